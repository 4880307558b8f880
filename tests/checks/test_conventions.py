"""Readings of poses and profiles: each undoes the mistake that it names, whatever the poses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.checks import Convention, known_conventions, known_profile_readings
from workbench.units import Float

TRUE = Rotation.random(40, random_state=3)
AT = np.random.default_rng(4).normal(0.0, 500.0, (40, 3))
HAND_EYE = np.eye(4)
HAND_EYE[:3, :3], HAND_EYE[:3, 3] = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix(), (30.0, -20.0, 140.0)
KNOWN = {one.name: one for one in known_conventions()}


def wxyz(turn: Rotation) -> Float:
    return np.asarray(turn.as_quat()[:, [3, 0, 1, 2]])


def read(
    convention: Convention, quaternion: Float, at: Float = AT, hand_eye: Float = HAND_EYE
) -> tuple[Rotation, Float, Float]:
    """Rotations, places and hand-eye as they would be."""
    quaternion, at, hand_eye = convention.read(quaternion, at, hand_eye)
    return Rotation.from_quat(quaternion[:, [1, 2, 3, 0]]), at, hand_eye


def with_rotation(turn: Float) -> Float:
    """The hand-eye pose with another one."""
    pose = HAND_EYE.copy()
    pose[:3, :3] = turn
    return pose


HELD = {"quaternion": wxyz(TRUE), "at": AT, "hand_eye": HAND_EYE}
STORED: dict[str, dict[str, Float]] = {  # by the mistake
    "quaternions are stored x y z w, not w x y z": {"quaternion": TRUE.as_quat()},
    "quaternions are conjugated: they turn from the base to the flange": {"quaternion": wxyz(TRUE.inv())},
    "quaternions are stored x y z w and conjugated": {"quaternion": TRUE.inv().as_quat()},
    "quaternions are stored x y z w on writing and on reading": {"quaternion": wxyz(TRUE)[:, [3, 0, 1, 2]]},
    "quaternions are stored w z y x, not w x y z": {"quaternion": wxyz(TRUE)[:, [0, 3, 2, 1]]},
    "quaternions are stored z y x w, not w x y z": {"quaternion": wxyz(TRUE)[:, ::-1]},
    "the sign of x of the quaternions is wrong": {"quaternion": wxyz(TRUE) * [1, -1, 1, 1]},
    "the sign of y of the quaternions is wrong": {"quaternion": wxyz(TRUE) * [1, 1, -1, 1]},
    "the sign of z of the quaternions is wrong": {"quaternion": wxyz(TRUE) * [1, 1, 1, -1]},
    "the poses are inverted: they map the base to the flange": {
        "quaternion": wxyz(TRUE.inv()),
        "at": -TRUE.inv().apply(AT),
    },
    "the hand-eye pose is inverted: it maps the flange to the profiler": {"hand_eye": np.linalg.inv(HAND_EYE)},
    "the hand-eye rotation is transposed": {"hand_eye": with_rotation(HAND_EYE[:3, :3].T)},
}


@pytest.mark.parametrize("name", STORED)
def test_what_is_stored_otherwise_is_read_back(name: str) -> None:
    turn, at, hand_eye = read(KNOWN[name], **(HELD | STORED[name]))
    assert (turn.inv() * TRUE).magnitude().max() < 1e-7
    assert at == pytest.approx(AT)
    assert hand_eye == pytest.approx(HAND_EYE)


def test_poses_of_the_profiler_itself_need_no_hand_eye_pose() -> None:
    missing = KNOWN["the hand-eye pose is missing from the poses: they are the profiler's own"]
    assert np.array_equal(read(missing, wxyz(TRUE))[2], np.eye(4))


def order(name: str) -> str:
    return f"{'-'.join(name.upper())} ({'moving' if name.isupper() else 'fixed'})"


EULER = ("ZYX", "XYZ", "ZYZ", "zyx", "xyz")  # as controllers have them
NEAR, FAR = (0.1, 1.4), (np.pi - 1.4, np.pi - 0.1)  # middle angles; beyond 90 deg the order has first and last alike


@pytest.mark.parametrize(
    ("written", "taken", "middle"),
    [(a, b, at) for a in EULER for b in EULER if a != b for at in ([NEAR, FAR] if a[0] == a[2] else [NEAR])],
)
def test_angles_of_one_order_read_in_another_are_read_back(
    written: str, taken: str, middle: tuple[float, float]
) -> None:
    rng = np.random.default_rng(5)
    angles = np.column_stack([rng.uniform(0.1, 1.4, 40), rng.uniform(*middle, 40), rng.uniform(0.1, 1.4, 40)])
    true, misread = (Rotation.from_euler(name, angles) for name in (written, taken))
    name = f"Euler angles of order {order(written)}, read as {order(taken)}"
    readings = [one for one in known_conventions() if one.name == name]
    off = [(read(one, wxyz(misread))[0].inv() * true).magnitude().max() for one in readings]
    assert min(off) < 1e-6


def test_axes_of_the_robot_that_are_swapped_or_mirrored_are_read_back() -> None:
    names = [name for name in KNOWN if name.startswith("the robot's axes are ")]
    assert len(names) == 47  # all of 48 but as they are
    found = {tuple(KNOWN[name].read(wxyz(TRUE), np.array([[1.0, 2.0, 3.0]]), HAND_EYE)[1][0]) for name in names}
    assert len(found) == 47
    assert (1.0, 2.0, 3.0) not in found
    assert all(sorted(np.abs(one)) == [1.0, 2.0, 3.0] for one in found)


def test_axes_of_the_profiler_turn_the_hand_eye_pose_and_leave_its_place() -> None:
    names = [name for name in KNOWN if name.startswith("the profiler's axes are ")]
    turned = [KNOWN[name].read(wxyz(TRUE), AT, HAND_EYE)[2] for name in names]
    axes = {tuple(np.round(HAND_EYE[:3, :3].T @ one[:3, :3]).astype(int).ravel()) for one in turned}
    assert len(axes) == len(names) == 20  # of 24 turns of a cube those that leave the axes in their order are four
    for one in turned:
        assert np.linalg.det(one[:3, :3]) == pytest.approx(1.0)
        assert one[:3, 3] == pytest.approx(HAND_EYE[:3, 3])


def test_profiles_of_swapped_or_mirrored_axes_are_read_back() -> None:
    x, z = np.float32([[1.0, 2.0]]), np.float32([[50.0, 60.0]])
    seen = set()
    for one in known_profile_readings():
        # what a sensor writes whose axes are such: reading it so gives x and z again
        a, b = (x * one.signs[0], z * one.signs[1])
        stored = (b, a) if one.swapped else (a, b)
        back = one.read(*stored)
        assert np.array_equal(back[0], x)
        assert np.array_equal(back[1], z)
        assert ("swapped" in one.name) is one.swapped
        assert ("sign of x" in one.name or "both" in one.name or "x and z of" in one.name) is (one.signs[0] < 0)
        assert ("sign of z" in one.name or "both" in one.name or "x and z of" in one.name) is (one.signs[1] < 0)
        seen.add((one.swapped, one.signs))
    assert len(seen) == 7
