"""Configurations as Yaskawa counts them, and the posture that a pose has with one."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.program.inform import Arm, inform_configuration
from workbench.robot import Cell, forward_kinematics

from .postured import cell_of


@pytest.fixture(scope="module")
def gp25(tmp_path_factory) -> Cell:
    return cell_of("gp25", tmp_path_factory.mktemp("cell"))


def test_yaskawa_says_the_configuration(gp25) -> None:
    """RCONF: flip 0 where R lies within 90 deg of a whole turn, lower arm 1, rear 1; R, T, S beyond +-180 deg."""
    chain = gp25.chain
    flip, no_flip = (0, 90, -89, 271, 360, -270, -360), (91, 180, 270, -90, -180, -269)
    for r in (*flip, *no_flip):
        assert inform_configuration(chain, np.radians([0, 0, 0, r, -90, 0]))[0] == (r in no_flip)
    assert inform_configuration(chain, np.radians([0, 0, 0, 0, 90, 0])) == (0, 0, 0, 0, 0, 0)
    assert inform_configuration(chain, np.radians([180, 60, 130, 185, -90, -200])) == (1, 1, 0, 1, 1, 0)
    assert inform_configuration(chain, np.radians([-180, -100, 60, -180, -90, 180]))[2:] == (1, 1, 0, 1)


def test_a_pose_and_its_configuration_are_one_posture(gp25) -> None:
    """All of 300 random postures of which no joint is beyond 180 deg come back; beyond it, joint 6 has two."""
    chain = gp25.chain
    arm, rng = Arm(chain, gp25.flange_from_cutter, np.eye(4)), np.random.default_rng(7)
    for _ in range(300):
        joints = rng.uniform(*np.clip(chain.limits, -3.1, 3.1).T)
        found = arm.postures(arm.pose(forward_kinematics(chain, joints)), inform_configuration(chain, joints))
        assert len(found) == 1
        assert np.abs(found[0] - joints).max() < 1e-6
    joints = np.radians([10, 20, -10, 30, -60, 200])
    found = arm.postures(arm.pose(forward_kinematics(chain, joints)), inform_configuration(chain, joints))
    assert len(found) == 1  # -160 deg is not beyond 180, and 200 - 720 deg is beyond the limits
