"""Blocks of frames: every frame once, in order, and no work after a failure."""

from __future__ import annotations

import os
import threading
from typing import Any

import numpy as np
import pytest

from workbench.geometry import blocks


@pytest.mark.parametrize("cores", [1, 3])
@pytest.mark.parametrize(("frames", "columns", "most"), [*((n, 125, 8) for n in (0, 1, 5, 63, 64)), (3, 1001, 1)])
def test_every_frame_once_and_in_order(monkeypatch: Any, frames: int, columns: int, most: int, cores: int) -> None:
    monkeypatch.setattr(blocks, "cores", lambda: cores)
    spans = blocks.over_blocks(lambda first, last: (first, last), (frames, columns), 1000)
    assert [i for first, last in spans for i in range(first, last)] == list(range(frames))
    assert all(last - first <= most for first, last in spans)


def test_a_forked_process_has_threads_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "cores", lambda: 2)
    both = threading.Barrier(2, timeout=120)

    def together(first: int, last: int) -> int:
        return both.wait()

    assert sorted(blocks.in_order(together, 2, 1)) == [0, 1]
    child = os.fork()
    if child == 0:
        both.reset()
        os._exit(sorted(blocks.in_order(together, 2, 1)) != [0, 1])
    assert os.waitpid(child, 0)[1] == 0


def test_kernels_see_one_type_whatever_the_array_was() -> None:
    array = np.arange(12.0).reshape(3, 4)
    for given in (array, array[:, ::2], array.T):
        made = blocks.as_input(given)
        np.testing.assert_array_equal(made, given)
        assert made.flags.c_contiguous
        assert not made.flags.writeable
    assert array.flags.writeable
    assert np.shares_memory(blocks.as_input(array), array)
