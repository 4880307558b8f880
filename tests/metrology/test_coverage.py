"""The uncertainties hold through the whole chain, from recording to sections, on fixed parts of both simulators."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from bench.score.measure import Result, named
from tests.seldom import seldom
from workbench.units import Float

SEED = 17  # drawn once; nothing was chosen by what it gives
HARD = [
    *("swept_lost_edge", "swept_ghosts"),
    *seldom(
        "swept_rounded", "swept_burr_out", "swept_burr_in", "swept_bowed", "swept_lost_blocks", "swept_fixed_pattern"
    ),
    *seldom("swept_time_offset", "swept_mixed"),
]
SHAPES = ["swept_ring", *seldom("swept_twist", "swept_helix", "swept_saddle", "swept_reversal")]
MOST_U_DEG = 0.5  # of a useful bevel angle: the tolerance is 1 deg


@cache
def measured(condition: str) -> Result:
    return named(condition, SEED)


def ratios(result: Result, quantity: str) -> Float:
    """|error| / u of all measured values."""
    found = result.found[quantity]
    return np.abs(found.error) / found.u


@pytest.mark.parametrize("condition", HARD)
def test_what_disturbs_is_in_the_uncertainty_or_refused(condition: str) -> None:
    result = measured(condition)
    assert not result.crashed
    assert all(ratios(result, quantity).max(initial=0.0) <= 4 for quantity in ("root_mm", "bevel_deg"))


@pytest.mark.parametrize("condition", SHAPES)
def test_turning_and_closed_edges_are_measured(condition: str) -> None:
    result = measured(condition)
    assert not result.refused
    assert not result.crashed
    root = result.found["root_mm"]
    assert np.isin(root.wanted, root.piece).mean() > 0.8
    assert result.found["bevel_deg"].u.mean() < MOST_U_DEG
    assert max(ratios(result, quantity).max() for quantity in ("root_mm", "bevel_deg")) <= 4


# Parts that were wrong by 3.6 to 106 u, each for a reason of its own.
ONCE_WRONG = {
    "a rough face with a rounded edge": ("swept_raw_mixed", 5_250_014, "along_m_mm"),
    "an end lost over most of the edge": ("swept_raw_mixed", 5_250_005, "along_m_mm"),
    "a level that is not shifted": ("swept_raw_burr_in", 5_260_007, "along_m_mm"),
    "texture that is no roughness": ("swept_raw_mixed", 5_250_019, "axis_deg"),
    "a change under a clamp": ("swept_mixed", 5_270_033, "root_mm"),
    "a level lost for a third of the edge": ("swept_lost_edge", 5_270_035, "root_mm"),
}


@pytest.mark.parametrize("name", [*list(ONCE_WRONG)[:1], *seldom(*list(ONCE_WRONG)[1:])])
def test_what_was_wrong_once_is_in_its_uncertainty(name: str) -> None:
    condition, seed, quantity = ONCE_WRONG[name]
    result = named(condition, seed)
    assert not result.refused
    assert ratios(result, quantity).max() < 3.0
