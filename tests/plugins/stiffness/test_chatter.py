"""Chatter along a path: what margin and its U are, and what is refused."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.path import read
from workbench.plugins.stiffness import chatter, force, modes, posture

ROOT = Path(__file__).parents[3]
MASSES = (400.0, 300.0, 200.0, 120.0, 30.0, 5.0)
FIXED = {"cutter_rotation_deg": (0, 0), "turntable_deg": (0, 0), "whole_map": False}
OWN = (767.0, 169.0, 222.0, 27.7, 26.6, 0.7)


@pytest.fixture(scope="module")
def plan():
    return read(toolpath=ROOT / "data/synthetic/paths/raw_arc.json")


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
    return chatter(cell, robot, plan, push, postures, stations=2, force_relative_u=0.1)


def test_margin_is_limit_over_depth_and_u_comes_from_what_is_declared(cell, plan, milled, found) -> None:
    push, postures, robot = milled
    found, file, page = found
    assert np.allclose(found.margin * found.depth_mm, found.up_limit_mm)
    assert (found.u_log > 0.1).all()
    surer = dataclasses.replace(robot, covariance=robot.covariance / 100)
    less, *_ = chatter(cell, surer, plan, push, postures, stations=2, force_relative_u=0.1)
    assert np.allclose(less.u_log**2 - 0.01, (found.u_log**2 - 0.01) / 100, rtol=0.05)
    document = json.loads(file.content)
    assert len(document["declared"]) == 3
    assert document["not_included"]
    assert "milling down" in document["worst"]
    assert "Chatter" in page.summary


def test_twice_the_force_is_half_the_limit(cell, plan, milled) -> None:
    _, postures, robot = milled
    strong, _ = force(plan, None, cell, coefficients=tuple(2 * k for k in OWN), helix_deg=0)
    plain, _ = force(plan, None, cell, coefficients=OWN, helix_deg=0)
    one, _, _ = chatter(cell, robot, plan, plain, postures, stations=2, force_relative_u=0.1)
    two, _, _ = chatter(cell, robot, plan, strong, postures, stations=2, force_relative_u=0.1)
    assert np.allclose(two.up_limit_mm * 2, one.up_limit_mm, rtol=0.01)
    assert np.allclose(two.down_limit_mm * 2, one.down_limit_mm, rtol=0.01)


def test_more_damping_allows_more(cell, plan, milled, found) -> None:
    push, postures, robot = milled
    calm = dataclasses.replace(robot, damping=2 * robot.damping)
    two, *_ = chatter(cell, calm, plan, push, postures, stations=2)
    assert (two.up_limit_mm > 1.2 * found[0].up_limit_mm).all()


def test_another_paths_force_and_one_without_coefficients_are_refused(cell, plan, milled) -> None:
    push, postures, robot = milled
    with pytest.raises(InputError, match="coefficients"):
        chatter(cell, robot, plan, dataclasses.replace(push, process=None), postures)
    with pytest.raises(InputError, match="point by point"):
        chatter(cell, robot, plan, dataclasses.replace(push, layers=push.layers[:1]), postures)
    with pytest.raises(InputError, match="another path"):
        chatter(cell, robot, dataclasses.replace(plan), push, postures)
