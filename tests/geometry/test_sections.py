"""Lines in the section planes: how much a frame's line counts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from workbench.geometry.chains import FaceLines, labelled_lines
from workbench.geometry.curves import fit_curve
from workbench.geometry.sections import section_lines
from workbench.units import Float

FRAMES, COLUMNS, SIGMA_MM = 80, 40, 0.01
ALONG_MM = np.arange(FRAMES, dtype=float)


def lines_of(z: Float) -> FaceLines:
    """Lines through all returns (80, 40) of a face, 1.6 mm wide."""
    x = np.linspace(-0.8, 0.8, COLUMNS)[None]
    return labelled_lines(x.astype(np.float32), z.astype(np.float32), np.ones(z.shape, np.uint8), 1)


def variance_of(face: FaceLines) -> Float:
    """Variance (80,) of each frame's direction on a straight edge, over that by noise alone."""
    pose = np.tile(np.eye(4), (FRAMES, 1, 1))
    pose[:, 1, 3] = ALONG_MM
    curve = fit_curve(pose[:, :3, 3], ALONG_MM, np.zeros(FRAMES, np.int64))
    of_all = np.full(FRAMES, SIGMA_MM)
    found = section_lines(face, np.zeros(FRAMES), pose, np.ones(FRAMES), of_all, curve, ALONG_MM)
    return np.asarray(found.angle_variance * face.sxx / SIGMA_MM**2)


@pytest.mark.parametrize("columns", [0.0, 2.0])
def test_noise_alone_lets_every_frame_count(columns: float) -> None:
    """Also of a sensor whose neighbouring columns share it: so few differ that frames scatter more unevenly."""
    noise = np.random.default_rng(1).normal(0.0, 1.0, (FRAMES, COLUMNS))
    noise = gaussian_filter1d(noise, columns) if columns else noise
    variance = variance_of(lines_of(SIGMA_MM * noise / noise.std()))
    assert np.mean(variance < 1.5) > 0.95


def test_a_line_through_second_returns_counts_less() -> None:
    z = SIGMA_MM * np.random.default_rng(2).normal(0.0, 1.0, (FRAMES, COLUMNS))
    z[::4, 25:31] += 5.0 * SIGMA_MM  # within the strays' limit of so uneven a line
    variance = variance_of(lines_of(z))
    assert np.median(variance[::4]) > 4.0
    assert np.median(variance[1::4]) < 1.1
