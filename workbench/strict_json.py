"""JSON files, read and written strictly: no key twice, no NaN, an object on top."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from workbench.errors import InputError
from workbench.storage import encoding_slip, regular_file

MAX_BYTES = 2**24


def read_json(path: Path, max_bytes: int = MAX_BYTES) -> dict[str, Any]:
    """The object in a JSON file of at most `max_bytes`; errors as `read_any_json`."""
    document = read_any_json(path, max_bytes)
    if not isinstance(document, dict):
        raise InputError(f"{path}: $", "expected an object")
    return document


def read_any_json(path: Path, max_bytes: int = MAX_BYTES) -> Any:
    """What a JSON file holds.

    Raises:
        InputError: it cannot be read, is too large, is not strict JSON: a key twice, NaN, a number beyond float64.
    """
    if regular_file(path).st_size > max_bytes:
        raise InputError(str(path), f"expected JSON of at most {max_bytes} bytes")

    def constant(name: str, what: str = "") -> NoReturn:
        line = text.count("\n", 0, text.find(name)) + 1
        raise InputError(f"{path}: line {line}", f"expected JSON numbers, found {what or name}")

    def finite(digits: str) -> float:
        value = float(digits)
        return value if math.isfinite(value) else constant(digits, f"{digits[:20]}..., beyond float64")

    def whole(digits: str) -> int:
        finite(digits)
        return int(digits)

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        made = dict(pairs)
        if len(made) < len(pairs):
            twice = next(key for key, _ in pairs if sum(key == other for other, _ in pairs) > 1)
            raise InputError(f"{path}: $.{twice}", "occurs twice")
        return made

    hooks: dict[str, Any] = {
        "parse_constant": constant,
        "parse_float": finite,
        "parse_int": whole,
        "object_pairs_hook": unique,
    }
    text = ""
    try:
        text = path.read_bytes().decode("utf-8-sig")
        return json.loads(text, **hooks)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}: line {error.lineno}, column {error.colno}", f"expected JSON: {json_slip(error)}"
        ) from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start}", f"expected JSON in UTF-8{encoding_slip(error)}") from None
    except RecursionError:
        raise InputError(str(path), "expected JSON nested less deeply") from None
    except (OSError, ValueError) as error:  # ValueError: an integer of thousands of digits
        raise InputError(str(path), f"expected JSON: {getattr(error, 'strerror', None) or error}") from None


def json_slip(error: json.JSONDecodeError) -> str:
    """What is wrong with a text, by the slips that people make; else in the words of the reader."""
    found = error.doc[error.pos : error.pos + 1]
    if not error.doc[: error.pos].strip() and "{" not in error.doc:
        return f"found {error.doc[:20]!r}: a file of another kind?" if error.doc.strip() else "is empty"
    if found in ("}", "]") and error.doc[: error.pos].rstrip().endswith(","):
        return "a comma too many"
    if found in ("/", "#"):
        return "JSON has no comments"
    if found and found in "'‘’“”„«»":
        return 'JSON has straight double quotes (") alone'
    return error.msg


def strict_json(document: Mapping[str, Any]) -> bytes:
    """A JSON object, one member per line, one entry a line in a list of objects; NaN becomes null."""
    members = (f"{json.dumps(key)}: {_lines(plain(value))}" for key, value in document.items())
    return ("{\n  " + ",\n  ".join(members) + "\n}\n").encode()


def content_digest(document: Mapping[str, Any]) -> str:
    """SHA-256 of what an object says, however it is laid out: a file that is read back has the same."""
    text = json.dumps(plain(document), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


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
