"""The kernels of the traversal against closed-form inverse, limits and J K^-1 J^T f, branch by branch."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.geometry.poses import inverse, pose_from, rotation_from_vector
from workbench.plugins.stiffness.arm import CAUSES, LoadedPath, displacements, fast_arm, traverse
from workbench.plugins.stiffness.elastic import give_way
from workbench.robot import Cell, forward_kinematics, inverse_kinematics, within_limits
from workbench.units import Float

from .conftest import K

BRANCHES = [(s, e) for s in (0, 1) for e in (0, 1)]


@pytest.fixture(scope="module")
def drawn(cell: Cell) -> Any:
    """Poses of random postures within limits, the tips there, and random forces."""
    rng = np.random.default_rng(8)
    q = rng.uniform(cell.chain.limits[:, 0], cell.chain.limits[:, 1], (3000, 6))
    poses = forward_kinematics(cell.chain, q)
    return poses, (poses @ cell.flange_from_cutter)[:, :3, 3], 100 * rng.normal(size=(3000, 3))


def reference(cell: Cell, poses: Float, force: Float, branch: int) -> tuple[Float, Float]:
    """Displacement and joint angles within limits of one of eight branches; NaN where there is none."""
    joints = inverse_kinematics(cell.chain, poses)[:, branch]
    tip = cell.flange_from_cutter[:3, 3]
    load = np.hstack([force, np.zeros_like(force)])
    moved, _ = give_way(cell.chain, K, np.nan_to_num(joints), tip, load, order=1, with_kc=False)
    length = np.where(np.isnan(joints[:, 0]), np.nan, np.linalg.norm(moved[:, :3], axis=1))
    return length, within_limits(cell.chain, joints)


@pytest.mark.parametrize(("shoulder", "elbow"), BRANCHES)
def test_displacement_and_verdict_are_those_of_the_joint_angles(
    cell: Cell, drawn: Any, shoulder: int, elbow: int
) -> None:
    poses, tips, force = drawn
    found, said = displacements(fast_arm(cell.chain), K, poses, tips, force, shoulder=shoulder, elbow=elbow)
    branch = 4 * shoulder + 2 * elbow
    length, joints = reference(cell, poses, force, branch)
    flipped, other = reference(cell, poses, force, branch + 1)
    there = np.isfinite(length)
    assert np.abs(found / length - 1)[there].max() < 1e-10
    assert np.abs(flipped / length - 1)[there].max() < 1e-10  # a wrist flip changes nothing
    assert ((said == CAUSES.index("unreachable")) == ~there).all()
    within = np.isfinite(joints).all(axis=1) | np.isfinite(other).all(axis=1)
    assert ((said == 0) == within).all()
    assert 0 < (said == 0).sum() < len(said)


@pytest.mark.parametrize(("shoulder", "elbow"), BRANCHES)
@pytest.mark.parametrize("sense", [(1, 1, 1, 1, 1, 1), (1, -1, 1, -1, -1, 1), (-1, 1, -1, 1, -1, -1)])
def test_robot_in_another_frame(cell: Cell, drawn: Any, shoulder: int, elbow: int, sense: Any) -> None:
    """A base that lies on its side, axes that count the other way: branches are those of the inverse all the same."""
    moved = pose_from(rotation_from_vector(np.array([0.9, -0.5, 1.3])), np.array([300.0, -800, 450]))
    turn, chain, way = moved[:3, :3], cell.chain, np.array(sense, float)[:, None]
    other = dataclasses.replace(
        chain,
        axes=way * chain.axes @ turn.T,
        points_mm=chain.points_mm @ turn.T + moved[:3, 3],
        base_from_flange_at_zero=moved @ chain.base_from_flange_at_zero,
        limits=np.sort(way * chain.limits, axis=1),
    )
    poses, tips, force = (part[:500] for part in drawn)
    poses, tips, force = moved @ poses, tips @ turn.T + moved[:3, 3], force @ turn.T
    found, said = displacements(fast_arm(other), K, poses, tips, force, shoulder=shoulder, elbow=elbow)
    turned = dataclasses.replace(cell, chain=other)
    (length, joints), (_, flip) = (reference(turned, poses, force, 4 * shoulder + 2 * elbow + i) for i in (0, 1))
    there = np.isfinite(length)
    assert np.abs(found / length - 1)[there].max() < 1e-9
    assert ((said == 0) == (np.isfinite(joints).all(axis=1) | np.isfinite(flip).all(axis=1))).all()


def test_stretched_wrist_is_called_singular(cell: Cell) -> None:
    poses = forward_kinematics(cell.chain, np.array([[0.1, 0.2, 0.3, 0.0, 0.0, 0.0]]))
    found, said = displacements(fast_arm(cell.chain), K, poses, poses[:, :3, 3], np.ones((1, 3)))
    assert CAUSES[said[0]] == "singular"
    assert np.isfinite(found).all()


def test_traverse_is_the_mean_over_explicit_poses(cell: Cell, table_a1: Float) -> None:
    """Around a posture that works: a turntable's angles, path points and cutter rotations, pose by pose."""
    arm, rng = fast_arm(cell.chain), np.random.default_rng(9)
    angles = np.radians(np.arange(0, 360, 24.0))
    start = forward_kinematics(cell.chain, table_a1[0]) @ cell.flange_from_cutter
    cutter = np.array(
        [
            [
                start @ pose_from(rotation_from_vector(rng.normal(size=3) / 10), rng.normal(size=3) * 40)
                for _ in range(4)
            ]
            for _ in range(3)
        ]
    )
    force = rng.normal(size=(3, 4, 3)) * 50
    load = cutter[..., :3, 3] + rng.normal(size=(3, 4, 3))
    path = LoadedPath(cell.flange_from_cutter, cutter, load, force)
    for shoulder, elbow in BRANCHES:
        mean, said = traverse(arm, K, path, angles, shoulder=shoulder, elbow=elbow)
        for t, angle in enumerate(angles):
            turned = cutter @ pose_from(rotation_from_vector(np.array([0, 0, angle])), np.zeros(3))
            flange = (turned @ inverse(cell.flange_from_cutter)).reshape(-1, 4, 4)
            found, one = displacements(
                arm, K, flange, load.reshape(-1, 3), force.reshape(-1, 3), shoulder=shoulder, elbow=elbow
            )
            assert np.allclose(mean[:, :, t], found.reshape(3, 4).mean(axis=1), rtol=1e-10)
            assert (said[:, :, t].min(axis=0) >= one.reshape(3, 4).max(axis=1)).all()
            assert ((said[:, :, t] == 0).any(axis=0) <= (one.reshape(3, 4) == 0).all(axis=1)).all()
    assert (traverse(arm, K, path, angles)[1] == 0).any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {
                "axes": np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [0.8, 0.6, 0], [0, 0, 1], [1, 0, 0.0]]),
                "points_mm": np.array([[0, 0, 780.0], [320, 0, 780], [320, 0, 2060]] + [[1912.5, 0, 2260]] * 3),
            },
            "axis 4 square",
        ),
    ],
)
def test_other_robots_are_refused(cell: Cell, change: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        fast_arm(dataclasses.replace(cell.chain, **change))
