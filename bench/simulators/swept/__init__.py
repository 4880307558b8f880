"""A second, independent simulator: a section swept along a space curve, a mesh met by rays (docs/simulation.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bench.simulators.swept.recipe import GrooveRecipe, SweptRecipe
from bench.simulators.swept.simulate import simulate_groove, simulate_swept
from bench.simulators.swept.truth import SweptTruth
from workbench.errors import InputError
from workbench.strict_json import read_any_json
from workbench.synthetic import parse_as, write_made

__all__ = [
    "GrooveRecipe",
    "SweptRecipe",
    "SweptTruth",
    "parse_swept_recipe",
    "simulate_groove",
    "simulate_swept",
    "simulate_swept_file",
]


def parse_swept_recipe(document: Any, source: str = "recipe") -> Any:
    """The recipe that `document` describes, of a groove if its part is of that kind.

    Raises:
        InputError: as of `workbench.synthetic.read_recipe`.
    """
    if not isinstance(document, dict):
        raise InputError(source, "a JSON object, the recipe")
    part = document.get("part")
    groove = isinstance(part, dict) and part.get("kind") == "groove"
    return parse_as(GrooveRecipe if groove else SweptRecipe, document, source)


def simulate_swept_file(recipe_path: Path, out_path: Path) -> None:
    """Write the recording of a recipe, and its truth to `<out_path>.truth.json`, as `workbench simulate` does."""
    recipe = parse_swept_recipe(read_any_json(recipe_path), str(recipe_path))
    made: Any = simulate_groove(recipe) if isinstance(recipe, GrooveRecipe) else simulate_swept(recipe)
    write_made(*made, out_path)
