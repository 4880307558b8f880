"""Synthetic parts and their scanner: profile recordings whose truth is known exactly (docs/simulation.md)."""

from __future__ import annotations

from workbench.synthetic.conditions import CONDITIONS, RAW_CONDITIONS, random_recipe
from workbench.synthetic.recipe import Recipe
from workbench.synthetic.recipe_file import parse_recipe, read_recipe
from workbench.synthetic.simulate import simulate_file, simulate_recording, truth_path, write_simulation
from workbench.synthetic.truth import Truth, read_truth

__all__ = [
    "CONDITIONS",
    "RAW_CONDITIONS",
    "Recipe",
    "Truth",
    "parse_recipe",
    "random_recipe",
    "read_recipe",
    "read_truth",
    "simulate_file",
    "simulate_recording",
    "truth_path",
    "write_simulation",
]
