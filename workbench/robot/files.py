"""Small JSON files, read strictly: no duplicate keys, no NaN, an object on top."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NoReturn

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
