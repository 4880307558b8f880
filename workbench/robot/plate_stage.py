"""`robot.plate`: the scanned plate, and all that was scanned with it, as a body to run into; so a workpiece's mesh."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import Cloud, MeasuredAxis, PointSet, Toolpath
from workbench.errors import InputError
from workbench.geometry.grids import fuse
from workbench.geometry.poses import inverse
from workbench.robot.cell_model import ON_BASE, ON_TURNTABLE, Cell, Shape, named_file
from workbench.robot.collision import external_at, sliding, turntable_pose
from workbench.stage import InputFile, stage
from workbench.units import DEG, AnyArray, Float

GridCell = tuple[int, ...]  # of the grid
CLOUDS = (".pcd", ".xyz", ".pts")  # hold points only; a PLY file may hold either
MOST_CUBES, MOST_BOXES = 20_000, 250
LEAST_MM = 5.0  # a smaller body is one in metres
SAMPLED = 500  # points at which the uncertainty of a scan is looked at
NO_HAND_EYE_U = (
    "robustness against the hand-eye's uncertainty: neither the calibration states it (covariance) nor the cell file "
    "($.uncertainty.base_u_mm)"
)
BEYOND_SCAN = (
    "collision with the part beyond its scan, which is {} mm large: the cell file has no mesh of it ($.workpiece)"
)
BASE_U_ALONE = (
    "what the hand-eye leaves open of the scan: the calibration states no covariance, the cell file's "
    "$.uncertainty.base_u_mm and turntable_u_mm count alone"
)
# mm, deg, by which an axis may lie beside the measured one: the root face's tolerance, or the bevel's, is then gone
TOOL_BESIDE, TABLE_BESIDE = (0.5, 1.0), (0.5, 0.15)
ANOTHER_TOOL, ENTERED = (20.0, 10.0), (0.05, 0.05)  # likewise: of one on the controller; by rounding
SURE = 3.0  # standard uncertainties
ROUND, CUTTER_MM = ("cylinder", "capsule", "sphere"), 0.25  # kinds of shapes; of radii: half of a root's tolerance
CONTACT = ("cutter", "workpiece")  # what mills may touch what is milled


def read_workpiece(path: Path, where: str) -> tuple[Float, AnyArray]:
    """Vertices (v, 3) and triangles (t, 3) of a mesh (STL, OBJ, PLY), or points and none of a cloud.

    Raises:
        InputError: no such file, nothing in it, or so small that it must be in metres.
    """
    import open3d

    named_file(path, where, "mesh or cloud")
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        if path.suffix.lower() in CLOUDS:
            points, triangles = np.array(open3d.io.read_point_cloud(path).points), np.empty((0, 3), np.int64)
        else:
            mesh = open3d.io.read_triangle_mesh(path)
            points, triangles = np.array(mesh.vertices), np.array(mesh.triangles)
    if not len(points) or not np.isfinite(points).all():
        raise InputError(where, f"expected a mesh or a cloud of finite points, '{path}' holds none")
    check_size(points, path, where)
    return points, triangles


def check_size(points: Float, path: Path, where: str) -> None:
    """Refuse a body whose file (v, 3) is so small that it must be in metres."""
    size = float(np.ptp(points, axis=0).max())
    if size < LEAST_MM:
        raise InputError(where, f"expected millimetres, '{path}' is {size:.3g} large: is it in metres?")


def boxes(points_mm: Float, edge_mm: float, where: str) -> tuple[Float, Float]:
    """Middles (b, 3) and edge lengths (b, 3) of boxes that hold all points (n, 3): cubes of a grid, joined greedily.

    No point is outside; what the scan has not seen is not there. The grid is made coarser until MOST_BOXES suffice.
    """
    index = np.floor(points_mm / edge_mm)
    if np.abs(index).max() > 2**20:
        raise InputError(where, f"expected a voxel_mm above {edge_mm:g} for a cloud so far from its origin")
    held = np.unique(index.astype(np.int64), axis=0)
    found = _joined(held) if len(held) <= MOST_CUBES else []
    if not 0 < len(found) <= MOST_BOXES:
        return boxes(points_mm, 1.5 * edge_mm, where)
    low, high = (np.array(corner, float) * edge_mm for corner in zip(*found, strict=True))
    return (low + high) / 2, high - low


def scanned(points_mm: Float, voxel_mm: float, link: int, pose: Float, where: str) -> list[Shape]:
    """A scan's points (n, 3) as shapes of the body `workpiece`; `pose` of their frame, `link` as in `Shape`."""
    found = []
    for middle, size in zip(*boxes(points_mm, voxel_mm, where), strict=True):
        at = pose.copy()
        at[:3, 3] += pose[:3, :3] @ middle
        found.append(Shape("workpiece", link, "box", tuple(size.tolist()), at))
    return found


def _joined(held: AnyArray) -> list[tuple[GridCell, GridCell]]:
    """Lowest and highest corners of boxes: runs along x, as many alike in y, then in z."""
    open_ = set(map(tuple, held.tolist()))
    found: list[tuple[GridCell, GridCell]] = []
    for x, y, z in sorted(open_):
        if (x, y, z) not in open_:
            continue
        high = [x + 1, y + 1, z + 1]
        for axis in range(3):
            while _slab(x, y, z, high, axis) <= open_:
                high[axis] += 1
        open_ -= set(itertools.product(range(x, high[0]), range(y, high[1]), range(z, high[2])))
        found.append(((x, y, z), (high[0], high[1], high[2])))
    return found


def _slab(x: int, y: int, z: int, high: list[int], axis: int) -> set[GridCell]:
    """The cubes that a box would gain at its high end along an axis."""
    spans = [range(x, high[0]), range(y, high[1]), range(z, high[2])]
    spans[axis] = range(high[axis], high[axis] + 1)
    return set(itertools.product(*spans))


@stage("robot.plate")
def plate(
    cell: Cell | None,
    cloud: Cloud | None = None,
    points: PointSet | None = None,
    toolpath: Toolpath | None = None,
    *,
    scan: InputFile | None = None,
    voxel_mm: Annotated[float, Field(gt=0, le=100)] = 5.0,
    planned_at_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0,
    planned_tilt_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0,
) -> Cell | None:
    """Make the scan (plate, clamps, fixtures) a collision body of the cell, as boxes of a grid.

    It adds to the body `workpiece`, which stands on the turntable, else on the base. It is larger than the scanned
    surface by up to a cube; what was not scanned is there only if the cell file has its mesh ($.workpiece). The cutter
    (shapes with `"body": "cutter"`) may touch it. The hand-eye covariance adds to the part's uncertainty.

    Args:
        cell: the robot cell; without one there is nothing to do, nor without a scan.
        cloud: the scan.
        points: the cloud that the scan was sliced from (`edge.segment_cloud`): the body is made of all its points.
        toolpath: the path, which says how well its scan's hand-eye was known, and where tool and turntable were
            measured.
        scan: a scan as a file, where none is upstream: PLY, PCD, XYZ, mm in the base.
        voxel_mm: edge of the cubes that hold the scan's points.
        planned_at_deg: turntable angle at which the part was scanned.
        planned_tilt_deg: likewise of its tilt.

    Raises:
        InputError: points too far from the origin for the grid; a file that is no cloud, or in metres; a path whose
            tool or turntable was measured elsewhere than the cell has it, or whose cutter is another.

    Example:
        >>> from workbench import edge, path, robot, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/raw_edge.h5"))
        >>> raw = edge.segment_raw(points, upper_side=[0, 0, 1])
        >>> plan = path.feed(path.layers(raw, points), points, raw)
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> type(robot.plate(cell, points)).__name__
        'JudgedCell'
    """
    if cell is None:
        return None
    _check_cutter(cell, toolpath)
    cell = _as_measured(_as_known(cell, cloud, toolpath), toolpath)
    if points is not None:
        seen, source = points.points_mm, points.source
    elif cloud is not None:
        seen, source = _seen(cloud), cloud.source
    elif scan is not None:
        seen, source = read_workpiece(scan, f"{scan}")[0], str(scan)
    else:
        return cell
    on_table = cell.turntable is not None
    if sliding(cell) and planned_at_deg:
        raise InputError(
            "robot.plate.planned_at_deg", "expected 0: the cell has a track, whose base is where it is at 0"
        )
    planned = external_at(cell, planned_at_deg, planned_tilt_deg, "robot.plate.planned_tilt_deg")
    pose = inverse(turntable_pose(cell, planned)) if on_table else np.eye(4)
    body = scanned(seen, voxel_mm, ON_TURNTABLE if on_table else ON_BASE, pose, source or "cloud")
    touch = cell.may_touch if CONTACT in cell.may_touch else (*cell.may_touch, CONTACT)
    unchecked = tuple(text for text in cell.unchecked if not text.startswith("collision with the workpiece"))
    unseen = cell.unseen
    if all(shape.body != "workpiece" for shape in cell.shapes):
        size = " by ".join(f"{side:.0f}" for side in np.ptp(seen, axis=0))
        unseen += (BEYOND_SCAN.format(size),)
    shapes = (*cell.shapes, *body)
    return dataclasses.replace(
        cell, shapes=shapes, may_touch=touch, unchecked=unchecked, unseen=unseen, scanned_at=planned
    )


def _check_cutter(cell: Cell, toolpath: Toolpath | None) -> None:
    """Refuse a path whose cutter is none of the cell's: the one that is in the spindle cuts deeper, or less."""
    round_ = [shape.size_mm[0] for shape in cell.shapes if shape.body == CONTACT[0] and shape.kind in ROUND]
    if toolpath is None or not round_:
        return
    nearest = min(round_, key=lambda radius: abs(radius - toolpath.cutter.radius_mm))
    if abs(nearest - toolpath.cutter.radius_mm) > CUTTER_MM:
        raise InputError(
            f"{cell.source}: $.tool.shapes",
            f"expected a cutter of {toolpath.cutter.diameter_mm:g} mm diameter, as the path has, found "
            f"{2.0 * nearest:g} mm: is another one in the spindle (cutter_diameter_mm of the path)?",
        )


def _as_known(cell: Cell, cloud: Cloud | None, toolpath: Toolpath | None) -> Cell:
    """The cell with what the hand-eye leaves open of the part: by the scan, or as the path says that was made of it."""
    stated = None if toolpath is None else toolpath.part.hand_eye_u_mm
    known = None if cloud is None else scan_uncertainty(cloud)
    if known is None and stated is None:
        if cell.margins.part_mm:
            return dataclasses.replace(cell, unseen=(*cell.unseen, BASE_U_ALONE))
        return dataclasses.replace(cell, unchecked=(*cell.unchecked, NO_HAND_EYE_U))
    mm, rad = known or (stated or 0.0, 0.0)
    margins = dataclasses.replace(
        cell.margins,
        part_mm=float(np.hypot(cell.margins.part_mm, mm)),
        part_rad=float(np.hypot(cell.margins.part_rad, rad)),
    )
    return dataclasses.replace(cell, margins=margins)


def _as_measured(cell: Cell, toolpath: Toolpath | None) -> Cell:
    """The cell, if its tool and turntable lie where those of the path were measured; what is nearly so is told."""
    axes = {} if toolpath is None or toolpath.chain is None else toolpath.chain.axes
    table = cell.turntable
    told: list[str] = []
    if "tool" in axes:  # of one that the controller knows, programs do not have the place
        pose, most = cell.flange_from_cutter, TOOL_BESIDE if cell.tool_name is None else ANOTHER_TOOL
        told, beyond_mm = _compared(axes["tool"], pose, most, f"{cell.source}: $.tool.flange_from_cutter")
        if abs(beyond_mm) > TOOL_BESIDE[0]:
            told.append(
                f"the tool's length: its tip was measured {beyond_mm:+.3g} mm beyond the cell's, along its axis"
            )
    if "turntable" in axes and table is not None and table.on is None and not table.slides:
        where = f"{cell.source}: $.turntable.base_from_turntable"
        told += _compared(axes["turntable"], table.base_from_turntable, TABLE_BESIDE, where)[0]
    return dataclasses.replace(cell, unchecked=(*cell.unchecked, *told))


def _compared(measured: MeasuredAxis, pose: Float, most: tuple[float, float], where: str) -> tuple[list[str], float]:
    """What is to be told of an axis, the z of a pose, that lies beside its measured one; and how far beyond its origin.

    Raises:
        InputError: it is off by more than `most`, mm and deg, and than its uncertainty: it would cut elsewhere.
    """
    place, u = np.array(measured.point_mm), np.array([measured.u_mm, measured.u_deg])
    away, axis = pose[:3, :3].T @ (place - pose[:3, 3]), pose[:3, 2]
    along = axis if measured.direction is None else np.array(measured.direction)
    turn = np.arctan2(np.linalg.norm(np.cross(axis, along)), axis @ along)
    off = np.array([np.hypot(*away[:2]), turn / DEG])
    point = ", ".join(f"{v:.2f}" for v in place)
    said = f"lies {off[0]:.3g} mm beside the measured axis through ({point}) mm, and is turned by {off[1]:.2g} deg"
    if (off > np.maximum(most, SURE * u)).any():
        raise InputError(where, f"{said}: is it another one, or was that not entered here?")
    return [f"{where} {said}"] * bool((off > np.maximum(ENTERED, SURE * u)).any()), away[2]


def _seen(cloud: Cloud) -> Float:
    """Its points (n, 3) in the base."""
    origin = cloud.base_from_profiler[len(cloud.base_from_profiler) // 2, :3, 3]
    return np.asarray(fuse(cloud.x_mm, cloud.z_mm, cloud.base_from_profiler, origin)[cloud.keep] + origin)


def scan_uncertainty(cloud: Cloud) -> tuple[float, float] | None:
    """What the hand-eye leaves open of a scan in the base: standard uncertainties, mm and rad, of the worst direction.

    At the point of the scan where it is largest; None where the calibration states no covariance.
    """
    covariance, pose = cloud.hand_eye_covariance, cloud.flange_from_profiler
    if covariance is None or pose is None:
        return None
    frame, column = (places[:: max(len(places) // SAMPLED, 1)] for places in np.nonzero(cloud.keep))
    seen = np.column_stack([cloud.x_mm[frame, column], np.zeros(len(frame)), cloud.z_mm[frame, column]])
    arm = seen.astype(float) @ pose[:3, :3].T  # turned by the rotation's error, in the flange
    by_turn = np.cross(arm[:, None], np.eye(3))  # (n, 3, 3): w -> w x arm
    jacobian = np.concatenate([np.broadcast_to(np.eye(3), by_turn.shape), by_turn], axis=2)
    of_points = jacobian @ covariance @ jacobian.transpose(0, 2, 1)
    return float(np.sqrt(np.linalg.eigvalsh(of_points).max())), float(
        np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:]).max())
    )
