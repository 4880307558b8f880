"""What the cutter met on its way, and what is left to do."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.artefacts.evidence import UNKNOWN_PART, Check, Part
from workbench.artefacts.paths import PathDeflection, Toolpath
from workbench.units import Bool, Float, Shaped


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
    checks: tuple[Check, ...] = ()
    warnings: tuple[str, ...] = ()
    part: Part = UNKNOWN_PART
