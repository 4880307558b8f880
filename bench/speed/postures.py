"""The posture optimiser. `python -m bench.speed.postures` prints JSON.

It runs in a process of its own, on one core, on the shipped path and cell; times are the process's own.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bench.speed.timing import REPEATS, print_on_one_core
from workbench.path import read
from workbench.plugins.stiffness import force
from workbench.plugins.stiffness.arm import BRANCHES, Arm, fast_arm
from workbench.plugins.stiffness.path_points import PathPoints, path_points
from workbench.plugins.stiffness.traversal import Examiner, flange_poses, sample, search, traversal
from workbench.plugins.stiffness.values import TABLE_2_NM_PER_RAD
from workbench.robot import Cell, CollisionScreen, bounding_volumes, clearance_bound_mm, inverse_kinematics, read_cell
from workbench.robot.cell import ON_BASE, Shape
from workbench.units import Float

PATH, CELL = Path("data/synthetic/paths/raw_arc.json"), Path("data/robot/cell.json")
K = np.array(TABLE_2_NM_PER_RAD)
GRID = np.radians(np.arange(-180, 180.0))
POINTS, BOXES, BOUNDED, SCREENED = 60, 40, 200_000, 50_000


def cluttered(cell: Cell) -> Cell:
    """Forty boxes around the robot, at random places (seed 1) within its reach but not over the turntable."""
    rng = np.random.default_rng(1)
    boxes: list[Shape] = []
    while len(boxes) < BOXES:
        pose = np.eye(4)
        pose[:3, 3] = rng.uniform((-1500, -2000, 200), (2200, 2000, 2400))
        if np.hypot(*(pose[:2, 3] - (2000, 0))) > 900 and np.hypot(*pose[:2, 3]) > 900:
            boxes.append(Shape(f"box {len(boxes)}", ON_BASE, "box", (300.0, 300.0, 300.0), pose))
    return dataclasses.replace(cell, shapes=(*cell.shapes, *boxes))


def optimum(cell: Cell, arm: Arm, points: PathPoints, loaded: PathPoints) -> int:
    """Traversal and best-first search, bodies built anew: the proven optimum; how many cells were examined."""
    choice, _ = search(Examiner(cell, arm, points), traversal(arm, cell, loaded, GRID, GRID))
    return choice.examined


def timed(action: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Median seconds of processor time; one round that is not counted comes first."""
    taken = []
    for _ in range(repeats + 1):
        start = time.process_time()
        action()
        taken.append(time.process_time() - start)
    return statistics.median(taken[1:])


def certified(cell: Cell, joints: tuple[Float, Float]) -> dict[str, float]:
    """Seconds a posture to prove it free or not, all pairs of bodies; and the share that bounding volumes decide."""
    volumes, screen = bounding_volumes(cell), CollisionScreen(cell)
    few = joints[0][:SCREENED], joints[1][:SCREENED]
    return {
        "bound_s": timed(lambda: clearance_bound_mm(cell, volumes, *joints)) / len(joints[0]),
        "certified": float(np.mean(clearance_bound_mm(cell, volumes, *joints) > 0)),
        "screen_s": timed(lambda: screen.hits(*few), 3) / SCREENED,
        "colliding": float(np.mean(screen.hits(*few) >= 0)),
    }


def measure() -> dict[str, Any]:
    """All times in s."""
    cell, path = dataclasses.replace(read_cell(CELL), process=None), read(toolpath=PATH)  # the path, no ways home
    arm = fast_arm(cell.chain, K)
    points = path_points(path, force(path)[0], load="mean", reach_mm=path.cutter.flute_length_mm / 2, planned=0.0)
    sampled = points.only(sample(points, POINTS))
    loaded = sampled.only(sampled.loaded)
    full = cluttered(cell)
    joints = _postures(cell, points)
    return {
        "points": len(loaded.layer),
        "branches": BRANCHES,
        "traversal_s": timed(lambda: traversal(arm, cell, loaded, GRID, GRID)),
        "open_s": timed(lambda: optimum(cell, arm, points, sampled), 3),
        "open_cells": optimum(cell, arm, points, sampled),
        "cluttered_s": timed(lambda: optimum(full, arm, points, sampled), 3),
        "cluttered_cells": optimum(full, arm, points, sampled),
        **certified(cell, joints),
    }


def _postures(cell: Cell, points: PathPoints) -> tuple[Float, Float]:
    """Joint angles and turntable angles at random cells of the grid that the robot reaches."""
    rng = np.random.default_rng(3)
    table = rng.choice(GRID, BOUNDED)
    poses = flange_poses(cell, points, rng.choice(points.loaded, BOUNDED), rng.choice(GRID, BOUNDED), table)
    joints = inverse_kinematics(cell.chain, poses)[:, 0]
    there = np.isfinite(joints[:, 0])
    return joints[there], table[there]


if __name__ == "__main__":
    print_on_one_core(measure)
