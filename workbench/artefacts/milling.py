"""What the cutter met on its way, and what is left to do."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.artefacts.paths import Toolpath
from workbench.units import Float


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
