"""The shapes that annotations name are checked in the tests: an axis that is another one fails."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.shapes import unchecked
from workbench.edge.broken_end import whole_end
from workbench.geometry.grids import fuse
from workbench.units import Shaped


def test_a_dataclass_with_another_axis_fails() -> None:
    end = whole_end(3)
    with pytest.raises(AssertionError, match=r"BrokenEnd, u_mm: expected Shaped\[Float, ' N'\], found \(4,\)"):
        replace(end, u_mm=np.zeros(4))


def test_a_function_with_another_axis_fails() -> None:
    grid, poses = np.zeros((2, 5), np.float32), np.tile(np.eye(4), (2, 1, 1))
    assert fuse(grid, grid, poses, np.zeros(3)).shape == (2, 5, 3)
    with pytest.raises(AssertionError, match=r"fuse, base_from_profiler: expected Shaped\[Float, 'N 4 4'\]"):
        fuse(grid, grid, poses[:1], np.zeros(3))
    with pytest.raises(ValueError, match="N, M"):
        unchecked(fuse)(grid, grid, poses[:1], np.zeros(3))


def test_users_have_plain_annotations() -> None:
    """Outside the tests a shape costs nothing: no jaxtyping is imported."""
    import subprocess
    import sys

    told = "import sys, typing, workbench.edge.broken_end as rim; "
    told += "print('jaxtyping' in sys.modules, rim.Shaped is typing.Annotated)"
    out = subprocess.run([sys.executable, "-c", told], check=True, capture_output=True, text=True).stdout
    assert out == "False True\n"
    assert "jaxtyping" in repr(Shaped)
