"""On which side of its singularities an arm stands: eight branches, eight different answers."""

from typing import Any

import numpy as np
import pytest

from workbench.robot import Cell, Chain, arm_sides, forward_kinematics, inverse_kinematics, within_margins
from workbench.robot.cell_model import DIGITS
from workbench.robot.wrist import free_joint_3, level_joint_3


@pytest.mark.parametrize("name", ["irb6700", "kr210", "m20ia", "gp25", "puma", "ur10e"])
def test_each_branch_has_sides_of_its_own(arms: Any, name: str) -> None:
    chain: Chain = arms(name)
    count = 1000
    q = np.random.default_rng(5).uniform(chain.limits[:, 0], chain.limits[:, 1], (count, 6))
    branches = inverse_kinematics(chain, forward_kinematics(chain, q))
    solved = np.isfinite(branches[..., 0])
    code = np.full(solved.shape, -1)
    code[solved] = arm_sides(chain, branches[solved]) @ [4, 2, 1]
    for row in code:
        found = row[row >= 0]
        assert len(set(found)) == len(found)
    assert (solved.sum(axis=1) == 8).sum() > 0.15 * count


def test_the_upright_forward_arm_has_none(chain: Chain) -> None:
    """ABB's zero posture with the wrist bent down, then up; over its back; elbow down."""
    q = np.radians([[0, 0, 0, 0, 30, 0], [0, 0, 0, 0, -30, 0], [0, -60, -100, 0, 10, 0], [50, 20, -100, 0, 10, 0]])
    assert arm_sides(chain, q).astype(int).tolist() == [[0, 0, 0], [0, 0, 1], [1, 1, 0], [0, 1, 0]]


def test_the_level_joint_keeps_the_forearms_slope(arms: Any) -> None:
    """Joint 2 alone, as FANUC moves it: the forearm's direction stays, and the angles come back."""
    chain: Chain = arms("m20ia")
    level = np.radians([[10, 0, 20, 5, -40, 3], [10, 35, 20, 5, -40, 3]])
    free = free_joint_3(chain, level)
    turned = forward_kinematics(chain, free)[:, :3, :3]
    assert np.abs(turned[0] - turned[1]).max() < 1e-12
    assert np.abs(level_joint_3(chain, free) - level).max() < 1e-15


def test_what_is_planned_keeps_its_margin_in_fanucs_digits(cell: Cell) -> None:
    """Postures on the limits that planning keeps: joint 3 against the ground has the rounding of joint 2 besides."""
    planned = within_margins(cell).chain.limits
    q = np.random.default_rng(3).uniform(planned[:, 0], planned[:, 1], (3000, 6))
    at, side = np.arange(3000) % 6, np.arange(3000) // 6 % 2
    q[np.arange(3000), at] = planned[at, side]
    shown = np.round(np.degrees(level_joint_3(cell.chain, q)), DIGITS)
    read = free_joint_3(cell.chain, np.radians(shown))
    room = np.minimum(read - cell.chain.limits[:, 0], cell.chain.limits[:, 1] - read)
    assert room.min() >= cell.margins.limit
    bare = np.round(np.degrees(cell.chain.limits[2] + np.array([1, -1]) * cell.margins.limit), DIGITS)
    assert planned[2, 0] > np.radians(bare[0])  # the reserve is there, and small
    assert np.degrees(planned[2, 0]) - bare[0] < 0.002
