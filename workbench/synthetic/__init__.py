"""Synthetic parts and their scanner: profile recordings whose truth is known exactly (docs/simulation.md)."""

from __future__ import annotations

from workbench.artefacts.showing import shown_all
from workbench.synthetic.conditions import CONDITIONS, RAW_CONDITIONS, random_recipe
from workbench.synthetic.prism_scan import simulate_prism
from workbench.synthetic.recipe import PrismRecipe, Recipe, SphereRecipe
from workbench.synthetic.recipe_file import (
    parse_groove_recipe,
    parse_prism_recipe,
    parse_recipe,
    parse_sphere_recipe,
    parse_swept_recipe,
    read_any_recipe,
    read_recipe,
)
from workbench.synthetic.simulate import simulate_file, simulate_recording, truth_path, write_simulation
from workbench.synthetic.sphere import SphereTruth, simulate_sphere
from workbench.synthetic.sphere_conditions import random_sphere_recipe
from workbench.synthetic.swept import (
    GrooveRecipe,
    GrooveTruth,
    SweptRecipe,
    SweptTruth,
    simulate_groove,
    simulate_swept,
)
from workbench.synthetic.workpiece import Truth, Workpiece, milled_truth, read_truth

__all__ = [
    "CONDITIONS",
    "RAW_CONDITIONS",
    "GrooveRecipe",
    "GrooveTruth",
    "PrismRecipe",
    "Recipe",
    "SphereRecipe",
    "SphereTruth",
    "SweptRecipe",
    "SweptTruth",
    "Truth",
    "Workpiece",
    "milled_truth",
    "parse_groove_recipe",
    "parse_prism_recipe",
    "parse_recipe",
    "parse_sphere_recipe",
    "parse_swept_recipe",
    "random_recipe",
    "random_sphere_recipe",
    "read_any_recipe",
    "read_recipe",
    "read_truth",
    "simulate_file",
    "simulate_groove",
    "simulate_prism",
    "simulate_recording",
    "simulate_sphere",
    "simulate_swept",
    "truth_path",
    "write_simulation",
]

shown_all(*(globals()[_name] for _name in __all__))
del shown_all
