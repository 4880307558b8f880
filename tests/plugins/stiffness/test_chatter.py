"""Chatter along a path: what margin and its U are, and what is refused."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from tests.program.paths import thinned
from workbench.errors import InputError
from workbench.path import check_file, read
from workbench.plugins.stiffness import chatter, force, modes, posture

ROOT = Path(__file__).parents[3]
MASSES = (400.0, 300.0, 200.0, 120.0, 30.0, 5.0)
FIXED = {"cutter_rotation_deg": (0, 0), "turntable_deg": (0, 0), "whole_map": False}
OWN = (767.0, 169.0, 222.0, 27.7, 26.6, 0.7)
FEW = {"stations": 2, "speed_change": 0.05}


@pytest.fixture(scope="module")
def plan():
    """The shipped path, every twenty-fourth point of it."""
    return thinned(read(toolpath=ROOT / "data/synthetic/paths/raw_arc.json"), slice(None, None, 24))


@pytest.fixture(scope="module")
def milled(cell, stiffness, plan):
    """Force, postures and modes of the shipped path."""
    push, _ = force(plan, None, cell, coefficients=OWN)
    found, *_ = posture(cell, stiffness, plan, push, **FIXED)
    robot, *_ = modes(cell, stiffness, link_masses_kg=MASSES)
    return push, found, robot


@pytest.fixture(scope="module")
def found(cell, plan, milled):
    push, postures, robot = milled
    return chatter(cell, robot, plan, push, postures, **FEW, force_relative_u=0.1, most_layers=0)


def test_margin_is_limit_over_depth_and_u_comes_from_what_is_declared(cell, plan, milled, found) -> None:
    push, postures, robot = milled
    found, file, page = found
    assert np.allclose(found.margin * found.depth_mm, found.up_limit_mm)
    assert (found.u_log > 0.1).all()
    surer = dataclasses.replace(robot, covariance=robot.covariance / 100)
    less, *_ = chatter(cell, surer, plan, push, postures, **FEW, force_relative_u=0.1, most_layers=0)
    assert np.allclose(less.u_log**2 - 0.01, (found.u_log**2 - 0.01) / 100, rtol=0.05)
    document = json.loads(file.content)
    assert len(document["declared"]) == 3
    assert document["not_included"]
    assert "milling down" in document["worst"]
    assert "Chatter" in page.summary


def test_another_paths_force_and_one_without_coefficients_are_refused(cell, plan, milled) -> None:
    push, postures, robot = milled
    with pytest.raises(InputError, match="coefficients"):
        chatter(cell, robot, plan, dataclasses.replace(push, process=None), postures)
    with pytest.raises(InputError, match="point by point"):
        chatter(cell, robot, plan, dataclasses.replace(push, layers=push.layers[:1]), postures)
    with pytest.raises(InputError, match="another path"):
        chatter(cell, robot, dataclasses.replace(plan), push, postures)


@pytest.mark.slow
def test_the_posture_of_least_displacement_that_keeps_the_margin_is_chosen(cell, stiffness, plan, milled) -> None:
    """Against every posture of a small grid, each judged by stiffness.chatter."""
    push, _, robot = milled
    asked, ways = 1.5, range(90, 111, 10)
    told = {}
    for angle in ways:
        at = {"cutter_rotation_deg": (angle, angle), "turntable_deg": (-100, -100), "whole_map": False}
        made, *_ = posture(cell, stiffness, plan, push, **at)
        one, *_ = chatter(cell, robot, plan, push, made, **FEW, most_layers=0, largest_depth_mm=60)
        told[angle] = float(np.linalg.norm(made.displacement_mm, axis=1).sum()), float(one.least_margin.min())
    kept = {angle: moved for angle, (moved, margin) in told.items() if margin >= asked}
    assert 0 < len(kept) < len(told)
    over = {"cutter_rotation_deg": (90, 110), "turntable_deg": (-100, -100), "step_deg": 10.0, "map_step_deg": 10.0}
    gate = check_file(plan)
    found, passed, file, _ = posture(
        cell, stiffness, plan, push, gate, robot, **over, least_margin=asked, stations=2, whole_map=True
    )
    document = json.loads(file.content)
    assert document["constant"]["cutter_rotation_deg"] == min(kept, key=kept.get)
    assert passed.passed
    assert document["constant"]["margin_kept"]
    assert {ways[i] for i in np.flatnonzero(document["map"]["margin_kept"])} == set(kept)
    assert np.isfinite(found.displacement_mm).all()


def test_where_no_posture_keeps_the_margin_the_gate_lets_nothing_through(cell, stiffness, plan, milled) -> None:
    push, _, robot = milled
    made, gate, file, _ = posture(cell, stiffness, plan, push, check_file(plan), robot, **FIXED, least_margin=50.0)
    found, *_ = chatter(cell, robot, plan, push, made, most_layers=0)
    told = json.loads(file.content)["constant"]["least_margin"]
    assert told == pytest.approx(found.least_margin.min())  # not the one that was asked for
    assert not gate.passed
    assert "margin of 50 less U" in gate.reason
    assert any("no posture keeps a margin" in one for one in made.warnings)
    assert json.loads(file.content)["constant"]["margin_kept"] is False


def test_the_fastest_option_keeps_the_margin_and_a_faster_one_does_not(cell, plan, milled, found) -> None:
    """Judged as a force of its own, at its depth and speed."""
    _, postures, robot = milled
    asked = 1.3 * float(found[0].least_margin.min())  # so that it takes more layers, or another direction

    def judged(layers: int, rpm: float) -> dict[str, float]:
        depth = plan.depth_of_cut_mm * len(plan.layers) / layers
        push, _ = force(plan, None, cell, coefficients=OWN, radial_depth_mm=depth, spindle_rpm=rpm)
        one, *_ = chatter(cell, robot, plan, push, postures, **FEW, force_relative_u=0.1, most_layers=0)
        down = one.down_limit_mm / one.depth_mm * np.exp(-2 * one.u_log)
        return {"up": float(one.least_margin.min()), "down": float(down.min())}

    push, _, _ = milled
    _, file, page = chatter(
        cell, robot, plan, push, postures, **FEW, force_relative_u=0.1, least_margin=asked, root_tolerance_mm=5
    )
    choice = json.loads(file.content)["choice"]
    best = choice["options"][choice["direction"]]
    assert judged(best["layers"], best["spindle_rpm"])[best["direction"]] > 0.9 * asked
    assert judged(best["layers"] - 1, best["spindle_rpm"])[best["direction"]] < 1.1 * asked
    assert choice["faster_ones_that_fail"][choice["direction"]]["chatter"] > 0
    assert "Least time" in page.html
    curve = cell.spindle
    assert best["power_kw"] <= np.interp(best["spindle_rpm"], curve.speed_rpm, curve.power_kw)
    assert best["power_kw"] == pytest.approx(best["torque_nm"] * best["spindle_rpm"] * 2 * np.pi / 60e3)


def test_a_weak_spindle_and_a_narrow_tolerance_stand_against_what_is_fast(cell, plan, milled) -> None:
    push, postures, robot = milled
    weak = dataclasses.replace(cell, spindle=cell.spindle.model_copy(update={"torque_nm": [0.01] * 3}))
    for which, more, why in ((weak, {}, "the spindle's torque"), (cell, {"root_tolerance_mm": 1e-4}, "deflection")):
        _, file, _ = chatter(which, robot, plan, push, postures, **FEW, least_margin=0.01, **more)
        choice = json.loads(file.content)["choice"]
        assert choice["direction"] is None
        assert set(choice["faster_ones_that_fail"]["up"]) >= {why}
        assert why in choice["words"]
