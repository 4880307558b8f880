"""Kernels over blocks of frames, on all cores: a compiled kernel without the interpreter lock, called by a few threads.

It is as fast as numba's own parallel loops, compiles several times faster, and needs no second threading layer.
"""

from __future__ import annotations

import functools
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from functools import partial
from typing import NoReturn, TypeVar

import numpy as np

from workbench.units import AnyArray, Int, Shaped

T = TypeVar("T")
BLOCK_POINTS = 2**17  # the least in a block: long enough to make a call cheap
BLOCKS_A_CORE = 8  # at most: short enough that no core waits long for another's last one


def over_blocks(kernel: Callable[[int, int], T], shape: tuple[int, ...], least_points: int | None = None) -> list[T]:
    """What `kernel(first, last)` returns for each block of frames [first, last), in order.

    Args:
        kernel: releases the interpreter lock; touches no frame outside its block, unless to read it.
        shape: of the grid, frames x columns.
        least_points: in a block, if not `BLOCK_POINTS`.

    Raises:
        What the kernel raises, once; blocks not begun by then are left out.
    """
    frames, columns = shape
    step = max(1, (least_points or BLOCK_POINTS) // max(columns, 1), -(-frames // (BLOCKS_A_CORE * cores())))
    return list(in_order(kernel, frames, step))


def in_order(task: Callable[[int, int], T], frames: int, step: int) -> Iterator[T]:
    """What `task(first, last)` returns for each `step` frames, in order, while further blocks are under way.

    The caller's thread works like the others: it waits for nobody who has not begun, be the machine busy or not.
    """
    spans = [(first, min(first + step, frames)) for first in range(0, frames, step)]
    if len(spans) < 2 or cores() < 2:
        yield from (task(*span) for span in spans)
        return
    todo, made, finished = iter(range(len(spans))), dict[int, Callable[[], T]](), threading.Semaphore(0)

    def work(k: int) -> None:
        try:
            value = task(*spans[k])
            made[k] = lambda: value
        except BaseException as error:
            made[k] = partial(_raise, error)

    def help_along() -> None:
        for k in todo:
            work(k)
            finished.release()

    helpers = [_helpers(cores() - 1).submit(help_along) for _ in range(min(cores(), len(spans)) - 1)]
    try:
        for k in range(len(spans)):
            while k not in made:
                other = next(todo, None)
                if other is None:
                    finished.acquire()
                else:
                    work(other)
            yield made.pop(k)()
    finally:
        deque(todo, maxlen=0)
        wait([one for one in helpers if not one.cancel()])


def _raise(error: BaseException) -> NoReturn:
    raise error


@functools.cache
def _helpers(count: int) -> ThreadPoolExecutor:
    """Threads that are kept: to start them takes as long as a million points."""
    return ThreadPoolExecutor(count, "blocks")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_helpers.cache_clear)  # a forked child has none of the threads


def cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def as_input(array: AnyArray) -> AnyArray:
    """`array` as kernels take it: contiguous and read-only, so that each kernel is compiled for one type alone."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view


def as_rows(grid: AnyArray) -> AnyArray:
    """As `as_input`, of a grid (N, M) that may hold one row for all frames (`repeated`): that row alone is (1, M).

    A kernel takes row `min(i, len - 1)` of it for frame i.
    """
    return as_input(grid[:1] if is_repeated(grid) else grid)


def repeated(row: AnyArray, frames: int) -> AnyArray:
    """A grid (frames, M) whose rows are all the same one (M,), which is in memory once."""
    return np.broadcast_to(row, (frames, row.size))


def is_repeated(grid: AnyArray) -> bool:
    """Whether a grid (N, M) is of one row for all frames."""
    return len(grid) > 1 and grid.strides[0] == 0


def evenly(count: int, most: int) -> Shaped[Int, " k"]:
    """Indices of some of `count` things, at most `most`, evenly from the first to the last.

    Example:
        >>> evenly(9, 3).tolist(), evenly(2, 3).tolist(), evenly(0, 3).tolist()
        ([0, 4, 8], [0, 1], [])
    """
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))
