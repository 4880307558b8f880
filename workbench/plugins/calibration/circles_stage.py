"""`calibrate.circles`: the sphere's circle in every profile of a calibration recording.

Its arc is found by random samples (RANSAC), then fitted by maximum likelihood. A laser plane cuts a sphere in a circle,
of which the sensor sees the side that faces it: z = z_c + s sqrt(w - (x - x_c)^2) with w the circle's squared radius
and s the sense of z, +1 where z counts towards the sensor. The noise acts along z, so the fit is one of z on x, in
exactly the unknowns (x_c, z_c, w) that the calibration needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from workbench.api import (
    TO_SD,
    Bool,
    Float,
    InputError,
    Int,
    Limits,
    Recording,
    Shaped,
    frozen,
    kernel,
    refuse_unsound,
    stage,
)
from workbench.plugins.calibration.values import Rejected, SphereProfiles

SAMPLES = 500  # of three points; 15 % of a frame on the sphere give 20 good ones
SCORED = 400  # points that judge a sample
STEEP = 0.95  # |x - x_c| / r beyond which a point is left out: the surface is too steep for a sensor
LATERAL = 0.1  # noise along x, as a share of that along z: keeps steep points from ruling the fit
TUKEY = 4.685  # cut-off of the biweight in standard deviations: 95 % efficient (Beaton and Tukey 1974)
GATE = 4.0  # standard deviations within which a point lies on the arc
GAP = 0.4  # in sphere radii: a wider gap in x ends an arc
MIN_POINTS = 12
MIN_SPAN = 0.7  # of the arc in x, in circle radii: 41 deg
MAX_RADIUS_U = 0.1  # standard uncertainty of the circle's radius, in sphere radii


# Gaps that a sensor fills along a face lie on a sphere's arc to a micrometre, and its ends are not measured; the share
# of few frames goes up and down by a quarter with any one of them.
HARMLESS: dict[str, float | tuple[float, float]] = {"held_end_share": 1.0}


@kernel
def _through(x: Float, z: Float, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Circle (x_c, z_c, w) through three points; w = 0 where they lie on a line."""
    ux, uz, vx, vz = x[b] - x[a], z[b] - z[a], x[c] - x[a], z[c] - z[a]
    cross = 2.0 * (ux * vz - uz * vx)
    if abs(cross) < 1e-9:
        return 0.0, 0.0, 0.0
    u, v = ux * ux + uz * uz, vx * vx + vz * vz
    dx, dz = (vz * u - uz * v) / cross, (ux * v - vx * u) / cross
    return x[a] + dx, z[a] + dz, dx * dx + dz * dz


@kernel
def _score(x: Float, z: Float, xc: float, zc: float, w: float, sense: float, gate: float) -> float:
    """How well a circle explains the points above its chord: truncated squares; a point elsewhere costs a little."""
    score = 0.0
    step = max(1, len(x) // SCORED)
    for k in range(0, len(x), step):
        dx = x[k] - xc
        q2 = w - dx * dx
        if q2 < (1 - STEEP * STEEP) * w:
            continue
        q = np.sqrt(q2)
        e = abs(z[k] - zc - sense * q) * q / np.sqrt(w)  # distance across the surface
        score += 1.0 - (e / gate) ** 2 if e < gate else -0.2
    return score * step


@kernel
def search_arc(x: Float, z: Float, radius: float, gate: float, sense: float, seed: int) -> tuple[Float, float]:
    """Best circle of up to `SAMPLES` through three points: (x_c, z_c, w, sense) and its score; w = 0: none.

    `x`, `z` (n,) in the order of the columns; `radius` of the sphere; `gate` the distance within which a point counts;
    `sense` +-1, or 0: whichever fits better. A circle is no larger than the sphere allows (5 % and the gate more).
    """
    np.random.seed(seed)
    n = len(x)
    best, best_score = np.zeros(4), 0.0
    for _ in range(SAMPLES):
        a, reach = np.random.randint(n), (0.3 + 1.5 * np.random.random()) * radius
        c = a
        while c < n - 1 and abs(x[c] - x[a]) < reach:
            c += 1
        if c - a < 4 or abs(x[c] - x[a]) > 2 * radius:
            continue
        b = a + 1 + np.random.randint(c - a - 1)
        xc, zc, w = _through(x, z, a, b, c)
        if w < (0.15 * radius) ** 2 or w > (1.05 * radius + gate) ** 2:
            continue
        s = 1.0 if z[b] > zc else -1.0
        if (sense != 0.0 and s != sense) or s * (z[a] - zc) <= 0 or s * (z[c] - zc) <= 0:
            continue
        score = _score(x, z, xc, zc, w, s, gate)
        if score > best_score:
            best_score = score
            best[0], best[1], best[2], best[3] = xc, zc, w, s
    return best, best_score


@kernel
def _residuals(x: Float, z: Float, circle: Float, sense: float) -> Float:
    """Residuals along z over what a point's noise is, relative to sigma; infinite off the arc's span."""
    out = np.full(len(x), np.inf)
    for k in range(len(x)):
        dx = x[k] - circle[0]
        q2 = circle[2] - dx * dx
        if q2 >= (1 - STEEP * STEEP) * circle[2]:
            out[k] = (z[k] - circle[1] - sense * np.sqrt(q2)) / np.sqrt(1.0 + LATERAL**2 * dx * dx / q2)
    return out


@kernel
def fit_arc(x: Float, z: Float, start: Float, sense: float, sigma: float) -> tuple[Float, Float, float, bool]:
    """Maximum-likelihood circle from a start: (x_c, z_c, w), the inverse of its normal matrix (3, 3), scale, success.

    The covariance is sigma^2 times that matrix. Robust by Tukey's biweight, whose scale comes down from the start's
    misfit to the points' own (median absolute residual), never below `sigma`.
    """
    circle, inverse = start[:3].copy(), np.zeros((3, 3))
    scale = sigma
    for step in range(30):
        off = _residuals(x, z, circle, sense)
        near = np.abs(off) < 0.3 * np.sqrt(circle[2])
        if near.sum() < 8:
            return circle, inverse, scale, False
        off, dx = off[near], x[near] - circle[0]
        scale = max(sigma, TO_SD * np.median(np.abs(off)))
        q = np.sqrt(circle[2] - dx * dx)
        spread = np.sqrt(1.0 + (LATERAL * dx / q) ** 2)  # of a point along z, over sigma
        weight = np.maximum(1.0 - (off / (TUKEY * scale)) ** 2, 0.0) / spread
        rows = np.stack((sense * dx / q, np.ones(len(q)), sense / (2.0 * q))) * weight
        matrix, side = rows @ rows.T, rows @ (weight * spread * off)
        if not np.linalg.det(matrix) > 1e-9:
            return circle, inverse, scale, False
        inverse[:] = np.linalg.inv(matrix)
        change = inverse @ side
        limit = max(abs(change[0]), abs(change[1]), abs(change[2]) / (2 * np.sqrt(circle[2])))
        circle += change * min(1.0, 0.2 * np.sqrt(circle[2]) / max(limit, 1e-12))
        if circle[2] <= 0:
            return circle, inverse, scale, False
        if step > 2 and limit < 1e-7:
            break
    return circle, inverse, scale, True


def on_arc(x: Float, z: Float, circle: Float, sense: float, sigma: float, gap: float) -> Bool:
    """Which points (n,), in the order of the columns, make the largest contiguous arc: no gap in x wider than `gap`."""
    good = np.abs(_residuals(x, z, circle, sense)) < GATE * sigma
    run = np.cumsum(np.abs(np.diff(x[good], prepend=x[good][:1])) > gap)
    good[good] = run == np.bincount(run, minlength=1).argmax()
    return good


def returns(x_mm: Any, z_mm: Any) -> tuple[Float, Float, Int]:
    """Points of one frame that came back, in float64, and their columns."""
    columns = np.flatnonzero(np.isfinite(x_mm) & np.isfinite(z_mm))
    return x_mm[columns].astype(float), z_mm[columns].astype(float), columns


@dataclass(frozen=True)
class Arc:
    """One frame's arc: its circle, the inverse normal matrix, scale of the residuals, points and their residuals."""

    frame: int
    circle: Shaped[Float, " 3"]  # x_c, z_c, w
    inverse: Shaped[Float, "3 3"]  # covariance for unit noise
    residual: Shaped[Float, " points"]  # along z
    columns: Shaped[Int, " points"]
    sense: float


@stage("calibrate.circles")
def circles(
    recording: Recording,
    *,
    profile_noise_mm: Annotated[float, Field(gt=0, le=1)] = 0.015,
    limits: Limits = {},  # noqa: B006  (never changed)
) -> SphereProfiles:
    """Find the calibration sphere in each profile and fit the circle of its section (the paper's section 3.2, Fig. 4).

    RANSAC, then maximum likelihood with the noise along z, from the largest contiguous arc (docs/calibration.md).

    Args:
        recording: a calibration recording (with /sphere).
        profile_noise_mm: least standard deviation of a point along z; more where the arcs show more.
        limits: limits of checks by name (docs/checks.md). `held_end_share` is judged only if it is named here.

    Raises:
        InputError: no sphere in the recording's header, no arc of it in any frame, or a recording that fails a check.

    Example:
        >>> from workbench import scan
        >>> from workbench.plugins import calibration
        >>> ball = scan.read(recording="data/synthetic/sphere.h5")
        >>> arcs = calibration.circles(ball)
        >>> arcs.sphere_diameter_mm
        10.0
    """
    if recording.sphere_diameter_mm is None:
        raise InputError(f"{recording.source}: /sphere@diameter_mm", "missing: not a calibration recording")
    refuse_unsound(recording, HARMLESS | limits, "calibrate.circles.limits")
    radius = recording.sphere_diameter_mm / 2
    gate_sigma = _noise(recording, profile_noise_mm, radius)
    found, rejected = _arcs(recording, radius, gate_sigma)
    if not found:
        cause = rejected[0].cause if rejected else "no frame"
        raise InputError(f"{recording.source}: /profiles", f"no arc of the sphere in any frame: frame 0: {cause}")
    return _profiles(recording, found, rejected, profile_noise_mm)


def _noise(recording: Recording, least_mm: float, radius: float) -> float:
    """Noise of a point, as a gate for the search: the median frame's, within the least and a fiftieth of the sphere.

    From second differences along a profile: blind to slopes, robust to jumps.
    """
    each = [np.abs(np.diff(returns(*one)[1], 2)) for one in zip(recording.x_mm, recording.z_mm, strict=True)]
    sizes = [np.median(one) * TO_SD / np.sqrt(6.0) if len(one) > 2 else np.inf for one in each]
    return float(np.clip(np.median(sizes), least_mm, 0.02 * radius))


def _arcs(recording: Recording, radius: float, sigma: float) -> tuple[list[Arc], list[Rejected]]:
    """Arcs of all frames, of one sense: that of most points; frames that chose the other are searched again."""
    frames = range(len(recording.time_s))
    first = [_arc(recording, frame, radius, sigma, 0.0) for frame in frames]
    votes = sum(arc.sense * len(arc.columns) for arc in first if isinstance(arc, Arc))
    sense = 1.0 if votes >= 0 else -1.0
    again = [
        _arc(recording, frame, radius, sigma, sense) if isinstance(arc, Arc) and arc.sense != sense else arc
        for frame, arc in zip(frames, first, strict=True)
    ]
    return [arc for arc in again if isinstance(arc, Arc)], [arc for arc in again if isinstance(arc, Rejected)]


def _arc(recording: Recording, frame: int, radius: float, sigma: float, sense: float) -> Arc | Rejected:
    """The arc in one frame, or why there is none."""
    x, z, columns = returns(recording.x_mm[frame], recording.z_mm[frame])
    if len(x) < MIN_POINTS:
        return Rejected(frame, f"{len(x)} returns, expected at least {MIN_POINTS} on the sphere")
    start, score = search_arc(x, z, radius, GATE * sigma, sense, frame)
    if score < MIN_POINTS:
        return Rejected(frame, "no arc of the sphere in view")
    near = np.abs(x - start[0]) < np.sqrt(start[2])
    x, z, columns = x[near], z[near], columns[near]
    good = np.ones(len(x), np.bool_)
    for _ in range(3):  # what lies beyond a gap does not count, and the circle decides where the gap is
        circle, inverse, scale, fitted = fit_arc(x[good], z[good], start, start[3], sigma)
        if not fitted:
            return Rejected(frame, "no circle fits the points of the arc")
        start = np.append(circle, start[3])
        good = on_arc(x, z, circle, start[3], scale, GAP * radius)
        if good.sum() < MIN_POINTS:
            return Rejected(frame, f"{good.sum()} points on the arc, expected at least {MIN_POINTS}")
    cause = _implausible(x[good], circle, inverse, scale, radius)
    if cause:
        return Rejected(frame, cause)
    residual = z[good] - circle[1] - start[3] * np.sqrt(circle[2] - (x[good] - circle[0]) ** 2)
    return Arc(frame, circle, inverse, residual, columns[good], start[3])


def _implausible(x: Float, circle: Float, inverse: Float, scale: float, radius: float) -> str:
    """Why a circle cannot be a section of the sphere; empty if it can."""
    r = np.sqrt(circle[2])
    u = scale * np.sqrt(inverse[2, 2]) / (2 * r)
    if np.ptp(x) < MIN_SPAN * r:
        return f"the arc spans {np.ptp(x):.2f} mm of a circle of radius {r:.2f} mm: too little to fit it"
    if u > MAX_RADIUS_U * radius:
        return f"the circle's radius is uncertain by {u:.2f} mm"
    if r > 1.05 * radius + 4 * u:
        return f"the circle's radius is {r:.2f} mm, more than the sphere's {radius:.2f} mm"
    return ""


def _profiles(recording: Recording, found: list[Arc], rejected: list[Rejected], least_mm: float) -> SphereProfiles:
    """All arcs together: the noise they share, and the covariances that follow."""
    assert recording.sphere_diameter_mm is not None
    each = np.array([_spread(arc.residual) for arc in found])
    noise = max(least_mm, np.sqrt(np.mean(each**2)))
    correlation = _correlation(found)
    points = np.array([len(arc.columns) for arc in found])
    noisier = each > noise * (1 + 4 / np.sqrt(2 * points))  # beyond chance: such a frame counts for less
    own = np.where(noisier, each, noise)
    inflation = (1 + correlation) / (1 - correlation)  # of a mean's variance, where neighbours say the same
    covariance = np.stack([arc.inverse for arc in found]) * (own**2 * inflation)[:, None, None]
    on_arc: Bool = np.zeros(recording.x_mm.shape, np.bool_)
    for arc in found:
        on_arc[arc.frame, arc.columns] = True
    return SphereProfiles(
        frame=frozen(np.array([arc.frame for arc in found])),
        circle=frozen(np.stack([arc.circle for arc in found])),
        covariance=frozen(covariance),
        on_arc=frozen(on_arc),
        sense=int(found[0].sense),
        noise_mm=noise,
        stated_noise_mm=least_mm,
        correlation=correlation,
        sphere_diameter_mm=recording.sphere_diameter_mm,
        rejected=tuple(rejected),
    )


def _spread(residual: Float) -> float:
    """Standard deviation of residuals along z about a circle: robust, since steep points scatter more."""
    return float(TO_SD * np.median(np.abs(residual)) * np.sqrt(len(residual) / max(1, len(residual) - 3)))


def _correlation(found: list[Arc]) -> float:
    """First autocorrelation of the residuals, pooled; 0 where it is within its own noise."""
    pairs = [(arc.residual[1:], arc.residual[:-1]) for arc in found]
    product = sum(a @ b for a, b in pairs)
    power = sum(arc.residual @ arc.residual for arc in found)
    count = sum(len(a) for a, _ in pairs)
    correlation = product / max(power, 1e-300)
    return float(min(correlation, 0.9)) if correlation > 3 / np.sqrt(max(count, 1)) else 0.0
