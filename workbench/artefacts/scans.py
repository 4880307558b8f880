"""What was scanned: recordings, the scanner on the robot, clouds with and without a grid, also as Open3D's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol

import numpy as np

from workbench.artefacts.evidence import UNKNOWN_PART, Check, Part
from workbench.artefacts.showing import picture_html, space_scene
from workbench.geometry.poses import in_planes
from workbench.units import AnyArray, Bool, Float, Float32, Int, Shaped, frozen


def tensor_cloud(points_mm: Float, **attributes: AnyArray) -> Any:
    """`open3d.t.geometry.PointCloud` with float64 positions and int32 (n, 1) attributes by name."""
    import open3d as o3d

    cloud = o3d.t.geometry.PointCloud()
    cloud.point["positions"] = o3d.core.Tensor.from_numpy(np.array(points_mm, np.float64))
    for name, values in attributes.items():
        cloud.point[name] = o3d.core.Tensor.from_numpy(np.ascontiguousarray(values, np.int32)[:, None].copy())
    return cloud


def positions(cloud: Any) -> Float:
    """Points (n, 3) of either of Open3D's point clouds, those that are not finite left out."""
    points = cloud.point.positions.cpu().numpy() if hasattr(cloud, "point") else cloud.points
    array = np.array(points, np.float64).reshape(-1, 3)
    return array[np.isfinite(array).all(axis=1)]


class Labelled(Protocol):
    """An edge: it labels the grid's points by face."""

    @property
    def labels(self) -> AnyArray:
        """(N, M) uint8."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Profile frames and robot poses as recorded (docs/conventions.md; INTERFACES section 1)."""

    source: str  # the file's name as given, for messages
    time_s: Shaped[Float, " N"]  # exposure times on the robot's clock (or the profiler's own, see `clock`)
    x_mm: Shaped[Float32, "N M"]  # lateral, profiler frame; NaN = no return
    z_mm: Shaped[Float32, "N M"]  # range, profiler frame; NaN = no return
    pass_index: Shaped[Int, " N"]  # scanning pass of each frame
    robot_time_s: Shaped[Float, " K"]
    robot_position_mm: Shaped[Float, "K 3"]  # flange origin in the base
    robot_quaternion_wxyz: Shaped[Float, "K 4"]  # flange orientation in the base, unit length
    robot_pass: Shaped[Int, " K"]
    flange_from_profiler: Shaped[Float, "4 4"] | None = None
    intensity: Shaped[AnyArray, "N M"] | None = None  # uint16
    sphere_diameter_mm: float | None = None  # set: a calibration recording
    clock: Literal["robot", "own"] = "robot"
    part: Part = UNKNOWN_PART
    checks: tuple[Check, ...] = ()
    not_confirmed: tuple[str, ...] = ()  # what its import took for granted and nobody has confirmed


@dataclass(frozen=True, slots=True, eq=False)
class HandEye:
    """Pose of the profiler on the flange, with its uncertainty where known."""

    flange_from_profiler: Shaped[Float, "4 4"]
    covariance: Shaped[Float, "6 6"] | None = (
        None  # tx ty tz mm, rotation vector rad in the flange frame; R_true = exp(w) R
    )
    source: str = ""
    calibrated_at: str | None = None  # ISO 8601
    volume_u_mm: float | None = None  # predicted RMS error of a point over the field of view
    sensor_scale: tuple[float, float] = (1.0, 1.0)  # of the profiler's x and z: measured over true, ...
    sensor_middle_mm: tuple[float, float] = (0.0, 0.0)  # ... about this place, which stays


@dataclass(frozen=True, slots=True, eq=False)
class TaughtEdge:
    """Where a lower edge is, roughly: points that a robot was led to."""

    points_mm: Shaped[Float, "p 3"]  # in the base, in order of t = m x n
    upper_side: Shaped[Float, " 3"]  # roughly m, in the base
    source: str


@dataclass(frozen=True, slots=True, eq=False)
class ScanCourse:
    """One pass as it is to be driven."""

    base_from_profiler: Shaped[Float, "k 4 4"]  # straight between them
    frame_pitch_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class PlannedScan:
    """The passes of a planned scan, and the profiler that they were planned for."""

    courses: tuple[ScanCourse, ...]
    columns: int
    pitch_mm: float  # between them, at the stand-off
    standoff_mm: float
    range_mm: tuple[float, float]
    noise_mm: float
    camera_mm: float | None  # beside the laser, along y; None: unknown
    z_away: bool
    plan_id: str | None = None  # of its scan-plan.json


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """An organised point cloud: the scanner's grid (frame x column), one pose per frame and what is kept.

    Base coordinates of point (i, j) are `base_from_profiler[i] @ (x, 0, z, 1)`; they are computed where needed
    (`workbench.geometry.grids.fuse`), since the grid itself is the index that every later stage works on.
    """

    x_mm: Shaped[Float32, "N M"]  # profiler frame
    z_mm: Shaped[Float32, "N M"]
    keep: Shaped[Bool, "N M"]  # False: no return, or rejected by a filter
    base_from_profiler: Shaped[Float, "N 4 4"]
    time_s: Shaped[Float, " N"]
    pass_index: Shaped[Int, " N"]
    hand_eye_covariance: Shaped[Float, "6 6"] | None = None  # as in HandEye
    flange_from_profiler: Shaped[Float, "4 4"] | None = None
    recorded_flange_from_profiler: Shaped[Float, "4 4"] | None = None  # which the recording itself carries
    source: str = ""
    part: Part = UNKNOWN_PART
    rejected: Mapping[str, int] = field(default_factory=dict)  # cause -> number of points
    checks: tuple[Check, ...] = ()  # of the recording that it was made from
    sparse_poses_u: tuple[float, float] = (0.0, 0.0)  # of a frame's place, mm, and turn, rad, between poses far apart
    only_end_poses: bool = False  # some pass has the poses of its two ends only: frames do not average their errors
    intensity: Shaped[AnyArray, "N M"] | None = None  # brightness, where it was recorded

    def of_frames(self, frames: slice | Int) -> Cloud:
        """The cloud of some of its frames; of a slice its grid is a view."""
        named = ["x_mm", "z_mm", "keep", "base_from_profiler", "time_s", "pass_index"]
        named += [] if self.intensity is None else ["intensity"]
        return replace(self, **{name: getattr(self, name)[frames] for name in named})

    def plot(self) -> Any:
        """A PyVista plotter with the kept points in the base."""
        return space_scene(points_mm=self.points_mm)

    def more_html(self) -> str:
        """Its picture."""
        return picture_html(self.plot())

    @property
    def points_mm(self) -> Float:
        """(n, 3) kept points in the base, frame by frame; computed anew each time."""
        return self.placed(*np.nonzero(self.keep))

    def to_open3d(self, edge: Labelled | None = None) -> Any:
        """The kept points as `open3d.t.geometry.PointCloud`, in mm in the base.

        Attributes: `frame` and `column` (places in the scanner's grid) and `face` (`FACE_NAMES`; 0 without an edge).
        `.to_legacy()` of it is Open3D's older point cloud, without them.
        """

        frame, column = np.nonzero(self.keep)
        face = np.zeros(len(frame), np.int32) if edge is None else edge.labels[frame, column]
        return tensor_cloud(self.placed(frame, column), face=face, frame=frame, column=column)

    def placed(self, frame: Int, column: Int) -> Float:
        """(n, 3) points in the base at places (n,) of the grid."""
        x, z = (of[frame, column].astype(np.float64) for of in (self.x_mm, self.z_mm))
        return in_planes(self.base_from_profiler[frame], x, z)


@dataclass(frozen=True, slots=True, eq=False)
class PointSet:
    """A cloud without profiles, as other people's scanners and programs write it: n points in the base.

    They stand in no order, or at places of a grid of rows and columns where the file has one.
    """

    points_mm: Shaped[Float, "n 3"]  # finite
    source: str = ""  # the file's name as given, for messages
    part: Part = UNKNOWN_PART
    row: Shaped[Int, " n"] | None = None  # of the file's grid, never falling
    column: Shaped[Int, " n"] | None = None  # rising along a row
    warnings: tuple[str, ...] = ()  # what was taken for granted of the file

    def plot(self) -> Any:
        """A PyVista plotter with the points in the base."""
        return space_scene(points_mm=self.points_mm)

    def to_open3d(self) -> Any:
        """The points as `open3d.t.geometry.PointCloud`, in mm."""

        return tensor_cloud(self.points_mm)

    @classmethod
    def from_open3d(cls, cloud: Any, source: str = "open3d") -> PointSet:
        """The finite points of one of Open3D's point clouds, tensor or legacy; its coordinates are taken as mm."""

        return cls(frozen(positions(cloud)), source)
