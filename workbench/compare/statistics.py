"""What many deviations say together: percentiles, sections, whether anything changed, what the robot's path leaves.

A robot that errs smoothly along its path moves every face of a stretch together: a shift d across the edge and a turn w
about it. With m = (d, w), a place i with normal n_i and lever l_i about the stretch's middle comes to lie off by

    r_i = f_i' m,    f_i = (n_i, l_i).

A change of one face does not move the others. So for places i, j of different faces

    E[r_i r_j] = f_i' S f_j,    S = E[m m'], 3 x 3 in the section,

linear in S, which the pairs of a stretch determine by least squares: wholly where it shows three faces, and where it
shows two as near to an even shift as they allow. Pairs of one face are left out: there a change and a motion are alike.
A part that is bent between two scans, or two faces that were milled again together, move in the same way and count so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from skimage.measure import label
from skimage.morphology import closing

from workbench.compare.surface_stage import Deviations
from workbench.units import DEG, Bool, Float, Int, Shaped

# Where something changed: adjoining places on the map, as regions with a size and a mean.

LEAST_PLACES = 4  # fewer beside each other may be chance
NEIGHBOURS = np.ones((3, 3), np.uint8)


class Region(NamedTuple):
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


def changed_regions(found: Deviations, changed: Bool, spacing_mm: float) -> tuple[Bool, tuple[Region, ...]]:
    """Changed places (c,) that lie beside others, and their regions by falling area.

    Regions are connected components of the changed cells of a grid of `spacing_mm` over the map. Gaps of one cell
    between places are closed first, as places are no regular grid. A few places alone are a streak of returns.
    """
    regions, kept = [], np.zeros(len(changed), bool)
    for sign in (1.0, -1.0):
        parts = _beside(found, changed & (sign * found.distance_mm > 0), spacing_mm)
        regions += [_region(found, part, spacing_mm) for part in parts]
        for part in parts:
            kept[part] = True
    return kept, tuple(sorted(regions, key=lambda region: -region.area_mm2))


def _beside(found: Deviations, which: Bool, spacing_mm: float) -> list[Int]:
    """Those of the places that lie beside enough others, as the places of each connected component."""
    mine = np.flatnonzero(which)
    if not mine.size:
        return []
    at = np.stack([found.arc_length_mm[mine], found.across_mm[mine]], axis=1)
    cell = np.floor((at - at.min(axis=0)) / spacing_mm).astype(np.int64) + 1
    filled = np.zeros(cell.max(axis=0) + 2, np.uint8)
    filled[tuple(cell.T)] = 1
    numbered = label(closing(filled, NEIGHBOURS), connectivity=2)  # type: ignore[no-untyped-call]
    owner = np.asarray(numbered[tuple(cell.T)], np.int64)
    return [mine[owner == k] for k in np.flatnonzero(np.bincount(owner) >= LEAST_PLACES)]


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


PERCENTILES = (1, 5, 25, 50, 75, 95, 99)
FALSE_DISCOVERIES = 0.05
BINS = 60


@dataclass(frozen=True, slots=True)
class SectionDeviation:
    """Deviations near one section; NaN: none was compared."""

    index: int  # from 1
    arc_length_mm: float
    places: int
    mean_mm: float
    least_mm: float
    most_mm: float
    detectable_mm: float  # median level of detection of a place
    significant: float  # share of places


class Summary(NamedTuple):
    """Of all places that were compared."""

    compared: int
    beyond: int  # places beside others that lie further off than was searched
    mean_mm: float
    rms_mm: float
    percentiles_mm: dict[int, float]
    significant: float  # share of places beyond their own level of detection: about 0.05 where nothing changed
    changed: Shaped[Bool, " c"]  # changed beside others that did, with 5 % false discoveries among these
    regions: tuple[Region, ...]  # of these, the largest first
    detectable_mm: float  # median level of detection
    sections: tuple[SectionDeviation, ...]
    counts: Shaped[Float, " b"]  # of the histogram
    edges_mm: Float  # (b + 1,)
    along: str  # what arc length counts along
    what: str  # a change since another scan, or a deviation from a mesh or a plan

    @property
    def is_changed(self) -> bool:
        """Whether anything changed, or lies too far off to be measured."""
        return bool(self.changed.any() or self.beyond)

    @property
    def in_words(self) -> str:
        """The finding, one line."""
        if not self.is_changed:
            limit = f"{self.detectable_mm:.3f} mm would be detected (95 %)"
            return f"No significant {self.what} at {self.compared} places; {limit}"
        more = f"; {self.beyond} more places lie further off than depth_mm" if self.beyond else ""
        many = f"{int(self.changed.sum())} of {self.compared}"
        return (
            f"Significant {self.what} at {many} places; mean {self.mean_mm:+.3f} mm, "
            f"from {self.percentiles_mm[1]:+.3f} to {self.percentiles_mm[99]:+.3f} mm (1 % to 99 %){more}"
        )


def summarise(
    found: Deviations, sections: int, half_width_mm: float, along: str, what: str, spacing_mm: float
) -> Summary:
    """The summary of deviations at places `spacing_mm` apart, by `sections` along the part."""
    seen = np.isfinite(found.distance_mm)
    values = found.distance_mm[seen]
    if not len(values):
        values = np.array([math.nan])
    new, regions = changed_regions(found, changed(found.distance_mm, found.u_mm), spacing_mm)
    counts, edges = np.histogram(values, bins=BINS, range=_range(values))
    return Summary(
        int(seen.sum()),
        sum(len(part) for part in _beside(found, found.is_beyond, spacing_mm)),
        float(values.mean()),
        float(np.sqrt(np.mean(values**2))),
        {k: float(np.percentile(values, k)) for k in PERCENTILES},
        _share(found.significant[seen]),
        new,
        regions,
        median(found.detectable_mm[seen]),
        _sections(found, seen, sections, half_width_mm),
        counts.astype(float),
        edges,
        along,
        what,
    )


def changed(distance_mm: Float, u_mm: Float) -> Bool:
    """(c,) places of significant change, at most 5 % of them false on average.

    Benjamini and Hochberg (J. R. Stat. Soc. B 57, 1995): two-sided p values.
    """
    seen = np.isfinite(distance_mm) & (u_mm > 0)
    p = scipy.special.erfc(np.abs(distance_mm[seen]) / u_mm[seen] / math.sqrt(2.0))
    found = np.zeros(len(seen), bool)
    if len(p):
        found[seen] = scipy.stats.false_discovery_control(p) <= FALSE_DISCOVERIES
    return found


def _sections(found: Deviations, seen: Bool, count: int, half_width_mm: float) -> tuple[SectionDeviation, ...]:
    """Section i lies at (i - 1/2)/n of the stretch that was compared."""
    arc = found.arc_length_mm
    low, high = (float(arc[seen].min()), float(arc[seen].max())) if seen.any() else (0.0, 0.0)
    rows = []
    for k in range(count):
        at = low + (k + 0.5) / count * (high - low)
        mine = seen & (np.abs(arc - at) <= half_width_mm)
        values = found.distance_mm[mine] if mine.any() else np.array([math.nan])
        rows.append(
            SectionDeviation(
                k + 1,
                at,
                int(mine.sum()),
                float(values.mean()),
                float(values.min()),
                float(values.max()),
                median(found.detectable_mm[mine]),
                _share(found.significant[mine]),
            )
        )
    return tuple(rows)


def median(values: Float) -> float:
    """NaN of none."""
    return float(np.median(values)) if len(values) else math.nan


def _share(flags: Bool) -> float:
    return float(flags.mean()) if len(flags) else math.nan


def _range(values: Float) -> tuple[float, float]:
    """From the 0.5th to the 99.5th percentile and a little beyond, 0 inside."""
    low, high = (float(x) for x in np.nan_to_num(np.percentile(values, [0.5, 99.5])))
    low, high = min(low, 0.0), max(high, 0.0)
    room = max(0.1 * (high - low), 1e-4)
    return low - room, high + room


STRETCH_MM = 4.0  # as far as places are taken to share a motion: that of `compare.register`
ONE_FACE_DEG = 15.0  # normals less apart may belong to one face
MOST_PLACES = 300  # of a stretch that are paired: 45,000 pairs
LEAST_STRETCHES = 3  # that show two faces: below, nothing is known of the path
DETERMINED = 0.05  # least singular value of what the pairs tell of S, of the greatest


def path_error_u(
    position_mm: Shaped[Float, "c 3"],
    distance_mm: Shaped[Float, " c"],
    normal: Shaped[Float, "c 3"],
    arc_length_mm: Shaped[Float, " c"],
) -> Float | None:
    """Standard uncertainty (c,), mm, of a scan along its places' normals by its path; None: one face tells nothing.

    At every place the larger of what its stretch shows and of the mean shift over all stretches.

    Args:
        position_mm: (c, 3) of places.
        distance_mm: (c,) of a registered scan from the reference there, NaN where there is none.
        normal: (c, 3) unit.
        arc_length_mm: (c,) along the part.
    """
    stretch = np.floor(arc_length_mm / STRETCH_MM)
    variance = np.full(len(distance_mm), np.nan)
    shifts = []
    for k in np.unique(stretch[np.isfinite(stretch)]):
        mine = np.flatnonzero(stretch == k)
        seen = np.flatnonzero(np.isfinite(distance_mm[mine]))
        seen = seen[:: -(-len(seen) // MOST_PLACES) or 1]
        pairs = _of_two_faces(normal[mine[seen]])
        if pairs is not None:
            f = _in_section(position_mm[mine], normal[mine])
            shared = _shared(f[seen], distance_mm[mine[seen]], *pairs)
            variance[mine] = ((f @ shared) * f).sum(axis=1)
            shifts.append(0.5 * float(np.trace(shared[:2, :2])))
    if len(shifts) < LEAST_STRETCHES:
        return None
    return np.asarray(np.sqrt(np.fmax(variance, float(np.mean(shifts)))))


def _of_two_faces(normal: Float) -> tuple[Int, Int] | None:
    """Pairs of places whose faces differ; None: no second face, or none but at a right angle."""
    cosine = normal @ normal.T
    first, second = np.nonzero(np.triu(np.abs(cosine) < math.cos(ONE_FACE_DEG * DEG)))
    enough = len(first) > len(normal) and float((cosine[first, second] ** 2).mean()) > DETERMINED
    return (first, second) if enough else None


def _in_section(position_mm: Float, normal: Float) -> Float:
    """f (c, 3) of places: the normal in the plane of all normals, and the lever about their middle by its rms."""
    along, *plane = np.linalg.eigh(normal.T @ normal)[1].T  # all normals stand square to the edge
    lever = np.cross(position_mm - position_mm.mean(axis=0), normal) @ along
    return np.column_stack([*(normal @ axis for axis in plane), lever / max(float(np.sqrt((lever**2).mean())), 1e-9)])


def _shared(f: Float, distance_mm: Float, first: Int, second: Int) -> Float:
    """S (3, 3), mm^2, of one stretch by its pairs of places."""
    a, b = f[first], f[second]
    squares = a * b
    mixed = np.stack([a[:, i] * b[:, j] + a[:, j] * b[:, i] for i, j in ((0, 1), (0, 2), (1, 2))], axis=1)
    rows = np.hstack([squares, mixed])
    product = distance_mm[first] * distance_mm[second]
    even = squares[:, 0] + squares[:, 1]  # of a shift alike in all directions
    level = max(float(even @ product) / float(even @ even), 0.0)
    x, y, turn, xy, x_turn, y_turn = np.linalg.lstsq(rows, product - level * even, rcond=DETERMINED)[0]
    found = np.array([[level + x, xy, x_turn], [xy, level + y, y_turn], [x_turn, y_turn, turn]])
    size, axes = np.linalg.eigh(found)
    return np.asarray((axes * np.maximum(size, 0.0)) @ axes.T)
