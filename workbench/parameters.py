"""Parameters of a stage: checked by pydantic, alike for a pipeline, the command line and a notebook."""

from __future__ import annotations

import json
import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_args

from workbench.errors import InputError, PipelineError, nearest
from workbench.units import DEG

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError
    from pydantic_core import ErrorDetails

M = TypeVar("M", bound="BaseModel")


def parameter_model(name: str, fields: Mapping[str, Any]) -> type[BaseModel]:
    """A model of `fields` (type and default by name): strict types, known keys, finite numbers, defaults checked."""
    from pydantic import ConfigDict, create_model

    config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, validate_default=True, frozen=True)
    return create_model(name, __config__=config, **fields)


def check_parameters(model: type[BaseModel], given: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Values of all fields, defaults included; PipelineError at `where` with the first thing that is wrong.

    Values go through JSON whoever gives them, so that all callers are checked alike.
    """
    from pydantic import ValidationError

    known = model.model_fields
    if other := other_kind(model, given):
        raise PipelineError(f"{where}.format", other)
    for key in given:
        if key not in known:
            raise PipelineError(f"{where}.{key}", f"no such parameter{nearest(key, known)}")
    try:
        checked = model.model_validate_json(json.dumps(dict(given), default=jsonable))
    except ValidationError as error:
        place, text = problems(error, given, model)[0]
        raise PipelineError(path_of(place, where), text) from None
    except (TypeError, ValueError, RecursionError) as error:
        raise PipelineError(where, f"a parameter is not a JSON value: {error}") from None
    return {name: getattr(checked, name) for name in known}


def parsed(model: type[M], document: Any, where: str) -> M:
    """What a file's JSON says as a model has it; InputError at `where` with the first thing that is wrong."""
    from pydantic import ValidationError

    try:
        return model.model_validate_json(json.dumps(document))
    except ValidationError as error:
        place, text = problems(error, document, model)[0]
        raise InputError(path_of(place, where), text) from None


def jsonable(value: Any) -> Any:
    """What JSON lacks but a notebook passes: paths, numpy scalars and arrays, frozen values."""
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form")


Place = tuple[str | int, ...]


def path_of(place: Place, root: str = "$") -> str:
    """A place in a JSON document: $.passes[0].from_mm."""
    return root + "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place)


def problems(error: ValidationError, given: Any, model: type[BaseModel] | None = None) -> list[tuple[Place, str]]:
    """All that pydantic found in a document: the place, and what was expected; to unknown keys the nearest of `model`.

    What pydantic adds to a place is left out: tags of unions. Of a file of another kind that alone is told.
    """
    if model is not None and (other := other_kind(model, given)):
        return [(("format",), other)]
    found = []
    for entry in error.errors(include_url=False):
        place: list[str | int] = []
        value = given
        for depth, key in enumerate(entry["loc"]):
            absent = entry["type"] == "missing" and depth == len(entry["loc"]) - 1
            try:
                value = value[key]
            except (KeyError, IndexError, TypeError):
                place += [key] if absent or not depth else []
                continue  # a tag of a union: what follows is in the same object
            place.append(key)
        found.append((tuple(place), _expected(entry, tuple(place), model)))
    return found


def other_kind(model: type[BaseModel], given: Any) -> str:
    """What to say of a document whose `format` is not the only one of the model; '' where it is, or none is stated."""
    kinds = get_args(model.model_fields["format"].annotation) if "format" in model.model_fields else ()
    said = given.get("format") if isinstance(given, Mapping) else None
    if len(kinds) != 1 or not isinstance(said, str) or said in kinds:
        return ""
    return f"expected '{kinds[0]}', this is a file of another kind: '{said}'"


def _expected(entry: ErrorDetails, place: Place, model: type[BaseModel] | None) -> str:
    if entry["type"] == "missing":
        return "is required, but missing"
    if entry["type"] == "extra_forbidden" and model is not None:
        return f"unknown key{nearest(str(place[-1]), _object_at(model, place[:-1]).model_fields)}"
    said = NAMES.get(entry.get("ctx", {}).get("pattern", ""), entry["msg"])
    text, value = said.removeprefix("Value error, ").replace("Input should be", "expected"), entry["input"]
    if isinstance(value, Mapping) and entry["type"] == "value_error":
        return text  # says itself which of its values it is
    if "tolerance" in path_of(place) and isinstance(value, int | float):
        most = entry["ctx"][BOUNDS[entry["type"]][0]] if entry["type"] in BOUNDS else 0.0
        text = f"expected the lower and the upper deviation, as [{-abs(value)}, {abs(value)}]"
        text = f"expected a deviation from the nominal size, in mm or deg, of at most {abs(most):g}" if most else text
    if entry["type"] in LENGTHS:
        text = f"expected {entry['ctx'][LENGTHS[entry['type']][0]]} values at {LENGTHS[entry['type']][1]}"
    shown = repr(value)
    return f"{text}, got {shown if len(shown) <= 60 else shown[:57] + '...'}{_slip(entry, place)}"


MISTAKEN: dict[str, dict[str, Callable[[float], float]]] = {  # by a name's unit: what else a number may be in
    "deg": {"radians": lambda value: value / DEG if abs(value) < math.tau else value},
    "c": {"kelvin": lambda value: value - 273.15},
    "mm": {"metres": lambda value: value * 1000.0, "inches": lambda value: value * 25.4},
}
NAME, INDEXED = r"^[A-Za-z][A-Za-z0-9_]{0,31}$", r"^[A-Za-z][A-Za-z0-9_]{0,31}(\[[0-9]{1,4}\])?$"  # of controllers
NAMES = {
    NAME: "expected a name of a letter (A to Z, a to z) and at most 31 letters, digits or _",
    INDEXED: "expected a name of a letter (A to Z, a to z) and at most 31 letters, digits or _; or one with an [index]",
}
LENGTHS = {"too_long": ("max_length", "most"), "too_short": ("min_length", "least")}
BOUNDS = {
    "greater_than": ("gt", operator.gt),
    "greater_than_equal": ("ge", operator.ge),
    "less_than": ("lt", operator.lt),
    "less_than_equal": ("le", operator.le),
}


def _slip(entry: ErrorDetails, place: Place) -> str:
    """The likeliest slip behind what was refused, as a question; '' where none is known."""
    value = entry["input"]
    if entry["type"] == "too_long" or re.fullmatch(r"[-+]?\d+,\d+", str(value)):
        return ": a decimal comma for a point?"
    if str(value)[:1] in ("[", "{") and isinstance(value, str):
        return ": is it JSON, as [0, 1.5], and quoted from the shell?"
    unit = path_of(place).rpartition("_")[2]
    if entry["type"] in BOUNDS and unit in MISTAKEN:
        bound, keeps = BOUNDS[entry["type"]]
        ways = MISTAKEN[unit].items()
        return next((f": in {name}?" for name, converted in ways if keeps(converted(value), entry["ctx"][bound])), "")
    return ""


def _object_at(model: type[BaseModel], place: Place) -> type[BaseModel]:
    """The model of the object at a place of a document."""
    for key in place:
        if key in model.model_fields:
            model = next(_models(model.model_fields[str(key)].annotation), model)
    return model


def _models(hint: Any) -> Iterator[type[BaseModel]]:
    """Models that an annotation names, the outermost first."""
    if hasattr(hint, "model_fields"):
        yield hint
    for one in get_args(hint):
        yield from _models(one)
