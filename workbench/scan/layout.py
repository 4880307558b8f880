"""What a profile recording's file must look like before any of its numbers is read (INTERFACES section 1)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np

from workbench.artefacts import Part, PartNames
from workbench.errors import InputError, nearest
from workbench.scan.hdf5 import attribute, data_set, member

MAX_SPHERE_MM = 1e4
HEADER = {"format": "profile-recording", "version": 1, "length_unit": "mm", "time_unit": "s"}


@dataclass(frozen=True)
class Field:
    """A data set: its shape in numbers and named sizes, its dtype in memory, and what is accepted in the file."""

    path: str
    shape: tuple[str | int, ...]
    dtype: type = np.float64
    kind: str = "f"
    bytes: int = 8
    required: bool = True


FIELDS = {
    "time_s": Field("/profiles/time", ("N",)),
    "x_mm": Field("/profiles/x", ("N", "M"), np.float32),
    "z_mm": Field("/profiles/z", ("N", "M"), np.float32),
    "intensity": Field("/profiles/intensity", ("N", "M"), np.uint16, "u", 2, required=False),
    "pass_index": Field("/profiles/pass", ("N",), np.int64, "iu", required=False),
    "robot_time_s": Field("/robot/time", ("K",)),
    "robot_position_mm": Field("/robot/position", ("K", 3)),
    "robot_quaternion_wxyz": Field("/robot/quaternion_wxyz", ("K", 4)),
    "robot_pass": Field("/robot/pass", ("K",), np.int64, "iu", required=False),
    "flange_from_profiler": Field("/hand_eye/flange_from_profiler", (4, 4), required=False),
}


def check_header(file: Any, where: str) -> None:
    """The four attributes that say what the file is."""
    for name, expected in HEADER.items():
        found = attribute(file, name)
        if found is None:
            raise InputError(f"{where}: /@{name}", f"expected {expected!r}, found none{nearest(name, file.attrs)}")
        if isinstance(found, bool) or found != expected:
            raise InputError(f"{where}: /@{name}", f"expected {expected!r}, found {_shown(found)}")


def data_sets(file: Any, where: str) -> dict[str, Any]:
    """Every data set that is there, of the dtype and shape that it must have."""
    sizes: dict[str, tuple[int, str]] = {}
    found = {}
    for name, field in FIELDS.items():
        dataset = data_set(file, field.path, field.kind, field.bytes)
        if dataset is None:
            _check_absent(file, field, where)
            continue
        _check_shape(dataset.shape, field, sizes, where)
        found[name] = dataset
    return found


def _check_absent(file: Any, field: Field, where: str) -> None:
    """Is the data set one that may be absent? A misspelt neighbour is named."""
    group_path, _, name = field.path.rpartition("/")
    group = member(file, group_path)
    if field.required or (group is not None and field.path.startswith("/hand_eye")):
        holder, lost = (file, group_path[1:]) if group is None else (group, name)
        hint = nearest(lost, holder) if hasattr(holder, "keys") else ""
        raise InputError(f"{where}: {field.path}", f"no such data set{hint}")


def _check_shape(shape: tuple[int, ...], field: Field, sizes: dict[str, tuple[int, str]], where: str) -> None:
    """Numbers must match, sizes by name must match the first data set that had them; nothing may be empty."""
    if len(shape) != len(field.shape):
        raise InputError(f"{where}: {field.path}", f"expected {len(field.shape)} dimensions, found shape {shape}")
    if 0 in shape:
        raise InputError(f"{where}: {field.path}", f"is empty: shape {shape}")
    for axis, (size, expected) in enumerate(zip(shape, field.shape, strict=True)):
        number, owner = sizes.setdefault(expected, (size, field.path)) if isinstance(expected, str) else (expected, "")
        if size != number:
            reason = f" as in {owner}" if owner else ""
            raise InputError(
                f"{where}: {field.path}", f"expected {number} along axis {axis}{reason}, found shape {shape}"
            )


def calibration(file: Any, where: str) -> tuple[float | None, Literal["robot", "own"]]:
    """The sphere's diameter, if this is a calibration recording, and whose clock the profiles' times are on."""
    sphere, profiles = member(file, "/sphere"), member(file, "/profiles")
    diameter_mm = None
    if sphere is not None:
        found = attribute(sphere, "diameter_mm")
        if isinstance(found, bool) or not isinstance(found, int | float) or not 0 < found < MAX_SPHERE_MM:
            raise InputError(f"{where}: /sphere@diameter_mm", f"expected a length in mm, found {_shown(found)}")
        diameter_mm = float(found)
    clock = text(profiles, "clock", f"{where}: /profiles") or "robot"
    if clock not in ("robot", "own"):
        raise InputError(f"{where}: /profiles@clock", f"expected 'robot' or 'own', found {_shown(clock)}")
    if clock == "own" and sphere is None:
        raise InputError(f"{where}: /profiles@clock", "'own' is for calibration recordings (with /sphere) only")
    return diameter_mm, "own" if clock == "own" else "robot"


def text(holder: Any, name: str, where: str) -> str | None:
    """A text attribute, or None; `where` is its holder's place."""
    value = attribute(holder, name)
    if value is not None and not isinstance(value, str):
        raise InputError(f"{where}@{name}", f"expected text, found {_shown(value)}")
    return value


def part_of(file: Any, where: str) -> Part:
    """What the root attributes say of part, people and instruments."""
    names: dict[str, Any] = {field.name: text(file, field.name, f"{where}: /") for field in fields(PartNames)}
    simulated = attribute(file, "simulated")
    if simulated not in (None, 0, 1):
        raise InputError(f"{where}: /@simulated", f"expected 0 or 1, found {_shown(simulated)}")
    try:
        return Part(**names, simulated=None if simulated is None else bool(simulated))
    except ValueError as error:
        raise InputError(f"{where}: /", str(error)) from None


def _shown(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else shown[:57] + "..."
