"""`scan.read`: a profile recording from an HDF5 file (INTERFACES section 1), refused unless all of it makes sense."""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from workbench.artefacts import NO_NAMES, PartNames, Recording, frozen
from workbench.errors import InputError
from workbench.geometry.blocks import in_order, repeated
from workbench.scan.checks import checked, in_micrometres
from workbench.scan.hdf5 import FIELDS, calibration, check_header, data_sets, opened, part_of, survives, text, whole
from workbench.stage import InputFile, Progress, stage
from workbench.units import AnyArray, Float32

BLOCK_BYTES = 2**22  # of x, and as much of z: still in the cache when it is checked
MAX_MM = 1e5  # 100 m: beyond it is not a length in mm but a code for 'no return', which is NaN here
ON_THE_GRID = ("x_mm", "z_mm", "intensity")


@stage("scan.read")
def read(*, recording: InputFile, part: PartNames = NO_NAMES, progress: Progress = None) -> Recording:
    """Read a profile recording: laser profiles (frame x column, mm) and robot poses, each with its time in s.

    Anything that the format (docs/recording.md) does not allow is refused.

    Args:
        recording: the HDF5 file, `format = "profile-recording"`, version 1.
        part: part, operator and instruments, where the file lacks them or is wrong.
        progress: called with the fraction read so far.

    Raises:
        InputError: not such a file, or not a whole one, with data set, row and what was expected.

    Example:
        >>> from workbench.scan import read
        >>> read(recording="data/synthetic/milled_edge.h5").z_mm.shape
        (309, 600)
    """
    found = read_in(recording, {}, progress)
    for said in found.part.contradicted(part):
        warnings.warn(f"{said}, which is taken", stacklevel=1)
    return replace(found, part=found.part.with_names(part))


def read_in(recording: Path, unit_mm: Mapping[str, float], progress: Progress = None) -> Recording:
    """As `read`, of a file whose `x_mm` or `z_mm` are in another unit of so many mm: what `workbench look` tries.

    Raises:
        InputError: as `read`.
    """
    where = str(recording)
    with opened(recording) as file:
        if not survives(lambda: _tables(file, where)):
            raise InputError(where, "expected a complete HDF5 file: its tables or texts are damaged")
        sets, values, header = _tables(file, where)
        values |= _grid(sets, where, progress, unit_mm)
    fields: dict[str, Any] = {name: frozen(array) for name, array in values.items()}
    return Recording(source=where, **fields, **header)


def _tables(file: Any, where: str) -> tuple[dict[str, Any], dict[str, AnyArray], dict[str, Any]]:
    """All but the grid: data sets by field, checked times, passes and poses, and what the attributes say."""
    check_header(file, where)
    sets = data_sets(file, where)
    diameter_mm, clock = calibration(file, where)
    values = {name: whole(sets[name], FIELDS[name].dtype) for name in sets if name not in ON_THE_GRID}
    _name_passes(values)
    values = checked(where, values, diameter_mm is not None or clock == "own", clock)
    part = part_of(file, where)
    unsure = tuple((text(file, "not_confirmed", f"{where}: /") or "").splitlines())
    return (
        sets,
        values,
        {"sphere_diameter_mm": diameter_mm, "clock": clock, "part": part, "not_confirmed": unsure},
    )


def _name_passes(values: dict[str, AnyArray]) -> None:
    """Where a pass array is absent there is one pass: that of the other side, if it names one."""
    for absent, time, other in (("pass_index", "time_s", "robot_pass"), ("robot_pass", "robot_time_s", "pass_index")):
        if absent not in values:
            named = np.unique(values[other]) if other in values else np.zeros(1, np.int64)
            values[absent] = np.full(len(values[time]), named[0] if len(named) == 1 else 0)


def _grid(sets: dict[str, Any], where: str, progress: Progress, unit_mm: Mapping[str, float]) -> dict[str, AnyArray]:
    """x, z and intensity, read and checked in blocks of frames; a block is whole chunks, so each is unpacked once.

    Most profilers give every frame the same x: as long as it is, it is kept once.
    """
    grid = {name: np.empty(sets[name].shape, FIELDS[name].dtype) for name in ON_THE_GRID if name in sets}
    frames, columns = grid["x_mm"].shape
    step = max([1, *(sets[name].chunks[0] for name in grid if sets[name].chunks)])
    step *= max(1, BLOCK_BYTES // (4 * columns * step))

    def block(name: str, out: AnyArray, first: int) -> AnyArray:
        read_frames(sets[name], out, first)
        if name in unit_mm:
            out *= unit_mm[name]
        return out

    row = block("x_mm", np.empty((1, columns), np.float32), 0)

    def fill(first: int, last: int) -> tuple[int, bool]:
        for name in grid.keys() - {"x_mm"}:
            block(name, grid[name][first:last], first)
        x_mm = block("x_mm", np.empty((last - first, columns), np.float32), first)
        alike = bool((x_mm.view(np.int32) == row.view(np.int32)).all())
        if not alike:
            grid["x_mm"][first:last] = x_mm
        return _count_returns(x_mm, grid["z_mm"][first:last], first, where), alike

    seen, same = 0, []
    for number, (returns, alike) in enumerate(in_order(fill, frames, step), 1):
        seen += returns
        same.append(alike)
        if progress is not None:
            progress(min(1.0, number * step / frames))
    if not seen:
        raise InputError(f"{where}: /profiles", "no return in any frame: every x or z is NaN")
    if all(same):
        grid["x_mm"] = repeated(row[0], frames)
    else:
        for number in np.flatnonzero(same).tolist():
            grid["x_mm"][number * step : (number + 1) * step] = row
    return grid


def _count_returns(x_mm: Float32, z_mm: Float32, first_frame: int, where: str) -> int:
    """How many points of a block came back; refuses infinities and what else cannot be a length."""
    from workbench.geometry import grids  # compiled code: loaded when there is something to read

    finite, absurd = grids.census(x_mm, z_mm, MAX_MM)
    if absurd:
        for name, values in (("x", x_mm), ("z", z_mm)):
            rows, columns = np.nonzero(np.abs(values) > MAX_MM)
            if len(rows):
                place = f"{where}: /profiles/{name}[{first_frame + rows[0]}, {columns[0]}]"
                found = f"{values[rows[0], columns[0]]:g}{in_micrometres(values)}"
                raise InputError(place, f"expected mm, NaN where nothing came back, found {found}")
    return finite


# Unpacking a grid on all cores: HDF5 itself unpacks one chunk at a time, under a lock.
#
# Chunks of whole frames, packed by gzip with or without shuffle, are taken as they lie in the file and unpacked
# here;
# every other form goes through HDF5.

PACKED = ("deflate", "shuffle deflate")  # the filters, in the order of writing


def read_frames(dataset: Any, out: AnyArray, first: int) -> None:
    """Frames from `first` on of `dataset` into `out`, as many as it has rows, converted to its dtype.

    Several threads may read different frames at the same time.

    Raises:
        OSError, RuntimeError: the file is damaged.
    """
    last = first + len(out)
    if not unpacks_here(dataset, out) or first % dataset.chunks[0]:
        dataset.read_direct(out, np.s_[first:last])
        return
    rows = dataset.chunks[0]
    for start in range(first, last, rows):
        end = min(start + rows, last)
        filters_left_out, packed = dataset.id.read_direct_chunk((start, 0))
        if filters_left_out:
            dataset.read_direct(out, np.s_[start:end], np.s_[start - first : end - first])
        else:
            _unpack(packed, rows, bool(dataset.shuffle), out[start - first : end - first], f"{dataset.name}[{start}]")


def unpacks_here(dataset: Any, out: AnyArray) -> bool:
    """Is this a form of storage that `read_frames` unpacks itself?"""
    chunks = dataset.chunks
    return (
        chunks is not None
        and chunks[1:] == dataset.shape[1:]
        and dataset.dtype == out.dtype == np.dtype("<f4")
        and " ".join(_filters(dataset)) in PACKED
    )


def _filters(dataset: Any) -> list[str]:
    import h5py

    names = {h5py.h5z.FILTER_DEFLATE: "deflate", h5py.h5z.FILTER_SHUFFLE: "shuffle"}
    properties = dataset.id.get_create_plist()
    return [names.get(properties.get_filter(i)[0], "other") for i in range(properties.get_nfilters())]


def _unpack(packed: bytes, rows: int, shuffled: bool, out: AnyArray, where: str) -> None:
    """A chunk of `rows` frames into `out`, which is shorter where the chunk reaches beyond the last frame."""
    import deflate  # libdeflate: 2.8 times as fast as zlib

    from workbench.geometry import grids

    expected = rows * out.shape[1] * out.itemsize
    try:
        plain = deflate.zlib_decompress(packed, expected)
    except deflate.DeflateError:
        plain = bytearray()
    if len(plain) != expected:
        raise OSError(f"{where}: {_damage(packed, expected)}")
    if shuffled:
        grids.unshuffle(np.frombuffer(plain, np.uint8), out)
    else:
        out[:] = np.frombuffer(plain, out.dtype).reshape(rows, -1)[: len(out)]


def _damage(packed: bytes, expected: int) -> str:
    """What is wrong with a chunk that does not unpack to `expected` bytes: zlib tells more."""
    unpacking = zlib.decompressobj()
    try:
        found = len(unpacking.decompress(packed, expected + 1))
    except zlib.error as error:
        return str(error)
    end = "" if unpacking.eof else " without an end"  # the end holds the checksum
    return f"expected a chunk of {expected} bytes, found {found}{end}"
