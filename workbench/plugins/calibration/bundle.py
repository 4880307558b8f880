"""Maximum likelihood on (x_c, z_c, w): Gauss-Newton from an answer of the sign search, gross postures left out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from workbench.api import Bool, Float, Shaped
from workbench.plugins.calibration.model import SIZE, Estimate, Linear, Noise, Normal, linearise, normal_equations
from workbench.plugins.calibration.observations import Observations, Passes
from workbench.plugins.calibration.signs import GATE, distances

STEPS = 30
CONVERGED = 1e-6  # of a step's length in standard deviations, squared
GROSS = float(scipy.special.chdtri(3, 1e-5))  # squared distance of a posture, left out of the fit, that is no chance
NO_CHANCE = 1e-3  # probability below which a misfit is no chance
GROSS_SHARE = 0.25  # of the postures: if more are off, it is not they but the model


@dataclass(frozen=True)
class Fit:
    """A fit and what it rests on: k observations, P unknowns."""

    estimate: Estimate
    covariance: Shaped[Float, "P P"]
    chi2: float
    freedom: int
    used: Shaped[Bool, " k"]


def fit(
    start: Estimate,
    seen: Observations | Passes,
    noise: Noise,
    *,
    used: Bool | None = None,
    with_offset: bool = False,
    steps: int = STEPS,
) -> Fit:
    """Least squares from `start` on the observations `used` (k,), None: all.

    Every step weights with the noise predicted at the estimate. The sphere's radius is pulled to the stated one; the
    pull is an observation like any other. `with_offset`: `seen` are passes whose clock offset is estimated too.
    """
    count = len(seen.circle)
    keep = np.ones(count, bool) if used is None else used

    def system(estimate: Estimate) -> Normal:
        here = seen.place(estimate.offset_s) if isinstance(seen, Passes) else seen
        here = here if keep.all() else here.subset(keep)
        return normal_equations(linearise(estimate, here, noise, with_offset), here, noise, estimate.radius_mm)

    estimate, now = start, system(start)
    for _ in range(steps):
        step = _step(now)
        moved, then = estimate, now
        for _ in range(6):
            moved = estimate.moved(step)
            then = system(moved)
            if then.chi2 < 1.5 * now.chi2 + 1.0:  # weights move with the estimate, so it may rise a little
                break
            step = step / 3
        length = float(step @ now.matrix @ step)
        estimate, now = moved, then
        if length < CONVERGED:
            break
    freedom = 3 * int(keep.sum()) + 1 - len(now.side)
    return Fit(estimate, _inverse(now.matrix), now.chi2, freedom, keep)


def _step(now: Normal) -> Float:
    """Gauss-Newton step (P,), none along what nothing determines; mm and rad differ in size, so scaled first."""
    scale = 1 / np.sqrt(np.maximum(np.diagonal(now.matrix), 1e-12))
    step = scale * np.linalg.lstsq(scale[:, None] * now.matrix * scale, scale * now.side, rcond=1e-13)[0]
    return np.asarray(step * min(1.0, 0.5 / max(float(np.linalg.norm(step[3:6])), 1e-12)))


def _inverse(information: Float) -> Float:
    """Inverse of an information matrix; huge, not infinite, in directions that nothing determines."""
    scale = 1 / np.sqrt(np.maximum(np.diagonal(information), 1e-12))
    values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    values = np.maximum(values, 1e-14)
    return np.asarray(scale[:, None] * (vectors / values) @ vectors.T * scale)


def without_gross(start: Estimate, seen: Observations, noise: Noise) -> Fit:
    """The fit without gross postures: begun with those that agree with `start`, settled one posture at a time.

    A posture is judged by its distance from the fit of the others. Where more than a quarter would go, none does: then
    it is not some postures that are off, but what is known about all of them.
    """
    count = len(seen)
    most = int(GROSS_SHARE * count) if count > 6 else 0
    near = distances(start, seen, noise) < 4 * GATE
    used = near if count - near.sum() <= most else np.ones(count, bool)
    result = fit(start, seen, noise, used=used)
    for _ in range(2 * most + 1):
        off = left_out(result, seen, noise) > GROSS
        worst = np.argmax(np.where(used & off, left_out(result, seen, noise), 0.0))
        back = ~used & ~off
        if back.any():
            used = used | back
        elif (used & off).any() and (~used).sum() < most:
            used = used.copy()
            used[worst] = False
        else:
            break
        result = fit(result.estimate, seen, noise, used=used)
    if (left_out(result, seen, noise)[used] > GROSS).any() or (~used).sum() > most:
        return fit(result.estimate, seen, noise)
    return result


def misfits(result: Fit) -> bool:
    """Whether the residuals are larger than the noise explains."""
    return bool(result.freedom > 0 and scipy.special.chdtrc(result.freedom, result.chi2) < NO_CHANCE)


def matched(result: Fit, seen: Observations, noise: Noise) -> tuple[Fit, Noise]:
    """The fit with the robot's noise as large as the residuals say, so that profiles keep their due weight.

    Postures that only the smaller noise made gross come back.
    """
    for _ in range(10):
        ratio = result.chi2 / result.freedom
        factor = float(np.clip(np.sqrt(ratio), 0.3, 10.0))
        noise = replace(noise, pose_mm=factor * noise.pose_mm, pose_deg=factor * noise.pose_deg)
        used = result.used | (left_out(result, seen, noise) < GROSS)
        if abs(ratio - 1) < 0.02 and (used == result.used).all():
            break
        result = fit(result.estimate, seen, noise, used=used)
    return result, noise


def left_out(result: Fit, seen: Observations, noise: Noise) -> Float:
    """Squared distance (k,) of every observation from the fit of the others (of all that count, for one left out)."""
    linear = linearise(result.estimate, seen, noise)
    J = linear.jacobian
    from_fit = J @ result.covariance[:SIZE, :SIZE] @ np.swapaxes(J, 1, 2)
    sign = np.where(result.used, -1.0, 1.0)[:, None, None]
    spread = linear.covariance + sign * from_fit
    r = linear.residual
    values, vectors = np.linalg.eigh(spread)  # a posture that alone determines a direction leaves no residual there
    values = np.where(values > 1e-6 * values[:, -1:], values, np.inf)
    along = (np.swapaxes(vectors, 1, 2) @ r[..., None])[..., 0]
    return np.asarray(np.sum(along**2 / values, axis=1))


def signed_centres(estimate: Estimate, linear: Linear, seen: Observations) -> Float:
    """Sphere centres (k, 3) in the profiler frame: measured x_c, z_c and |h|, which side by the answer."""
    h = np.sqrt(np.maximum(estimate.radius_mm**2 - seen.circle[:, 2], 0.0))
    return np.stack([seen.circle[:, 0], np.copysign(h, linear.centre[:, 1]), seen.circle[:, 1]], axis=1)


def to_base(centre: Float, estimate: Estimate, seen: Observations) -> Float:
    """Points (k, 3) of the profiler frame in the base."""
    flange = centre @ estimate.rotation.T + estimate.translation_mm
    return np.asarray((seen.base_from_flange[:, :3, :3] @ flange[..., None])[..., 0] + seen.base_from_flange[:, :3, 3])
