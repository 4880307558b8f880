"""The values that stages exchange. Frozen: a stage takes artefacts and returns new ones.

Lengths in mm, times in s, angles in rad unless a name ends in `_deg`; `a_from_b` maps coordinates in b to a.
N frames, M columns, K robot poses. NaN marks what was not measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any, Literal

import numpy as np

from workbench.geometry.faces import FaceLines
from workbench.geometry.times import step_lengths_mm, travel_time_s
from workbench.units import AnyArray, Bool, Float, Float32, Int

Verdict = Literal["pass", "fail", "undecided"]

# Face labels of a grid point, in `Edge.labels` (uint8).
UNLABELLED, ROOT_FACE, BEVEL_FACE, UPPER_SURFACE, LOWER_SURFACE = range(5)
FACE_NAMES = ("unlabelled", "root face", "bevel face", "upper surface", "lower surface")


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Profile frames and robot poses as recorded (docs/conventions.md; INTERFACES section 1)."""

    source: str  # the file's name as given, for messages
    time_s: Float  # (N,) exposure times on the robot's clock (or the profiler's own, see `clock`)
    x_mm: Float32  # (N, M) lateral, profiler frame; NaN = no return
    z_mm: Float32  # (N, M) range, profiler frame; NaN = no return
    pass_index: Int  # (N,) scanning pass of each frame
    robot_time_s: Float  # (K,)
    robot_position_mm: Float  # (K, 3) flange origin in the base
    robot_quaternion_wxyz: Float  # (K, 4) flange orientation in the base, unit length
    robot_pass: Int  # (K,)
    flange_from_profiler: Float | None = None  # (4, 4)
    intensity: AnyArray | None = None  # (N, M) uint16
    sphere_diameter_mm: float | None = None  # set: a calibration recording
    clock: Literal["robot", "own"] = "robot"
    part_id: str | None = None  # free text out of the file: data, never a path


@dataclass(frozen=True, slots=True, eq=False)
class HandEye:
    """Pose of the profiler on the flange, with its uncertainty where known."""

    flange_from_profiler: Float  # (4, 4)
    covariance: Float | None = None  # (6, 6) tx ty tz mm, rotation vector rad in the flange frame; R_true = exp(w) R
    source: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """An organised point cloud: the scanner's grid (frame x column), a pose a frame and what is kept.

    Base coordinates of point (i, j) are `base_from_profiler[i] @ (x, 0, z, 1)`; they are computed where needed
    (`workbench.geometry.grids.fuse`), since the grid itself is the index that every later stage works on.
    """

    x_mm: Float32  # (N, M) profiler frame
    z_mm: Float32  # (N, M)
    keep: Bool  # (N, M) False: no return, or rejected by a filter
    base_from_profiler: Float  # (N, 4, 4)
    time_s: Float  # (N,)
    pass_index: Int  # (N,)
    hand_eye_covariance: Float | None = None  # (6, 6) as in HandEye
    flange_from_profiler: Float | None = None  # (4, 4)
    source: str = ""
    part_id: str | None = None
    rejected: Mapping[str, int] = field(default_factory=dict)  # cause -> number of points


@dataclass(frozen=True, slots=True, eq=False)
class PointSet:
    """A cloud without a grid, as other people's scanners and programs write it: n points in the base, in no order."""

    points_mm: Float  # (n, 3) finite
    source: str = ""  # the file's name as given, for messages
    part_id: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class EdgeFrames:
    """What each of the N frames says about a milled edge, in the section plane; NaN where it does not see the edge.

    Angles are directions of the faces, from the lower to the upper side, in the plane normal to the edge's tangent,
    counted from `reference` towards t x `reference`.
    """

    arc_length_mm: Float  # (N,) where the frame crosses the upper edge of the root face
    lower_arc_length_mm: Float  # (N,) where it crosses the lower edge
    reference: Float  # (N, 3) unit vector normal to t that does not twist along the edge
    tilt: Float  # (N,) direction of the root face, as estimated for the whole pass, rad
    root_angle: Float  # (N,) direction of the root face in this frame alone, rad
    root_angle_variance: Float  # (N,) rad^2, from independent range noise
    bevel_arc_length_mm: Float  # (N,) where the frame measures the bevel
    bevel_angle: Float  # (N,) direction of the bevel face, corrected for drift and curvature, rad
    bevel_angle_variance: Float  # (N,) rad^2, from independent range noise
    bevel_lever_mm: Float  # (N,) distance of the bevel's measured points from the upper edge of the root face
    root_low_mm: Float  # (N,) root size up to the last return on the root face; the edge lies at most a step beyond
    root_step_mm: Float  # (N,) that step between columns; 0 where the lower edge is a corner of two faces
    root_sigma_mm: Float  # (N,) standard deviation of root_low_mm from range noise
    root_weight: Float  # (N,) what the frame counts for the root size: less than 1 where neighbours say the same
    missing: Float  # (N,) probability that a column at the end of the root face has no return on it
    tangent_leverage: (
        Float  # (N,) error of the bevel angle per error of the edge's tangent; 0: the laser plane is square
    )


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """The workpiece's edge as measured: faces a frame, the lower edge as a curve in the base.

    t = m x n (docs/conventions.md). Curve arrays have one row a *station*, about 1 mm apart, from arc length 0 at the
    first measured point of the lower edge to its last.
    """

    kind: Literal["milled", "raw"]
    faces: Mapping[int, FaceLines]  # by label: ROOT_FACE (the end face of a raw edge), BEVEL_FACE, ...
    labels: AnyArray  # (N, M) uint8, face of each grid point
    pass_index: Int  # (N,)
    frame_arc_length_mm: Float  # (N,) where each frame crosses the lower edge; NaN: edge not seen in that frame
    frame_tangent: Float  # (N, 3) t at each frame, NaN where not seen
    frames: EdgeFrames | None  # None: a raw edge
    tangent_u: float  # standard uncertainty of the tangent's direction, rad
    arc_length_mm: Float  # (n,)
    position_mm: Float  # (n, 3) lower edge in the base; NaN where hidden
    tangent: Float  # (n, 3) unit, rising arc length; interpolated where hidden
    normal: Float  # (n, 3) unit outward normal of the end face (root face), in the section plane
    across: Float  # (n, 3) unit, m: from the lower to the upper side
    seen: Bool  # (n,) measured here; False under clamps and in other gaps
    burr_stations: Int  # (b,) stations where material stands out beyond the faces
    upper_position_mm: Float | None = None  # (n, 3) raw edge: its upper edge; NaN where hidden
    upper_inward: Float | None = None  # (n, 3) raw edge: unit, along the upper surface, into the plate
    position_u_mm: Float | None = None  # (n, 2) standard uncertainty of `position_mm` along `normal` and `across`
    normal_u: float = 0.0  # standard uncertainty of the direction of `normal` about the tangent, rad
    hand_eye_u_mm: Float | None = None  # (n, 2) as `position_u_mm`: what the hand-eye pose adds, one for the whole scan
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Requirements:
    """What the part must satisfy: nominal values and deviations from them, lower <= 0 <= upper."""

    root_nominal_mm: float = 1.5
    root_tolerance_mm: tuple[float, float] = (-0.5, 0.5)
    bevel_nominal_deg: float = 40.0
    bevel_tolerance_deg: tuple[float, float] = (-1.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """One inspected section. Values are None where the edge is hidden; `verdict` is then 'undecided'."""

    index: int  # from 1
    arc_length_mm: float
    origin_mm: Float  # (3,) on the lower edge
    tangent: Float  # (3,) unit, normal of the section plane
    normal: Float  # (3,) unit, n
    across: Float  # (3,) unit, m
    root_mm: float | None
    root_u_mm: float | None
    bevel_deg: float | None
    bevel_u_deg: float | None
    verdict: Verdict
    reason: str
    frames: Int  # indices of the frames that it rests on


@dataclass(frozen=True, slots=True, eq=False)
class EdgeProfile:
    """Root size and bevel angle along the whole edge; NaN where they cannot be measured."""

    arc_length_mm: Float  # (n,)
    position_mm: Float  # (n, 3) lower edge in the base
    root_mm: Float  # (n,)
    root_u_mm: Float  # (n,)
    bevel_deg: Float  # (n,)
    bevel_u_deg: Float  # (n,)


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """The measured part against its requirements (ISO 14253-1 with guard band `guard_factor` * u)."""

    sections: tuple[Section, ...]
    profile: EdgeProfile
    requirements: Requirements
    guard_factor: float
    verdict: Verdict
    reason: str
    root_face_tilt: str  # how the root face's tilt was estimated: 'whole edge' or 'per section'
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Cutter:
    """A cylindrical end mill that cuts with its flank (peripheral milling; the paper's section 6.2)."""

    diameter_mm: float = 10.0
    flutes: int = 4
    flute_length_mm: float = 30.0  # cutting length, along the axis


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """One layer of a milling path: k points in the order of feed, lead-in and lead-out included.

    A point's frame (docs/conventions.md): origin at mid-width of the layer's bevel face, y along the feed, z along the
    cutter's axis from shank to tip, x = y x z into the material. The cutter's axis runs a radius off, at x = -radius.
    """

    index: int  # from 1, in cutting order
    height_mm: float  # of its bevel face above the finished one, along the bevel's outward normal; 0: the final layer
    arc_length_mm: Float  # (k,) below 0 in the lead-in, beyond the edge's length in the lead-out
    position_mm: Float  # (k, 3)
    quaternion_wxyz: Float  # (k, 4)
    feed_mm_s: Float  # (k,) towards the point
    cutting: Bool  # (k,)
    measured: Bool  # (k,) False: over a hidden stretch, where nothing is cut
    width_mm: Float  # (k,) of the bevel face that is cut here; 0 in the air


@dataclass(frozen=True, slots=True, eq=False)
class Travel:
    """A move through the air between layers: k points with frames as in `Layer`."""

    position_mm: Float  # (k, 3)
    quaternion_wxyz: Float  # (k, 4)
    feed_mm_s: Float  # (k,)


@dataclass(frozen=True, slots=True, eq=False)
class Toolpath:
    """A milling path: layers in cutting order, the last one final, and the moves through the air between them."""

    cutter: Cutter
    layers: tuple[Layer, ...]
    travels: tuple[Travel, ...]  # one before each layer, and one after the last
    root_mm: float  # required
    bevel_deg: float  # required
    depth_of_cut_mm: float
    v_slow_mm_s: float  # feed while cutting
    edge_length_mm: float
    base_from_workobject: Float | None = None  # (4, 4): positions are in the work object's frame; None: in the base
    part_id: str | None = None
    source: str = ""
    refused: tuple[str, ...] = ()  # stretches and layers that are not milled, and why
    warnings: tuple[str, ...] = ()
    claim: Gate | None = None  # what the file that it was read from says of its check; None: nothing

    @property
    def in_order(self) -> tuple[Travel | Layer, ...]:
        """Travels and layers in the order in which they are run."""
        return tuple(part for pair in zip_longest(self.travels, self.layers) for part in pair if part is not None)

    @property
    def time_s(self) -> float:
        """Time of the whole path at its feeds, travels included."""
        position, feed = (
            np.concatenate([getattr(p, name) for p in self.in_order]) for name in ("position_mm", "feed_mm_s")
        )
        return travel_time_s(position, feed)

    @property
    def time_at_v_slow_s(self) -> float:
        """The same at constant v_slow: what the paper's equation (26) is compared with."""
        return float(step_lengths_mm(np.concatenate([p.position_mm for p in self.in_order])).sum()) / self.v_slow_mm_s

    def in_base(self, position_mm: Float) -> Float:
        """Positions (k, 3) of the path, in the base."""
        pose = self.base_from_workobject
        return position_mm if pose is None else position_mm @ pose[:3, :3].T + pose[:3, 3]


@dataclass(frozen=True, slots=True, eq=False)
class Postures:
    """How robot, cutter and turntable stand at n points of a path, travels included, in the order of motion.

    Travels have more points than the path's own. Turned with the cutter and the turntable, a point's frame is where
    the tool frame on the flange goes; the robot's base is the frame of all that follows.
    """

    toolpath: Toolpath  # that they are for
    layer: Int  # (n,) index of the layer; 0: through the air between layers
    cutting: Bool  # (n,)
    measured: Bool  # (n,)
    position_mm: Float  # (n, 3) of the turned frame
    quaternion_wxyz: Float  # (n, 4)
    feed_mm_s: Float  # (n,) towards the point, as the base sees it; on the workpiece it is the path's
    cutter_rotation: Float  # (n,) of the flange about the cutter's axis, rad
    turntable: Float  # (n,) rad
    joints: Float  # (n, 6) the controller's angles, rad
    displacement_mm: Float  # (n, 3) by which the cutter gives way
    clearance_mm: Float  # (n,) between bodies that must not touch; NaN: nothing could
    flange_from_point: Float  # (4, 4) the tool frame in the flange
    has_turntable: bool
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class PathDeflection:
    """By how much the tool is displaced at the points of a path's layers, in each point's own frame."""

    by_layer_mm: Mapping[int, Float]  # index of the layer -> (k, 3), in the order of its points


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """A path as a robot's controller runs it: k straight or circular moves, each to its target.

    The first target is where the robot starts.
    """

    position_mm: Float  # (k, 3) targets
    quaternion_wxyz: Float  # (k, 4)
    circular: Bool  # (k,) over `via`, else straight
    via_position_mm: Float  # (k, 3) NaN for straight moves
    via_quaternion_wxyz: Float  # (k, 4) NaN for straight moves
    feed_mm_s: Float  # (k,)
    cutting: Bool  # (k,)
    layer: Int  # (k,) index of the layer; 0: through the air between layers
    toolpath: Toolpath  # that it was made from
    points_before: int  # of that path
    chord_tolerance_mm: float
    angle_tolerance_deg: float
    turntable_deg: Float | None = None  # (k,) at each target; None: no turntable is driven
    start_joints_deg: Float | None = None  # (6,) the posture of the first target; None: the controller chooses
    flange_from_point: Float | None = None  # (4, 4) the tool frame that the postures rest on; None: any


@dataclass(frozen=True, slots=True, eq=False)
class LayerEngagement:
    """What the cutter meets in one layer, at the k points of that layer."""

    index: int  # of the layer
    arc_length_mm: Float  # (k,)
    radial_depth_mm: Float  # (k,) greatest depth of material before the cutter, normal to the layer's bevel face
    axial_depth_mm: Float  # (k,) length of the cutter's axis along which it cuts
    chip_area_mm2: Float  # (k,) of the section that is removed, normal to the feed


@dataclass(frozen=True, slots=True, eq=False)
class Engagement:
    """Engagement of the cutter along a milling path, as milled in simulation."""

    layers: tuple[LayerEngagement, ...]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """A stretch of the edge of which something is to be said."""

    from_mm: float  # arc length
    to_mm: float
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Rework:
    """What an inspection asks to be milled again, and what can no longer be mended."""

    toolpath: Toolpath | None  # None: nothing is to be milled
    too_much_material: tuple[Stretch, ...]
    too_little_material: tuple[Stretch, ...]
    reason: str
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Shading:
    """One way to colour the n points of a scene, and what the colours mean."""

    name: str
    index: AnyArray  # (n,) uint8, row of the palette
    palette: AnyArray  # (p, 3) uint8 red, green, blue
    legend: tuple[tuple[str, str], ...]  # text, '#rrggbb'


@dataclass(frozen=True, slots=True, eq=False)
class Strokes:
    """Lines of a scene that are shown and hidden together."""

    name: str
    lines_mm: tuple[Float, ...]  # each (k, 3) in the base, finite
    colours: tuple[AnyArray, ...]  # each (k, 3) uint8, one a point
    shown: bool = True  # at first


@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """What can be chosen in a scene, such as a section.

    A row of the chapter's tables with the attribute `data-mark` equal to `key` is chosen with it.
    """

    key: str
    place_mm: Float  # (3,) in the base: where its label stands
    outline_mm: Float  # (k, 3) in the base: drawn, and closed where it can be clicked
    colour: str  # '#rrggbb'
    facts: tuple[tuple[str, str], ...]  # name and value, shown while it is chosen


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What a chapter shows in space, to be turned in a browser. Any first part of the points shows the whole."""

    points_mm: Float  # (n, 3) in the base
    shadings: tuple[Shading, ...]  # at least one where there are points
    strokes: tuple[Strokes, ...]
    marks: tuple[Mark, ...]
    axes: Float  # (3, 3) rows t, n, m: the first look is along them, m stays upright
    marks_are: str = "sections"


@dataclass(frozen=True, slots=True, eq=False)
class Chapter:
    """A part of the report: a title and HTML that is complete in itself (pictures as data addresses).

    Its own headings are <h3>; the page numbers them. Text out of files must be escaped in it. Where it has a scene,
    its HTML says with an empty `<figure class="space"></figure>` where that is to stand.
    """

    title: str
    html: str
    verdict: Verdict | Literal[""] = ""  # '': the chapter decides nothing
    summary: str = ""  # one line for the top of the page, plain text
    part: str = ""  # the part that it is about, as its recording names it
    warnings: tuple[str, ...] = ()
    scene: Scene | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Provenance:
    """What a run rests on, for its report. The runner supplies it to a stage that asks for it."""

    title: str
    inputs: tuple[tuple[str, str, str], ...]  # name, path as given, SHA-256
    versions: Mapping[str, str]  # package -> version
    pipeline: Mapping[str, Any]  # as resolved
    seed: int


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """A file that a run writes: `name` inside the output directory and its bytes."""

    name: str
    content: bytes


@dataclass(frozen=True, slots=True, eq=False)
class Gate:
    """The pipeline's decision: the exit status is 1 where `passed` is False, or where a check was loosened."""

    passed: bool
    reason: str
    loosened: tuple[str, ...] = ()  # checks that a parameter made weaker than the rule: programs say so
    unchecked: tuple[str, ...] = ()  # what nothing in the run could look at: programs say so

    @property
    def clean(self) -> bool:
        """Passed, with every check in full force."""
        return self.passed and not self.loosened

    @property
    def cause(self) -> str:
        """Why the exit status is not 0; '' where it is."""
        return "; ".join(self.loosened) if self.passed else self.reason


@dataclass(frozen=True, slots=True, eq=False)
class PathGate(Gate):
    """The decision on one milling path: a program is written for this path only, and only if it passed."""

    toolpath: Toolpath = field(kw_only=True)
    tolerance_mm: float = field(kw_only=True)  # by which a program's moves may leave the path and the decision holds
    reached: bool = False  # postures were found for all points: reachable, inside limits, clear of collision


class RobotCell:
    """What a pipeline has where it knows the robot: then no program is written without postures."""

    __slots__ = ()


def frozen(array: AnyArray) -> AnyArray:
    """`array`, made read-only (a view; the caller gives up writing to it)."""
    view = np.asarray(array).view()
    view.flags.writeable = False
    return view
