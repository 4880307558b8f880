"""HDF5 files from elsewhere, trusted with nothing: objects are found inside the file alone, and their storage is
checked against the file's size before anything is allocated. Whatever is wrong is an InputError that names the place.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import InputError, one_line
from workbench.storage import regular_file
from workbench.units import AnyArray

MAX_BYTES = 2**31  # a data set: 5e8 float32, three times the largest recording foreseen (5 m of edge, 3,200 columns)
MAX_RATIO = 1100  # a data set over MIN_BYTES in memory against the file; deflate reaches 1,032 at most
MIN_BYTES = 2**24
_BROKEN = (OSError, RuntimeError, KeyError, ValueError, TypeError, OverflowError, MemoryError)  # h5py has no own class
MAX_ENTRIES, MAX_ATTRIBUTE_BYTES = 16, 2**16
MAX_HOPS = 16  # soft links followed one after another


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
        raise InputError(str(path), f"expected a complete HDF5 file: {str(error) or type(error).__name__}") from None
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
