"""Two J preparations make a U: a land between fillet and root face changes nothing of what is above it."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bench.odd_plates import j_shape
from bench.outside import FAR_MM
from bench.recordings import frames
from tests.edge.test_odd_grooves import GAP, ROOT, THICK, groove, mirrored
from tests.seldom import seldom
from workbench.artefacts import Cloud, Groove
from workbench.cloud import denoise
from workbench.edge import segment_groove
from workbench.scan import fuse

RADIUS_MM, FLANK_DEG = 4.0, 14.0


@cache
def joined(land_mm: float, seed: int) -> Cloud:
    """A U of two J preparations with a land, every third frame of half its scan."""
    above = j_shape(RADIUS_MM, FLANK_DEG, land_mm, THICK - ROOT)
    begin = ((-FAR_MM, 0.0), (-0.5 * GAP, 0.0), (-0.5 * GAP, ROOT))
    left = (*begin, *((u - 0.5 * GAP, v + ROOT) for u, v in above), (-FAR_MM, THICK))
    recording = groove(seed, (left, mirrored(left))).recording
    return denoise(fuse(frames(recording, np.arange(0, len(recording.time_s) // 2, 3))))


@cache
def as_usual(land_mm: float, seed: int) -> Groove:
    return segment_groove(joined(land_mm, seed))


@pytest.mark.parametrize(("land_mm", "seed"), [(1.5, 10_000_013), *seldom((0.0, 10_000_010), (0.5, 10_000_011))])
def test_a_land_at_the_root_is_no_part_of_the_fillet(land_mm: float, seed: int) -> None:
    """Twelve of twelve were refused: a bent bevel, no two plates; in another simulator, a fillet off any circle."""
    found = as_usual(land_mm, seed)
    assert found.type == "U"
    for name, exact in {"root_radius_mm": RADIUS_MM, "depth_mm": THICK - ROOT, "bevel_left_deg": FLANK_DEG}.items():
        size = found.sizes[name]
        assert np.nanmax(np.abs(size.value - exact) / size.u) < 3.0, name
    assert np.nanmedian(found.sizes["root_radius_mm"].u) < 0.02


def test_a_sensor_that_bends_an_arc_to_another_arc_is_in_u_of_its_radius(tmp_path: Path) -> None:
    """A declared linearity of 7 um left nothing beside the circle: 8.8 u."""
    told = tmp_path / "sensor.json"
    told.write_text(json.dumps({"name": "one", "linearity_mm": 0.007, "linearity_length_mm": 9.0}), encoding="utf-8")
    cloud = joined(1.5, 10_000_013)
    usual, declared = as_usual(1.5, 10_000_013), segment_groove(cloud, sensor=str(told))
    more, less = (np.nanmedian(one.sizes["root_radius_mm"].u) for one in (declared, usual))
    assert more > 5.0 * less
