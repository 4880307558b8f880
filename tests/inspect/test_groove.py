"""What a section of a groove states, and what of it is not seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from workbench.artefacts import Groove
from workbench.cloud import denoise
from workbench.edge import segment_groove
from workbench.inspect import groove as inspect_groove
from workbench.scan import fuse, read

RECORDING = Path(__file__).parents[2] / "data" / "synthetic" / "groove.h5"
WANTED = {"gap_mm": 2.4, "gap_tolerance_mm": [-1.0, 1.0]}


@pytest.fixture(scope="module")
def found() -> Groove:
    return segment_groove(denoise(fuse(read(recording=RECORDING))))


def stated(found: Groove, **changed: object) -> list[tuple[float | None, float | None, str]]:
    inspection = inspect_groove(replace(found, **changed), nominal=WANTED)
    return [(one.values["gap_mm"], one.values["gap_u_mm"], one.verdict) for one in inspection.sections]


def test_a_value_without_its_u_is_not_stated_nor_a_u_without_its_value(found: Groove) -> None:
    gap = found.sizes["gap_mm"]
    hole = np.where(np.arange(gap.value.size) < gap.value.size // 3, np.nan, 0.0)
    first, *others = gap.terms
    for part in (
        replace(gap, value=gap.value + hole),
        replace(gap, terms=(replace(first, u=first.u + hole), *others)),
    ):
        told = stated(found, sizes={**found.sizes, "gap_mm": part})
        assert told[:2] == [(None, None, "undecided")] * 2
        assert all(value is not None and verdict == "pass" for value, _, verdict in told[4:])


def test_a_stretch_that_no_frame_shows_states_nothing(found: Groove) -> None:
    seen = np.array(found.seen)
    seen[: seen.size // 3] = False
    told = stated(found, seen=seen)
    assert told[:2] == [(None, None, "undecided")] * 2
    assert all(value is not None for value, _, _ in told[4:])
