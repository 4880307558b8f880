"""What one planned scan promised, and what came of it."""

from __future__ import annotations

import dataclasses
import math
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from bench.programs import CELL
from bench.scan_plan.parts import ROBOT_MM, STANDOFF_MM, Drawn, analytic, draw, sensor_file, triangulated
from workbench import cloud, edge, robot, scan
from workbench.artefacts import Recording
from workbench.errors import InputError, WorkbenchError
from workbench.geometry.poses import inverse, pose_from
from workbench.result_files import SensorFile
from workbench.robot import Cell, turntable_pose
from workbench.robot.cell_model import ON_TURNTABLE, Shape
from workbench.scan import read_hand_eye
from workbench.scan_plan import ScanPlan
from workbench.scan_plan.information import Joint, Knowledge
from workbench.scan_plan.plan_stage import Task, as_profiler, courses, planned, predicted
from workbench.scan_plan.reach import scan_cell
from workbench.scan_plan.way import EdgeLine
from workbench.synthetic.workpiece import build_surface, edge_frames, pose
from workbench.units import DEG

HAND_EYE = CELL.parent.parent / "calibration" / "handeye.json"
TAUGHT_MM = 0.3  # error of a taught point
SIMULATORS = "analytic, sharp", "triangulated, sharp", "triangulated, a radius", "the same, predicted with it"
ENDS_MM = 4.0  # of the edge, where passes begin


def examine(seed: int) -> dict[str, Any]:
    """One part: planned in the shipped cell, scanned, measured."""
    drawn = draw(seed)
    with TemporaryDirectory() as folder:
        sensor = sensor_file(drawn, Path(folder))
        begin = time.process_time()
        try:
            task, made = _planned(drawn, sensor, seed)
        except InputError as refused:
            return {"refused": str(refused)}
        row: dict[str, Any] = {"seconds": time.process_time() - begin, "promised": float(made.reached.mean())}
        row["unseen"] = float((~np.any([one.sees for one in made.passes], axis=0)).mean())
        way = courses(made)
        found = {SIMULATORS[0]: _achieved(drawn, made, sensor, *analytic(drawn, made, way))}
        if not drawn.recipe.part.clamps and not any(one.view.lead for one in made.passes):
            scanned = triangulated(drawn, made, seed)
            found[SIMULATORS[1 + (drawn.radius_mm > 0.0)]] = _achieved(drawn, made, sensor, *scanned)
            if drawn.radius_mm > 0.0:
                told = predicted(task, made, 2 * [drawn.radius_mm])
                found[SIMULATORS[3]] = _achieved(drawn, told, sensor, *scanned)
    return {**row, "simulators": found}


def _planned(drawn: Drawn, sensor: Path, seed: int) -> tuple[Task, ScanPlan]:
    """In the shipped cell with the clamp, by points that were taught."""
    file, eye = SensorFile.read(sensor), read_hand_eye(HAND_EYE)
    part = drawn.recipe.part
    joint = Joint(drawn.thickness_mm, drawn.root_mm, drawn.bevel_deg * DEG)
    surface = build_surface(part, seed)
    frames = pose(part.base_from_part) @ edge_frames(surface, np.linspace(0.0, part.length_mm, 4))
    points = frames[:, :3, 3] + np.random.default_rng([76, seed]).normal(0.0, TAUGHT_MM, (4, 3))
    line = EdgeLine.through(points, frames[:, :3, 2], "taught")
    known = Knowledge(ROBOT_MM, 0.0, "unknown")
    task = Task(joint, as_profiler(file, sensor), known, line, drawn.wanted, 2, 200.0, 100.0)
    cell = robot.cell(cell=CELL)
    assert isinstance(cell, Cell)
    for one in part.clamps:
        cell = dataclasses.replace(cell, shapes=(*cell.shapes, _clamp(cell, drawn, one)))
    place = scan_cell(cell, file, eye.flange_from_profiler, STANDOFF_MM, line, joint, tool_stays=False, z_away=True)
    return task, planned(task, place)


def _clamp(cell: Cell, drawn: Drawn, one: Any) -> Shape:
    """The clamp as a body on the turntable."""
    part = drawn.recipe.part
    middle = edge_frames(build_surface(part, 0), np.array([0.5 * (one.from_mm + one.to_mm)]))[0]
    top = part.thickness_mm.highest + one.height_mm
    size = (one.reach_in_mm + one.reach_out_mm, one.to_mm - one.from_mm, top + 2.0)
    offset = np.array([0.5 * (one.reach_out_mm - one.reach_in_mm), 0.0, 0.5 * (top - 2.0)])
    at = pose(part.base_from_part) @ middle @ pose_from(np.eye(3), offset)
    return Shape("clamp", ON_TURNTABLE, "box", size, inverse(turntable_pose(cell, 0.0)) @ at)


def _achieved(drawn: Drawn, made: ScanPlan, sensor: Path, recording: Recording, truth: Any) -> dict[str, Any]:
    """Of stations that the plan speaks of: u by the engine, and errors."""
    try:
        found = edge.segment(
            cloud.denoise(scan.fuse(recording)),
            root_nominal_mm=drawn.root_mm,
            bevel_nominal_deg=drawn.bevel_deg,
            robot_noise_mm=ROBOT_MM,
            sensor=sensor,
        )
    except WorkbenchError as refused:
        return {"refused": str(refused)}
    known = found.seen & np.isfinite(found.root.u) & np.isfinite(found.bevel.u)
    place = found.position_mm[known]
    near = np.argmin(np.linalg.norm(truth["position_mm"][None] - place[:, None], axis=2), axis=1)
    s = found.arc_length_mm[known]
    inside = (s > s[0] + ENDS_MM) & (s < s[-1] - ENDS_MM)
    station = np.clip(np.searchsorted(made.arc_length_mm, s), 0, len(made.arc_length_mm) - 1)
    promised = made.reached[station] & made.reached[np.maximum(station - 1, 0)] & inside
    root_u, bevel_u = 2.0 * found.root.u[known], 2.0 * found.bevel.u[known]
    root_error = np.abs(found.root.value[known] - np.asarray(truth["root_mm"])[near])
    bevel_error = np.abs(found.bevel.value[known] - np.asarray(truth["bevel_deg"])[near])
    told_root, told_bevel = 2.0 * made.root.u[station], 2.0 * made.bevel.u[station]
    held = (root_u <= drawn.wanted.root_mm) & (bevel_u <= drawn.wanted.bevel_deg)
    out: dict[str, Any] = {"promised": int(promised.sum()), "held": int((held & promised).sum())}
    for name, u, told, error, most in (
        ("root", root_u, told_root, root_error, drawn.wanted.root_mm),
        ("bevel", bevel_u, told_bevel, bevel_error, drawn.wanted.bevel_deg),
    ):
        which = promised & np.isfinite(told)
        if which.any():
            out[name] = {
                "ratio": math.sqrt(float(np.mean(u[which] ** 2) / np.mean(told[which] ** 2))),
                "held": float(np.mean(u[which] <= most)),
                "covered": float(np.mean(error[which] <= u[which])),
            }
    return out
