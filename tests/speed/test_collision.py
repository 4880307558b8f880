"""The bench of collision: its postures are what it says, and a screen that is wrong is found out."""

from typing import Any

import numpy as np
import pytest

from bench import collision
from workbench.robot import CollisionScreen
from workbench.robot.bounds import FREE


@pytest.fixture(scope="module")
def screens() -> dict[str, CollisionScreen]:
    return {name: CollisionScreen(cell) for name, cell in collision.cells().items()}


def test_counts_add_up_and_nothing_free_collides(screens: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr(collision, "CHUNK", 400)
    rows = [{"seed": 7, "chunk": chunk, **collision.counted(screens, 7, chunk)} for chunk in range(3)]
    for row in rows:
        assert row["free"] + row["colliding"] == row["postures"] == 400
        assert row["near_the_workpiece"] == 200
        assert 0 < row["proven_free"] <= row["free"] < 400
        assert row["free_but_fcl_collides"] == 0
    assert list(collision.summary(rows))[-1].startswith("| all | 1,200 | 600 |")


def test_a_screen_that_calls_all_free_is_found_out(screens: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr(collision, "CHUNK", 200)
    right = collision.counted(screens, 8, 0)
    monkeypatch.setattr(CollisionScreen, "hits", lambda self, joints, table: np.full(len(joints), FREE))
    wrong = collision.counted(screens, 8, 0)
    assert wrong["free_but_fcl_collides"] == right["colliding"] > 0
