"""A robot on a track along an edge of 3 m: planned, written, read back, and driven by an outsider."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench import path, program
from workbench.api import rotation_from_quaternion
from workbench.artefacts import Gate, Judgement, Moves, PathGate, Postures, Toolpath
from workbench.errors import InputError
from workbench.plugins import stiffness
from workbench.robot import Cell, read_cell
from workbench.units import Float

from .languages import back
from .paths import Shape, mill_path, moved, thinned
from .postured import DATA, URDFS, by_an_outsider

LENGTH_MM, EVERY = 3000, 20
ALONG = np.array([0.6, 0.8, 0.0])  # of the track, in the base
ROBOTS = {  # URDF, base frame, home, and where the edge lies beside it, mm
    "abb": (DATA / "irb6700_150_320.urdf", "base_link", (0, -20, 20, 0, 30, 0), (1750, 900)),
    "fanuc": (URDFS / "m20ia.urdf", "base", (0, 0, 0, 0, -60, 0), (950, 100)),
}


def cell_on_track(folder: Path, dialect: str, change: Callable[[dict[str, Any]], Any] = lambda tree: None) -> Cell:
    """A robot on a track of 7 m, whose floor has a bed for the part."""
    tree = json.loads((DATA / "cell.json").read_text())
    urdf, base, home, beside = ROBOTS[dialect]
    for key in ("turntable", "envelope", "fixtures"):
        del tree[key]
    tree["robot"] |= {"urdf": str(urdf), "base_frame": base}
    tree["controller"] = {"dialect": dialect}
    tree["track"] = {
        "direction": (10 * ALONG).tolist(),
        "limits_mm": [-500, 6500],
        "speed_mm_s": 800,
        "acceleration_mm_s2": 1500,
    }
    half = float(np.arctan2(ALONG[1], ALONG[0])) / 2
    bed = (pose_along(3000, beside) @ [0, 300, -400, 1])[:3].tolist()
    turned = [float(np.cos(half)), 0, 0, float(np.sin(half))]
    at = {"position_mm": bed, "quaternion_wxyz": turned}
    tree["fixtures"] = [{"name": "bed", "on": "base", "pose": at, "box_mm": [6500, 700, 200]}]
    tree["process"] = {"home": {"joints_deg": home}, "probe": {"distance_mm": 60}}
    change(tree)
    file = folder / f"{dialect}.json"
    file.write_text(json.dumps(tree))
    return read_cell(file)


def pose_along(share_mm: float, beside: tuple[float, float]) -> Float:
    """A frame beside the track, so far to its left and above: x along it, z up."""
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1] = ALONG, np.cross([0, 0, 1], ALONG)
    pose[:3, 3] = share_mm * ALONG + beside[0] * pose[:3, 1] + [0, 0, beside[1]]
    return pose


def edge(length_mm: int, dialect: str = "abb") -> Toolpath:
    """A straight edge along the track."""
    plan = mill_path(Shape(length_mm=length_mm, layers=1, turn=(0, 0, 0)))
    start = np.eye(4)
    start[:3, 3] = [-900, 200, -700]
    some = np.r_[0:11, 20 : length_mm + 10 : EVERY, length_mm + 10 : length_mm + 21]
    return moved(thinned(plan, some), pose_along(0, ROBOTS[dialect][3]) @ start)


def planned(cell: Cell, plan: Toolpath) -> tuple[Postures, PathGate]:
    force, _ = stiffness.force(plan, None, cell)
    at = {"cutter_rotation_deg": (40, 120), "step_deg": 20.0, "whole_map": False, "sampled_points": 20}
    postures, gate, *_ = stiffness.posture(cell, None, plan, force, path.check_file(plan), **at)
    return postures, gate


def written(cell: Cell, plan: Toolpath) -> tuple[Moves, tuple[Any, ...]]:
    postures, gate = planned(cell, plan)
    moves = path.simplify(plan, postures)
    return moves, program.write(moves, gate, cell)


@pytest.fixture(scope="module", params=["abb", "fanuc"])
def milled(request: Any, tmp_path_factory: Any) -> tuple[Cell, Toolpath, Moves, tuple[Any, ...]]:
    cell, plan = cell_on_track(tmp_path_factory.mktemp("track"), request.param), edge(LENGTH_MM, request.param)
    return (cell, plan, *written(cell, plan))


def test_the_track_goes_along_and_the_robot_keeps_its_posture(milled: Any) -> None:
    cell, _, moves, made = milled
    (judged,) = (one for one in made if isinstance(one, Judgement))
    assert judged.passed
    assert next(one for one in made if isinstance(one, Gate)).passed
    postures, table = moves.postures, np.degrees(moves.postures.turntable)
    low, high = np.degrees(cell.turntable.limits)
    assert low < table.min() < table.max() < high
    assert np.ptp(table) > LENGTH_MM
    assert np.degrees(np.ptp(postures.joints[postures.cutting], axis=0)).max() < 5
    assert len(moves.layer) < 60  # the track goes evenly between few targets


def test_what_is_written_is_read_back_and_follows_the_edge(milled: Any, monkeypatch: Any) -> None:
    """Driven in steps by other formulas: the tool in the frame of the part, and the axis as written."""
    for step in ("STEP_MM", "STEP_DEG"):  # a degree is a millimetre of the track
        monkeypatch.setattr(f"bench.program_outsider.{step}", 4.0)
    cell, plan, moves, made = milled
    files = {
        one.name: one.content.decode() for one in made if getattr(one, "name", "").endswith(("mod", "src", "dat", "ls"))
    }
    read = next(one for one in made if isinstance(one, Judgement)).program
    if cell.controller.dialect == "fanuc":
        fixed = replace(cell, turntable=replace(cell.turntable, slides=False))
        with pytest.raises(InputError, match="E1 in mm where the robot stands on a track"):
            back(moves, fixed, "fanuc", files)
        assert f"E1= {moves.turntable_deg[-1]:.3f} mm" in next(iter(files.values()))
    assert [move.turntable is not None for move in read.moves] == [True] * len(read.moves)
    begin = max(i for i, move in enumerate(read.moves[:-1]) if move.kind == "J")
    straight = read.moves[begin + 1 : -2]  # to the last target; behind it the tool is drawn back
    assert [move.kind for move in straight] == ["L"] * len(moves.layer)
    assert np.degrees([move.turntable for move in straight]) == pytest.approx(moves.turntable_deg, abs=1e-3)
    if cell.controller.dialect != "abb":
        return
    _, outsider, joints, tables = by_an_outsider(cell, read)
    flange = outsider.links(joints)[:, 6] @ outsider.tip
    place = flange[:, :3, 3] + tables[:, None] * ALONG  # on the floor
    axis = place - plan.cutter.diameter_mm / 2 * flange[:, :3, 0]
    layer = plan.layers[0]
    wanted = layer.position_mm - plan.cutter.diameter_mm / 2 * rotation_from_quaternion(layer.quaternion_wxyz)[:, :, 0]
    off = axis[:, None] - wanted[None]
    nearest = np.linalg.norm(off, axis=2).min(axis=0)
    assert nearest.max() < 2.1  # steps of 4 mm pass every point ...
    first, along = wanted[0], (wanted[-1] - wanted[0]) / np.linalg.norm(wanted[-1] - wanted[0])
    beside = axis - first
    share = beside @ along
    inside = (share > 20) & (share < LENGTH_MM - 20) & (np.linalg.norm(beside - share[:, None] * along, axis=1) < 5)
    assert inside.sum() > LENGTH_MM / 4 - 20
    assert np.linalg.norm(beside - share[:, None] * along, axis=1)[inside].max() < 0.01  # ... on its straight edge


def test_what_the_track_cannot_do_is_refused(milled: Any) -> None:
    cell, _, moves, made = milled
    (judged,) = (one for one in made if isinstance(one, Judgement))
    table, lowest = cell.turntable, np.radians(moves.turntable_deg.min() - 1)  # its margin is 2 mm
    for kind, change in (
        ("limit", {"limits": np.array([lowest, table.limits[1]])}),
        ("speed", {"speed": np.radians(3.0)}),  # mm/s, and the feed is 6 beside the cut
        ("acceleration", {"acceleration": np.radians(0.1)}),
    ):
        if cell.controller.dialect != "abb" and kind != "acceleration":  # which alone is another for it
            continue
        less = replace(cell, turntable=replace(table, **change))
        found = less.judge(judged.program, moves, 0.05, lambda *_: None)
        told = {(one.kind, one.finding.startswith("the track")) for one in found.violations}
        stands = kind == "acceleration" and not any(move.zone_mm for move in judged.program.moves)  # at every target
        assert told == (set() if stands else {(kind, True)})


@pytest.fixture(scope="module")
def short(tmp_path_factory: Any) -> tuple[Cell, Toolpath, Postures, PathGate]:
    """A short edge, in a cell that asks for no process."""
    cell = cell_on_track(tmp_path_factory.mktemp("short"), "abb", lambda tree: tree.update(process=None))
    plan = edge(300)
    return (cell, plan, *planned(cell, plan))


def test_a_track_stands_where_one_place_of_it_serves(short: Any) -> None:
    _, _, postures, _ = short
    assert np.ptp(postures.turntable) == 0
    assert postures.on_track


@pytest.mark.parametrize("controller", ["ur", "yaskawa", "trajectory"])
def test_languages_that_drive_no_track_refuse_it_in_one_line(short: Any, controller: Any) -> None:
    cell, plan, postures, gate = short
    with pytest.raises(InputError, match=f"track: expected none for {controller}") as told:
        program.write(path.simplify(plan, postures), gate, cell, controller=controller)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.update(turntable={"base_from_turntable": {"position_mm": [1500, 0, 0]}}), "turntable or a track"),
        (lambda t: t["track"].update(limits_mm=[-0.5, 6.5]), "is it in metres"),
        (lambda t: t["track"].update(speed_mm_s=0.1), "is it in m/s"),
        (lambda t: t["process"]["home"].update(turntable_deg=5), "expected track_mm"),
        (lambda t: t.pop("track") and t["fixtures"][0].update(on="carriage"), "no track"),
    ],
)
def test_a_track_that_cannot_be_is_refused(tmp_path: Path, change: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        cell_on_track(tmp_path, "abb", change)
