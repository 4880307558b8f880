"""`calibrate.tcp` and `calibrate.turntable` on cells whose truth is known."""

from __future__ import annotations

import contextlib
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.plugins.calibration.conftest import edited
from workbench.api import (
    DEG,
    Float,
    InputError,
    pose_from,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
)
from workbench.plugins.calibration import tcp as tcp_stage
from workbench.plugins.calibration import turntable as turntable_stage

TIP, SHANK = np.array([80.0, -20.0, 250.0]), np.array([80.0, -20.0, 200.0])
REFERENCES = np.array([[1200.0, 100.0, 600.0], [1300.0, -200.0, 650.0]])
NOISE_MM, NOISE = 0.05, 0.01 * DEG
AXIS = np.array([0.02, -0.03, 1.0]) / np.linalg.norm([0.02, -0.03, 1.0])
CENTRE = np.array([1500.0, 200.0, 400.0])


def touch_rows(
    rng: Any, count: int = 16, spread: float = 0.6, about: Float | None = None, known_mm: float | None = None
) -> list[str]:
    """CSV rows of touches; `about`: the flange turns about that axis only; `known_mm`: u of references told."""
    vectors = rng.normal(size=(count, 3)) * spread
    if about is not None:
        vectors = (vectors @ about)[:, None] * about
    rotation, shift = rotation_from_vector(vectors), rng.normal(size=3) * (known_mm or 0.0)
    rows = []
    for i, turn in enumerate(rotation):
        point, name = ((TIP, "tip"), (SHANK, "shank"))[i % 2]
        k = i // 2 % 2
        lever = turn @ point
        at = REFERENCES[k] - lever + rng.normal(size=3) * NOISE_MM - np.cross(rng.normal(size=3) * NOISE, lever)
        told = [*at, *quaternion_from_rotation(turn), *(REFERENCES[k] + shift if known_mm is not None else [])]
        rows.append(f"ball {k},{name}," + ",".join(f"{v:.9f}" for v in told))
    return rows


def touch_file(folder: Path, rows: list[str]) -> Path:
    header = "reference,tool_point,x_mm,y_mm,z_mm,qw,qx,qy,qz"
    header += ",px_mm,py_mm,pz_mm" if rows[0].count(",") > 9 else ""
    path = folder / "touches.csv"
    path.write_text("\n".join(["# touches", header, *rows]) + "\n")
    return path


def calibrated(path: Path, **more: Any) -> dict[str, Any]:
    noise = {"robot_noise_mm": NOISE_MM, "robot_noise_deg": NOISE / DEG, "touch_noise_mm": 0.0} | more
    return json.loads(tcp_stage(touches=path, **noise)[0].content)


@pytest.mark.parametrize("known_mm", [None, 0.05])
def test_tool_points_and_axis_within_what_their_covariance_says(tmp_path: Path, known_mm: float | None) -> None:
    rng, chi, axis_in = np.random.default_rng(7), [], []
    for _ in range(12):
        found = calibrated(touch_file(tmp_path, touch_rows(rng, known_mm=known_mm)))
        assert [p["name"] for p in found["points"]] == ["tip", "shank"]
        off = np.concatenate(
            [np.array(p["position_mm"]) - t for p, t in zip(found["points"], (TIP, SHANK), strict=True)]
        )
        chi.append(off @ np.linalg.solve(np.array(found["covariance_mm2"]), off))
        angle = math.acos(min(1.0, np.array(found["axis"]["direction"]) @ (TIP - SHANK) / 50.0)) / DEG
        axis_in.append(angle <= 2.5 * found["axis"]["u_deg"])  # two directions: 2.45 for 95 %
        assert found["left_out"] == []
    assert 3.8 < np.mean(chi) < 8.2  # six degrees of freedom; the covariance only ever grows with the misfit
    assert np.mean(axis_in) > 0.8


def test_references_that_move_meanwhile_are_told_and_taken_out(tmp_path: Path) -> None:
    """All shank touches, which come last, are 0.5 mm off: the tip was up to 8.9 u off, and nothing told."""
    rng, off = np.random.default_rng(3), []
    for _ in range(6):
        rows = touch_rows(rng, 32)
        moved = [edited(row, 2, lambda v: v + np.r_[0.3, -0.4, 0.0, np.zeros(4)]) for row in rows[1::2]]
        found = calibrated(touch_file(tmp_path, [*rows[::2], *moved]))
        assert [
            words
            for words in found["warnings"]
            if re.match(r"the references shift by 0\.[45]\d mm after line 1[789]", words)
        ]
        tip = np.array(found["points"][0]["position_mm"]) - TIP
        off.append(tip @ np.linalg.solve(np.array(found["points"][0]["covariance_mm2"]), tip))
    assert max(off) < 14.2  # three degrees of freedom, 3 standard deviations
    assert not calibrated(touch_file(tmp_path, rows))["warnings"]


def test_what_u_does_not_hold_is_said(tmp_path: Path) -> None:
    found = calibrated(
        touch_file(tmp_path, touch_rows(np.random.default_rng(7))), robot_noise_mm=0.01, robot_noise_deg=0
    )
    assert any("hold that as chance, not as an error tied to posture or angle" in words for words in found["warnings"])


def ball_rows(rng: Any, count: int, beside_mm: float, known: bool, tilt: float) -> list[str]:
    """Touches of balls with a ball: the tool presses from its side, up to `tilt` rad off the line to the flange."""
    rows = []
    for i, turn in enumerate(rotation_from_vector(rng.normal(size=(count, 3)) * 0.6)):
        lever = turn @ TIP
        way = rotation_from_vector((rng.normal(size=3) * tilt)[None])[0] @ (-lever / np.linalg.norm(lever))
        at = REFERENCES[i % 2] + beside_mm * way - lever
        at = at + rng.normal(size=3) * NOISE_MM - np.cross(rng.normal(size=3) * NOISE, lever)
        told = [*at, *quaternion_from_rotation(turn), beside_mm, *(REFERENCES[i % 2] if known else [])]
        rows.append(f"ball {i % 2},tip," + ",".join(f"{v:.9f}" for v in told))
    return rows


@pytest.mark.parametrize(("known", "tilt"), [(True, 0.05), (False, 0.5)])
def test_a_ball_that_is_touched_keeps_the_tool_off(tmp_path: Path, known: bool, tilt: float) -> None:
    """By both radii; without them the tool would be too long by as much. Along the tool, and from all sides."""
    header = "reference,tool_point,x_mm,y_mm,z_mm,qw,qx,qy,qz,stand_off_mm" + (",px_mm,py_mm,pz_mm" if known else "")
    rng, chi, path = np.random.default_rng(6), [], tmp_path / "balls.csv"
    for _ in range(12):
        path.write_text("\n".join([header, *ball_rows(rng, 30, 8.0, known, tilt)]) + "\n")
        found = calibrated(path, max_u_mm=10.0, reference_u_mm=0.001)
        off = np.array(found["points"][0]["position_mm"]) - TIP
        chi.append(off @ np.linalg.solve(np.array(found["points"][0]["covariance_mm2"]), off))
        assert found["left_out"] == []
    assert 1.6 < np.mean(chi) < 4.6  # three degrees of freedom, twelve tools: 3 +- 0.7


def test_a_distance_below_zero_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "balls.csv"
    rows = ball_rows(np.random.default_rng(5), 8, -1.0, False, 0.5)
    path.write_text("\n".join(["reference,tool_point,x_mm,y_mm,z_mm,qw,qx,qy,qz,stand_off_mm", *rows]) + "\n")
    with pytest.raises(InputError, match="line 2: stand_off_mm: expected 0 or more"):
        calibrated(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda v: v / np.r_[[25.4] * 3, [1] * 4], r"would lie 10\.\d mm from the flange's middle.*in mm"),
        (lambda v: v / np.r_[[1000] * 3, [1] * 4], "would lie 0.2.* mm from the flange's middle.*in mm"),
        (
            lambda v: v * np.r_[[1] * 4, [-1] * 3],
            "the rows contradict each other|times as far apart|nothing determines",
        ),
    ],
    ids=["inches", "metres", "conjugate"],
)
def test_positions_in_another_unit_and_turned_round_poses_are_refused(tmp_path: Path, change: Any, words: str) -> None:
    rows = [edited(row, 2, change) for row in touch_rows(np.random.default_rng(12))]
    with pytest.raises(InputError, match=words):
        calibrated(touch_file(tmp_path, rows))


def test_a_table_that_begins_with_the_shank_is_told(tmp_path: Path) -> None:
    found = calibrated(touch_file(tmp_path, touch_rows(np.random.default_rng(13))[1:]))
    assert found["points"][0]["name"] == "shank"
    assert any("is the table's order, or a name, exchanged?" in words for words in found["warnings"])


def test_touches_that_agree_too_well_are_told(tmp_path: Path) -> None:
    found = calibrated(touch_file(tmp_path, touch_rows(np.random.default_rng(14))), robot_noise_mm=2.0, max_u_mm=5)
    assert any("nearer to each other than the stated noise says" in words for words in found["warnings"])


def test_what_no_touch_determines_is_named(tmp_path: Path) -> None:
    """A flange that turns about its z only never shows how far along z the tip is."""
    rows = touch_rows(np.random.default_rng(4), about=np.array([0.0, 0.0, 1.0]))
    with pytest.raises(InputError, match=r"nothing determines the tool point 'tip' along \(.0\.00, .0\.00, \+1\.00\)"):
        calibrated(touch_file(tmp_path, rows))


@pytest.mark.parametrize(("tolerance", "enough"), [(0.5, True), (0.05, False)])
def test_the_report_says_whether_it_is_good_enough(tmp_path: Path, tolerance: float, enough: bool) -> None:
    found = calibrated(touch_file(tmp_path, touch_rows(np.random.default_rng(6))), root_tolerance_mm=tolerance)
    assert found["good_enough"] is enough
    assert ("not good enough" in found["verdict"]) is not enough


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("1,2,3,1.0011,0,0,0", "line 19: expected a quaternion of norm 1"),
        ("1,2,1.01e6,1,0,0,0", "line 19: z_mm: expected a number within ±1e\\+06"),
    ],
)
def test_unusable_rows_are_named(tmp_path: Path, row: str, words: str) -> None:
    rows = [*touch_rows(np.random.default_rng(1)), f"ball 0,tip,{row}"]
    with pytest.raises(InputError, match=words):
        calibrated(touch_file(tmp_path, rows))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: "", "is empty: was it exported"),
        (lambda text: "# to be measured", "expected a header with the columns reference, x_mm"),
        (lambda text: text.replace("qz", "q"), "header: expected the column 'qz'"),
        (lambda text: text.replace(",", ";"), "header: expected cells parted by commas, decimals by points"),
        (lambda text: text.replace("qz", "qy"), "header: expected the column 'qz'"),
        (lambda text: text.replace("tool_point", "reference"), "'reference': occurs twice"),
        (lambda text: "\n".join(text.splitlines()[:5]), "expected at least 4 rows, found 3"),
    ],
)
def test_tables_that_are_none_are_refused(tmp_path: Path, change: Any, words: str) -> None:
    path = touch_file(tmp_path, touch_rows(np.random.default_rng(1)))
    path.write_text(change(path.read_text()))
    with pytest.raises(InputError, match=words):
        calibrated(path)


def mark_rows(
    rng: Any,
    markers: int = 3,
    angles: tuple[float, ...] = (0, 40, 80, 120),
    away_mm: float = 200.0,
    tall_mm: float = 100.0,
) -> list[str]:
    rows = []
    for k in range(markers):
        q = rng.normal(size=3) * [away_mm, away_mm, tall_mm]
        for angle in angles:
            turned = rotation_from_vector((angle + rng.normal() * 0.002) * DEG * AXIS)
            p = CENTRE + turned @ q + rng.normal(size=3) * 0.05
            rows.append(f"m{k},{angle}," + ",".join(f"{v:.6f}" for v in p))
    return rows


def turned(folder: Path, rows: list[str], **more: Any) -> dict[str, Any]:
    path = folder / "marks.csv"
    path.write_text("\n".join(["marker,angle_deg,x_mm,y_mm,z_mm", *rows]) + "\n")
    return json.loads(turntable_stage(marks=path, **more)[0].content)


def test_a_turntables_axis_within_what_its_covariance_says(tmp_path: Path) -> None:
    rng, chi = np.random.default_rng(2), []
    for _ in range(6):
        found = turned(tmp_path, mark_rows(rng))
        point, across = np.array(found["axis_point_mm"]), np.array(found["across"])
        direction = np.array(found["axis_direction"])
        true = CENTRE + AXIS * ((point - CENTRE) @ AXIS)
        off = np.concatenate([across @ (point - true), across @ (direction - AXIS)])
        chi.append(off @ np.linalg.solve(np.array(found["covariance"]), off))
        assert direction @ AXIS > 0.999999  # rising angles turn about it
        pose = np.array(found["base_from_turntable"])
        assert pose[:3, :3] @ pose[:3, :3].T == pytest.approx(np.eye(3), abs=1e-9)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
        assert pose[0, 0] > 0.99  # the frame hangs on the axis, not on where its search began
    assert 2.6 < np.mean(chi) < 6.2  # four degrees of freedom


def test_an_axis_that_points_down_is_told(tmp_path: Path) -> None:
    """Columns x and y swapped: what turned to the left turns to the right."""
    rows = [row.split(",") for row in mark_rows(np.random.default_rng(4))]
    assert not turned(tmp_path, [",".join(row) for row in rows])["warnings"]
    found = turned(tmp_path, [f"{name},{angle},{y},{x},{z}" for name, angle, x, y, z in rows])
    assert found["axis_direction"][2] < -0.9
    assert [said.startswith("the axis points down, against the base's z") for said in found["warnings"]] == [True]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (mark_rows(np.random.default_rng(1), angles=(0, 2)), "no axis shows"),
        (mark_rows(np.random.default_rng(1), markers=1, angles=(0, 90)), "leave the axis open"),
        (mark_rows(np.random.default_rng(1), away_mm=0.5, tall_mm=0.5), "expected at most 0.2 mm"),
        (mark_rows(np.random.default_rng(1), markers=2, angles=(0, 6), tall_mm=1.0), "expected at most 0.2 mm"),
    ],
)
def test_a_turntable_that_remains_open_is_refused(tmp_path: Path, rows: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        turned(tmp_path, rows)


def test_points_that_turn_by_other_angles_are_refused(tmp_path: Path) -> None:
    """A table whose angles are counted 0.3 % short."""
    rows = mark_rows(np.random.default_rng(15))
    short = [f"{name},{float(angle) * 0.997}," + ",".join(rest) for name, angle, *rest in (r.split(",") for r in rows)]
    with pytest.raises(InputError, match=r"the points turn by 1\.003\d* times the angles given"):
        turned(tmp_path, short)
    assert turned(tmp_path, rows)["warnings"] == []


def test_angles_that_nothing_checks_are_told_and_not_good_enough(tmp_path: Path) -> None:
    """Two markers nearly above each other, at two angles: an angle that is off by 2 % displaces the axis unseen."""
    rng, rows = np.random.default_rng(16), []
    for k, q in enumerate(([300.0, 0.0, 0.0], [303.0, 0.0, 200.0])):
        for angle in (0, 90):
            p = CENTRE + rotation_from_vector(angle * DEG * AXIS) @ q + rng.normal(size=3) * 0.05
            rows.append(f"m{k},{angle}," + ",".join(f"{v:.6f}" for v in p))
    found = turned(tmp_path, rows, root_tolerance_mm=2.0)
    assert not found["good_enough"]
    assert any("the table's angles are believed" in words for words in found["warnings"])


def test_a_slow_drift_is_told_and_stands_in_u(tmp_path: Path) -> None:
    """0.02 mm a reading along x, angle by angle: where the axis is depends on when."""
    for seed in range(2):
        rows = mark_rows(np.random.default_rng(seed), markers=4, angles=(0, 60, 120, 200, 280))
        rows = [rows[5 * k + j].split(",") for j in range(5) for k in range(4)]
        still, moved = (
            turned(
                tmp_path,
                [",".join([*row[:2], f"{float(row[2]) + by * i:.6f}", *row[3:]]) for i, row in enumerate(rows)],
            )
            for by in (0.0, 0.02)
        )
        assert not any("drift" in words for words in still["warnings"])
        assert any(
            re.search(r"the markers drift by 0\.[34]\d mm across the axis", words) for words in moved["warnings"]
        )
        more = np.trace(np.array(moved["covariance"])[:2, :2]) - np.trace(np.array(still["covariance"])[:2, :2])
        assert np.sqrt(more) == pytest.approx(0.02 * 19 / np.sqrt(12.0), rel=0.25)  # any time is as likely
        begun = CENTRE - moved["axis_point_mm"]
        off = np.array(moved["across"]) @ begun
        assert off @ np.linalg.solve(np.array(moved["covariance"])[:2, :2], off) < 9.0
        assert not moved["good_enough"]
        assert moved["u_mm"] > 3.0 * still["u_mm"]


def test_a_step_at_an_angle_is_told_and_stands_in_u(tmp_path: Path) -> None:
    """0.3 mm along x from 180 deg on, marker by marker: no time tells it; the axis was 6.5 u off and good enough."""
    for seed in range(4):
        rows = [row.split(",") for row in mark_rows(np.random.default_rng(seed), 2, (0, 60, 120, 180, 240, 300), 350.0)]
        rows = [[*row[:2], f"{float(row[2]) + 0.3 * (float(row[1]) >= 180)}", *row[3:]] for row in rows]
        found = turned(tmp_path, [",".join(row) for row in rows])
        assert any(re.match(r"the markers shift by 0\.[23]\d mm across", words) for words in found["warnings"])
        off = np.array(found["across"]) @ (CENTRE - found["axis_point_mm"])
        assert off @ np.linalg.solve(np.array(found["covariance"])[:2, :2], off) < 11.8
        assert not found["good_enough"]


def test_a_drift_of_one_marker_is_no_error_of_the_angles(tmp_path: Path) -> None:
    """Six angles' errors would explain most of it: unknown to the fit, it was told in 4 of 23, the axis 3.4 u off."""
    told = 0
    for seed in range(8):
        rng = np.random.default_rng(1000 + seed)
        rows = [row.split(",") for row in mark_rows(rng, markers=1, angles=(0, 60, 120, 180, 240, 300))]
        for k, row in enumerate(rows):
            row[2:] = [f"{float(at) + by * k / 5}" for at, by in zip(row[2:], (0.2, 0.2, 0.1), strict=True)]
        with contextlib.suppress(InputError):
            found = turned(tmp_path, [",".join(row) for row in rows])
            told += any("the markers drift" in words for words in found["warnings"])
    assert told > 2


@pytest.mark.parametrize("seed", range(3))
def test_a_table_whose_angles_err_once_a_turn_is_measured(tmp_path: Path, seed: int) -> None:
    """0.05 deg once a turn, where 0.002 deg is stated: the angles' noise follows the points, the axis stays in u."""
    rng = np.random.default_rng(seed)
    rows = [row.split(",") for row in mark_rows(rng, markers=3, angles=(0, 60, 120, 180, 240, 300))]
    turning = [0.05 * np.sin(float(row[1]) * DEG + 1.0) for row in rows]
    found = turned(
        tmp_path,
        [",".join([row[0], f"{float(row[1]) - off}", *row[2:]]) for row, off in zip(rows, turning, strict=True)],
    )
    off = np.array(found["across"]) @ (CENTRE - found["axis_point_mm"])
    assert off @ np.linalg.solve(np.array(found["covariance"])[:2, :2], off) < 11.8


def test_poses_in_a_frame_at_the_reference_are_refused_with_that_cause(tmp_path: Path) -> None:
    """A work object whose origin is the pin: no inverted pose, and the tool would be sound."""
    rows = []
    for row in touch_rows(np.random.default_rng(3)):
        name, tool, *values = row.split(",")
        at = np.array(values[:3], float) - REFERENCES[0]
        rows.append(",".join([name, tool, *map(str, at), *values[3:]]))
    with pytest.raises(InputError, match="or in a frame at the reference, not the base's"):
        calibrated(touch_file(tmp_path, rows))


def test_inverted_poses_are_refused(tmp_path: Path) -> None:
    """Tool and reference change their places: it fits as well."""
    lines = Path("data/calibration/touches.csv").read_text().splitlines()[1:]
    rows = []
    for line in (line for line in lines if line.startswith("ball 0,tip")):
        *names, x, y, z, qw, qx, qy, qz = line.split(",")
        pose = np.linalg.inv(
            pose_from(rotation_from_quaternion(np.array([qw, qx, qy, qz], float)), np.array([x, y, z], float))
        )
        rows.append(",".join([*names, *map(str, pose[:3, 3]), *map(str, quaternion_from_rotation(pose[:3, :3]))]))
    path = tmp_path / "touches.csv"
    path.write_text("\n".join([lines[0], *rows]) + "\n")
    with pytest.raises(InputError, match=r"are the poses inverted \(flange_from_base\)"):
        tcp_stage(touches=path)
