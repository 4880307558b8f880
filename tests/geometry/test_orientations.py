"""Orientations as controllers have them, between two, and motions that are none: against scipy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation, Slerp

from tests.geometry.test_poses import share, signs, turns, wxyz
from workbench.geometry import poses
from workbench.geometry.poses import CONVENTIONS, ORDERS, quaternions, rotation_from_quaternion
from workbench.units import Float

ANGLES = np.random.default_rng(5).uniform(-3.1, 3.1, (40, 3))


@given(turns, turns, share, signs, signs)
def test_slerp_agrees_with_scipy_whatever_the_signs(a: Float, b: Float, at: float, p: float, q: float) -> None:
    ends = Rotation.from_rotvec([a, b])
    if (ends[0].inv() * ends[1]).magnitude() > 3.1:
        return  # no way is the shorter one
    found = poses.slerp(p * wxyz(ends[0]), q * wxyz(ends[1]), np.array(at))
    np.testing.assert_allclose(rotation_from_quaternion(found), Slerp([0, 1], ends)(at).as_matrix(), rtol=0, atol=1e-9)


def improper() -> dict[str, Float]:
    good = poses.pose_from(poses.rotation_from_rpy(0.1, 0.2, 0.3), np.array([1.0, 2.0, 3.0]))
    bad = {name: good.copy() for name in ("scaled", "mirrored", "sheared", "last row", "not finite", "huge")}
    bad["scaled"][:3, :3] *= 1.00001
    bad["mirrored"][:3, 0] *= -1
    bad["sheared"][0, 1] += 1e-5
    bad["last row"][3, 0] = 1e-3
    bad["huge"][0, 0] = 1e200
    bad["not finite"][0, 3] = np.nan
    assert poses.is_rigid(good)
    return {**bad, "shape": good[:3]}


@pytest.mark.parametrize(("name", "pose"), improper().items())
def test_improper_motions_are_told(name: str, pose: Float) -> None:
    assert not poses.is_rigid(pose), name


def matrices(values: Float, convention: str) -> Float:
    return rotation_from_quaternion(quaternions(values, convention))


@pytest.mark.parametrize("order", ORDERS)
def test_euler_orders_agree_with_scipy(order: str) -> None:
    # scipy: lower case turns about axes that stay, upper case about the moving ones
    extrinsic, intrinsic = Rotation.from_euler(order, ANGLES), Rotation.from_euler(order.upper(), ANGLES)
    np.testing.assert_allclose(matrices(ANGLES, f"euler_{order}_extrinsic"), extrinsic.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(matrices(ANGLES, f"euler_{order}_intrinsic"), intrinsic.as_matrix(), atol=1e-12)


def test_twelve_orders_no_two_alike() -> None:
    assert len(set(ORDERS)) == 12
    assert len(set(CONVENTIONS)) == len(CONVENTIONS) == 34
