"""Profiles gathered one by one into a grid of frames x columns."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from workbench.errors import InputError
from workbench.importing.bags_ragged import ragged_columns
from workbench.importing.neutral import ProfileFrames
from workbench.units import AnyArray, Float, Float32, Int

MAX_COLUMNS = 10_000
NOTHING = np.zeros(0, np.float32)


@dataclass(slots=True)
class Grid:
    """Rows of x and z (mm, NaN = no return) in float32, and of intensity where all rows have it."""

    by_spacing: bool  # columns of rows of different length: by gaps in x, or counted
    length_unit: str = "mm"  # that the lengths were read from, for messages
    time_s: list[float] = field(default_factory=list)
    topic: list[int] = field(default_factory=list)
    x_mm: list[Float32] = field(default_factory=list)
    z_mm: list[Float32] = field(default_factory=list)
    intensity: list[AnyArray] = field(default_factory=list)
    no_intensity: str = ""  # why there is none
    empty: int = 0
    ragged: str = ""  # how rows of different length were laid out

    def append(self, time_s: float, topic: int, x_mm: Float, z_mm: Float, intensity: AnyArray | None,
               where: str) -> None:  # fmt: skip
        """Add a profile. Raises InputError where it is too long."""
        if len(x_mm) > MAX_COLUMNS:
            raise InputError(where, f"expected a profile of at most {MAX_COLUMNS} points, found {len(x_mm)}")
        self.empty += not len(x_mm)
        self.time_s.append(time_s)
        self.topic.append(topic)
        self.x_mm.append(x_mm.astype(np.float32))
        self.z_mm.append(z_mm.astype(np.float32))
        self._append_intensity(intensity, len(x_mm))

    def _append_intensity(self, intensity: AnyArray | None, points: int) -> None:
        if self.no_intensity:
            return
        if intensity is None and points:
            self.no_intensity = "none in the bag"
        elif intensity is not None and not (
            (intensity >= 0).all() and (intensity <= 65535).all() and (intensity == np.rint(intensity)).all()
        ):
            self.no_intensity = "left out: not whole numbers from 0 to 65535"
        if self.no_intensity:
            self.intensity.clear()
        else:
            self.intensity.append(np.zeros(0, np.uint16) if intensity is None else intensity.astype(np.uint16))

    def frames(self, source: str, pass_gap_s: float | None) -> ProfileFrames:
        """The whole grid; the rows are given up as they are copied. Raises InputError where nothing was seen."""
        if not any(map(len, self.x_mm)):
            raise InputError(source, "expected profiles with points, found none")
        if not any(np.isfinite(row).any() for row in self.z_mm):
            raise InputError(source, "expected returns in the profiles, found none")
        columns = self._columns()
        width = 1 + max(int(row.max(initial=0)) for row in columns)
        if width > MAX_COLUMNS:
            raise InputError(source, f"expected profiles of at most {MAX_COLUMNS} columns, found {width} by gaps in x")
        return ProfileFrames(
            source=source,
            x_mm=_stacked(self.x_mm, columns, width, np.nan), z_mm=_stacked(self.z_mm, columns, width, np.nan),
            time_s=np.array(self.time_s), pass_index=self._passes(pass_gap_s), length_unit=self.length_unit,
            intensity=None if self.no_intensity else _stacked(self.intensity, columns, width, 0),
        )  # fmt: skip

    def _columns(self) -> list[AnyArray]:
        """Columns of each row's points."""
        lengths = {len(row) for row in self.x_mm} - {0}
        if len(lengths) == 1:
            every = np.arange(lengths.pop())
            return [every[: len(row)] for row in self.x_mm]
        for i, z in enumerate(self.z_mm):  # what was seen alone tells the spacing
            seen = np.isfinite(z)
            self.x_mm[i], self.z_mm[i] = self.x_mm[i][seen], z[seen]
            if not self.no_intensity:
                self.intensity[i] = self.intensity[i][seen]
        columns, self.ragged = ragged_columns(self.x_mm, self.by_spacing)
        return columns

    def _passes(self, gap_s: float | None) -> Int | None:
        """Passes (N,) from 0: a new one with each topic and after each gap longer than `gap_s`; None: there is one."""
        begins = np.diff(self.topic) != 0
        if gap_s is not None:
            begins |= np.diff(self.time_s) > gap_s
        return np.append(0, np.cumsum(begins)) if begins.any() else None

    @property
    def notes(self) -> list[str]:
        """What the user should know of it."""
        empty = [f"{self.empty} messages without points: frames without returns"] if self.empty else []
        return [f"intensity: {self.no_intensity or 'taken'}", *empty, *([self.ragged] if self.ragged else [])]


def _stacked(rows: list[AnyArray], columns: list[AnyArray], width: int, missing: float) -> AnyArray:
    """All rows (N, M), emptying the list as it goes, so that the peak stays at one grid and a bit."""
    made = np.full((len(rows), width), missing, rows[0].dtype)
    for i in range(len(rows)):
        made[i, columns[i]] = rows[i]
        rows[i] = NOTHING  # not a slice: that would keep the row alive
    rows.clear()
    return made
