"""What lies behind an edge takes pixels that see the edge in part: none, some or all of them, by its brightness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.score.measure import alone
from bench.score.triangulated import sharp
from tests.seldom import seldom


@pytest.mark.parametrize(
    ("seed", "is_recorded"), [(9920009, True), (9980000, False), *seldom((9980049, True), (9980049, False))]
)
def test_a_table_brighter_than_the_face_shortens_no_root_face(seed: int, is_recorded: bool) -> None:
    """It takes every pixel that sees any of it: ends were up to 5.1 u short."""
    drawn = sharp(seed)
    recording = drawn.recording if is_recorded else replace(drawn.recording, intensity=None)
    found = alone(drawn._replace(recording=recording, declared={**drawn.declared, "edge_condition": "sharp"}))
    root = found.found["root_mm"]
    assert np.abs(root.error / root.u).max() < 2.5
    assert np.median(root.u) < 0.015
