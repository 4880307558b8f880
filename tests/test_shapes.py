"""The shapes that annotations name are checked in the tests: an axis that is another one fails."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from workbench.artefacts import PointSet
from workbench.robot import refusal
from workbench.units import Shaped


def test_a_dataclass_and_a_function_with_another_axis_fail() -> None:
    with pytest.raises(AssertionError, match=r"PointSet, points_mm: expected Shaped\[Float, 'n 3'\], found \(5, 2\)"):
        PointSet(np.zeros((5, 2)))
    with pytest.raises(AssertionError, match=r"refusal, joints: expected Shaped\[Float, 'n 6'\], found \(2, 5\)"):
        refusal(None, np.zeros((2, 5)), np.zeros(2), np.zeros(2), 0)


def test_users_have_plain_annotations() -> None:
    """Outside the tests a shape costs nothing: no jaxtyping is imported."""
    told = "import sys, typing, workbench.edge, workbench.units as units; "
    told += "print('jaxtyping' in sys.modules, units.Shaped is typing.Annotated)"
    out = subprocess.run([sys.executable, "-c", told], check=True, capture_output=True, text=True).stdout
    assert out == "False True\n"
    assert "jaxtyping" in repr(Shaped)
