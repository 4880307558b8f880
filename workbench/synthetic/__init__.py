"""Synthetic parts and their scanner: profile recordings whose truth is known exactly (docs/simulation.md)."""

from __future__ import annotations

from workbench.synthetic.recipe import Recipe, parse_recipe, read_recipe
from workbench.synthetic.simulate import simulate_file, simulate_recording, truth_path, write_simulation
from workbench.synthetic.truth import Truth, read_truth

__all__ = [
    "Recipe",
    "Truth",
    "parse_recipe",
    "read_recipe",
    "read_truth",
    "simulate_file",
    "simulate_recording",
    "truth_path",
    "write_simulation",
]
