"""Where something changed: places that hang together on the map, as regions with a size and a mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from skimage.measure import label
from skimage.morphology import closing

from workbench.compare.surface_values import Deviations
from workbench.units import Bool, Int

LEAST_PLACES = 4  # fewer beside each other may be chance
NEIGHBOURS = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, slots=True)
class Region:
    """Places of change with one sign that lie beside each other on the map."""

    places: int
    area_mm2: float
    from_mm: float  # arc length
    to_mm: float
    across_from_mm: float
    across_to_mm: float
    mean_mm: float
    u_mm: float  # of the mean, errors taken as common to all its places
    extreme_mm: float  # the distance furthest from 0


def changed_regions(found: Deviations, changed: Bool, spacing_mm: float) -> tuple[Region, ...]:
    """Regions by falling area: connected components of the changed cells of a grid of `spacing_mm` over the map.

    Gaps of one cell between places are closed first, as places are no regular grid.
    """
    regions = []
    for sign in (1.0, -1.0):
        mine = np.flatnonzero(changed & (sign * found.distance_mm > 0))
        if mine.size:
            owner = _labels(found, mine, spacing_mm)
            regions += [_region(found, mine[owner == k], spacing_mm) for k in range(1, owner.max() + 1)]
    kept = [region for region in regions if region.places >= LEAST_PLACES]
    return tuple(sorted(kept, key=lambda region: -region.area_mm2))


def _labels(found: Deviations, mine: Int, spacing_mm: float) -> Int:
    """Number of the component that each of these places belongs to."""
    at = np.stack([found.arc_length_mm[mine], found.across_mm[mine]], axis=1)
    cell = np.floor((at - at.min(axis=0)) / spacing_mm).astype(np.int64) + 1
    filled = np.zeros(cell.max(axis=0) + 2, np.uint8)
    filled[tuple(cell.T)] = 1
    numbered = label(closing(filled, NEIGHBOURS), connectivity=2)  # type: ignore[no-untyped-call]
    return np.asarray(numbered[tuple(cell.T)], np.int64)


def _region(found: Deviations, places: Int, spacing_mm: float) -> Region:
    arc, across, distance = found.arc_length_mm[places], found.across_mm[places], found.distance_mm[places]
    return Region(
        len(places),
        len(places) * spacing_mm**2,
        float(arc.min()),
        float(arc.max()),
        float(across.min()),
        float(across.max()),
        float(distance.mean()),
        float(found.u_mm[places].mean()),
        float(distance[np.abs(distance).argmax()]),
    )
