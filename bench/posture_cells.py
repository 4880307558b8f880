"""Cells of the posture map that are called free, each asked of fcl at every point: `python -m bench.posture_cells`.

Random boxes stand around the path; the map is made on a coarse grid. The outsider (`bench.program_outsider`: its own
kinematics and shapes) looks at every point of the path in each of the arm's branches that go along it within their
limits: where all of them hit something, the cell is called free and collides. Told apart by how the map says that the
cell was judged.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.program_outsider import Outsider
from workbench.path import read
from workbench.plugins.stiffness import force
from workbench.plugins.stiffness import read as read_stiffness
from workbench.plugins.stiffness.path_points import PathPoints, path_points
from workbench.plugins.stiffness.posture import posture
from workbench.plugins.stiffness.traversal import flange_poses
from workbench.robot import Cell, inverse_kinematics, read_cell
from workbench.robot.cell import ON_BASE, Shape
from workbench.units import Float

CELL = Path(__file__).parent.parent / "data" / "robot" / "cell.json"
PATH = CELL.parent.parent / "synthetic" / "paths" / "raw_arc.json"
FAST = 20.0  # deg between neighbouring points: beyond it, the arm has changed its branch


def boxed(cell: Cell, rng: np.random.Generator, points: PathPoints) -> Cell:
    """Three to ten boxes within the spindle's reach of the path."""
    boxes = []
    for i in range(rng.integers(3, 11)):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.random(rng=rng).as_matrix()
        at = points.base_from_point[rng.integers(len(points.layer))]
        pose[:3, 3] = at[:3, 3] + rng.normal(size=3) * 250 - at[:3, 2] * rng.uniform(60, 400)
        boxes.append(Shape(f"box {i}", ON_BASE, "box", tuple(rng.uniform(20, 250, 3).tolist()), pose))
    return dataclasses.replace(cell, shapes=(*cell.shapes, *boxes))


def free_somehow(outsider: Outsider, cell: Cell, points: PathPoints, rotation: float, table: float) -> bool:
    """Whether one branch of the arm follows the path without a contact."""
    count = len(points.layer)
    poses = flange_poses(cell, points, np.arange(count), np.full(count, rotation), np.full(count, table))
    rows = inverse_kinematics(cell.chain, poses)  # (n, 8, 6), one branch a column
    for branch in range(rows.shape[1]):
        joints = np.unwrap(rows[:, branch], axis=0)
        if not np.isfinite(joints).all() or np.degrees(np.abs(np.diff(joints, axis=0)).max()) > FAST:
            continue
        for shifted in _within(joints, outsider.low, outsider.high):
            if outsider.least(cell, shifted, np.full(count, np.degrees(table)), 0.0)[0] > 0:
                return True
    return False


def _within(joints: Float, low: Float, high: Float) -> list[Float]:
    """The joints shifted by whole turns into their limits; none: they do not fit."""
    turns = np.round((joints.mean(axis=0) - (low + high) / 2) / (2 * np.pi))
    shifted = joints - 2 * np.pi * turns
    return [shifted] if ((shifted >= low) & (shifted <= high)).all() else []


def study(cases: int, seed: int, asked: int, step_deg: float) -> Counter[str]:
    """`cases` maps; of each, at most `asked` free cells of every way of judging, at random."""
    bare, path, tally = read_cell(CELL), read(toolpath=PATH), Counter[str]()
    acting, stiffness = force(path, None, bare)[0], read_stiffness(bare)
    points = path_points(path, acting, load="mean", reach_mm=path.cutter.flute_length_mm / 2, planned=0.0)
    outsider = Outsider(CELL.parent / "irb6700_150_320.urdf", bare)
    for number in range(cases):
        rng = np.random.default_rng([seed, number])
        cell = boxed(bare, rng, points)
        try:
            made = posture(cell, stiffness, path, acting, step_deg=step_deg)
        except ValueError as error:
            tally["cases without a posture"] += 1
            print(f"case {number}: {error}", file=sys.stderr)
            continue
        assert made is not None
        over = json.loads(made[2].content)["map"]  # type: ignore[misc,union-attr]
        cause, judged = np.array(over["cause"], object), np.array(over["judged"])
        for how in ("every point", "proven"):
            cells = np.argwhere((cause == None) & (judged == how))  # noqa: E711  (elementwise)
            for i, j in rng.permutation(cells)[:asked]:
                angles = np.radians([over["cutter_rotation_deg"][i], over["turntable_deg"][j]])
                tally[f"{how}: called free"] += 1
                if not free_somehow(outsider, cell, points, *angles):
                    tally[f"{how}: CALLED FREE, COLLIDES"] += 1
        print(f"case {number}: {dict(tally)}", file=sys.stderr, flush=True)
    return tally


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--asked", type=int, default=20)
    parser.add_argument("--step-deg", type=float, default=10.0)
    options = parser.parse_args()
    for name, count in sorted(study(options.cases, options.seed, options.asked, options.step_deg).items()):
        print(f"{name:40s} {count}")


if __name__ == "__main__":
    main()
