"""One profile alone: its straight lines and the corners where they meet. No angle of a part: that needs frames."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from workbench.geometry.chains import COUNT, FIRST, LAST, noise_sigma, straight_faces
from workbench.units import DEG, Float, Shaped

NOTE = (
    "angles are those of the profile; the angle of a part needs frames along its edge, "
    "since the laser plane may stand oblique to it"
)
REACH_PITCHES = 20.0  # a corner lies at most so many columns beyond the last point of each of its lines
LEAST_TURN = 2.0 * DEG  # less is one line, slightly bent
LEAST_POINTS = 12
SURE = 4.0  # standard uncertainties by which two lines must differ
ROUGHER = 5.0  # times the noise between neighbours: a line that leaves more is not straight
KEPT = 0.95  # share of the points that a line through both must explain
MOST_CORRELATION = 0.98  # of neighbours: beyond it the residuals are a shape, not noise


class Line(NamedTuple):
    """A straight part of the profile, z = slope x + offset."""

    x_mm: tuple[float, float]
    angle_deg: float  # of the line to the x axis
    length_mm: float
    points: int
    rms_mm: float  # of the residuals along z
    slope: float
    offset_mm: float
    spread: float  # variance of the fit (mm^2) an independent point: rms^2, with the neighbours' correlation
    x_mean_mm: float
    sxx: float  # mm^2

    def variance(self, x_mm: float) -> float:
        """Of the fitted z at x, mm^2."""
        return self.spread * (1.0 / self.points + (x_mm - self.x_mean_mm) ** 2 / self.sxx)


class Corner(NamedTuple):
    """Where two neighbouring lines meet, with standard uncertainties."""

    x_mm: float
    z_mm: float
    x_u_mm: float
    z_u_mm: float
    turn_deg: float  # from one line to the next; 0 would be straight on


class Profile(NamedTuple):
    """A profile and what was found in it."""

    x_mm: Shaped[Float, " n"]  # rising
    z_mm: Shaped[Float, " n"]
    lines: tuple[Line, ...]
    corners: tuple[Corner, ...]


def measured(x_mm: Float, z_mm: Float) -> Profile:
    """Straight lines and corners of one profile (n,), NaN where nothing came back.

    Lines are the optimal partition of `geometry.chains`, regressions of z on x. A corner's uncertainty follows from
    the two fits; the residuals' correlation from column to column, 0.8 of real sensors, counts in it.
    """
    seen = np.isfinite(x_mm) & np.isfinite(z_mm)
    x, z = np.asarray(x_mm[seen], float), np.asarray(z_mm[seen], float)
    order = np.argsort(x, kind="stable")
    x, z = x[order], z[order]
    if len(x) < LEAST_POINTS or x[-1] - x[0] <= 0:
        return Profile(x, z, (), ())
    lines = _merged(x, z, [(int(row[FIRST]), int(row[LAST])) for row in straight_faces(x, z) if row[COUNT] >= 4])
    reach_mm = REACH_PITCHES * float(np.median(np.diff(x)))
    found = (_corner(a, b, reach_mm) for a, b in itertools.pairwise(lines))
    return Profile(x, z, lines, tuple(corner for corner in found if corner is not None))


def _merged(x: Float, z: Float, spans: list[tuple[int, int]]) -> tuple[Line, ...]:
    """The lines of the spans, those as one that the noise alone tells apart: the partition takes it as independent."""
    k, most_mm = 0, ROUGHER * noise_sigma(z)
    while k + 1 < len(spans):
        a, b = _line(x, z, *spans[k]), _line(x, z, *spans[k + 1])
        both = _line(x, z, spans[k][0], spans[k + 1][1])
        middle = 0.5 * (a.x_mm[1] + b.x_mm[0])
        step = a.slope * middle + a.offset_mm - b.slope * middle - b.offset_mm
        spread = (a if a.points >= b.points else b).spread  # of a short piece the rms says little
        turn_u = math.sqrt(spread * (1.0 / a.sxx + 1.0 / b.sxx))
        step_u = math.sqrt(a._replace(spread=spread).variance(middle) + b._replace(spread=spread).variance(middle))
        kept = both.points >= KEPT * (a.points + b.points) and both.rms_mm < max(most_mm, a.rms_mm, b.rms_mm)
        if kept and abs(a.slope - b.slope) < SURE * turn_u and abs(step) < SURE * step_u:
            spans[k : k + 2] = [(spans[k][0], spans[k + 1][1])]
            k = max(0, k - 1)
        else:
            k += 1
    return tuple(_line(x, z, *span) for span in spans)


def _line(x: Float, z: Float, first: int, last: int) -> Line:
    """The regression through the points from `first` to `last`, those far off it left out."""
    x, z = x[first : last + 1], z[first : last + 1]
    slope, offset = np.polyfit(x - x.mean(), z, 1)
    residual = z - offset - slope * (x - x.mean())
    near = np.abs(residual) <= 5.0 * max(1e-9, 1.4826 * float(np.median(np.abs(residual))))
    if near.sum() >= 4:
        x, z = x[near], z[near]
        slope, offset = np.polyfit(x - x.mean(), z, 1)
        residual = z - offset - slope * (x - x.mean())
    rms = math.sqrt(float(residual @ residual) / max(1, len(x) - 2))
    neighbours = float(residual[1:] @ residual[:-1]) / max(1e-30, float(residual @ residual))
    r = min(MOST_CORRELATION, max(0.0, neighbours))
    sxx = float(((x - x.mean()) ** 2).sum())
    return Line(
        (float(x[0]), float(x[-1])),
        math.degrees(math.atan(slope)),
        float(x[-1] - x[0]) * math.hypot(1.0, slope),
        len(x),
        rms,
        float(slope),
        float(offset - slope * x.mean()),
        rms**2 * (1.0 + r) / (1.0 - r),
        float(x.mean()),
        max(sxx, 1e-12),
    )


def _corner(a: Line, b: Line, reach_mm: float) -> Corner | None:
    """Where `a` and `b` meet; None where they are parallel, or meet away from both."""
    turn = (b.angle_deg - a.angle_deg) * DEG
    if abs(turn) < LEAST_TURN:
        return None
    x = (b.offset_mm - a.offset_mm) / (a.slope - b.slope)
    if not (a.x_mm[1] - reach_mm <= x <= a.x_mm[1] + reach_mm and b.x_mm[0] - reach_mm <= x <= b.x_mm[0] + reach_mm):
        return None
    va, vb, apart = a.variance(x), b.variance(x), a.slope - b.slope
    return Corner(
        x,
        a.slope * x + a.offset_mm,
        math.sqrt(va + vb) / abs(apart),
        math.sqrt(a.slope**2 * vb + b.slope**2 * va) / abs(apart),
        math.degrees(turn),
    )


def told(profile: Profile) -> list[str]:
    """The table of lines and corners, as text."""
    rows = [f"single profile: {len(profile.lines)} straight line(s), {len(profile.corners)} corner(s); {NOTE}"]
    rows += [
        f"  line {k}: x {one.x_mm[0]:.3f} to {one.x_mm[1]:.3f} mm, length {one.length_mm:.3f} mm, "
        f"{one.angle_deg:+.3f} deg to x, {one.points} points, rms {1e3 * one.rms_mm:.2f} um"
        for k, one in enumerate(profile.lines, 1)
    ]
    rows += [
        f"  corner {k}: x {c.x_mm:.3f} ± {2 * c.x_u_mm:.3f} mm, z {c.z_mm:.3f} ± {2 * c.z_u_mm:.3f} mm, "
        f"turn {c.turn_deg:+.2f} deg"
        for k, c in enumerate(profile.corners, 1)
    ]
    if profile.corners:
        rows.append(
            "  (± U: expanded uncertainty, k = 2, of these points alone: no calibration of the sensor is in it)"
        )
    return rows
