"""Joint trajectories: their times are judged, and their rows along the path may mill the plate."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from workbench.api import inverse, quaternion_from_rotation
from workbench.artefacts import Judgement, Moves, ProgramMoves
from workbench.path import simplify
from workbench.program import write
from workbench.robot import (
    Cell,
    forward_kinematics,
    inverse_kinematics,
    read_cell,
    turntable_pose,
    within_limits,
)

from .conftest import passed
from .languages import back
from .paths import Shape
from .postured import as_workpiece, cell_of, postured

ROBOT = "gp25"  # its postures lie 5 mm apart on travels too, as the optimiser's
ACCELERATIONS = np.radians([90.0, 90, 90, 180, 180, 240])
BEND = Shape(bend=1 / 300, length_mm=40)
CUTTER_SHAPE = {
    "pose": {"position_mm": [215, 0, 140], "quaternion_wxyz": [0.7071067811865476, 0, 0.7071067811865476, 0]},
    "cylinder_mm": [5, 90],
    "body": "cutter",
}


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    return replace(cell_of(ROBOT, tmp_path_factory.mktemp("cell")), accelerations=ACCELERATIONS)


@pytest.fixture(scope="module")
def moves(cell: Cell) -> Moves:
    return postured(cell, ROBOT, BEND)


def written(moves: Moves, cell: Cell) -> tuple[dict[str, str], Judgement]:
    """The files, and what came of them."""
    csv, table, _, _, judgement, _ = write(moves, passed(moves.toolpath), cell, controller="trajectory")
    return {one.name: one.content.decode() for one in (csv, table)}, judgement


def faster(files: dict[str, str], by: float) -> dict[str, str]:
    """CSV and JSON with all times divided."""
    (csv, text), (table, document) = sorted(files.items())
    lines = [
        line if line[0] in "#t" else ",".join([repr(float((cut := line.split(","))[0]) / by), *cut[1:]])
        for line in text.splitlines()
    ]
    tree = json.loads(document)
    tree["points"] = [[float(row[0]) / by, *row[1:]] for row in tree["points"]]
    return {csv: "\n".join(lines) + "\n", table: json.dumps(tree)}


@pytest.fixture(scope="module")
def sound(moves: Moves, cell: Cell) -> tuple[dict[str, str], Judgement]:
    return written(moves, cell)


def judged(cell: Cell, program: ProgramMoves, moves: Moves) -> Judgement:
    return cell.judge(program, moves, 0.05, lambda *_: None)


def test_what_is_written_passes_in_the_files_own_time(moves: Moves, sound: tuple[dict[str, str], Judgement]) -> None:
    files, judgement = sound
    assert judgement.passed, judgement.violations
    last = max(float(line.split(",")[0]) for line in files["BevelPath.csv"].splitlines() if line[0].isdigit())
    assert judgement.time_s == pytest.approx(last, abs=1e-9)
    assert last > moves.toolpath.time_s - 1e-6
    assert 0 < judgement.speed_share < 1


def test_where_the_turntable_turns_fast_rows_lie_nearer(moves, cell, monkeypatch):
    """To and fro by 8 deg, 2 deg from posture to posture: even angles leave the path by r theta^2/8."""
    made = moves.postures
    step = np.arange(len(made.layer))
    table = np.radians(2.0) * np.abs((step + 4) % 8 - 4)
    turned = np.array([turntable_pose(cell, angle) @ inverse(turntable_pose(cell, 0.0)) for angle in table])
    targets = turned @ forward_kinematics(cell.chain, made.joints) @ made.flange_from_point
    branches = inverse_kinematics(cell.chain, targets @ inverse(made.flange_from_point))
    near = np.array([within_limits(cell.chain, one, q) for one, q in zip(branches, made.joints, strict=True)])
    which = np.nanargmin(np.linalg.norm(near - made.joints[:, None], axis=2), axis=1)
    other = replace(
        made,
        turntable=table,
        joints=near[step, which],
        position_mm=targets[:, :3, 3],
        quaternion_wxyz=quaternion_from_rotation(targets[:, :3, :3]),
    )
    wild = simplify(moves.toolpath, other)
    judgement = written(wild, cell)[1]
    assert judgement.passed, judgement.violations
    assert judgement.deviation_mm < 0.025
    assert len(judgement.program.moves) > 2 * len(step)
    monkeypatch.setattr("workbench.program.trajectory.MOST_ROWS", 1)
    _, gate, judgement, _ = write(wild, passed(wild.toolpath), cell, controller="trajectory")
    assert not gate.passed
    assert "deviation" in {one.kind for one in judgement.violations}


def test_times_stay_those_of_the_feed_where_joints_can_follow(moves, sound):
    """No step is shorter than its feed, and few are longer: those beside a standstill or a corner."""
    program = sound[1].program
    made = moves.postures
    at = np.array([np.abs(made.joints - move.joints).max(axis=1).argmin() for move in program.moves])
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(made.position_mm, axis=0), axis=1) / made.feed_mm_s[1:]))
    ratio = np.diff([move.time_s for move in program.moves]) / np.diff(way[at])
    assert ratio.min() > 1 - 1e-5
    assert np.mean(ratio > 1.001) < 0.2


@pytest.mark.parametrize(("by", "kind"), [(2.0, "acceleration"), (100.0, "acceleration"), (5000.0, "speed")])
def test_a_faster_file_is_refused_naming_joint_and_line(moves, cell, sound, by, kind):
    files, _ = sound
    found = judged(cell, back(moves, cell, "trajectory", faster(files, by)), moves)
    assert kind in {one.kind for one in found.violations}
    rows = files["BevelPath.csv"].splitlines()
    for one in found.violations:
        assert ("joint " in one.finding) == (one.kind != "feed")
        assert rows[one.line - 1][0].isdigit()
    assert judged(cell, back(moves, cell, "trajectory", faster(files, 1.0)), moves).passed


@pytest.mark.parametrize("by", [1.06])
def test_a_faster_file_is_refused_for_its_feed_where_no_accelerations_are_known(moves, cell, by):
    silent = replace(cell, accelerations=None)
    files, _ = written(moves, silent)
    found = judged(silent, back(moves, silent, "trajectory", faster(files, by)), moves)
    assert {one.kind for one in found.violations} == {"feed"}
    said = [one.finding for one in found.violations]
    assert all(any(f"along layer {layer} at" in one for one in said) for layer in (1, 2))


def test_one_row_of_a_layer_that_comes_too_soon_is_found(moves: Moves, cell: Cell) -> None:
    """Between two rows of a layer that is milled at 1 mm/s, although travels are at 20."""
    silent = replace(cell, accelerations=None)
    program = written(moves, silent)[1].program
    feed = np.diff([move.time_s for move in program.moves])
    slow = int(np.flatnonzero((feed > 0.9) & (np.array([move.layer for move in program.moves[1:]]) == 2))[5]) + 1
    moved = [replace(move, time_s=move.time_s - 0.5) if i >= slow else move for i, move in enumerate(program.moves)]
    (found,) = judged(silent, replace(program, moves=tuple(moved)), moves).violations
    assert (found.line, found.kind) == (program.moves[slow].line, "feed")
    assert "the tool goes along layer 2 at 2" in found.finding


@pytest.fixture(scope="module")
def plated(moves: Moves, tmp_path_factory: pytest.TempPathFactory) -> tuple[Cell, Moves, ProgramMoves]:
    """A block where the path's middle is, which the cutter may mill; its path and program."""
    points = moves.postures
    tip = points.position_mm[len(points.layer) // 2]
    block = {"name": "block", "pose": {"position_mm": tip.tolist()}, "box_mm": [20, 20, 20]}
    folder = tmp_path_factory.mktemp("plated")
    cell_of(ROBOT, folder)
    file = folder / f"{ROBOT}.json"
    tree = json.loads(file.read_text())
    tree["tool"]["shapes"] = [CUTTER_SHAPE]
    file.write_text(json.dumps(tree | {"fixtures": [block], "may_touch": [["cutter", "workpiece"]]}))
    cell = replace(as_workpiece("block", read_cell(file)), accelerations=ACCELERATIONS)
    own = postured(cell, ROBOT, BEND)
    judgement = written(own, cell)[1]
    assert judgement.passed, judgement.violations
    return cell, own, judgement.program


def collisions(cell: Cell, program: ProgramMoves, moves: Moves) -> set[int]:
    return {one.line for one in judged(cell, program, moves).violations if one.kind == "collision"}


def test_the_rows_of_the_path_may_mill_the_plate(plated: tuple[Cell, Moves, ProgramMoves]) -> None:
    cell, moves, program = plated
    assert {move.layer for move in program.moves} == {0, 1, 2}
    silent = replace(program, moves=tuple(replace(move, layer=None) for move in program.moves))
    assert collisions(cell, silent, moves)
    held = replace(cell, may_touch=())
    assert collisions(held, program, moves)


@pytest.mark.parametrize("end", ["before", "behind"])
def test_rows_beyond_the_paths_ends_may_not(plated: tuple[Cell, Moves, ProgramMoves], end: str) -> None:
    """Whatever layer they claim: into the block and out again."""
    cell, moves, program = plated
    rows = list(program.moves)
    middle = replace(rows[len(rows) // 2], layer=1)
    ends = rows[0], rows[-1]
    more = [ends[0], middle, *rows] if end == "before" else [*rows, middle, ends[1]]
    timed = tuple(replace(move, line=i + 1, time_s=20.0 * i) for i, move in enumerate(more))
    lines = collisions(cell, replace(program, moves=timed), moves)
    wanted = {2, 3} if end == "before" else {len(more) - 1, len(more)}
    assert lines
    assert lines <= wanted


def test_a_way_aside_between_two_parts_of_the_path_is_found(plated: tuple[Cell, Moves, ProgramMoves]) -> None:
    """At the end of a layer into the block and back, in the layer's name: no row of the path, whatever it says."""
    cell, moves, whole = plated
    rows = list(whole.moves)
    i = max(n for n, row in enumerate(rows) if row.layer == 1)
    aside = replace(rows[len(rows) // 2], layer=1, joints=rows[i].joints + np.radians([0, 2, 2, 0, 0, 0]))
    more = [*rows[: i + 1], aside, rows[i], *rows[i + 1 :]]
    timed = tuple(replace(move, line=n + 1, time_s=20.0 * n) for n, move in enumerate(more))
    program = replace(whole, moves=timed)
    assert "deviation" in {one.kind for one in judged(cell, program, moves).violations}
