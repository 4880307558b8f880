"""What a milling run has to say: where the cutter met what the path did not mean to cut."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Layer
from workbench.twin.machine import Met
from workbench.units import Bool, Float

_SPARE_MM = 0.1  # a lead or a ramp may take the depth of cut and this much more
_MET_MM = 0.02  # less is not met in the air
_AT_ONCE = 2.0  # a layer that takes more than so many depths of cut is no layer


class Watch:
    """Warnings about one layer and the travel to it, with their places as arc lengths of that layer."""

    def __init__(self, layer: Layer, u_at_points: Float, u: Float, radius_mm: float, depth_of_cut_mm: float) -> None:
        """`u_at_points` (k,) of the layer's points, `u` (U,) of the columns that depths are counted on."""
        order = np.argsort(u_at_points)
        self._u, self._at, self._arc_length_mm = u, u_at_points[order], layer.arc_length_mm[order]
        self._name, self._depth_of_cut_mm = f"layer {layer.index}", depth_of_cut_mm
        self._cuts = bool(layer.cutting.any())
        self._beside = _within(u, self._at[layer.cutting[order]], radius_mm)

    def travel(self, name: str, met: Met) -> list[str]:
        """A travel must not meet anything."""
        found = self._met(name, met.depth_mm, _MET_MM)
        return found + self._hits(name, met)

    def layer(self, met: Met, taken_mm: Float) -> list[str]:
        """A layer's leads and ramps take no more than a layer does; all of it took `taken_mm` (U,).

        Within a cutter's radius of a point that cuts it does not count which piece of the path came first.
        """
        found = self._met(self._name, np.where(self._beside, 0.0, met.depth_mm), self._depth_of_cut_mm + _SPARE_MM)
        worst = int(np.argmax(taken_mm))
        deepest, planned = taken_mm[worst], self._depth_of_cut_mm
        if self._cuts and deepest < _MET_MM:
            found.append(f"{self._name}: the cutter meets nothing")
        if deepest > _AT_ONCE * planned:
            found.append(
                f"{self._name}: the cutter takes {deepest:.2f} mm at once "
                f"{self._place(self._u[worst])}; the depth of cut is {planned:g} mm"
            )
        return found + self._hits(self._name, met)

    def _met(self, name: str, depth_mm: Float, allowed_mm: float) -> list[str]:
        worst = int(np.argmax(depth_mm))
        if depth_mm[worst] <= allowed_mm:
            return []
        return [
            f"{name}: the cutter meets material where the path does not cut, {depth_mm[worst]:.2f} mm deep "
            f"{self._place(self._u[worst])}"
        ]

    def _hits(self, name: str, met: Met) -> list[str]:
        return [
            f"{name}: the cutter runs {hit.depth_mm:.2f} mm into {hit.what} {self._place(hit.u)}" for hit in met.hits
        ]

    def _place(self, u: float) -> str:
        return f"at arc length {np.interp(u, self._at, self._arc_length_mm):.1f} mm"


def _within(u: Float, places: Float, reach: float) -> Bool:
    """Whether each u (U,) is within `reach` of one of the `places` (p,), ascending."""
    padded = np.concatenate([[-np.inf], places, [np.inf]])
    after = np.searchsorted(padded, u)
    return np.asarray(np.minimum(u - padded[after - 1], padded[after] - u) <= reach)
