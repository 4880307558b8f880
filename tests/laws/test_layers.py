"""Primer that was masked beside an edge, or scale that came off there, changes nothing of a prepared plate."""

from __future__ import annotations

import numpy as np
import pytest

from bench.odd_plates import Corners, drawn_above, ledge
from bench.outside import simulate
from bench.recordings import frames
from tests.seldom import seldom
from workbench.artefacts import Preparation
from workbench.cloud import denoise
from workbench.edge import segment_preparation
from workbench.scan import fuse
from workbench.units import DEG

ABOVE = ledge(1.2, 40.0, 6.0)


def measured(seed: int, above: Corners) -> Preparation:
    """A nose of which every third frame is scanned."""
    recording = simulate(seed, False, drawn_above(1.5, 40.0 * DEG, above)).recording
    return segment_preparation(denoise(fuse(frames(recording, np.arange(0, len(recording.time_s), 3)))))


@pytest.mark.parametrize(("height_mm", "strip_mm", "seed"), [(0.1, 3.0, 4), *seldom((-0.08, 4.0, 4), (0.05, 2.0, 5))])
def test_a_layer_beside_the_edge_changes_no_size(height_mm: float, strip_mm: float, seed: int) -> None:
    """The upper surface was a chord over both levels, or the strip: bevels 0.7 deg off, u 10 to 30 times as large."""
    u, v = ABOVE[-1]
    layer = ((u - strip_mm, v), (u - strip_mm, v + height_mm))
    bare, found = measured(seed, ABOVE), measured(seed, (*ABOVE, *layer))
    assert any("beside its edge the upper surface of the plate" in one for one in found.warnings)
    for name, size in found.sizes.items():
        other = bare.sizes[name]
        assert np.nanmax(np.abs(size.value - other.value) / other.u) < 3.0, name
        assert np.nanmedian(size.u) < 1.5 * np.nanmedian(other.u), name
