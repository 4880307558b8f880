"""The equations of identification, eq. (24): what each load says about the joints' compliance; and their solution.

One *observation* is one load's displacement: its equations y = A c, c the compliance of the joints in rad/Nm. Rows are
mm and rad of the tool frame, or mm of the tracked points that were seen.

They are solved by weighted least squares, gross errors found and rejected; which joints the loads cannot determine is
told in words.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from workbench.api import (
    AnyArray,
    Chain,
    Float,
    LoadingSetup,
    Shaped,
    forward_kinematics,
    jacobian_at,
    jacobian_derivative,
    joint_axes,
)
from workbench.plugins.stiffness.elastic import MM, geometric_stiffness, torques, wrench_at
from workbench.plugins.stiffness.values import LoadingTests

GROSS = 1e-4  # chance that a sound set of loads loses one
ITERATIONS = 6
TYPICAL = 1e-6  # rad/Nm, scales the unknowns
SOFTEST = 1e-3  # rad/Nm, three times the softest plausible
WIDE = 1e-3  # rad/Nm, standard deviation of a prior that decides nothing: it keeps what no load determines finite
ALIKE = 0.9  # correlation above which two joints count as not told apart
SURE = 3.0  # standard uncertainties by which a compliance counts as negative
LITTLE = 0.02  # torque over force times reach below which a load does not turn a joint


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """L loads with r rows each; rows of points that were not seen have weight 0 (`seen`)."""

    y: Shaped[Float, "L r"]  # mm, rad
    a: Shaped[Float, "L r 6"]  # with c in rad/Nm: first order
    curved: Shaped[Float, "L r 6 6"]  # second derivative of y by joint deflection: mm/rad^2, 1/rad
    torque: Shaped[Float, "L 6"]  # Nm, of each load about the joints
    by_wrench: Shaped[Float, "L 6 6"]  # torque = by_wrench @ the sensor's wrench
    jacobian: Shaped[Float, "L r 6"]  # of the rows: mm/rad, rad/rad
    kc: Shaped[Float, "L 6 6"]  # Nm/rad, of the load at its own posture
    noise: Shaped[Float, " r"]  # standard deviation of a row
    wrench_noise: Shaped[Float, " 6"]  # N, Nm
    seen: Shaped[Float, "L r"]  # 1 or 0


def equations(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Equations:
    """Equations of all loads; `tests.joints` in the controller's convention."""
    axes, points = joint_axes(chain, tests.joints)
    flange = forward_kinematics(chain, tests.joints)
    sensor = flange @ setup.flange_from_sensor
    at_sensor = jacobian_at(axes, points, sensor[:, :3, 3])
    tip = (flange @ setup.flange_from_tool)[:, :3, 3]
    at_tip = jacobian_at(axes, points, tip)
    wrench = wrench_at(sensor[:, :3, :3], sensor[:, :3, 3] - tip, tests.wrench)
    torque = torques(at_tip, wrench)
    derivative = jacobian_derivative(axes, at_tip)
    jacobian, curved, y, noise = _rows(tests, setup, axes, points, flange, at_tip, derivative)
    seen = np.isfinite(y)
    return Equations(
        y=np.where(seen, y, 0.0),
        a=jacobian * torque[:, None, :],
        curved=curved,
        torque=torque,
        by_wrench=_by_wrench(at_sensor, sensor),
        jacobian=jacobian,
        kc=_kc(axes, at_sensor, sensor, tests.wrench),
        noise=noise,
        seen=seen.astype(float),
        wrench_noise=np.array([setup.force_noise_n] * 3 + [setup.torque_noise_nm] * 3),
    )


def _rows(
    tests: LoadingTests,
    setup: LoadingSetup,
    axes: Float,
    points: Float,
    flange: Float,
    at_tip: Float,
    derivative: Float,
) -> tuple[Float, Float, Float, Float]:
    """Jacobian, second derivative, measured displacement and noise of the rows of every load."""
    if tests.targets_mm is None:
        noise = np.array([setup.displacement_noise_mm] * 3 + [setup.rotation_noise] * 3)
        assert tests.displacement is not None
        return at_tip, derivative, tests.displacement, noise
    count, k = tests.targets_mm.shape[:2]
    at = (flange[:, None] @ np.column_stack([setup.targets_mm[:k], np.ones(k)])[:, :, None])[..., :3, 0]
    of_points = [jacobian_at(axes, points, at[:, i]) for i in range(k)]
    jacobian = np.concatenate([j[:, :3] for j in of_points], axis=1)
    curved = np.concatenate([jacobian_derivative(axes, j)[:, :3] for j in of_points], axis=1)
    return jacobian, curved, tests.targets_mm.reshape(count, 3 * k), np.full(3 * k, setup.target_noise_mm)


def _by_wrench(at_sensor: Float, sensor: Float) -> Float:
    """Joint torques of the unit wrenches in the sensor's axes."""
    turn = np.zeros((len(sensor), 6, 6))
    turn[:, :3, :3], turn[:, 3:, 3:] = sensor[:, :3, :3] / MM, sensor[:, :3, :3]
    return np.asarray(np.swapaxes(at_sensor, -1, -2) @ turn)


def _kc(axes: Float, at_sensor: Float, sensor: Float, wrench: Float) -> Float:
    """K_c of the load where it acts: the sensor keeps its point, the force its direction."""
    in_base = wrench_at(sensor[:, :3, :3], np.zeros(3), wrench)
    return geometric_stiffness(jacobian_derivative(axes, at_sensor), in_base)


def curvature(eq: Equations, compliance: Float) -> Float:
    """What the second order adds to y (L, r): K_c in the joints' deflection and the curvature of the way."""
    dq = eq.torque * compliance
    by_kc = np.einsum("lri,i,lij,lj->lr", eq.jacobian, compliance, eq.kc, dq)
    return np.asarray(by_kc + 0.5 * np.einsum("lrij,li,lj->lr", eq.curved, dq, dq))


def covariances(eq: Equations, compliance: Float) -> Float:
    """Covariance (L, r, r) of each load's rows: noise of the displacement, and of the wrench through the robot."""
    through = (eq.jacobian * compliance) @ eq.by_wrench * eq.wrench_noise
    return through @ np.swapaxes(through, -1, -2) + np.diag(eq.noise**2)


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Compliance of the joints and what the loads say about it."""

    compliance: Shaped[Float, " 6"]  # rad/Nm
    covariance: Shaped[Float, "6 6"]
    misfit: Shaped[Float, " L"]  # chi-square of each load
    rows: Shaped[Float, " L"]  # how many rows each has
    residual: Shaped[Float, "L r"]  # measured minus modelled
    scale2: float  # variance of the residuals over what the noise predicts
    freedom: float  # its degrees of freedom

    @property
    def u(self) -> Float:
        """Standard uncertainties (6,), rad/Nm."""
        return np.sqrt(np.diag(self.covariance))


def solve(eq: Equations, use: Float) -> Estimate:
    """Compliance from the loads with `use` (L,) 1; weights and second order follow the estimate until it rests.

    The noise of the wrench acts through the compliance itself, so weights depend on it. A joint that no load turns gets
    a compliance near 0 and a huge variance, not an error.
    """
    compliance: Float = np.full(6, TYPICAL)
    for iteration in range(ITERATIONS):
        whitened = whiten(eq, np.abs(compliance)) * use[:, None, None]
        extra = curvature(eq, compliance) if iteration else 0.0
        a = (whitened @ eq.a).reshape(-1, 6) * TYPICAL
        y = (whitened @ (eq.y - extra)[..., None]).reshape(-1)
        information = a.T @ a + np.eye(6) * (TYPICAL / WIDE) ** 2
        # softer joints than any robot's come of loads that contradict each other: their second order would run away
        found = np.clip(TYPICAL * np.linalg.solve(information, a.T @ y), -SOFTEST, SOFTEST)
        resting = np.abs(found - compliance).max() < 1e-10 * np.abs(found).max()
        compliance = found
        if resting:
            break
    residual = (eq.y - curvature(eq, compliance) - eq.a @ compliance) * eq.seen
    misfit = np.sum((whiten(eq, np.abs(compliance)) @ residual[..., None])[..., 0] ** 2, axis=1)
    rows = eq.seen.sum(axis=1)
    freedom = max(float((rows * use).sum()) - 6, 1.0)
    covariance: AnyArray = np.linalg.inv(information) * TYPICAL**2
    return Estimate(compliance, covariance, misfit, rows, residual, float((misfit * use).sum()) / freedom, freedom)


def whiten(eq: Equations, compliance: Float) -> Float:
    """(L, r, r) that turns rows into independent ones of variance 1; what was not seen becomes 0."""
    covariance = covariances(eq, compliance)
    both = eq.seen[:, :, None] * eq.seen[:, None, :]
    hidden = (1 - eq.seen)[:, :, None] * np.eye(eq.seen.shape[1])
    lower = np.linalg.cholesky(covariance * both + hidden)
    return np.asarray(np.linalg.inv(lower) * eq.seen[:, None, :])


def excess(found: Estimate, use: Float) -> Float:
    """(L,) misfit of each load in use over what chance explains; above 1 it contradicts the others.

    Judged against the noise or, where all loads fit worse than that, against the spread of most of them.
    """
    inside = (use > 0) & (found.rows > 0)
    if not inside.any():
        return np.zeros(len(use))
    level = scipy.special.chdtri(found.rows, GROSS / len(use))
    spread = max(1.0, float(np.median(found.misfit[inside] / scipy.special.chdtri(found.rows[inside], 0.5))))
    return np.asarray(np.where(inside, found.misfit / np.maximum(level * spread, 1e-300), 0.0))


def robust(eq: Equations) -> tuple[Estimate, Float]:
    """The estimate, and which loads it rests on (L,): the worst is rejected as long as chance does not explain it.

    At most a fifth of them: where one more contradicts the rest, see `excess`.
    """
    use = np.ones(len(eq.y))
    found = solve(eq, use)
    for _ in range(len(use) // 5):
        over = excess(found, use)
        if over.max() <= 1:
            break
        use[int(np.argmax(over))] = 0.0
        found = solve(eq, use)
    return found, use


def unobserved(found: Estimate, largest_relative_u: float) -> list[int]:
    """Joints (from 0) whose compliance has a relative uncertainty above the limit, the worst first."""
    relative = np.full(6, np.inf)
    np.divide(
        found.u * np.sqrt(max(found.scale2, 1.0)), found.compliance, out=relative, where=found.compliance > 1e-300
    )
    return [int(j) for j in np.argsort(-relative) if relative[j] > largest_relative_u]


def reason(joint: int, found: Estimate, eq: Equations, chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> str:
    """Why the loads say too little about a joint."""
    axes, points = joint_axes(chain, tests.joints)
    sensor = forward_kinematics(chain, tests.joints) @ setup.flange_from_sensor
    force = (sensor[:, :3, :3] @ tests.wrench[:, :3, None])[..., 0]
    size = np.linalg.norm(force, axis=1)
    torque = np.abs(eq.torque[:, joint])
    reach_mm = np.linalg.norm(sensor[:, :3, 3] - points[:, joint], axis=1)
    little = torque <= LITTLE * size * np.maximum(reach_mm, 100.0) / 1e3 + 3 * _torque_noise(eq, joint)
    if little.all():
        across = np.linalg.norm(np.cross(axes[:, joint], force), axis=1)
        if (across <= LITTLE * np.maximum(size, 1e-12)).all():
            return "all forces are parallel to its axis: load in other directions too"
        return (
            f"every force acts through its axis or nearly so, as with an in-line tool (largest torque about it "
            f"{torque.max():.3g} Nm): load it through a lever beside its axis"
        )
    partners = _alike(joint, found.covariance)
    if partners:
        names = " and ".join(str(j + 1) for j in partners)
        return f"its share cannot be told from that of joint {names}: use postures and directions that part them"
    u = found.u[joint] * np.sqrt(max(found.scale2, 1.0))
    if found.compliance[joint] < -SURE * u:
        return (
            f"it would give way against its load, compliance {found.compliance[joint]:.2g} ± {u:.2g} rad/Nm: the axes "
            "of wrench and displacement do not belong together"
        )
    return (
        f"its loads are too small for the noise: torques up to {torque.max():.3g} Nm, compliance "
        f"{found.compliance[joint]:.2g} ± {u:.2g} rad/Nm"
    )


def _torque_noise(eq: Equations, joint: int) -> Float:
    return np.asarray(np.linalg.norm(eq.by_wrench[:, joint] * eq.wrench_noise, axis=1))


def _alike(joint: int, covariance: Float) -> list[int]:
    u = np.sqrt(np.diag(covariance))
    correlation = np.abs(covariance[joint] / (u * u[joint]))
    return [int(j) for j in np.flatnonzero(correlation > ALIKE) if j != joint]
