"""The fillet of a U, a J or a J preparation in one profile: a circle that touches a flank above and a land below.

With c the circle's centre, R its radius and d a face's direction downwards or onwards, n = (-d_y, d_x) its normal into
the open, the distances of a point p into the open are

    (p - c) . n + R of the flank, where (p - c) . d < 0, and of the land, where (p - c) . d > 0;
    R - |p - c| between.

Of the three any may be out of sight: a circle by itself, below a flank of which nothing is known, or between a flank
that is known and a land.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from workbench.edge.groove_profile import TRIM_MM
from workbench.geometry.medians import robust_sd
from workbench.units import DEG, MEDIAN_U, TO_SD, Float, Shaped

LEAST_ARC, LEAST_POINTS = 8, 12  # returns of a fillet alone; with its flank
LEAST_SHARE = 0.2  # of the noise that counts across it, at least
SHARP_MM = 0.5  # radius of a fillet that passes for a corner: corners of cutters have up to 0.4
SMALLEST_MM, LARGEST_MM = 0.3, 40.0  # radius
LAND_TILT = 2.0 * DEG  # standard deviation of a land's tilt before anything is seen of it
LOSS_SIGMAS = 3.0
NINE_TENTHS = 1.645  # standard deviations, within which nine tenths of what is normally distributed lie
GOOD_COST = 4.0  # of a fit, times what noise costs: no other start is tried
RUNS = 12  # of points along flank, fillet and land
STEPS = 60
FORM_U_MM = 3e-3  # of an arc without its flank: by the study its radius is off by so much times the lever


class Fillet(NamedTuple):
    """One profile's fillet."""

    radius_mm: float  # R
    bottom_mm: float  # level at the origin of the land, or where nothing of it is seen of the circle's lowest point
    tilt: float  # delta of the land, rad
    covariance: Shaped[Float, "3 3"]  # of these, by noise
    misfit: float  # nine tenths of its returns lie within so many times 1.6 of their noise
    left_mm: Shaped[Float, " RUNS"]  # mean of what is left in runs of equally many points, from the flank on
    by_run: Shaped[Float, "3 3"]  # covariance for runs that err by 1 mm, each on its own

    def form_u(self, x_mm: float) -> tuple[float, float, float]:
        """By how much the radius, the land's level at x and its tilt err where every run does by 1 mm, rms."""
        at = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, x_mm], [0.0, 0.0, 1.0]])
        radius, level, tilt = np.sqrt(np.diag(at @ self.by_run @ at.T)).tolist()
        return radius, level, tilt

    def tangent(self, fall: float) -> Float:
        """Where the circle touches the land (2,); fall: of the flank through the origin, rad."""
        return _between(self.radius_mm, self.bottom_mm, self.tilt, fall) - self.radius_mm * _normal(self.tilt)

    def flank_mm(self, fall: float) -> float:
        """Length of the flank, down to where the circle touches it."""
        return float(_between(self.radius_mm, self.bottom_mm, self.tilt, fall) @ _along(-fall))


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
        self._all: list[Fillet] = []

    def add(self, k: int, one: Fillet) -> None:
        """The fillet of profile k."""
        self.radius[k], self.bottom[k] = one.radius_mm, one.bottom_mm
        self._all.append(one)

    def variances(self) -> tuple[Float, Float]:
        """Of radius and level (n,), by noise: those of most profiles.

        By its own, a radius that noise made small would count more: of it more of the circle is seen.
        """
        usual = np.median([np.diag(one.covariance) for one in self._all], axis=0) if self._all else np.full(3, np.nan)
        return np.full(self.radius.size, usual[0]), np.full(self.radius.size, usual[1])

    def misfit(self) -> float:
        """Of their returns, times their noise; NaN: there is none."""
        return float(np.median([one.misfit for one in self._all])) if self._all else math.nan

    def form_u(self, sensor_mm: float) -> tuple[float, float]:
        """By how much radius and level err by what stands off line and circle in the same way in all profiles, mm.

        And by the sensor's own error, rms: a wave of it that bends an arc to another arc leaves nothing.
        """
        whole = [one for one in self._all if np.isfinite(one.left_mm).all()]
        if not whole:
            return 0.0, 0.0
        radius, level, _ = np.median([one.form_u(0.0) for one in whole], axis=0) * math.hypot(
            misfit_mm(whole), sensor_mm
        )
        return float(radius), float(level)


def misfit_mm(fillets: Sequence[Fillet]) -> float:
    """How far flanks and fillets stand off their lines and circles in the same way in all profiles, rms.

    Of what n profiles leave in the same places, beyond what chance makes of it.
    """
    left = np.array([one.left_mm for one in fillets])
    middle = np.median(left, axis=0)
    noise = MEDIAN_U * np.median(np.abs(left - middle), axis=0) * TO_SD / math.sqrt(len(left))
    return math.sqrt(max(float(np.mean(middle**2 - noise**2)), 0.0))


def fit_circle(points: Float, ray: Float, sigma_mm: float) -> Fillet | None:
    """Circle through a fillet's returns (n, 2), noise sigma along `ray`; None: they do not fix one."""
    ends = np.minimum(*(np.hypot(*(points - points[k]).T) for k in (0, -1)))
    points = points[ends > TRIM_MM]  # beside a shadow and a corner
    if len(points) < LEAST_ARC:
        return None
    middle = points.mean(axis=0)
    off = points - middle
    unknown = np.linalg.lstsq(np.column_stack([2 * off, np.ones(len(off))]), (off**2).sum(axis=1), rcond=None)[0]
    start = np.array([unknown[0], unknown[1], math.sqrt(max(float(unknown[2] + unknown[:2] @ unknown[:2]), 1e-6))])
    outward = (off - start[:2]) / np.hypot(*(off - start[:2]).T)[:, None]
    sigma = sigma_mm * np.maximum(np.abs(outward @ ray), LEAST_SHARE)  # of the range axis' noise, across the circle
    found = _fitted(lambda at: _away(off - at[:2], at[2]) / sigma, [start], len(off))
    if found is None:
        return None
    gradient = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, -1.0], [0.0, 0.0, 0.0]])
    sizes = float(found.x[2]), float(middle[1] + found.x[1] - found.x[2]), 0.0
    return _fillet(sizes, gradient, found, found.fun, sigma_mm)


def fit_below_flank(
    points: Float, middle: Float, way: float, sigma_mm: float, guess_mm: float
) -> tuple[Flank, Fillet] | None:
    """Flank, fillet and land at once: a line that goes over into a circle which it touches, and that into a land.

    points (n, 2) from the flank on, y out of the plate; middle, way: a place on the flank and its direction, roughly.
    The land is level but for its tilt. None where the points do not fix them.
    """

    def centre(unknown: Float) -> Float:
        turn, off, radius, tangent, _ = unknown
        return np.asarray(middle + tangent * _along(way + turn) + (off + radius) * _normal(way + turn))

    def away(unknown: Float) -> Float:
        left = _away(points - centre(unknown), unknown[2], down=way + unknown[0], onward=unknown[4])
        return np.append(left / sigma_mm, unknown[4] / LAND_TILT)

    reach = (points - middle) @ _along(way)
    begins = [
        np.array([0.0, 0.0, radius, float(np.max(reach)) - radius, 0.0])
        for radius in (guess_mm, 0.5 * guess_mm, 2.0 * guess_mm)
    ]
    found = _fitted(away, begins, len(points))
    if found is None:
        return None
    found.fun = found.fun[:-1]
    turn, off, radius, tangent, _ = (float(v) for v in found.x)
    d, inside = _along(way + turn), _normal(way + turn)
    lever = tangent * d[0] - (off + radius) * d[1]
    gradient = np.array([[0.0, 0.0, 1.0, 0.0, 0.0], [lever, inside[1], inside[1] - 1.0, d[1], 0.0], np.zeros(5)])
    on_arc = found.fun[reach > tangent]
    on_arc = on_arc if on_arc.size >= LEAST_ARC else np.zeros(1)
    fillet = _fillet((radius, float(centre(found.x)[1]) - radius, 0.0), gradient, found, on_arc, sigma_mm)
    if fillet is None:
        return None
    own = np.linalg.inv(found.jac.T @ found.jac) * max(robust_sd(found.fun), 1.0) ** 2
    return Flank(way + turn, float(own[0, 0]), middle + off * inside, float(own[1, 1])), fillet


def fit_on_land(points: Float, fall: float, sigma_mm: float, start: Fillet | None) -> Fillet | None:
    """The fillet between a known flank, that falls by `fall` from the origin on, rad, and its land.

    points (n, 2) on flank, fillet and land, x outwards and y out of the plate. None: they do not fix one.
    """
    if len(points) < LEAST_POINTS:
        return None
    points = points[np.argsort(points[:, 0], kind="stable")]
    lowest = float(np.quantile(points[:, 1], 0.1))
    begins = [np.array([radius, lowest, 0.0]) for radius in (SHARP_MM, -0.5 * lowest)]
    if start is not None:
        begins = [np.array([start.radius_mm, start.bottom_mm, start.tilt])]

    def away(unknown: Float) -> Float:
        radius, bottom, tilt = (float(v) for v in unknown)
        off = points - _between(radius, bottom, tilt, fall)
        return np.append(_away(off, radius, down=-fall, onward=tilt) / sigma_mm, tilt / LAND_TILT)

    found = _fitted(away, begins, 0, x_scale=np.array([0.3, 0.1, 0.01]))
    if found is None:
        return None
    found.fun = found.fun[:-1]
    return _fillet((float(found.x[0]), float(found.x[1]), float(found.x[2])), np.eye(3), found, found.fun, sigma_mm)


def _along(angle: float) -> Float:
    return np.array([math.cos(angle), math.sin(angle)])


def _normal(angle: float) -> Float:
    return np.array([-math.sin(angle), math.cos(angle)])


def _between(radius: float, bottom: float, tilt: float, fall: float) -> Float:
    """Centre of the circle that touches a flank through the origin and a land through (0, bottom)."""
    rows = np.array([_normal(-fall), _normal(tilt)])
    return np.linalg.solve(rows, np.array([radius, radius + bottom * math.cos(tilt)]))


def _away(off: Float, radius: float, down: float = math.nan, onward: float = math.nan) -> Float:
    """Distances (n,) into the open of points that lie `off` (n, 2) the centre; NaN: flank or land is not seen."""
    away = radius - np.hypot(off[:, 0], off[:, 1])
    for angle, sense in ((onward, 1.0), (down, -1.0)):
        if not math.isnan(angle):
            away = np.where(sense * (off @ _along(angle)) > 0.0, off @ _normal(angle) + radius, away)
    return np.asarray(away)


def _fitted(
    away: Callable[[Float], Float], begins: Sequence[Float], good: int, x_scale: Float | float = 1.0
) -> scipy.optimize.OptimizeResult | None:
    """The cheapest fit of the starts, residuals in sigmas; `good`: points, of which the first good fit will do."""
    best = None
    for begin in begins:
        try:
            found = scipy.optimize.least_squares(
                away, begin, loss="soft_l1", f_scale=LOSS_SIGMAS, x_scale=x_scale, max_nfev=STEPS
            )
        except (ValueError, np.linalg.LinAlgError):
            continue
        if best is None or found.cost < best.cost:
            best = found
        if best.cost < GOOD_COST * good:
            break
    return best


def _fillet(
    sizes: tuple[float, float, float],
    gradient: Float,
    found: scipy.optimize.OptimizeResult,
    on_arc: Float,
    sigma_mm: float,
) -> Fillet | None:
    """The fillet of a fit, gradient (3, k) of its sizes; on_arc: what is left of its own points, in sigmas."""
    left, unknown = found.fun, found.x.size
    try:
        own = gradient @ np.linalg.inv(found.jac.T @ found.jac) @ gradient.T
    except np.linalg.LinAlgError:
        return None
    if not SMALLEST_MM < sizes[0] < LARGEST_MM:
        return None
    runs = np.array_split(sigma_mm * left, RUNS)
    return Fillet(
        *sizes,
        own * max(robust_sd(left), 1.0) ** 2,
        float(np.quantile(np.abs(on_arc), 0.9)) / NINE_TENTHS,
        np.array([run.mean() for run in runs]) if left.size >= RUNS else np.full(RUNS, math.nan),
        own * left.size / ((RUNS - unknown) * sigma_mm**2),
    )
