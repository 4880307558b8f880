"""Collision of many postures at once: the answers are those of fcl alone, pair by pair."""

import dataclasses

import numpy as np
import pytest

from workbench.robot import Cell, CollisionModel, CollisionScreen
from workbench.robot.bounds import FREE
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
    some = slice(0, 200)
    found = [model.clearance(one, angle) for one, angle in zip(q[some], table[some].tolist(), strict=True)]
    assert screen.clearances_mm(q[some], table[some]).tolist() == [one and one.distance_mm for one in found]
    for one, angle, hit in zip(q, table, hits, strict=True):
        assert (model.collision(one, angle) is None) == (hit == FREE)
        if hit != FREE:
            near = model.clearance(one, angle)
            assert near is not None
            assert near.distance_mm < max(margin_mm, 1e-12)
            assert screen.pair(hit) == model.names(*model.pairs[hit])


def test_what_is_proven_along_a_way_is_free_between_its_places(cell: Cell) -> None:
    rng = np.random.default_rng(12)
    pose = np.eye(4)
    pose[:3, 3] = (1300, -600, 1500)
    full = dataclasses.replace(cell, shapes=(*cell.shapes, Shape("post", ON_BASE, "cylinder", (150.0, 2500.0), pose)))
    low, high = cell.chain.limits.T
    at, between = np.linspace(0, 1, 25), np.linspace(0, 1, 193)  # every place, and seven between
    start, go, bend = (rng.uniform(-1, 1, (80, 1, 6)) * size for size in ((high - low) / 2, 0.5, 0.3))
    table, screen = rng.uniform(-np.pi, np.pi, 80), CollisionScreen(full)

    def way(share: np.ndarray) -> np.ndarray:
        s = share[None, :, None]
        return np.asarray((low + high) / 2 + 0.8 * start + go * s + bend * np.sin(3 * s))

    open_ = screen.swept(way(at), table)
    hits = screen.hits(way(between).reshape(-1, 6), np.repeat(table, len(between))).reshape(80, -1)
    near = np.round(between * 24).astype(int)
    assert not (~open_[:, near] & (hits != FREE)).any()
    assert 0.05 < open_.mean() < 0.5
    assert (hits != FREE).any(axis=1).sum() > 10


def test_what_tool_and_part_may_be_off_keeps_their_bodies_farther_apart(cell: Cell) -> None:
    """By hand: the clearance, and twice what either is off; links of the robot are where its joints say."""
    rng = np.random.default_rng(7)
    q = rng.uniform(cell.chain.limits[:, 0], cell.chain.limits[:, 1], (300, 6))
    unsure = dataclasses.replace(
        cell, margin_mm=10.0, margins=dataclasses.replace(cell.margins, flange_mm=30, part_mm=40)
    )
    screen, around = CollisionScreen(unsure), {"floor", "turntable"}
    judged, nearer = screen.hits(q, np.zeros(300)), 0
    for one, hit in zip(q, judged, strict=True):
        near = set()
        for gap in CollisionModel(cell).gaps(one):
            off = np.hypot(30.0 * ("tool" in gap.pair), 40.0 * bool(around.intersection(gap.pair)))
            if gap.distance_mm < 10 + 2 * off:
                near.add(gap.pair)
        assert (hit == FREE) == (not near)
        assert hit == FREE or screen.pair(hit) in near
        nearer += hit != FREE and CollisionModel(dataclasses.replace(cell, margin_mm=10.0)).collision(one) is None
    assert nearer > 10


def test_no_postures_no_hits(cell: Cell) -> None:
    assert CollisionScreen(cell).hits(np.empty((0, 6)), np.empty(0)).shape == (0,)
