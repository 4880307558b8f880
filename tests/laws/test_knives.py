"""A knife edge is never quite sharp: where nothing is said of it, what it may have lost is in u of gap and depth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bench.score.measure import alone
from bench.score.parts import Drawn
from bench.score.triangulated import made, ordinary
from bench.simulators.triangulated import Course
from tests.seldom import seldom

BLUNTED_MM = 0.04  # of height


def blunted(seed: int) -> Drawn:
    """A V groove whose knife edges are cut off, and the truth of the edges that the bevels had."""
    part, eye, led = ordinary(np.random.default_rng(seed), "groove", seed, 85.0, 95.0)
    bevel = Course(math.radians(35.0))
    part = replace(part, root_mm=Course(BLUNTED_MM), bevel=bevel, gap_mm=Course(3.0), table_mm=None)
    drawn = made(part, replace(eye, footprint=0.8), led, seed, {}, "")
    gap = drawn.truth["gap_mm"] - 2.0 * BLUNTED_MM * math.tan(bevel.mean)
    return drawn._replace(truth={**drawn.truth, "gap_mm": gap, "depth_mm": drawn.truth["depth_mm"] + BLUNTED_MM})


@pytest.mark.parametrize("seed", [3, *seldom(4)])
def test_what_a_knife_edge_has_lost_is_in_u(seed: int) -> None:
    of = blunted(seed)
    found, sharp = (
        alone(of._replace(declared={**of.declared, "edge_condition": condition})).found
        for condition in ("unknown", "sharp")
    )
    for name in ("gap_mm", "depth_mm"):
        assert np.nanmax(np.abs(found[name].error / found[name].u)) < 3.0, name
        assert np.nanmedian(sharp[name].u) < np.nanmedian(found[name].u), name
