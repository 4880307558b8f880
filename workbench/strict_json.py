"""JSON files, read and written strictly: no key twice, no NaN, an object on top."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.storage import encoding_slip, regular_file

MAX_BYTES = 2**24
MAX_DEPTH = 32


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
    try:
        return parse_json(path.read_bytes(), str(path), "$")
    except OSError as error:
        raise InputError(str(path), f"expected JSON: {error.strerror}") from None
    except InputError as error:
        raise InputError(error.where, f"expected JSON: {error.expected}") from None


class _Refused(NamedTuple):
    """Stands in the parsed tree for what JSON does not allow, until its place is known."""

    why: str


def parse_json(content: bytes, name: str, root: str = "", *, shallow: bool = False) -> Any:
    """Strict JSON; messages call it `name`, and its top `root`. `shallow`: of at most MAX_DEPTH levels.

    Raises:
        InputError: no UTF-8, no JSON, a key twice, NaN, a number beyond float64, nested too deeply.
    """
    refused: list[_Refused] = []

    def refuse(why: str) -> _Refused:
        refused.append(_Refused(why))
        return refused[-1]

    def number(kind: type[float] | type[int], digits: str) -> Any:
        value = kind(digits)
        return value if math.isfinite(float(digits)) else refuse("expected a finite number")

    def unique(pairs: list[tuple[str, Any]]) -> Any:
        made = dict(pairs)
        if len(made) == len(pairs):
            return made
        twice = next(key for key, _ in pairs if sum(key == other for other, _ in pairs) > 1)
        return refuse(f"key '{twice}' occurs twice")

    hooks: dict[str, Any] = {"parse_float": partial(number, float), "parse_int": partial(number, int)}
    hooks |= {"parse_constant": lambda text: refuse(f"{text} is not JSON"), "object_pairs_hook": unique}
    deep = InputError(name, f"is nested deeper than {MAX_DEPTH} levels")
    try:
        tree = json.loads(content.decode("utf-8-sig"), **hooks)
    except json.JSONDecodeError as error:
        raise InputError(f"{name}: line {error.lineno}, column {error.colno}", json_slip(error)) from None
    except UnicodeDecodeError as error:
        line, slip = content.count(b"\n", 0, error.start) + 1, encoding_slip(error)
        raise InputError(f"{name}: line {line}", f"is not UTF-8 text (byte {error.start}){slip}") from None
    except RecursionError:
        raise deep from None
    except ValueError:  # an integer of thousands of digits
        raise InputError(name, "holds a number with too many digits") from None
    for place, value, depth in _walk(root, tree) if refused or shallow else ():
        if shallow and depth > MAX_DEPTH:
            raise deep
        if isinstance(value, _Refused):
            raise InputError(f"{name}: {place.lstrip('.')}" if place else name, value.why)
    return tree


def _walk(root: str, tree: Any) -> Iterator[tuple[str, Any, int]]:
    """Every value with its JSON path and depth, in the order of the file."""
    stack = [(root, tree, 0)]
    while stack:
        place, value, depth = stack.pop()
        yield place, value, depth
        if isinstance(value, dict):
            stack += [(f"{place}.{key}", part, depth + 1) for key, part in reversed(value.items())]
        elif isinstance(value, list):
            stack += [(f"{place}[{i}]", part, depth + 1) for i, part in reversed([*enumerate(value)])]


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
