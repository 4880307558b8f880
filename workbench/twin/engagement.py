"""What the cutter met: radial and axial depth and chip area along a layer, and where it met what it should not."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Layer, LayerEngagement
from workbench.units import Bool, Float

_SPARE_MM = 0.1  # a lead or a ramp may take the depth of cut and this much more
_MET_MM = 0.02  # less is not met in the air
_FAR_MM = 1e6
_AT_ONCE = 2.0  # a layer that takes more than so many depths of cut is no layer


def engage(layer: Layer, u_at_points: Float, u: Float, removed_mm: Float, w_step_mm: float) -> LayerEngagement:
    """Engagement at a layer's k points from the depths (U, W) that it removed, lines `w_step_mm` apart.

    Depths are signed: below 0 the cutter passed that much above the material. `u_at_points` (k,), `u` (U,).
    """
    length, area = _positive_part(removed_mm, w_step_mm)
    radial = np.maximum(removed_mm.max(axis=1), 0.0)
    along = (np.interp(u_at_points, u, value, left=0.0, right=0.0) for value in (radial, length, area))
    return LayerEngagement(layer.index, layer.arc_length_mm, *along)


def _positive_part(depth: Float, step: float) -> tuple[Float, Float]:
    """Length over which piecewise linear depths (U, W) are above 0, and the area there."""
    depth = np.maximum(depth, -_FAR_MM)  # lines beside the part miss it by an infinite depth
    a, b = depth[:, :-1], depth[:, 1:]
    high, low = np.maximum(np.maximum(a, b), 0.0), np.minimum(a, b)
    share = np.where(low >= 0.0, high > 0.0, high / (high - np.minimum(low, -1e-12)))
    area = 0.5 * share * (high + np.maximum(low, 0.0))
    return step * share.sum(axis=1), step * area.sum(axis=1)


def travel_warnings(name: str, depth_mm: Float, arc_length_mm: Float) -> list[str]:
    """What to say of material that a travel met: depths (U,) at arc lengths (U,)."""
    worst = int(np.argmax(depth_mm))
    return [_met(name, depth_mm[worst], arc_length_mm[worst])] if depth_mm[worst] > _MET_MM else []


def layer_warnings(layer: Layer, idle_mm: Float, taken_mm: Float, beside: Bool, arc_length_mm: Float,
                   depth_of_cut_mm: float) -> list[str]:  # fmt: skip
    """What to say of a layer: material met by pieces that do not cut, and cuts far deeper than planned.

    Args:
        layer: the layer.
        idle_mm: (U,) depth that pieces removed which do not cut.
        taken_mm: (U,) depth that the whole layer removed.
        beside: (U,) within reach of a piece that cuts: there it does not count which piece came first.
        arc_length_mm: (U,)
        depth_of_cut_mm: as planned.
    """
    warnings, alone = [], np.where(beside, 0.0, idle_mm)
    worst, deepest = int(np.argmax(alone)), int(np.argmax(taken_mm))
    if alone[worst] > depth_of_cut_mm + _SPARE_MM:
        warnings.append(_met(f"layer {layer.index}", alone[worst], arc_length_mm[worst]))
    if taken_mm[deepest] > _AT_ONCE * depth_of_cut_mm:
        warnings.append(
            f"layer {layer.index}: the cutter takes {taken_mm[deepest]:.2f} mm at once at arc length "
            f"{arc_length_mm[deepest]:.1f} mm; the depth of cut is {depth_of_cut_mm:g} mm"
        )
    return warnings


def _met(name: str, depth: float, place: float) -> str:
    return (f"{name}: the cutter meets material where the path does not cut, {depth:.2f} mm deep at arc length "
            f"{place:.1f} mm")  # fmt: skip
