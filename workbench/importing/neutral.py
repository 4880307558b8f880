"""What every importer produces, whatever the file: profile frames, poses, and what was understood of them.

Points in the order of a file become the scanner's grid, frame by column.

N frames of M columns, K poses. Lengths in mm, times in s; profiler frame and base as in docs/conventions.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.units import AnyArray, Float, Float32, Int, Shaped


@dataclass(frozen=True, slots=True, eq=False)
class ProfileFrames:
    """Profiles out of one source, in the profiler frame."""

    source: str  # the file's name as given, for messages
    x_mm: Shaped[Float32, "N M"]  # lateral; NaN = no return
    z_mm: Shaped[Float32, "N M"]  # range; NaN = no return
    time_s: Shaped[Float, " N"] | None = None  # exposure times on the profiler's clock; None: the file has none
    travel_mm: Shaped[Float, " N"] | None = None  # way gone along the scan: an encoder's or a surface's y
    intensity: Shaped[AnyArray, "N M"] | None = None  # uint16
    pass_index: Shaped[Int, " N"] | None = None  # where the file itself tells passes apart
    sensor: str | None = None  # as the file names it
    length_unit: str = "mm"  # that the lengths were read from, for messages


@dataclass(frozen=True, slots=True, eq=False)
class PoseStream:
    """Flange poses out of one source, in the robot base."""

    source: str
    position_mm: Shaped[Float, "K 3"]
    quaternion_wxyz: Shaped[Float, "K 4"]  # unit length
    time_s: Shaped[Float, " K"] | None = None  # on the robot's clock; None: the file has none
    pass_index: Shaped[Int, " K"] | None = None  # where the file itself tells passes apart
    length_unit: str = "mm"  # that the lengths were read from, for messages
    time_unit: str = "s"


@dataclass(frozen=True, slots=True, eq=False)
class JointStream:
    """Postures out of one source: K of n joints, in the robot's own order."""

    source: str
    position: Shaped[Float, "K n"]  # rad; of linear joints, as far as a URDF tells them, m
    names: tuple[str, ...]  # as the file calls them
    time_s: Shaped[Float, " K"] | None = None  # on the robot's clock; None: the file has none
    number: Shaped[Int, " K"] | None = None  # of the posture, where the file tells it
    angle_unit: str = "rad"  # that the angles were read from


@dataclass(frozen=True, slots=True, eq=False)
class TrackerReadings:
    """n places that a laser tracker saw, in its own frame."""

    source: str
    place_mm: Shaped[Float, "n 3"]
    name: tuple[str, ...]  # of the target
    number: Shaped[Int, " n"]  # of the position at which the robot stood
    time_s: Shaped[Float, " n"] | None = None  # on the tracker's clock


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """What one source held. `notes` are lines for the user: kind of file, columns, units, what was left out."""

    profiles: ProfileFrames | None = None
    poses: PoseStream | None = None
    notes: tuple[str, ...] = ()
    tracker: TrackerReadings | None = None
    joints: JointStream | None = None  # beside the poses that follow from them, or alone where no URDF is named


class TimedPass(NamedTuple):
    """One pass on the robot's clock."""

    time_s: Shaped[Float, " n"]  # of its frames
    poses: PoseStream  # with times
    note: str  # how the times came about
    has_clock: bool = True  # False: the times only count frames or mm


REFINEMENTS = 2
PITCH_POINTS = 1_000_000  # that tell the usual step from column to column
NEAR = 4  # strides: over a longer gap the profile may have turned away, and x with it
MOST_WIDER = 4  # columns for the longest row's points: beyond it the spacing tells nothing
MOST_EMPTY = 20  # cells a point: beyond it the rows cannot be profiles of one sensor
FEW_CELLS = 1_000_000
BLOCK_FRAMES = 512
MAX_MM = 1e5  # as scan.read: beyond it no length in mm, but a code for 'no return'


class Grid(NamedTuple):
    """Points by frame and column; NaN = no return."""

    x_mm: Float32
    z_mm: Float32
    note: str  # how ragged frames were laid out; '' where none was ragged
    intensity: AnyArray | None = None


class Points:
    """Points in the order of a file, added stretch by stretch; then the grid."""

    def __init__(self) -> None:
        self._columns: dict[str, AnyArray] = {}
        self._starts: list[Int] = []
        self.rows = self.frames = 0

    def add(self, x_mm: Float32, z_mm: Float32, starts: Int, intensity: AnyArray | None = None) -> None:
        """Points (r,), and at which of them frames begin; a frame may be of no points."""
        self._starts.append(starts + self.rows)
        self.rows += len(x_mm)
        self.frames += len(starts)
        for name, values in (("x_mm", x_mm), ("z_mm", z_mm), ("intensity", intensity)):
            if values is not None:
                whole = self._columns.setdefault(name, np.empty(0, values.dtype))
                whole.resize(self.rows, refcheck=False)  # in place: tens of millions of points are not copied
                whole[self.rows - len(values) :] = values

    def gridded(self, where: str, *, by_spacing: bool = True) -> Grid:
        """The grid; the points are gone from here afterwards.

        Frames of unequal length (none is one without returns) are laid out by the gaps in x between returns, so that
        columns stay the sensor's pixels as far as the file shows them; where the gaps tell nothing, or `by_spacing` is
        False, points are counted from column 0.
        """
        ends = np.append(np.concatenate(self._starts), self.rows)
        points, self._columns = self._columns, {}
        counts = np.diff(ends)
        if counts.min() == counts.max():
            shape = len(counts), int(counts[0])
            return Grid(note="", **{name: values.reshape(shape) for name, values in points.items()})
        if len({*np.unique(counts)} - {0}) == 1:  # frames without returns apart, all are alike
            by_spacing = False
        elif not (seen := np.isfinite(points["x_mm"]) & np.isfinite(points["z_mm"])).all():
            ends = np.append(0, np.cumsum(seen))[ends]
            counts = np.diff(ends)
            points = {name: values[seen] for name, values in points.items()}
        note = f"frames of {counts.min()} to {counts.max()} points: columns "
        place, width = _counted, int(counts.max())
        if by_spacing and (spacing := Spacing.of(points["x_mm"], ends)) is not None:
            place, width = spacing.columns, spacing.width
        note += "counted from each frame's first point" if place is _counted else "by the gaps in x"
        if len(counts) * width > max(FEW_CELLS, MOST_EMPTY * self.rows):
            raise InputError(where, f"expected frames of equal length, found {counts.min()} to {counts.max()} points")
        return Grid(note=note, **_filled(points, ends, width, place))


def _blocks(ends: Int) -> Iterator[tuple[slice, slice, Int]]:
    """Frames, their points, and how many each has, block by block."""
    for at in range(0, len(ends) - 1, BLOCK_FRAMES):
        block = ends[at : at + BLOCK_FRAMES + 1]
        yield slice(at, at + len(block) - 1), slice(block[0], block[-1]), np.diff(block)


def _counted(x_mm: Float32, counts: Int) -> Int:
    """Columns of the points of some frames, counted from 0 in each."""
    return np.arange(len(x_mm)) - np.repeat(np.cumsum(counts) - counts, counts)


class Spacing(NamedTuple):
    """Columns by the gaps in x, alike for alike x in all frames: a gap of k usual spacings leaves k - 1 free."""

    pitch_mm: float
    origin: float  # least x of a first point, in pitches
    width: int

    @classmethod
    def of(cls, x_mm: Float32, ends: Int) -> Spacing | None:
        """Of points from `ends[k]` to `ends[k + 1]` in frame k; None where gaps tell nothing: x runs both ways."""
        inside = np.ones(min(len(x_mm), PITCH_POINTS), bool)
        inside[ends[ends < len(inside)]] = False
        pitch_mm = _usual(np.diff(x_mm[: len(inside)].astype(float))[inside[1:]])
        if pitch_mm is None:
            return None
        counts = np.diff(ends)
        plain = cls(pitch_mm, float((x_mm[ends[:-1][counts > 0]] / pitch_mm).min()), 0)
        widest = 0
        for _, points, count in _blocks(ends):
            columns = plain.columns(x_mm[points], count)
            last = np.cumsum(count)[count > 0] - 1
            if (np.delete(np.diff(columns), last[:-1]) <= 0).any():
                return None
            widest = max(widest, int(columns[last].max(initial=0)))
        return plain._replace(width=widest + 1) if widest < MOST_WIDER * counts.max() else None

    def columns(self, x_mm: Float32, counts: Int) -> Int:
        """Columns of the points of some frames; they don't rise where x turns back."""
        at = x_mm.astype(float) / self.pitch_mm
        step = np.diff(at, prepend=at[:1])
        step = np.where(step > 0, np.maximum(1, np.round(step)), 0)
        counts = counts[counts > 0]
        first = np.cumsum(counts) - counts
        step[first] = 0
        way = np.cumsum(step)
        start = np.round(at[first] - self.origin)
        return np.asarray(way + np.repeat(start - way[first], counts), int)


def _usual(step_mm: Float) -> float | None:
    """The usual step from column to column of steps from point to point; None where they do not all go one way.

    The median step leans to where points are dense; over whole strides the pitch averages out.
    """
    pitch = float(np.median(step_mm)) if len(step_mm) else 0.0
    if pitch == 0 or (step_mm * np.sign(pitch) <= 0).any():
        return None
    for _ in range(REFINEMENTS):
        strides = np.maximum(1, np.round(step_mm / pitch))
        near = strides <= NEAR
        pitch = float(step_mm[near].sum() / strides[near].sum())
    return pitch


def _filled(
    points: dict[str, AnyArray], ends: Int, width: int, place: Callable[[Float32, Int], Int]
) -> dict[str, AnyArray]:
    """Points put into their columns, from the last frames on; empty cells are NaN, or 0 of whole numbers.

    Points are gone from memory once they are in the grid: both together would be twice as much.
    """
    shape = len(ends) - 1, width
    grids = {name: np.empty(shape, values.dtype) for name, values in points.items()}
    for frames, some, counts in reversed([*_blocks(ends)]):
        row = np.repeat(np.arange(len(counts)), counts)
        column = place(points["x_mm"][some], counts)
        for name, values in points.items():
            block = grids[name][frames]
            block[:] = np.nan if values.dtype.kind == "f" else 0
            block[row, column] = values[some]
            values.resize(some.start, refcheck=False)
    return grids


def bounded(lengths_mm: Float) -> Float32:
    """Lengths as float32; what float32 cannot hold becomes the largest it can, for the check of sizes to find."""
    return np.asarray(np.clip(lengths_mm, -1e30, 1e30), np.float32)


def without(values: Float, missing: list[float]) -> Float:
    """`values` with NaN for those that mean no return."""
    return np.where(np.isin(values, missing), np.nan, values) if missing else values


def returns_of(x_mm: Float32, z_mm: Float32) -> tuple[int, Float]:
    """How many points of profiles (N, M) are returns, and least and greatest x and z (2, 2) of them; block by block."""
    count, ranges = 0, np.array([[np.inf, -np.inf]] * 2)
    for at in range(0, len(z_mm), BLOCK_FRAMES):
        grids = x_mm[at : at + BLOCK_FRAMES], z_mm[at : at + BLOCK_FRAMES]
        back = np.isfinite(grids).all(axis=0)
        count += int(back.sum())
        for row, grid in zip(ranges, grids, strict=True):
            row[0] = min(row[0], np.min(grid, initial=np.inf, where=back))
            row[1] = max(row[1], np.max(grid, initial=-np.inf, where=back))
    return count, ranges
