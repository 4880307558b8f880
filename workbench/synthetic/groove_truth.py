"""What a groove is, exactly: its sizes and corners at stations along its middle, as every simulator states them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import scipy

from workbench.synthetic.recipe import Strict
from workbench.units import Bool, Float, Shaped

PLACES = ("arc_length_mm", "position_mm", "tangent", "normal", "across")


@dataclass(frozen=True, slots=True, eq=False)
class Stations:
    """Places along an edge or a groove; arrays have one row per station."""

    closed: bool
    arc_length_mm: Shaped[Float, " n"]  # along the lower edge, or the groove's middle, from the part's start
    position_mm: Shaped[Float, "n 3"]  # lower edge, or the groove's middle, in the base
    tangent: Shaped[Float, "n 3"]  # t = m x n
    seen: Shaped[Bool, " n"]

    def at(self, position_mm: Float, values: Float) -> Float:
        """`values` (n, ...) of the stations, in the sections of base points (..., 3): linear between stations."""
        first, share = self._place(position_mm)
        return self._between(values, first, share)

    def arc_length_mm_at(self, position_mm: Float) -> Float:
        """Arc length (...,) of the sections of base points (..., 3), from the part's start."""
        return self.at(position_mm, self.arc_length_mm)

    def seen_at(self, position_mm: Float) -> Bool:
        """Whether the stations on both sides of each base point (..., 3) were seen."""
        first, share = self._place(position_mm)
        inside = (share > -1.0) & (share < 2.0)
        return np.asarray(self.seen[first] & self.seen[first + 1] & inside)

    def _place(self, position_mm: Float) -> tuple[Any, Float]:
        """Station before and share of the way to the next, of the sections of base points."""
        points = np.asarray(position_mm, dtype=float)
        index = np.clip(scipy.spatial.cKDTree(self.position_mm).query(points)[1], 0, len(self.position_mm) - 1)
        off = np.einsum("...i,...i->...", points - self.position_mm[index], self.tangent[index])
        first = np.clip(np.where(off < 0, index - 1, index), 0, len(self.position_mm) - 2)

        def height(at: Any) -> Float:
            return np.asarray(np.einsum("...i,...i->...", points - self.position_mm[at], self.tangent[at]))

        before, after = height(first), height(first + 1)
        return first, before / np.where(before == after, 1.0, before - after)

    def _between(self, values: Float, first: Any, share: Float) -> Float:
        share = share.reshape(share.shape + (1,) * (values.ndim - 1))
        return np.asarray(values[first] + share * (values[first + 1] - values[first]))


@dataclass(frozen=True, slots=True, eq=False)
class GrooveSizes:
    """The exact sizes at k stations; NaN where the type has none."""

    gap_mm: Float
    root_face_left_mm: Float
    root_face_right_mm: Float
    bevel_left_deg: Float
    bevel_right_deg: Float
    included_deg: Float
    depth_mm: Float
    width_mm: Float
    misalignment_mm: Float
    root_radius_mm: Float
    corners: dict[str, Float]  # name -> (k, 2) as (a, b)


SIZES = tuple(field.name for field in fields(GrooveSizes) if field.name != "corners")


@dataclass(frozen=True, slots=True, eq=False)
class GrooveTruth(Stations):
    """A groove as built, at stations along its middle, at the level of the left plate's lower surface."""

    recipe: Strict
    simulator: str
    type: str
    normal: Shaped[Float, "n 3"]  # across the groove, from the left plate to the right one
    across: Shaped[Float, "n 3"]  # up
    sizes: GrooveSizes  # (n,) each
    base_from_part: Shaped[Float, "4 4"]
    flange_from_profiler: Shaped[Float, "4 4"]  # true

    def document(self) -> dict[str, Any]:
        """The content of a truth file: strict JSON, null for what is not."""
        corners = {}
        for name, place in self.sizes.corners.items():
            base = self.position_mm + place[:, :1] * self.normal + place[:, 1:] * self.across
            corners[name] = {"section_mm": rounded(place), "position_mm": rounded(base)}
        return {
            "format": "groove-truth",
            "version": 1,
            "frame": "base",
            "simulator": self.simulator,
            "type": self.type,
            "closed": self.closed,
            **{name: rounded(getattr(self, name)) for name in PLACES},
            **{name: rounded(getattr(self.sizes, name)) for name in SIZES},
            "corners": corners,
            "seen": self.seen.tolist(),
            "base_from_part": self.base_from_part.tolist(),
            "flange_from_profiler": self.flange_from_profiler.tolist(),
            "recipe": self.recipe.model_dump(mode="json"),
        }


def rounded(values: Float) -> list[Any]:
    """As a truth file has numbers: to 1e-9, null for NaN."""
    if values.ndim == 2:
        return [[round(float(x), 9) for x in row] for row in values]
    return [None if np.isnan(x) else round(float(x), 9) for x in values]
