"""Controllers' orientations against scipy and against worked examples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.geometry.poses import CONVENTIONS, ORDERS, components, quaternions, rotation_from_quaternion
from workbench.units import Float

ANGLES = np.random.default_rng(5).uniform(-3.1, 3.1, (40, 3))


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


def test_fanuc_turns_about_fixed_axes_w_first() -> None:
    """W = 90 takes z to -y; R = 90 then takes that to +x (fixed axes, x before z)."""
    moved = matrices(np.radians([[90.0, 0.0, 90.0]]), "fanuc_wpr")[0] @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(moved, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(
        matrices(ANGLES, "fanuc_wpr"), Rotation.from_euler("xyz", ANGLES).as_matrix(), atol=1e-12
    )


def test_kuka_turns_about_its_own_axes_a_first() -> None:
    """A = 90 takes the tool's x to the base's y; B = 90 about the new y then takes its x down, whatever C is."""
    moved = matrices(np.radians([[90.0, 90.0, 17.0]]), "kuka_abc")[0] @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(moved, [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(matrices(ANGLES, "kuka_abc"), Rotation.from_euler("ZYX", ANGLES).as_matrix(), atol=1e-12)


@pytest.mark.parametrize("name", ["ur", "rotation_vector"])
def test_rotation_vectors_agree_with_scipy(name: str) -> None:
    np.testing.assert_allclose(matrices(ANGLES, name), Rotation.from_rotvec(ANGLES).as_matrix(), atol=1e-12)


def test_quaternion_orders() -> None:
    scipy_order = Rotation.from_euler("xyz", ANGLES).as_quat()  # x y z w
    want = Rotation.from_quat(scipy_order).as_matrix()
    np.testing.assert_allclose(matrices(scipy_order, "quaternion_xyzw"), want, atol=1e-12)
    for name in ("quaternion_wxyz", "abb"):
        np.testing.assert_allclose(matrices(np.roll(scipy_order, 1, axis=1), name), want, atol=1e-12)


def test_numbers_an_orientation() -> None:
    assert {name for name in CONVENTIONS if components(name) == 4} == {"abb", "quaternion_wxyz", "quaternion_xyzw"}
