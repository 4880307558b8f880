"""Milling paths from raw edges, against the finished bevel that a truth of our own implies."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.seldom import seldom

from .conftest import ROOT, SCAN, Ended
from .hdf import write
from .stranger import UP, Part, Scan, Setting, any_setting, record

SHIPPED = ROOT / "pipelines" / "plan_bevel.json"
RAW = Part(raw=True, curvature_per_mm=1 / 400)
BACK = {"start_mm": 124.0, "stop_mm": -4.0}
CASES: dict[str, tuple[Part, list[Scan]]] = {
    "arc from above": (RAW, [SCAN]),
    "straight, frontal, other way": (
        Part(raw=True),
        [replace(SCAN, elevation_deg=8, x_sense=-1, falling=True, **BACK)],
    ),
    "hollow, from below, counts towards": (
        replace(RAW, curvature_per_mm=-1 / 300),
        [replace(SCAN, elevation_deg=-20, z_sense=-1, poses="dense")],
    ),
    "wavy, upside down, far zero, leaning": (
        Part(raw=True, wave_rad=0.06, tilt_deg=2.0, thickness_mm=11),
        [replace(SCAN, x_sense=-1, z_sense=-1, x_zero_mm=900, z_zero_mm=1500, yaw_deg=-12, poses="frames")],
    ),
    "two passes, both sides": (
        Part(raw=True, thickness_mm=6),
        [replace(SCAN, pass_index=7), replace(SCAN, pass_index=-3, elevation_deg=-20, x_sense=-1, **BACK)],
    ),
    "followed, disturbed, on a table": (
        RAW,
        [replace(SCAN, follow=True, poses="dense", outliers=0.03, dropouts=0.1, mixed=0.5, table_mm=12)],
    ),
}


@dataclass(frozen=True)
class Planned:
    """The final layer's cutting points beside the truth."""

    along_mm: np.ndarray  # true arc length of each
    above_mm: np.ndarray  # height over the true finished bevel
    middle_mm: np.ndarray  # distance from the middle of that face, across it
    axis_deg: np.ndarray  # of the cutter's axis from the true one
    feed_deg: np.ndarray  # of y from t
    into_deg: np.ndarray  # of x from the bevel's inward normal
    told_mm: np.ndarray  # arc length as reported


def planned(
    layer: dict[str, Any], part: Part, setting: Setting, root_mm: float = 1.5, bevel_deg: float = 40
) -> Planned:
    points = [point for point in layer["points"] if point["cutting"]]
    part_from_base = np.linalg.inv(setting.base_from_part)
    place = np.array([p["position_mm"] for p in points]) @ part_from_base[:3, :3].T + part_from_base[:3, 3]
    w, x, y, z = np.array([p["quaternion_wxyz"] for p in points]).T
    axes = part_from_base[:3, :3] @ Rotation.from_quat(np.stack([x, y, z, w], axis=-1)).as_matrix()
    s = part.nearest(place)
    t, plate, tilt, beta = part.tangent(s), part.normal(s), np.radians(part.tilt_deg), np.radians(bevel_deg)
    normal, across = np.cos(tilt) * plate + np.sin(tilt) * UP, np.cos(tilt) * UP - np.sin(tilt) * plate
    bevel, axis = normal * np.cos(beta) + across * np.sin(beta), normal * np.sin(beta) - across * np.cos(beta)
    corner = part.lower_edge(s) + root_mm * across
    width = (part.thickness_mm / np.cos(tilt) - root_mm) * np.cos(tilt) / np.cos(beta + tilt)

    def apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.degrees(np.arccos(np.clip(np.sum(one * other, axis=1), -1, 1)))

    return Planned(
        s,
        np.sum((place - corner) * bevel, axis=1),
        np.sum((place - corner) * -axis, axis=1) - width / 2,
        apart(axes[:, :, 2], axis),
        apart(axes[:, :, 1], t),
        apart(axes[:, :, 0], -bevel),
        np.array([p["arc_length_mm"] for p in points]),
    )


@pytest.fixture
def plan(command: Callable[..., Ended], tmp_path: Path) -> Callable[..., Ended]:
    """`plan(recording, up, ...)`: the shipped planning without its page."""
    document = json.loads(SHIPPED.read_text())
    document["stages"] = [entry for entry in document["stages"] if not entry["stage"].startswith("report.")]
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(document))

    def call(recording: Path, upper_side: np.ndarray, *arguments: object) -> Ended:
        up = json.dumps(np.asarray(upper_side).tolist())
        return command("run", path, "--input", f"recording={recording}", "--input", f"upper_side={up}", *arguments)

    return call


def roughly_up(setting: Setting, rng: np.random.Generator) -> np.ndarray:
    """The upper side as a user would say it: 8 deg off, of any length."""
    away = Rotation.from_rotvec(np.radians(8) * _unit(rng.normal(size=3)))
    return 3.7 * (setting.base_from_part[:3, :3] @ away.apply(UP))


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


QUICK = ("arc from above", "wavy, upside down, far zero, leaning", "two passes, both sides")


@pytest.mark.parametrize("case", [*QUICK, *seldom(*(case for case in CASES if case not in QUICK))])
def test_the_final_layer_is_the_finished_bevel(case: str, plan: Callable[..., Ended], folder: Path) -> None:
    part, scans = CASES[case]
    rng = np.random.default_rng(len(case))
    setting = any_setting(rng)
    ended = plan(write(folder / "raw.h5", record(part, scans, setting, 3), form="lzf"), roughly_up(setting, rng))
    assert ended.status == 1, ended.err  # a shape only
    document = ended.read("toolpath.json")
    found = planned(document["layers"][-1], part, setting)
    assert np.max(np.abs(found.above_mm)) < 0.04
    assert np.max(np.abs(found.middle_mm)) < 0.1
    assert np.max(found.axis_deg) < 0.1
    assert np.max(found.into_deg) < 0.3
    assert np.max(found.feed_deg) < 0.3
    assert np.ptp(found.along_mm) > 0.97 * part.length_mm - 2
    assert np.all(np.diff(found.told_mm) > 0)
    assert np.diff(found.along_mm)[:-1] == pytest.approx(1.0, abs=0.05)
    assert np.ptp(found.told_mm - found.along_mm) < 0.2


def test_layers_step_down_to_the_finished_bevel(plan: Callable[..., Ended], folder: Path, setting: Setting) -> None:
    up = setting.base_from_part[:3, 2]
    recording = write(folder / "steps.h5", record(RAW, [SCAN], setting, 5))
    for root, bevel, depth in ((1.5, 40.0, 1.0), (2.5, 35.0, 0.7)):
        values = {"root_mm": root, "bevel_deg": bevel, "depth_of_cut_mm": depth}
        asked = [word for key, value in values.items() for word in ("--input", f"{key}={value}")]
        ended = plan(recording, up, *asked)
        assert ended.status == 1, ended.err  # a shape only
        layers = ended.read("toolpath.json")["layers"]
        heights = [np.mean(planned(layer, RAW, setting, root, bevel).above_mm) for layer in layers]
        stock = (RAW.thickness_mm - root) * np.sin(np.radians(bevel))
        assert len(layers) == np.ceil(stock / depth)
        assert heights == pytest.approx(np.arange(len(layers))[::-1] * depth, abs=0.03)


def test_nothing_is_cut_under_a_clamp(plan: Callable[..., Ended], folder: Path, setting: Setting) -> None:
    scan = replace(SCAN, clamp_mm=(50.0, 72.0))
    ended = plan(write(folder / "clamped.h5", record(RAW, [scan], setting, 5)), setting.base_from_part[:3, 2])
    assert ended.status == 1, ended.err  # a shape only
    part_from_base = np.linalg.inv(setting.base_from_part)
    for layer in ended.read("toolpath.json")["layers"]:
        points = layer["points"]
        place = np.array([p["position_mm"] for p in points]) @ part_from_base[:3, :3].T + part_from_base[:3, 3]
        s = RAW.nearest(place)
        cutting, measured = (np.array([p[key] for p in points]) for key in ("cutting", "measured"))
        assert not cutting[(s > 50 - 4) & (s < 72 + 4)].any()
        assert not measured[(s > 52) & (s < 70)].any()
        assert cutting[(s > 5) & (s < 35)].all()
        assert cutting[(s > 90) & (s < 115)].all()


def test_where_nothing_shows_the_place_there_is_no_table(
    plan: Callable[..., Ended], folder: Path, setting: Setting
) -> None:
    """A table has no comment that could say that it is a shape only; the path's own file says it."""
    recording = write(folder / "program.h5", record(RAW, [SCAN], setting, 6))
    ended = plan(recording, setting.base_from_part[:3, 2])
    assert ended.status == 1, ended.err
    assert "not passed: SHAPE ONLY" in ended.out.splitlines()[-1]
    assert {one.name for one in ended.directory.iterdir()} == {"toolpath.json", "run.json"}
    assert ended.read("toolpath.json")["check"]["placed"] is False


REFUSED = {
    "root larger than the thickness": ({"root_mm": 9}, 2),
    "upper side along the edge": ({"upper_side": "along"}, 2),
    "upper side of no length": ({"upper_side": [0, 0, 0]}, 2),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_planned_is_refused(
    what: str, plan: Callable[..., Ended], folder: Path, setting: Setting
) -> None:
    asked, status = REFUSED[what]
    straight = Part(raw=True)
    recording = write(folder / "refused.h5", record(straight, [SCAN], setting, 7))
    values = {k: setting.base_from_part[:3, 0].tolist() if v == "along" else v for k, v in asked.items()}
    words = [word for key, value in values.items() for word in ("--input", f"{key}={json.dumps(value)}")]
    ended = plan(recording, setting.base_from_part[:3, 2], *words)
    assert ended.status == status, ended.out
    assert ended.err.strip().splitlines()[-1].startswith("error: ")
    assert "Traceback" not in ended.err
    assert not list(ended.directory.glob("*")) if ended.directory.exists() else True


def test_a_milled_edge_is_not_planned_again(plan: Callable[..., Ended], easy: Path, setting: Setting) -> None:
    ended = plan(easy, setting.base_from_part[:3, 2])
    assert ended.status == 2
    assert ended.err.startswith("error: ") or "\nerror: " in ended.err


def test_an_edge_out_of_view_is_not_planned(plan: Callable[..., Ended], folder: Path, setting: Setting) -> None:
    """Nothing tells where the stock ends if the field of view cuts the end face off."""
    part = Part(raw=True, thickness_mm=12)
    recording = write(folder / "narrow.h5", record(part, [replace(SCAN, columns=120, skew_mm=0)], setting, 7))
    ended = plan(recording, setting.base_from_part[:3, 2])
    assert ended.status == 2, ended.out
    assert not (ended.directory / "toolpath.json").exists()
