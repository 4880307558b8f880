"""What frames say about the edge where they do not advance, where a ledge or a filter of the sensor misleads them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from bench.drawn.plates import random_recipe
from bench.odd_plates import odd_plate
from tests.seldom import seldom
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.errors import InputError
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic import simulate_recording

Scans = Callable[..., Any]


def test_frames_that_do_not_advance_are_refused(scanned: Scans) -> None:
    cloud = scanned().cloud
    still = replace(cloud, base_from_profiler=np.tile(cloud.base_from_profiler[100], (len(cloud.keep), 1, 1)))
    with pytest.raises(InputError, match=r"expected at least 3 frames that see the edge along at least 1 mm of it"):
        segment(still)


def test_a_bevel_above_a_ledge_is_no_root_face() -> None:
    """Upper surface and bevel were taken for bevel and root face, and the ledge beyond for a burr."""
    part = odd_plate("ledge of 0.05 to 0.5 mm", 1618, False)
    up = tuple(part.base_from_section[:3, 1])
    for given, told in ({}, "no edge in view"), ({"upper_side": up}, r"complement_nearer_deg: 1\d.*, limit 5"):
        with pytest.raises(InputError, match=told):
            segment(denoise(fuse(part.recording)), root_nominal_mm=3.0, bevel_nominal_deg=40.0, **given)


@pytest.mark.parametrize(
    ("seed", "most_deg", "smooth"),
    [
        (2, 0.08, partial(gaussian_filter1d, sigma=0.8)),
        (9_995_000, 0.12, partial(uniform_filter1d, size=3)),
        *seldom((4, 0.08, partial(gaussian_filter1d, sigma=0.8))),
    ],
)
def test_a_filter_of_the_sensor_bends_no_face(seed: int, most_deg: float, smooth: Callable[..., Any]) -> None:
    """It mixes both faces beside their corner: uncorrected, bevels above narrow root faces are 0.3 deg off."""
    recording, truth = simulate_recording(random_recipe("straight", seed))
    seen = np.isfinite(recording.z_mm)
    total, weight = (smooth(of.astype(float), axis=1) for of in (np.where(seen, recording.z_mm, 0.0), seen))
    filtered = np.where(seen, total / np.maximum(weight, 1e-3), np.nan).astype(np.float32)
    root, bevel = (round(float(of.mean()), 1) for of in (truth.root_mm, truth.bevel_deg))
    cloud = denoise(fuse(replace(recording, z_mm=filtered)))
    found = sections(segment(cloud, root_nominal_mm=root, bevel_nominal_deg=bevel)).sections
    off = [one.values["bevel_deg"] - float(truth.bevel_deg_at(one.origin_mm[None])[0]) for one in found]
    assert abs(np.median(off)) < most_deg
    assert np.max(np.abs(off) / [one.values["bevel_u_deg"] for one in found]) < 2.5
