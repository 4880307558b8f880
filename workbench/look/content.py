"""What a file holds, ready to be told and shown: points and their colours, bare profiles, checks. Lengths in mm.

Of one profile alone, its straight lines and the corners where they meet: no angle of a part, which needs frames.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Strokes
from workbench.artefacts.evidence import Check
from workbench.artefacts.showing import shown
from workbench.geometry.chains import COUNT, FIRST, LAST, noise_sigma, straight_faces
from workbench.importing.command import column_pitch_mm
from workbench.look.rows import Rows
from workbench.units import DEG, TO_SD, AnyArray, Float, Float32, Int, Shaped

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
    near = np.abs(residual) <= 5.0 * max(1e-9, TO_SD * float(np.median(np.abs(residual))))
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


def profile_lines(profile: Profile) -> list[str]:
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


@shown
@dataclass(frozen=True, slots=True, eq=False)
class Shade:
    """One value per point, by which the view may be coloured."""

    name: str  # with its unit
    values: Shaped[Float, " n"]


@shown
@dataclass(frozen=True, slots=True, eq=False)
class FileContent:
    """A file as it was understood."""

    source: str
    kind: str  # what it is, for people
    frame: str  # in what frame the points are shown, in words
    lines: tuple[str, ...]  # the summary
    points_mm: Shaped[Float, "n 3"]  # a sample of the points; any first part of it shows the whole
    shades: tuple[Shade, ...]
    strokes: tuple[Strokes, ...] = ()
    checks: tuple[Check, ...] = ()
    suggestions: tuple[str, ...] = ()  # what would make it consistent
    profile: Profile | None = None  # where there is a single one
    corners: Rows | None = None  # of a groove, in rows of ranges
    hints: tuple[str, ...] = ()  # what to do next


MOST_POINTS = 300_000
SEED = 0  # the order of the points shown: any first part of them shows the whole


def chosen_of(points_mm: Float) -> Float:
    """At most MOST_POINTS of the points (n, 3), in no order."""
    order = np.random.default_rng(SEED).permutation(len(points_mm))[:MOST_POINTS]
    return np.asarray(points_mm[order])


def places(x_mm: Float32, z_mm: Float32) -> tuple[Int, Int]:
    """Frames and columns of at most MOST_POINTS returns of a grid (N, M), in no order.

    Large grids are drawn from by place, so that no array as large as the grid is made.
    """
    rng = np.random.default_rng(SEED)
    frames, columns = z_mm.shape
    if frames * columns <= 4 * MOST_POINTS:
        frame, column = np.nonzero(np.isfinite(x_mm) & np.isfinite(z_mm))
        order = rng.permutation(len(frame))[:MOST_POINTS]
        return frame[order], column[order]
    frame, column = rng.integers(0, frames, 3 * MOST_POINTS), rng.integers(0, columns, 3 * MOST_POINTS)
    back = np.isfinite(x_mm[frame, column]) & np.isfinite(z_mm[frame, column])
    return frame[back][:MOST_POINTS], column[back][:MOST_POINTS]


def shades_of(points_mm: Float, **more: AnyArray) -> tuple[Shade, ...]:
    """Height in the frame shown, and whatever else differs from point to point."""
    values = {"height z, mm": points_mm[:, 2], **{name.replace("_", " "): one for name, one in more.items()}}
    return tuple(Shade(name, np.asarray(one, float)) for name, one in values.items() if not len(one) or np.ptp(one) > 0)


class Stacked(NamedTuple):
    """Points in the profiler frame; y is the way along the scan, or the frame's number times a column's pitch."""

    points_mm: Float
    shades: tuple[Shade, ...]


def stacked(x_mm: Float32, z_mm: Float32, travel_mm: Float | None) -> Stacked:
    """The returns of a grid (N, M)."""
    frame, column = places(x_mm, z_mm)
    y_mm = travel_mm if travel_mm is not None else np.arange(len(z_mm)) * np.nan_to_num(column_pitch_mm(x_mm), nan=1.0)
    points = np.stack([x_mm[frame, column], y_mm[frame], z_mm[frame, column]], axis=1).astype(float)
    return Stacked(points, shades_of(points, frame=frame, column=column))


def failed(name: str, value: float | None, reason: str, finding: str) -> Check:
    """A check that the file does not pass."""
    return Check(name, value, None, False, reason, finding)


def check_lines(checks: tuple[Check, ...]) -> list[str]:
    """A line a check: those that failed first, with what was found."""
    rows = []
    for check in sorted(checks, key=lambda each: each.passed):
        value = "" if check.value is None else f" {check.value:.4g}"
        limit = "" if check.limit is None else f" (limit {limit_text(check.limit)})"
        text = check.reason if check.passed else check.finding or check.reason
        rows.append(f"  {'ok  ' if check.passed else 'FAIL'} {check.name}{value}{limit}: {text}")
    return rows


def limit_text(limit: float | tuple[float, float] | None) -> str:
    """A limit, or a range."""
    if limit is None:
        return ""
    return f"{limit[0]:.4g} to {limit[1]:.4g}" if isinstance(limit, tuple) else f"{limit:.4g}"


def box(points_mm: Float) -> str:
    """Least and greatest coordinates of points (n, 3), n > 0."""
    low, high = points_mm.min(axis=0), points_mm.max(axis=0)
    return ", ".join(f"{name} {a:.6g} to {b:.6g} mm" for name, a, b in zip("xyz", low, high, strict=True))
