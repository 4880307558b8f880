"""Second returns of a part of a face are told from the face: by most of its places, however it bows."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry import tracking
from workbench.geometry.ghosts import PLACES, ghosts

FRAMES, COLUMNS = 40, 200
X = np.linspace(-5.0, 5.0, COLUMNS, dtype=np.float32)


def found(shape_mm: np.ndarray, scatter_mm: np.ndarray | float = 0.0) -> np.ndarray:
    """Share of the frames in which each column (M,) of a bevel of this shape is told to be a ghost."""
    rng = np.random.default_rng(7)
    aside = shape_mm + scatter_mm * rng.random((FRAMES, COLUMNS))
    z = (aside + 0.3 * X + rng.normal(0.0, 0.01, (FRAMES, COLUMNS))).astype(np.float32)
    sums = np.zeros((FRAMES, 4, 8))
    for row, line in zip(z, sums[:, tracking.BEVEL], strict=True):
        dx, dz = X - X.mean(), row - row.mean()
        line[:] = COLUMNS, X.mean(), row.mean(), (dx * dx).sum(), (dx * dz).sum(), (dz * dz).sum(), 0, COLUMNS - 1
    sums[:, tracking.ROOT] = sums[:, tracking.BEVEL]
    every = np.ones((FRAMES, COLUMNS), bool)
    return np.asarray(ghosts(X[None], z, every, sums, np.ones(FRAMES, bool)).mean(axis=0))


@pytest.mark.parametrize("bow_mm", [0.0, 0.1])
@pytest.mark.parametrize(("from_mm", "to_mm"), [(-3.0, 0.0), (1.5, 5.0)])
def test_a_strip_beside_a_face_is_left_out(bow_mm: float, from_mm: float, to_mm: float) -> None:
    strip = (from_mm <= X) & (to_mm >= X)
    told = found(bow_mm * (X / 5.0) ** 2 + 0.08 * strip)
    place = 10.0 / PLACES
    inside = (from_mm + place < X) & (to_mm - place > X)
    outside = (from_mm - place > X) | (to_mm + place < X)
    assert (told[inside] == 1.0).all()
    assert (told[outside] == 0.0).all()


def test_a_strip_of_which_some_returns_are_second_ones_is_told_by_their_scatter() -> None:
    told = found(np.zeros(COLUMNS), 0.15 * ((X > 0.0) & (X < 3.0)))
    assert (told[(X > 0.7) & (X < 2.3)] == 1.0).all()


@pytest.mark.parametrize(
    "shape", [0.1 * (X / 5.0) ** 2, 0.02 * np.sin(X), np.where(X > 0.0, 0.1, 0.0), 0.06 * np.maximum(X - 3.0, 0.0)]
)
def test_a_bow_a_wave_two_halves_and_a_bend_are_no_ghosts(shape: np.ndarray) -> None:
    assert not found(shape).any()


def test_a_pass_without_faces_has_no_ghosts() -> None:
    grid = np.zeros((4, COLUMNS), np.float32)
    assert not ghosts(X[None], grid, grid == 0.0, np.zeros((4, 4, 8)), np.zeros(4, bool)).any()
