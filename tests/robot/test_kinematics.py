"""Our kernels against pinocchio, and the Jacobian's derivative against differences of pinocchio's Jacobian."""

from typing import Any

import numpy as np

from workbench.robot import Chain, abb_angles, forward_kinematics, jacobian, jacobian_derivative

METRES = np.array([1e-3] * 3 + [1.0] * 3)[:, None]


def test_jacobian_is_pins_at_a_point_of_the_flange(chain: Chain, by_pin: Any, postures: Any) -> None:
    point = np.array([260.0, -35.0, 140.0])
    q = postures(100, 2)
    ours = METRES * jacobian(chain, q, point)
    assert np.abs(ours - [by_pin.jacobian(one, point / 1e3) for one in q]).max() < 1e-12
    assert np.abs(METRES * jacobian(chain, q[0]) - by_pin.jacobian(q[0], np.zeros(3))).max() < 1e-12


def test_derivative_of_the_jacobian(chain: Chain, by_pin: Any, postures: Any) -> None:
    point, step = np.array([260.0, -35.0, 140.0]), 1e-6
    for q in postures(5, 3):
        ours = jacobian_derivative(METRES * jacobian(chain, q, point))
        for j in range(6):
            there, back = q + step * np.eye(6)[j], q - step * np.eye(6)[j]
            difference = by_pin.jacobian(there, point / 1e3) - by_pin.jacobian(back, point / 1e3)
            assert np.abs(ours[:, :, j] - difference / (2 * step)).max() < 1e-8


def test_dh_convention_is_the_standard_dh_chain(chain: Chain) -> None:
    """Denavit-Hartenberg's own product of matrices, with the robot's lengths, is what 'dh' angles mean."""
    theta = np.radians([12.0, 93.0, -5.0, 45.0, 33.0, -70.0])
    a, d, alpha = (320, 1280, 200, 0, 0, 0), (780, 0, 0, 1592.5, 0, 200), np.radians((90, 0, 90, -90, 90, 0))
    pose = np.eye(4)
    for t, length, offset, twist in zip(theta, a, d, alpha, strict=True):
        (c, s), (ca, sa) = (np.cos(t), np.sin(t)), (np.cos(twist), np.sin(twist))
        pose = pose @ [
            [c, -s * ca, s * sa, length * c],
            [s, c * ca, -c * sa, length * s],
            [0, sa, ca, offset],
            [0, 0, 0, 1],
        ]
    assert np.abs(forward_kinematics(chain, abb_angles(theta, "dh")) - pose).max() < 1e-9
