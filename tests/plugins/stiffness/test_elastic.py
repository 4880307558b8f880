"""Deflection against springs and load in balance, solved on pinocchio's kinematics by scipy."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import root

from workbench.plugins.stiffness import deflection, read
from workbench.plugins.stiffness.elastic import balance, geometric_stiffness, give_way, tangent_stiffness, wrench_at
from workbench.robot import Cell, forward_kinematics, jacobian, jacobian_derivative, joint_axes
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


def wrenches(seed: int, count: int) -> Float:
    """Forces of 2,000 N in random directions."""
    f = np.random.default_rng(seed).normal(size=(count, 3))
    return np.hstack([2000 * f / np.linalg.norm(f, axis=1, keepdims=True), np.zeros((count, 3))])


def relative(found: Float, truth: Float) -> Float:
    return np.linalg.norm(found - truth, axis=-1) / np.linalg.norm(truth, axis=-1)


def test_orders_against_the_balance_at_2000_n(cell: Cell, table_a1: Float, springs: Springs) -> None:
    """At the paper's postures: linear is off by 5e-3, linear with K_c by 2e-3, second order by some 1e-5."""
    loads = wrenches(1, 20)
    q = np.repeat(table_a1, len(loads), axis=0)
    w = np.tile(loads, (3, 1))
    truth = np.array([springs.moved(a, b) for a, b in zip(q, w, strict=True)])
    flange = np.zeros(3)
    second, _ = give_way(cell.chain, K, q, flange, w)
    linear_kc, _ = give_way(cell.chain, K, q, flange, w, order=1)
    linear, _ = give_way(cell.chain, K, q, flange, w, order=1, with_kc=False)
    for part in (slice(0, 3), slice(3, 6)):
        assert np.median(relative(second[:, part], truth[:, part])) < 1e-5
        assert relative(second[:, part], truth[:, part]).max() < 2.5e-5
    assert 5e-4 < relative(linear_kc[:, :3], truth[:, :3]).max() < 3e-3
    assert 2e-3 < relative(linear[:, :3], truth[:, :3]).max() < 6e-3


def test_orders_over_random_postures_and_wrenches(cell: Cell) -> None:
    """2,000 N and up to 200 Nm at 1,000 postures: the third order to 1e-8; the second errs by the load's square."""
    rng, n = np.random.default_rng(5), 1000
    low, high = np.clip(cell.chain.limits, -np.pi, np.pi).T
    q, moment = rng.uniform(low, high, (n, 6)), rng.normal(size=(n, 3))
    moment *= (200 * rng.random(n) / np.linalg.norm(moment, axis=1))[:, None]
    w, tip = np.hstack([wrenches(6, n)[:, :3], moment]), cell.flange_from_cutter[:3, 3]
    left = {}
    for share in (1.0, 0.5):
        truth = np.array([balance(cell.chain, K, a, tip, share * b)[0] for a, b in zip(q, w, strict=True)])
        for order in (2, 3):
            found, _ = give_way(cell.chain, K, q, tip, share * w, order=order)
            left[order, share] = np.array([relative(found[:, p], truth[:, p]) for p in (slice(0, 3), slice(3, 6))])
    assert left[3, 1.0].max() < 1e-8
    assert 5e-6 < np.median(left[2, 1.0]) < 1e-5
    assert 1e-5 < np.quantile(left[2, 1.0], 0.95) < 3e-5
    for order, power in ((2, 4), (3, 16)):
        assert np.isclose(np.median(left[order, 1.0]) / np.median(left[order, 0.5]), power, rtol=0.02)


def test_balance_is_the_balance(cell: Cell, table_a1: Float, springs: Springs) -> None:
    rng = np.random.default_rng(2)
    for q in table_a1:
        w = np.concatenate([wrenches(3, 1)[0, :3], 200 * rng.normal(size=3)])
        moved, dq = balance(cell.chain, K, q, np.zeros(3), w)
        assert np.abs(dq - springs.rest(q, w)).max() < 1e-13
        assert relative(moved, springs.moved(q, w)) < 1e-10


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


def test_kc_of_a_force_is_symmetric_and_of_a_moment_not(cell: Cell, table_a1: Float) -> None:
    derivative = jacobian_derivative(joint_axes(cell.chain, table_a1)[0], jacobian(cell.chain, table_a1))
    of_force = geometric_stiffness(derivative, np.array([300.0, -200, 100, 0, 0, 0]))
    of_moment = geometric_stiffness(derivative, np.array([0.0, 0, 0, 50, 80, -30]))
    assert np.abs(of_force - np.swapaxes(of_force, 1, 2)).max() < 1e-9
    assert np.abs(of_moment - np.swapaxes(of_moment, 1, 2)).max() > 1


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


def test_stage_methods_and_axes(cell: Cell) -> None:
    """The stage on the cutter's tip: methods approach the balance, and cutter axes are turned base axes."""
    joints = (0, -3, 5, 45, -45, 225)
    load = np.array([900.0, 500.0, -400.0])
    found = {
        m: deflection(cell, read(cell), joints_deg=joints, force_n=tuple(load), method=m)[0]
        for m in ("balance", "third_order", "second_order", "linear_kc", "linear")
    }
    off = [
        np.linalg.norm(found[m].displacement_mm - found["balance"].displacement_mm)
        for m in ("third_order", "second_order", "linear_kc", "linear")
    ]
    assert off[0] < off[1] / 100 < off[2] / 1000
    assert off[2] < off[3]
    rotation = (forward_kinematics(cell.chain, np.radians(joints)) @ cell.flange_from_cutter)[:3, :3]
    turned = deflection(cell, read(cell), joints_deg=joints, force_n=tuple(rotation.T @ load), axes="cutter")[0]
    assert np.allclose(turned.displacement_mm, found["balance"].displacement_mm, rtol=1e-12)
    dh = deflection(cell, read(cell), joints_deg=(0, 93, -5, 45, 45, 45), angle_convention="dh", force_n=tuple(load))[0]
    assert np.allclose(dh.displacement_mm, found["balance"].displacement_mm, rtol=1e-12)
