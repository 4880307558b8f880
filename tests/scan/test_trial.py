"""The forked trial tells a crash and an endless loop from what merely fails."""

from __future__ import annotations

import os
import signal
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from workbench.errors import InputError
from workbench.scan import hdf5, read

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")


def test_results_and_exceptions_survive_a_crash_does_not() -> None:
    assert hdf5.survives(lambda: 1)
    assert hdf5.survives(lambda: 1 / 0)
    assert not hdf5.survives(lambda: os.kill(os.getpid(), signal.SIGSEGV))


def test_a_damaged_heap_of_texts_is_refused(build: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """A heap object that claims to reach almost to 2^64: HDF5 adds it up past the end and never comes back."""
    monkeypatch.setattr(hdf5, "CPU_SECONDS", 1)
    path = build()
    content = bytearray(path.read_bytes())
    heap = content.index(b"GCOL")
    struct.pack_into("<Q", content, heap + 16 + 8, 2**64 - 16)  # size of the heap's first object
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read(recording=path)
    assert str(caught.value).startswith(f"{path}: expected a complete HDF5 file")
