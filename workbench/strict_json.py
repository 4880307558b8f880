"""JSON files, read and written strictly: no key twice, no NaN, an object on top."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from workbench.errors import InputError

MAX_BYTES = 2**24


def read_json(path: Path) -> dict[str, Any]:
    """The object in a JSON file.

    Raises:
        InputError: it cannot be read, is too large, is not strict JSON or not an object.
    """

    def constant(name: str) -> NoReturn:
        raise InputError(str(path), f"expected JSON numbers, found {name}")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        made = dict(pairs)
        if len(made) < len(pairs):
            twice = next(key for key, _ in pairs if sum(key == other for other, _ in pairs) > 1)
            raise InputError(str(path), f"key '{twice}' stands twice")
        return made

    try:
        with open(path, "rb") as file:
            content = file.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise InputError(str(path), f"expected at most {MAX_BYTES} bytes")
        document = json.loads(content.decode("utf-8-sig"), parse_constant=constant, object_pairs_hook=unique)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: line {error.lineno}, column {error.colno}", error.msg) from None
    except (OSError, RecursionError, ValueError) as error:
        raise InputError(str(path), f"cannot be read as JSON: {getattr(error, 'strerror', None) or error}") from None
    if not isinstance(document, dict):
        raise InputError(str(path), "expected a JSON object")
    return document


def strict_json(document: Mapping[str, Any]) -> bytes:
    """A JSON object, one member a line, one entry a line in a list of objects; NaN becomes null."""
    members = (f"{json.dumps(key)}: {_lines(plain(value))}" for key, value in document.items())
    return ("{\n  " + ",\n  ".join(members) + "\n}\n").encode()


def _lines(value: Any) -> str:
    if isinstance(value, list) and value and all(isinstance(part, dict) for part in value):
        return "[\n    " + ",\n    ".join(json.dumps(part, allow_nan=False) for part in value) + "\n  ]"
    return json.dumps(value, allow_nan=False)


def plain(value: Any) -> Any:
    """`value` as JSON knows it: arrays as lists, what is not finite as null, anything else as text."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return value if value is None or isinstance(value, str | int) else str(value)
