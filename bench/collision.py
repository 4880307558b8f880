"""Postures that the screen calls free, each asked of fcl again, all pairs: `python -m bench.collision`.

Half of the postures are anywhere within the limits. The other half hold the cutter near the workpiece, as a path does:
on or around the turntable, axis in any direction that does not point up. Three cells in turn: the shipped one, one with
a plate (a mesh), clamps and posts, one with forty boxes. One line a chunk goes to the log; a run that was stopped goes
on behind the last one.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bench.speed.postures import CELL, cluttered
from workbench.geometry.poses import inverse, rotation_from_vector
from workbench.robot import Cell, CollisionScreen, inverse_kinematics, motions, read_cell, turntable_pose, within_limits
from workbench.robot.bounds import FREE, SAFE_MM, bounding_volumes, clearance_bound_mm
from workbench.robot.cell import ON_BASE, ON_TURNTABLE, Shape
from workbench.robot.collision import standing_poses
from workbench.units import Float

CHUNK = 10_000
COUNTS = ("postures", "near_the_workpiece", "proven_free", "free", "colliding", "free_but_fcl_collides")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.collision", description=__doc__)
    parser.add_argument("--postures", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--log", type=Path, default=Path("out/collision.jsonl"), help="a line a chunk; read on restart")
    arguments = parser.parse_args()
    os.nice(10)
    arguments.log.parent.mkdir(parents=True, exist_ok=True)
    done = [json.loads(line) for line in arguments.log.read_text().splitlines()] if arguments.log.exists() else []
    mine = {row["chunk"] for row in done if row["seed"] == arguments.seed}
    screens = {name: CollisionScreen(cell) for name, cell in cells().items()}
    for chunk in range(-(-arguments.postures // CHUNK)):
        if chunk not in mine:
            row = {"seed": arguments.seed, "chunk": chunk, **counted(screens, arguments.seed, chunk)}
            done.append(row)
            with open(arguments.log, "a", encoding="utf-8") as log:
                print(json.dumps(row), file=log)
    for line in summary([row for row in done if row["seed"] == arguments.seed]):
        print(line)


def cells() -> dict[str, Cell]:
    shipped = read_cell(CELL)
    return {"shipped": shipped, "plate": furnished(shipped), "boxes": cluttered(shipped)}


def furnished(cell: Cell) -> Cell:
    """A plate of triangles on the turntable, two clamps, a round post and a slanted rail beside it."""
    corners = np.array([[x, y, z] for x in (-250.0, 250) for y in (-200.0, 200) for z in (100.0, 120)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    at = [np.eye(4) for _ in range(4)]
    for pose, position in zip(at, [(280, 0, 90), (-280, 0, 90), (1300, 900, 700), (1200, -800, 900)], strict=True):
        pose[:3, 3] = position
    at[3][:3, :3] = rotation_from_vector(np.array([0.7, 0.3, 0.0]))
    return dataclasses.replace(
        cell,
        shapes=(
            *cell.shapes,
            Shape("plate", ON_TURNTABLE, "mesh", (), np.eye(4), corners, triangles),
            Shape("clamp 1", ON_TURNTABLE, "box", (60.0, 120.0, 180.0), at[0]),
            Shape("clamp 2", ON_TURNTABLE, "box", (60.0, 120.0, 180.0), at[1]),
            Shape("post", ON_BASE, "cylinder", (60.0, 1400.0), at[2]),
            Shape("rail", ON_BASE, "capsule", (40.0, 900.0), at[3]),
        ),
    )


def counted(screens: dict[str, CollisionScreen], seed: int, chunk: int) -> dict[str, Any]:
    """Counts of one chunk, in the cell whose turn it is."""
    name = list(screens)[chunk % len(screens)]
    screen, start = screens[name], time.process_time()
    cell, model = screen.cell, screen.model
    rng = np.random.default_rng([seed, chunk])
    near, near_table = near_the_workpiece(cell, rng, CHUNK // 2)
    low, high = cell.chain.limits.T
    joints = np.vstack([near, rng.uniform(low, high, (CHUNK - len(near), 6))])
    table = np.append(near_table, rng.uniform(-np.pi, np.pi, CHUNK - len(near)))
    proven = clearance_bound_mm(cell, bounding_volumes(cell), joints, table) > model.least_mm.max() + SAFE_MM
    free = screen.hits(joints, table) == FREE
    everything, moved = list(range(len(model.pairs))), motions(cell.chain, joints)
    hits = (model.first_hit(moved[i], standing_poses(cell, table[i]), everything) for i in np.flatnonzero(free))
    counts = (CHUNK, len(near), proven.sum(), free.sum(), CHUNK - free.sum(), sum(hit >= 0 for hit in hits))
    return {
        "cell": name,
        **dict(zip(COUNTS, map(int, counts), strict=True)),
        "seconds": round(time.process_time() - start, 1),
    }


def near_the_workpiece(cell: Cell, rng: np.random.Generator, count: int) -> tuple[Float, Float]:
    """Postures (n, 6) and turntable angles (n,) of `count` or fewer cutter poses on and around the turntable."""
    table = rng.uniform(-np.pi, np.pi, 5 * count)
    cutter = np.tile(np.eye(4), (len(table), 1, 1))
    cutter[:, :3, :3] = rotation_from_vector(rng.normal(size=(len(table), 3)) * 2)
    cutter[:, :3, 3] = turntable_pose(cell, 0.0)[:3, 3] + rng.uniform((-500, -500, 0), (500, 500, 350), (len(table), 3))
    up = cutter[:, 2, 2] > 0.2  # z runs from shank to tip: the spindle would stand below
    found = inverse_kinematics(cell.chain, cutter[~up] @ inverse(cell.flange_from_cutter))
    joints = within_limits(cell.chain, found)
    usable = np.isfinite(joints).all(axis=-1)
    chosen = np.argmax(usable * rng.uniform(0.1, 1.0, usable.shape), axis=1)  # any of the branches within limits
    there = usable.any(axis=1)
    return joints[np.arange(len(joints)), chosen][there][:count], table[~up][there][:count]


def summary(rows: list[dict[str, Any]]) -> Iterator[str]:
    """A table in Markdown, cell by cell and all together."""
    yield "| cell | " + " | ".join(COUNTS).replace("_", " ") + " | s |"
    yield "|---|" + "---|" * (len(COUNTS) + 1)
    names = list(dict.fromkeys(row["cell"] for row in rows))
    for name in [*names, "all"]:
        own = [row for row in rows if name in ("all", row["cell"])]
        numbers = [f"{sum(row[key] for row in own):,}" for key in COUNTS]
        yield f"| {name} | {' | '.join(numbers)} | {sum(row['seconds'] for row in own):.0f} |"


if __name__ == "__main__":
    main()
