"""The fillet of a U or J groove in one profile: a circle below a flank that it touches, or by itself."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy

from workbench.edge.groove_form import repeated_mm
from workbench.edge.groove_profile import TRIM_MM
from workbench.units import Float, Shaped

MIN_ARC, LEAST_SHARE = 8, 0.2  # returns of a fillet alone; of the noise that counts across it, at least
SMALLEST_MM, LARGEST_MM = 0.3, 40.0  # radius
NINE_TENTHS = 1.645  # standard deviations, within which nine tenths of what is normally distributed lie
GOOD_COST = 4.0  # of a fillet's fit, times what noise costs: no other start is tried
RUNS = 12  # of points along flank and fillet
STEPS = 60


class Arc(NamedTuple):
    """One profile's fillet."""

    radius_mm: float
    radius_variance: float
    bottom_mm: float  # its lowest level
    bottom_variance: float
    misfit: float  # nine tenths of its returns lie within so many times 1.6 of their noise
    left_mm: Shaped[Float, " RUNS"]  # mean of what is left in runs of equally many points
    by_run: tuple[float, float]  # variances of radius and level where every run errs by 1 mm, each on its own, mm^2


class Flank(NamedTuple):
    """The line above a fillet: direction downwards, a place on it, and the variances of both."""

    way: float
    way_variance: float
    place: Shaped[Float, " 2"]
    offset_variance: float


class Fillets:
    """The fillets of one plate in n profiles."""

    def __init__(self, n: int) -> None:
        self.radius, self.bottom = np.full((2, n), np.nan)
        self._all: list[Arc] = []

    def add(self, k: int, one: Arc) -> None:
        """The fillet of profile k."""
        self.radius[k], self.bottom[k] = one.radius_mm, one.bottom_mm
        self._all.append(one)

    def variances(self) -> tuple[Float, Float]:
        """Of radius and level (n,), by noise: those of most profiles.

        By its own, a radius that noise made small would count more: of it more of the circle is seen.
        """
        whole = np.ones(self.radius.size)
        if not self._all:
            return np.nan * whole, np.nan * whole
        radius, level = np.median([(one.radius_variance, one.bottom_variance) for one in self._all], axis=0)
        return radius * whole, level * whole

    def misfit(self) -> float:
        """Of their returns, times their noise; NaN: there is none."""
        return float(np.median([one.misfit for one in self._all])) if self._all else math.nan

    def form_u(self) -> tuple[float, float]:
        """By how much radius and level err by what stands off line and circle in the same way in all profiles, mm."""
        told = [one for one in self._all if np.isfinite(one.left_mm).all()]
        if not told:
            return 0.0, 0.0
        form = repeated_mm(np.array([one.left_mm for one in told]))
        radius, level = np.median([one.by_run for one in told], axis=0)
        return form * math.sqrt(radius), form * math.sqrt(level)


def fit_circle(points: Float, ray: Float, sigma: float) -> Arc | None:
    """Circle through a fillet's returns (n, 2), noise sigma along `ray`; None: they do not fix one."""
    ends = np.minimum(*(np.hypot(*(points - points[k]).T) for k in (0, -1)))
    points = points[ends > TRIM_MM]  # beside a shadow and a corner
    if len(points) < MIN_ARC:
        return None
    middle = points.mean(axis=0)
    off = points - middle
    unknown = np.linalg.lstsq(np.column_stack([2 * off, np.ones(len(off))]), (off**2).sum(axis=1), rcond=None)[0]
    start = np.array([unknown[0], unknown[1], math.sqrt(max(float(unknown[2] + unknown[:2] @ unknown[:2]), 1e-6))])
    outward = (off - start[:2]) / np.hypot(*(off - start[:2]).T)[:, None]
    share = np.maximum(np.abs(outward @ ray), LEAST_SHARE)  # of the range axis' noise, across the circle

    def away(at: Float) -> Float:
        return np.asarray((np.hypot(*(off - at[:2]).T) - at[2]) / share)

    found = scipy.optimize.least_squares(away, start, loss="soft_l1", f_scale=3.0 * sigma, max_nfev=STEPS)
    covariance = _covariance(found)
    if covariance is None or not SMALLEST_MM < found.x[2] < LARGEST_MM:
        return None
    bottom = float(middle[1] + found.x[1] - found.x[2])
    variances = covariance[2, 2], covariance[1, 1] + covariance[2, 2] - 2.0 * covariance[1, 2]
    return _arc(float(found.x[2]), bottom, variances, found.fun, found.fun, sigma)


def fit_fillet(points: Float, middle: Float, way: float, sigma: float, guess: float) -> tuple[Flank, Arc] | None:
    """Flank and fillet at once: a line that goes over into a circle which it touches; both 4 unknowns together.

    points (n, 2) from the flank on; middle, way: a place on the flank and its direction, roughly. None where the points
    do not fix them.
    """

    def away(unknown: Float) -> Float:
        turn, off, radius, tangent = unknown
        d = np.array([math.cos(way + turn), math.sin(way + turn)])
        inside = np.array([-d[1], d[0]])
        along, across = (points - middle) @ d, (points - middle) @ inside
        centre = np.array([tangent, off + radius])
        round_ = radius - np.hypot(along - centre[0], across - centre[1])
        return np.asarray(np.where(along < tangent, across - off, round_))

    reach = (points - middle) @ np.array([math.cos(way), math.sin(way)])
    best = None
    for radius in (guess, 0.5 * guess, 2.0 * guess):
        start = np.array([0.0, 0.0, radius, float(np.max(reach)) - radius])
        try:
            found = scipy.optimize.least_squares(
                away, start, method="trf", loss="soft_l1", f_scale=3.0 * sigma, max_nfev=STEPS
            )
        except (ValueError, np.linalg.LinAlgError):
            continue
        if best is None or found.cost < best.cost:
            best = found
        if best.cost < GOOD_COST * sigma**2 * len(points):
            break
    covariance = None if best is None else _covariance(best)
    if best is None or covariance is None or not SMALLEST_MM < best.x[2] < LARGEST_MM:
        return None
    turn, off, radius, tangent = (float(v) for v in best.x)
    d = np.array([math.cos(way + turn), math.sin(way + turn)])
    inside = np.array([-d[1], d[0]])
    bottom = float((middle + tangent * d + (off + radius) * inside)[1]) - radius
    lever = tangent * math.cos(way + turn) - (off + radius) * math.sin(way + turn)
    gradient = np.array([lever, inside[1], inside[1] - 1.0, d[1]])
    variances = covariance[2, 2], gradient @ covariance @ gradient
    on_arc = best.fun[reach > tangent]
    noise = max(_rms(best.fun), sigma) ** 2
    return (
        Flank(way + turn, float(covariance[0, 0]) * noise, middle + off * inside, float(covariance[1, 1]) * noise),
        _arc(radius, bottom, variances, best.fun, on_arc if on_arc.size >= MIN_ARC else np.zeros(1), sigma),
    )


def _arc(radius: float, bottom: float, variances: tuple[float, float], left: Float, on_arc: Float, sigma: float) -> Arc:
    """The fillet from what is left of all points (n,) and of its own; variances: of both sizes for errors of 1 mm."""
    noise = max(_rms(left), sigma) ** 2
    unknown = 4
    by_run = tuple(float(one) * left.size / (RUNS - unknown) for one in variances)
    return Arc(
        radius,
        float(variances[0]) * noise,
        bottom,
        float(variances[1]) * noise,
        float(np.quantile(np.abs(on_arc), 0.9)) / (NINE_TENTHS * sigma),
        np.array([np.mean(run) for run in np.array_split(left, RUNS)])
        if left.size >= RUNS
        else np.full(RUNS, math.nan),
        (by_run[0], by_run[1]),
    )


def _covariance(found: scipy.optimize.OptimizeResult) -> Float | None:
    try:
        return np.asarray(np.linalg.inv(found.jac.T @ found.jac))
    except np.linalg.LinAlgError:
        return None


def _rms(left: Float) -> float:
    return 1.4826 * float(np.median(np.abs(left))) + 1e-4
