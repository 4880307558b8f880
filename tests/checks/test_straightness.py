"""A corner within a face: its turn and its place, and shapes that are none; how far a face bows."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy

from workbench.artefacts import BEVEL_FACE
from workbench.checks.straightness import Straightness, _shape, straightness
from workbench.units import DEG, Float

WIDTH_MM, COLUMNS, FRAMES = 8.0, 160, 30
P = np.linspace(0.0, 1.0, COLUMNS)  # shares of the width


def found(
    shape_mm: Float, noise_mm: float = 0.005, frames: int = FRAMES, columns: int = COLUMNS, turn_deg: float = 30.0
) -> Straightness:
    """Of a face that leans, what it does beside its line (m,) in columns that are spread over it evenly."""
    rng = np.random.default_rng(7)
    along, across = WIDTH_MM * P, shape_mm + rng.normal(0.0, noise_mm, (frames, COLUMNS))
    c, s = np.cos(turn_deg * DEG), np.sin(turn_deg * DEG)
    x, z = c * along - s * across, 100.0 + s * along + c * across
    labels = np.zeros(x.shape, np.uint8)
    labels[:, np.linspace(0, COLUMNS - 1, columns).astype(int)] = BEVEL_FACE
    keep = np.ones(x.shape, bool)
    cloud: Any = SimpleNamespace(x_mm=x.astype(np.float32), z_mm=z.astype(np.float32), keep=keep)
    return straightness(cloud, labels, BEVEL_FACE)


def corner(turn_deg: float, at: float) -> Float:
    return WIDTH_MM * np.tan(turn_deg * DEG) * np.maximum(P - at, 0.0)


@pytest.mark.parametrize("face_deg", [30.0, -140.0])
@pytest.mark.parametrize(("turn_deg", "at"), [(1.5, 0.5), (-1.5, 0.5), (1.5, 0.25), (-2.0, 0.7)])
def test_a_corner_is_found_by_its_turn_and_place(turn_deg: float, at: float, face_deg: float) -> None:
    told = found(corner(turn_deg, at), turn_deg=face_deg)
    assert abs(told.turn) / DEG == pytest.approx(abs(turn_deg), rel=0.1)
    assert min(abs(told.at - at), abs(1.0 - told.at - at)) < 0.05
    assert np.sign(told.turn) == np.sign(found(corner(2.0 * turn_deg, at), turn_deg=face_deg).turn)
    assert np.sign(told.turn) == -np.sign(found(corner(-turn_deg, at), turn_deg=face_deg).turn)


@pytest.mark.parametrize(
    "shape_mm",
    [
        0.0 * P,
        0.05 * (P - 0.5) ** 2,
        -0.1 * P**2,
        np.where(P > 0.5, 0.03, 0.0),
        0.02 * np.sin(40.0 * P),
    ],
    ids=["straight", "bowed", "hollow", "step", "waves"],
)
def test_other_shapes_are_no_corner(shape_mm: Float) -> None:
    told = found(shape_mm)
    assert told.turn == 0.0
    assert abs(told.bow_mm) == pytest.approx(abs(np.polyfit(P, shape_mm, 2)[0]) / 4.0, abs=0.006)


def test_a_corner_that_noise_hides_is_none() -> None:
    assert found(corner(0.5, 0.5), noise_mm=0.001).turn != 0.0
    assert found(corner(0.5, 0.5), noise_mm=0.3).turn == 0.0


def test_less_than_the_sensor_knows_of_itself_is_none() -> None:
    assert found(corner(0.005, 0.5), noise_mm=1e-6).turn == 0.0


def test_few_frames_or_columns_tell_nothing() -> None:
    shape = corner(2.0, 0.5)
    assert [found(shape, frames=n).turn != 0.0 for n in (3, 4)] == [False, True]
    assert [found(shape, columns=n).turn != 0.0 for n in (11, 20)] == [False, True]


def test_noise_that_neighbouring_columns_or_frames_share_makes_no_corner() -> None:
    rng, place = np.random.default_rng(1), (np.arange(12) + 0.5) / 12.0
    smooth = np.exp(-np.abs(np.subtract.outer(np.arange(12.0), np.arange(12.0))) / 3.0)
    for _ in range(200):
        noise = rng.normal(0.0, 0.012, (120, 12)) @ np.linalg.cholesky(smooth).T
        assert _shape(place, noise, 1.2).turn == 0.0
    bent = noise + np.maximum(place - 0.6, 0.0) * 1.2 * np.tan(6.0 * DEG)
    assert _shape(place, bent, 1.2).turn == pytest.approx(6.0 * DEG, rel=0.2)

    for seed in (4, 6, 9):  # rough by 0.15 mm, over 6 frames and a quarter of the width: each had one, of 4 deg
        rough = scipy.ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=(120, COLUMNS)), (6.0, 40.0))
        rough *= 0.15 / rough.std()
        assert found(rough, frames=120).turn == 0.0
        assert found(rough + corner(12.0, 0.5), frames=120).turn != 0.0
