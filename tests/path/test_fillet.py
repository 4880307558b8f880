"""J preparations: where the ball end stands, what it leaves, and what its checks find."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Callable

import numpy as np
import pytest

from tests.made import files_of
from tests.path.conftest import Raw
from tests.report.conftest import text_of
from workbench.api import rotation_from_quaternion
from workbench.artefacts import Toolpath
from workbench.errors import InputError
from workbench.path import check, check_file, feed, layers, read
from workbench.report import plan as report_plan

ROOT, RADIUS, ANGLE = 1.5, 3.0, math.radians(20.0)
J = {"root_mm": ROOT, "bevel_deg": 20.0, "root_radius_mm": RADIUS, "cutter_diameter_mm": 2.0 * RADIUS}
CURVES = {"straight": {"shape": "straight"}, "convex": {"shape": "arc", "radius_mm": 300, "sense": "convex"}}


@pytest.fixture(params=["straight", "convex"])
def planned(raw: Callable[..., Raw], request) -> tuple[Raw, Toolpath]:
    scan = raw(
        part={"curve": CURVES[request.param]},
        **(
            {"passes": [{"from_mm": 2.0, "to_mm": 62.0, "motion": "stream", "follow": "edge"}]}
            if request.param == "convex"
            else {}
        ),
    )
    return scan, feed(layers(scan.edge, scan.cloud, **J), scan.cloud, scan.edge)


def moved(plan: Toolpath, down_mm: float) -> Toolpath:
    """The path with its cutter pushed along its axis."""
    lower = [
        dataclasses.replace(
            layer, position_mm=layer.position_mm + down_mm * rotation_from_quaternion(layer.quaternion_wxyz)[:, :, 2]
        )
        for layer in plan.layers
    ]
    return dataclasses.replace(plan, layers=tuple(lower))


def test_the_ball_stands_above_the_end_of_the_root_face(planned) -> None:
    """Its centre: a radius above the root face's end, on the end face; higher layers along the bevel's normal."""
    scan, plan = planned
    for layer in plan.layers:
        axes = rotation_from_quaternion(layer.quaternion_wxyz)
        cut = layer.cutting
        centre = layer.position_mm + plan.cutter.cylinder_end_mm * axes[:, :, 2] - RADIUS * axes[:, :, 0]
        s = layer.arc_length_mm + scan.start_mm
        place, n, m = (
            np.stack([np.interp(s, scan.truth.arc_length_mm, v[:, k]) for k in range(3)], axis=1)
            for v in (scan.truth.position_mm, scan.truth.normal, scan.truth.across)
        )
        off = centre - place
        assert np.abs((off * n).sum(axis=1) - layer.height_mm * math.cos(ANGLE))[cut].max() < 2e-3
        above = ROOT + RADIUS + layer.height_mm * math.sin(ANGLE)
        assert np.abs((off * m).sum(axis=1) - above)[cut].max() < 2e-3
    assert plan.cutter.ball_end
    assert plan.plane_mm == pytest.approx(ROOT + RADIUS - RADIUS / math.sin(ANGLE))


def test_its_face_lies_between_fillet_and_upper_surface(planned) -> None:
    scan, plan = planned
    final = plan.layers[-1]
    axis = rotation_from_quaternion(final.quaternion_wxyz)[:, :, 2]
    middle, half = plan.face_middle_mm(final), 0.5 * final.width_mm[:, None]
    s = final.arc_length_mm + scan.start_mm
    place, m = (
        np.stack([np.interp(s, scan.truth.arc_length_mm, v[:, k]) for k in range(3)], axis=1)
        for v in (scan.truth.position_mm, scan.truth.across)
    )
    for end, height in ((middle + half * axis, ROOT + RADIUS * (1 - math.sin(ANGLE))), (middle - half * axis, 8.0)):
        assert np.abs(((end - place) * m).sum(axis=1) - height)[final.cutting].max() < 0.02


def test_a_sound_path_passes_with_its_scan_and_from_its_file(planned, tmp_path) -> None:
    scan, plan = planned
    gate = check(plan, scan.edge, scan.cloud)
    assert gate.passed, gate.reason
    file = tmp_path / "toolpath.json"
    file.write_bytes(files_of(plan)["toolpath.json"])
    document = json.loads(file.read_text())
    assert document["cutter"]["ball_end"]
    assert document["requirements"]["root_radius_mm"] == RADIUS
    again = read(toolpath=file)
    assert again.root_radius_mm == RADIUS
    assert dataclasses.astuple(again.cutter) == dataclasses.astuple(plan.cutter)
    assert check_file(again).passed


def test_the_page_says_where_the_ball_end_meets_the_end_face(planned, monkeypatch) -> None:
    scan, plan = planned
    monkeypatch.setattr("workbench.report.scene.picture", lambda view: b"\x89PNG")
    text = text_of(report_plan(scan.cloud, scan.edge, plan))
    (told,) = re.findall(r"Root face 1\.5 mm ([\d.]+) mm ([\d.]+) mm", text)
    assert [float(one) for one in told] == pytest.approx([ROOT, ROOT], abs=0.02)


@pytest.mark.parametrize("down_mm", [0.2, -0.2])
def test_a_cutter_pushed_along_its_axis_is_found(planned, down_mm) -> None:
    scan, plan = planned
    gate = check(moved(plan, down_mm), scan.edge, scan.cloud)
    assert not gate.passed
    assert "does not stand where its ball end makes the fillet" in gate.reason


def test_the_cloud_tells_a_cutter_that_is_too_deep(planned) -> None:
    """Beside the check of the layers: 0.4 mm down its axis the ball's end is 0.4 cos(20 deg) = 0.38 mm in the part."""
    scan, plan = planned
    deep = dataclasses.replace(plan, layers=(*plan.layers[:-1], moved(plan, 0.4).layers[-1]))
    reason = check(deep, scan.edge, scan.cloud).reason
    final = next(each for each in reason.split("; ") if "what must remain" in each)
    assert f"layer {len(plan.layers)} " in final
    assert re.search(r"by 0\.3[5-9] mm", final), final


@pytest.mark.parametrize("cutter", [{"ball_end": False}, {"diameter_mm": 8.0}])
def test_another_cutters_end_is_found(planned, cutter) -> None:
    scan, plan = planned
    other = dataclasses.replace(plan, cutter=dataclasses.replace(plan.cutter, **cutter))
    for gate in (check(other, scan.edge, scan.cloud), check_file(other)):
        assert not gate.passed
        assert "the cutter has no ball end of the fillet's radius, 3 mm" in gate.reason


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"cutter_diameter_mm": 10.0}, "cutter_diameter_mm: expected 6 mm, twice root_radius_mm, found 10 mm"),
        ({"upper_bevel_deg": 50.0, "lower_bevel_mm": 2.0}, "upper_bevel_deg: expected none beside root_radius_mm"),
        ({"finish_allowance_mm": 0.3}, "finish_allowance_mm: expected none beside root_radius_mm"),
        (
            {"root_radius_mm": 10.0, "cutter_diameter_mm": 20.0},
            "root_radius_mm: 10 mm reach to the stock's upper surface",
        ),
        ({"flute_length_mm": 6.0}, "flute_length_mm: 6 mm do not reach over the bevel face"),
    ],
)
def test_what_a_ball_end_cannot_mill_is_refused(raw, changed, told) -> None:
    scan = raw()
    with pytest.raises(InputError, match=told):
        layers(scan.edge, scan.cloud, **{**J, **changed})
