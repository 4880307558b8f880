"""How far a rounded corner leaves its path, against the parabola itself."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.moves import rounding_mm

NONE = np.full((3, 3), np.nan)


@pytest.mark.parametrize("turn_deg", [0.0, 10.0, 90.0, 180.0])
@pytest.mark.parametrize(("before", "behind", "rounding"), [(10.0, 10.0, 2.0), (1.0, 30.0, 50.0), (30.0, 1.0, 50.0)])
def test_straight_corners(turn_deg: float, before: float, behind: float, rounding: float) -> None:
    """The middle of the parabola, which begins no more than half way."""
    turn = np.radians(turn_deg)
    way = np.array([np.cos(turn), np.sin(turn), 0])
    off = rounding_mm(np.array([[-before, 0, 0], [0, 0, 0], behind * way]), NONE, np.zeros(3, bool), rounding)
    middle = min(rounding, before / 2, behind / 2) * (way - [1, 0, 0]) / 4
    assert off == pytest.approx([0, np.linalg.norm(middle), 0], abs=1e-12)


def test_an_arc_that_goes_on_as_a_line_has_no_corner() -> None:
    """A quarter of a circle whose tangent at the end is x, and a line along x or along y."""
    position = np.array([[0.0, 0, 0], [10, 10, 0], [20, 10, 0]])
    via = NONE.copy()
    via[1] = [10 - 10 * np.cos(np.pi / 4), 10 * np.sin(np.pi / 4), 0]
    circular = np.array([False, True, False])
    assert rounding_mm(position, via, circular, 1.0)[1] == pytest.approx(0, abs=1e-9)
    position[2] = [10, 20, 0]
    assert rounding_mm(position, via, circular, 1.0)[1] == pytest.approx(np.sin(np.pi / 4) / 2)


def test_a_turn_on_the_spot_is_never_rounded() -> None:
    position = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0]])
    assert rounding_mm(position, NONE, np.zeros(3, bool), 0.3)[1] == np.inf
