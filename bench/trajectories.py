"""Random joint trajectories at random speeds: what the judge lets pass, sampled by an outsider in fine steps of time.

`python -m bench.trajectories --help`. Each is a CSV and a JSON of a smooth motion, driven from much too slow to much
too fast, many with one row at a wrong time, in a cell with random boxes near the way. The judge sees the files; the
outsider (`bench.program_outsider`) the numbers that they were made from. Unsafe: a contact, a joint beyond its limit,
its speed or its acceleration, a turntable that is too fast. The goal is none unsafe among those that passed, and no
promise (clearance, distance from limits, largest share of a speed) broken.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline

from bench.harness import Option, Study
from bench.program_outsider import Outsider, Target
from bench.programs import CELL, blocks, judged, random_program, summed, with_boxes
from workbench.program.trajectory import COLUMNS, Table
from workbench.robot import Cell, forward_kinematics, read_cell
from workbench.robot.judge import MOST_TOLD, judge
from workbench.units import Float

FINE = 2000  # places on the smooth motion, to know how fast it is
MISTIMED = 0.45  # of a step, at most: rows stay in their order


def random_trajectory(cell: Cell, rng: np.random.Generator) -> tuple[Float, Float]:
    """Times (n,) s and joints with turntable (n, 7) in deg: a spline from rest to rest through some postures."""
    start, table, _ = random_program(cell, rng)
    knots = rng.integers(2, 6)
    size = np.exp(rng.uniform(np.log(2), np.log(25)))
    via = np.cumsum([np.append(np.degrees(start), table), *(size * rng.normal(size=(knots, 7)))], axis=0)
    curve = CubicSpline(np.linspace(0, 1, len(via)), via)

    def at(share: Float) -> Float:
        return np.asarray(curve(share**3 * (10 - 15 * share + 6 * share**2)))

    fine = at(np.linspace(0, 1, FINE))
    assert cell.turntable is not None
    rated = np.degrees(np.append(cell.chain.speeds, cell.turntable.speed))
    speed = np.abs(np.diff(fine, axis=0)).max(axis=0) * (FINE - 1) / rated
    seconds = speed.max()
    if cell.accelerations is not None:
        change = np.abs(np.diff(fine, 2, axis=0)).max(axis=0) * (FINE - 1) ** 2
        most = np.append(cell.accelerations, cell.turntable.acceleration or np.inf)
        seconds = max(seconds, np.sqrt((change / np.degrees(most)).max()))
    seconds *= 2 ** rng.uniform(-1.5, 2)
    share = np.linspace(0, 1, rng.integers(5, 120))
    times, angles = seconds * share, at(share)
    if rng.random() < 0.4:
        row = rng.integers(1, len(times) - 1)
        times[row] += rng.uniform(-MISTIMED, MISTIMED) * times[1]
    return np.round(times, 9), np.round(angles, 6)


def files(times: Float, angles: Float, tool: Float, name: str) -> dict[str, str]:
    """CSV and JSON, as another writer might write them."""
    rows = [[t, *row, 0] for t, row in zip(times.tolist(), angles.tolist(), strict=True)]
    table = "\n".join([",".join(COLUMNS), *(",".join(map(repr, row)) for row in rows), ""])
    head = {"format": "joint-trajectory", "version": 1, "columns": list(COLUMNS), "flange_from_tool": tool.tolist()}
    return {f"{name}.csv": table, f"{name}.json": json.dumps({**head, "points": rows})}


def sampled(task: tuple[int, int, int]) -> tuple[Counter[str], float]:
    """Judge a block of random trajectories, the outsider samples all; the largest share of an acceleration by splines.

    Through the rows of those that passed.
    """
    shipped, tally = dataclasses.replace(read_cell(CELL), process=None), Counter[str]()  # they begin anywhere
    outsider = Outsider(CELL.parent / "irb6700_150_320.urdf", shipped)
    (seed, first, last), worst = task, 0.0
    for number in range(first, last):
        rng = np.random.default_rng([seed, number])
        cell = shipped if rng.random() < 0.6 else dataclasses.replace(shipped, accelerations=None)
        times, angles = random_trajectory(cell, rng)
        ends = forward_kinematics(cell.chain, np.radians(angles[:, :6])) @ cell.flange_from_cutter
        cell = with_boxes(cell, rng, [Target("J", pose, None, None, 0.0, 0.0) for pose in ends], ends[0])
        name = f"{seed}-{number}"
        found = judge(cell, Table().program(files(times, angles, cell.flange_from_cutter, name)))
        tally.update(judged(found))
        kinds = {violation.kind for violation in found.violations}
        fast, share = outsider.too_fast(cell, times, angles)
        joints, tables = outsider.sampled(times, angles)
        tally["too fast for the outsider"] += bool(fast)
        missed = bool(fast) and not kinds & {"speed", "acceleration"} and len(found.violations) < MOST_TOLD
        tally["TOO FAST, NOT TOLD"] += missed
        tally["told as too fast, the outsider needs less"] += not fast and bool(kinds & {"speed", "acceleration"})
        if abs(share - found.speed_share) > 1e-3 * share:
            tally["SHARE OF A SPEED WRONG"] += 1
            print(f"{name}: {share:.4f} of a speed, said {found.speed_share:.4f}", file=sys.stderr)
        if missed:
            print(f"{name}: {fast}", file=sys.stderr)
        if not found.passed:
            continue
        limit = ((joints < outsider.low) | (joints > outsider.high)).any()
        wrong = fast or ("limit" if limit else outsider.unsafe(cell, joints, tables))
        broken = wrong or outsider.broken(cell, joints, tables, found.clearance_mm, found.limit_margin)
        tally["UNSAFE PASSED"] += bool(wrong)
        tally["PROMISES BROKEN"] += bool(broken)
        tally["places of the outsider"] += len(joints)
        worst = max(worst, outsider.of_a_spline(cell, times, angles))
        if broken:
            print(f"{name}: {broken}", file=sys.stderr)
    return tally, worst


def report(found: Sequence[tuple[Mapping[str, int], float]], given: Namespace) -> Iterator[str]:
    """All blocks together."""
    yield from summed([tally for tally, _ in found], given)
    worst = max(share for _, share in found)
    yield from ("", f"A spline through rows that passed asks for at most {100 * worst:.0f} % of an acceleration.")


STUDY = Study(
    "trajectories", str(__doc__), {"count": Option(40), "seed": Option(1)}, partial(blocks, size=20), sampled, report
)
if __name__ == "__main__":
    STUDY()
