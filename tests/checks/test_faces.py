"""What is no bevel is refused before a size of it is told: 204 simulated shapes of twelve kinds, and a real one."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest

from bench.confidently_wrong.shapes import SHAPES, shape_recording, with_grid
from tests.checks.conftest import good
from workbench.artefacts import Gate, Recording
from workbench.checks.faces import judge_faces
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.errors import WorkbenchError
from workbench.inspect import gate, sections
from workbench.scan import fuse

REAL = Path(__file__).parents[3] / "shared" / "data"


def inspected(recording: Recording) -> Gate:
    return gate(sections(segment(denoise(fuse(recording)))))


@pytest.mark.parametrize("kind", SHAPES)
def test_what_is_no_bevel_is_refused(kind: str) -> None:
    told = []
    for seed in range(17):
        with contextlib.suppress(WorkbenchError):
            told.append((seed, inspected(shape_recording(kind, seed)).reason))
    assert told == []


@pytest.mark.parametrize(
    "condition", ["paper", "arc", "wavy", "coarse", "correlated", "clamps", "two_pass", "reversed"]
)
def test_faces_of_bevels_pass(condition: str) -> None:
    cloud = denoise(fuse(good(condition)))
    assert [check.name for check in judge_faces(cloud, segment(cloud).labels) if not check.passed] == []


@pytest.mark.parametrize("file", ["vendor/gocator_surface_v2.csv"])
def test_a_real_surface_is_no_bevel(file: str) -> None:
    if not (REAL / file).is_file():
        pytest.skip("real files are not beside this checkout")
    rows = [line.split(",") for line in (REAL / file).read_text().splitlines()]
    first = next(i for i, row in enumerate(rows) if row[0] == r"Y\X") + 1
    grid = [[float(cell) if cell.strip() else np.nan for cell in row[1:]] for row in rows[first : first + 200]]
    widest = max(map(len, grid))
    z = np.full((200, 500), np.nan)
    for i, row in enumerate(grid):
        z[i, : min(len(row), 500)] = row[: min(widest, 500)][:500]
    base = shape_recording("empty table", 0)
    with pytest.raises(WorkbenchError):
        inspected(with_grid(base, np.broadcast_to(np.arange(500) * 0.3, z.shape), 150.0 - z))
