"""The paper's Table 1 in simulation: `python -m bench.calibration.paper --trials 100`.

Three orientations of the flange, measured thrice each, solved both its ways.

These are analytic least squares, and its genetic algorithm with equation (6) as it can be used.
Equation (6) holds for pairs that share the flange's orientation; `share_only` keeps to these. Without it, the part that
holds for any pair is used as well (docs/paper.md).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bench.calibration.faces import TRUE
from bench.peers.genetic import evolve
from bench.tables import markdown
from workbench.geometry.poses import pose_from, rotation_from_rpy, rotation_from_vector, rpy_from_rotation
from workbench.marks import FACES, GREY, MEASURED
from workbench.plugins.calibration.methods import BOX_MM, Centres, Pairs, translation, translation_cost
from workbench.units import DEG, Float

CENTER_MM = np.array([1890.33, 241.48, 1079.72])  # the paper's sphere
RADIUS_MM = 5.0
POSE_MM, POSE_DEG, CENTRE_MM = 0.07, 0.01, 0.005  # noise: flange an axis, and the circle's centre
TURN_DEG = 25.0


@dataclass(frozen=True)
class Measured:
    """Nine measurements: what the methods get, the design's hand-eye pose, and whose orientation each has."""

    centres: Centres
    design: Float  # (4, 4)
    orientation: Float  # (9,) 0, 1 or 2


def measured(rng: np.random.Generator, moved: bool, design_deg: float = 1.0, design_mm: float = 3.0) -> Measured:
    """Nine measurements. `moved`: each orientation in three places; else one place, gone to three times."""
    nominal = rotation_from_rpy(*(np.array([20.0, 65.0, 10.0]) * DEG))
    turns = nominal @ rotation_from_vector(rng.uniform(-1, 1, (3, 3)) * TURN_DEG * DEG)
    places = _places(rng, 9 if moved else 3)
    P = places if moved else np.repeat(places, 3, axis=0)
    r = np.repeat(turns, 3, axis=0)
    t = CENTER_MM - (r @ (P @ TRUE[:3, :3].T + TRUE[:3, 3])[..., None])[..., 0]
    # What the robot records is not quite where it is.
    said_r = r @ rotation_from_vector(rng.normal(0, POSE_DEG * DEG, (9, 3)))
    seen = P + rng.normal(0, CENTRE_MM, (9, 3))
    seen[:, 1] = np.copysign(np.sqrt(np.maximum(RADIUS_MM**2 - _squared_radius(rng, P[:, 1]), 0.0)), P[:, 1])
    axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    off = rotation_from_vector(axis * design_deg * DEG)
    design = pose_from(off @ TRUE[:3, :3], TRUE[:3, 3] + design_mm * way)
    return Measured(Centres(seen, said_r, t + rng.normal(0, POSE_MM, (9, 3))), design, np.repeat(np.arange(3), 3))


def _places(rng: np.random.Generator, count: int) -> Float:
    y = rng.choice([-1.0, 1.0], count) * rng.uniform(1.5, 4.25, count)
    return np.stack([rng.uniform(-10, 10, count), y, rng.uniform(-15, 15, count)], axis=1)


def _squared_radius(rng: np.random.Generator, y: Float) -> Float:
    """r^2 of the circles as fitted: sd 0.01 mm of the radius."""
    r = np.sqrt(RADIUS_MM**2 - y**2)
    return np.asarray((r + rng.normal(0, 0.01, len(y))) ** 2)


def sphere_centres(pose: Float, seen: Centres) -> Float:
    """Sphere centres (9, 3) in the base by a hand-eye pose: Table 1's rows."""
    flange = seen.P @ pose[:3, :3].T + pose[:3, 3]
    return np.asarray((seen.r @ flange[..., None])[..., 0] + seen.t)


def vol_mm(pose: Float) -> float:
    """RMS error of a point over +-16 x +-20 mm of the field of view."""
    corners = np.array([[a * 16 / np.sqrt(3), 0.0, b * 20 / np.sqrt(3)] for a in (-1, 1) for b in (-1, 1)])
    off = corners @ (pose - TRUE)[:3, :3].T + (pose - TRUE)[:3, 3]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def sharing(seen: Centres) -> tuple[Float, Float]:
    """Of pairs that share the orientation: differences in the profiler and in the flange frame (k, 3)."""
    pairs = Pairs(seen)
    return pairs.seen_by[pairs.shared], pairs.moved[pairs.shared]


def analytic(seen: Centres) -> Float:
    """Kabsch on the pairs of pure translation, then linear least squares, whatever comes of it."""
    seen_by, moved = sharing(seen)
    U, _, V = np.linalg.svd(moved.T @ seen_by)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    return pose_from(R, translation(R, seen))


def turn_cost(seen: Centres, rotations: Float) -> Float:
    """Equation (6) (s,) over pairs that share the orientation, for rotations (s, 3, 3)."""
    seen_by, moved = sharing(seen)
    return np.asarray(np.sum((np.einsum("sab,kb->ska", rotations, seen_by) - moved) ** 2, axis=(1, 2)))


def genetic(seen: Centres, design: Float, box_deg: float, rng: np.random.Generator) -> Float:
    """The genetic algorithm, 100 generations of 100, within `box_deg` and 50 mm about the design."""

    def cost(genes: Float) -> Float:
        return turn_cost(seen, np.array([rotation_from_rpy(*one) for one in genes]))

    R = rotation_from_rpy(*evolve(cost, np.array(rpy_from_rotation(design[:3, :3])), box_deg * DEG, rng))
    return pose_from(R, evolve(lambda genes: translation_cost(R, genes, seen), design[:3, 3], BOX_MM, rng))


TITLES = {False: "three postures, three times each", True: "three orientations, three places each"}
BOXES_DEG = (1.0, 2.0, 5.0, 20.0)


def table1(trials: int) -> Iterator[str]:
    """Spread of the sphere centres by both ways, and the true error of the hand-eye pose."""
    rows = []
    for moved, words in TITLES.items():
        sets = [measured(np.random.default_rng(seed), moved) for seed in range(trials)]
        ways = {"analytic": [analytic(one.centres) for one in sets]} | {
            f"GA, box {box:g} deg": [
                genetic(one.centres, one.design, box, np.random.default_rng(seed)) for seed, one in enumerate(sets)
            ]
            for box in BOXES_DEG
        }
        for name, poses in ways.items():
            every = [sphere_centres(pose, one.centres).std(axis=0) for pose, one in zip(poses, sets, strict=True)]
            spread = ", ".join(f"{v:.3f}" for v in np.median(every, axis=0))  # with n, as the paper's
            rows.append([words, name, spread, f"{np.median([vol_mm(pose) for pose in poses]):.2f}"])
    head = ["measurements", "method", "spread of the centres x, y, z, mm", "true error over the field, mm"]
    yield from markdown(head, rows)


COLOURS = (MEASURED, FACES[1], "#009e73")  # of the three orientations


def write_figure(path: Path) -> None:
    """Fig. 5: centres by both ways of one set with three postures repeated, and of one with three places each."""
    box_deg, seed = 5.0, 3
    figure = Figure(figsize=(9, 7.6), layout="constrained")
    grid = figure.subplots(2, 2, subplot_kw={"projection": "3d"})
    for row, (moved, title) in zip(grid, TITLES.items(), strict=True):
        sets = measured(np.random.default_rng(seed), moved)
        found = genetic(sets.centres, sets.design, box_deg, np.random.default_rng(seed))
        ways = {"analytic": analytic(sets.centres), f"GA, box {box_deg:g} deg": found}
        for axes, (name, pose) in zip(row, ways.items(), strict=True):
            centre = sphere_centres(pose, sets.centres)
            off = centre - centre.mean(axis=0)
            for which, colour in enumerate(COLOURS):
                axes.scatter(*off[sets.orientation == which].T, color=colour, s=18, depthshade=False)
            reach = 1.1 * max(float(np.abs(off).max()), 0.05)
            for axis in "xyz":
                getattr(axes, f"set_{axis}lim")(-reach, reach)
                getattr(axes, f"set_{axis}label")(f"{axis}, mm")
            spread = ", ".join(f"{v:.2f}" for v in centre.std(axis=0))
            axes.set_title(f"{title}: {name}\nspread {spread} mm", fontsize=9)
            axes.tick_params(labelsize=7, colors=GREY)
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m bench.calibration.paper")
    parser.add_argument("--trials", type=int, default=100, help="simulated sets (100), seeds from 0")
    parser.add_argument("--figure", type=Path, metavar="FILE.svg", help="write Fig. 5 there instead")
    given = parser.parse_args()
    if given.figure:
        write_figure(given.figure)
    else:
        print(*table1(given.trials), sep="\n")
