"""Lines cut by a standing cylinder with a flat or a ball end: against points on the cutter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.synthetic.milling import Lines, Sweep, cut_lines

RADIUS, TIP = 5.0, 6.0
X, Y = np.linspace(-4, 4, 81), np.linspace(-3, 3, 61)  # of lines along z
LYING = np.stack([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]], axis=-1)  # axis along y, x of the tool downwards


@pytest.mark.parametrize("ball", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_a_standing_cutter_leaves_its_own_surface(seed, ball):
    """However it leans: cut points lie on its flank or its end, and just above them is its inside."""
    rng = np.random.default_rng(seed)
    frame = Rotation.from_rotvec(rng.normal(0, 0.8, 3)).as_matrix() @ LYING
    position, twice = rng.uniform(-1.5, 1.5, 3), np.ones((2, 1))
    base, along, up = (X[:, None] * [[1.0, 0, 0]], *(np.tile(one, (len(X), 1)) for one in np.eye(3)[1:]))
    height = np.full((len(X), len(Y)), np.inf)
    columns = np.array([0]), np.array([len(X)])
    tool = Sweep(
        twice * position, twice * frame[:, 0], twice * frame[:, 2], RADIUS * np.ones(2), RADIUS, TIP, ball, *columns
    )
    cut_lines(
        height, Lines(base, along, up, Y[0], 0.1, np.full(height.shape, -50.0)), np.full(len(height), np.inf), tool, 0.1
    )
    cut = np.isfinite(height)
    assert cut.sum() > 100

    def inside(at):
        offset = at - (position - RADIUS * frame[:, 0])
        along = offset @ frame[:, 2]
        aside = np.linalg.norm(offset - along[..., None] * frame[:, 2], axis=-1)
        if ball:
            return np.hypot(aside, np.maximum(along - TIP, 0.0)) - RADIUS
        return np.maximum(aside - RADIUS, along - TIP)  # below 0: inside

    at, up = np.stack([*np.meshgrid(X, Y, indexing="ij"), np.where(cut, height, 0.0)], axis=-1), np.array([0, 0, 1.0])
    assert np.abs(inside(at)[cut]).max() < 1e-9
    assert (inside(at + 1e-4 * up) < 1e-9)[cut].mean() > 0.99  # but where the line only touches
    for below in (1e-4, 0.3, 5.0):
        assert (inside(at - below * up) > -1e-9)[cut].all()
    assert all((inside(at[~cut] + z * up) > -1e-6).all() for z in np.linspace(-20, 20, 81))
