"""Reading recipes: errors name the file, the place, what was expected and the nearest known key."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from workbench.errors import InputError
from workbench.parameters import parsed
from workbench.strict_json import read_any_json
from workbench.synthetic.recipe import PrismRecipe, Recipe, SphereRecipe

M = TypeVar("M", bound=BaseModel)


def read_recipe(path: str | Path) -> Recipe:
    """The recipe of a part in the JSON file `path`; InputError names the place and what was expected."""
    return parse_recipe(read_any_json(Path(path)), source=str(path))


def read_any_recipe(path: str | Path) -> Recipe | SphereRecipe | PrismRecipe:
    """The recipe in the JSON file `path`: by its `format` of a plate, a groove or a sphere."""
    document = read_any_json(Path(path))
    if isinstance(document, Mapping):
        if "simulator" in document:
            raise InputError(
                f"{path}: simulator",
                "no such key: recipes of the swept simulator are read in a checkout only, by "
                "`python -m bench.simulators.swept`; here: bevel-recipe, groove-recipe, sphere-recipe",
            )
        if document.get("format") == "sphere-recipe":
            return parse_sphere_recipe(document, source=str(path))
        if document.get("format") == "groove-recipe":
            return parse_as(PrismRecipe, document, str(path))
    return parse_recipe(document, source=str(path))


def parse_recipe(document: Any, source: str = "recipe") -> Recipe:
    """The recipe that `document` (parsed JSON) describes; InputError as for `read_recipe`."""
    return parse_as(Recipe, document, source)


def parse_sphere_recipe(document: Any, source: str = "recipe") -> SphereRecipe:
    """The recipe of a calibration recording that `document` describes; InputError as for `read_recipe`."""
    return parse_as(SphereRecipe, document, source)


def parse_as(model: type[M], document: Any, source: str = "recipe") -> M:
    """The recipe that `document` describes, of the kind `model`; InputError as for `read_recipe`."""
    if not isinstance(document, Mapping):
        raise InputError(source, "a JSON object, the recipe")
    return parsed(model, document, f"{source}: $")
