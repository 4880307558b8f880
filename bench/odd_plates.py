"""`python -m bench.odd_plates --parts 40 --seed 0`: plates that are no plain bevel and no raw edge, by outside.py.

Each is given to `edge.segment` as a bevel and to `edge.segment_raw` as a raw edge. What is not refused must be right.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bench.outside import BEYOND, FAR_MM, Errors, Part, Section, inspected, planned, simulate
from workbench.errors import WorkbenchError
from workbench.units import DEG, Float

Corners = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Chain(Section):
    """A plate whose root face goes on through `corners`, (u, v) from its upper end on, to the plate's surface."""

    corners: Corners = ()

    def segments(self, w: Float) -> Float:
        pieces = Section.segments(self, w)
        above = [(u, self.root_mm + v) for u, v in self.corners]
        points = [(0.0, self.root_mm), *above, (above[-1][0] - FAR_MM, above[-1][1])]
        faces = np.array([[*after, *before] for before, after in pairwise(points)])
        return np.concatenate([np.broadcast_to(faces, (len(w), len(faces), 4)), pieces[:, 2:]], axis=1)


@dataclass(frozen=True, slots=True)
class Deburred(Section):
    """A plate whose lower edge is chamfered: the rays see all of the chamfer, some of it, or none."""

    chamfer_mm: float = 0.0  # height
    turn: float = 0.0  # from the face, rad

    def segments(self, w: Float) -> Float:
        pieces = Section.segments(self, w)  # upper surface, bevel, root face, lower surface, table
        back = -self.chamfer_mm * np.tan(self.turn)
        pieces[:, 2, 3], pieces[:, 3, 0] = self.chamfer_mm, back
        chamfer = np.broadcast_to(np.array([0.0, self.chamfer_mm, back, 0.0]), (len(w), 1, 4))
        return np.concatenate([pieces[:, :3], chamfer, pieces[:, 3:]], axis=1)


def deburred_plate(seed: int, is_raw: bool) -> Part:
    """Part `seed` with a chamfer of 0.05 to 0.5 mm."""
    rng = np.random.default_rng([780, seed])
    root, bevel, height = rng.uniform(0.8, 3.0), rng.uniform(25.0, 55.0), rng.uniform(3.0, 8.0)
    table = None if rng.random() < 0.5 else rng.uniform(4.0, 30.0)
    thick, turn = rng.uniform(4.0, 12.0) if is_raw else root + height, rng.uniform(25.0, 65.0) * DEG
    chamfer = min(float(np.exp(rng.uniform(np.log(0.05), np.log(0.5)))), 0.4 * root)
    sizes = (thick - 1e-3, 0.0, np.pi / 4.0) if is_raw else (root, 0.0, bevel * DEG)
    return simulate(seed, is_raw, Deburred(*sizes, thick, 0.0, table, chamfer, turn))


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


def _compound(rng: np.random.Generator, bevel_deg: float, height_mm: float) -> Corners:
    other = bevel_deg + rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 40.0)
    return compound(bevel_deg, float(np.clip(other, 2.0, 75.0)), rng.uniform(0.15, 0.85), height_mm)


def _j_shape(rng: np.random.Generator, _: float, height_mm: float) -> Corners:
    return j_shape(
        min(rng.uniform(2.0, 5.0), 0.95 * height_mm), rng.uniform(0.0, 20.0), rng.uniform(0.0, 2.0), height_mm
    )


def _step(rng: np.random.Generator, _: float, height_mm: float) -> Corners:
    """An end face whose upper part stands back, or out."""
    back = rng.uniform(0.15, 0.9) * rng.choice([-1.0, 1.0])
    return ((-back, 0.0), (-back, height_mm))


SHAPES: dict[str, Callable[[np.random.Generator, float, float], Corners]] = {
    "compound bevel": _compound,
    "nose of 0.5 to 3 mm": lambda rng, bevel_deg, height_mm: ledge(rng.uniform(0.5, 3.0), bevel_deg, height_mm),
    "ledge of 0.05 to 0.5 mm": lambda rng, bevel_deg, height_mm: ledge(rng.uniform(0.05, 0.5), bevel_deg, height_mm),
    "J": _j_shape,
    "step of 0.15 to 0.9 mm": _step,
}


DEBURRED = "chamfered lower edge"


def odd_plate(shape: str, seed: int, is_raw: bool) -> Part:
    """Part `seed` of one of SHAPES; is_raw: scanned as raw edges are, which shows less of what lies above."""
    if shape == DEBURRED:
        return deburred_plate(seed, is_raw)
    rng = np.random.default_rng([779, seed, list(SHAPES).index(shape)])
    root, bevel, height = rng.uniform(0.8, 3.0), rng.uniform(25.0, 55.0), rng.uniform(3.0, 8.0)
    table = None if rng.random() < 0.5 else rng.uniform(4.0, 30.0)
    corners = SHAPES[shape](rng, bevel, height)
    return simulate(seed, is_raw, Chain(root, 0.0, bevel * DEG, root + height, 0.0, table, corners))


def judged(shape: str, seeds: range, is_raw: bool) -> tuple[int, int, list[str]]:
    """How many parts were refused and how many right within BEYOND u; the wrong ones, told.

    Of a chamfered lower edge the size to the virtual sharp edge is right, and that to where the chamfer begins.
    """
    refused, right, wrong = 0, 0, []
    for seed in seeds:
        part = odd_plate(shape, seed, is_raw)
        try:
            found = (planned if is_raw else inspected)(part)
        except WorkbenchError:
            refused += 1
            continue
        if isinstance(part.section, Deburred):
            found = _to_either_end(found, part.section.chamfer_mm)
        off = [f"{q} {np.abs(e).max():.3f} at {(np.abs(e) / u).max():.1f} u" for q, (e, u) in found.items() if e.size]
        worst = max((float((np.abs(e) / u).max()) for e, u in found.values() if e.size), default=0.0)
        if worst <= BEYOND:
            right += 1
        else:
            wrong.append(f"{shape} {seed} as {'raw edge' if is_raw else 'bevel'}: {', '.join(off)}")
    return refused, right, wrong


def _to_either_end(found: Errors, chamfer_mm: float) -> Errors:
    """Errors of sizes to the virtual sharp edge or, where that is nearer in all, to where the chamfer begins."""
    out = dict(found)
    for name, land in (("root, mm", chamfer_mm), ("along m, mm", -chamfer_mm)):
        if name in found:
            e, u = found[name]
            out[name] = min(((e, u), (e + land, u)), key=lambda one: float((np.abs(one[0]) / one[1]).max(initial=0.0)))
    return out


def main() -> None:
    """Simulate, measure, and print a table."""
    parser = argparse.ArgumentParser(prog="python -m bench.odd_plates", description=__doc__.split("\n")[0])
    parser.add_argument("--parts", type=int, default=40, help="of each shape")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    seeds = range(chosen.seed, chosen.seed + chosen.parts)
    print(f"`python -m bench.odd_plates --parts {chosen.parts} --seed {chosen.seed}`\n")
    print("| shape | given as | refused | right | wrong |\n| --- | --- | --- | --- | --- |")
    told: list[str] = []
    for shape in (*SHAPES, DEBURRED):
        for is_raw in (False, True):
            refused, right, wrong = judged(shape, seeds, is_raw)
            name = "raw edge" if is_raw else "bevel"
            print(f"| {shape} | {name} | {refused} | {right} | {len(wrong)} |", flush=True)
            told += wrong
    print("", *[f"- {line}" for line in told], sep="\n")


if __name__ == "__main__":
    main()
