"""Kernels over blocks of frames, on all cores: a compiled kernel without the interpreter lock, called by a few threads.

It is as fast as numba's own parallel loops, compiles several times faster, and needs no second threading layer.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

from workbench.units import AnyArray

T = TypeVar("T")
BLOCK_POINTS = 2**17  # the least in a block: long enough to make a call cheap
BLOCKS_A_CORE = 8  # at most: short enough that no core waits long for another's last one


def over_blocks(kernel: Callable[[int, int], T], shape: tuple[int, ...]) -> list[T]:
    """What `kernel(first, last)` returns for each block of frames [first, last), in order.

    Args:
        kernel: releases the interpreter lock; touches no frame outside its block, unless to read it.
        shape: of the grid, frames x columns.

    Raises:
        What the kernel raises, once; blocks not begun by then are left out.
    """
    frames, columns = shape
    step = max(1, BLOCK_POINTS // max(columns, 1), -(-frames // (BLOCKS_A_CORE * cores())))
    return list(in_order(kernel, frames, step))


def in_order(task: Callable[[int, int], T], frames: int, step: int) -> Iterator[T]:
    """What `task(first, last)` returns for each `step` frames, in order, while further blocks are under way."""
    spans = [(first, min(first + step, frames)) for first in range(0, frames, step)]
    if len(spans) < 2 or cores() < 2:
        yield from (task(*span) for span in spans)
        return
    pool = ThreadPoolExecutor(max_workers=min(cores(), len(spans)))
    try:
        yield from pool.map(lambda span: task(*span), spans)
    finally:
        pool.shutdown(cancel_futures=True)


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def as_input(array: AnyArray) -> AnyArray:
    """`array` as kernels take it: contiguous and read-only, so that each kernel is compiled for one type alone."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view
