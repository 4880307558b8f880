"""What a file holds, ready to be told and shown: points and their colours, bare profiles, checks. Lengths in mm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Strokes
from workbench.artefacts.evidence import Check
from workbench.artefacts.showing import shown
from workbench.edge.groove_rows import Rows
from workbench.look.single import Profile
from workbench.units import AnyArray, Float, Float32, Int, Shaped


@shown
@dataclass(frozen=True, slots=True, eq=False)
class Shade:
    """A value a point, by which the view may be coloured."""

    name: str  # with its unit
    values: Shaped[Float, " n"]


@shown
@dataclass(frozen=True, slots=True, eq=False)
class Seen:
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


LEAST_PIXELS, MOST_PIXELS = 20, 20_000_000  # of a height map that is measured as an image
EVEN = 0.05  # share of a step by which steps may differ


class Stacked(NamedTuple):
    """Points in the profiler frame; y is the way along the scan, or the frame's number times a column's pitch."""

    points_mm: Float
    shades: tuple[Shade, ...]


def stacked(x_mm: Float32, z_mm: Float32, travel_mm: Float | None) -> Stacked:
    """The returns of a grid (N, M)."""
    frame, column = places(x_mm, z_mm)
    y_mm = travel_mm if travel_mm is not None else np.arange(len(z_mm)) * pitch_mm(x_mm)
    points = np.stack([x_mm[frame, column], y_mm[frame], z_mm[frame, column]], axis=1).astype(float)
    return Stacked(points, shades_of(points, frame=frame, column=column))


def pitch_mm(x_mm: Float32) -> float:
    """Median distance of neighbouring columns; 1 where nothing tells it."""
    step = np.abs(np.diff(x_mm[:: max(1, len(x_mm) // 50)], axis=1))
    step = step[np.isfinite(step) & (step > 0)]
    return float(np.median(step)) if len(step) else 1.0


def even_grid(x_mm: Float32, travel_mm: Float | None) -> bool:
    """Whether profiles are a height map: x alike in all of them, and even steps of x and travel."""
    if travel_mm is None or min(x_mm.shape) < LEAST_PIXELS or x_mm.size > MOST_PIXELS:
        return False
    some = x_mm[:: max(1, len(x_mm) // 100)]
    low = np.min(some, axis=0, initial=np.inf, where=np.isfinite(some))
    high = np.max(some, axis=0, initial=-np.inf, where=np.isfinite(some))
    if not np.isfinite(low).all() or not (high - low < EVEN * pitch_mm(x_mm)).all():
        return False
    return all(_even(np.diff(values)) for values in ((low + high) / 2, travel_mm))


def _even(step: Float) -> bool:
    usual = float(np.median(step))
    return usual != 0 and bool((np.abs(step - usual) < EVEN * abs(usual)).all())


def failed(name: str, value: float | None, reason: str, finding: str) -> Check:
    """A check that the file does not pass."""
    return Check(name, value, None, False, reason, finding)


def told(checks: tuple[Check, ...]) -> list[str]:
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
