"""The score over drawn parts: that parts are kept, methods are judged, and results are of the parts."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.open.rivals import rival
from bench.score.errors import process
from bench.score.measure import measure
from bench.score.parts import GROUPS, Part, part
from bench.score.table import table
from tests.seldom import seldom
from workbench.errors import InputError


def test_a_robots_error_has_its_strength_and_length() -> None:
    way = np.arange(0.0, 4000.0, 0.5)
    drawn = process(np.random.default_rng(5), way, 5.0)
    assert drawn.std(axis=0) == pytest.approx(1.0, abs=0.1)
    for lag_mm in (2.0, 5.0, 8.0):
        k = round(lag_mm / 0.5)
        assert (drawn[:-k] * drawn[k:]).mean() == pytest.approx(np.exp(-((lag_mm / 5.0) ** 2) / 2), abs=0.08)


def straight(tmp_path: Path) -> Part:
    stations = np.linspace([0.0, 0.0, 0.0], [90.0, 0.0, 0.0], 91)
    truth = {
        "position_mm": stations.tolist(),
        "seen": [True] * 91,
        "root_mm": np.linspace(1.0, 2.0, 91).tolist(),
        "bevel_deg": [40.0] * 91,
    }
    return Part("none", 0, tmp_path / "none.h5", truth, {"kind": "milled"}, "")


def test_a_verdict_pass_on_a_section_far_off_is_counted(tmp_path: Path) -> None:
    def method(recording: Path, declared: Any) -> dict[str, Any]:
        values = {"root_u_mm": 0.01, "bevel_deg": 40.0, "bevel_u_deg": 0.5, "verdict": "pass"}
        places = ((12.0, 0.01), (45.0, 0.5))
        return {"sections": [{"origin_mm": [x, 0, 0], "root_mm": 1.0 + x / 90.0 + e, **values} for x, e in places]}

    result = measure(straight(tmp_path), method, "sharp", {})
    assert result.found["root_mm"].error == pytest.approx([0.01, 0.5])
    assert result.passed_wrongly == 1


@pytest.mark.parametrize("fault", [InputError("file", "no bevel"), ZeroDivisionError("oh")])
def test_an_engine_that_refuses_or_crashes_is_priced(tmp_path: Path, fault: Exception) -> None:
    def method(recording: Path, declared: object) -> dict[str, object]:
        raise fault

    result = measure(straight(tmp_path), method, "sharp", {})
    assert result.refused
    assert bool(result.crashed) == isinstance(fault, ZeroDivisionError)
    assert "| sharp | none | `root_mm` | 1 | 1 | 1.000 |" in table([result])


@pytest.mark.parametrize("group", ["sharp", *seldom("raw")])
def test_a_kept_part_is_measured_by_the_product(tmp_path: Path, group: str) -> None:
    first = part("outside", GROUPS[group].recordings, 3, tmp_path)
    told = json.loads(first.recording.with_suffix(".json").read_text())
    assert len(told["truth"]["position_mm"]) == len(told["truth"]["seen"])
    written = first.recording.stat().st_mtime_ns
    again = part("outside", GROUPS[group].recordings, 3, tmp_path)
    assert again.truth == first.truth
    assert first.recording.stat().st_mtime_ns == written
    result = measure(again, rival("product").measure, group, GROUPS[group].declared)
    assert not result.refused
    for name, found in result.found.items():
        limit = 0.1 if name.endswith("mm") else 0.5  # far beyond what noise does; a wrong truth is off by more
        assert len(found.error) >= 9
        assert np.abs(found.error).max() < limit
