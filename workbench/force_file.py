"""Forces of a dynamometer over time: Kistler's DynoWare export, or a table of `fx_n`, `fy_n`, `fz_n`."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.storage import MOST_BYTES, read_text
from workbench.units import Float, Shaped

NAME = "Kistler DynoWare"
MARK = "DynoWare"
MOST_HEAD = 60  # lines
UNITS = {"N": 1.0, "kN": 1000.0, "Nm": 1.0, "V": 1.0}
TABLE = ("fx_n", "fy_n", "fz_n")


class Forces(NamedTuple):
    """Samples of a dynamometer: forces in N, moments in N m."""

    time_s: Shaped[Float, " n"]  # rising
    value: Shaped[Float, "n c"]
    channel: tuple[str, ...]
    unit: tuple[str, ...]
    rate_hz: float


def recognises(head: str) -> bool:
    """Whether a text begins as DynoWare's export does."""
    return head.startswith(MARK)


def read_forces(path: Path, rate_hz: float | None = None) -> Forces:
    """The samples of a file; delimiter and decimal mark as its head has them.

    A table has the columns fx_n, fy_n, fz_n and, where no `rate_hz` is given, time_s. Lines that begin with # are
    comments.

    Raises:
        InputError: no row of channels, a unit that is not known, a cell that is no number, times that do not rise.
    """
    lines = read_text(path, MOST_BYTES).splitlines()
    first = lines[0] if lines else ""
    delimiter = "\t" if "\t" in first else ";" if ";" in first else ","
    if recognises(first):
        names_at = next(
            (k for k, line in enumerate(lines[:MOST_HEAD]) if line.split(delimiter)[0].strip() == "Time"), None
        )
        if names_at is None or names_at + 1 >= len(lines):
            raise InputError(str(path), f"expected a row of channels that begins with Time within {MOST_HEAD} lines")
        names, units = _channels(lines, names_at, delimiter, path)
        return _sampled(_numbers(lines, names_at + 2, len(names), delimiter, path), names, units, path)
    names_at = next((k for k, line in enumerate(lines[:MOST_HEAD]) if line.strip() and line.strip()[0] != "#"), 0)
    delimiter = ";" if names_at < len(lines) and ";" in lines[names_at] else ","
    names = [cell.strip() for cell in lines[names_at].split(delimiter)] if lines else []
    missing = [name for name in (*TABLE, *(() if rate_hz else ("time_s",))) if name not in names]
    if missing:
        raise InputError(
            f"{path}: line {names_at + 1}",
            f"expected DynoWare's export, or a table with the column '{missing[0]}' (time_s may be left out where "
            f"rate_hz is given), found {', '.join(names)[:80]!r}",
        )
    table = _numbers(lines, names_at + 1, len(names), delimiter, path)
    time = table[:, names.index("time_s")] if "time_s" in names else np.arange(len(table)) / float(rate_hz or 1.0)
    channels = table[:, [names.index(name) for name in TABLE]]
    return _sampled(np.column_stack([time, channels]), ["Time", "Fx", "Fy", "Fz"], ["s", "N", "N", "N"], path)


def _channels(lines: list[str], at: int, delimiter: str, path: Path) -> tuple[list[str], list[str]]:
    """Names and units of DynoWare's columns, time first."""
    names = [cell.strip() for cell in lines[at].split(delimiter) if cell.strip()]
    units = [cell.strip() for cell in lines[at + 1].split(delimiter)][: len(names)]
    if len(names) < 2 or len(set(names)) < len(names):
        raise InputError(f"{path}: line {at + 1}", f"expected Time and channels of different names, found {names}")
    if units[:1] != ["s"] or len(units) < len(names) or any(unit not in UNITS for unit in units[1:]):
        expected = f"expected the unit s and for each channel one of {', '.join(UNITS)}, found {units}"
        raise InputError(f"{path}: line {at + 2}", expected)
    return names, units


def _numbers(lines: list[str], first: int, count: int, delimiter: str, path: Path) -> Float:
    """Rows of `count` finite numbers from the line `first` (from 0) on; with semicolons, commas are decimal marks."""
    rows = [line.replace(",", ".") if delimiter == ";" else line for line in lines[first:] if line.strip()]
    try:
        table = np.loadtxt(io.StringIO("\n".join(rows)), delimiter=delimiter, ndmin=2, usecols=range(count))
        if len(table) >= 2 and np.isfinite(table).all():
            return np.asarray(table)
    except ValueError:
        pass
    for k, row in enumerate(rows):
        cells = row.split(delimiter)[:count]
        if len(cells) < count or not all(_is_number(cell) for cell in cells):
            raise InputError(f"{path}: row {k + 1} of the samples", f"expected {count} numbers, found {row[:60]!r}")
    raise InputError(str(path), "expected at least two samples")


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False


def _sampled(table: Float, names: list[str], units: list[str], path: Path) -> Forces:
    time = table[:, 0]
    if not (np.diff(time) > 0).all():
        raise InputError(str(path), "expected at least two samples and times that rise")
    scale = np.array([UNITS[unit] for unit in units[1:]])
    rate = (len(time) - 1) / float(time[-1] - time[0])
    shown = tuple("N" if unit == "kN" else unit for unit in units[1:])
    return Forces(time, table[:, 1:] * scale, tuple(names[1:]), shown, rate)


def summary(forces: Forces) -> list[str]:
    """Duration, rate, and of each channel mean, standard deviation, extremes and strongest frequency."""
    span = float(forces.time_s[-1] - forces.time_s[0])
    rows = [f"samples: {len(forces.time_s)} at {forces.rate_hz:.6g} Hz, {span:.6g} s, {len(forces.channel)} channels"]
    for name, unit, value in zip(forces.channel, forces.unit, forces.value.T, strict=True):
        off = value - value.mean()
        strength = np.abs(np.fft.rfft(off * np.hanning(off.size)))
        peak = float(np.fft.rfftfreq(off.size, 1.0 / forces.rate_hz)[int(np.argmax(strength))])
        rows.append(
            f"  {name}: mean {value.mean():.4g} {unit}, standard deviation {off.std():.4g}, "
            f"{value.min():.4g} to {value.max():.4g}, strongest at {peak:.5g} Hz"
        )
    return rows
