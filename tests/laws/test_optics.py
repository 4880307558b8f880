"""What thick sheets of light and blurred optics do to an edge's last pixels is no rounding, and is in u."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.score import outsider
from bench.score.measure import alone
from bench.score.parts import Drawn
from bench.score.triangulated import made, ordinary


def drawn(seed: int, footprint: float) -> Drawn:
    """A sharp edge over nothing, seen by fine columns with a footprint of so many."""
    part, eye, led = ordinary(np.random.default_rng(seed), "milled", seed, 30.0, 45.0)
    eye = replace(eye, columns=1024, threshold=0.02, footprint=footprint, bright=False)
    return made(replace(part, table_mm=None), eye, led, seed, {}, "")


def hooked(z: np.ndarray, by_mm: tuple[float, ...]) -> np.ndarray:
    """Profiles whose returns at either end are moved, from the very last on."""
    seen, out = np.isfinite(z), z.copy()
    rows, first, last = np.arange(len(z)), seen.argmax(axis=1), z.shape[1] - 1 - seen[:, ::-1].argmax(axis=1)
    for k, by in enumerate(by_mm):
        out[rows, first + k] += by
        out[rows, last - k] += by
    return out


@pytest.mark.parametrize(("seed", "by_mm"), [(1, ()), (8, (-0.02, -0.005))], ids=["blurred", "hooked"])
def test_what_optics_do_to_the_last_pixels_lengthens_no_root_face(seed: int, by_mm: tuple[float, ...]) -> None:
    """Over 2.4 columns: 2.3 u too long. Where the sheet moves the last two as well: 0.17 mm too long, or u 0.04 mm."""
    of = drawn(seed, 2.4)
    z = hooked(of.recording.z_mm, by_mm)
    root = alone(of._replace(recording=replace(of.recording, z_mm=z))).found["root_mm"]
    assert np.abs(root.error / root.u).max() < 2.0
    assert root.u.max() < 0.03


def test_a_face_that_hardly_returns_shows_no_error_of_the_sensor() -> None:
    """Frames that lack it show no end that moves: a rounding was an error of 28 um, and the bevel's u 1.1 deg."""
    found = alone(outsider.below(18_900_001)).found["bevel_deg"]
    assert found.u.max() < 0.1
    assert (np.abs(found.error) < 3.0 * found.u).all()
