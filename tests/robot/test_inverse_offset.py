"""Arms whose wrist is offset along axis 5: every posture comes back, and a search from many starts finds no more."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from workbench.errors import InputError
from workbench.robot import Chain, forward_kinematics, inverse_kinematics, jacobian
from workbench.robot.wrist import offset_wrist
from workbench.units import Float

from .conftest import apart

STRETCHED = {"ur10e": 0.0, "crx10ia": np.pi / 2}  # joint 3


def drawn(name: str, where: str, count: int) -> Float:
    """Random postures (count, 6): anywhere, with the arm nearly stretched, or axis 6 nearly along axis 4."""
    rng = np.random.default_rng(8)
    q = rng.uniform(-np.pi, np.pi, (count, 6))
    near = rng.choice([-1, 1], count) * 10.0 ** rng.uniform(-4, -1, count)
    if where == "stretched":
        q[:, 2] = STRETCHED[name] + near
    elif where == "wrist":
        q[:, 4] = near
    return np.asarray(q)


@pytest.mark.parametrize("where", ["anywhere", "stretched", "wrist"])
@pytest.mark.parametrize("name", STRETCHED)
def test_every_posture_comes_back(arms: Any, name: str, where: str) -> None:
    chain: Chain = arms(name)
    q = drawn(name, where, 1000)
    poses = forward_kinematics(chain, q)
    found = inverse_kinematics(chain, poses)
    assert np.nanmin(apart(found, q[:, None]), axis=1).max() < 1e-6
    solved = np.isfinite(found[..., 0])
    back = forward_kinematics(chain, np.nan_to_num(found))
    assert np.abs(back - poses[:, None])[solved].max() < 1e-6
    if where == "anywhere":
        assert set(solved.sum(axis=1)) <= {2, 4, 6, 8, 12, 16}
        assert (solved.sum(axis=1) == 16).any() == (name == "crx10ia")


def test_poses_out_of_a_file_are_reached(arms: Any) -> None:
    """Rounded to 8 digits their rotations are none."""
    chain: Chain = arms("ur10e")
    poses = forward_kinematics(chain, np.radians([[10, -70, 100, -60, -80, 30], [50, -100, 60, -30, 70, 0]]))
    found = inverse_kinematics(chain, np.round(poses, 7))
    back = forward_kinematics(chain, np.nan_to_num(found))
    assert np.isfinite(found[..., 0]).sum() == 16
    assert np.abs(back - poses[:, None])[np.isfinite(found[..., 0])].max() < 1e-4


def test_many_starts_find_no_other(arms: Any) -> None:
    """CRX-10iA, for which EAIK has no decomposition: least squares from 120 random starts at each of two poses."""
    chain: Chain = arms("crx10ia")
    rng = np.random.default_rng(9)
    poses = forward_kinematics(chain, rng.uniform(-np.pi, np.pi, (2, 6)))
    ours = inverse_kinematics(chain, poses)
    for pose, branches in zip(poses, ours, strict=True):
        there = branches[np.isfinite(branches[:, 0])]
        seen = np.zeros(len(there), bool)

        def miss(q: Any, pose: Any = pose) -> Any:
            here = forward_kinematics(chain, q)
            turn = Rotation.from_matrix(pose[:3, :3] @ here[:3, :3].T).as_rotvec()
            return np.append((pose[:3, 3] - here[:3, 3]) / 1e3, turn)

        def slope(q: Any) -> Any:
            return -jacobian(chain, q) / np.array([[1e3], [1e3], [1e3], [1.0], [1.0], [1.0]])

        for start in rng.uniform(-np.pi, np.pi, (120, 6)):
            solution = least_squares(miss, start, slope, method="lm", xtol=1e-14, ftol=1e-14, max_nfev=200)
            if np.abs(solution.fun).max() < 1e-9:
                away = apart(there, solution.x)
                assert away.min() < 1e-5
                seen |= away < 1e-5
        assert seen.sum() >= len(there) - 2


def test_wrists_of_another_kind_are_refused(arms: Any) -> None:
    """Axis 6 beside axis 5."""
    chain: Chain = arms("ur10e")
    points = chain.points_mm.copy()
    points[5] += [30, 0, 0]
    other = replace(chain, points_mm=points)
    assert offset_wrist(chain) is not None
    assert offset_wrist(other) is None
    with pytest.raises(InputError, match="wrist is not spherical"):
        inverse_kinematics(other, np.eye(4))
