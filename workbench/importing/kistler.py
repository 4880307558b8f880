"""Forces of a dynamometer as Kistler's DynoWare exports them: a head of names and values, then a row a sample."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.importing.mapping_parts import TextPart
from workbench.importing.text import first_bytes, head_text, read_table
from workbench.units import Float, Shaped

NAME = "Kistler DynoWare"
MARK = "DynoWare"
MOST_HEAD = 60  # lines
UNITS = {"N": 1.0, "kN": 1000.0, "Nm": 1.0, "V": 1.0}


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


def read_forces(path: Path) -> Forces:
    """The samples of an export; delimiter and decimal mark as the head has them.

    Raises:
        InputError: no row of channels, a unit that is not known, a cell that is no number, times that do not rise.
    """
    head = head_text(first_bytes(path)).splitlines()[:MOST_HEAD]
    first = head[0] if head else ""
    delimiter: Literal["\t", ";", ","] = "\t" if "\t" in first else ";" if ";" in first else ","
    names_at = next((k for k, line in enumerate(head) if line.split(delimiter)[0].strip() == "Time"), None)
    if names_at is None or names_at + 1 >= len(head):
        raise InputError(str(path), f"expected a row of channels that begins with Time within {MOST_HEAD} lines")
    names = [cell.strip() for cell in head[names_at].split(delimiter) if cell.strip()]
    units = [cell.strip() for cell in head[names_at + 1].split(delimiter)][: len(names)]
    where = f"{path}: line {names_at + 2}"
    if len(names) < 2 or len(set(names)) < len(names):
        raise InputError(
            f"{path}: line {names_at + 1}", f"expected Time and channels of different names, found {names}"
        )
    if units[:1] != ["s"] or len(units) < len(names) or any(unit not in UNITS for unit in units[1:]):
        raise InputError(where, f"expected the unit s and for each channel one of {', '.join(UNITS)}, found {units}")
    form = TextPart(
        delimiter=delimiter,
        decimal="," if delimiter == ";" else ".",
        skip_lines=names_at + 2,
        header=False,
        length_unit="mm",
    )
    table = read_table(path, form, {name: k for k, name in enumerate(names)})
    time_s = table.present("Time")
    if len(time_s) < 2 or not (np.diff(time_s) > 0).all():
        raise InputError(table.where, "expected at least two samples and times that rise")
    value = np.stack([table.present(name) for name in names[1:]], axis=1)
    scale = np.array([UNITS[unit] for unit in units[1:]])
    rate = 1.0 / float(np.median(np.diff(time_s)))
    shown = tuple("N" if unit == "kN" else unit for unit in units[1:])
    return Forces(time_s, value * scale, tuple(names[1:]), shown, rate)


def told(forces: Forces) -> list[str]:
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
