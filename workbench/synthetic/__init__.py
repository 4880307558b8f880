"""Synthetic parts and their scanner: profile recordings whose truth is known exactly (docs/simulation.md)."""

from __future__ import annotations

from workbench.artefacts.showing import shown_all
from workbench.synthetic.groove_truth import GrooveTruth
from workbench.synthetic.prism_scan import simulate_prism
from workbench.synthetic.recipe import PrismRecipe, Recipe, SphereRecipe
from workbench.synthetic.recipe_file import parse_as, parse_recipe, parse_sphere_recipe, read_any_recipe, read_recipe
from workbench.synthetic.simulate import (
    simulate_file,
    simulate_recording,
    truth_path,
    write_made,
    write_simulation,
)
from workbench.synthetic.sphere import SphereTruth, simulate_sphere
from workbench.synthetic.workpiece import Truth, Workpiece, milled_truth, read_truth

__all__ = [
    "GrooveTruth",
    "PrismRecipe",
    "Recipe",
    "SphereRecipe",
    "SphereTruth",
    "Truth",
    "Workpiece",
    "milled_truth",
    "parse_as",
    "parse_recipe",
    "parse_sphere_recipe",
    "read_any_recipe",
    "read_recipe",
    "read_truth",
    "simulate_file",
    "simulate_prism",
    "simulate_recording",
    "simulate_sphere",
    "truth_path",
    "write_made",
    "write_simulation",
]

shown_all(*(globals()[_name] for _name in __all__))
del shown_all
