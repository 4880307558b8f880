"""Known mistakes in a recording of the hand-eye calibration are named, whatever its target."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.calibration import faces
from tests.plugins.calibration import conftest as spheres
from tests.seldom import seldom
from workbench.api import Document, InputError, Recording, inverse
from workbench.plugins.calibration import circles, hand_eye, hand_eye_faces


def by_sphere(seed: int, count: int = 12) -> Recording:
    rng = np.random.default_rng(seed)
    return spheres.recording(rng, spheres.cell(rng, *spheres.postures(rng, count)), spheres.off_design(rng, 5.0, 10.0))


def by_edge(seed: int) -> Recording:
    return replace(faces.still(np.random.default_rng(seed), 14), flange_from_profiler=faces.TRUE)


def found(made: Recording) -> Document:
    return hand_eye_faces(made)[1] if made.sphere_diameter_mm is None else hand_eye(circles(made), made)[2]


def of_poses(change: Callable[[Any, Any], tuple[Any, Any]]) -> Callable[[Recording], Recording]:
    """A mistake in the recorded rotations and positions."""

    def mistaken(made: Recording) -> Recording:
        turn = Rotation.from_quat(made.robot_quaternion_wxyz, scalar_first=True)
        turn, position = change(turn, made.robot_position_mm)
        return replace(made, robot_position_mm=position, robot_quaternion_wxyz=turn.as_quat(scalar_first=True))

    return mistaken


POSES = {
    "quaternions are stored x y z w, not w x y z": lambda R, p: (
        Rotation.from_quat(R.as_quat(scalar_first=False), scalar_first=True),
        p,
    ),
    "the poses are inverted": lambda R, p: (R.inv(), -R.inv().apply(p)),
    "angles are in rad, but were read as degrees": lambda R, p: (
        Rotation.from_euler("ZYX", np.radians(R.as_euler("ZYX"))),
        p,
    ),
    r"Euler angles of order Z-Y-X \(moving\), read as X-Y-Z \(moving": lambda R, p: (
        Rotation.from_euler("XYZ", R.as_euler("ZYX")),
        p,
    ),
    "poses are those of the posture beside": lambda R, p: (R[np.roll(np.arange(len(p)), 1)], np.roll(p, 1, axis=0)),
    "the robot's axes are x, -y, z": lambda R, p: (R, p * [1.0, -1.0, 1.0]),
}


# What an edge adds is the way to ask; the mistakes are the same.
CASES = [
    *((by_sphere, words) for words in list(POSES)[:2]),
    *seldom(*((by_sphere, words) for words in list(POSES)[2:])),
]
CASES += seldom((by_edge, next(iter(POSES))))


@pytest.mark.parametrize(("made", "words"), CASES, ids=lambda one: one[:30] if isinstance(one, str) else one.__name__)
def test_a_mistake_in_the_poses_is_the_refusals_suspicion(made: Any, words: str) -> None:
    with pytest.raises(InputError, match=rf"^\S+: /robot: no hand-eye pose explains .*suspicion: .*{words}"):
        found(of_poses(POSES[words])(made(21)))


def test_few_postures_that_fit_badly_are_suspected_too() -> None:
    """Eight inverted poses fit at a few times the noise: the postures were blamed."""
    with pytest.raises(InputError, match=r"the residuals ask for .*; suspicion: the poses are inverted"):
        found(of_poses(POSES["the poses are inverted"])(by_sphere(21, 8)))


def test_a_diameter_that_is_twice_the_sphere_s_is_suspected() -> None:
    made = by_sphere(21)
    with pytest.raises(InputError, match=r"suspicion: another sphere: all circles are within 9\.5 mm, stated .* 20 mm"):
        found(replace(made, sphere_diameter_mm=20.0))


@pytest.mark.parametrize("made", [by_sphere, by_edge])
def test_profiles_of_a_mirrored_axis_are_told(made: Any) -> None:
    sound = made(22)
    assert not json.loads(found(sound).content)["warnings"]
    (said,) = json.loads(found(replace(sound, x_mm=-sound.x_mm)).content)["warnings"]
    assert "turned by 1" in said
    assert said.endswith("suspicion: the sign of x of the profiles is wrong")


def test_a_design_the_wrong_way_round_is_told() -> None:
    sound = by_sphere(23)
    said = json.loads(found(replace(sound, flange_from_profiler=inverse(sound.flange_from_profiler))).content)
    assert "the hand-eye pose is inverted: it maps the flange to the profiler" in " ".join(said["warnings"])


@pytest.mark.parametrize("made", [by_sphere, by_edge])
def test_poses_of_another_tool_frame_are_told(made: Any) -> None:
    """All rows with a tool of 100 mm active: the hand-eye pose was 100 mm off, without a word."""
    other = of_poses(lambda turn, position: (turn, position + turn.apply([0.0, 0.0, 100.0])))
    (said,) = json.loads(found(other(made(22))).content)["warnings"]
    assert "another tool was active" in said
