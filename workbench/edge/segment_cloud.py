"""`edge.segment_cloud`: the faces of the edge and its lower edge, from a cloud without a grid."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import END, PASSES, ROOT_FACE, Cloud, MilledEdge, PointSet, RawEdge
from workbench.checks import NOT_JUDGED
from workbench.edge.segment import segment
from workbench.edge.segment_cloud_grid import recovered_grid
from workbench.edge.segment_cloud_slices import Nominal, slice_cloud
from workbench.edge.segment_raw import segment_raw
from workbench.errors import InputError
from workbench.geometry.faces import FaceLines
from workbench.geometry.scan_traces import Traces
from workbench.stage import stage

# What a slice counts for the root size beside a scan line: neighbouring slices cut the same few lines, so that where
# their last points lie is no new draw in each (tested: bench.metrology, study clouds).
SLICE_WEIGHT = 0.2
LEAST_POINTS, MOST_MM, FAR_MM = 100, 30_000.0, 1e10
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
    root_nominal_mm: Annotated[
        float, Field(gt=0, le=50, description="expected root size, tells the faces apart")
    ] = 1.5,
    bevel_nominal_deg: Annotated[float, Field(ge=20, le=70, description="expected bevel angle, likewise")] = 40.0,
    robot_noise_mm: Annotated[
        float, Field(ge=0, le=5, description="standard deviation of the positions that the cloud was fused with")
    ] = 0.07,
    upper_side: Annotated[
        tuple[float, float, float] | None,
        Field(description="a raw edge's: direction from the plate's lower to its upper surface; null: a milled edge"),
    ] = None,
    use_order: Annotated[bool, Field(description="look for scan lines in the order of the points")] = True,
) -> tuple[Cloud, MilledEdge | RawEdge]:
    """Find root face, bevel face and the lower edge of a milled edge, or a raw edge, in a cloud without a grid.

    The cloud becomes an organised one, and the edge is then that of `edge.segment` (`edge.segment_raw` where
    `upper_side` is given). Where the points still stand in the
    order in which a line scanner took them, its grid is found again: each scan line lies in one plane, and its columns
    are equal steps along one axis of that. Else the cloud is sliced: Open3D's surface normals tell in which direction
    the edge runs, trial slices from which side its two faces show, a first pass its course; slices square to that, as
    thick as the points are apart, are the profiles. Several passes in such a cloud are refused: where they do not
    agree, they show as two sheets on a face; else by the traces of their scan lines. Of these, passes that are said to
    agree (`robot_noise_mm` up to 0.02) are measured, and all values carry that noise.

    Args:
        points: the cloud of one edge, in mm.
        root_nominal_mm: expected root size; only tells the faces apart.
        bevel_nominal_deg: expected bevel angle; likewise.
        robot_noise_mm: standard deviation of the positions that the cloud was fused with, each axis: nothing in the
            cloud shows it, yet it turns the edge's tangent.
        upper_side: of a raw edge, from its lower to its upper side; the cloud must then stand in scan order.
        use_order: look for scan lines in the order of the points; false: slice the cloud in any case.

    Returns:
        The organised cloud, for reports and planning, and its edge.

    Raises:
        InputError: no cloud of a part; no root face next to a bevel face (no end face) in view; points without order
            of passes that do not agree, or may not; a raw edge without scan lines.

    Example:
        >>> from workbench import cloud, edge
        >>> gridded, milled = edge.segment_cloud(cloud.read(file="data/synthetic/milled_edge.laz"))
        >>> round(float(milled.arc_length_mm[-1]))
        77
    """
    _check_extent(points)
    recovered = recovered_grid(points) if use_order else None
    if upper_side is not None:
        if recovered is None:
            raise InputError(points.source, "expected a raw edge's points in the order of scan lines, found none")
        recovered = replace(recovered, checks=(NOT_JUDGED,))
        return recovered, segment_raw(recovered, upper_side=upper_side, robot_noise_mm=robot_noise_mm)
    nominal = Nominal(root_nominal_mm, bevel_nominal_deg)
    cloud, passes = (recovered, None) if recovered else slice_cloud(points, nominal)
    cloud = replace(cloud, checks=(NOT_JUDGED,))
    if passes == "several passes" and robot_noise_mm > MOST_PASS_NOISE_MM:
        raise InputError(
            points.source,
            "points stand on lines of several scanning passes, which may differ by the "
            f"robot's noise: give points in scan order or each pass alone (or robot_noise_mm of at most "
            f"{MOST_PASS_NOISE_MM:g}, if they are known to agree)",
        )
    edge = segment(
        cloud, root_nominal_mm=root_nominal_mm, bevel_nominal_deg=bevel_nominal_deg, robot_noise_mm=robot_noise_mm
    )
    return cloud, edge if passes is None else _of_slices(edge, passes, robot_noise_mm)


def _check_extent(points: PointSet) -> None:
    """Refuse what is no part: so few points, or so far apart or away, that float64 has no digits for them."""
    found = points.points_mm
    if len(found) < LEAST_POINTS:
        raise InputError(points.source, f"expected a cloud of at least {LEAST_POINTS} points, found {len(found)}")
    if not (np.abs(found).max() < FAR_MM and np.ptp(found, axis=0).max() < MOST_MM):
        raise InputError(
            points.source, f"expected a part within {MOST_MM / 1000:g} m, and that within {FAR_MM:g} mm of the origin"
        )


def _of_slices(edge: MilledEdge, passes: Traces, robot_noise_mm: float) -> MilledEdge:
    """The edge with what slices do not know taken off its certainty, and told."""
    # Passes may see one end of the root face each, and differ by the noise of two positions.
    passes_u_mm = math.sqrt(2.0) * robot_noise_mm if passes == "several passes" else 0.0
    told = {"one pass": (), "several passes": (SEVERAL.format(passes_u_mm),), "none": (NO_LINES,)}[passes]
    direction_u = math.hypot(
        _noise_slope(edge.faces[ROOT_FACE]), STEP_SLOPE * passes_u_mm / float(np.nanmedian(edge.root.value))
    )
    root, bevel = dict(edge.root.u_by_source), dict(edge.bevel.u_by_source)
    root[END] = root[END] / math.sqrt(SLICE_WEIGHT)  # neighbouring slices cut the same scan lines
    whole = np.ones(edge.arc_length_mm.size)
    lever = 0.5 * edge.root.value / np.abs(np.tan(edge.bevel.value))
    root[PASSES], bevel[PASSES] = np.hypot(passes_u_mm, lever * direction_u), direction_u * whole
    return replace(
        edge,
        root=replace(edge.root, u_by_source=root),
        bevel=replace(edge.bevel, u_by_source=bevel),
        warnings=(*edge.warnings, SLICED, *told),
    )


def _noise_slope(face: FaceLines) -> float:
    """Standard uncertainty of the face's slope in slices, rad, since nothing tells along which axis its noise acts.

    Lines are fitted as if along z. Noise along an axis at an angle phi to that acts on x too, and turns them by its
    variance over that of x, times sin(phi) cos(phi): in the mean square over all phi, an eighth.
    """
    noise = face.szz - face.sxz**2 / face.sxx
    return math.sqrt(0.125) * float(np.nanmedian(noise / face.sxx))
