"""`calibrate.tracker` and `calibrate.robot` on robots whose errors are known, and a real robot where it is at hand."""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from bench.calibration.arm import (
    CELL,
    POSE,
    POSE_MM,
    RADIUS_MM,
    TRUE,
    draw,
    flange,
    one_sphere,
    one_tracked,
    sphere,
)
from bench.calibration.sphere_truth import circles_of
from tests.plugins.calibration.conftest import edited
from tests.seldom import seldom
from workbench.api import (
    DEG,
    Float,
    InputError,
    pose_from,
    quaternion_from_rotation,
    rotation_from_vector,
)
from workbench.plugins.calibration import circles
from workbench.plugins.calibration import robot as robot_stage
from workbench.plugins.calibration import tracker as tracker_stage
from workbench.plugins.calibration.model import Estimate, Noise, View
from workbench.plugins.calibration.observations import from_arrays
from workbench.plugins.calibration.robot_stage import as_flange_errors, together
from workbench.scan import read, read_hand_eye

DATA = Path(__file__).parents[3] / "data" / "calibration"
REAL = Path(__file__).parents[3].parent / "shared" / "data" / "real"


def changed_readings(folder: Path, change: Any) -> Path:
    """The shipped readings with `change` of each row's joints (6,) and place (3,)."""
    note, header, *rows = (DATA / "tracker.csv").read_text().splitlines()
    path = folder / "readings.csv"
    path.write_text("\n".join([note, header, *(edited(row, 1, change) for row in rows)]) + "\n")
    return path


@pytest.mark.parametrize(
    "change",
    [
        lambda v: np.r_[v[:6], v[6:] / 25.4],
        lambda v: np.r_[v[:6] * [1, 1, -1, 1, 1, 1], v[6:]],
        *seldom(
            lambda v: np.r_[v[:6], v[6:] * [1, -1, 1]],
            lambda v: np.r_[np.radians(v[:6]), v[6:]],
            lambda v: np.r_[v[[0, 1, 2, 5, 4, 3]], v[6:]],
            lambda v: np.r_[v[:2], v[2] + v[1], v[3:]],
        ),
    ],
    ids=["inches", "sign of joint 3", "mirrored", "radians", "order of joints", "coupled joints"],
)
def test_readings_of_no_such_robot_are_refused(tmp_path: Path, change: Any) -> None:
    with pytest.raises(InputError, match="in the URDF's order and senses"):
        tracker_stage(readings=changed_readings(tmp_path, change), cell=CELL)


def test_a_joint_that_is_counted_from_elsewhere_is_told(tmp_path: Path) -> None:
    """5 deg off where the robot is said to be built to 0.3: found, and told."""
    path = changed_readings(tmp_path, lambda v: v + np.r_[0, 0, 5.0, np.zeros(6)])
    found = json.loads(tracker_stage(readings=path, cell=CELL)[0].content)
    offset = next(one for one in found["parameters"] if one["name"] == "offset of joint 3")
    assert offset["value_deg"] == pytest.approx(0.27 - 5.0, abs=0.05)
    assert any("the offset of joint 3 is 16 times what was stated" in words for words in found["warnings"])


@pytest.fixture(scope="module")
def shipped() -> dict[str, Any]:
    """What the shipped readings tell of the robot."""
    return json.loads(tracker_stage(readings=DATA / "tracker.csv", cell=CELL)[0].content)


def test_postures_that_a_robot_comes_back_to_count_once(tmp_path: Path, shipped: dict[str, Any]) -> None:
    """Four readings of each, joints but for what a robot at rest shows: nothing is known better."""
    rng, note = np.random.default_rng(4), (DATA / "tracker.csv").read_text().splitlines()
    noise = np.repeat([0.0005, 0.002], [6, 3])
    again = [edited(row, 1, lambda v: v + rng.normal(size=9) * noise) for row in note[2:] * 3]
    path = tmp_path / "readings.csv"
    path.write_text("\n".join([*note, *again]) + "\n")
    once, often = (
        {one["name"]: one.get("u_deg", one.get("u_mm")) for one in found["parameters"]}
        for found in (shipped, json.loads(tracker_stage(readings=path, cell=CELL)[0].content))
    )
    assert all(often[name] > 0.7 * once[name] for name in once)  # a third of the readings' own noise is left


@pytest.mark.parametrize("one", [one_sphere, *seldom(one_tracked)])
def test_errors_are_those_of_the_bound_and_the_stated_ones(one: Any) -> None:
    """Over eight robots drawn from the stages' priors: without tilts of axes lengths were up to 18 u off."""
    tilt = inspect.signature(robot_stage).parameters["tilt_prior_deg"].default * DEG
    found = [one(seed, tilt) for seed in range(500, 508)]
    z = np.array([error / np.sqrt(np.diagonal(covariance)) for error, covariance, _ in found])
    assert np.abs(z).max() < 4.0
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.15
    squared = [error @ np.linalg.solve(covariance, error) for error, covariance, _ in found]
    assert np.sum(np.array(squared) < chi2.ppf(0.95, z.shape[1])) >= 6  # by chance fewer once in 170 times
    stated, bound = (np.sqrt(np.mean([np.diagonal(f[k]) for f in found], axis=0)) for k in (1, 2))
    np.testing.assert_allclose(stated, bound, rtol=0.1)


def test_a_tracker_finds_the_robot_and_its_blunder(shipped: dict[str, Any]) -> None:
    found = shipped
    said = dict(
        re.findall(r"([a-z][\w ]+?) (-?\d+\.\d+) (?:mm|deg)", (DATA / "tracker.csv").read_text().split("\n")[0])
    )
    for one in found["parameters"]:
        unit = "mm" if "u_mm" in one else "deg"
        true = float(said.get(one["name"], 0.0))  # no axis is tilted
        assert one[f"value_{unit}"] == pytest.approx(true, abs=4 * one[f"u_{unit}"] + 1e-4)
    undetermined = [one["name"] for one in found["parameters"] if not one["determined"] and "tilt" not in one["name"]]
    assert undetermined == ["offset of joint 1", "shift of axis 2 along z", "offset of joint 6"]
    assert [name in " ".join(found["left_as_built"]) for name in undetermined] == [True] * 3
    assert all(re.search(r"u is (99|100) % of the prior", one) for one in found["left_as_built"])
    assert found["left_out"] == [{"line": 25, "cause": found["left_out"][0]["cause"]}]
    assert "499.9" in found["left_out"][0]["cause"]
    assert found["residual_rms_mm"] < 0.07 < 4.0 < found["residual_rms_as_built_mm"]
    assert found["good_enough"]


def test_a_sphere_tells_the_wrist(tmp_path: Path) -> None:
    recording = read(recording=DATA / "sphere_robot.h5")
    hand_eye, *documents, _ = robot_stage(circles(recording), recording, cell=CELL, joints=DATA / "sphere_joints.csv")
    document = documents[1]
    found = json.loads(document.content)
    assert {"offset of joint 4", "offset of joint 5", "shift of axis 6 along y"} <= {
        one["name"] for one in found["parameters"] if one["determined"]
    }
    assert found["residual_rms_mm"] < 0.1 < 0.3 < found["residual_rms_as_built_mm"]
    assert 0.05 < hand_eye.volume_u_mm < 2.0
    assert [one.name for one in documents] == ["handeye.json", "robot.json"]
    for one in documents:
        (tmp_path / one.name).write_bytes(one.content)
    assert hand_eye.volume_u_mm < 0.2 * found["volume_u_mm"]  # the last joint's zero is as another hand-eye pose
    with pytest.warns(UserWarning, match=r"for a controller into which .* robot\.json are entered"):
        again = read_hand_eye(tmp_path / "handeye.json")
    np.testing.assert_array_equal(again.flange_from_profiler, hand_eye.flange_from_profiler)
    np.testing.assert_array_equal(again.covariance, hand_eye.covariance)
    pose = json.loads(documents[0].content)
    assert f"u = {found['u_mm']:.3f} mm" in pose["method"]
    assert pose["good_enough"]
    assert re.match(r"the hand-eye pose, with .* takes U = 0\.\d+ mm .* and 0\.\d+ deg of a bevel tol", pose["verdict"])
    with pytest.raises(InputError, match=r"expected a handeye\.json, found a robot\.json: give the handeye\.json"):
        read_hand_eye(tmp_path / "robot.json")


def test_a_posture_whose_sphere_lies_off_is_left_out_and_by_how_much() -> None:
    recording = read(recording=DATA / "sphere_robot.h5")
    z = np.array(recording.z_mm)
    z[recording.pass_index == 7] += 4.0
    spoilt = dataclasses.replace(recording, z_mm=z)
    *_, document, _ = robot_stage(circles(spoilt), spoilt, cell=CELL, joints=DATA / "sphere_joints.csv")
    found = json.loads(document.content)
    (told,) = found["left_out"]
    assert float(re.findall(r"lies (\S+) mm", told["cause"])[0]) == pytest.approx(4.0, abs=0.3)
    assert found["residual_rms_mm"] < 0.1


def test_the_covariance_of_handeye_json_holds_what_the_last_joint_takes_from_the_pose() -> None:
    """Robots drawn from the priors: the profiler's place beside the ball's, by the pose and the corrected robot.

    The truth by a chain that is multiplied out anew; the ball moves with the base, which no sphere tells.
    """
    inside = []
    for seed in range(12):
        rng = np.random.default_rng([seed, 0x5F])
        arm = draw(rng)
        joints, recorded, centre, ball = sphere(rng, arm)
        circle, spread = circles_of(rng, centre, RADIUS_MM)
        noise = Noise(POSE_MM, POSE / DEG, RADIUS_MM, 0.05)
        start = Estimate(TRUE[:3, :3], TRUE[:3, 3], ball, RADIUS_MM)
        found = together(start, from_arrays(circle, spread, recorded), joints, noise, arm.chain, arm.errors)
        view = View((0.0, 0.0), (16.0, 20.0))
        both = as_flange_errors(arm.chain, arm.errors, found, joints, view)
        pose = pose_from(found.at.estimate.rotation, found.at.estimate.translation_mm)
        off = beside_another_base(flange(arm, found.at.errors, joints) @ pose, flange(arm, arm.x, joints))
        inside.append(off @ np.linalg.solve(both, off))
    assert 4.0 < np.mean(inside) < 8.5  # six degrees of freedom, twelve robots: 6 +- 1


def beside_another_base(found: Float, flanges: Float) -> Float:
    """The hand-eye error (6,), mm and rad in the flange, that with one motion of the base explains the poses found."""
    points = np.array([[0, 0, 0], [16, 0, 0], [-16, 0, 0], [0, 0, 20], [0, 0, -20]]) @ np.diag([1.0, 0.0, 1.0])
    seen = points @ np.swapaxes(found[:, :3, :3], 1, 2) + found[:, None, :3, 3]
    middle = seen.mean(axis=(0, 1))

    def away(x: Float) -> Float:
        pose = pose_from(Rotation.from_rotvec(x[3:6]).as_matrix() @ TRUE[:3, :3], TRUE[:3, 3] + x[:3])
        there = flanges @ pose
        at = points @ np.swapaxes(there[:, :3, :3], 1, 2) + there[:, None, :3, 3]
        moved = (at - middle) @ Rotation.from_rotvec(x[9:]).as_matrix().T + middle + x[6:9]
        return np.asarray(moved - seen).ravel()

    return np.asarray(least_squares(away, np.zeros(12), x_scale=np.repeat([1.0, 1e-3, 1.0, 1e-3], 3)).x[:6])


def test_what_does_not_belong_together_is_refused(tmp_path: Path) -> None:
    recording = read(recording=DATA / "sphere_robot.h5")
    profiles, table = circles(recording), (DATA / "sphere_joints.csv").read_text().splitlines()
    other = tmp_path / "joints.csv"
    first = table[2].split(",")
    other.write_text("\n".join([*table[:2], ",".join([first[0], str(float(first[1]) + 1.0), *first[2:]]), *table[3:]]))
    with pytest.raises(InputError, match=r"pass 0: by the cell's model .* from the recorded pose"):
        robot_stage(profiles, recording, cell=CELL, joints=other)
    other.write_text("\n".join(table[:-1]))
    with pytest.raises(InputError, match="expected the joint angles of pass"):
        robot_stage(profiles, recording, cell=CELL, joints=other)
    few = read(recording=DATA.parent / "synthetic" / "sphere.h5")
    with pytest.raises(InputError, match="expected 30 postures or more"):
        robot_stage(circles(few), few, cell=CELL, joints=DATA / "sphere_joints.csv")
    rows = (DATA / "tracker.csv").read_text().splitlines()
    other.write_text("\n".join(rows[:8]))
    with pytest.raises(InputError, match="different postures"):
        tracker_stage(readings=other, cell=CELL)


@pytest.mark.skipif(not (REAL / "akig_ur5_poses.txt").exists(), reason="the real readings are not here")
def test_a_real_robot_and_its_blunder_of_half_a_metre(tmp_path: Path) -> None:
    """A UR5 under a hand-held scanner's tracker: poses in m and rotation vectors, 27 of them."""
    poses = {int(row[0]): row[1:] for row in np.loadtxt(REAL / "akig_ur5_poses.txt", delimiter=",")}
    places: dict[int, list[list[float]]] = {}
    for line in (REAL / "akig_tscan_values.txt").read_text().splitlines():
        if head := re.match(r"Pos\s+(\d+)", line):
            now = places.setdefault(int(head[1]), [])
        elif place := re.search(r"X=\s*(\S+)\s+Y=\s*(\S+)\s+Z=\s*(\S+)", line):
            now.append([float(place[k]) for k in (1, 2, 3)])
    rows = ["x_mm,y_mm,z_mm,qw,qx,qy,qz,tracker_x_mm,tracker_y_mm,tracker_z_mm"]
    for number, pose in poses.items():
        quaternion = quaternion_from_rotation(rotation_from_vector(pose[None, 3:]))[0]
        rows.append(",".join(f"{v:.9f}" for v in [*(1e3 * pose[:3]), *quaternion, *np.mean(places[number], axis=0)]))
    (tmp_path / "readings.csv").write_text("\n".join(rows))
    found = json.loads(tracker_stage(readings=tmp_path / "readings.csv")[0].content)
    far = [float(re.findall(r"lies (\S+) mm", one["cause"])[0]) for one in found["left_out"]]
    assert [one["line"] for one in found["left_out"]] == [19, 24]
    assert far[0] == pytest.approx(590.8, abs=1.0)
    assert far[1] < 2.0
    assert found["residual_rms_mm"] == pytest.approx(0.18, abs=0.02)
    assert found["targets"][0]["position_mm"] == pytest.approx([16.2, -4.0, 369.2], abs=1.0)
    assert not found["good_enough"]
