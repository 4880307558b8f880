"""Milling paths: cutter, layers, travels; how the robot stands, gives way and moves; what the cutter met and left."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from typing import Any

import numpy as np

from workbench.artefacts.decisions import Gate
from workbench.artefacts.evidence import UNKNOWN_PART, Check, Part
from workbench.artefacts.showing import columns_table, space_scene
from workbench.errors import InputError
from workbench.geometry.moves import step_lengths_mm, travel_time_s
from workbench.geometry.poses import mapped, rotation_from_quaternion
from workbench.units import DEG, Bool, Float, Int, Shaped


@dataclass(frozen=True, slots=True, eq=False)
class Cutter:
    """An end mill that cuts with its flank (peripheral milling; the paper's 6.2), and with a ball end if any."""

    diameter_mm: float = 10.0
    flutes: int = 4
    flute_length_mm: float = 30.0  # cutting length, along the axis, a ball end included
    ball_end: bool = False  # its end is half a sphere of the cutter's radius; else flat

    @property
    def radius_mm(self) -> float:
        """Of the cylinder, and of the ball end."""
        return self.diameter_mm / 2.0

    @property
    def cylinder_end_mm(self) -> float:
        """How far the cylinder reaches from a frame's origin towards the tip: there a ball end has its centre."""
        return self.flute_length_mm / 2.0 - (self.radius_mm if self.ball_end else 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """One layer of a milling path: k points in the order of feed, lead-in and lead-out included.

    A point's frame (docs/conventions.md): origin at mid-width of the layer's bevel face, y along the feed, z along the
    cutter's axis from shank to tip, x = y x z into the material. The cutter's axis runs a radius off, at x = -radius.
    Under a ball end the origin lies on the bevel face, at the middle of the flutes.
    """

    index: int  # from 1, in cutting order
    height_mm: float  # of its bevel face above the finished one, along the bevel's outward normal; 0: the final layer
    arc_length_mm: Shaped[Float, " k"]  # below 0 in the lead-in, beyond the edge's length in the lead-out
    position_mm: Shaped[Float, "k 3"]
    quaternion_wxyz: Shaped[Float, "k 4"]
    feed_mm_s: Shaped[Float, " k"]  # towards the point
    cutting: Shaped[Bool, " k"]
    measured: Shaped[Bool, " k"]  # False: over a hidden stretch, where nothing is cut
    width_mm: Shaped[Float, " k"]  # of the bevel face that is cut here; 0 in travel moves


@dataclass(frozen=True, slots=True, eq=False)
class Travel:
    """A travel move between layers: k points with frames as in `Layer`."""

    position_mm: Shaped[Float, "k 3"]
    quaternion_wxyz: Shaped[Float, "k 4"]
    feed_mm_s: Shaped[Float, " k"]


@dataclass(frozen=True, slots=True)
class MeasuredAxis:
    """The axis of a tool (in the flange, through its tip) or of a turntable (in the base), as calibrated."""

    point_mm: tuple[float, float, float]
    direction: tuple[float, float, float] | None  # None: not measured
    u_mm: float
    u_deg: float


@dataclass(frozen=True, slots=True)
class ChainU:
    """What tool, turntable and robot make of a path's place, beyond edge and hand-eye pose: one error of all of it."""

    place_mm: float  # standard uncertainty along any axis
    turn: float  # of the face's direction, rad
    rests_on: tuple[str, ...]  # the links that are in it
    axes: Mapping[str, MeasuredAxis] = field(default_factory=dict)  # by link: what a cell must have there


@dataclass(frozen=True, slots=True, eq=False)
class Toolpath:
    """A milling path: layers in cutting order, the last one final, and the travel moves between them."""

    cutter: Cutter
    layers: tuple[Layer, ...]
    travels: tuple[Travel, ...]  # one before each layer, and one after the last
    root_mm: float  # required
    bevel_deg: float  # required
    depth_of_cut_mm: float
    v_slow_mm_s: float  # feed while cutting
    edge_length_mm: float
    base_from_workobject: Shaped[Float, "4 4"] | None = (
        None  # positions are in the work object's frame; None: in the base
    )
    part: Part = UNKNOWN_PART
    source: str = ""
    refused: tuple[str, ...] = ()  # stretches and layers that are not milled, and why
    warnings: tuple[str, ...] = ()
    evidence: tuple[Check, ...] = ()  # what was checked of the recording and the edge that it rests on
    claim: Gate | None = None  # what the file that it was read from says of its check; None: nothing
    finish_allowance_mm: float = 0.0  # left on the bevel face for `finishing`, along its normal
    before: tuple[Layer, ...] = ()  # milled earlier along this edge, heights above this path's finished face
    rests_on: str = ""  # what must have been milled before, by another path: nothing here shows it
    chain: ChainU | None = None  # None: no link is stated
    root_radius_mm: float = 0.0  # of a J preparation: its fillet between root face and bevel face; 0: none
    finishing: Toolpath | None = None  # the pass that takes the allowance, once the cut was measured (path.correct)
    about: tuple[str, ...] = ()  # what it is, in lines for a program's head, where it is no milling path

    @property
    def mills(self) -> bool:
        """Whether a cutter is led along it."""
        return not self.about

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

    @property
    def shape(self) -> str:
        """What it mills, in words."""
        return "J preparation" if self.root_radius_mm else "bevel"

    @property
    def plane_mm(self) -> float:
        """Where the bevel face's plane meets the end face: at the root face, or below, where a fillet lies between."""
        return self.root_mm + self.root_radius_mm * (1.0 - 1.0 / math.sin(self.bevel_deg * DEG))

    def face_middle_mm(self, layer: Layer) -> Float:
        """Middle (k, 3) of the bevel face that a layer cuts: the frames' origins, but under a ball end.

        There the face begins where the fillet ends, beside the ball's centre, or on the end face where the ball passes
        outside of it: (height - radius) / tan(bevel) further up.
        """
        if not self.root_radius_mm:
            return layer.position_mm
        outside = max(0.0, layer.height_mm - self.root_radius_mm) / math.tan(self.bevel_deg * DEG)
        down = self.cutter.cylinder_end_mm - outside - 0.5 * layer.width_mm
        return layer.position_mm + down[:, None] * rotation_from_quaternion(layer.quaternion_wxyz)[:, :, 2]

    def table(self) -> Any:
        """A row a key point, layer after layer: a pandas DataFrame where pandas is installed, else a list of dicts."""
        names = ("arc_length_mm", "feed_mm_s", "cutting", "measured", "width_mm")
        columns = {name: np.concatenate([getattr(layer, name) for layer in self.layers]) for name in names}
        place = np.concatenate([self.in_base(layer.position_mm) for layer in self.layers])
        layer = np.concatenate([np.full(len(each.feed_mm_s), each.index) for each in self.layers])
        return columns_table(layer=layer, **columns, x_mm=place[:, 0], y_mm=place[:, 1], z_mm=place[:, 2])

    def plot(self) -> Any:
        """A PyVista plotter with the layers in the base."""
        return space_scene(*((f"layer {each.index}", self.in_base(each.position_mm)) for each in self.layers))

    def in_base(self, position_mm: Float) -> Float:
        """Positions (k, 3) of the path, in the base."""
        pose = self.base_from_workobject
        return position_mm if pose is None else mapped(pose, position_mm)


@dataclass(frozen=True, slots=True, eq=False)
class PathGate(Gate):
    """The decision on one milling path: a program is written for this path only, and only if it passed."""

    toolpath: Toolpath = field(kw_only=True)
    tolerance_mm: float = field(kw_only=True)  # by which a program's moves may leave the path and the decision holds
    reached: bool = False  # postures were found for all points: reachable, inside limits, clear of collision
    loaded: bool = False  # it was held as the tool comes that gives way: what is predicted is allowed for


@dataclass(frozen=True, slots=True, eq=False)
class Postures:
    """How robot, cutter and turntable stand at n points of a path, travels included, in the order of motion.

    Travels have more points than the path's own. Turned with the cutter and the turntable, a point's frame is where
    the tool frame on the flange goes; the robot's base is the frame of all that follows, of one on a track at 0.
    """

    toolpath: Toolpath  # that they are for
    layer: Shaped[Int, " n"]  # index of the layer; 0: travel between layers
    cutting: Shaped[Bool, " n"]
    measured: Shaped[Bool, " n"]
    position_mm: Shaped[Float, "n 3"]  # of the turned frame
    quaternion_wxyz: Shaped[Float, "n 4"]
    feed_mm_s: Shaped[Float, " n"]  # towards the point, as the base sees it; on the workpiece it is the path's
    cutter_rotation: Shaped[Float, " n"]  # of the flange about the cutter's axis, rad
    turntable: Shaped[Float, "n ..."]  # of the external axis, rad; of a tilted turntable (n, 2): tilt, turntable
    joints: Shaped[Float, "n 6"]  # the controller's angles, rad
    displacement_mm: Shaped[Float, "n 3"]  # by which the cutter gives way
    clearance_mm: Shaped[Float, " n"]  # between bodies that must not touch; NaN: nothing could
    flange_from_point: Shaped[Float, "4 4"]  # the tool frame in the flange
    has_turntable: bool
    warnings: tuple[str, ...] = ()
    planned_turntable: Float | float = 0.0  # where it stood when the path was planned, rad
    on_track: bool = False  # what is said of the turntable is of a track, a millimetre as a degree
    torque_nm: Shaped[Float, " n"] | None = None  # that the cutter asks of the spindle; None: nobody tells
    spindle_rpm: float = math.nan

    @property
    def axes(self) -> Float:
        """(n, a) joint angles, then the external axes, rad."""
        return np.column_stack([self.joints, self.turntable])


@dataclass(frozen=True, slots=True, eq=False)
class PathDeflection:
    """By how much the tool is displaced at the points of a path's layers, in each point's own frame."""

    by_layer_mm: Mapping[int, Float]  # index of the layer -> (k, 3), in the order of its points
    turn_by_layer: Mapping[int, Float] = field(default_factory=dict)  # -> (k,) about the frame's y, rad; absent: none

    def at(self, layer: Layer) -> Float:
        """Displacement (k, 3) at a layer's points. Raises InputError where it is that of another path."""
        moved = self.by_layer_mm.get(layer.index)
        if moved is None or moved.shape != layer.position_mm.shape or not np.isfinite(moved).all():
            expected = f"a deflection for each of the {len(layer.position_mm)} points of layer {layer.index}"
            raise InputError("deflection", f"expected that of this path: {expected}")
        return moved


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """A path as a robot's controller runs it: k straight or circular moves, each to its target.

    The first target is where the robot starts.
    """

    position_mm: Shaped[Float, "k 3"]  # targets
    quaternion_wxyz: Shaped[Float, "k 4"]
    circular: Shaped[Bool, " k"]  # over `via`, else straight
    via_position_mm: Shaped[Float, "k 3"]  # NaN for straight moves
    via_quaternion_wxyz: Shaped[Float, "k 4"]  # NaN for straight moves
    feed_mm_s: Shaped[Float, " k"]
    cutting: Shaped[Bool, " k"]
    layer: Shaped[Int, " k"]  # index of the layer; 0: travel between layers
    toolpath: Toolpath  # that it was made from
    points_before: int  # of that path
    chord_tolerance_mm: float
    angle_tolerance_deg: float
    postures: Postures | None = None  # how the robot stands along that path; None: the controller chooses
    point: Shaped[Int, " k"] | None = None  # which of the postures' points each target is

    @property
    def joints_deg(self) -> Float | None:
        """The controller's joint angles (k, 6) at each target."""
        return None if self.postures is None else self.postures.joints[self.point] / DEG

    @property
    def on_track(self) -> bool:
        """Whether `turntable_deg` is of a track under the robot, in mm."""
        return self.postures is not None and self.postures.on_track

    @property
    def turntable_deg(self) -> Float | None:
        """Values of the external axis at each target (k,), deg, of a track mm; tilt and turntable (k, 2)."""
        if self.postures is None or not self.postures.has_turntable:
            return None
        return self.postures.turntable[self.point] / DEG

    @property
    def flange_from_point(self) -> Float | None:
        """The tool frame (4, 4) that the postures rest on; None: any."""
        return None if self.postures is None else self.postures.flange_from_point


@dataclass(frozen=True, slots=True, eq=False)
class LayerEngagement:
    """What the cutter meets in one layer, at the k points of that layer."""

    index: int  # of the layer
    arc_length_mm: Shaped[Float, " k"]
    # greatest depth of material before the cutter, normal to the layer's bevel face
    radial_depth_mm: Shaped[Float, " k"]
    axial_depth_mm: Shaped[Float, " k"]  # length of the cutter's axis along which it cuts
    chip_area_mm2: Shaped[Float, " k"]  # of the section that is removed, normal to the feed


@dataclass(frozen=True, slots=True, eq=False)
class Engagement:
    """Engagement of the cutter along a milling path, as milled in simulation."""

    layers: tuple[LayerEngagement, ...]
    warnings: tuple[str, ...] = ()
    part: Part = UNKNOWN_PART


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
    part: Part = UNKNOWN_PART


CANCELS = (
    "hand-eye pose, tool setting, tool radius and work object: both cuts and both scans share them",
    "the robot's error where it repeats along the same way, and its giving way under the same load",
    "the robot's error from scan to scan: root face and angle are taken from the edge in one scan",
)
NOT_INCLUDED = (
    "What the robot will not repeat in the finishing pass: it comes on top of the corrected cut.",
    "Wear of the cutter in the finishing pass itself.",
    "A shift along the bevel face: it leaves no trace in the cut, and changes neither root face nor angle.",
)


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Mean of what the first cuts of a batch's parts showed at k stations along the edge, NaN where nothing did."""

    parts: int
    arc_length_mm: Shaped[Float, " k"]
    shift_mm: Shaped[Float, " k"]  # along the bevel's outward normal, as measured
    turn: Shaped[Float, " k"]  # about the feed, rad
    shift_scatter_mm: float = math.nan  # standard deviation of a part about those before it; NaN: of one part alone
    turn_scatter: float = math.nan  # rad
    shared: Mapping[str, Any] = field(default_factory=dict)  # what its parts have in common, as the file says it

    def on(self, arc_length_mm: Float) -> Batch:
        """The same at other stations."""
        at, own = arc_length_mm, self.arc_length_mm
        shift, turn = (np.interp(at, own, mean, np.nan, np.nan) for mean in (self.shift_mm, self.turn))
        return replace(self, arc_length_mm=at, shift_mm=shift, turn=turn)


@dataclass(frozen=True, slots=True, eq=False)
class PathCorrection:
    """What a first cut tells of the pass that follows it, at k key points along the edge.

    The cut is displaced where it lies outside its plan, along the bevel's outward normal b at the root end of the face;
    a shift along the face leaves no trace and does no harm. The correction (VIM 2.53) is what the finishing pass is
    moved by: against the displacement, or by 0 where that is not significant.
    """

    arc_length_mm: Shaped[Float, " k"]  # of the lower edge, as planned
    cut: Shaped[Bool, " k"]  # the finishing pass cuts here
    displacement_mm: Shaped[Float, " k"]  # of the cut, along b, as estimated
    displacement_u_mm: Shaped[Float, " k"]
    turn: Shaped[Float, " k"]  # of the cut face about the feed: above 0 the bevel angle came out larger, rad
    turn_u: Shaped[Float, " k"]  # rad
    shift_mm: Shaped[Float, " k"]  # correction along b
    tilt: Shaped[Float, " k"]  # correction of the bevel angle, rad
    stock_mm: Shaped[Float, " k"]  # what the finishing pass will remove, the least along the face
    bevel: float  # rad
    length_mm: float  # of the edge, as planned
    allowance_mm: float
    repeatability_mm: float  # of the robot along b, that no measurement can foretell
    moved_mm: float  # by which the lower edge lies beside where the first scan saw it, along b
    variation_mm: float  # standard deviation of what repeats and is no constant error of the tool
    comes: PathDeflection  # how the tool comes beside the corrected path, by this measurement
    reason: str  # what was corrected, or why nothing was
    refused: str | None = None  # where and by how much the allowance does not allow it; None: it does
    batch: Batch | None = None  # of the parts so far, this one included unless it is refused
    checks: tuple[Check, ...] = ()
    warnings: tuple[str, ...] = ()
    part: Part = UNKNOWN_PART
