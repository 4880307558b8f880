"""Passes of one view share what it hides; one that hides more takes nothing from what another shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.drawn.seeds import nominal
from bench.score.analytic import milled_part
from bench.score.measure import alone
from bench.score.parts import Drawn
from bench.score.triangulated import ordinary
from bench.simulators.triangulated import simulate
from tests.seldom import seldom
from workbench.synthetic import parse_recipe, simulate_recording
from workbench.units import DEG


@pytest.mark.parametrize(("seed", "radius_mm"), [(12_400_001, 0.06), *seldom((12_400_003, 0.1))])
def test_a_pass_that_is_repeated_does_not_make_a_hidden_rounding_known(seed: int, radius_mm: float) -> None:
    """Three passes stated half of one's u, up to 4.6 u off."""
    part, eye, way = ordinary(np.random.default_rng(seed), "milled", seed, 36.0, 48.0)
    part = replace(part, lower_radius_mm=radius_mm)
    declared = {"kind": "milled", **nominal(part.root_mm.mean, part.bevel.mean / DEG)}
    u = []
    for passes in (1, 3):
        drawn = simulate(part, eye, [way] * passes, seed)
        root = alone(Drawn(drawn.recording, drawn.truth, declared, "")).found["root_mm"]
        assert np.max(np.abs(root.error) / root.u) < 3.0
        u.append(np.median(root.u))
    assert u[1] > 0.8 * u[0]


def test_a_pass_that_does_not_see_the_corner_takes_nothing_from_one_that_does() -> None:
    """It raised u of the root face from 0.0051 to 0.0090 mm."""
    below = {"from_mm": 5.0, "to_mm": 55.0, "elevation_deg": -29.0}
    recipe = {"format": "bevel-recipe", "version": 1, "seed": 5, "scanner": {"columns": 500}}
    recipe["part"] = {"length_mm": 60.0}
    u = []
    for passes in ([below], [below, below | {"elevation_deg": 45.0}]):
        root = alone(milled_part(*simulate_recording(parse_recipe(recipe | {"passes": passes})))).found["root_mm"]
        assert np.max(np.abs(root.error) / root.u) < 3.0
        u.append(np.median(root.u))
    assert u[1] < 1.1 * u[0]
