"""A second, independent simulator: a section swept along a space curve, a mesh met by rays (docs/simulation.md)."""

from __future__ import annotations

from workbench.synthetic.swept.recipe import SweptRecipe
from workbench.synthetic.swept.simulate import simulate_swept
from workbench.synthetic.swept.truth import SweptTruth

__all__ = ["SweptRecipe", "SweptTruth", "simulate_swept"]
