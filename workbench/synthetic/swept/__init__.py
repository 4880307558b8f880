"""A second, independent simulator: a section swept along a space curve, a mesh met by rays (docs/simulation.md)."""

from __future__ import annotations

from workbench.synthetic.swept.recipe import GrooveRecipe, SweptRecipe
from workbench.synthetic.swept.simulate import simulate_groove, simulate_swept
from workbench.synthetic.swept.truth import GrooveTruth, SweptTruth

__all__ = ["GrooveRecipe", "GrooveTruth", "SweptRecipe", "SweptTruth", "simulate_groove", "simulate_swept"]
