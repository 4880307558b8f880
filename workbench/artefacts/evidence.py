"""Whose measurement it is, by whom, when, with which instruments; and what was checked of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from datetime import date, datetime
from typing import Any, ClassVar, Literal

Verdict = Literal["pass", "fail", "undecided"]

UNSEEN = (
    "Errors of scale and linearity of the profile sensor (see its calibration certificate), and what it drifts during "
    "the scan, as while it warms up.",
    "Errors of the robot's position that stay constant within a pass, such as those of its kinematic calibration; "
    "where a pass has only the poses of its two ends, how far the robot left the straight line between them.",
    "A rotation of the laser plane by up to 20°, a displaced hand-eye pose, mirrored axes, an orientation that was not "
    "measured, and a scale error or the reverse sense of the robot's travel: passes in which the flange hardly turns "
    "do not reveal them.",
    "An offset between the clocks of profiler and robot, unless the motion shows it: it moves values along the edge.",
    "A burr in the plane of the root face or end face, or a loss of returns at its end, along the whole edge: no "
    "profile reveals it. An allowance for it can be declared.",
    "A recess below the root face or end face, in its shadow along the rays: an undercut, a chamfer of the lower edge.",
    "An even layer of paint, scale or coolant: the surface that returns the light is measured.",
)  # what no recording of a straight edge shows


SCALE = 1e-3  # of x against z; data sheets of laser profilers tell a few parts in a thousand of the range
CUT_AWAY_MM = 0.1  # of a face's end, that returns nothing or is not there
COSTS = {"root_mm": ("root face", " mm"), "bevel_deg": ("bevel angle", "°")}
COSTS |= {"gap_mm": ("gap", " mm"), "depth_mm": ("depth", " mm"), "width_mm": ("width", " mm")}
COSTS |= {"included_deg": ("included angle", "°")}


ACCEPTED = "accepted by name"  # how a verdict begins what its pass rests on


@dataclass(frozen=True, slots=True)
class Unseen:
    """What a recording does not show of itself, and what it may cost its values: where any is known, others nothing.

    >>> Unseen("clock_offset", "A clock that is 10 ms off.", {"root_mm": 0.0021}).told
    'A clock that is 10 ms off (root face 0.0021 mm).'
    """

    name: str  # by which a user accepts it
    sentence: str
    costs: Mapping[str, float] = field(default_factory=dict)  # by size, in its unit; empty: not known
    is_doubt: bool = False  # of what was measured at all: the verdict rests on it whatever it costs
    exchanges: bool = False  # values between places: the verdict of the part is the same either way

    @property
    def told(self) -> str:
        """The sentence with its sizes."""
        costs = ", ".join(f"{COSTS[name][0]} {cost:.2g}{COSTS[name][1]}" for name, cost in self.costs.items() if cost)
        return f"{self.sentence.rstrip('.')} ({costs})." if costs else self.sentence


@dataclass(frozen=True, slots=True)
class Check:
    """One plausibility check. Checks travel with what they are of: recording, cloud, edge, inspection, toolpath.

    The unit of `value` and `limit` stands in `name`; a name without one is a pure number.
    """

    name: str  # such as 'obliquity_deg'
    value: float | None  # None: nothing to judge by, and `finding` says why
    limit: float | tuple[float, float] | None  # greatest allowed value, or least and greatest; None: reported only
    passed: bool
    reason: str  # why the limit is where it is
    finding: str = ""  # what was found, in words; of a failed check: the suspicion
    loosened: bool = False  # a parameter made it weaker than the rule: results say so, and a path then ends in exit 1


DATES = ("recorded_at", "sensor_calibrated_at")  # ISO 8601
MOST_CHARACTERS = 200
LINEAR_AXIS = "linear axis"  # a `robot` that is none: its positions are its travel, from any zero


@dataclass(frozen=True, slots=True)
class PartNames:
    """What a recording or a user may say of a part; None: unknown. Free text out of files: data, never a path."""

    __pydantic_config__: ClassVar[Any] = {
        "extra": "forbid",
        "coerce_numbers_to_str": True,
        "str_max_length": MOST_CHARACTERS,
    }

    part_id: str | None = None
    drawing: str | None = None
    operator: str | None = None
    recorded_at: str | None = None
    sensor: str | None = None
    sensor_serial: str | None = None
    sensor_calibrated_at: str | None = None
    robot: str | None = None
    robot_serial: str | None = None

    def __post_init__(self) -> None:
        """Dates must be such."""
        for name in DATES:
            if (text := getattr(self, name)) is not None and iso_date(text) is None:
                raise ValueError(f"{name}: expected a date as 2026-03-31 or 2026-03-31T14:05 (ISO 8601), got {text!r}")


@dataclass(frozen=True, slots=True)
class Part(PartNames):
    """The identity that goes with a measurement from the recording to every result.

    >>> Part(part_id="A-7", sensor="LPS 36").with_names(PartNames(part_id="A-8")).part_id
    'A-8'
    """

    __pydantic_config__: ClassVar[Any] = {"extra": "ignore"}  # files may hold more

    simulated: bool | None = None  # True: no real part was measured
    scan_plan: str | None = None  # id of the scan-plan.json that was followed
    hand_eye: str | None = None  # the hand-eye calibration in use: its file, or 'the recording's own'
    hand_eye_calibrated_at: str | None = None  # ISO 8601
    hand_eye_u_mm: float | None = None  # RMS over the field of view, as its file predicts it

    def with_names(self, names: PartNames) -> Part:
        """The same part with what `names` says in place of its own."""
        own = {f.name: getattr(self, f.name) for f in fields(Part)}
        return Part(**{**own, **{f.name: v for f in fields(PartNames) if (v := getattr(names, f.name)) is not None}})

    def contradicted(self, names: PartNames) -> list[str]:
        """What `names` says otherwise, in words."""
        both = ((f.name, getattr(self, f.name), getattr(names, f.name)) for f in fields(PartNames))
        return [
            f"{name}: the file says {own!r}, the run {given!r}"
            for name, own, given in both
            if own is not None and given is not None and own != given
        ]


def shared(parts: Sequence[Part]) -> Part:
    """What several measurements agree on; None where they differ, or one of them says nothing.

    >>> found = shared([Part(part_id="A-7", robot="R1"), Part(part_id="A-8", robot="R1")])
    >>> found.part_id, found.robot
    (None, 'R1')
    """
    said = {f.name: {getattr(one, f.name) for one in parts} for f in fields(Part)}
    return Part(**{name: next(iter(found)) for name, found in said.items() if len(found) == 1})


UNKNOWN_PART = Part()
NO_NAMES = PartNames()


def iso_date(text: str) -> date | None:
    """The day of an ISO 8601 date or time; None: it is none."""
    try:
        return datetime.fromisoformat(text).date()
    except ValueError:
        return None
