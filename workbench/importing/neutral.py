"""What every importer produces, whatever the file: profile frames, poses, and what was understood of them.

Points in the order of a file become the scanner's grid, frame by column.

N frames of M columns, K poses. Lengths in mm, times in s; profiler frame and base as in docs/conventions.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.units import AnyArray, Bool, Float, Float32, Int, Shaped


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
    name: tuple[str, ...]  # of the target, or of the point
    number: Shaped[Int, " n"] | None = None  # of the position at which the robot stood; None: the file tells none
    time_s: Shaped[Float, " n"] | None = None  # on the tracker's clock
    u95_mm: Shaped[Float, " n"] | None = None  # expanded uncertainty (k = 2) as the tracker declares it


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """What one source held. `notes` are lines for the user: kind of file, columns, units, what was left out."""

    profiles: ProfileFrames | None = None
    poses: PoseStream | None = None
    notes: tuple[str, ...] = ()
    flange_from_profiler: Shaped[Float, "4 4"] | None = None  # where the source itself carries it
    tracker: TrackerReadings | None = None
    joints: JointStream | None = None  # beside the poses that follow from them, or alone where no URDF is named


class TimedPass(NamedTuple):
    """One pass on the robot's clock."""

    time_s: Shaped[Float, " n"]  # of its frames
    poses: PoseStream  # with times
    note: str  # how the times came about
    has_clock: bool = True  # False: the times only count frames or mm


REFINEMENTS = 2
NEAR = 4  # strides: over a longer gap the profile may have turned away, and x with it
MOST_WIDER = 4  # columns for the longest row's points: beyond it the spacing tells nothing
MOST_EMPTY = 20  # cells a point: beyond it the rows cannot be profiles of one sensor
FEW_CELLS = 1_000_000
BLOCK_POINTS = 1_000_000
ROOM = 2**23 + 1  # points: so large an array (32 MB) has pages of its own, which are none before they are written
MAX_MM = 1e5  # as scan.read: beyond it no length in mm, but a code for 'no return'


def columns_by_count(first: Bool) -> Int:
    """Columns (R,) of points in order: 0, 1, 2, ... from each frame's `first` (R,) point."""
    starts = np.flatnonzero(first)
    return np.asarray(np.arange(len(first)) - np.repeat(starts, np.diff(np.append(starts, len(first)))))


def usual_pitch(x_mm: Float, first: Bool) -> float | None:
    """The step from column to column of points `x_mm` (R,), frame after frame, `first` (R,) at each frame's first.

    The median step leans to where points are dense; over whole strides the pitch averages out. None where x does not
    run one way.
    """
    step = np.diff(x_mm, prepend=x_mm[:1])
    inside = ~first & np.isfinite(step)
    if not np.isfinite(x_mm).all() or not inside.any():
        return None
    pitch = float(np.median(step[inside]))
    if pitch == 0 or (step[inside] * np.sign(pitch) <= 0).any():
        return None
    for _ in range(REFINEMENTS):
        strides = np.where(inside, np.maximum(1, np.round(step / pitch)), 0)
        near = strides <= NEAR
        pitch = float(step[inside & near].sum() / strides[near].sum())
    return pitch


def columns_by_spacing(x_mm: Float, first: Shaped[Bool, " R"], pitch_mm: float, origin: float) -> Int | None:
    """Columns (R,) of points `x_mm` (R,), a gap of k usual spacings leaving k - 1 columns free.

    Args:
        x_mm: lateral coordinates, frame after frame.
        first: (R,) True at each frame's first point.
        pitch_mm: the usual step of all frames (`usual_pitch`), of which these may be some.
        origin: x / pitch_mm of column 0.

    Returns:
        Columns from 0, distinct and rising within a frame, alike for alike x in all frames; None where x does not run
        one way or the gaps are out of proportion.
    """
    step = np.diff(x_mm, prepend=x_mm[:1])
    if not np.isfinite(x_mm).all() or (step[~first] * np.sign(pitch_mm) <= 0).any():
        return None
    strides = np.where(first, 0, np.maximum(1, np.round(step / pitch_mm)))
    start = x_mm[first] / pitch_mm
    along = np.cumsum(strides)
    frame = np.cumsum(first) - 1
    column = along - along[first][frame] + np.round(start - origin)[frame]
    most = columns_by_count(first).max() + 1
    return column.astype(np.int64) if column.max() < MOST_WIDER * most else None


class Grid(NamedTuple):
    """Points by frame and column; NaN = no return."""

    x_mm: Float32
    z_mm: Float32
    intensity: AnyArray | None
    note: str  # how ragged frames were laid out; '' where none was ragged


class Points:
    """Points in the order of a file, added stretch by stretch; then the grid. Holds little more than the numbers."""

    def __init__(self) -> None:
        self._x, self._z, self._light = _Growing(), _Growing(), _Growing()
        self._starts: list[Int] = []
        self.rows = self.frames = 0

    def add(self, x_mm: Float32, z_mm: Float32, first: Bool, intensity: AnyArray | None = None) -> None:
        """Points (r,), `first` True where a frame begins."""
        self._x.add(x_mm)
        self._z.add(z_mm)
        if intensity is not None:
            self._light.add(intensity)
        self._starts.append(np.flatnonzero(first) + self.rows)
        self.rows += len(x_mm)
        self.frames += len(self._starts[-1])

    def add_frame(self, x_mm: Float32, z_mm: Float32, intensity: AnyArray) -> None:
        """A whole frame (r,), perhaps of no points."""
        self._starts.append(np.array([self.rows]))
        for values, column in ((self._x, x_mm), (self._z, z_mm), (self._light, intensity)):
            if len(column):
                values.add(column)
        self.rows += len(x_mm)
        self.frames += 1

    def gridded(self, where: str, *, by_spacing: bool = True) -> Grid:
        """The grid; the points are gone from here afterwards.

        Frames of unequal length (none is one without returns) are laid out by the gaps in x between returns, so that
        columns stay the sensor's pixels as far as the file shows them; where the gaps tell nothing, or `by_spacing` is
        False, points are counted from column 0.
        """
        starts = np.concatenate(self._starts)
        counts = np.diff(np.append(starts, self.rows))
        x, z = self._x.taken(), self._z.taken()
        light = self._light.taken() if self._light else None
        if counts.min() == counts.max():
            shape = (len(counts), int(counts[0]))
            return Grid(x.reshape(shape), z.reshape(shape), None if light is None else light.reshape(shape), "")
        if len({*np.unique(counts)} - {0}) == 1:  # frames without returns apart, all are alike
            by_spacing = False
        elif not (seen := np.isfinite(x) & np.isfinite(z)).all():
            counts = np.diff(np.append(0, np.cumsum(seen))[np.append(starts, self.rows)])
            starts = np.cumsum(counts) - counts
            x, z, light = x[seen], z[seen], None if light is None else light[seen]
        note = f"frames of {counts.min()} to {counts.max()} points: columns "
        columns = _by_spacing(x, starts, counts) if by_spacing else None
        note += "counted from each frame's first point" if columns is None else "by the gaps in x"
        if columns is None:
            columns = _by_count(starts, counts)
        width = max(int(each.max(initial=0)) for each in columns) + 1
        if len(counts) * width > max(FEW_CELLS, MOST_EMPTY * self.rows):
            raise InputError(where, f"expected frames of alike length, found {counts.min()} to {counts.max()} points")
        into = partial(_filled, (len(counts), width), starts, counts, columns)
        x_mm = into(x)
        del x  # each array of points is let go of before the next grid is made
        z_mm = into(z)
        del z
        return Grid(x_mm, z_mm, None if light is None else into(light), note)


class _Growing:
    """An array that grows in place: the system moves its pages rather than their content."""

    def __init__(self) -> None:
        self._all = np.empty(0)
        self._rows = 0

    def __len__(self) -> int:
        return self._rows

    def add(self, values: AnyArray) -> None:
        if not self._rows:
            self._all = np.empty(ROOM, values.dtype)
        rows = self._rows + len(values)
        if rows > len(self._all):
            self._all.resize(rows + rows // 16, refcheck=False)
        self._all[self._rows : rows] = values
        self._rows = rows

    def taken(self) -> AnyArray:
        """All that was added, which is gone from here."""
        whole, self._all = self._all, np.empty(0)
        whole.resize(self._rows, refcheck=False)
        return whole


def gridded(x_mm: Float, z_mm: Float, first: Bool, where: str) -> Grid:
    """The grid of points (R,) whose frames begin where `first` (R,) is True."""
    points = Points()
    points.add(bounded(x_mm), bounded(z_mm), first)
    return points.gridded(where)


def _blocks(counts: Int) -> Iterator[tuple[int, int]]:
    """First frame and the one after the last of blocks of about BLOCK_POINTS points."""
    number = np.cumsum(counts) // BLOCK_POINTS
    cuts = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(counts)]
    return pairwise(dict.fromkeys(cuts))


def _firsts(starts: Int, first: int, last: int, begin: int, end: int) -> Bool:
    """(end - begin,) True where the frames from `first` to `last` - 1 begin."""
    made = np.zeros(end - begin + 1, bool)  # the last frames may be empty
    made[starts[first:last] - begin] = True
    return made[:-1]


def _by_count(starts: Int, counts: Int) -> list[AnyArray]:
    """Columns of the points, block by block of frames, counted from each frame's first point."""
    ends = starts + counts
    return [
        columns_by_count(_firsts(starts, first, last, int(starts[first]), int(ends[last - 1]))).astype(np.int32)
        for first, last in _blocks(counts)
    ]


def _by_spacing(x_mm: Float32, starts: Int, counts: Int) -> list[AnyArray] | None:
    """Columns of the points, block by block of frames, by one pitch and origin; None where gaps tell nothing."""
    ends = np.append(starts[1:], len(x_mm))
    columns: list[AnyArray] = []
    pitch: float | None = None
    origin = 0.0
    for first, last in _blocks(counts):
        begin, end = int(starts[first]), int(ends[last - 1])
        if begin == end:
            columns.append(np.zeros(0, np.uint16))
            continue
        x, at = x_mm[begin:end].astype(np.float64), _firsts(starts, first, last, begin, end)
        if pitch is None:
            pitch = usual_pitch(x, at)
            if pitch is None:
                return None
            origin = float((x_mm[starts[counts > 0]] / pitch).min())
        found = columns_by_spacing(x, at, pitch, origin)
        if found is None:
            return None
        columns.append(found.astype(np.uint16 if found.max() < 2**16 else np.int32))
    return columns


def _filled(shape: tuple[int, int], starts: Int, counts: Int, columns: list[AnyArray], values: AnyArray) -> AnyArray:
    """Points put into their columns, block by block; empty cells are NaN, or 0 of whole numbers."""
    grid = np.full(shape, np.nan if values.dtype.kind == "f" else 0, values.dtype)
    ends = starts + counts
    for (first, last), column in zip(_blocks(counts), columns, strict=True):
        begin, end = int(starts[first]), int(ends[last - 1])
        cell = np.repeat(np.arange(first, last) * shape[1], counts[first:last]) + column
        grid.reshape(-1)[cell] = values[begin:end]
    return grid


def bounded(lengths_mm: Float) -> Float32:
    """Lengths as float32; what float32 cannot hold becomes the largest it can, for the check of sizes to find."""
    return np.asarray(np.clip(lengths_mm, -1e30, 1e30), np.float32)


def without(values: Float, missing: list[float]) -> Float:
    """`values` with NaN for those that mean no return."""
    return np.where(np.isin(values, missing), np.nan, values) if missing else values
