"""A scan that was planned by taught points is driven in the simulated cell as planned, the part raw."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.scan_plan.test_plan import DATA, SENSOR
from workbench import cloud, edge, scan, twin
from workbench.artefacts import Document, PlannedScan, Recording
from workbench.errors import InputError
from workbench.scan import write
from workbench.scan_plan import plan
from workbench.synthetic import Workpiece

RECIPE = DATA / "synthetic" / "raw_arc.json"


class Followed(NamedTuple):
    """A raw part, its planned scan and that one's file, and what the simulated cell recorded of it."""

    part: Workpiece
    planned: PlannedScan
    content: bytes
    recording: Recording


@pytest.fixture(scope="module")
def followed() -> Followed:
    part = twin.part(recipe=RECIPE)
    made = plan(taught=twin.teach(part), sensor=SENSOR, raw=True, passes=1, frame_rate_hz=120.0)
    planned = next(one for one in made if isinstance(one, PlannedScan))
    content = next(one.content for one in made if isinstance(one, Document))
    return Followed(part, planned, content, twin.scan(part, planned))


def test_a_raw_edge_is_scanned_from_end_to_end_as_planned(followed: Followed) -> None:
    (course,), recording = followed.planned.courses, followed.recording
    fused = cloud.denoise(scan.fuse(recording))
    assert recording.x_mm.shape[1] == 1000  # columns of the shipped sensor, not of the recipe's
    ways = np.linalg.norm(fused.base_from_profiler[:, None, :3, 3] - course.base_from_profiler[None, :, :3, 3], axis=2)
    assert ways.min(axis=1).max() < 1.0
    found = edge.segment_raw(fused, upper_side=(0.0, 0.0, 1.0))
    assert found.arc_length_mm[-1] > 145.0
    assert np.isfinite(found.position_mm).all()


def test_what_was_not_done_as_planned_is_told(followed: Followed, tmp_path: Path) -> None:
    part, planned, content, recording = followed
    file = tmp_path / "scan-plan.json"
    file.write_bytes(content)
    write(recording, tmp_path / "recording.h5")
    fused = scan.fuse(scan.read(recording=tmp_path / "recording.h5"), scan_plan=file)
    assert fused.part.scan_plan == planned.plan_id
    assert fused.checks[-1].finding == "done as planned"

    (course,) = planned.courses
    tilted = course.base_from_profiler[: len(course.base_from_profiler) // 2].copy()
    tilted[:, :3, :3] = tilted[:, :3, :3] @ Rotation.from_euler("y", 4.0, degrees=True).as_matrix()
    other = dataclasses.replace(
        planned, courses=(dataclasses.replace(course, base_from_profiler=tilted, frame_pitch_mm=1.0),)
    )
    document = json.loads(content)
    of_path = json.loads(Path("data/synthetic/paths/raw_arc.json").read_text())["layers"][0]["points"][0]
    assert document["passes"][0]["points"][0].keys() >= of_path.keys() - {"width_mm"}
    document["passes"] += [{**one, "index": 2, "elevation_deg": 80.0} for one in json.loads(content)["passes"]]
    for point in document["passes"][1]["points"]:
        point["position_mm"][2] += 200.0
    file.write_text(json.dumps(document))
    told = scan.fuse(twin.scan(part, other), scan_plan=file).checks[-1]
    for words in (
        "elevation off by 4.",
        "no frame from 7",
        "a frame every 1 mm, planned 0.",
        "pass 2 (80 deg): missing",
        "names plan",
    ):
        assert words in told.finding
    assert told.value == 5
    assert not told.passed

    document["passes"] = document["passes"][1:]
    file.write_text(json.dumps(document))
    nameless = dataclasses.replace(recording, part=dataclasses.replace(recording.part, scan_plan=None))
    assert scan.fuse(nameless, scan_plan=file).part.scan_plan is None  # nothing of that plan was driven


def test_a_plan_needs_to_know_where_the_edge_is() -> None:
    with pytest.raises(InputError, match="where the edge is"):
        plan(sensor=SENSOR)
