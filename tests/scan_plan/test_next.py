"""What would decide an undecided inspection: the pass that is proposed is scanned, and decides what it was said to."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.artefacts import Cloud, Document, Inspection, MilledEdge
from workbench.artefacts.edges import conformity
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.scan_next import next_
from workbench.scan_next.proposal import Size
from workbench.synthetic import parse_recipe, simulate_recording

RECIPE = Path("data/synthetic/milled_edge.json")
CLOSE = (-0.09, 0.09)  # of a root face that goes from 1.46 to 1.6 mm about its nominal size of 1.5


@cache
def scanned(*elevations_deg: float) -> tuple[Cloud, MilledEdge]:
    recipe: dict[str, Any] = json.loads(RECIPE.read_text())
    recipe["passes"] = [{**recipe["passes"][0], "elevation_deg": one} for one in elevations_deg]
    recording, _ = simulate_recording(parse_recipe(recipe, str(RECIPE)))
    cloud = denoise(fuse(recording))
    return cloud, segment(cloud)


def told(*elevations_deg: float, **asked: Any) -> tuple[Inspection, dict[str, Any]]:
    cloud, edge = scanned(*elevations_deg)
    found = sections(edge, **asked)
    made = next_(cloud, edge, found)
    return found, json.loads(made[0].content) if made else {}  # type: ignore[union-attr]


def test_a_decided_part_needs_no_further_pass() -> None:
    for tolerance in ((-0.5, 0.5), (-0.01, 0.01)):
        found, proposal = told(42.0, root_tolerance_mm=tolerance)
        assert found.verdict in ("pass", "fail")
        assert proposal == {}


def test_the_proposed_pass_decides_what_it_was_said_to() -> None:
    nominal = {"root_nominal_mm": 1.5, "root_tolerance_mm": CLOSE}
    before, proposal = told(42.0, **nominal)
    assert before.verdict == "undecided"
    assert max(proposal["probability"]) > 0.5
    after = sections(scanned(42.0, proposal["elevation_deg"])[1], **nominal)
    verdicts = {one.index: one.verdict for one in after.sections}
    assert {verdicts[k] for k in proposal["decided_by_it"]} <= {"pass", "fail"}
    decided = sum(verdicts[k] != "undecided" for k in proposal["undecided_sections"])
    assert decided == pytest.approx(sum(proposal["probability"]), abs=2.0)
    u = [2.0 * one.values["root_u_mm"] for one in after.sections if one.values["root_u_mm"] is not None]
    assert np.median(u) == pytest.approx(proposal["predicted_root_U_mm"], rel=0.5)


@pytest.mark.parametrize("u", [0.2, 0.6, 1.4])
@pytest.mark.parametrize("value", [-0.5, 1.0, 3.0])
def test_the_chance_of_a_verdict_is_that_of_sizes_that_may_come_out(value: float, u: float) -> None:
    """Drawn: the true size, given what is known of it, then what is known with the further pass."""
    before = Size(value, 1.5, 0.0, 4.0)
    learned = np.sqrt(before.u**2 - u**2)
    after = value + np.random.default_rng(3).normal(0.0, learned, 100_000)
    verdicts = [conformity(one, u, 0.0, (0.0, 4.0), 1.645) for one in after.tolist()]
    for chance, verdict in zip(before.decided(u, 1.645), ("pass", "fail"), strict=True):
        assert chance == pytest.approx(verdicts.count(verdict) / after.size, abs=0.006)


def test_a_further_pass_takes_no_verdict_away() -> None:
    """Neither does a prediction that exceeds what is known, nor its reserve: passes tell no less than one of them."""
    for value, now in ((2.0, (1.0, 0.0)), (-2.0, (0.0, 1.0)), (0.3, (0.0, 0.0))):
        for predicted in (1.0, 1.5):
            assert Size(value, 1.0, 0.0, 4.0).decided(predicted, 1.645, 1.15) == pytest.approx(now)


def test_a_part_that_passes_on_a_condition_is_to_be_seen_from_below() -> None:
    cloud, edge = scanned(42.0)
    found = sections(edge, root_tolerance_mm=(-0.15, 0.15), root_nominal_mm=1.55)
    assert {one.verdict for one in found.sections} == {"pass"}
    assert {one.name for one in found.conditions} == {"lost_columns", "shadow"}
    proposal = json.loads(next_(cloud, edge, found)[0].content)  # type: ignore[union-attr]
    assert proposal["elevation_deg"] < -20.0
    assert proposal["undecided_sections"] == []
    assert "lower surface is in view" in proposal["sentence"]
    _, both = scanned(42.0, proposal["elevation_deg"])
    settled = sections(both, root_tolerance_mm=(-0.15, 0.15), root_nominal_mm=1.55)
    assert settled.verdict == "pass", settled.reason


def test_the_file_is_an_edge_for_the_plan_of_a_scan(tmp_path: Path) -> None:
    from workbench.scan_plan import plan

    cloud, edge = scanned(42.0)
    found = sections(edge, root_tolerance_mm=CLOSE)
    file = tmp_path / "next_scan.json"
    file.write_bytes(next_(cloud, edge, found)[0].content)  # type: ignore[union-attr]
    proposal = json.loads(file.read_text())
    made = plan(edge=file, sensor=Path("data/calibration/sensor.json"))[0]
    length = proposal["to_mm"] - proposal["from_mm"]
    assert made.edge.length_mm == pytest.approx(length, rel=0.02)  # type: ignore[union-attr]


def test_what_a_sensor_file_leaves_open_is_the_recording_s(tmp_path: Path) -> None:
    cloud, edge = scanned(42.0)
    found = sections(edge, root_tolerance_mm=CLOSE)
    sensor = tmp_path / "sensor.json"
    sensor.write_text('{"linearity_mm": 0.0005}')
    with_it, without = (next_(cloud, edge, found, sensor=one)[0] for one in (sensor, None))
    assert isinstance(with_it, Document)
    assert isinstance(without, Document)
    assert with_it.content == without.content


def test_a_pass_that_decides_nothing_is_not_called_the_next_scan() -> None:
    cloud, edge = scanned(42.0, -25.0)
    sizes = [one.values["root_mm"] for one in sections(edge).sections if one.values["root_mm"] is not None]
    at_limit = sections(edge, root_nominal_mm=1.5, root_tolerance_mm=(min(sizes) - 1.5, 0.5))
    assert at_limit.verdict == "undecided"
    (chapter,) = next_(cloud, edge, at_limit)
    assert "No further pass decides" in chapter.summary  # type: ignore[union-attr]
    assert "less than 0.0001 mm would be needed" in chapter.summary  # type: ignore[union-attr]
