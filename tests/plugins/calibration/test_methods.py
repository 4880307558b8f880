"""The other methods, each one parameter of the stage: exact on exact data, honest on noisy data."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.calibration.faces import TRUE, off, squared
from tests.plugins.calibration.conftest import NOMINAL, cell, off_design, postures, recording
from workbench.api import InputError
from workbench.plugins import calibration

EXACT: dict[str, Any] = {"pose_noise_mm": 1e-3, "pose_noise_deg": 1e-4, "sphere_radius_u_mm": 1e-3}


def three_by_three(rng: np.random.Generator) -> Any:
    """Three orientations, three positions each: 9 postures in which pairs of pure translation exist."""
    tilts = Rotation.from_rotvec(np.radians([[20.0, 0.0, 5.0], [-12.0, 17.0, 0.0], [-8.0, -18.0, 10.0]]))
    return np.repeat((tilts * NOMINAL).as_matrix(), 3, axis=0), postures(rng, 9)[1]


@pytest.mark.parametrize(("method", "most"), [("bundle", 0.01), ("analytic", 0.01), ("genetic", 0.2)])
def test_exact_data_give_the_pose(method: Any, most: float) -> None:
    """Profiles to 1 um; the genetic algorithm comes as near as 100 generations bring it, the same each time."""
    rng = np.random.default_rng(7)
    rec = recording(rng, cell(rng, *three_by_three(rng), 0.0, 0.0), off_design(rng, 8.0, 20.0), noise_mm=1e-3)
    arcs = calibration.circles(rec)
    first, again = (calibration.hand_eye(arcs, rec, method=method, seed=1, **EXACT)[0] for _ in range(2))
    assert np.abs(off(first) * [1, 1, 1, 100, 100, 100]).max() < most
    assert (first.flange_from_profiler == again.flange_from_profiler).all()


@pytest.mark.parametrize("method", ["analytic", "genetic"])
def test_noisy_data_give_it_within_what_the_method_propagates(method: Any) -> None:
    distances = []
    for seed in range(2 if method == "genetic" else 4):
        rng = np.random.default_rng(seed)
        rec = recording(rng, cell(rng, *three_by_three(rng)), off_design(rng, 5.0, 15.0))
        pose, found, _ = calibration.hand_eye(calibration.circles(rec), rec, method=method)
        distances.append(squared(pose))
        assert found.warnings[-1].startswith(f"method '{method}' is for comparison")
    assert np.median(distances) < 14  # six unknowns: 5.3 is usual


@pytest.mark.parametrize(
    ("method", "design", "words"),
    [("genetic", None, "/hand_eye is missing"), ("analytic", TRUE, "share the flange's orientation")],
)
def test_what_a_method_needs_is_asked_for(rng: np.random.Generator, method: Any, design: Any, words: str) -> None:
    rec = recording(rng, cell(rng, *postures(rng, 9)), design)
    with pytest.raises(InputError, match=words):
        calibration.hand_eye(calibration.circles(rec), rec, method=method)
