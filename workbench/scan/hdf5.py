"""HDF5 files from elsewhere, trusted with nothing: tried in a forked child, their layout checked before any number.

Of 4,000 recordings with a few bytes changed, libhdf5 2.0 never came back from 17 and crashed on 2, in the heap that
holds texts. A fork costs a few milliseconds; the child's death is the parent's error message.
"""

from __future__ import annotations

import contextlib
import faulthandler
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np

from workbench.artefacts import Part, PartNames
from workbench.errors import InputError, nearest, one_line
from workbench.storage import regular_file
from workbench.units import AnyArray

MAX_BYTES = 2**31  # a data set: 5e8 float32, three times the largest recording foreseen (5 m of edge, 3,200 columns)
MAX_RATIO = 1100  # a data set over MIN_BYTES in memory against the file; deflate reaches 1,032 at most
MIN_BYTES = 2**24
_BROKEN = (OSError, RuntimeError, KeyError, ValueError, TypeError, OverflowError, MemoryError)  # h5py has no own class
MAX_ENTRIES, MAX_ATTRIBUTE_BYTES = 16, 2**16
MAX_HOPS = 16  # soft links followed one after another


ENDINGS = (".h5", ".hdf5")


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """The HDF5 file at `path`, open for reading; every failure of HDF5 while it is open becomes an InputError."""
    import h5py

    before = regular_file(path)
    try:
        with h5py.File(path, "r") as file:
            yield file
        after = os.stat(path)
    except _BROKEN as error:
        if isinstance(error, MemoryError):
            raise InputError(str(path), "does not fit into memory") from None
        other = (
            ""
            if path.suffix.lower() in ENDINGS
            else f"; `workbench import --draft {path.name}` begins a recording of it"
        )
        cause = f"{str(error) or type(error).__name__}{other}"
        raise InputError(str(path), f"expected a complete HDF5 file: {cause}") from None
    if (after.st_size, after.st_mtime_ns, after.st_ino) != (before.st_size, before.st_mtime_ns, before.st_ino):
        raise InputError(str(path), "changed while it was read")


def member(group: Any, path: str, hops: int = 0) -> Any | None:
    """The object at `path` under `group`, or None. Links that leave the file are refused before they are followed."""
    import h5py

    for name in filter(lambda part: part not in ("", "."), path.split("/")):
        if not isinstance(group, h5py.Group) or not group.id.links.exists(name.encode()):
            return None
        kind = group.id.links.get_info(name.encode()).type
        if kind == h5py.h5l.TYPE_HARD:
            group = group[name]
        elif kind == h5py.h5l.TYPE_SOFT and hops < MAX_HOPS:
            target = group.id.links.get_val(name.encode()).decode()
            group = member(group.file if target.startswith("/") else group, target, hops + 1)
        else:
            where = f"{group.file.filename}: {group.name.rstrip('/')}/{name}"
            raise InputError(where, "expected data in this file, found a link that leaves it or leads nowhere")
    return group


def attribute(holder: Any, name: str) -> Any | None:
    """An attribute in Python's own types (an array of one entry counts as that entry); None if absent.

    Its size is looked at first: HDF5 itself believes what a damaged header declares, and hangs or crashes.
    """
    import h5py

    if name not in holder.attrs:
        return None
    low = h5py.h5a.open(holder.id, name.encode())
    if low.get_space().get_simple_extent_npoints() > MAX_ENTRIES or low.get_storage_size() > MAX_ATTRIBUTE_BYTES:
        place = f"{holder.file.filename}: {holder.name.rstrip('/')}/@{name}"
        raise InputError(place, f"expected one value, found {low.get_storage_size()} bytes")
    value = holder.attrs[name]
    if isinstance(value, np.ndarray | np.generic):
        value = value.reshape(-1)[0] if np.size(value) == 1 else value
        value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    if isinstance(value, str):  # h5py lets broken UTF-8 through as surrogates, which no JSON or HTML could carry
        return value.encode("utf-8", "replace").decode("utf-8")
    return value


def data_set(file: Any, path: str, kind: str, size: int) -> Any | None:
    """The data set at `path`, or None; refuses other objects, dtypes that are not `kind` or wider than `size` bytes,
    and storage that does not hold what is declared.
    """
    import h5py

    where = f"{file.filename}: {path}"
    found = member(file, path)
    if found is None:
        return None
    if not isinstance(found, h5py.Dataset):
        raise InputError(where, "expected a data set, found a group or a type")
    dtype = found.dtype
    if dtype.kind not in kind or dtype.itemsize > size:
        names = {"f": "floating-point numbers", "iu": "integers", "u": "unsigned integers"}
        raise InputError(where, f"expected {names[kind]} of at most {8 * size} bits, found {one_line(str(dtype))}")
    if found.shape is None:
        raise InputError(where, "expected an array, found an empty data space")
    _check_storage(found, where, os.stat(file.filename).st_size)
    return found


def _check_storage(dataset: Any, where: str, file_bytes: int) -> None:
    """Is everything that is declared in this file? Chunks that were never written would read as made-up numbers."""
    import h5py

    declared = dataset.dtype.itemsize * math.prod(dataset.shape)
    if dataset.is_virtual or dataset.external:
        raise InputError(where, "expected its values in this file, found virtual or external storage")
    if declared > MAX_BYTES:
        raise InputError(where, f"declares {declared} bytes; at most {MAX_BYTES} are read")
    stored = dataset.id.get_storage_size()
    if dataset.chunks:
        chunks = math.prod(-(-size // step) for size, step in zip(dataset.shape, dataset.chunks, strict=True))
        if (missing := chunks - dataset.id.get_num_chunks()) > 0:
            raise InputError(where, f"declares {chunks} chunks, of which the file lacks {missing}")
    elif stored < declared:
        raise InputError(where, f"declares {declared} bytes, of which the file holds {stored}")
    if stored > file_bytes or (declared > MIN_BYTES and declared > MAX_RATIO * stored):
        raise InputError(where, f"declares {declared} bytes, more than {stored} in a file of {file_bytes} can hold")
    filters = dataset.id.get_create_plist()
    for index in range(filters.get_nfilters()):
        code, _, _, name = filters.get_filter(index)
        if not h5py.h5z.filter_avail(code):
            raise InputError(
                where, f"is compressed by a filter that is not installed: {one_line(name.decode()) or code}"
            )


def whole(dataset: Any, dtype: type) -> AnyArray:
    """All of a data set that passed `data_set`, as native `dtype`."""
    out = np.empty(dataset.shape, dtype)
    if out.size:
        dataset.read_direct(out)
    return out


CPU_SECONDS = 2  # of the child; a whole file's tables take a hundredth of one


def survives(action: Callable[[], object], seconds: int = CPU_SECONDS) -> bool:
    """Whether `action` comes back within its processor time, with a result or an exception, rather than crash.

    True without trial where processes cannot be forked.
    """
    if not hasattr(os, "fork"):
        return True
    child = os.fork()
    if child == 0:
        try:
            _confine(seconds)
            with contextlib.suppress(Exception):
                action()
        finally:
            os._exit(0)  # no clean-up of what belongs to the parent
    return not os.WIFSIGNALED(os.waitpid(child, 0)[1])


def _confine(seconds: int) -> None:
    """No core file, no message of a crash, no more than so much processor time."""
    import resource

    faulthandler.disable()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))


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
    if field.required or (field.path.startswith("/hand_eye") and group is not None and len(group)):
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
        plan = text(file, "scan_plan", f"{where}: /")
        return Part(**names, simulated=None if simulated is None else bool(simulated), scan_plan=plan)
    except ValueError as error:
        raise InputError(f"{where}: /", str(error)) from None


def _shown(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else shown[:57] + "..."
