"""Both sides of the benchmark's picture show the same part at the same place."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bench.speed import pictures
from workbench.geometry.splat import draw_cloud

ROOT = Path(__file__).parents[2]
RECORDING = ROOT / "data" / "synthetic" / "milled_edge.h5"


def test_the_whole_part_is_in_the_picture() -> None:
    points, colour = pictures.points_of(RECORDING)
    camera = pictures.camera_for(points)
    column, row, _ = camera.project(points.astype(float)).T
    assert column.min() > 0
    assert column.max() < pictures.WIDTH_PX
    assert row.min() > 0
    assert row.max() < pictures.HEIGHT_PX
    assert np.mean(draw_cloud(points, colour, camera).rgb < 255) > 0.1


@pytest.mark.slow  # VTK may end the process that it runs in, so it gets one
def test_both_sides_draw_the_same_part() -> None:
    code = (
        "import sys, numpy as np; from pathlib import Path; from bench.speed import pictures as p;"
        "points, colour = p.points_of(Path(sys.argv[1])); camera = p.camera_for(points);"
        "ours = (p.draw_cloud(points, colour, camera).rgb < 250).any(axis=2);"
        "theirs = (p.by_vtk(points, colour, camera) < 250).any(axis=2);"
        "print((ours & theirs).sum() / (ours | theirs).sum())"
    )
    done = subprocess.run([sys.executable, "-c", code, RECORDING], cwd=ROOT, check=True, capture_output=True, text=True)
    assert float(done.stdout.split()[-1]) > 0.9
