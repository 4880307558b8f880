"""The inverse against EAIK (Ostermeier, Kuelz, Althoff 2025), an independent solver: the same set of branches.

EAIK also gives least-squares answers where a pose cannot be had. Those that miss the pose are left out by forward
kinematics, which is pin's (test_kinematics.py). Where no axes are parallel or meet it marks all its answers as such,
and they reach the pose to 4e-7 only; least squares miss it by far more there.
"""

from typing import Any

import numpy as np
import pytest

from workbench.robot import Chain, forward_kinematics, inverse_kinematics
from workbench.units import Float

from .conftest import apart, missing

EAIK = pytest.importorskip("eaik.pybindings.EAIK", reason="EAIK has no wheel for this Python")
MOST = 64  # answers of EAIK, least squares included
REACHES, ROUGHLY = 1e-9, 1e-6  # m, 1
SAME = 1e-6  # rad
ARMS = ["irb6700", "puma", "skewed", "oblique"]


def random(chain: Chain, q: Float, rng: np.random.Generator) -> None:
    """As drawn within limits."""


def on_limits(chain: Chain, q: Float, rng: np.random.Generator) -> None:
    """Three of the joints on a limit."""
    for row in q:
        joints = rng.choice(6, 3, replace=False)
        row[joints] = chain.limits[joints, rng.integers(0, 2, 3)]


def wrist_nearly_stretched(chain: Chain, q: Float, rng: np.random.Generator) -> None:
    q[:, 4] = rng.choice([-1, 1], len(q)) * 10.0 ** rng.uniform(-4, -2, len(q))


def forearm_nearly_stretched(chain: Chain, q: Float, rng: np.random.Generator) -> None:
    """The shipped robot's wrist centre nearly in line with axes 2 and 3."""
    q[:, 2] = -np.arctan2(1592.5, 200) + rng.choice([-1, 1], len(q)) * 10.0 ** rng.uniform(-4, -2, len(q))


def assert_same_branches(chain: Chain, q: Float, misses: float = 1e-12) -> None:
    """Ours and EAIK's at the poses of postures `q` (n, 6)."""
    poses = forward_kinematics(chain, q)
    ours, theirs = inverse_kinematics(chain, poses), peer(chain, poses)
    assert np.nanmax(missing(chain, ours, poses)) < misses
    distance = apart(ours[:, :, None], theirs[:, None])
    distance[np.isnan(distance)] = np.inf
    assert (distance.min(axis=1)[np.isfinite(theirs[..., 0])] < SAME).all()
    assert (distance.min(axis=2)[np.isfinite(ours[..., 0])] < SAME).all()
    assert np.isfinite(ours[..., 0]).sum() > 3 * len(q)


def peer(chain: Chain, poses: Float) -> Float:
    """EAIK's answers (n, MOST, 6) that reach the poses (n, 4, 4); NaN: fewer."""
    points = np.vstack([np.zeros(3), chain.points_mm, chain.base_from_flange_at_zero[:3, 3]]) / 1e3
    turn = chain.base_from_flange_at_zero[:3, :3]
    robot: Any = EAIK.Robot(chain.axes.T, np.diff(points, axis=0).T, turn, [], True)
    metres = poses.copy()
    metres[:, :3, 3] /= 1e3
    found, marked = np.full((len(poses), MOST, 6), np.nan), True
    for row, solution in zip(found, robot.calculate_IK_batched(list(metres), 1), strict=True):
        if len(solution.Q):
            row[: len(solution.Q)] = solution.Q
            marked = marked and all(solution.is_LS)
    found[~(missing(chain, found, poses) < (ROUGHLY if marked else REACHES))] = np.nan
    return found


@pytest.mark.parametrize("where", [random, on_limits, wrist_nearly_stretched, forearm_nearly_stretched])
def test_shipped_robot_has_the_branches_of_eaik(chain: Chain, postures: Any, where: Any) -> None:
    q = postures(4000 if where is random else 1000, 41)
    where(chain, q, np.random.default_rng(41))
    assert_same_branches(chain, q)


@pytest.mark.parametrize("where", [random, on_limits])
@pytest.mark.parametrize("name", ARMS[1:])
def test_other_robots_have_the_branches_of_eaik(arms: Any, name: str, where: Any) -> None:
    chain, rng = arms(name), np.random.default_rng(42)
    q = rng.uniform(chain.limits[:, 0], chain.limits[:, 1], (1000, 6))
    where(chain, q, rng)
    assert_same_branches(chain, q)


def test_an_offset_wrist_has_the_branches_of_eaik(arms: Any) -> None:
    """UR10e: ours are roots of a polynomial, EAIK's a closed form."""
    chain = arms("ur10e")
    assert_same_branches(chain, np.random.default_rng(44).uniform(-np.pi, np.pi, (500, 6)), REACHES)
