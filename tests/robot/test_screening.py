"""Collision of many postures at once: the answers are those of fcl alone, pair by pair."""

import dataclasses

import numpy as np
import pytest

from workbench.robot import Cell, CollisionModel, CollisionScreen
from workbench.robot.screening import FREE
from workbench.robot.shapes import ON_BASE, ON_TURNTABLE, Shape


@pytest.mark.parametrize("margin_mm", [0.0, 25.0])
def test_no_posture_is_judged_otherwise(cell: Cell, margin_mm: float) -> None:
    rng = np.random.default_rng(6)
    pose = np.eye(4)
    pose[:3, 3] = (1300, -600, 1500)
    around = (
        Shape("post", ON_BASE, "cylinder", (150.0, 2500.0), pose),
        Shape("disc", ON_BASE, "cylinder", (400.0, 60.0), pose),
        Shape("clamp", ON_TURNTABLE, "box", (200.0, 300.0, 400.0), np.eye(4)),
    )
    full = dataclasses.replace(cell, shapes=(*cell.shapes, *around), margin_mm=margin_mm)
    q = rng.uniform(cell.chain.limits[:, 0], cell.chain.limits[:, 1], (600, 6))
    table = rng.uniform(-np.pi, np.pi, 600)
    screen, model = CollisionScreen(full), CollisionModel(full)
    hits = screen.hits(q, table)
    assert 100 < (hits == FREE).sum() < 500
    for one, angle, hit in zip(q, table, hits, strict=True):
        assert (model.collision(one, angle) is None) == (hit == FREE)
        if hit != FREE:
            near = model.clearance(one, angle)
            assert near is not None
            assert near.distance_mm < max(margin_mm, 1e-12)
            assert screen.pair(hit) == model.names(*model.pairs[hit])


def test_no_postures_no_hits(cell: Cell) -> None:
    assert CollisionScreen(cell).hits(np.empty((0, 6)), np.empty(0)).shape == (0,)
