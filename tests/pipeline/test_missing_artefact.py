"""A stage that needs what the one before it could not make is told so, by the artefact's name."""

from __future__ import annotations

from pathlib import Path

import pytest

from workbench.errors import InputError
from workbench.pipeline import Pipeline

CELL = Path(__file__).parents[2] / "data" / "robot" / "cell.json"


def test_stiffness_that_nobody_stated() -> None:
    cell = {"stage": "robot.cell", "cell": str(CELL)}
    stages = [{"stage": "stiffness.read"}, cell, {"stage": "stiffness.deflection"}]
    with pytest.raises(InputError, match=r"needs a JointStiffness for 'stiffness', but stiffness\.read made none"):
        Pipeline({"version": 1, "title": "t", "inputs": {}, "stages": stages}).run()
