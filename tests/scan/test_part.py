"""Identity goes from the recording's attributes, or from the run, to the artefacts."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.artefacts import Part, PartNames, Recording
from workbench.errors import InputError, PipelineError
from workbench.scan import fuse, read

Build = Callable[..., Path]


@pytest.fixture
def recording(build: Build) -> Recording:
    return read(recording=build())


def test_attributes_of_the_file_are_read(build: Build) -> None:
    said = {"operator": "A. Smith", "sensor_calibrated_at": "2026-03-31", "simulated": np.int64(0)}
    found = read(recording=build(lambda file: file.attrs.update(said))).part
    assert found == Part(part_id="A-7", operator="A. Smith", sensor_calibrated_at="2026-03-31", simulated=False)


def test_the_run_may_say_what_the_file_does_not(build: Build) -> None:
    assert read(recording=build(), part=PartNames(drawing="D 1/B")).part == Part(part_id="A-7", drawing="D 1/B")


def test_a_contradiction_is_told_and_the_run_is_believed(build: Build) -> None:
    with pytest.warns(UserWarning, match="part_id: the file says 'A-7', the run '8'"):
        assert read(recording=build(), part={"part_id": 8}).part.part_id == "8"


@pytest.mark.parametrize(("name", "value"), [("recorded_at", "31.3.2026"), ("simulated", 2), ("operator", 7)])
def test_what_the_format_does_not_allow_is_refused(build: Build, name: str, value: Any) -> None:
    with pytest.raises(InputError, match=name):
        read(recording=build(lambda file: file.attrs.__setitem__(name, value)))


def test_a_misspelt_name_is_refused(build: Build) -> None:
    with pytest.raises(PipelineError, match="part"):
        read(recording=build(), part={"partid": "7"})


def test_the_calibration_in_use_is_named(recording: Recording, tmp_path: Path) -> None:
    assert fuse(recording).part.hand_eye == "the recording's own"
    file = tmp_path / "handeye.json"
    pose = recording.flange_from_profiler
    assert pose is not None
    document = {"flange_from_profiler": pose.tolist(), "volume_u_mm": 0.08, "part": {"recorded_at": "2026-02-01"}}
    file.write_text(json.dumps(document))
    part = fuse(recording, hand_eye=file).part
    assert (part.part_id, part.hand_eye) == ("A-7", "handeye.json")
    assert (part.hand_eye_u_mm, part.hand_eye_calibrated_at) == (0.08, "2026-02-01")
