"""`scan.next`: the pass that would decide an inspection which ends undecided."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from workbench import pieces
from workbench.artefacts import BEVEL_FACE, Chapter, Cloud, Document, Inspection, MilledEdge
from workbench.edge.broken_end import EdgeCondition
from workbench.edge.parameters import USUAL_NOISE_MM, RobotNoiseOrUsual, usual_noise_mm
from workbench.stage import InputFile, stage
from workbench.units import DEG, Float

if TYPE_CHECKING:
    from workbench.scan_plan.information import Knowledge, PassInformation, Profiler

ELEVATIONS_DEG = tuple(range(-65, 85, 10))  # -25: both faces of a 40 deg bevel, and the lower surface, below 70 deg
COVERAGE = 2.0
POINT_MM = 5.0  # between points of the edge in the file
SHOWN_FROM_BELOW = {"lost_columns", "shadow"}  # conditions that a view of the lower surface settles
STANDOFF_MM = 100.0  # of a profiler whose sensor file is not given: its field of view is what counts
LEAST_MM, LEAST_DEG = 1e-4, 1e-3  # of a U that is told as a number
NAME = "next_scan.json"
NO_PASS = "no pass from -65° to 75° of elevation sees both faces with this profiler"


class Open(NamedTuple):
    """A section that is undecided: U (k = 2) below which it would be decided; inf: decided already."""

    section: int
    arc_length_mm: float
    root_mm: float
    bevel_deg: float

    def most(self) -> float:
        """The smaller of both, a tenth of a millimetre for a degree: sections with more of it are decided first."""
        return min(self.root_mm, 0.1 * self.bevel_deg)

    def over(self, root: float, bevel: float) -> float:
        """U of both sizes over what decides."""
        return max(root / self.root_mm, bevel / self.bevel_deg)


class Proposal(NamedTuple):
    """A further pass, and what all passes together are predicted to tell, U (k = 2)."""

    elevation_deg: float
    root_mm: float
    bevel_deg: float
    shows_below: bool  # the lower surface is in view


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

    Of elevations 10 deg apart the one that, added to the passes that are there, decides most sections by the u that
    `scan.plan` predicts. `next_scan.json` is an `edge` for `plan_scan.json`, which checks it against robot and
    fixtures; it is written only if some section would be decided.

    Args:
        cloud: the recording that was inspected.
        edge: the measured edge.
        inspection: its verdict.
        edge_condition: as in `edge.segment`.
        sensor: a sensor.json; null: columns, field of view and noise of the recording.

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
    from workbench.scan_plan.plan import as_profiler

    profiler = _as_recorded(cloud) if sensor is None else as_profiler(SensorFile.read(sensor), sensor)
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

    best = _best(found, left)
    decided = [one for one in left if one.over(best.root_mm, best.bevel_deg) <= 1.0]
    if left and not decided:
        return (_chapter(_none_decides(best, left)),)
    stretch = _stretch(left, inspection)
    sentence = _sentence(best, left, decided, stretch)
    return Document(NAME, _written(edge, best, stretch, left, decided, sentence)), _chapter(sentence)


def _best(found: Sequence[Proposal], left: Sequence[Open]) -> Proposal:
    """The one that decides most sections; of these the one that comes nearest in the others."""

    def rank(one: Proposal) -> tuple[int, float]:
        ratios = [section.over(one.root_mm, one.bevel_deg) for section in left]
        return -sum(ratio <= 1.0 for ratio in ratios), max(ratios, default=one.root_mm)

    return min(found, key=rank)


def open_sections(inspection: Inspection) -> tuple[Open, ...]:
    """The undecided sections, and what would decide them: a hidden one a tenth of the tolerances' width."""
    found = []
    for section in inspection.sections:
        if section.verdict != "undecided":
            continue
        wanted = {"root_mm": math.inf, "bevel_deg": math.inf}
        for one in inspection.characteristics:
            if one.limits is None:
                continue
            (low, high), pair = one.limits, one.pairs[section.index - 1]
            if pair is None:
                wanted[one.name] = 0.1 * (high - low)
            elif one.verdicts[section.index - 1] == "undecided":
                value = pair[0]
                margin = min(abs(value - low), abs(high - value))
                wanted[one.name] = COVERAGE * margin / max(inspection.guard_factor, 1e-9)
        found.append(Open(section.index, section.arc_length_mm, max(wanted["root_mm"], 1e-9), wanted["bevel_deg"]))
    return tuple(found)


def proposals(cloud: Cloud, edge: MilledEdge, profiler: Profiler, known: Knowledge) -> list[Proposal]:
    """Every elevation from which both faces are seen, with U of all passes together."""
    from workbench.scan_plan.information import Joint, View, combined, information

    root, bevel = float(np.nanmedian(edge.root.value)), float(np.nanmedian(edge.bevel.value)) * DEG
    face = edge.faces[BEVEL_FACE]
    on = face.count > 2
    width = float(np.median(np.sqrt(12.0 * face.sxx[on] / face.count[on]) * np.hypot(1.0, face.sxz[on] / face.sxx[on])))
    joint = Joint(root + width * math.cos(bevel), root, bevel)
    length = float(edge.arc_length_mm[-1])
    pitch = max(float(np.nanmedian(np.abs(np.diff(edge.frame_arc_length_mm)))), 1e-3)

    def told(elevation: float) -> PassInformation | None:
        return information(joint, profiler, known, View(elevation, profiler.middle_mm, pitch), length)

    there = [one for elevation in _elevations(cloud, edge) if (one := told(elevation)) is not None]
    found = []
    for elevation in ELEVATIONS_DEG:
        further = told(elevation * DEG)
        if further is not None:
            both = combined(joint, known, (*there, further), length)
            found.append(
                Proposal(elevation, COVERAGE * both.root_mm, COVERAGE * both.bevel_deg, further.step_mm == 0.0)
            )
    return found


def _elevations(cloud: Cloud, edge: MilledEdge) -> list[float]:
    """Of each pass: how far the scanner stands above the root face's normal, rad."""
    seen = np.flatnonzero(np.isfinite(edge.frame_arc_length_mm))
    station = np.abs(edge.frame_arc_length_mm[seen, None] - edge.arc_length_mm[None]).argmin(axis=1)
    z = cloud.base_from_profiler[seen, :3, 2]
    out, up = ((z * axis[station]).sum(axis=1) for axis in (edge.normal, edge.across))
    elevation = np.arctan2(up * np.sign(out), np.abs(out))
    passes = cloud.pass_index[seen]
    return [float(np.median(elevation[passes == one])) for one in np.unique(passes)]


def _as_recorded(cloud: Cloud) -> Profiler:
    """The profiler by what it returned: its columns, as wide as they reach, and the noise between neighbours."""
    from workbench.scan_plan.edges import noise_mm
    from workbench.scan_plan.information import Profiler

    x, z = cloud.x_mm[:: max(1, len(cloud.x_mm) // 200)], cloud.z_mm[:: max(1, len(cloud.z_mm) // 200)].astype(float)
    width = float(np.nanmax(x) - np.nanmin(x))
    near, far = STANDOFF_MM - 0.5 * width, STANDOFF_MM + 0.5 * width
    return Profiler(cloud.x_mm.shape[1], (near, far), (width, width), max(noise_mm(z), 1e-4))


def _sentence(best: Proposal, left: Sequence[Open], decided: Sequence[Open], stretch: tuple[float, float]) -> str:
    """What to do next, in words."""
    pass_ = (
        f"A further pass at {best.elevation_deg:g}° above the root face's normal, from {stretch[0]:.0f} to "
        f"{stretch[1]:.0f} mm, where nothing covers the edge: U is predicted as {_mm(best.root_mm)} "
        f"and {_deg(best.bevel_deg)}"
    )
    if not left:
        return f"{pass_}, and the lower surface is in view." if best.shows_below else f"{pass_}; conditions remain."
    told = f"{pass_}, which decides {len(decided)} of {len(left)} undecided sections"
    rest = [one for one in left if one not in decided]
    if not rest:
        return f"{told}."
    return f"{told}; {_needed(min(rest, key=Open.most))}."


def _none_decides(best: Proposal, left: Sequence[Open]) -> str:
    """What would decide sections that no pass decides, in words."""
    return (
        f"No further pass decides any of the {len(left)} undecided sections: the best, at {best.elevation_deg:g}° "
        f"above the root face's normal, is predicted to leave U = {_mm(best.root_mm)} and {_deg(best.bevel_deg)}; "
        f"{_needed(max(left, key=Open.most))}: what would decide it is a sensor or robot that errs less, or a size "
        "farther from the limit."
    )


def _needed(one: Open) -> str:
    need = " and ".join(told(u) for told, u in ((_mm, one.root_mm), (_deg, one.bevel_deg)) if math.isfinite(u))
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
    decided: Sequence[Open],
    sentence: str,
) -> bytes:
    """`next_scan.json`: an edge-line with what is proposed along it."""
    seen = np.isfinite(edge.position_mm).all(axis=1)
    at = edge.arc_length_mm[seen]
    first, last = stretch
    places = np.linspace(first, last, max(2, round((last - first) / POINT_MM) + 1))
    points: Float = np.stack([np.interp(places, at, edge.position_mm[seen, k]) for k in range(3)], axis=1)

    def least(values: Sequence[float]) -> float | None:
        known = [one for one in values if math.isfinite(one)]
        return min(known) if known else None

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
        "wanted_root_U_mm": least([one.root_mm for one in left]),
        "wanted_bevel_U_deg": least([one.bevel_deg for one in left]),
        "undecided_sections": [one.section for one in left],
        "decided_by_it": [one.section for one in decided],
    }
    return json.dumps(document, indent=1, allow_nan=False).encode() + b"\n"


def _chapter(sentence: str) -> Chapter:
    return Chapter(title="What would decide it", html=pieces.list_html([sentence]), summary=sentence)
