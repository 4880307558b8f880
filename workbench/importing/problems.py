"""All problems of a mapping file at once, each with its line."""

from __future__ import annotations

import copy
import difflib
import json
import re
from typing import Any, NamedTuple, TypeGuard, get_args

from pydantic import ValidationError

from workbench.errors import nearest
from workbench.importing.part import Part

Place = tuple[str | int, ...]
ROUNDS = 8  # of mending: a problem may hide another one
MOST = 8  # problems that are told
SHOWN = 40  # characters of a value
PASSING = {"float": 1.0, "int": 1, "list": ["x"] * 3, "tuple": ["x"] * 3, "model": {}, "too": ["x"] * 3}  # by error
BLANK = re.compile(r"[ \t\n\r]*")


class Problem(NamedTuple):
    """Something wrong in a mapping."""

    place: Place
    text: str


def problems_of(model: type[Part], tree: dict[str, Any]) -> list[Problem]:
    """Everything that is wrong with a tree: unknown keys, then values.

    pydantic checks an object as a whole only when all of its values are right. So wrong values are replaced by some
    that would pass, and the tree is checked again.
    """
    found = {one.place: one for one in _unknown(tree, model, ())}
    tree, guessed = copy.deepcopy(tree), set[Place]()
    for place in found:
        _parent(tree, place).pop(place[-1], None)
    for _ in range(ROUNDS):
        try:
            model.model_validate_json(json.dumps(tree))
            break
        except ValidationError as error:
            entries = error.errors(include_url=False)
        fresh = False
        for entry in entries:
            place, missing = _place(tree, entry["loc"], entry["type"] == "missing"), entry["type"] == "missing"
            known = place in found or (place in guessed and entry["type"] == "value_error")
            if not known:
                found[place] = Problem(place, _text(entry))
            fresh |= _mend(tree, place, entry, missing or known) or not known
            if entry["type"] == "literal_error" and entry["input"] == "x":  # mended blindly: says nothing of the rest
                guessed.add(place[:-1])
        if not fresh:
            break
    return list(found.values())


def told(problems: list[Problem], text: str) -> str:
    """The problems in one line, in the order of the file."""
    lines = sorted(((line_of(text, one.place), one) for one in problems), key=lambda each: each[0])
    shown = [f"line {line}: {_path(one.place)}: {one.text}" for line, one in lines[:MOST]]
    if len(lines) == 1:
        return shown[0]
    more = f"; and {len(lines) - MOST} more" if len(lines) > MOST else ""
    return f"{len(lines)} problems: " + "; ".join(f"({k}) {one}" for k, one in enumerate(shown, 1)) + more


def line_of(text: str, place: Place) -> int:
    """The line of a place in a JSON text that parses; of the object that should hold it, where it is not there."""
    at = BLANK.match(text).end()  # type: ignore[union-attr]  # matches anything
    for key in place:
        found = _member(text, at, key)
        if found is None:
            break
        at = found
    return text.count("\n", 0, at) + 1


def _member(text: str, at: int, key: str | int) -> int | None:
    """Where the value of a member, or an element, of the object or list at `at` begins."""
    closing = {"{": "}", "[": "]"}.get(text[at])
    if closing is None or (closing == "}") != isinstance(key, str):
        return None
    at, number = _after_blanks(text, at + 1), 0
    while text[at] != closing:
        name: str | int = number
        if closing == "}":
            name, at = json.JSONDecoder().raw_decode(text, at)
            at = _after_blanks(text, _after_blanks(text, at) + 1)
        if name == key:
            return at
        at = _after_blanks(text, json.JSONDecoder().raw_decode(text, at)[1])
        if text[at] == ",":
            at = _after_blanks(text, at + 1)
        number += 1
    return None


def _after_blanks(text: str, at: int) -> int:
    match = BLANK.match(text, at)
    assert match is not None
    return match.end()


def _unknown(tree: dict[str, Any], model: type[Part], place: Place) -> list[Problem]:
    """Keys that no object of the mapping has; the nearest known name is told."""
    found = []
    for key, value in tree.items():
        if key not in model.model_fields:
            found.append(Problem((*place, key), f"unknown key{nearest(key, model.model_fields)}"))
            continue
        parts = [hint for hint in get_args(model.model_fields[key].annotation) if is_part(hint)]
        if parts and isinstance(value, dict):
            found += _unknown(value, parts[0], (*place, key))
    return found


def is_part(hint: object) -> TypeGuard[type[Part]]:
    """Whether an annotation is an object of the mapping file."""
    return isinstance(hint, type) and issubclass(hint, Part)


def _place(tree: Any, location: Place, missing: bool) -> Place:
    """The part of pydantic's location that is a path: tags of unions are left out."""
    place: list[str | int] = []
    for depth, key in enumerate(location):
        last = depth == len(location) - 1
        try:
            tree = tree[key]
        except (KeyError, IndexError, TypeError):
            if last and missing:
                place.append(key)
            break
        place.append(key)
    return tuple(place)


def _text(entry: Any) -> str:
    if entry["type"] == "missing":
        return "is required, but missing"
    text = entry["msg"].removeprefix("Value error, ").replace("Input should be", "expected")
    if entry["type"] == "value_error":
        return str(text)
    shown = json.dumps(entry["input"], ensure_ascii=False, default=str)
    return f"{text}, got {shown if len(shown) <= SHOWN else shown[: SHOWN - 3] + '...'}"


def _mend(tree: Any, place: Place, entry: Any, required: bool) -> bool:
    """Put something at the place that would pass, or take away what need not be there; whether that changed it."""
    if not place or entry["type"] == "value_error":
        return False
    parent = _parent(tree, place)
    if not required and isinstance(parent, dict):
        parent.pop(place[-1])
        return True
    literals = re.findall(r"'([^']*)'", str(entry.get("ctx", {}).get("expected", "")))
    close = difflib.get_close_matches(str(entry["input"]), literals, n=1, cutoff=0.0)
    value: Any = close[0] if close else PASSING.get(entry["type"].split("_")[0], "x")
    if isinstance(parent, list) and place[-1] == len(parent):
        parent.append(value)
        return True
    before = parent.get(place[-1]) if isinstance(parent, dict) else parent[place[-1]]
    parent[place[-1]] = copy.copy(value)
    return bool(before != value)


def _parent(tree: Any, place: Place) -> Any:
    for key in place[:-1]:
        tree = tree[key]
    return tree


def _path(place: Place) -> str:
    return "$" + "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place)
