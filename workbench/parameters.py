"""Parameters of a stage: checked by pydantic, alike for a pipeline, the command line and a notebook."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.errors import PipelineError, nearest

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError


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
    for key in given:
        if key not in known:
            raise PipelineError(f"{where}.{key}", f"{model.__name__} has no such parameter{nearest(key, known)}")
    try:
        checked = model.model_validate_json(json.dumps(dict(given), default=jsonable))
    except ValidationError as error:
        raise complaint(error, given, where) from None
    except (TypeError, ValueError, RecursionError) as error:
        raise PipelineError(where, f"a parameter is not a JSON value: {error}") from None
    return {name: getattr(checked, name) for name in known}


def jsonable(value: Any) -> Any:
    """What JSON lacks but a notebook passes: paths, numpy scalars and arrays, frozen values."""
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form")


def complaint(error: ValidationError, given: Mapping[str, Any], where: str) -> PipelineError:
    """The first thing that pydantic found, as place and expectation."""
    first = error.errors(include_url=False)[0]
    value: Any = given
    for depth, key in enumerate(first["loc"]):
        missing = first["type"] == "missing" and depth == len(first["loc"]) - 1
        try:
            value = value[key]
        except (KeyError, IndexError, TypeError):
            if depth and not missing:
                break  # the tag of a union
        where += f"[{key}]" if isinstance(key, int) else f".{key}"
    if first["type"] == "missing":
        return PipelineError(where, "is required, but missing")
    text = first["msg"].removeprefix("Value error, ").replace("Input should be", "expected")
    found = first.get("input", value)
    if isinstance(found, Mapping) and first["type"] == "value_error":
        return PipelineError(where, text)  # says itself which of its values it is
    if "tolerance" in where and isinstance(found, int | float):
        text = f"expected the lower and the upper deviation, as [{-abs(found)}, {abs(found)}]"
    shown = repr(found)
    return PipelineError(where, f"{text}, got {shown if len(shown) <= 60 else shown[:57] + '...'}")
