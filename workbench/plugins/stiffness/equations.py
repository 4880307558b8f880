"""The equations of identification, eq. (24): what each load says about the joints' compliance; and their solution.

One load's displacement has the equations y = A c, c the compliance of the joints in rad/Nm. Rows are mm and rad of the
tool frame, or mm of the tracked points that were seen. `Loading` is what the estimator solves; which joints the loads
cannot determine is told in words.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from workbench.api import (
    AnyArray,
    Bool,
    Chain,
    Float,
    LoadingSetup,
    Shaped,
    estimator,
    forward_kinematics,
    frame_about,
    jacobian_at,
    joint_axes,
    motions,
)
from workbench.plugins.stiffness.elastic import MM, balance, way, wrench_at
from workbench.plugins.stiffness.values import LoadingTests

TYPICAL = 1e-6  # rad/Nm, to begin with
SOFTEST = 1e-3  # rad/Nm, three times the softest plausible
ALIKE = 0.9  # correlation above which two joints count as not told apart
SURE = 3.0  # standard uncertainties by which a compliance counts as negative
STEPS = 2  # of the balance, where the compliance is still sought: what is left is of the fourth order
LITTLE = 0.02  # torque over force times reach below which a load does not turn a joint


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """L loads with r rows each; rows of points that were not seen have weight 0 (`seen`)."""

    y: Shaped[Float, "L r"]  # mm, rad
    a: Shaped[Float, "L r 6"]  # with c in rad/Nm: first order
    torque: Shaped[Float, "L 6"]  # Nm, of each load about the joints
    by_wrench: Shaped[Float, "L 6 6"]  # torque = by_wrench @ the sensor's wrench
    jacobian: Shaped[Float, "L r 6"]  # of the rows: mm/rad, rad/rad
    across_n: Shaped[Float, "L 6"]  # force across each joint's axis
    reach_mm: Shaped[Float, "L 6"]  # of the sensor from the joint
    noise: Shaped[Float, " r"]  # standard deviation of a row
    wrench_noise: Shaped[Float, " 6"]  # N, Nm
    links: Shaped[Float, "L r 12"]  # with 1 rad/Nm of each bearing and link, two ways across its joint's axis
    seen: Shaped[Bool, "L r"]
    values: int  # of an observation: 6 of the tool frame, 3 of a tracked point
    predicted: Callable[[Float], Float]  # displacement (L, r) by the compliance, springs and loads in balance

    def residual(self, compliance: Float) -> Float:
        """Measured less modelled (L, r); 0 where nothing was seen."""
        return (self.y - self.predicted(compliance)) * self.seen


def equations(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Equations:
    """Equations of all loads; `tests.joints` in the controller's convention."""
    axes, points = joint_axes(chain, tests.joints)
    flange = forward_kinematics(chain, tests.joints)
    sensor = flange @ setup.flange_from_sensor
    turn = np.zeros((len(sensor), 6, 6))  # of unit wrenches, from the sensor's axes
    turn[:, :3, :3], turn[:, 3:, 3:] = sensor[:, :3, :3] / MM, sensor[:, :3, :3]
    in_base = wrench_at(sensor[:, :3, :3], np.zeros(3), tests.wrench)  # the sensor keeps its point

    def about(axes: Float) -> tuple[Float, Float, Float]:
        """Jacobian (L, r, 6) of the rows, torque by the wrench (L, 6, 6) and torque (L, 6) about axes (L, 6, 3)."""
        by_wrench = jacobian_at(axes, points, sensor[:, :3, 3]).mT @ turn
        torque = (by_wrench @ tests.wrench[..., None])[..., 0]
        if not tests.points:
            return jacobian_at(axes, points, (flange @ setup.flange_from_tool)[:, :3, 3]), by_wrench, torque
        targets = (flange[:, :3, :3] @ setup.targets_mm[: tests.points].T).mT + flange[:, None, :3, 3]
        each = [jacobian_at(axes, points, targets[:, k])[:, :3] for k in range(tests.points)]
        return np.concatenate(each, axis=1), by_wrench, torque

    jacobian, by_wrench, torque = about(axes)
    rotations = motions(chain, tests.joints)[:, :6, :3, :3]
    links = []
    for cross_axis in np.moveaxis(frame_about(chain.axes), 1, 0)[:2]:  # across each joint's axis
        moved, _, moment = about((rotations @ cross_axis[:, :, None])[..., 0])
        links.append(moved * moment[:, None, :])
    seen = np.isfinite(tests.moved)
    return Equations(
        y=np.where(seen, tests.moved, 0.0),
        a=jacobian * torque[:, None, :],
        torque=torque,
        by_wrench=by_wrench,
        jacobian=jacobian,
        across_n=np.linalg.norm(np.cross(axes, in_base[:, None, :3]), axis=2),
        reach_mm=np.linalg.norm(sensor[:, None, :3, 3] - points, axis=2),
        noise=setup.moved_noise(tests.points),
        links=np.concatenate(links, axis=2),
        seen=seen,
        values=3 if tests.points else 6,
        predicted=lambda compliance: displaced(chain, setup, compliance, tests, STEPS),
        wrench_noise=setup.wrench_noise,
    )


def displaced(
    chain: Chain, setup: LoadingSetup, compliance: Float, tests: LoadingTests, most: int | None = None
) -> Float:
    """Displacement (L, r) of the tool frame or the tracked points by the tests' joints and wrenches alone.

    The wrench keeps its direction in space; `most`: as in `elastic.balance`.
    """
    flange, joints = forward_kinematics(chain, tests.joints), tests.joints
    in_base = wrench_at((flange @ setup.flange_from_sensor)[:, :3, :3], np.zeros(3), tests.wrench)
    dq = balance(chain, compliance, joints, setup.flange_from_sensor[:3, 3], in_base, most)
    if not tests.points:
        return way(chain, joints, dq, setup.flange_from_tool[:3, 3])
    moved = (forward_kinematics(chain, joints + dq) - flange)[:, :3]
    ends = np.column_stack([setup.targets_mm[: tests.points], np.ones(tests.points)])
    return (moved @ ends.T).mT.reshape(len(joints), -1)


def covariances(eq: Equations, compliance: Float) -> Float:
    """Covariance (L, r, r) of each load's rows: noise of the displacement, and of the wrench through the robot."""
    through = (eq.jacobian * compliance) @ eq.by_wrench * eq.wrench_noise
    return through @ through.mT + np.diag(eq.noise**2)


class Loading:
    """Loads as the estimator sees them: unknown are the joints' compliance (6,), rad/Nm, and m causes (m,).

    An observation is what one load shows of the tool frame, or of one tracked point that was seen: n of them. Errors of
    the wrench belong to a load and act through the robot on all its points alike. A cause is what may be other than
    stated (`beyond_springs`): it moves the observations by `directions` (n, d, m), and is 0 but for `u` (m,), infinite
    where nothing is known of it.
    """

    def __init__(self, eq: Equations, directions: Float | None = None, u: Float | None = None) -> None:
        self.eq = eq
        self.load, self.point = np.nonzero(self._points(eq.seen).all(axis=2))
        none = np.zeros((len(self.load), eq.values, 0))
        self.directions, self.u = none if directions is None else directions, np.zeros(0) if u is None else u

    def _points(self, rows: Shaped[AnyArray, "L r ..."]) -> AnyArray:
        return rows.reshape(len(rows), -1, self.eq.values, *rows.shape[2:])

    def observed(self, rows: Float) -> Float:
        """What rows (L, r, ...) say of each observation (n, d, ...)."""
        return self._points(rows)[self.load, self.point]

    def rows(self, at: Float) -> estimator.Rows:
        """What the wrench's noise does through the joints follows the estimate."""
        eq, n, d = self.eq, len(self.load), self.eq.values
        own = self.observed((eq.jacobian * np.abs(at[:6])) @ eq.by_wrench * eq.wrench_noise)
        noise = self.observed(np.broadcast_to(eq.noise, eq.y.shape))
        alone = noise[:, :, None] ** 2 * np.eye(d)
        residual = self.observed(eq.residual(at[:6])) - self.directions @ at[6:]
        none, values, slope = np.zeros((6, 6)), np.full(n, float(d)), self.observed(eq.a)
        springs = estimator.Rows.posed(residual, slope, alone, own, self.load, values, none, none[0])
        return springs.beside(self.directions, at[6:], self.u)

    def moved(self, at: Float, step: Float) -> Float:
        """Loads that contradict each other make joints softer than any robot's: their balance would run away."""
        at = at + step
        return np.concatenate([np.clip(at[:6], -SOFTEST, SOFTEST), at[6:]])

    def misfits(self, rows: estimator.Rows) -> Float:
        """Chi-square of each load (L,) over how many values were seen of it."""
        of_load = [replace(rows.only(self.load == i), prior=0.0 * rows.prior) for i in range(len(self.eq.y))]
        return np.array([one.normal().chi2 / max(one.values.sum(), 1.0) for one in of_load])

    def fit(self, used: Bool | None = None) -> estimator.Fit[Float]:
        """The compliance by all loads, or the observations `used` (n,)."""
        return estimator.fit(self, np.append(np.full(6, TYPICAL), np.zeros(len(self.u))), used)


def unobserved(compliance: Float, covariance: Float, largest_relative_u: float) -> list[int]:
    """Joints (from 0) whose compliance has a relative uncertainty above the limit, the worst first."""
    relative = np.full(6, np.inf)
    np.divide(estimator.standard_u(covariance), compliance, out=relative, where=compliance > 1e-300)
    return [int(j) for j in np.argsort(-relative) if relative[j] > largest_relative_u]


def reason(joint: int, compliance: Float, covariance: Float, eq: Equations, force_n: Float) -> str:
    """Why the loads, with forces (L,), say too little about a joint."""
    torque = np.abs(eq.torque[:, joint])
    noise = np.linalg.norm(eq.by_wrench[:, joint] * eq.wrench_noise, axis=1)
    if (torque <= LITTLE * force_n * np.maximum(eq.reach_mm[:, joint], 100.0) / 1e3 + 3 * noise).all():
        if (eq.across_n[:, joint] <= LITTLE * np.maximum(force_n, 1e-12)).all():
            return "all forces are parallel to its axis: load in other directions too"
        return (
            f"every force acts through its axis or nearly so, as with an in-line tool (largest torque about it "
            f"{torque.max():.3g} Nm): load it through a lever beside its axis"
        )
    every = estimator.standard_u(covariance)
    u, correlation = every[joint], np.abs(covariance[joint] / (every * every[joint]))
    partners = " and ".join(str(j + 1) for j in np.flatnonzero(correlation > ALIKE) if j != joint)
    if partners:
        return f"its share cannot be told from that of joint {partners}: use postures and directions that part them"
    if compliance[joint] < -SURE * u:
        return (
            f"it would give way against its load, compliance {compliance[joint]:.2g} ± {u:.2g} rad/Nm: the axes "
            "of wrench and displacement do not belong together"
        )
    return (
        f"its loads are too small for the noise: torques up to {torque.max():.3g} Nm, compliance "
        f"{compliance[joint]:.2g} ± {u:.2g} rad/Nm"
    )
