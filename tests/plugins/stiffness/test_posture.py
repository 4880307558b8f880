"""The posture optimiser against plain loops over the robot's own kinematics, limits and collision."""

import dataclasses
import itertools
import json
from typing import Any

import numpy as np
import pytest

from tests.program.paths import thinned as with_points
from tests.seldom import seldom
from workbench.api import inverse, rotation_from_vector, turn_about_z
from workbench.artefacts import PathGate, Postures, Toolpath
from workbench.errors import InputError
from workbench.path import read
from workbench.plugins.stiffness import force, posture
from workbench.plugins.stiffness.elastic import give_way
from workbench.plugins.stiffness.path_points import path_points
from workbench.plugins.stiffness.values import JointStiffness, MillingForce
from workbench.robot import (
    SIDES,
    Cell,
    CollisionModel,
    Shape,
    arm_sides,
    forward_kinematics,
    inverse_kinematics,
    jacobian,
    turntable_pose,
    within_limits,
)
from workbench.robot.cell_model import ON_BASE, ON_TURNTABLE
from workbench.units import Float

from .conftest import ROOT, K

PATH = ROOT / "data" / "synthetic" / "paths" / "raw_arc.json"
COARSE: dict[str, Any] = {"step_deg": 30.0, "sampled_points": 100, "reach_mm": 15.0}
FEW = {**COARSE, "whole_map": False}
MODES = "constant", "along_path"


def thinned(path: Toolpath, every: int) -> Toolpath:
    """The last layer alone, one point in so many; no travels."""
    last = dataclasses.replace(path, layers=path.layers[-1:], travels=())
    return with_points(last, slice(None, None, every))


@pytest.fixture(scope="module")
def path() -> Toolpath:
    return thinned(read(toolpath=PATH), 15)


@pytest.fixture(scope="module")
def acts(path: Toolpath) -> MillingForce:
    return force(path)[0]


@pytest.fixture(scope="module")
def cluttered(cell: Cell) -> Cell:
    """Boxes where the forearm would like to be."""
    turn = np.eye(4)
    boxes = []
    for i, at in enumerate(((1300, -700, 1500), (900, 600, 1500), (1700, 300, 1250))):
        pose = turn.copy()
        pose[:3, 3] = at
        boxes.append(Shape(f"box {i}", ON_BASE, "box", (250.0, 300.0, 500.0), pose))
    return dataclasses.replace(cell, shapes=(*cell.shapes, *boxes))


@pytest.fixture(scope="module")
def dressed(cell: Cell) -> Cell:
    """A dress pack: joint 6 turns by 170 deg to one side, 40 to the other."""
    limits = cell.chain.limits.copy()
    limits[5] = np.radians([-170, 40])
    return dataclasses.replace(cell, chain=dataclasses.replace(cell.chain, limits=limits))


def best_by_loops(cell: Cell, path: Toolpath, acts: MillingForce, step_deg: float) -> Float:
    """Mean displacement (8, t, a) in each branch of the inverse, inf: infeasible, by its limits and fcl."""
    points = path_points(path, acts, load="mean", reach_mm=15.0, planned=0.0)
    model, angles = CollisionModel(cell), np.radians(np.arange(-180, 180, step_deg))
    best = np.full((8, len(angles), len(angles)), np.inf)
    low, high = cell.chain.limits.T + np.radians([[2.0], [-2.0]])
    reach = np.array([[1796.25]] * 3 + [[1.0]] * 3)
    for (t, rotation), (a, table) in itertools.product(enumerate(angles), enumerate(angles)):
        moved = turntable_pose(cell, table) @ inverse(turntable_pose(cell, 0.0))
        point = moved @ points.base_from_point
        cutter = point @ points.point_from_tip @ turn_about_z(np.array(rotation))
        joints = within_limits(cell.chain, inverse_kinematics(cell.chain, cutter @ inverse(cell.flange_from_cutter)))
        for branch in range(8):
            q = np.unwrap(joints[:, branch], axis=0)
            if not np.isfinite(q).all() or not np.isfinite(within_limits(cell.chain, q)).all():
                continue
            if abs(table) > np.radians(178) or ((q < low) | (q > high)).any():
                continue
            by_tip = [jacobian(cell.chain, one, cell.flange_from_cutter[:3, 3]) / reach for one in q]
            if np.abs(np.sin(q[:, 4])).min() < np.sin(np.radians(5)) or max(map(np.linalg.cond, by_tip)) > 50:
                continue
            if np.abs(np.diff(q, axis=0)).max() > np.radians(15) or any(model.collision(one, table) for one in q):
                continue
            loads = np.hstack([points.force_n @ moved[:3, :3].T, np.zeros((len(q), 3))])
            flange = forward_kinematics(cell.chain, q)
            local = (inverse(flange) @ point)[:, :3, 3]
            length = [
                np.linalg.norm(give_way(cell.chain, K, one, at, load, with_kc=False)[0][:3])
                for one, at, load in zip(q, local, loads, strict=True)
            ]
            best[branch, t, a] = np.mean(np.array(length)[points.loaded])
    return best


def sure(cell: Cell) -> Cell:
    """The loops know of no uncertainty and no home."""
    margins = dataclasses.replace(cell.margins, flange_mm=0.0, flange_rad=0.0, part_mm=0.0, part_rad=0.0)
    return dataclasses.replace(cell, margins=margins, process=None)


@pytest.fixture(scope="module")
def by_loops(cell: Cell, path: Toolpath, acts: MillingForce) -> Float:
    return best_by_loops(sure(cell), path, acts, 30.0)


@pytest.mark.parametrize("where", ["cell", "cluttered", *seldom("dressed")])
def test_choice_and_map_are_those_of_plain_loops(where, path, acts, stiffness, by_loops, request):
    here = sure(request.getfixturevalue(where))
    made, _, document, _ = posture(here, stiffness, path, acts, **COARSE)
    every = by_loops if where == "cell" else best_by_loops(here, path, acts, 30.0)
    each = every.min(axis=0)
    length = np.linalg.norm(made.displacement_mm, axis=1)[made.cutting]
    assert np.isclose(length.mean(), each.min(), rtol=1e-9)
    file = json.loads(document.content)
    over = file["map"]
    assert not np.isfinite(each[:, 0]).any()  # the turntable at its limit
    each = each[:, 1:]
    found = np.array([[np.inf if x is None else x for x in row] for row in over["mean_displacement_mm"]])
    assert (np.isfinite(found) == np.isfinite(each)).all()
    feasible = np.isfinite(each)
    assert np.allclose(found[feasible], each[feasible], rtol=0, atol=1e-6)
    causes = np.array([[x or "" for x in row] for row in over["cause"]])
    assert ((causes == "") == feasible).all()
    assert set(causes.reshape(-1)) <= {"", "unreachable", "limit", "singular", "collision"}
    judged = np.array(over["judged"])
    assert set(judged[feasible].tolist()) <= {"every point", "proven"}
    pairs = np.array([[x is not None for x in row] for row in over["collision_pair"]])
    assert (pairs == (causes == "collision")).all()
    bodies = {name for pair in over["collision_pairs"] for name in pair}
    assert any(name.startswith("box") for name in bodies) == (where == "cluttered")
    assert 0 < feasible.sum() < feasible.size


def test_a_part_is_scanned_at_one_angle(
    cell: Cell, path: Toolpath, acts: MillingForce, stiffness: JointStiffness
) -> None:
    turned = dataclasses.replace(cell, scanned_at=np.radians(40.0))
    with pytest.raises(InputError, match=r"as robot\.plate has it"):
        posture(turned, stiffness, path, acts, planned_at_deg=0.0, **FEW)
    as_placed, as_asked = (
        posture(turned, stiffness, path, acts, **FEW),
        posture(cell, stiffness, path, acts, planned_at_deg=40.0, **FEW),
    )
    assert np.array_equal(as_placed[0].joints, as_asked[0].joints)


@pytest.fixture(scope="module")
def free(cell: Cell, path: Toolpath, acts: MillingForce, stiffness: JointStiffness) -> Postures:
    return posture(cell, stiffness, path, acts, **FEW)[0]


@pytest.mark.parametrize("wanted", [["front"], ["front", "elbow_up", "flipped"]])
def test_a_configuration_is_kept(wanted, cell, path, acts, stiffness, free):
    """By the cell's key and by the parameter; the arm stands as its words say, and gives way more for it."""
    made, *_ = posture(dataclasses.replace(cell, configuration=tuple(wanted)), stiffness, path, acts, **FEW)
    asked, *_ = posture(cell, stiffness, path, acts, configuration=wanted, **FEW)
    assert (asked.joints == made.joints).all()
    sides = arm_sides(cell.chain, made.joints)
    for word in wanted:
        which = next(i for i, pair in enumerate(SIDES) if word in pair)
        assert (sides[:, which] == SIDES[which].index(word)).all()
    mean, least = (np.linalg.norm(one.displacement_mm, axis=1)[one.cutting].mean() for one in (made, free))
    assert mean > 1.01 * least


def test_without_stiffness_the_arm_keeps_away_from_limits_and_singular_postures(cell, path, acts, by_loops):
    """The chosen cell is the least awkward of those that loops over the robot's inverse and fcl find free."""
    here = sure(cell)
    gate = PathGate(passed=True, reason="checked", toolpath=path, tolerance_mm=0.3)
    made, told, document, _ = posture(here, None, path, acts, gate, **COARSE)
    assert np.isnan(made.displacement_mm).all()
    assert any("NOT CHECKED: how far the robot gives way" in line for line in told.loosened)

    def awkward(q: Float) -> float:
        limits = cell.chain.limits + np.radians([2.002, -2.002])  # by the margin, and a program's digits
        j = jacobian(cell.chain, q, cell.flange_from_cutter[:3, 3]) / np.array([[1796.25]] * 3 + [[1.0]] * 3)
        condition = np.linalg.norm(j) * np.linalg.norm(np.linalg.inv(j)) / 6
        return condition * np.mean(np.ptp(limits, axis=1) ** 2 / (4 * (q - limits[:, 0]) * (limits[:, 1] - q)))

    file = json.loads(document.content)
    mean = np.mean([awkward(q) for q in made.joints[made.cutting]])
    assert np.isclose(file["mean_awkwardness"], mean, rtol=1e-4)
    assert file["mean_displacement_mm"] is None
    ways = np.isfinite(by_loops).any(axis=0)[:, 1:]
    found = np.array([[x is not None for x in row] for row in file["map"]["mean_awkwardness"]])
    assert (found == ways).all()


def test_postures_stand_at_the_path(cell: Cell, path: Toolpath, free: Postures) -> None:
    """The cutter's axis goes where the path wants it, wherever cutter and turntable stand; clear of everything."""
    made = free
    layer, model = path.layers[-1], CollisionModel(cell)
    for i, (q, table) in enumerate(zip(made.joints, made.turntable, strict=True)):
        moved = turntable_pose(cell, table) @ inverse(turntable_pose(cell, 0.0))
        tip = (inverse(moved) @ forward_kinematics(cell.chain, q) @ cell.flange_from_cutter)[:3]
        planned = rotation_from_quaternion_wxyz(layer.quaternion_wxyz[i])
        assert np.allclose(tip[:, 2], planned[:, 2], atol=1e-9)
        assert np.allclose(tip[:, 3], layer.position_mm[i] - 5.0 * planned[:, 0] + 15.0 * planned[:, 2], atol=1e-6)
        near = model.gaps(q, table)[0]
        assert np.isclose(near.distance_mm, made.clearance_mm[i])
        assert near.distance_mm > 0
    assert (np.abs(np.diff(made.joints, axis=0)) < 0.3).all()
    low, high = cell.chain.limits.T
    assert ((made.joints >= low - 1e-9) & (made.joints <= high + 1e-9)).all()


def rotation_from_quaternion_wxyz(q: Float) -> Float:
    """By the rotation vector, not by the formula that the code uses."""
    angle = 2 * np.arctan2(np.linalg.norm(q[1:]), q[0])
    return rotation_from_vector(q[1:] / np.linalg.norm(q[1:]) * angle)


def test_no_point_by_itself_gives_way_less_than_the_bound_says(cell, path, acts, stiffness):
    """The bound is below every choice, and that of fewer angles is not below that of more."""
    told = []
    for span in ((60, 110), (95, 105)):
        some = {**COARSE, "step_deg": 2.0, "whole_map": False, "cutter_rotation_deg": span}
        made, _, document, _ = posture(cell, stiffness, path, acts, turntable_deg=(-90, -60), **some)
        told.append(json.loads(document.content))
        mean = np.linalg.norm(made.displacement_mm, axis=1)[made.cutting].mean()
        assert told[-1]["gap_to_bound"] == pytest.approx(mean / told[-1]["pointwise_bound_mm"] - 1)
        assert 0 < told[-1]["gap_to_bound"] < 0.1
    assert told[0]["pointwise_bound_mm"] < told[1]["pointwise_bound_mm"]


def test_angles_along_the_path_are_one_pair_and_what_each_points_own_would_win(cell, path, acts, stiffness):
    some = {
        **COARSE,
        "step_deg": 5.0,
        "whole_map": False,
        "cutter_rotation_deg": (60, 110),
        "turntable_deg": (-90, -60),
    }
    (one, _, document, _), (other, *_) = (posture(cell, stiffness, path, acts, mode=m, **some) for m in MODES)
    assert np.array_equal(one.joints, other.joints)
    share = f"by {100 * json.loads(document.content)['gap_to_bound']:.2g} % at most"
    assert [told for told in other.warnings if share in told] == [*set(other.warnings) - {*one.warnings}]
    (silent,) = {*posture(cell, None, path, acts, mode=MODES[1], **some)[0].warnings} - {*one.warnings}
    assert "nothing says" in silent


def test_without_a_turntable(cell: Cell, path: Toolpath, acts: MillingForce, stiffness: JointStiffness) -> None:
    shapes = tuple(shape for shape in cell.shapes if shape.body != "turntable")
    alone = dataclasses.replace(cell, turntable=None, shapes=shapes)
    made, _, document, chapter = posture(alone, stiffness, path, acts, **COARSE)
    assert not made.has_turntable
    assert (made.turntable == 0).all()
    assert json.loads(document.content)["map"]["turntable_deg"] == [0.0]
    assert "<img" in chapter.html


def test_postures_release_a_path_by_its_own_decision_alone(cell, path, acts, stiffness):
    """A refused path stays refused, and another path's gate does not count."""
    sound = PathGate(True, "", toolpath=path, tolerance_mm=0.05)
    refused = dataclasses.replace(sound, passed=False, reason="too steep")
    other = dataclasses.replace(sound, toolpath=dataclasses.replace(path))
    found = [posture(cell, stiffness, path, acts, gate, **FEW)[1] for gate in (None, other, refused, sound)]
    assert found[:2] == [None, None]
    assert (found[2].passed, found[2].reason.startswith("too steep; postures found")) == (False, True)
    assert (found[3].passed, found[3].reached) == (True, True)


@pytest.mark.parametrize(
    ("by", "to_mm", "words"),
    [((1, 1, 1), (9000.0, 0, 0), "unreachable 100 %"), ((1, 1, 0), (450.0, 250.0, 440.0), "'turntable'")],
    ids=["out of reach", "in the turntable"],
)
def test_a_path_where_no_cutter_comes_is_refused(cell, path, stiffness, by, to_mm, words):
    layer = dataclasses.replace(path.layers[0], position_mm=path.layers[0].position_mm * by + to_mm)
    there = dataclasses.replace(path, layers=(layer,))
    with pytest.raises(InputError, match=words):
        posture(cell, stiffness, there, force(there)[0], **FEW)


def test_a_clamp_between_sparse_points_is_found_by_the_search(cell: Cell, stiffness: JointStiffness) -> None:
    """Points 60 mm apart, a clamp round the cutter half way: in the way of every posture."""
    path = thinned(read(toolpath=PATH), 60)
    points = path_points(path, force(path)[0], load="mean", reach_mm=6.5, planned=0.0)
    pose = np.eye(4)
    pose[:3, 3] = (points.base_from_point @ points.point_from_tip)[:2, :3, 3].mean(axis=0)
    clamp = Shape("clamp", ON_TURNTABLE, "box", (20.0, 20.0, 20.0), inverse(cell.turntable.base_from_turntable) @ pose)
    here = dataclasses.replace(cell, shapes=(*cell.shapes, clamp))
    with pytest.raises(InputError, match=r"no cutter rotation .* collision .*'cutter' with 'clamp'"):
        posture(here, stiffness, path, force(path)[0], step_deg=5.0)


def test_where_the_cutter_hits_a_clamp_at_every_angle_the_search_ends_soon(
    cell: Cell, path: Toolpath, acts: MillingForce, stiffness: JointStiffness, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A block on the turntable holds the whole path: every posture of the grid was judged by itself."""
    seen, asked = CollisionModel.first_hit, list[int]()
    monkeypatch.setattr(CollisionModel, "first_hit", lambda *args: asked.append(1) or seen(*args))
    pose = inverse(turntable_pose(cell, 0.0))
    pose[:3, 3] += path.layers[0].position_mm.mean(axis=0)
    block = Shape("block", ON_TURNTABLE, "box", (300.0, 300.0, 100.0), pose)
    blocked = dataclasses.replace(cell, shapes=(*cell.shapes, block))
    with pytest.raises(InputError, match=r"collision \d+ % .*'cutter' with 'block'"):
        posture(blocked, stiffness, path, acts, step_deg=4.0, whole_map=False)
    assert len(asked) < 1000


def test_force_of_another_path_is_refused(cell, acts, path, stiffness):
    other = thinned(read(toolpath=PATH), 10)
    with pytest.raises(InputError, match="that of this path"):
        posture(cell, stiffness, other, acts, **COARSE)
    idle = dataclasses.replace(acts.layers[0], mean_n=acts.layers[0].mean_n * 0)
    with pytest.raises(InputError, match="found none"):
        posture(cell, stiffness, path, MillingForce((idle,), "", 6000.0), **COARSE)
