"""What `workbench look` makes of a profile and of a recording, before it is told."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bench.drawn.swept import random_swept_recipe
from bench.simulators.swept import simulate_swept
from tests.seldom import seldom
from workbench.look.content import measured
from workbench.look.recorded import judged
from workbench.scan import read

SYNTHETIC = Path(__file__).parents[2] / "data" / "synthetic"


def wedge(seed, correlation):
    """A profile of two lines that meet in (1, 4), 0.05 mm a column, noise of 0.01 mm."""
    rng = np.random.default_rng(seed)
    x = np.arange(-10, 12, 0.05) + rng.uniform(0, 0.05)
    noise = rng.normal(0, 0.01, len(x))
    for i in range(1, len(x)):
        noise[i] = correlation * noise[i - 1] + np.sqrt(1 - correlation**2) * noise[i]
    return x, 4 + np.where(x < 1, 0.2, -0.7) * (x - 1) + noise


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_a_corner_lies_within_its_uncertainty(correlation):
    off = []
    for seed in range(60):
        profile = measured(*wedge(seed, correlation))
        assert (len(profile.lines), len(profile.corners)) == (2, 1)
        corner = profile.corners[0]
        off.append(((corner.x_mm - 1) / corner.x_u_mm, (corner.z_mm - 4) / corner.z_u_mm))
        assert corner.turn_deg == pytest.approx(-np.degrees(np.arctan(0.7) + np.arctan(0.2)), abs=1.0)
    within = (np.abs(off) < 2).mean(axis=0)
    assert (within > 0.87).all(), within  # 95 % expected; 60 draws
    assert 0.6 < np.std(off) < 1.4


@pytest.mark.parametrize("signs", [(-1, 1), (1, -1)])
@pytest.mark.parametrize("name", ["milled_edge", "raw_wavy"])
def test_of_a_mirrored_axis_that_nothing_shows_nothing_is_claimed(name, signs):
    recording = read(recording=SYNTHETIC / f"{name}.h5")
    checks, named = judged(replace(recording, x_mm=recording.x_mm * signs[0], z_mm=recording.z_mm * signs[1]))
    assert all(check.passed for check in checks)
    assert named == ()


@cache
def swaying():
    recording, _ = simulate_swept(random_swept_recipe("swept_sway", 1))
    assert all(check.passed for check in judged(recording)[0])
    return recording


@pytest.mark.parametrize(
    ("signs", "named"),
    [
        ((-1, 1), "the sign of x of the profiles is wrong"),
        *seldom(((1, -1), "the sign of z of the profiles is wrong")),
    ],
)
def test_a_mirrored_axis_is_named_where_the_flange_sways(signs, named):
    """The section then seems to turn with the wrist; data/synthetic has no such motion, so one is simulated."""
    recording = swaying()
    changed = replace(recording, x_mm=recording.x_mm * signs[0], z_mm=recording.z_mm * signs[1])
    checks, found = judged(changed)
    assert "twist_deg" in {check.name for check in checks if not check.passed}
    assert named in found
    assert not any("swapped" in one for one in found)
