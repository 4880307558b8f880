"""The optimiser for any arm: the kernels' own numbers where those hold, and an UR that mills."""

from dataclasses import replace

import numpy as np
import pytest

from workbench.api import inverse, pose_from, rotation_from_vector
from workbench.plugins.stiffness.arm import (
    BRANCHES,
    Arm,
    GeneralArm,
    LoadedPath,
    arm_of,
)
from workbench.robot import Cell, forward_kinematics, inverse_kinematics, spherical_wrist
from workbench.units import Float

from .conftest import K


@pytest.mark.parametrize("sense", [(1, 1, 1, 1, 1, 1), (1, -1, 1, -1, -1, 1), (-1, 1, -1, 1, -1, -1)])
def test_the_numbers_are_the_kernels(cell: Cell, sense: tuple[int, ...]) -> None:
    """Displacement, verdict and joint angles by branch, of a robot on its side whose axes may count backwards."""
    side = pose_from(rotation_from_vector(np.array([0.9, -0.5, 1.3])), np.array([300.0, -800, 450]))
    way, old = np.array(sense, float)[:, None], cell.chain
    limits = np.sort(way * old.limits, axis=1)
    limits[3] = np.radians([-100, 170])  # to one side less far than to the other
    chain = replace(
        old,
        axes=way * old.axes @ side[:3, :3].T,
        points_mm=old.points_mm @ side[:3, :3].T + side[:3, 3],
        base_from_flange_at_zero=side @ old.base_from_flange_at_zero,
        limits=limits,
    )
    arm, general = arm_of(chain, K), GeneralArm(chain, K)
    assert isinstance(arm, Arm)
    rng, low, high = np.random.default_rng(3), *np.clip(chain.limits.T, -np.pi, np.pi)
    cutter = forward_kinematics(chain, rng.uniform(low, high, (300, 1, 6))) @ cell.flange_from_cutter
    load, acts = cutter[..., :3, 3] + rng.normal(0, 100, (300, 1, 3)), rng.normal(0, 100, (300, 1, 3))
    cutter[::3] = cutter[1]  # some turn with the rotation only
    angles, flange = np.radians([0, 60, -90]), cutter[:, 0] @ inverse(cell.flange_from_cutter)
    given = (LoadedPath(cell.flange_from_cutter, cutter, load, acts), angles)
    found, told = ([one.traverse(*given, branch) for branch in range(BRANCHES)] for one in (arm, general))
    alike = []
    for branch, (fast, said) in enumerate(found):
        assert set(np.unique(said)) == {0, 2, 3}
        same = [(np.sort(said, axis=0) == np.sort(other, axis=0)).all() for _, other in told]
        alike.append(same.index(True))
        assert np.allclose(fast[said < 3], told[alike[-1]][0][said < 3], rtol=1e-8)
        for row in (2 * branch, 2 * branch + 1):
            wanted = inverse_kinematics(chain, flange)[:, row]
            there = np.isfinite(wanted[:, 0])
            ours = arm.joint_angles(flange[there], row)
            assert np.abs((ours - wanted[there] + np.pi) % (2 * np.pi) - np.pi).max() < 1e-9
    assert sorted(alike) == [0, 1, 2, 3]  # whatever the sides of the arm are called


def test_a_wrist_on_axis_1_or_2_has_finite_angles(cell: Cell) -> None:
    """Joint 1 is free there, and 0 as the inverse has it: forward kinematics tells whether the posture is one."""
    arm, chain = arm_of(cell.chain, K), cell.chain
    centre, flange = spherical_wrist(chain).centre_mm, chain.base_from_flange_at_zero
    on_axis_1, on_axis_2 = flange.copy(), flange.copy()
    on_axis_1[:2, 3] += chain.points_mm[0, :2] - centre[:2]
    on_axis_2[:3, 3] += chain.points_mm[1] - centre
    on_axis_1[2, 3] = 2000.0
    reached = 0
    for row in range(8):
        found = arm.joint_angles(np.stack([on_axis_1, on_axis_2]), row)
        assert np.isfinite(found).all()
        assert found[0, 0] == 0.0
        reached += np.abs(forward_kinematics(chain, found[0]) - on_axis_1).max() < 1e-6
    assert reached >= 2
    path = LoadedPath(cell.flange_from_cutter, *_still(on_axis_1 @ cell.flange_from_cutter))
    for branch in range(BRANCHES):
        moved, said = arm.traverse(path, np.zeros(1), branch)
        assert np.isfinite(moved).all()
        assert set(np.unique(said)) <= {1, 3}


def _still(cutter: Float) -> tuple[Float, Float, Float]:
    return cutter[None, None], cutter[None, None, :3, 3], np.full((1, 1, 3), 50.0)
