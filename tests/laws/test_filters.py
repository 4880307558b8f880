"""What a sensor's filter does to a recording is within what its inspection says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, gaussian_filter1d, median_filter, uniform_filter1d

from tests.seldom import seldom
from workbench import inspect
from workbench.artefacts import Inspection, Recording
from workbench.cloud import denoise
from workbench.edge import segment, segment_groove
from workbench.errors import InputError
from workbench.scan import fuse, read

MOST = 2.0  # times both u, and the part is another draw of its noise
WIDEST = 5.0  # times u without the filter
LEAST = 4  # sections of nine that are measured before and after: tack welds hide some


def measured(name: str, scan: Recording) -> Inspection:
    points = denoise(fuse(scan))
    return inspect.groove(segment_groove(points)) if name == "groove" else inspect.sections(segment(points))


@cache
def as_it_is(name: str) -> tuple[Recording, Inspection]:
    scan = read(recording=f"data/synthetic/{name}.h5")
    return scan, measured(name, scan)


def over_columns(z: np.ndarray) -> np.ndarray:
    """The mean of what returned in three columns."""
    seen = np.isfinite(z)
    total, count = (uniform_filter1d(of.astype(float), 3, axis=1) for of in (np.where(seen, z, 0.0), seen))
    return np.where(seen, total / np.maximum(count, 1e-9), np.nan)


def over_frames(z: np.ndarray) -> np.ndarray:
    before = np.maximum(np.arange(len(z))[:, None] - np.arange(3), 0)
    return np.mean([z[before[:, k]] for k in range(3)], axis=0)


def dropped(z: np.ndarray) -> np.ndarray:
    """Three columns on both sides of every lost one, of which some are within the faces."""
    lost = ~np.isfinite(z) | (np.random.default_rng(5).random(z.shape) < 0.002)
    return np.where(binary_dilation(lost, np.ones((1, 7), bool)), np.nan, z)


FILTERS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "mean over three columns": over_columns,
    "mean over three frames": over_frames,
    "three columns dropped beside lost ones": dropped,
    "rounded to 0.02 mm": lambda z: np.round(z / 0.02) * 0.02,
}


EACH = [(kind, name) for kind in FILTERS for name in ("milled_edge", "groove")]


@pytest.mark.parametrize(("kind", "name"), [*EACH[:3], EACH[5], EACH[6], *seldom(EACH[3], EACH[4], EACH[7])])
def test_a_filter_moves_no_value_by_more_than_its_uncertainty(kind: str, name: str) -> None:
    scan, before = as_it_is(name)
    after = measured(name, replace(scan, z_mm=FILTERS[kind](scan.z_mm).astype(np.float32)))
    pairs = [(old.values, new.values) for old, new in zip(before.sections, after.sections, strict=True)]
    for quantity in ("gap_mm", "depth_mm") if name == "groove" else ("root_mm", "bevel_deg"):
        u = quantity.replace("_mm", "_u_mm").replace("_deg", "_u_deg")
        both = [(old, new) for old, new in pairs if None not in (old[quantity], new[quantity])]
        assert len(both) >= LEAST
        for old, new in both:
            assert abs(new[quantity] - old[quantity]) < MOST * np.hypot(new[u], old[u]), quantity
            assert new[u] < WIDEST * old[u], quantity


@pytest.mark.parametrize("name", ["milled_edge", "groove"])
def test_a_rough_face_is_no_filter_and_a_median_of_it_is_one(name: str) -> None:
    """Roughness that lasts some columns makes neighbours alike without any filter."""
    scan, _ = as_it_is(name)
    rough = gaussian_filter1d(np.random.default_rng(10_239_000).normal(size=scan.z_mm.shape), 3.0, axis=1)
    z = np.round((scan.z_mm + 0.05 * rough / rough.std()) / 0.01) * 0.01
    fuse(replace(scan, z_mm=z.astype(np.float32)))
    seen = np.isfinite(z)
    held = median_filter(np.where(seen, z, 1e3), (1, 3))
    with pytest.raises(InputError, match="median filter"):
        fuse(replace(scan, z_mm=np.where(seen, held, np.nan).astype(np.float32)))
