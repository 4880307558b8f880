"""Spheres that the scanner saw in the place of typed points, by a hand-eye pose that is known as its file says."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.plugins.calibration.conftest import TRUE, Cell, postures, recording
from tests.plugins.calibration.test_tool import NOISE_MM, REFERENCES, SHANK, TIP, touch_file, touch_rows
from workbench.api import DEG, Float, InputError, Recording, pose_from, rotation_from_vector, strict_json
from workbench.plugins.calibration import circles
from workbench.plugins.calibration import tcp as tcp_stage
from workbench.plugins.calibration import turntable as turntable_stage

AXIS = np.array([0.02, -0.03, 1.0]) / np.linalg.norm([0.02, -0.03, 1.0])
CENTRE, BALL = np.array([1500.0, 200.0, 400.0]), np.array([150.0, -120.0, 90.0])
ANGLES, EACH = (0.0, 60.0, 140.0), 4  # deg; postures
SPREAD = np.repeat([0.15, 0.05 * DEG], 3)  # of the hand-eye pose


def on_table() -> list[Float]:
    """Where the ball stands in the base at each angle."""
    return [CENTRE + rotation_from_vector(angle * DEG * AXIS[None])[0] @ BALL for angle in ANGLES]


def scanned(rng: np.random.Generator, places: Sequence[Float]) -> Recording:
    """A ball at these places, seen in four postures each, robot and profiler as noisy as stated."""
    parts = []
    for at in places:
        turns, centre = postures(rng, EACH)
        position = at - np.einsum("kij,kj->ki", turns, centre @ TRUE[:3, :3].T + TRUE[:3, 3])
        noise = Rotation.from_rotvec(rng.normal(0, 0.01 * DEG, (EACH, 3))).as_matrix()
        parts.append((pose_from(turns @ noise, position + rng.normal(0, 0.07, (EACH, 3))), centre))
    poses, centre = (np.concatenate(one) for one in zip(*parts, strict=True))
    return recording(rng, Cell(poses, poses, centre))


def files(folder: Path, rng: np.random.Generator | None = None) -> dict[str, Path]:
    """The table of passes, and a handeye.json that is off as its covariance says."""
    rows = [f"ball,{angle},{k * EACH + i}" for k, angle in enumerate(ANGLES) for i in range(EACH)]
    (folder / "marks.csv").write_text("\n".join(["marker,angle_deg,pass", *rows]) + "\n")
    off = np.zeros(6) if rng is None else rng.normal(size=6) * SPREAD
    pose = pose_from(rotation_from_vector(-off[None, 3:])[0] @ TRUE[:3, :3], TRUE[:3, 3] - off[:3])
    (folder / "handeye.json").write_bytes(strict_json({"flange_from_profiler": pose, "covariance": np.diag(SPREAD**2)}))
    return {"marks": folder / "marks.csv", "hand_eye": folder / "handeye.json"}


def calibrated(seen: Recording, **more: Any) -> dict[str, Any]:
    return json.loads(turntable_stage(circles(seen), seen, max_u_mm=10, **more)[0].content)


def off_axis(found: dict[str, Any]) -> Float:
    """Errors (4,) of the axis as its covariance counts them."""
    point, direction, across = (np.array(found[key]) for key in ("axis_point_mm", "axis_direction", "across"))
    nearest = CENTRE + (point - CENTRE) @ AXIS * AXIS
    return np.concatenate([across @ (point - nearest), across @ (direction - AXIS)])


def test_the_axis_lies_within_what_scans_and_hand_eye_say(tmp_path: Path) -> None:
    chi = []
    for seed in range(8):
        rng = np.random.default_rng([seed, 3])
        found = calibrated(scanned(rng, on_table()), **files(tmp_path, rng))
        off = off_axis(found)
        chi.append(off @ np.linalg.solve(np.array(found["covariance"]), off))
        assert found["points"] == 3
    assert 2.4 < np.mean(chi) < 5.8  # four degrees of freedom, eight tables: 4 +- 1


def test_what_the_hand_eye_leaves_open_is_in_u(tmp_path: Path) -> None:
    seen, given = scanned(np.random.default_rng(5), on_table()), files(tmp_path)
    known = calibrated(seen, **given)
    alone = calibrated(seen, marks=given["marks"])  # the recording's own pose, of which nothing is said
    assert known["u_mm"] > 1.5 * alone["u_mm"]
    assert any("hand-eye" in words for words in alone["warnings"])
    assert not alone["good_enough"]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (["ball,0,0", "ball,0,1", "ball,60,4", "ball,60,5", "ball,60,6"], "line 2: expected 3 postures or more"),
        (["ball,0,0", "ball,0,1", "ball,0,2", "ball,2,4", "ball,2,5"], "expected angles 5 deg or more apart"),
    ],
)
def test_too_little_is_refused(tmp_path: Path, rows: list[str], words: str) -> None:
    given = files(tmp_path)
    given["marks"].write_text("\n".join(["marker,angle_deg,pass", *rows]) + "\n")
    with pytest.raises(InputError, match=words):
        calibrated(scanned(np.random.default_rng(5), on_table()), **given)


def test_a_hand_eye_pose_that_serves_no_sphere_is_refused(tmp_path: Path) -> None:
    given = files(tmp_path)
    with pytest.raises(InputError, match=r"handeye.json: expected scanned spheres.* give a recording"):
        turntable_stage(**given)
    with pytest.raises(InputError, match=r"handeye.json: expected scanned spheres.* give references"):
        tcp_stage(touches=touch_file(tmp_path, touch_rows(np.random.default_rng(3))), hand_eye=given["hand_eye"])


def test_a_tool_that_touches_scanned_references(tmp_path: Path) -> None:
    """The flange turns about one axis only: nothing but the references' places tells the tool along it."""
    chi, known = [], np.array([0.0, 0.0, 1.0])
    for seed in range(8):
        rng = np.random.default_rng([seed, 7])
        seen, given = scanned(rng, REFERENCES), files(tmp_path, rng)
        rows = [f"ball {k},{k * EACH + i}" for k in range(2) for i in range(EACH)]
        (tmp_path / "references.csv").write_text("\n".join(["reference,pass", *rows]) + "\n")
        touches = on_centres(touch_file(tmp_path, touch_rows(rng, about=known)))
        noise = {"robot_noise_mm": NOISE_MM, "touch_noise_mm": 0.0, "max_u_mm": 10.0}
        with pytest.raises(InputError, match="nothing determines the tool point"):
            tcp_stage(touches=touches, **noise)
        given = {"references": tmp_path / "references.csv", "hand_eye": given["hand_eye"]}
        document, _ = tcp_stage(circles(seen), seen, touches=touches, **given, **noise)
        found = json.loads(document.content)
        places = [np.array(point["position_mm"]) for point in found["points"]]
        off = np.concatenate([place - true for place, true in zip(places, (TIP, SHANK), strict=True)])
        chi.append(off @ np.linalg.solve(np.array(found["covariance_mm2"]), off))
    assert 4.0 < np.mean(chi) < 8.2  # six degrees of freedom, eight tools: 6 +- 1.2


def test_the_order_of_the_references_changes_nothing(tmp_path: Path) -> None:
    """One of them is seen by all of its passes, the other by three: their covariances differ."""
    rng = np.random.default_rng(3)
    seen, given = scanned(rng, REFERENCES), files(tmp_path, rng)
    rows = [f"ball {k},{k * EACH + i}" for k in range(2) for i in range(EACH if k else 3)]
    touches, found = on_centres(touch_file(tmp_path, touch_rows(rng))), []
    for ordered in (rows, rows[::-1]):
        (tmp_path / "references.csv").write_text("\n".join(["reference,pass", *ordered]) + "\n")
        more = {"references": tmp_path / "references.csv", "hand_eye": given["hand_eye"]}
        document, _ = tcp_stage(circles(seen), seen, touches=touches, max_u_mm=10.0, **more)
        found.append(json.loads(document.content)["covariance_mm2"])
    assert np.allclose(*found, rtol=1e-9)


def on_centres(touches: Path, said: str = "0") -> Path:
    """The table, which says how far from the spheres' centres the tool point stays."""
    lines = touches.read_text().splitlines()
    cells = [f",{'stand_off_mm' if k == 1 else said}" if k else "" for k in range(len(lines))]
    touches.write_text("\n".join(line + cell for line, cell in zip(lines, cells, strict=True)) + "\n")
    return touches


@pytest.mark.parametrize("said", [None, "", "3"])
def test_a_scanned_sphere_is_touched_on_its_surface_unless_it_is_said(tmp_path: Path, said: str | None) -> None:
    """Pressed along the tool it would be too long by the radius, and no residual would show it."""
    rng = np.random.default_rng(1)
    seen, touches = scanned(rng, REFERENCES), touch_file(tmp_path, touch_rows(rng))
    touches = touches if said is None else on_centres(touches, said)
    (tmp_path / "references.csv").write_text("reference,pass\nball 0,0\nball 0,1\nball 0,2\n")
    with pytest.raises(InputError, match=r"line 3: stand_off_mm: expected the tool point's distance .* 5 mm, and that"):
        tcp_stage(circles(seen), seen, touches=touches, references=tmp_path / "references.csv")


def test_references_that_no_touch_names(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    seen, touches = scanned(rng, REFERENCES), on_centres(touch_file(tmp_path, touch_rows(rng)))
    (tmp_path / "references.csv").write_text("reference,pass\nbal 0,0\nbal 0,1\nbal 0,2\n")
    with pytest.raises(InputError, match="'bal 0' is no reference of the touches; did you mean 'ball 0'"):
        tcp_stage(circles(seen), seen, touches=touches, references=tmp_path / "references.csv")
    with pytest.raises(InputError, match="expected a recording that shows them"):
        tcp_stage(touches=touches, references=tmp_path / "references.csv")
