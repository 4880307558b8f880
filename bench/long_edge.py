"""`python -m bench.long_edge`: laws along a straight edge of 1.5 m across the turntable, as a Markdown table."""

from __future__ import annotations

import argparse
import dataclasses
import time
from pathlib import Path

import numpy as np

from workbench.artefacts import Layer, Toolpath
from workbench.geometry.poses import quaternion_from_rotation, rotation_from_quaternion
from workbench.path import read
from workbench.plugins.stiffness import force
from workbench.plugins.stiffness.arm import fast_arm
from workbench.plugins.stiffness.law import BAND, STEP_COST_MM, Grid, Law, Limits, constant_law, improved_law
from workbench.plugins.stiffness.path_points import path_points
from workbench.plugins.stiffness.traversal import Examiner, lowest, sample, search, traversal
from workbench.plugins.stiffness.values import TABLE_2_NM_PER_RAD
from workbench.robot import Margins, read_cell

PATH, CELL = Path("data/synthetic/paths/raw_arc.json"), Path("data/robot/cell.json")
K, ANGLES = np.array(TABLE_2_NM_PER_RAD), np.radians(np.arange(-180, 180.0))
LENGTH_MM, MIDDLE_MM = 1500.0, (2000.0, 0.0, 780.0)  # over the turntable's axis


def straight_edge(step_mm: float) -> Toolpath:
    """The middle of the shipped path's last layer, turned so that it feeds along the base's y, drawn out straight."""
    path = read(toolpath=PATH)
    last = path.layers[-1]
    middle = len(last.arc_length_mm) // 2
    own = rotation_from_quaternion(last.quaternion_wxyz[middle])
    turn = np.pi / 2 - np.arctan2(own[1, 1], own[0, 1])
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ own
    at = np.arange(0, LENGTH_MM + step_mm / 2, step_mm)
    layer = Layer(
        index=1,
        height_mm=0.0,
        arc_length_mm=at,
        position_mm=MIDDLE_MM + (at - LENGTH_MM / 2)[:, None] * rotation[:, 1],
        quaternion_wxyz=np.tile(quaternion_from_rotation(rotation), (len(at), 1)),
        feed_mm_s=np.ones(len(at)),
        cutting=np.ones(len(at), bool),
        measured=np.ones(len(at), bool),
        width_mm=np.full(len(at), float(last.width_mm[middle])),
    )
    return dataclasses.replace(path, layers=(layer,), travels=(), edge_length_mm=LENGTH_MM)


def show(name: str, law: Law, loaded: int, more: str = "| |") -> None:
    """One row of the table."""
    spans = [f"{np.degrees(a.min()):.0f} to {np.degrees(a.max()):.0f}" for a in (law.rotation, law.table)]
    print(f"| {name} | {' | '.join(spans)} | {law.cost_mm / loaded:.4f} | {more} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.long_edge", description=__doc__)
    parser.add_argument("--step-mm", type=float, default=1.0, help="from point to point (1)")
    sure = Margins(limit=0.0, wrist=0.0, condition=1e6)
    cell = dataclasses.replace(read_cell(CELL), margins=sure, margin_mm=0.0, process=None)
    path = straight_edge(parser.parse_args().step_mm)
    arm = fast_arm(cell.chain)
    points = path_points(path, force(path)[0], load="mean", reach_mm=path.cutter.flute_length_mm / 2, planned=0.0)
    some, n = points.only(sample(points, 60)), len(points.loaded)
    examiner = Examiner(cell, arm, points)
    choice, _ = search(examiner, traversal(arm, cell, K, some, ANGLES, ANGLES))
    start = constant_law(examiner, K, choice)
    assert cell.turntable is not None
    limits = Limits(np.append(cell.chain.speeds, cell.turntable.speed), np.full(7, np.radians(100.0)))
    print(
        "| | cutter rotation, deg | turntable, deg | mean displacement, mm | bound of such laws, mm | at most above "
        "it, % | processor time, s |\n|---|---|---|---|---|---|---|"
    )
    show("best constant pair", start, n)
    for name, band in (("best law at a fixed turntable angle", 0), ("best law of both angles", BAND)):
        began, grid = time.process_time(), Grid(ANGLES, ANGLES, np.array([band, BAND]), STEP_COST_MM)
        law, bound = improved_law(examiner, K, start, grid, limits)
        taken = time.process_time() - began
        show(name, law, n, f"{bound / n:.4f} | {100 * (law.cost_mm / bound - 1):.3f} | {taken:.1f}")
    alone = lowest(arm, cell, K, some, ANGLES, ANGLES).min(axis=1).mean()
    print(f"| every point by itself | | | | {alone:.4f} | | |")


if __name__ == "__main__":
    main()
