"""Rows about what is computed, in a process that keeps to one core; batches take two."""

from __future__ import annotations

import dataclasses
import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.calibration.sphere_truth import cell_of, circles, recorded_poses
from bench.drawn.spheres import random_sphere_recipe
from bench.harness import ROOT
from bench.speed.recordings import simulated, small_parts
from bench.speed.timing import Row, median_s, peak_gb
from workbench import cloud, edge, inspect, scan
from workbench.artefacts import PathGate, Toolpath
from workbench.batch.part import Job, Record
from workbench.batch.workers import Workers
from workbench.path import check, feed, layers, read, simplify
from workbench.pipeline.document import read_document
from workbench.plugins import calibration
from workbench.plugins.calibration.model import Noise
from workbench.plugins.calibration.observations import from_arrays
from workbench.plugins.calibration.solve import solve
from workbench.plugins.stiffness import force
from workbench.plugins.stiffness.arm import BRANCHES, fast_arm
from workbench.plugins.stiffness.path_points import path_points
from workbench.plugins.stiffness.traversal import Examiner, sample, search, traversal
from workbench.plugins.stiffness.values import TABLE_2_NM_PER_RAD
from workbench.program import write
from workbench.robot import Cell, read_cell
from workbench.robot.cell_model import ON_BASE, Shape
from workbench.synthetic import write_simulation
from workbench.synthetic.sphere import design_hand_eye

PIPELINE = ROOT / "pipelines" / "inspect_bevel.json"
SIZES = {1: None, 50: 1.6}  # million points, and the goal of their inspection, s
FIRST_SEED = 500_000
GRID, POINTS, BOXES = np.radians(np.arange(-180, 180.0)), 60, 40
TIME_LIMIT_S, WARM_UP = 600.0, 4  # parts a worker that are not counted


def inspecting(folder: Path) -> Iterator[Row]:
    """Recordings from file to inspection, without a report."""
    for million, goal in SIZES.items():
        path = simulated(million, folder)
        taken = median_s(
            lambda path=path: inspect.sections(edge.segment(cloud.denoise(scan.fuse(scan.read(recording=path)))))
        )
        yield Row(f"recording to inspection, {million} M points, processor time", taken, goal=goal)
    with tempfile.TemporaryDirectory() as name:
        command = ("run", str(PIPELINE), "--no-report", "--input", f"recording={path}", "--out", name)
        yield Row(f"peak memory, {million} M points", peak_gb(*command), "GB", goal=2.5)


def planning(folder: Path) -> Iterator[Row]:
    """A raw edge of 5 m to its program: ten layers in 12 mm of thickness."""
    points = cloud.denoise(scan.fuse(scan.read(recording=simulated(50, folder, raw=True))))
    raw = edge.segment_raw(points, upper_side=(0.0, 0.0, 1.0))

    def planned() -> Toolpath:
        return feed(layers(raw, points, depth_of_cut_mm=0.7), points, raw)

    def program() -> None:
        plan = planned()
        write(simplify(plan), PathGate(True, "timed by itself", toolpath=plan, tolerance_mm=0.05))

    plan = planned()
    count = sum(len(layer.feed_mm_s) for layer in plan.layers)
    yield Row(f"5 m raw edge to RAPID, {len(plan.layers)} layers, {count:,} points", median_s(program), goal=2)
    yield Row("`path.check` of it", median_s(lambda: check(plan, raw, points)))


def calibrating(_: Path) -> Iterator[Row]:
    """Nine profiles of a sphere to the hand-eye pose: from circles, of ten sets, and from a file."""
    taken = []
    for k in range(10):
        recipe = random_sphere_recipe("sphere_nine", FIRST_SEED + k)
        circle, covariance = circles(cell_of(recipe), np.random.default_rng(k))
        seen, design = from_arrays(circle, covariance, recorded_poses(recipe)), design_hand_eye(recipe)
        taken.append(median_s(lambda seen=seen, design=design: solve(seen, Noise(), design), 1))
    what = "hand-eye pose of 9 profiles after circle fits, signs searched, answer checked"
    yield Row(what, 1e3 * statistics.median(taken), "ms", goal=5)
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "sphere.h5"
        write_simulation(random_sphere_recipe("sphere_stray", FIRST_SEED), path)

        def answered() -> None:
            recording = scan.read(recording=path)
            calibration.hand_eye(calibration.circles(recording), recording)

        yield Row("file of 9 profiles to `handeye.json`, libraries imported", median_s(answered), goal=1)


def posturing(_: Path) -> Iterator[Row]:
    """Traversal and proven optimum on the shipped path and cell."""
    cell = dataclasses.replace(read_cell(ROOT / "data/robot/cell.json"), process=None)  # the path, no ways home
    path = read(toolpath=ROOT / "data/synthetic/paths/raw_arc.json")
    arm = fast_arm(cell.chain, np.array(TABLE_2_NM_PER_RAD))
    points = path_points(path, force(path)[0], load="mean", reach_mm=path.cutter.flute_length_mm / 2, planned=0.0)
    sampled = points.only(sample(points, POINTS))
    loaded = sampled.only(sampled.loaded)
    size = f"360 x 360 angles x {len(loaded.layer)} points, all {BRANCHES} branches of the arm"
    over = median_s(lambda: traversal(arm, cell, loaded, GRID, GRID))
    yield Row(f"traversal of {size}, no collision", over, goal=0.5)
    for name, place, goal in (("open", cell, 3), ("cluttered", cluttered(cell), 10)):
        taken = median_s(
            lambda place=place: search(Examiner(place, arm, points), traversal(arm, place, sampled, GRID, GRID)), 3
        )
        yield Row(f"the optimum with exact collision checks, proven, {name} cell", taken, goal=goal)


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


def batches(_: Path, count: int = 1000) -> Iterator[Row]:
    """Small parts without a report by one worker and by two, what a part costs beside its pipeline, and memory."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recordings = list(small_parts(count, folder))
        (one_s, records, memory), (two_s, _, _) = (_timed(k, recordings, folder / str(k)) for k in (1, 2))
    what = f"{count:,} small parts, two workers; one worker, {one_s:.3g} s"
    yield Row(what, one_s / two_s, "x faster", 1.8, True)
    own_s = sum(record.seconds for record in records)
    yield Row("a small part in a warm worker; its stages alone", 1e3 * (one_s - own_s) / count, "ms", goal=50)
    grown = memory[-1] / memory[len(memory) // 10]
    yield Row(f"memory of a worker after {count:,} parts; after a tenth of them", grown, "x as much", goal=1.05)


def _timed(workers: int, recordings: list[Path], out: Path) -> tuple[float, list[Record], list[int]]:
    """Seconds for all parts once the workers are warm, the records, and a worker's resident bytes after each part."""
    pipeline = read_document(PIPELINE)
    stages = tuple(one for one in pipeline.stages if not one["stage"].startswith("report."))
    pipeline = dataclasses.replace(pipeline, stages=stages)

    def jobs(some: list[Path], place: Path) -> list[Job]:
        return [Job(one.stem, str(one), pipeline, {}, {}, str(place / one.stem), os.getcwd()) for one in some]

    records, memory = [], []
    with Workers(workers, time_limit_s=TIME_LIMIT_S) as team:
        list(team.run(jobs(recordings[: WARM_UP * workers], out / "warm-up")))
        start_s = time.perf_counter()
        for record in team.run(jobs(recordings, out)):
            records.append(record)
            pages = Path(f"/proc/{team.workers[0].process.pid}/statm").read_text().split()[1]
            memory.append(int(pages))
        spent_s = time.perf_counter() - start_s
    unmeasured = [record.cause for record in records if record.outcome not in ("passed", "rejected")]
    if unmeasured:
        raise AssertionError(f"expected every part to be measured: {unmeasured[:3]}")
    return spent_s, records, memory
