"""Reading recipes: errors name the file, the place, what was expected and the nearest known key."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from workbench.errors import InputError, nearest
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
    try:
        return model.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place, expected = _path(first["loc"]), str(first["msg"])
        if first["type"] == "extra_forbidden":
            expected = "no such key" + nearest(str(first["loc"][-1]), _siblings(model, first["loc"]))
        raise InputError(f"{source}: {place}" if place else source, expected) from error


def _path(location: tuple[int | str, ...]) -> str:
    steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in location)
    return "".join(steps).removeprefix(".")


def _siblings(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Keys that the object at `location`'s parent may have."""
    schema: dict[str, Any] = model.model_json_schema()
    node = schema
    for step in location[:-1]:
        node = _resolved(node["items"] if isinstance(step, int) else node["properties"][step], schema)
    return list(node.get("properties", {}))


def _resolved(node: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    for option in (node, *node.get("anyOf", ())):
        if "$ref" in option:
            return dict(schema["$defs"][option["$ref"].rsplit("/", 1)[-1]])
    return node
