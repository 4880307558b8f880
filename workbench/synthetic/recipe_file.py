"""Reading recipes: errors name the file, the place, what was expected and the nearest known key."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from workbench.errors import InputError, nearest
from workbench.synthetic.recipe import Recipe


def read_recipe(path: str | Path) -> Recipe:
    """The recipe in the JSON file `path`; InputError names the place and what was expected."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(str(path), f"a readable recipe file ({error.strerror or error})") from error
    except UnicodeDecodeError as error:
        raise InputError(str(path), "a recipe in JSON, encoded as UTF-8") from error
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: line {error.lineno}, column {error.colno}", f"JSON: {error.msg}") from error
    except RecursionError as error:
        raise InputError(str(path), "JSON nested less deeply") from error
    return parse_recipe(document, source=str(path))


def parse_recipe(document: Any, source: str = "recipe") -> Recipe:
    """The recipe that `document` (parsed JSON) describes; InputError as for `read_recipe`."""
    if not isinstance(document, Mapping):
        raise InputError(source, "a JSON object, the recipe")
    try:
        return Recipe.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place, expected = _path(first["loc"]), str(first["msg"])
        if first["type"] == "extra_forbidden":
            expected = "no such key" + nearest(str(first["loc"][-1]), _siblings(first["loc"]))
        raise InputError(f"{source}: {place}" if place else source, expected) from error


def _path(location: tuple[int | str, ...]) -> str:
    steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in location)
    return "".join(steps).removeprefix(".")


def _siblings(location: tuple[int | str, ...]) -> list[str]:
    """Keys that the object at `location`'s parent may have."""
    schema: dict[str, Any] = Recipe.model_json_schema()
    node = schema
    for step in location[:-1]:
        node = _resolved(node["items"] if isinstance(step, int) else node["properties"][step], schema)
    return list(node.get("properties", {}))


def _resolved(node: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    for option in (node, *node.get("anyOf", ())):
        if "$ref" in option:
            return dict(schema["$defs"][option["$ref"].rsplit("/", 1)[-1]])
    return node
