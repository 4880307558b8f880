"""`scan.next`: the pass that would decide an inspection which ends undecided."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from workbench import pieces
from workbench.artefacts import BEVEL_FACE, Chapter, Cloud, Document, Inspection, MilledEdge
from workbench.edge.end_templates import EdgeCondition
from workbench.edge.parameters import USUAL_NOISE_MM, RobotNoiseOrUsual, usual_noise_mm
from workbench.stage import InputFile, stage
from workbench.units import COVERAGE, DEG, Float

if TYPE_CHECKING:
    from workbench.result_files import SensorFile
    from workbench.scan_plan.information import Knowledge, PassInformation, Profiler

ELEVATIONS_DEG = tuple(range(-65, 85, 10))  # -25: both faces of a 40 deg bevel, and the lower surface, below 70 deg
SURE, LIKELY = 0.95, 0.5  # probability of a verdict that is promised, and that is worth a pass
POINT_MM = 5.0  # between points of the edge in the file
SHOWN_FROM_BELOW = {"lost_columns", "shadow"}  # conditions that a view of the lower surface settles
STANDOFF_MM = 100.0  # of a profiler whose range nobody told: its field of view is what counts
LEAST_MM, LEAST_DEG = 1e-4, 1e-3  # of a U that is told as a number
NAME = "next_scan.json"
NO_PASS = "no pass from -65° to 75° of elevation sees both faces with this profiler"


class Size(NamedTuple):
    """A size in one section, and its limits."""

    value: float
    u: float  # inf: it was not measured, and may lie anywhere between the limits
    low: float
    high: float

    def decided(self, u: float, guard_factor: float, reserve: float = 1.0) -> tuple[float, float]:
        """Probabilities that it passes and that it fails where u is predicted of all passes: more of them tell no less.

        What is measured then differs from what is known now by what is learned: its square is u^2 now less u^2 then.
        """
        u, guard = min(u, self.u), guard_factor * min(reserve * u, self.u)
        low, high = self.low + guard, self.high - guard
        if high <= low:
            return 0.0, 0.0
        if math.isinf(self.u):
            return max(high - low, 0.0) / (self.high - self.low), 0.0
        learned = math.sqrt(max(self.u**2 - u**2, 1e-24))

        def below(limit: float) -> float:
            return 0.5 * math.erfc((self.value - limit) / (math.sqrt(2.0) * learned))

        passes = max(below(high) - below(low), 0.0)
        return passes, below(self.low - guard) + 1.0 - below(self.high + guard)

    def needed(self, guard_factor: float) -> float:
        """U (k = 2) that decides, if the value stays; of what was not measured: a tenth of the tolerance's width."""
        if math.isinf(self.u):
            return max(0.1 * (self.high - self.low), 1e-9)
        margin = min(abs(self.value - self.low), abs(self.high - self.value))
        return max(COVERAGE * margin / max(guard_factor, 1e-9), 1e-9)


class Open(NamedTuple):
    """A section that is undecided."""

    section: int
    arc_length_mm: float
    sizes: dict[str, Size]  # by the name of the characteristic
    guard_factor: float

    @property
    def needed(self) -> dict[str, float]:
        """U (k = 2) that would decide its sizes that are undecided."""
        each = {name: (one, *one.decided(one.u, self.guard_factor)) for name, one in self.sizes.items()}
        return {name: one.needed(self.guard_factor) for name, (one, *known) in each.items() if max(known) < 0.5}

    @property
    def most(self) -> float:
        """The smaller of both, a tenth of a millimetre for a degree: sections with more of it are decided first."""
        return min((u * (0.1 if name == "bevel_deg" else 1.0) for name, u in self.needed.items()), default=math.inf)

    def decided(self, proposal: Proposal) -> float:
        """Probability that a further pass decides it, all sizes pass or one fails: over both edges of the prior."""
        return 0.5 * sum(self._decided(proposal._replace(root_mm=u)) for u in (proposal.root_mm, proposal.most_root_mm))

    def _decided(self, proposal: Proposal) -> float:
        each = [
            one.decided(getattr(proposal, name) / COVERAGE, self.guard_factor, proposal.reserve)
            for name, one in self.sizes.items()
        ]
        return math.prod(passes for passes, _ in each) + 1.0 - math.prod(1.0 - fails for _, fails in each)


class Proposal(NamedTuple):
    """A further pass, and what all passes together are predicted to tell, U (k = 2)."""

    elevation_deg: float
    root_mm: float
    bevel_deg: float
    most_root_mm: float  # by the edge of the prior that hides most
    shows_below: bool  # the lower surface is in view
    reserve: float  # over these, that nine of ten scans stay within


@stage("scan.next")
def next_(
    cloud: Cloud,
    edge: MilledEdge,
    inspection: Inspection,
    *,
    sensor: InputFile | None = None,
    edge_condition: EdgeCondition = "unknown",
    robot_noise_mm: RobotNoiseOrUsual = USUAL_NOISE_MM,
) -> tuple[Document | Chapter, ...]:
    """Name the pass that would decide an undecided inspection.

    Of elevations 10 deg apart it is the one that will probably decide most sections (docs/scan_planning.md, "The next
    scan"). `next_scan.json` is written only if some section is decided more likely than not.

    Args:
        cloud: the recording that was inspected.
        edge: the measured edge.
        inspection: its verdict.
        edge_condition: as in `edge.segment`.
        sensor: a sensor.json; columns, field of view and noise that it leaves open are the recording's.

    Example:
        >>> from workbench import cloud, edge, inspect, scan, scan_next
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> milled = edge.segment(points)
        >>> scan_next.next_(points, milled, inspect.sections(milled))
        ()
        >>> found = inspect.sections(milled, root_tolerance_mm=(-0.11, 0.11))
        >>> document, chapter = scan_next.next_(points, milled, found)
        >>> found.verdict, document.name
        ('undecided', 'next_scan.json')
    """
    if inspection.verdict != "undecided":
        return ()
    from workbench.result_files import SensorFile
    from workbench.scan_plan.information import Knowledge
    from workbench.scan_plan.plan_stage import as_profiler

    declared = SensorFile() if sensor is None else SensorFile.read(sensor)
    profiler = as_profiler(_as_recorded(cloud, declared), sensor)
    covariance = cloud.hand_eye_covariance
    turn = 0.0 if covariance is None else math.sqrt(float(np.trace(covariance[3:, 3:])) / 3.0)
    known = Knowledge(usual_noise_mm(robot_noise_mm), turn, edge_condition)
    left = open_sections(inspection)
    found = proposals(cloud, edge, profiler, known)
    below = any(one.name in SHOWN_FROM_BELOW for one in inspection.conditions)
    if below:
        found = [one for one in found if one.shows_below] or found
    if not found:
        return (_chapter(NO_PASS),)

    best = max(found, key=lambda one: (sum(section.decided(one) for section in left), -one.root_mm))
    chance = {one.section: one.decided(best) for one in left}
    if left and max(chance.values()) < LIKELY:
        return (_chapter(_none_decides(best, left)),)
    stretch = _stretch(left, inspection)
    sentence = _sentence(best, left, chance, stretch)
    return Document(NAME, _written(edge, best, stretch, left, chance, sentence)), _chapter(sentence)


def open_sections(inspection: Inspection) -> tuple[Open, ...]:
    """The undecided sections, with all that is required of them."""
    asked = [(one, one.limits) for one in inspection.characteristics if one.limits is not None]
    return tuple(
        Open(
            section.index,
            section.arc_length_mm,
            {of.name: Size(*(of.pairs[section.index - 1] or (math.nan, math.inf)), *limits) for of, limits in asked},
            inspection.guard_factor,
        )
        for section in inspection.sections
        if section.verdict == "undecided"
    )


def proposals(cloud: Cloud, edge: MilledEdge, profiler: Profiler, known: Knowledge) -> list[Proposal]:
    """Every elevation from which both faces are seen, with U of all passes together: no more than it is now."""
    from workbench.scan_plan.information import RESERVE, Joint, View, combined, information

    root, bevel = float(np.nanmedian(edge.root.value)), float(np.nanmedian(edge.bevel.value)) * DEG
    face = edge.faces[BEVEL_FACE]
    width = face.width_mm
    joint = Joint(root + width * math.cos(bevel), root, bevel)
    length = float(edge.arc_length_mm[-1])
    pitch = max(float(np.nanmedian(np.abs(np.diff(edge.frame_arc_length_mm)))), 1e-3)

    def seen_from(elevation: float) -> PassInformation | None:
        return information(joint, profiler, known, View(elevation, profiler.middle_mm, pitch), length)

    there = [one for elevation in _elevations(cloud, edge) if (one := seen_from(elevation)) is not None]
    now = np.nanmedian([edge.root.u, edge.bevel.u, edge.root.u], axis=1)
    found = []
    for elevation in ELEVATIONS_DEG:
        further = seen_from(elevation * DEG)
        if further is not None:
            both = combined(joint, known, (*there, further), length)
            predicted = np.array([both.root_mm, both.bevel_deg, both.most_root_mm])
            root_u, bevel_u, most_u = (COVERAGE * np.fmin(predicted, now)).tolist()
            found.append(Proposal(elevation, root_u, bevel_u, most_u, further.step_mm == 0.0, RESERVE))
    return found


def _elevations(cloud: Cloud, edge: MilledEdge) -> list[float]:
    """Of each pass: how far the scanner stands above the root face's normal, rad."""
    seen = np.flatnonzero(np.isfinite(edge.frame_arc_length_mm))
    between = 0.5 * (edge.arc_length_mm[1:] + edge.arc_length_mm[:-1])
    station = np.searchsorted(between, edge.frame_arc_length_mm[seen])
    z = cloud.base_from_profiler[seen, :3, 2]
    out, up = ((z * axis[station]).sum(axis=1) for axis in (edge.normal, edge.across))
    elevation = np.arctan2(up * np.sign(out), np.abs(out))
    passes = cloud.pass_index[seen]
    return [float(np.median(elevation[passes == one])) for one in np.unique(passes)]


def _as_recorded(cloud: Cloud, declared: SensorFile) -> SensorFile:
    """What is told, else what was returned: columns, as wide as they reach, and the noise between neighbours."""
    from workbench.scan_plan.edges import noise_mm

    x, z = cloud.x_mm[:: max(1, len(cloud.x_mm) // 200)], cloud.z_mm[:: max(1, len(cloud.z_mm) // 200)].astype(float)
    width = float(np.nanmax(x) - np.nanmin(x))
    near, far = STANDOFF_MM - 0.5 * width, STANDOFF_MM + 0.5 * width
    returned = {
        "columns": cloud.x_mm.shape[1],
        "measuring_range_mm": (near, far),
        "width_mm": (width, width),
        "noise_mm": max(noise_mm(z), 1e-4),
    }
    return declared.model_copy(update={key: of for key, of in returned.items() if getattr(declared, key) is None})


def _sentence(best: Proposal, left: Sequence[Open], chance: dict[int, float], stretch: tuple[float, float]) -> str:
    """What to do next, in words."""
    pass_ = (
        f"A further pass at {best.elevation_deg:g}° above the root face's normal, from {stretch[0]:.0f} to "
        f"{stretch[1]:.0f} mm, where nothing covers the edge: U is predicted as {_mm(best.root_mm)} "
        f"and {_deg(best.bevel_deg)}"
    )
    if not left:
        return f"{pass_}, and the lower surface is in view." if best.shows_below else f"{pass_}; conditions remain."
    sure = sum(one >= SURE for one in chance.values())
    likely = max(math.floor(sum(chance.values())), sure)
    words = f"{pass_}. As it also changes the values, it probably decides {likely} of {len(left)} undecided sections"
    words += f", {sure} of them at {100 * SURE:.0f} %" if sure else ""
    rest = [one for one in left if chance[one.section] < LIKELY]
    if not rest:
        return f"{words}."
    return f"{words}; {_needed(min(rest, key=lambda one: one.most))}."


def _none_decides(best: Proposal, left: Sequence[Open]) -> str:
    """What would decide sections that no pass decides, in words."""
    return (
        f"No further pass decides any of the {len(left)} undecided sections: the best, at {best.elevation_deg:g}° "
        f"above the root face's normal, is predicted to leave U = {_mm(best.root_mm)} and {_deg(best.bevel_deg)}; "
        f"{_needed(max(left, key=lambda one: one.most))}: what would decide it is a sensor or robot that errs less, or "
        "a size farther from the limit."
    )


def _needed(one: Open) -> str:
    need = " and ".join((_deg if name == "bevel_deg" else _mm)(u) for name, u in one.needed.items())
    return f"section {one.section} lies so near a limit that U = {need} would be needed"


def _mm(u: float) -> str:
    return f"{u:.2g} mm" if u >= LEAST_MM else f"less than {LEAST_MM:g} mm"


def _deg(u: float) -> str:
    return f"{u:.2g}°" if u >= LEAST_DEG else f"less than {LEAST_DEG:g}°"


def _stretch(left: Sequence[Open], inspection: Inspection) -> tuple[float, float]:
    """Arc lengths that the pass covers: half a distance of sections beyond those that are undecided; all of it else."""
    length = float(inspection.profile.arc_length_mm[-1])
    if not left:
        return 0.0, length
    half = 0.5 * length / len(inspection.sections)
    return max(left[0].arc_length_mm - half, 0.0), min(left[-1].arc_length_mm + half, length)


def _written(
    edge: MilledEdge,
    best: Proposal,
    stretch: tuple[float, float],
    left: Sequence[Open],
    chance: dict[int, float],
    sentence: str,
) -> bytes:
    """`next_scan.json`: an edge-line with what is proposed along it."""
    seen = np.isfinite(edge.position_mm).all(axis=1)
    at = edge.arc_length_mm[seen]
    first, last = stretch
    places = np.linspace(first, last, max(2, round((last - first) / POINT_MM) + 1))
    points: Float = np.stack([np.interp(places, at, edge.position_mm[seen, k]) for k in range(3)], axis=1)

    def least(name: str) -> float | None:
        return min((one.needed[name] for one in left if name in one.needed), default=None)

    document = {
        "format": "edge-line",
        "version": 1,
        "points_mm": np.round(points, 6).tolist(),
        "upper_side": np.round(np.nanmean(edge.across, axis=0), 9).tolist(),
        "sentence": sentence,
        "elevation_deg": best.elevation_deg,
        "from_mm": round(first, 3),
        "to_mm": round(last, 3),
        "predicted_root_U_mm": best.root_mm,
        "predicted_bevel_U_deg": best.bevel_deg,
        "wanted_root_U_mm": least("root_mm"),
        "wanted_bevel_U_deg": least("bevel_deg"),
        "undecided_sections": [one.section for one in left],
        "decided_by_it": [number for number, one in chance.items() if one >= SURE],
        "probability": [round(one, 3) for one in chance.values()],
    }
    return json.dumps(document, indent=1, allow_nan=False).encode() + b"\n"


def _chapter(sentence: str) -> Chapter:
    return Chapter(title="What would decide it", html=pieces.list_html([sentence]), summary=sentence)
