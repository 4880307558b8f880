"""Profiles gathered one by one into a grid of frames x columns."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from workbench.errors import InputError
from workbench.importing.neutral import ProfileFrames
from workbench.units import AnyArray, Float, Float32, Int

MAX_COLUMNS = 10_000
NOTHING = np.zeros(0, np.float32)


@dataclass(slots=True)
class Grid:
    """Rows of x and z (mm, NaN = no return) in float32, of one length unless `pad` fills them up at their end."""

    pad: bool
    length_unit: str = "mm"  # that the lengths were read from, for messages
    columns: int = 0
    time_s: list[float] = field(default_factory=list)
    topic: list[int] = field(default_factory=list)
    x_mm: list[Float32] = field(default_factory=list)
    z_mm: list[Float32] = field(default_factory=list)
    intensity: list[AnyArray] = field(default_factory=list)
    no_intensity: str = ""  # why there is none
    empty: int = 0
    uneven: bool = False

    def append(self, time_s: float, topic: int, x_mm: Float, z_mm: Float, intensity: AnyArray | None,
               where: str) -> None:  # fmt: skip
        """Add a profile. Raises InputError where its length is another than before."""
        if len(x_mm) and self.columns and len(x_mm) != self.columns:
            if not self.pad:
                hint = 'filled up with missing points by "uneven": "pad" in $.bag of the mapping'
                raise InputError(where, f"expected {self.columns} points as before, found {len(x_mm)}; {hint}")
            self.uneven = True
        if len(x_mm) > MAX_COLUMNS:
            raise InputError(where, f"expected a profile of at most {MAX_COLUMNS} points, found {len(x_mm)}")
        self.columns = max(self.columns, len(x_mm))
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
        if not self.columns:
            raise InputError(source, "expected profiles with points, found none")
        has_intensity = not self.no_intensity
        made = ProfileFrames(
            source=source,
            x_mm=_stacked(self.x_mm, self.columns, np.nan), z_mm=_stacked(self.z_mm, self.columns, np.nan),
            time_s=np.array(self.time_s), pass_index=self._passes(pass_gap_s), length_unit=self.length_unit,
            intensity=_stacked(self.intensity, self.columns, 0) if has_intensity else None,
        )  # fmt: skip
        if np.isnan(made.z_mm).all():
            raise InputError(source, "expected returns in the profiles, found none")
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
        empty = [f"{self.empty} messages without points: frames without returns"] if self.empty else []
        uneven = ["profiles of different length, filled up at their end: a column is no pixel"] if self.uneven else []
        return [f"intensity: {self.no_intensity or 'taken'}", *empty, *uneven]


def _stacked(rows: list[AnyArray], columns: int, missing: float) -> AnyArray:
    """All rows (N, M), emptying the list as it goes, so that the peak stays at one grid and a bit."""
    made = np.full((len(rows), columns), missing, rows[0].dtype)
    for i in range(len(rows)):
        made[i, : len(rows[i])] = rows[i]
        rows[i] = NOTHING  # not a slice: that would keep the row alive
    rows.clear()
    return made
