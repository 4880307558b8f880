"""`calibrate.circles`: the sphere's circle in every profile of a calibration recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.api import Bool, Float, InputError, Int, Recording, Shaped, frozen, refuse_unsound, stage
from workbench.plugins.calibration import arcs
from workbench.plugins.calibration.values import Rejected, SphereProfiles

MIN_POINTS = 12
MIN_SPAN = 0.7  # of the arc in x, in circle radii: 41 deg
MAX_RADIUS_U = 0.1  # standard uncertainty of the circle's radius, in sphere radii


# Gaps that a sensor fills along a face lie on a sphere's arc to a micrometre, and its ends are not measured; the share
# of few frames goes up and down by a quarter with any one of them.
HARMLESS: dict[str, float | tuple[float, float]] = {"held_end_share": 1.0}


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
    limits: dict[str, float | tuple[float, float]] = {},  # noqa: B006  (never changed)
) -> SphereProfiles:
    """Find the calibration sphere in each profile and fit the circle of its section (the paper's section 3.2, Fig. 4).

    Circles through three points are tried (RANSAC) and the best is fitted by maximum likelihood with the noise along z
    (docs/calibration.md). Circle centre, squared radius and their covariance come from the largest contiguous arc.

    Args:
        recording: a calibration recording (with /sphere).
        profile_noise_mm: least standard deviation of a point along z; where the arcs show more, that counts.
        limits: limits of the checks of units, sensor and copies by name, where the default ones do not fit
            (docs/checks.md). `held_end_share` is not judged unless it is named here.

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
    """Noise of a point, as a gate for the search: the median frame's, within the least and a tenth of the sphere."""
    each = [arcs.second_differences(arcs.returns(x, z)[1]) for x, z in zip(recording.x_mm, recording.z_mm, strict=True)]
    return float(np.clip(np.median(each), least_mm, 0.02 * radius))


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
    x, z, columns = arcs.returns(recording.x_mm[frame], recording.z_mm[frame])
    if len(x) < MIN_POINTS:
        return Rejected(frame, f"{len(x)} returns, expected at least {MIN_POINTS} on the sphere")
    start, score = arcs.search(x, z, radius, arcs.GATE * sigma, sense, frame)
    if score < MIN_POINTS:
        return Rejected(frame, "no arc of the sphere in view")
    near = np.abs(x - start[0]) < np.sqrt(start[2])
    x, z, columns = x[near], z[near], columns[near]
    good = np.ones(len(x), np.bool_)
    for _ in range(3):  # what lies beyond a gap does not count, and the circle decides where the gap is
        circle, inverse, scale, fitted = arcs.fit(x[good], z[good], start, start[3], sigma)
        if not fitted:
            return Rejected(frame, "no circle fits the points of the arc")
        start = np.append(circle, start[3])
        good = arcs.on_arc(x, z, circle, start[3], scale, arcs.GAP * radius)
        if good.sum() < MIN_POINTS:
            return Rejected(frame, f"{good.sum()} points on the arc, expected at least {MIN_POINTS}")
    cause = _implausible(x[good], circle, inverse, scale, radius)
    if cause:
        return Rejected(frame, cause)
    residual = z[good] - circle[1] - start[3] * np.sqrt(circle[2] - (x[good] - circle[0]) ** 2)
    return Arc(frame, circle, inverse, residual, columns[good], float(start[3]))


def _implausible(x: Float, circle: Float, inverse: Float, scale: float, radius: float) -> str:
    """Why a circle cannot be a section of the sphere; empty if it can."""
    r = float(np.sqrt(circle[2]))
    u = float(scale * np.sqrt(inverse[2, 2]) / (2 * r))
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
    noise = max(least_mm, float(np.sqrt(np.mean(each**2))))
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
        residual_mm=frozen(each),
        points=frozen(points),
        on_arc=frozen(on_arc),
        sense=int(found[0].sense),
        noise_mm=noise,
        stated_noise_mm=least_mm,
        correlation=correlation,
        sphere_diameter_mm=recording.sphere_diameter_mm,
        rejected=tuple(rejected),
        source=recording.source,
    )


def _spread(residual: Float) -> float:
    """Standard deviation of residuals along z about a circle: robust, since steep points scatter more."""
    return float(1.4826 * np.median(np.abs(residual)) * np.sqrt(len(residual) / max(1, len(residual) - 3)))


def _correlation(found: list[Arc]) -> float:
    """First autocorrelation of the residuals, pooled; 0 where it is within its own noise."""
    pairs = [(arc.residual[1:], arc.residual[:-1]) for arc in found]
    product = sum(float(a @ b) for a, b in pairs)
    power = sum(float(arc.residual @ arc.residual) for arc in found)
    count = sum(len(a) for a, _ in pairs)
    correlation = product / max(power, 1e-300)
    return float(min(correlation, 0.9)) if correlation > 3 / np.sqrt(max(count, 1)) else 0.0
