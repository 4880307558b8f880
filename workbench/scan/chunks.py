"""Unpacking a grid on all cores: HDF5 itself unpacks one chunk at a time, under a lock.

Chunks of whole frames, packed by gzip with or without shuffle, are taken as they lie in the file and unpacked here;
every other form goes through HDF5.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np

from workbench.units import AnyArray

PACKED = ("deflate", "shuffle deflate")  # the filters, in the order of writing


def read_frames(dataset: Any, out: AnyArray, first: int, last: int) -> None:
    """Frames first to last - 1 of `dataset` into the same place of `out`, converted to its dtype.

    Several threads may read different frames at the same time.

    Raises:
        OSError, RuntimeError: the file is damaged.
    """
    if not unpacks_here(dataset, out) or first % dataset.chunks[0]:
        dataset.read_direct(out, np.s_[first:last], np.s_[first:last])
        return
    rows = dataset.chunks[0]
    for start in range(first, last, rows):
        frames = np.s_[start : min(start + rows, last)]
        filters_left_out, packed = dataset.id.read_direct_chunk((start, 0))
        if filters_left_out:
            dataset.read_direct(out, frames, frames)
        else:
            _unpack(packed, rows, bool(dataset.shuffle), out[frames], f"{dataset.name}[{start}]")


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
