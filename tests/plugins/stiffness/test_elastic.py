"""Deflection against springs and load in balance, solved on pinocchio's kinematics by scipy."""

import dataclasses
import itertools
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import root

from workbench.plugins.stiffness import deflection, read
from workbench.plugins.stiffness.elastic import tangent_stiffness, wrench_at
from workbench.robot import Cell, forward_kinematics
from workbench.units import Float

from .conftest import ROOT, K


class Springs:
    """The flange's origin under a constant wrench: energy-free balance of torques, in m and rad."""

    def __init__(self) -> None:
        self.model = pin.buildModelFromUrdf(str(ROOT / "data" / "robot" / "irb6700_150_320.urdf"))
        self.data = self.model.createData()
        self.flange = self.model.getFrameId("tool0")

    def place(self, q: Float) -> Any:
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.flange].copy()

    def torque(self, q: Float, wrench: Float) -> Float:
        j = pin.computeFrameJacobian(self.model, self.data, q, self.flange, pin.LOCAL_WORLD_ALIGNED)
        return np.array(j.T @ wrench)

    def rest(self, q: Float, wrench: Float) -> Float:
        """Joint deflection at which K dq = J(q + dq)^T F."""
        found = root(lambda dq: dq - self.torque(q + dq, wrench) / K, np.zeros(6), tol=1e-15)
        dq = np.array(found.x)
        for _ in range(30):
            dq = self.torque(q + dq, wrench) / K
        assert np.abs(K * dq - self.torque(q + dq, wrench)).max() < 1e-12 * np.abs(K * dq).max()
        return dq

    def moved(self, q: Float, wrench: Float) -> Float:
        """Displacement in mm and rotation vector in rad."""
        before, after = self.place(q), self.place(q + self.rest(q, wrench))
        turn = pin.log3(after.rotation @ before.rotation.T)
        return np.concatenate([(after.translation - before.translation) * 1e3, turn])


@pytest.fixture(scope="module")
def springs() -> Springs:
    return Springs()


METHODS = ("balance", "linear_kc", "linear")


def wrenches(seed: int, count: int) -> Float:
    """Forces of 2,000 N in random directions, moments of up to 200 Nm."""
    f, m = np.random.default_rng(seed).normal(size=(2, count, 3))
    f, m = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (f, m))
    return np.hstack([2000 * f, 200 * np.random.default_rng(seed + 1).random((count, 1)) * m])


def test_methods_against_the_balance(cell: Cell, table_a1: Float, springs: Springs) -> None:
    """The stage with the flange for a tool: linear is off by 5e-3, with K_c by 2e-3, both as the load grows."""
    flange = dataclasses.replace(cell, flange_from_cutter=np.eye(4))
    off: dict[tuple[str, float], list[float]] = {}
    for q, w in itertools.product(table_a1, wrenches(1, 6)):
        for method, share in itertools.product(METHODS, (1.0, 0.5)):
            made = deflection(
                flange,
                read(cell),
                joints_deg=tuple(np.degrees(q)),
                force_n=tuple(share * w[:3]),
                torque_nm=tuple(share * w[3:]),
                method=method,
            )[0]
            found, truth = np.concatenate([made.displacement_mm, made.rotation]), springs.moved(q, share * w)
            parts = [np.linalg.norm((found - truth)[p]) / np.linalg.norm(truth[p]) for p in (slice(0, 3), slice(3, 6))]
            off.setdefault((method, share), []).append(float(max(parts)))
    worst = {method: max(off[method, 1.0]) for method in METHODS}
    assert worst["balance"] < 1e-9
    assert 5e-4 < worst["linear_kc"] < 4e-3 < 2 * worst["linear"] < 2e-2
    for method in ("linear_kc", "linear"):
        assert np.median(off[method, 1.0]) / np.median(off[method, 0.5]) == pytest.approx(2, rel=0.15)


def test_tangent_stiffness_is_the_derivative_of_the_balance(cell: Cell, table_a1: Float, springs: Springs) -> None:
    """Eq. (17) at the loaded posture against differences of the balance; force and moment, to 1e-6."""
    step = np.array([2.0] * 3 + [1.0] * 3)
    for q, w in zip(table_a1, wrenches(4, 3) + np.array([0, 0, 0, 150, -80, 60]), strict=True):
        loaded = q + springs.rest(q, w)
        stiffness = tangent_stiffness(cell.chain, K, loaded, np.zeros(3), w)
        compliance = np.empty((6, 6))
        for j in range(6):
            there, back = (springs.place(q + springs.rest(q, w + s * step * np.eye(6)[j])) for s in (1, -1))
            turn = pin.log3(there.rotation @ back.rotation.T)
            compliance[:, j] = np.concatenate([there.translation - back.translation, turn]) / (2 * step[j])
        assert np.abs(stiffness @ compliance - np.eye(6)).max() < 2e-5
        scale = np.sqrt(np.outer(np.diag(compliance), np.diag(compliance)))
        assert np.abs((np.linalg.inv(stiffness) - compliance) / scale).max() < 1e-6


def test_sensor_wrench_does_the_same_work_anywhere() -> None:
    """Eqs. (27), (28) put right: power of a wrench on a rigid body's motion does not depend on the point."""
    rng = np.random.default_rng(5)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    lever, sensor, turn, way = rng.normal(size=3) * 100, rng.normal(size=6), rng.normal(size=3), rng.normal(size=3)
    moved = wrench_at(rotation, lever, sensor)
    at_sensor = way + np.cross(turn, lever / 1e3)
    power = (rotation @ sensor[:3]) @ at_sensor + (rotation @ sensor[3:]) @ turn
    assert abs(moved[:3] @ way + moved[3:] @ turn - power) < 1e-12


def test_the_cutters_axes_and_angles_of_another_convention(cell: Cell) -> None:
    joints, load = (0, -3, 5, 45, -45, 225), np.array([900.0, 500.0, -400.0])
    plain = deflection(cell, read(cell), joints_deg=joints, force_n=tuple(load))[0]
    rotation = (forward_kinematics(cell.chain, np.radians(joints)) @ cell.flange_from_cutter)[:3, :3]
    turned = deflection(cell, read(cell), joints_deg=joints, force_n=tuple(rotation.T @ load), axes="cutter")[0]
    dh = deflection(cell, read(cell), joints_deg=(0, 93, -5, 45, 45, 45), angle_convention="dh", force_n=tuple(load))[0]
    for other in (turned, dh):
        assert np.allclose(other.displacement_mm, plain.displacement_mm, rtol=1e-12)
