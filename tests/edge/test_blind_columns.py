"""Columns that never return, where the root face ends: how far it reaches is in u, not in the value."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.drawn.plates import random_recipe
from tests.seldom import seldom
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.edge.faces import find_faces
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic import simulate_recording


@pytest.mark.parametrize("columns", [8, 30, *seldom(4)])
def test_a_root_face_that_ends_behind_blind_columns_is_right(columns: int) -> None:
    """Or rests on a condition, where more are blind than dirt makes."""
    recording, truth = simulate_recording(random_recipe("partial_view", 5_250_201))  # it lies still; a table behind
    last = np.abs(find_faces(denoise(fuse(recording)), 1.5, 40.0).end_column)
    z = recording.z_mm.copy()
    first = int(np.median(last[last > 0])) - min(columns // 2, 4)
    z[:, first : first + columns] = np.nan
    edge = segment(denoise(fuse(replace(recording, z_mm=z))))
    assert ("window_end" in [one.name for one in edge.unseen]) == (columns == 30)
    if columns == 30:
        return
    found = sections(edge).sections
    told = [one for one in found if one.values["root_mm"] is not None]
    assert len(told) > 6
    off = [abs(one.values["root_mm"] - float(truth.root_mm_at(np.array([one.origin_mm]))[0])) for one in told]
    assert all(error < 3.0 * one.values["root_u_mm"] for error, one in zip(off, told, strict=True))
    wide = max(one.values["root_u_mm"] for one in told)
    assert wide > 0.1 * columns * 0.05  # at least a good part of the step over them
