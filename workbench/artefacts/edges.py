"""The edge, groove or preparation that was found, and what was measured on it against what was asked for.

Terms of joint preparations are those of ISO 9692-1 and ISO 17659.
"""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from workbench.artefacts.evidence import UNKNOWN_PART, Check, Part, Unseen, Verdict
from workbench.artefacts.quantities import Quantity
from workbench.artefacts.showing import AlongTheEdge, along_chart, rows_table
from workbench.geometry.chains import FaceLines
from workbench.pieces import table_html
from workbench.units import AnyArray, Bool, Float, Int, Shaped

# Face labels of a grid point, in `Edge.labels` (uint8).
UNLABELLED, ROOT_FACE, BEVEL_FACE, UPPER_SURFACE, LOWER_SURFACE = range(5)
FACE_NAMES = ("unlabelled", "root face", "bevel face", "upper surface", "lower surface")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Edge(AlongTheEdge):
    """The workpiece's edge as measured: faces a frame, the lower edge as a curve in the base.

    t = m x n (docs/conventions.md). Curve arrays have one row a *station*, about 1 mm apart, from arc length 0 at the
    first measured point of the lower edge to its last.
    """

    faces: Mapping[int, FaceLines]  # by label: ROOT_FACE (the end face of a raw edge), BEVEL_FACE, ...
    labels: Shaped[AnyArray, "N M"]  # uint8, face of each grid point
    pass_index: Shaped[Int, " N"]
    # where each frame crosses the lower edge; NaN: edge not seen in that frame
    frame_arc_length_mm: Shaped[Float, " N"]
    arc_length_mm: Shaped[Float, " n"]
    position_mm: Shaped[Float, "n 3"]  # lower edge in the base; NaN where hidden
    tangent: Shaped[Float, "n 3"]  # unit, rising arc length; interpolated where hidden
    tangent_u: Shaped[Float, " n"]  # standard uncertainty of the tangent's direction, rad
    normal: Shaped[Float, "n 3"]  # unit outward normal of the end face (root face), in the section plane
    across: Shaped[Float, "n 3"]  # unit, m: from the lower to the upper side
    seen: Shaped[Bool, " n"]  # measured here; False under clamps and in other gaps
    burr_stations: Shaped[Int, " b"]  # stations where material stands out beyond the faces
    part: Part = UNKNOWN_PART
    source: str = ""  # the file it was measured in
    warnings: tuple[str, ...] = ()
    unseen: tuple[Unseen, ...] = ()  # what this recording does not show of itself
    checks: tuple[Check, ...] = ()  # of the cloud that it was found in, and of the faces


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MilledEdge(Edge):
    """A milled edge: root face and bevel face, with the width of one and the angle of the other at each station."""

    root: Quantity  # (n,) `root_mm`, the root face
    bevel: Quantity  # (n,) `bevel_deg`, the bevel angle


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RawEdge(Edge):
    """A raw edge: an end face between the two surfaces of the plate."""

    upper_position_mm: Shaped[Float, "n 3"]  # its upper edge; NaN where hidden
    upper_inward: Shaped[Float, "n 3"]  # unit, along the upper surface, into the plate
    position_u_mm: Shaped[Float, "n 2"]  # standard uncertainty of `position_mm` along `normal` and `across`
    normal_u: Shaped[Float, " n"]  # standard uncertainty of the direction of `normal` about the tangent, rad
    hand_eye_u_mm: Shaped[Float, "n 2"] | None = (
        None  # as `position_u_mm`: what the hand-eye pose adds, one for the whole scan
    )
    hand_eye_turn: Shaped[Float, " n"] | None = None  # of `normal_u`: what the hand-eye pose has in it, rad
    # `along_normal_mm`, `along_across_mm` and `axis_deg`, whose u are `position_u_mm` and `normal_u`; (): not told
    budget: tuple[Quantity, ...] = ()


MOST_OFF = 50.0  # of a size from its nominal one, mm or deg: thicker plates have no such edge
Deviations = tuple[Annotated[float, Field(ge=-MOST_OFF, le=0)], Annotated[float, Field(ge=0, le=MOST_OFF)]]


@dataclass(frozen=True, slots=True, eq=False)
class Requirements:
    """What the part must satisfy: nominal values and deviations from them, lower <= 0 <= upper."""

    root_nominal_mm: float = 1.5
    root_tolerance_mm: tuple[float, float] = (-0.5, 0.5)
    bevel_nominal_deg: float = 40.0
    bevel_tolerance_deg: tuple[float, float] = (-1.0, 1.0)


def conformity(value: float, u: float, nominal: float, tolerance: tuple[float, float], guard_factor: float) -> Verdict:
    """Whether a value with standard uncertainty u conforms to nominal + tolerance, all in one unit (ISO 14253-1).

    'pass' inside the limits by at least guard_factor * u, 'fail' outside by at least that, else 'undecided'.
    """
    low, high, guard = nominal + tolerance[0], nominal + tolerance[1], guard_factor * u
    if low + guard <= value <= high - guard:
        return "pass"
    if value <= low - guard or value >= high + guard:
        return "fail"
    return "undecided"


BEVEL_TERMS = {  # of ISO 9692-1
    "root_mm": ("Root face", "c"),
    "bevel_deg": ("Bevel angle", "β"),
}
ROOT_AND_BEVEL = "root_mm", "bevel_deg"  # what the cutter sets


def named(size: str, what: str) -> str:
    """`gap_u_mm` of `gap_mm` and `u`, `gap_tolerance_mm` of `tolerance`."""
    stem, _, unit = size.rpartition("_")
    return f"{stem}_{what}_{unit}"


def u_name(size: str) -> str:
    """Name of a size's standard uncertainty: `gap_u_mm` of `gap_mm`."""
    return named(size, "u")


Required = Mapping[str, tuple[float, tuple[float, float]]]  # by size: nominal, deviations lower <= 0 <= upper


def required_in_file(requirements: Mapping[str, Any]) -> Required:
    """What result files require, of a bevel as `root_nominal_mm`, of a joint as `gap_mm`, each with its tolerance.

    >>> required_in_file({"gap_mm": 2, "gap_tolerance_mm": [-0.5, 0.5]})
    {'gap_mm': (2.0, (-0.5, 0.5))}
    """
    found = {}
    for key, pair in requirements.items():
        stem, here, unit = key.rpartition("_tolerance_")
        if here and pair is not None:
            nominal = requirements.get(f"{stem}_nominal_{unit}", requirements.get(f"{stem}_{unit}"))
            found[f"{stem}_{unit}"] = float(nominal), (float(pair[0]), float(pair[1]))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Characteristic:
    """A size of a joint over the sections of an inspection, and what is required of it.

    >>> gap = Quantity.of("gap_mm", np.array([2.0, 2.6]), {"faces": 0.05})
    >>> wanted = Characteristic(gap, "Root gap", "b", (2.0, (-0.5, 0.5)), guard_factor=1.645)
    >>> wanted.limits, wanted.verdicts
    ((1.5, 2.5), ('pass', 'fail'))
    """

    quantity: Quantity  # (n,) one value per section; NaN where it was not measured
    term: str  # of ISO 9692-1 or ISO 17659
    letter: str  # of ISO 9692-1; '–' where it has none
    required: tuple[float, tuple[float, float]] | None = None  # nominal, deviations lower <= 0 <= upper; None: nothing
    guard_factor: float = 1.645

    @property
    def name(self) -> str:
        """As in result files."""
        return self.quantity.name

    @property
    def is_angle(self) -> bool:
        """Whether it is an angle, in degrees, and no length, in mm."""
        return self.quantity.unit == "deg"

    @property
    def symbol(self) -> str:
        """Its letter in ASCII, 'beta' or 'c1', or its name without the unit."""
        return self.name.rpartition("_")[0] if self.letter == "–" else self.letter.translate(PLAIN_LETTERS)

    @property
    def limits(self) -> tuple[float, float] | None:
        """Lower and upper limit of the value."""
        if self.required is None:
            return None
        nominal, (lower, upper) = self.required
        return nominal + lower, nominal + upper

    @property
    def pairs(self) -> tuple[tuple[float, float] | None, ...]:
        """Value and standard uncertainty in each section; None where it was not measured."""
        known = np.isfinite(self.quantity.value) & np.isfinite(self.quantity.u)
        pairs = zip(self.quantity.value.tolist(), self.quantity.u.tolist(), strict=True)
        return tuple(pair if one else None for pair, one in zip(pairs, known.tolist(), strict=True))

    @property
    def verdicts(self) -> tuple[Verdict | None, ...]:
        """Of each section (ISO 14253-1), undecided where nothing was measured; None where nothing is required."""
        wanted = self.required
        if wanted is None:
            return (None,) * len(self.pairs)
        return tuple(conformity(*pair, *wanted, self.guard_factor) if pair else "undecided" for pair in self.pairs)

    @property
    def budget(self) -> dict[str, float]:
        """What each source contributes in the section of the largest uncertainty; {}: not measured."""
        u = np.array([np.nan if pair is None else pair[1] for pair in self.pairs], float)
        if not np.isfinite(u).any():
            return {}
        worst = int(np.nanargmax(u))
        return {
            source: float(np.broadcast_to(one, u.shape)[worst]) for source, one in self.quantity.u_by_source.items()
        }


PLAIN_LETTERS = str.maketrans({"α": "alpha", "β": "beta", "₁": "1", "₂": "2"})


class JointInspection(ABC):
    """A joint's preparation in sections against its requirements (ISO 14253-1 with guard band `guard_factor` * u)."""

    __slots__ = ()
    FORMAT: ClassVar[str]  # of its result file
    WHAT: ClassVar[str]  # in words
    terms: ClassVar[Mapping[str, tuple[str, str]]]  # of each size: term and letter
    sections: tuple[Section, ...]
    guard_factor: float
    verdict: Verdict
    reason: str
    uncertainty: Uncertainty
    conditions: tuple[Unseen, ...]  # on which a pass rests, and that nobody accepted
    part: Part
    warnings: tuple[str, ...]
    checks: tuple[Check, ...]
    source: str

    @property
    @abstractmethod
    def requirements_in_file(self) -> Mapping[str, Any]:
        """What is required, as result files tell it."""

    def more_html(self) -> str:
        """Verdict and reason, and one row per section: each size with U = 2 u."""
        found = self.characteristics
        head = ["section", *(f"{one.term}, {'°' if one.is_angle else 'mm'}" for one in found), "verdict"]
        pairs = zip(*(one.pairs for one in found), strict=True)
        cells = ([f"{pair[0]:.3f} ± {2 * pair[1]:.3f}" if pair else "not measured" for pair in row] for row in pairs)
        rows = [[f"{s.index}", *row, s.verdict] for s, row in zip(self.sections, cells, strict=True)]
        return f"<p><b>{self.verdict}</b>: {html.escape(self.reason)}</p>{table_html(head, rows)}"

    @property
    def required(self) -> Required:
        """Nominal value and deviations of every size of which something is required."""
        return required_in_file(self.requirements_in_file)

    @property
    def characteristics(self) -> tuple[Characteristic, ...]:
        """Every size that is required or that some section has, in the order of reports."""
        required = self.required
        there = {name for section in self.sections for name in section.sizes} | {*required}
        return tuple(
            Characteristic(
                Quantity.joined(name, [section.sizes.get(name) for section in self.sections]),
                *words,
                required.get(name),
                self.guard_factor,
            )
            for name, words in self.terms.items()
            if name in there
        )

    @property
    def sources(self) -> tuple[Mapping[str, Any], ...]:
        """The uncertainty budget: name, kind and u of every size, each in its worst section."""
        found = [(one, budget) for one in self.characteristics if (budget := one.budget)]
        kinds = {term.source: term.kind for one, _ in found for term in one.quantity.terms}
        rows = (
            {"name": source, "kind": kind, **{u_name(one.name): budget.get(source, 0.0) for one, budget in found}}
            for source, kind in kinds.items()
        )
        return tuple(row for row in rows if any(isinstance(u, float) and u > 0.0 for u in row.values()))

    def table(self) -> Any:
        """One row per section: a pandas DataFrame where pandas is installed, else a list of dicts."""
        return rows_table(
            [
                {"index": s.index, "arc_length_mm": s.arc_length_mm, **s.values, "verdict": s.verdict}
                for s in self.sections
            ]
        )

    def rows(self) -> list[dict[str, Any]]:
        """One row per section, for others' tables: place in the base, sizes with their u, verdict; None: hidden."""
        return [
            {
                "section": s.index,
                "arc_length_mm": s.arc_length_mm,
                **dict(zip(("x_mm", "y_mm", "z_mm"), s.origin_mm.tolist(), strict=True)),
                **s.values,
                "verdict": s.verdict,
                "reason": s.reason,
            }
            for s in self.sections
        ]


def sizes_in_file(sizes: Mapping[str, Quantity]) -> dict[str, float | None]:
    """Sizes at one place with their standard uncertainties, by the names of result files; None: not measured."""
    found: dict[str, float | None] = {}
    for name, one in sizes.items():
        known = bool(np.isfinite(one.value) and np.isfinite(one.u))
        found[name], found[u_name(name)] = (float(one.value), float(one.u)) if known else (None, None)
    return found


CHAIN = ("upper", "middle", "root", "lower")  # corners of a plate, from its upper surface down


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """One inspected section: values, standard uncertainties and corners, as in the result files."""

    index: int  # from 1
    arc_length_mm: float
    origin_mm: Shaped[Float, " 3"]  # of a plate on the lower edge
    tangent: Shaped[Float, " 3"]  # unit, normal of the section plane
    normal: Shaped[Float, " 3"]  # unit, n
    across: Shaped[Float, " 3"]  # unit, m
    sizes: Mapping[str, Quantity]  # () each; NaN where they were not measured
    verdict: Verdict
    reason: str
    frames: Int  # indices of the frames that it rests on
    corners: tuple[Mapping[str, Any], ...] = ()  # of a joint

    @property
    def values(self) -> dict[str, float | None]:
        """Sizes and their u, as in the result files; None: not measured."""
        return sizes_in_file(self.sizes)

    @property
    def root_and_bevel(self) -> tuple[float, float] | None:
        """Root face, mm, and bevel angle, degrees, of a milled bevel; None: not measured."""
        root, bevel = (self.values.get(name) for name in ROOT_AND_BEVEL)
        return None if root is None or bevel is None else (root, bevel)

    @property
    def places(self) -> dict[str, Float]:
        """The corners that were seen, (2,) each along `normal` and `across` from the origin, mm."""
        return {one["name"]: np.array(one["section_mm"]) for one in self.corners}

    @property
    def chains(self) -> tuple[Float, ...]:
        """The faces as chains of corners (k, 2), one a plate, from its upper surface down; none of a fillet's flank."""
        corner, below = self.places, 1 if "root_radius_mm" in self.sizes else 0
        sides = ([corner[s + each] for each in CHAIN[below:] if s + each in corner] for s in ("left_", "right_", ""))
        return tuple(np.array(chain) for chain in sides if len(chain) > 1)


@dataclass(frozen=True, slots=True, eq=False)
class EdgeProfile:
    """Root face and bevel angle along the whole edge; NaN where they cannot be measured."""

    arc_length_mm: Shaped[Float, " n"]
    position_mm: Shaped[Float, "n 3"]  # lower edge in the base
    root_mm: Shaped[Float, " n"]
    root_u_mm: Shaped[Float, " n"]
    bevel_deg: Shaped[Float, " n"]
    bevel_u_deg: Shaped[Float, " n"]
    root_u_by_source_mm: Mapping[str, Float] = field(default_factory=dict)  # (n,) each; squares add; empty: not told
    bevel_u_by_source_deg: Mapping[str, Float] = field(default_factory=dict)

    @property
    def sizes(self) -> dict[str, Quantity]:
        """Root face and bevel angle, (n,) each."""
        return {
            "root_mm": Quantity.of("root_mm", self.root_mm, self.root_u_by_source_mm or {"as stated": self.root_u_mm}),
            "bevel_deg": Quantity.of(
                "bevel_deg", self.bevel_deg, self.bevel_u_by_source_deg or {"as stated": self.bevel_u_deg}
            ),
        }


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """What goes with the uncertainty budget, whose sources the sections' sizes hold."""

    coverage_factor: float = 2.0
    not_included: tuple[Unseen, ...] = ()
    correlations: str = ""  # why the squares of the sources do not add up, where they do not


NO_BUDGET = Uncertainty()


@dataclass(frozen=True, slots=True, eq=False)
class Inspection(JointInspection):
    """A milled bevel against its requirements."""

    FORMAT: ClassVar = "bevel-inspection"
    WHAT: ClassVar = "milled bevel"
    terms: ClassVar = BEVEL_TERMS
    sections: tuple[Section, ...]
    profile: EdgeProfile
    requirements: Requirements
    guard_factor: float
    verdict: Verdict
    reason: str
    root_face_tilt: str  # how the root face's tilt was estimated: 'whole edge' or 'per section'
    part: Part = UNKNOWN_PART
    uncertainty: Uncertainty = NO_BUDGET
    warnings: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()  # what was checked of recording and faces
    source: str = ""  # the file it was measured in
    conditions: tuple[Unseen, ...] = ()

    @property
    def requirements_in_file(self) -> Mapping[str, Any]:
        """As `inspection.json` has them."""
        return asdict(self.requirements)

    def plot(self) -> Any:
        """A matplotlib Figure of root face and bevel angle along the edge, with U = 2 u."""
        p = self.profile
        root, bevel = ("root face, mm", p.root_mm, p.root_u_mm), ("bevel angle, deg", p.bevel_deg, p.bevel_u_deg)
        return along_chart(p.arc_length_mm, root, bevel)


GrooveType = Literal["I", "V", "Y", "HV", "HY", "X", "K", "U", "J"]
PreparationType = Literal["bevel", "compound", "nose", "J"]
SIZES = (
    "gap_mm",
    "root_face_left_mm",
    "root_face_right_mm",
    "bevel_left_deg",
    "bevel_right_deg",
    "included_deg",
    "depth_mm",
    "width_mm",
    "misalignment_mm",
    "root_radius_mm",
)

TERMS = {  # of ISO 17659 and letters of ISO 9692-1, which has none for the last two; in the order of reports
    "gap_mm": ("Root gap", "b"),
    "root_face_left_mm": ("Root face, left", "c₁"),
    "root_face_right_mm": ("Root face, right", "c₂"),
    "bevel_left_deg": ("Bevel angle, left", "β₁"),
    "bevel_right_deg": ("Bevel angle, right", "β₂"),
    "included_deg": ("Included angle", "α"),
    "depth_mm": ("Depth of preparation", "h"),
    "root_radius_mm": ("Root radius", "R"),
    "width_mm": ("Width", "–"),
    "misalignment_mm": ("Linear misalignment", "–"),
}
PREPARATION_TERMS = {  # likewise, of one plate
    "root_face_mm": ("Root face", "c"),
    "bevel_deg": ("Bevel angle", "β"),
    "upper_bevel_deg": ("Upper bevel angle", "β₂"),
    "lower_bevel_mm": ("Height of the lower bevel", "h₁"),
    "land_mm": ("Land", "–"),
    "depth_mm": ("Depth of preparation", "h"),
    "root_radius_mm": ("Root radius", "R"),
    "width_mm": ("Width", "–"),
}
ALL_TERMS: Mapping[str, tuple[str, str]] = {**BEVEL_TERMS, **TERMS, **PREPARATION_TERMS}  # of every joint


@dataclass(frozen=True, slots=True, eq=False)
class Corner:
    """A corner of the groove along it: (right, up) of the section's axes from its origin; NaN where not seen."""

    section_mm: Shaped[Float, "n 2"]
    u_mm: Shaped[Float, "n 2"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Joint:
    """What is measured of a joint's preparation, one row a station about 1 mm apart along it."""

    terms: ClassVar[Mapping[str, tuple[str, str]]]  # of each size: term and letter
    type: str
    alternatives: tuple[str, ...] = ()  # types that the side seen does not exclude
    declared: bool  # the type was given, and is not excluded; else it was chosen by the evidence
    arc_length_mm: Shaped[Float, " n"]
    origin_mm: Shaped[Float, "n 3"]  # in the base
    tangent: Shaped[Float, "n 3"]
    normal: Shaped[Float, "n 3"]
    across: Shaped[Float, "n 3"]
    seen: Shaped[Bool, " n"]
    sizes: Mapping[str, Quantity]  # by names of `terms`: (n,) mm, or degrees; those that were seen
    corners: Mapping[str, Corner]
    frame_arc_length_mm: Shaped[Float, " N"]  # NaN: not seen in that frame
    x_mm: Shaped[AnyArray, "N M"]  # lateral places of the columns, for telling a corner's column
    base_from_profiler: Shaped[Float, "N 4 4"]
    pass_index: Shaped[AnyArray, " N"]
    part: Part = UNKNOWN_PART
    warnings: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()
    unseen: tuple[Unseen, ...] = ()  # doubts on which a pass rests


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Groove(Joint):
    """A groove between two plates.

    Axes of the section: `normal` from the left plate to the right one along their upper surfaces, `across` up, out of
    the plates; tangent = across x normal. Its origin lies between the upper edges of both plates.
    """

    terms: ClassVar = TERMS
    type: GrooveType
    alternatives: tuple[GrooveType, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Preparation(Joint):
    """The prepared edge of one plate: root face, bevels, land, fillet.

    Axes of the section: `normal` out of the root face, `across` from the lower to the upper side; tangent = across x
    normal. Its origin is the lower edge.
    """

    terms: ClassVar = PREPARATION_TERMS
    type: PreparationType
    alternatives: tuple[PreparationType, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RecognisedInspection(JointInspection):
    """Of a joint whose type was recognised or declared."""

    type: str
    alternatives: tuple[str, ...]
    declared: bool
    sections: tuple[Section, ...]
    requirements: Mapping[str, Any]
    guard_factor: float
    verdict: Verdict
    reason: str
    uncertainty: Uncertainty
    part: Part = UNKNOWN_PART
    warnings: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()
    source: str = ""
    conditions: tuple[Unseen, ...] = ()

    @property
    def requirements_in_file(self) -> Mapping[str, Any]:
        """As `groove.json` has them."""
        return self.requirements


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GrooveInspection(RecognisedInspection):
    """A groove against its requirements."""

    FORMAT: ClassVar = "groove-inspection"
    WHAT: ClassVar = "groove"
    terms: ClassVar = TERMS


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PreparationInspection(RecognisedInspection):
    """The prepared edge of one plate against its requirements."""

    FORMAT: ClassVar = "preparation-inspection"
    WHAT: ClassVar = "preparation"
    terms: ClassVar = PREPARATION_TERMS
