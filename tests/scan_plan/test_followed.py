"""A scan that was planned by taught points is driven in the simulated cell as planned, the part raw."""

from __future__ import annotations

import numpy as np
import pytest

from tests.scan_plan.test_plan import DATA, SENSOR
from workbench import cloud, edge, scan, twin
from workbench.artefacts import PlannedScan
from workbench.errors import InputError
from workbench.scan_plan import plan

RECIPE = DATA / "synthetic" / "raw_arc.json"


def test_a_raw_edge_is_scanned_from_end_to_end_as_planned() -> None:
    part = twin.part(recipe=RECIPE)
    made = plan(taught=twin.teach(part), sensor=SENSOR, raw=True, wanted_root_mm=0.02, wanted_bevel_deg=0.1)
    planned = next(one for one in made if isinstance(one, PlannedScan))
    (course,) = planned.courses
    recording = twin.scan(part, planned)
    fused = cloud.denoise(scan.fuse(recording))
    assert recording.x_mm.shape[1] == 1000  # columns of the shipped sensor, not of the recipe's
    ways = np.linalg.norm(fused.base_from_profiler[:, None, :3, 3] - course.base_from_profiler[None, :, :3, 3], axis=2)
    assert ways.min(axis=1).max() < 1.0
    found = edge.segment_raw(fused, upper_side=(0.0, 0.0, 1.0))
    assert found.arc_length_mm[-1] > 145.0
    assert np.isfinite(found.position_mm).all()


def test_a_plan_needs_to_know_where_the_edge_is() -> None:
    with pytest.raises(InputError, match="where the edge is"):
        plan(sensor=SENSOR)
