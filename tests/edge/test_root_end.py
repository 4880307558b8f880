"""What the brightness of the root face's last pixel tells of where it ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.drawn.plates import random_recipe
from workbench.artefacts import ROOT_FACE, Cloud
from workbench.cloud import denoise
from workbench.edge.faces import TrackedFaces, find_faces
from workbench.edge.root_end import last_pixel_fill
from workbench.scan import fuse
from workbench.synthetic import simulate_recording

FULL, FILLED, SPECKLE = 1000.0, 0.6, 0.05


@pytest.fixture(scope="module")
def tracked() -> tuple[Cloud, TrackedFaces]:
    recording, truth = simulate_recording(random_recipe("straight", 12))
    cloud = denoise(fuse(recording))
    return cloud, find_faces(cloud, float(truth.root_mm.mean()), float(truth.bevel_deg.mean()))


def lit(cloud: Cloud, faces: TrackedFaces, filled: float) -> Cloud:
    """Every pixel of one brightness, but for speckle, and the last one of the root face of `filled` of it."""
    bright = FULL * (1.0 + SPECKLE * np.random.default_rng(2).normal(size=cloud.keep.shape))
    bright[np.arange(len(bright)), np.abs(faces.end_column)] *= filled
    return replace(cloud, brightness=bright.astype(np.uint16))


def test_the_last_pixel_tells_what_the_face_fills_of_it(tracked: tuple[Cloud, TrackedFaces]) -> None:
    cloud, faces = tracked
    fill, sigma = last_pixel_fill(lit(cloud, faces, FILLED), faces)
    known = np.isfinite(fill)
    assert known.mean() > 0.5
    assert abs(np.median(fill[known]) - FILLED) < 0.02
    assert (sigma[known] >= 0.1).all()


def test_a_sensor_that_tells_the_brightest_part_of_a_pixel_tells_nothing(tracked: tuple[Cloud, TrackedFaces]) -> None:
    cloud, faces = tracked
    assert np.isnan(last_pixel_fill(lit(cloud, faces, 1.0), faces)[0]).all()


def test_saturated_and_unrecorded_pixels_tell_nothing(tracked: tuple[Cloud, TrackedFaces]) -> None:
    cloud, faces = tracked
    white = lit(cloud, faces, FILLED)
    assert white.brightness is not None
    white.brightness[faces.labels == ROOT_FACE] = 65535
    assert np.isnan(last_pixel_fill(white, faces)[0]).all()
    assert np.isnan(last_pixel_fill(replace(cloud, brightness=None), faces)[0]).all()
