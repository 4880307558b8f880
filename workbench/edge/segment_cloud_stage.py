"""`edge.segment_cloud`: the faces of the edge and its lower edge, from a cloud without a grid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import scipy
from pydantic import Field

from workbench.artefacts import (
    BEVEL_FACE,
    END,
    LOWER_SURFACE,
    PASSES,
    ROOT_FACE,
    Cloud,
    MilledEdge,
    PointSet,
    Quantity,
    RawEdge,
    Unseen,
)
from workbench.checks import NOT_JUDGED
from workbench.checks.sensor import step_mm
from workbench.edge.end_templates import EdgeCondition
from workbench.edge.faces import find_faces, key_readings
from workbench.edge.identify import WORST_SCORE, Candidate
from workbench.edge.measure import UNDETERMINED, measure_edge
from workbench.edge.parameters import (
    USUAL_NOISE_MM,
    BevelNominal,
    Direction,
    RobotNoiseLength,
    RobotNoiseOrUsual,
    RootNominal,
    usual_noise_mm,
)
from workbench.edge.segment_cloud_direction import edge_direction
from workbench.edge.segment_cloud_grid import organised, recovered_grid
from workbench.edge.segment_cloud_passes import passes_shown
from workbench.edge.segment_cloud_sheets import LEAST_SLICES, check_one_sheet
from workbench.edge.segment_raw_stage import segment_raw
from workbench.edge.segment_stage import segment
from workbench.edge.unseen import BY_THICKNESS, BY_WINDOW
from workbench.errors import InputError
from workbench.geometry.blocks import evenly
from workbench.geometry.chains import FaceLines
from workbench.geometry.curves import Curve, with_frame
from workbench.geometry.gridless import MOST_COLUMNS, Laid, Traces, cut, lay_out
from workbench.geometry.grids import columns_beyond
from workbench.geometry.moves import chords_mm
from workbench.geometry.scan_grid import LEAST_CELLS
from workbench.geometry.splines import through
from workbench.stage import InputFile, stage
from workbench.units import DEG, Bool, Float

# What a slice counts for the root face beside a scan line: neighbouring slices cut the same few lines, so that where
# their last points lie is no new draw in each.
SLICE_WEIGHT = 0.2
COARSE_MM, FEW = 0.04, 100_000  # about three times a profiler's noise; points that tell a rounding
LEAST_POINTS, MOST_MM, FAR_MM = 100, 30_000.0, 1e10
OTHER_SOFTWARE = Unseen(
    "other_software",
    "What other software did to the cloud: points cut off or removed at the end of a face (crop, outlier removal), "
    "moved (smoothing, averaging, interpolation, another scale) or merged from scans registered to each other.",
)
BY_CUT = replace(
    BY_WINDOW,
    sentence="That the root face ends where its points do: none stands beyond, as where a cloud is cropped along the "
    "edge, or its last points were removed as stray ones.",
)
SLICED = "the order of the points shows no scan lines: the cloud was sliced"
NO_LINES = "its points stand on no scan lines: several passes, if they were merged, are known only where they disagree"
SEVERAL = (
    "its points stand on lines of several scanning passes: every size and angle carries in its uncertainty that they "
    "differ by {:.2g} mm"
)
STEP_SLOPE = 1.5  # slope of the line through a face with a step in its middle, in parts of the step over the width
# Beyond this, passes differ by more than a second sheet would show (twice a usual profiler's noise).
MOST_PASS_NOISE_MM = 0.02


@stage("edge.segment_cloud")
def segment_cloud(
    points: PointSet,
    *,
    root_nominal_mm: RootNominal = 1.5,
    bevel_nominal_deg: BevelNominal = 40.0,
    robot_noise_mm: RobotNoiseOrUsual = USUAL_NOISE_MM,
    robot_noise_length_mm: RobotNoiseLength = None,
    edge_condition: EdgeCondition = "unknown",
    sensor: InputFile | None = None,
    upper_side: Direction | None = None,
    thickness_mm: Annotated[float, Field(ge=0.5, le=500)] | None = None,
    use_order: bool = True,
) -> tuple[Cloud, MilledEdge | RawEdge]:
    """Find a milled or a raw edge in a cloud without a grid.

    The cloud becomes an organised one, by scan lines or slices; the edge is that of `edge.segment` (`edge.segment_raw`
    with `upper_side`): docs/clouds.md.

    Args:
        points: the cloud of one edge, in mm.
        edge_condition: as in `edge.segment`.
        sensor: as in `edge.segment`.
        upper_side: of a raw edge, in scan order: direction from the plate's lower to its upper surface. null: a milled
            edge.
        thickness_mm: as in `edge.segment`; shows whether a cloud was cropped along the edge.
        use_order: look for scan lines in the order of the points; false: slice the cloud.

    Raises:
        InputError: no cloud of a part; no such edge in view; points without order of passes that may not agree; a raw
            edge without scan lines.

    Example:
        >>> from workbench import cloud, edge
        >>> gridded, milled = edge.segment_cloud(cloud.read(file="data/synthetic/milled_edge.laz"))
        >>> round(float(milled.arc_length_mm[-1]))
        77
    """
    _check_extent(points)
    with _rounding_as_cause(points):
        _check_copies(points)
        recovered = recovered_grid(points) if use_order else None
        if upper_side is not None:
            if recovered is None:
                raise InputError(points.source, "expected a raw edge's points in the order of scan lines, found none")
            recovered = replace(recovered, checks=(NOT_JUDGED,))
            raw = segment_raw(
                recovered,
                upper_side=upper_side,
                robot_noise_mm=robot_noise_mm,
                robot_noise_length_mm=robot_noise_length_mm,
                edge_condition=edge_condition,
                sensor=sensor,
            )
            return recovered, replace(raw, warnings=(*points.warnings, *raw.warnings))
        nominal = Nominal(root_nominal_mm, bevel_nominal_deg)
        cloud, passes = (recovered, None) if recovered else slice_cloud(points, nominal)
        cloud = replace(cloud, checks=(NOT_JUDGED,))
        noise_mm = usual_noise_mm(robot_noise_mm)
        if passes == "several passes" and noise_mm > MOST_PASS_NOISE_MM:
            raise InputError(
                points.source,
                "points stand on lines of several scanning passes, or of rounded coordinates: give points as "
                "measured, in scan order or each pass alone (or robot_noise_mm of at most "
                f"{MOST_PASS_NOISE_MM:g}, if passes agree)",
            )
        edge = segment(
            cloud,
            root_nominal_mm=root_nominal_mm,
            bevel_nominal_deg=bevel_nominal_deg,
            robot_noise_mm=noise_mm,
            robot_noise_length_mm=robot_noise_length_mm,
            edge_condition=edge_condition,
            sensor=sensor,
            thickness_mm=thickness_mm,
        )
        cut = [BY_CUT] if _ends_with_cloud(cloud, edge, thickness_mm) else []
        unseen = [*cut, *(one for one in edge.unseen if one.name != BY_WINDOW.name), OTHER_SOFTWARE]
        edge = replace(edge, unseen=tuple(unseen), warnings=(*points.warnings, *edge.warnings))
        return cloud, edge if passes is None else _of_slices(edge, passes, noise_mm)


@contextmanager
def _rounding_as_cause(points: PointSet) -> Iterator[None]:
    """Of a cloud that is refused: that its coordinates are rounded, if they are, since that alone hides its faces."""
    try:
        yield
    except InputError as error:
        few = points.points_mm[:: 1 + len(points.points_mm) // FEW]
        step = min(step_mm(axis) for axis in few.T)
        if step < COARSE_MM:
            raise
        why = f"coordinates are rounded to {step:.2g} mm: export them at full resolution"
        raise InputError(points.source, why) from error


def _ends_with_cloud(cloud: Cloud, edge: MilledEdge, thickness_mm: float | None) -> bool:
    """Does in most frames no point stand beyond the root face's free end, and no thickness say that this is one?"""
    if thickness_mm is not None and all(one.name not in BY_THICKNESS for one in edge.unseen):
        return False
    root, bevel = (edge.faces[label].columns for label in (ROOT_FACE, BEVEL_FACE))
    on = np.flatnonzero((edge.faces[ROOT_FACE].count > 0) & (edge.faces[LOWER_SURFACE].count == 0))
    rising = root[on].sum(axis=1) > bevel[on].sum(axis=1)
    here = edge.labels[on] == ROOT_FACE
    last = here.shape[1] - 1 - here[:, ::-1].argmax(axis=1)
    beyond = columns_beyond(cloud.z_mm[on], np.where(rising, last, -here.argmax(axis=1)))
    return bool((beyond == here.shape[1]).sum() > 0.5 * (edge.faces[ROOT_FACE].count > 0).sum())


def _check_extent(points: PointSet) -> None:
    """Refuse what is no part: so few points, or so far apart or away, that float64 has no digits for them."""
    found = points.points_mm
    if len(found) < LEAST_POINTS:
        raise InputError(points.source, f"expected a cloud of at least {LEAST_POINTS} points, found {len(found)}")
    if not (np.abs(found).max() < FAR_MM and np.ptp(found, axis=0).max() < MOST_MM):
        raise InputError(
            points.source, f"expected a part within {MOST_MM / 1000:g} m, and that within {FAR_MM:g} mm of the origin"
        )


def _check_copies(points: PointSet) -> None:
    """Refuse a cloud that holds points again: they would count as further returns."""
    found = points.points_mm
    probes = found[:: 1 + len(found) // PROBES]
    axis = int(np.ptp(found, axis=0).argmax())
    along, thick = found[:, axis].copy(), SLAB * float(np.ptp(found[:, axis]))
    copied = 0
    for one in probes:
        near = found[np.abs(along - one[axis]) < thick]
        near = near if len(near) > EIGHTH else found
        square = np.partition(((near - one) ** 2).sum(axis=1), (1, EIGHTH))
        copied += bool(square[1] <= COPY**2 * square[EIGHTH])
    share = copied / len(probes)
    if share > COPIED:
        raise InputError(
            points.source,
            f"{100 * share:.0f} % of the points stand in the cloud more than once: expected each point once; "
            "was a scan merged with itself, or a file read twice?",
        )


def _of_slices(edge: MilledEdge, passes: Traces, robot_noise_mm: float) -> MilledEdge:
    """The edge with what slices do not know taken off its certainty, and a note of it."""
    # Passes may see one end of the root face each, and differ by the noise of two positions.
    passes_u_mm = math.sqrt(2.0) * robot_noise_mm if passes == "several passes" else 0.0
    notes = {"one pass": (), "several passes": (SEVERAL.format(passes_u_mm),), "none": (NO_LINES,)}[passes]
    direction_u = math.hypot(
        _noise_slope(edge.faces[ROOT_FACE]), STEP_SLOPE * passes_u_mm / float(np.nanmedian(edge.root.value))
    )
    root, bevel = dict(edge.root.u_by_source), dict(edge.bevel.u_by_source)
    root[END] = root[END] / math.sqrt(SLICE_WEIGHT)  # neighbouring slices cut the same scan lines
    whole = np.ones(edge.arc_length_mm.size)
    lever = 0.5 * edge.root.value / np.abs(np.tan(edge.bevel.value * DEG))
    root[PASSES], bevel[PASSES] = np.hypot(passes_u_mm, lever * direction_u), direction_u / DEG * whole
    return replace(
        edge,
        root=Quantity.of("root_mm", edge.root.value, root),
        bevel=Quantity.of("bevel_deg", edge.bevel.value, bevel),
        warnings=(*edge.warnings, SLICED, *notes),
    )


def _noise_slope(face: FaceLines) -> float:
    """Standard uncertainty of the face's slope in slices, rad, since nothing tells along which axis its noise acts.

    Lines are fitted as if along z. Noise along an axis at an angle phi to that acts on x too, and turns them by its
    variance over that of x, times sin(phi) cos(phi): in the mean square over all phi, an eighth.
    """
    return math.sqrt(0.125) * float(np.nanmedian(face.rss / face.sxx))


# A cloud without scan lines as an organised one: sliced across its edge, seen from where its faces show best.

PROBES = 32  # points of which copies are looked for
EIGHTH, COPY = 8, 0.02  # neighbour whose distance tells how densely points lie, and the share of it for a copy
COPIED, SLAB = 0.2, 0.01  # shares of the points; of the cloud's length, within which neighbours lie
SAMPLE = 4000  # points whose neighbours tell how densely they lie
NEIGHBOURS = 16  # at the least; as few as spread both ways
THICKER = 1.5  # than one point a cell asks for: points on lines do not spread evenly over the slices
VIEWS = 24  # directions of sight that are tried, around the edge
TRIAL_SLICES, COARSE_SLICES, MOST_SLICES = 60, 240, 200_000
MOST_CELLS = 20  # a point's, beyond LEAST_CELLS
HIDDEN_MM, MOST_LOST = 5.0, 0.15  # a longer gap is a hidden stretch; share of slices lost in shorter ones
REACH_MM = 25.0  # of the cloud only this much on each side of the edge is sliced
PATH_STEP_MM = 0.5


@dataclass(frozen=True, slots=True)
class Nominal:
    """What the faces are told apart by."""

    root_mm: float
    bevel_deg: float


@dataclass(frozen=True, slots=True)
class Spacing:
    """How densely points lie on a surface."""

    width_mm: float  # between nearest neighbours: of a column
    thickness_mm: float  # of a slice that has one point a column


def slice_cloud(points: PointSet, nominal: Nominal) -> tuple[Cloud, Traces]:
    """The cloud sliced across its edge, and of which scanning passes its points show lines.

    First square to one direction, from the side that reads best as a milled edge; that gives the edge's course. Then
    square to that course, in slices and columns as wide as the points on the root face lie apart.
    """
    straight = _straight(points)
    step = spacing(points)
    view = best_view(points, straight, step, nominal)
    coarse = _sliced(points, straight, view, step, COARSE_SLICES)
    found = find_faces(coarse, nominal.root_mm, nominal.bevel_deg)
    check_agreement(coarse, found.seen, step)
    try:
        course = measure_edge(coarse, found).curve
    except np.linalg.LinAlgError:
        raise InputError(points.source, UNDETERMINED) from None
    near = _near(points.points_mm, course)
    step = spacing(points, coarse.placed(*np.nonzero(found.labels == ROOT_FACE)))
    cloud = _sliced(points, near, view, step, MOST_SLICES)
    found = find_faces(cloud, nominal.root_mm, nominal.bevel_deg)
    check_one_sheet(cloud, found)
    check_agreement(cloud, found.seen, step)
    return cloud, passes_shown(near, view, cloud, found)


def check_agreement(cloud: Cloud, seen: Bool, step: Spacing) -> None:
    """Refuse slices that lose the edge here and there: what they hold is no one surface.

    seen (N,): slices that show root face and bevel. Where a clamp hides the edge, they lack in one long stretch.
    """
    gap = np.diff(np.flatnonzero(seen)) - 1
    short = chords_mm(cloud.base_from_profiler[seen, :3, 3]) < HIDDEN_MM
    missing = float(gap[short].sum())
    lost = missing / (float(seen.sum()) + missing)
    if lost > MOST_LOST:
        raise InputError(
            cloud.source,
            f"{100 * lost:.0f} % of its slices lose the edge here and there: expected one surface with at least three "
            f"points across the root face in a slice, and they lie about {step.width_mm:.2g} x "
            f"{step.thickness_mm / THICKER:.2g} mm apart; give points in scan order",
        )


def _straight(points: PointSet) -> Laid:
    """The points laid out along a straight line through their middle, in the direction of the edge."""
    along = edge_direction(points.points_mm, points.source)
    middle = points.points_mm.mean(axis=0)
    s = (points.points_mm - middle) @ along
    at = np.linspace(s.min(), s.max(), 8)
    course = with_frame(through(at, middle + at[:, None] * along), at)
    return lay_out(points.points_mm, course, s)


def _near(points_mm: Float, course: Curve) -> Laid:
    """The points within REACH_MM of the course, laid out along it."""
    at = np.arange(course.stations_mm[0], course.stations_mm[-1], PATH_STEP_MM)
    off, nearest = scipy.spatial.cKDTree(course.position(at)).query(points_mm, distance_upper_bound=REACH_MM)
    here = np.isfinite(off)
    return lay_out(points_mm[here], course, at[nearest[here]])


def spacing(points: PointSet, at_mm: Float | None = None) -> Spacing:
    """Median distance between neighbours, and what that leaves to the other direction by the density in the surface.

    Where points lie on lines the neighbours are those of the line, and the slices are as thick as the lines are apart:
    the density is that of so many neighbours that they spread both ways, at most about the root of all points.
    at_mm (k, 3): near which points to look; at all if None.
    """
    tree = scipy.spatial.cKDTree(points.points_mm)
    at = points.points_mm if at_mm is None else points.points_mm[tree.query(at_mm)[1]]
    at = at[:: max(1, len(at) // SAMPLE)]
    neighbours, is_line = NEIGHBOURS // 2, True
    while is_line and neighbours**2 < len(points.points_mm):
        neighbours *= 2
        distance, near = tree.query(at, k=neighbours + 1)
        off = points.points_mm[near] - points.points_mm[near].mean(axis=1, keepdims=True)
        length, breadth, _ = np.median(np.linalg.svd(off, compute_uv=False), axis=0)
        is_line = breadth < 0.5 * length
    area = float(np.median(np.pi * distance[:, -1] ** 2)) / neighbours  # of the surface, a point
    width = float(np.median(distance[:, 1]))
    return Spacing(width, max(THICKER * area / width, width))


def _sliced(points: PointSet, laid: Laid, view: Float, step: Spacing, most: int) -> Cloud:
    """At most `most` slices, evenly along the course."""
    first, length = float(laid.s.min()), float(np.ptp(laid.s))
    count = int(length / step.thickness_mm)
    if count < LEAST_SLICES:
        raise InputError(
            points.source,
            f"expected a cloud along an edge, found {length:.3g} mm of it with points "
            f"about {step.width_mm:.3g} x {step.thickness_mm:.3g} mm apart",
        )
    at = np.asarray(first + step.thickness_mm * (evenly(count, most) + 0.5), dtype=np.float64)
    columns = min(float(np.hypot(*np.ptp(laid.place, axis=0))) / step.width_mm, MOST_COLUMNS)
    if len(at) * columns > LEAST_CELLS + MOST_CELLS * len(laid.s):
        raise InputError(
            points.source,
            "points are too unevenly dense to be sliced: expected one scanned edge, about "
            f"evenly covered; most lie {step.width_mm:.3g} mm apart",
        )
    x, z, pose = cut(laid, view, at, step.thickness_mm, step.width_mm)
    return organised(points, x, z, pose, np.zeros(len(at), np.int64))


def best_view(points: PointSet, laid: Laid, step: Spacing, nominal: Nominal) -> Float:
    """Direction of sight (3,) from which slices read best as a milled edge: against the bisector of its two faces.

    Raises InputError where they do not from any.
    """
    _, a, b = laid.course.frame(np.zeros(1))
    best, score = None, 0.0
    for angle in np.arange(VIEWS) * 2.0 * np.pi / VIEWS:
        cloud = _sliced(points, laid, np.cos(angle) * a[0] + np.sin(angle) * b[0], step, TRIAL_SLICES)
        readings = key_readings(cloud, slice(None), nominal.root_mm, nominal.bevel_deg * DEG)[1]
        away = [[c for c in frame if c.sense > 0] for frame in readings]
        found = [min(those, key=lambda c: c.score) for those in away if those]
        total = sum(WORST_SCORE - c.score for c in found)
        if total > score:
            best, score = _between(found, cloud), total
    if best is None:
        raise InputError(
            points.source,
            "no edge in view: expected a root face next to a bevel face of "
            f"{nominal.bevel_deg:g} deg (a raw edge has none)",
        )
    return best


def _between(found: list[Candidate], cloud: Cloud) -> Float:
    """The direction (3,) against the bisector of both faces' outward normals."""
    slope = float(np.arctan(np.median([(c.root[0], c.bevel[0]) for c in found], axis=0)).mean())
    pose = cloud.base_from_profiler[len(cloud.base_from_profiler) // 2, :3]
    return np.asarray(np.cos(slope) * pose[:, 2] - np.sin(slope) * pose[:, 0])
