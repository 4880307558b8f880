"""Arms whose wrist is offset along axis 5: every posture comes back, and a search from many starts finds no more."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from workbench.errors import InputError
from workbench.robot import Chain, forward_kinematics, inverse_kinematics
from workbench.robot.wrist import offset_wrist

from .conftest import apart


@pytest.mark.parametrize("name", ["ur10e", "crx10ia"])
def test_every_posture_comes_back(arms: Any, name: str) -> None:
    chain: Chain = arms(name)
    q = np.random.default_rng(8).uniform(-np.pi, np.pi, (200, 6))
    poses = forward_kinematics(chain, q)
    found = inverse_kinematics(chain, poses)
    assert found.shape == (200, 16, 6)
    assert np.nanmin(apart(found, q[:, None]), axis=1).max() < 1e-6
    solved = np.isfinite(found[..., 0])
    back = forward_kinematics(chain, np.nan_to_num(found))
    assert np.abs(back - poses[:, None])[solved].max() < 1e-6
    assert set(solved.sum(axis=1)) <= {2, 4, 6, 8, 10, 12, 14, 16}
    assert (solved.sum(axis=1) == 16).any() == (name == "crx10ia")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur10e", "crx10ia"])
def test_twenty_thousand_postures(arms: Any, name: str) -> None:
    """Some minutes."""
    chain: Chain = arms(name)
    q = np.random.default_rng(80).uniform(-np.pi, np.pi, (20_000, 6))
    own = np.nanmin(apart(inverse_kinematics(chain, forward_kinematics(chain, q)), q[:, None]), axis=1)
    assert (own < 1e-6).all()


@pytest.mark.parametrize(
    ("name", "q"),
    [
        ("ur10e", (0.2939108936159691, 1.5562950334705574, 0.0145784487, -1.45054429, -0.85568572, 2.98464329)),
        ("ur10e", (0.2498368743686412, 1.5768051007875785, 0.0205182689, -2.26832706, 1.48927543, 0.35067339)),
        ("crx10ia", (-2.487283721846379, -1.18973036180235, -1.5703121605, -2.91212321, 0.77290715, -1.51887089)),
        ("crx10ia", (0.7130545803475243, -0.6706464657454223, -1.5706651416, 0.20084199, 1.77984123, -0.47377189)),
        ("crx10ia", (2.0582358731609673, -2.643580270237281, 2.56696779705, -0.14874167, 2.65863578, 0.24365863)),
    ],
)
def test_ways_between_two_places_of_the_grid(arms: Any, name: str, q: tuple[float, ...]) -> None:
    """Of joint 6: the arm is nearly stretched in the first four, the wrist's centre near axis 1 in the last."""
    chain: Chain = arms(name)
    found = inverse_kinematics(chain, forward_kinematics(chain, np.array(q)))
    assert np.nanmin(apart(found, np.array(q))) < 1e-6


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

        for start in rng.uniform(-np.pi, np.pi, (120, 6)):
            solution = least_squares(miss, start, method="lm", xtol=1e-14, ftol=1e-14, max_nfev=200)
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
