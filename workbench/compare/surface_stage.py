"""`compare.surface`, `compare.mesh`, `compare.plan`: what is compared, as one kind of value, and what comes of it."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from workbench import cad
from workbench.artefacts import UNKNOWN_PART, Check, Cloud, Part, PointSet, Toolpath
from workbench.children import read_by
from workbench.compare import mesh_reader
from workbench.errors import InputError
from workbench.geometry.poses import is_rigid, mapped, rotation_from_quaternion
from workbench.stage import InputFile, stage
from workbench.units import Bool, Float, Int, Shaped

TO_MM = {"mm": 1.0, "m": 1000.0, "inch": 25.4}


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Something to compare: points of a scan, or a mesh of triangles between its points. mm, in the base."""

    points_mm: Shaped[Float, "n 3"]
    triangles: Shaped[Int, "k 3"] | None = None  # counter-clockwise from outside; None: points of a scan
    frame: Shaped[Int, " n"] | None = None  # in which each point was measured; None: not known
    range_axis: Shaped[Float, " 3"] | None = None  # mean direction of the profiler's z, of either sense; None: unknown
    course_mm: Shaped[Float, "m 3"] | None = None  # along which arc length counts; None: none is known
    source: str = ""
    part: Part = UNKNOWN_PART
    checks: tuple[Check, ...] = ()  # of the recording that it was made from
    passes_apart_mm: float | None = 0.0  # of several passes, how far from one place they see a face; None: not known
    warnings: tuple[str, ...] = ()  # what was taken for granted of its file


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Where a scan lies against a reference.

    The covariance is that of a small motion about `pivot_mm`: x_true = x + dt + w x (x - pivot), in the reference's
    frame (the base). In directions that the shapes leave open the scan was held at its initial pose.
    """

    reference_from_scan: Shaped[Float, "4 4"]
    covariance: Shaped[Float, "6 6"]  # dt in mm, w in rad
    pivot_mm: Shaped[Float, " 3"]
    overlap: float  # share of the scan's points that lie on the reference
    rms_mm: float  # of their distances along the normal
    held: tuple[str, ...]  # directions that the shapes leave open, in words
    points: int  # that it rests on
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Deviations:
    """Signed distances of a scan from a reference at c places, positive outside; NaN where either is missing."""

    position_mm: Shaped[Float, "c 3"]  # on the scan, registered
    normal: Shaped[Float, "c 3"]  # unit, outwards
    distance_mm: Shaped[Float, " c"]
    u_mm: Shaped[Float, " c"]  # standard uncertainty, that of the place included
    detectable_mm: Shaped[Float, " c"]  # level of detection at 95 %: below, no change is significant
    arc_length_mm: Shaped[Float, " c"]  # along the course
    across_mm: Shaped[Float, " c"]  # from the course, over the surface: for the map
    is_beyond: Shaped[Bool, " c"]  # not compared: the reference lies further off than was searched
    sources: tuple[tuple[str, float], ...] = ()  # of u, each with its median in mm
    warnings: tuple[str, ...] = ()

    @property
    def significant(self) -> Bool:
        """(c,) whether the distance exceeds its level of detection."""
        return abs(self.distance_mm) > self.detectable_mm


@stage("compare.surface")
def surface(
    cloud: Cloud | None = None,
    points: PointSet | None = None,
    *,
    most_points: Annotated[int, Field(ge=1000, le=20_000_000)] = 400_000,
) -> Surface:
    """Take the points of a scan for comparison: an organised cloud's, or those of a cloud without a grid.

    Args:
        cloud: the organised cloud; each point keeps the number of its frame, whose points share the robot's error.
        points: or a cloud without a grid.
        most_points: largest number of points; frames are thinned evenly.

    Raises:
        InputError: neither or both; fewer than 100 points.

    Example:
        >>> from workbench import cloud, compare, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> surface = compare.surface(points)
        >>> surface.points_mm.shape
        (174988, 3)
    """
    if (cloud is None) == (points is None):
        raise InputError("compare.surface", "expected either an organised cloud or a set of points: name one by 'from'")
    if cloud is not None:
        made = _of_cloud(cloud, most_points)
    else:
        assert points is not None
        step = -(-len(points.points_mm) // most_points)
        made = Surface(points.points_mm[::step], source=points.source, part=points.part, warnings=points.warnings)
    if len(made.points_mm) < 100:
        raise InputError(made.source or "compare.surface", f"expected 100 points or more, found {len(made.points_mm)}")
    return made


@stage("compare.mesh")
def mesh(
    *,
    mesh: InputFile,
    unit: Literal["mm", "m", "inch"] = "mm",
    base_from_mesh: list[list[float]] | None = None,
) -> Surface:
    """Read a triangle mesh to compare with: a CAD model, or another program's surface.

    Args:
        mesh: STL, PLY, OBJ (triangles counter-clockwise from outside) or STEP.
        unit: mm, m or inch; a STEP file says its own.
        base_from_mesh: 4x4 (direction cosines, mm), from the mesh's coordinates to the base; null: the same.

    Raises:
        InputError: unreadable, no triangles, not finite, no rigid motion.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> from workbench import compare
        >>> file = Path(tempfile.mkdtemp()) / "plate.obj"
        >>> file.write_text("v 0 0 0\\nv 10 0 0\\nv 0 10 0\\nf 1 2 3\\n")
        34
        >>> compare.mesh(mesh=file).points_mm.shape
        (3, 3)
    """
    points, triangles = read_mesh(mesh)
    points = points * (1.0 if mesh.suffix.lower() in cad.SUFFIXES else TO_MM[unit])
    if base_from_mesh is not None:
        pose = rigid(base_from_mesh, "compare.mesh.base_from_mesh")
        points = mapped(pose, points)
    return Surface(points, triangles=triangles, source=str(mesh))


@stage("compare.plan")
def plan(toolpath: Toolpath) -> Surface:
    """The bevel face as planned: the strip that the last layer of the milling path finishes, in the base.

    Args:
        toolpath: from `path.layers`, or read by `path.read`.

    Raises:
        InputError: the last layer does not cut.

    Example:
        >>> from workbench import compare, path
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> len(compare.plan(plan).points_mm)
        294
    """
    layer = toolpath.layers[-1]
    axes = rotation_from_quaternion(layer.quaternion_wxyz)
    if toolpath.base_from_workobject is not None:
        axes = toolpath.base_from_workobject[:3, :3] @ axes
    middle = toolpath.in_base(toolpath.face_middle_mm(layer))
    points, triangles = finished_bevel(middle, axes, layer.width_mm, layer.cutting)
    if not len(triangles):
        raise InputError(toolpath.source or "toolpath", "expected a last layer that cuts, found none")
    along = layer.cutting & (layer.width_mm > 0)
    course = toolpath.in_base(layer.position_mm[along])
    return Surface(
        points, triangles=triangles, course_mm=course, source=toolpath.source or "toolpath", part=toolpath.part
    )


def rigid(rows: list[list[float]], where: str) -> Float:
    """A parameter as a rigid motion (4, 4)."""
    pose = np.array(rows, float) if all(len(row) == 4 for row in rows) else np.empty(0)
    if pose.shape != (4, 4) or not is_rigid(pose):
        raise InputError(where, "expected a rigid motion, 4x4")
    return pose


def _of_cloud(cloud: Cloud, most_points: int) -> Surface:
    from workbench.geometry import grids

    step = max(1, -(-int(cloud.keep.sum()) // most_points))
    frames = slice(None, None, step)
    poses = np.ascontiguousarray(cloud.base_from_profiler[frames])
    origin = poses[:, :3, 3].mean(axis=0)
    local = grids.fuse(
        np.ascontiguousarray(cloud.x_mm[frames]), np.ascontiguousarray(cloud.z_mm[frames]), poses, origin
    )
    row, column = np.nonzero(cloud.keep[frames])
    number: Int = np.arange(len(cloud.keep))[frames][row]
    view = poses[:, :3, 2].mean(axis=0)
    return Surface(
        local[row, column].astype(float) + origin,
        frame=number,
        range_axis=view / np.linalg.norm(view),
        source=cloud.source,
        part=cloud.part,
        checks=cloud.checks,
        passes_apart_mm=_passes_apart_mm(cloud),
    )


def _passes_apart_mm(cloud: Cloud) -> float | None:
    """How far apart passes see one face; None: no check says."""
    if len(np.unique(cloud.pass_index)) < 2:
        return 0.0
    return next((check.value for check in cloud.checks if check.name == "pass_disagreement_mm"), None)


# The planned bevel face as a strip of triangles.


def finished_bevel(position_mm: Float, axes: Float, width_mm: Float, cutting: Bool) -> tuple[Float, Int]:
    """Vertices (2 k, 3) and triangles of the face between the two edges of the last layer's bevel face.

    `position_mm` (k, 3) lies at mid-width; `axes` (k, 3, 3) are x (into the material), y (feed), z (from shank to tip,
    in the face) as columns; `width_mm` (k,). Triangles run counter-clockwise from outside, where both ends cut.
    """
    half = 0.5 * width_mm[:, None] * axes[:, :, 2]
    points = np.stack([position_mm - half, position_mm + half], axis=1).reshape(-1, 3)
    first = np.flatnonzero(cutting[:-1] & cutting[1:] & (width_mm[:-1] > 0) & (width_mm[1:] > 0))
    a, b, c, d = 2 * first, 2 * first + 1, 2 * first + 2, 2 * first + 3
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([b, d, c])]).astype(np.int64)
    used, renumbered = np.unique(triangles, return_inverse=True)
    return points[used], renumbered.reshape(-1, 3).astype(np.int64)


# A mesh out of a file: read by Open3D in a process of its own, then checked.

MESHES = (".stl", ".ply", ".obj", *cad.SUFFIXES)
MOST_BYTES = 2**31
MOST = 1e7  # size of a coordinate
SECONDS, BYTES_A_SECOND = 60, 1_000_000


def read_mesh(path: Path) -> tuple[Float, Int]:
    """Vertices (n, 3) in the file's unit, of STEP in mm, and triangles (k, 3).

    Raises:
        InputError: unreadable, damaged, no triangles, not finite.
    """
    if path.suffix.lower() not in MESHES:
        raise InputError(str(path), f"expected a mesh as {', '.join(MESHES)}")
    try:
        size = path.stat().st_size
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from None
    if not 0 < size <= MOST_BYTES:
        raise InputError(str(path), f"expected 1 to {MOST_BYTES} bytes, found {size}")
    is_cad = path.suffix.lower() in cad.SUFFIXES
    points, triangles = cad.surface(path) if is_cad else _in_process(path, SECONDS + size / BYTES_A_SECOND)
    if not len(triangles) or not len(points):
        raise InputError(str(path), "expected a mesh with triangles, found none")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise InputError(str(path), "expected triangles between its own vertices")
    if not (np.abs(points) <= MOST).all():
        raise InputError(str(path), f"expected finite coordinates within {MOST:g}")
    if not _area(points, triangles) > 0:
        raise InputError(str(path), "expected triangles with an area, found none")
    return points, triangles


def _area(points: Float, triangles: Int) -> float:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _in_process(path: Path, seconds: float) -> tuple[Float, Int]:
    try:
        with read_by(mesh_reader.__file__, path, "mesh.npz", seconds) as (status, _, out):
            if status or not out.exists():
                raise InputError(str(path), f"expected a complete {path.suffix[1:].upper()} file: its reader crashed")
            with np.load(out) as found:
                return np.asarray(found["points"], float), np.asarray(found["triangles"], np.int64)
    except subprocess.TimeoutExpired:
        raise InputError(str(path), f"expected a whole mesh: not read within {seconds:.0f} s") from None
