"""Plates that are no plain bevel and no raw edge, by outside.py.

Each is given to `edge.segment` as a bevel and to `edge.segment_raw` as a raw edge. What is not refused must be right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from bench.outside import FAR_MM, Part, Section, between, simulate
from workbench.units import DEG, Float

Corners = tuple[tuple[float, float], ...]
Lines = tuple[Corners, ...]
Rng = np.random.Generator
Draw = Callable[[Rng, bool], Section]  # whether it is scanned as a raw edge


@dataclass(frozen=True, slots=True)
class Drawn(Section):
    """A section that is the same all along: chains of corners, (u, v)."""

    lines: Lines = ()
    chamfer_mm: float = 0.0  # height of a chamfer that takes the lower edge off

    def segments(self, w: Float) -> Float:
        table = () if self.table_mm is None else (((2 * FAR_MM, -self.table_mm), (-FAR_MM, -self.table_mm)),)
        pieces = np.array([[*one, *two] for line in (*self.lines, *table) for one, two in pairwise(line)])
        return np.broadcast_to(pieces, (len(w), len(pieces), 4))


def plate(root_mm: float, above: Corners, below: Corners = ((0.0, 0.0), (-FAR_MM, 0.0))) -> Corners:
    """A plate whose end goes up from (0, root_mm) through the corners `above`, from there on, and down `below`."""
    up = [(u, root_mm + v) for u, v in above]
    return ((up[-1][0] - FAR_MM, up[-1][1]), *reversed(up), (0.0, root_mm), *below)


class Sizes(NamedTuple):
    """Of a plain plate, bevelled or raw."""

    root_mm: float
    bevel: float  # rad
    thick_mm: float
    table_mm: float | None

    def above(self) -> Corners:
        height = self.thick_mm - self.root_mm
        return ((-np.tan(self.bevel) * height, height),)

    def drawn(self, lines: Lines, chamfer_mm: float = 0.0) -> Drawn:
        return Drawn(self.root_mm, 0.0, self.bevel, self.thick_mm, 0.0, self.table_mm, lines, chamfer_mm)


def drawn_above(root_mm: float, bevel: float, corners: Corners, table_mm: float | None = None) -> Drawn:
    """A plate whose root face goes on through `corners` from its upper end on; bevel: what is said of it, rad."""
    return Sizes(root_mm, bevel, root_mm + corners[-1][1], table_mm).drawn((plate(root_mm, corners),))


def plain(rng: Rng, is_raw: bool) -> Sizes:
    """Sizes of a plate; a raw one's end face is as high as the plate."""
    root, bevel, height = rng.uniform(0.8, 3.0), rng.uniform(25.0, 55.0), rng.uniform(3.0, 8.0)
    table = None if rng.random() < 0.5 else rng.uniform(4.0, 30.0)
    thick = rng.uniform(4.0, 12.0) if is_raw else root + height
    return Sizes(thick - 1e-3, np.pi / 4.0, thick, table) if is_raw else Sizes(root, bevel * DEG, thick, table)


def _deburred(rng: Rng, sizes: Sizes) -> Section:
    """The lower edge chamfered by 0.05 to 0.5 mm."""
    turn = rng.uniform(25.0, 65.0) * DEG
    chamfer = min(between(rng, 0.05, 0.5), 0.4 * sizes.root_mm)
    below = ((0.0, chamfer), (-chamfer * np.tan(turn), 0.0), (-FAR_MM, 0.0))
    return sizes.drawn((plate(sizes.root_mm, sizes.above(), below),), chamfer)


def _double_bevel(rng: Rng, sizes: Sizes) -> Section:
    """A further bevel under the face, which shallow rays see."""
    turn, height = rng.uniform(20.0, 60.0) * DEG, rng.uniform(1.5, 5.0)
    below = ((0.0, 0.0), (-height * np.tan(turn), -height), (-FAR_MM, -height))
    table = None if sizes.table_mm is None else sizes.table_mm + height
    return sizes._replace(table_mm=table).drawn((plate(sizes.root_mm, sizes.above(), below),))


def _rail(rng: Rng, sizes: Sizes) -> Section:
    """A rail of a fixture in front of it, whose shadow may end the face."""
    gap, width = rng.uniform(0.3, 8.0), rng.uniform(3.0, 40.0)
    height, lean = rng.uniform(-0.5, 1.0) * sizes.root_mm, rng.choice([0.0, rng.uniform(0.2, 2.5)])
    near = gap + lean * (height + 2.0)
    rail = ((gap, -FAR_MM), (gap, -2.0), (near, height), (near + width, height), (near + width, -FAR_MM))
    return sizes.drawn((plate(sizes.root_mm, sizes.above()), rail))


def _on_table(rng: Rng, sizes: Sizes) -> Section:
    """A plate on a table, or close above it."""
    sizes = sizes._replace(table_mm=float(rng.choice([0.0, between(rng, 0.05, 3.0)])))
    return sizes.drawn((plate(sizes.root_mm, sizes.above()),))


def _rounded(rng: Rng, sizes: Sizes) -> Section:
    """A rounding larger than any that the view may hide by default."""
    radius = min(between(rng, 0.15, 1.2), 0.45 * sizes.root_mm)
    return Section(sizes.root_mm, 0.0, sizes.bevel, sizes.thick_mm, radius, sizes.table_mm)


def _undercut(rng: Rng, sizes: Sizes) -> Section:
    """The lower part of the root face stands back, as a second cut leaves it."""
    back, from_mm = between(rng, 0.05, 0.6), rng.uniform(0.2, 0.6) * sizes.root_mm
    below = ((0.0, from_mm), (-back, from_mm), (-back, 0.0), (-FAR_MM, 0.0))
    return sizes.drawn((plate(sizes.root_mm, sizes.above(), below),))


def _near_table(rng: Rng, sizes: Sizes) -> Section:
    """A plate on a table, or on what lifts it a little; its lower edge rounded."""
    radius = float(rng.choice([0.0, min(between(rng, 0.05, 0.5), 0.45 * sizes.root_mm)]))
    gap = float(rng.choice([0.0, between(rng, 0.02, 0.8)]))
    return Section(sizes.root_mm, 0.0, sizes.bevel, sizes.thick_mm, radius, gap)


def compound(lower_deg: float, upper_deg: float, share: float, height_mm: float) -> Corners:
    """Two bevel faces, parted at this share of their height."""
    low, high = np.tan(np.radians([lower_deg, upper_deg])) * height_mm * [share, 1.0 - share]
    return ((-low, share * height_mm), (-low - high, height_mm))


def ledge(land_mm: float, bevel_deg: float, height_mm: float) -> Corners:
    """A land between root face and bevel; one of some millimetres makes the root face a nose."""
    return ((-land_mm, 0.0), (-land_mm - height_mm * np.tan(np.radians(bevel_deg)), height_mm))


def j_shape(radius_mm: float, bevel_deg: float, land_mm: float, height_mm: float) -> Corners:
    """A land, a quarter of a circle or less, and a face."""
    turn = np.linspace(0.0, np.radians(90.0 - bevel_deg), 24)[1:]
    arc = [(-land_mm - radius_mm * np.sin(t), radius_mm * (1.0 - np.cos(t))) for t in turn]
    rest = height_mm - arc[-1][1]
    return ((-land_mm - 1e-6, 0.0), *arc, (arc[-1][0] - rest * np.tan(np.radians(bevel_deg)), height_mm))


def _compound(rng: Rng, bevel_deg: float, height_mm: float) -> Corners:
    other = bevel_deg + rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 40.0)
    return compound(bevel_deg, float(np.clip(other, 2.0, 75.0)), rng.uniform(0.15, 0.85), height_mm)


def _step(rng: Rng, _: float, height_mm: float) -> Corners:
    """An end face whose upper part stands back, or out."""
    back = rng.uniform(0.15, 0.9) * rng.choice([-1.0, 1.0])
    return ((-back, 0.0), (-back, height_mm))


def _ledge(rng: Rng, bevel_deg: float, height_mm: float) -> Corners:
    return ledge(rng.uniform(0.05, 0.5), bevel_deg, height_mm)


def _around(surround: Callable[[Rng, Sizes], Section]) -> Draw:
    """Of a plain plate."""
    return lambda rng, is_raw: surround(rng, plain(rng, is_raw))


def _above(shape: Callable[[Rng, float, float], Corners]) -> Draw:
    """What stands on the root face, by bevel angle, deg, and height."""

    def draw(rng: Rng, _: bool) -> Section:
        root, bevel, height = rng.uniform(0.8, 3.0), rng.uniform(25.0, 55.0), rng.uniform(3.0, 8.0)
        table = None if rng.random() < 0.5 else rng.uniform(4.0, 30.0)
        return drawn_above(root, bevel * DEG, shape(rng, bevel, height), table)

    return draw


DEBURRED = "chamfered lower edge"
SHAPES: dict[str, tuple[tuple[int, ...], Draw]] = {  # with the words of its random numbers
    DEBURRED: ((780,), _around(_deburred)),
    "a bevel below as well": ((781, 0), _around(_double_bevel)),
    "a rail in front": ((781, 2), _around(_rail)),
    "on a table, or up to 3 mm above": ((781, 3), _around(_on_table)),
    "lower edge rounded by 0.15 to 1.2 mm": ((781, 4), _around(_rounded)),
    "lower part of the root face stands back": ((781, 5), _around(_undercut)),
    "on a table, lower edge rounded": ((781, 6), _around(_near_table)),
    "compound bevel": ((779, 0), _above(_compound)),
    "ledge of 0.05 to 0.5 mm": ((779, 2), _above(_ledge)),
    "step of 0.15 to 0.9 mm": ((779, 4), _above(_step)),
}


def odd_plate(shape: str, seed: int, is_raw: bool) -> Part:
    """Part `seed` of one of SHAPES; is_raw: scanned as raw edges are, which shows less of what lies above."""
    (stream, *number), draw = SHAPES[shape]
    return simulate(seed, is_raw, draw(np.random.default_rng([stream, seed, *number]), is_raw))
