"""Profiles gathered one by one into a grid of frames x columns.

They are kept in blocks: a block that is given up goes back to the system, thousands of small arrays would not.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from workbench.errors import InputError
from workbench.geometry.columns import columns_by_count, columns_by_spacing, usual_pitch
from workbench.importing.neutral import ProfileFrames
from workbench.units import AnyArray, Bool, Float, Float32, Int

# Columns for profiles of different length, a block of them at a time, so that many take little room.

SAMPLE = 4  # blocks that the usual step is taken from


def ragged_columns(blocks_mm: list[Float32], lengths: list[Int], by_spacing: bool) -> tuple[list[AnyArray], str]:
    """Columns (uint16) of the points of each block of x, and how they were found. All points are returns.

    By the gaps in x, so that a column stays a pixel of the sensor as far as x shows it; where the gaps tell nothing, or
    `by_spacing` is False, counted from each profile's first point.

    Args:
        blocks_mm: x of some profiles each, one after the other.
        lengths: points of each of their profiles.
    """
    found = _by_spacing(blocks_mm, lengths) if by_spacing else None
    how = "counted from each profile's first point" if found is None else "by the gaps in x"
    every = np.concatenate(lengths)
    note = f"profiles of {every.min()} to {every.max()} points: columns {how}"
    return found or [counted(length) for length in lengths], note


def counted(lengths: Int) -> AnyArray:
    """Columns (R,) from 0 in each of some profiles of these lengths."""
    return columns_by_count(_first(lengths)).astype(np.uint16)


def _by_spacing(blocks_mm: list[Float32], lengths: list[Int]) -> list[AnyArray] | None:
    chosen = [k for k, x in enumerate(blocks_mm) if len(x)]
    sample = chosen[:: 1 + len(chosen) // SAMPLE]
    x_mm = np.concatenate([blocks_mm[k] for k in sample]).astype(float)
    pitch_mm = usual_pitch(x_mm, np.concatenate([_first(lengths[k]) for k in sample]))
    if pitch_mm is None:
        return None
    origin = min(float((blocks_mm[k][_first(lengths[k])] / pitch_mm).min()) for k in chosen)
    columns: list[AnyArray] = []
    for x, length in zip(blocks_mm, lengths, strict=True):
        first = _first(length)
        found = columns_by_spacing(x.astype(float), first, pitch_mm=pitch_mm, origin=origin) if len(x) else first
        if found is None:
            return None
        columns.append(found.astype(np.uint16))
    return columns


def _first(lengths: Int) -> Bool:
    """Which of the points (R,) of some profiles are a profile's first."""
    first = np.zeros(int(lengths.sum()), bool)
    first[(np.cumsum(lengths) - lengths)[lengths > 0]] = True
    return first


MAX_COLUMNS = 10_000
BLOCK = 64  # profiles
NAMES = ("x", "z", "intensity")


@dataclass(slots=True)
class Grid:
    """Rows of x and z (mm, NaN = no return) in float32, and of intensity where all rows have it."""

    by_spacing: bool  # columns of rows of different length: by gaps in x, or counted
    length_unit: str = "mm"  # that the lengths were read from, for messages
    time_s: list[float] = field(default_factory=list)
    topic: list[int] = field(default_factory=list)
    blocks: dict[str, list[AnyArray]] = field(default_factory=lambda: {name: [] for name in NAMES})
    pending: list[tuple[AnyArray, AnyArray, AnyArray]] = field(default_factory=list)
    lengths: list[Int] = field(default_factory=list)  # points of each row, block by block
    empty: int = 0
    no_intensity: str = ""  # why there is none
    ragged: str = ""  # how rows of different length were laid out

    def append(
        self, time_s: float, topic: int, x_mm: Float, z_mm: Float, intensity: AnyArray | None, where: str
    ) -> None:
        """Add a profile. Raises InputError where it is too long."""
        if len(x_mm) > MAX_COLUMNS:
            raise InputError(where, f"expected a profile of at most {MAX_COLUMNS} points, found {len(x_mm)}")
        self.empty += not len(x_mm)
        self.time_s.append(time_s)
        self.topic.append(topic)
        self.pending.append((x_mm.astype(np.float32), z_mm.astype(np.float32), self._counts(intensity, len(x_mm))))
        if len(self.pending) == BLOCK:
            self._close_block()

    def _counts(self, intensity: AnyArray | None, points: int) -> AnyArray:
        """Intensity as uint16; none from the first profile on that has none, or not such."""
        if intensity is None and points:
            self.no_intensity = self.no_intensity or "none in the bag"
        elif intensity is not None and not (
            (intensity >= 0).all() and (intensity <= 65535).all() and (intensity == np.rint(intensity)).all()
        ):
            self.no_intensity = self.no_intensity or "left out: not whole numbers from 0 to 65535"
        if self.no_intensity or intensity is None:
            return np.zeros(0, np.uint16)
        return intensity.astype(np.uint16)

    def _close_block(self) -> None:
        if self.pending:
            self.lengths.append(np.array([len(row[0]) for row in self.pending]))
            for name, rows in zip(NAMES, zip(*self.pending, strict=True), strict=True):
                self.blocks[name].append(np.concatenate(rows))
            self.pending.clear()

    def frames(self, source: str, pass_gap_s: float | None) -> ProfileFrames:
        """The whole grid; the blocks are given up as they are copied. Raises InputError where nothing was seen."""
        self._close_block()
        if not any(len(x) for x in self.blocks["x"]):
            raise InputError(source, "expected profiles with points, found none")
        if not any(np.isfinite(z).any() for z in self.blocks["z"]):
            raise InputError(source, "expected returns in the profiles, found none")
        columns = self._columns()
        width = 1 + max(int(column.max(initial=0)) for column in columns)
        if width > MAX_COLUMNS:
            raise InputError(source, f"expected profiles of at most {MAX_COLUMNS} columns, found {width} by gaps in x")
        x_mm, z_mm = (self._stacked(name, columns, width, np.nan) for name in ("x", "z"))
        intensity = None if self.no_intensity else self._stacked("intensity", columns, width, 0)
        return ProfileFrames(
            source=source,
            x_mm=x_mm,
            z_mm=z_mm,
            time_s=np.array(self.time_s),
            intensity=intensity,
            pass_index=self._passes(pass_gap_s),
            length_unit=self.length_unit,
        )

    def _columns(self) -> list[AnyArray]:
        """Columns of the points of each block."""
        if len(set(np.unique(np.concatenate(self.lengths))) - {0}) == 1:
            alike: dict[bytes, AnyArray] = {}  # one array for all blocks of as many rows
            return [alike.setdefault(length.tobytes(), counted(length)) for length in self.lengths]
        for k, z in enumerate(self.blocks["z"]):  # what was seen alone tells the spacing
            seen, row = np.isfinite(z), np.repeat(np.arange(len(self.lengths[k])), self.lengths[k])
            self.lengths[k] = np.bincount(row[seen], minlength=len(self.lengths[k]))
            for name in NAMES[: 2 if self.no_intensity else 3]:
                self.blocks[name][k] = self.blocks[name][k][seen]
        columns, self.ragged = ragged_columns(self.blocks["x"], self.lengths, self.by_spacing)
        return columns

    def _stacked(self, name: str, columns: list[AnyArray], width: int, missing: float) -> AnyArray:
        """All rows (N, M) of one quantity, emptying its blocks as it goes."""
        blocks, begin = self.blocks[name], 0
        made = np.full((len(self.time_s), width), missing, blocks[0].dtype)
        for k, length in enumerate(self.lengths):
            made[begin + np.repeat(np.arange(len(length)), length), columns[k]] = blocks[k]
            blocks[k] = blocks[k][:0].copy()  # not a slice alone: that would keep the block alive
            begin += len(length)
        blocks.clear()
        return made

    def _passes(self, gap_s: float | None) -> Int | None:
        """Passes (N,) from 0: a new one with each topic and after each gap longer than `gap_s`; None: there is one."""
        begins = np.diff(self.topic) != 0
        if gap_s is not None:
            begins |= np.diff(self.time_s) > gap_s
        return np.append(0, np.cumsum(begins)) if begins.any() else None

    @property
    def notes(self) -> list[str]:
        """What the user should know of it."""
        told = [f"{self.empty} messages without points: frames without returns"] if self.empty else []
        return [f"intensity: {self.no_intensity or 'taken'}", *told, *([self.ragged] if self.ragged else [])]
