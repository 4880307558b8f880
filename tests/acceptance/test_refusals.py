"""What cannot be used ends with 2, one line and nothing behind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.recordings import frames, with_grid
from workbench.artefacts import Recording
from workbench.scan import read, write

from .conftest import RECORDING, Ended

SHEET = 2.0 * np.sin(np.linspace(0.0, 40.0, 600))  # its flanks are nearly plane for a millimetre


def of_ranges(z_mm: Callable[[Recording], np.ndarray]) -> Callable[[Recording], Recording]:
    noise = np.random.default_rng(2)
    return lambda r: with_grid(r, r.x_mm, z_mm(r) + noise.normal(0.0, 0.012, r.z_mm.shape))


UNUSABLE: dict[str, tuple[Callable[[Recording], Recording], tuple[str, ...]]] = {
    "a sensor that says nothing": (lambda r: with_grid(r, r.x_mm, 0.0 * r.x_mm), ()),
    "a flat sheet": (of_ranges(lambda r: 150.0 + 0.0 * r.x_mm), ()),
    "a corrugated sheet": (of_ranges(lambda r: 150.0 + SHEET + 0.0 * r.x_mm), ()),
    "a single frame": (lambda r: frames(r, [100]), ("single frame",)),
    "two frames": (lambda r: frames(r, [100, 101]), ("expected",)),
    "a scanner at rest": (lambda r: frames(replace(r, robot_position_mm=0.0 * r.robot_position_mm), [5, 6, 7]), ()),
}


@pytest.mark.parametrize("what", UNUSABLE)
def test_what_cannot_be_inspected_is_refused(what: str, run: Callable[..., Ended], tmp_path: Path) -> None:
    """Shapes that are no bevel: tests/checks/test_faces.py."""
    change, words = UNUSABLE[what]
    write(change(read(recording=RECORDING)), tmp_path / "odd.h5")
    refused(run(tmp_path / "odd.h5"), "odd.h5", *words)


def test_a_raw_edge_is_refused(run: Callable[..., Ended]) -> None:
    refused(run(RECORDING.with_name("raw_edge.h5")), "raw_edge.h5", "no edge")


def refused(ended: Ended, *words: str) -> None:
    """In one line that names `words`."""
    lines = [line for line in ended.err.splitlines() if not line.startswith(("[", "compiling"))]
    assert ended.status == 2, ended.out
    assert len(lines) == 1, lines
    assert lines[0].startswith("error: ")
    assert "failed inside" not in lines[0]
    for word in words:
        assert word in lines[0]
    assert not ended.directory.exists() or not list(ended.directory.iterdir())
