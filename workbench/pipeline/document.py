"""The pipeline document: strict JSON in, inputs put in place of `${name}`, a checked `Document` out."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench import strict_json
from workbench.errors import ArgumentError, InputError, PipelineError, nearest

VERSION = 1
KEYS = ("version", "title", "seed", "inputs", "stages")
MAX_BYTES = 4_000_000  # a pipeline is written by people; this also ends the reading of /dev/zero
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")  # of an input
ID = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")  # of a stage in the pipeline


@dataclass(frozen=True)
class PipelineDocument:
    """A pipeline as written: nothing substituted, no stage looked up yet."""

    name: str  # its file, for messages
    base_dir: Path  # where its relative paths start
    title: str
    seed: int
    inputs: Mapping[str, Any]
    stages: tuple[Mapping[str, Any], ...]


def read_document(path: Path) -> PipelineDocument:
    """Read a pipeline file. Raises PipelineError with line and column, or the JSON path, of what is wrong."""
    try:
        with open(path, "rb") as file:
            content = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise ArgumentError(str(path), "cannot be read: No such file or directory") from None
    except (OSError, ValueError) as error:
        raise PipelineError(str(path), f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(content) > MAX_BYTES:
        raise PipelineError(str(path), f"is larger than {MAX_BYTES / 1e6:g} MB: expected a pipeline in JSON")
    try:
        tree = parse_json(content, str(path))
    except PipelineError as error:
        if path.suffix.lower() == ".json":
            raise
        message = (
            f"expected a pipeline in JSON: {error.expected}; a recording is the input of one, as in "
            f"`workbench run inspect_bevel --input recording={path}`; other files: `workbench import --draft`"
        )
        raise PipelineError(error.where, message) from None
    return check_document(tree, str(path), path.parent)


def parse_json(content: bytes, name: str) -> Any:
    """As `strict_json.parse_json` of a few levels. Raises PipelineError."""
    try:
        return strict_json.parse_json(content, name, shallow=True)
    except InputError as error:
        raise PipelineError(error.where, error.expected) from None


def check_document(tree: Any, name: str, base_dir: Path) -> PipelineDocument:
    """Check the document's own form; the stages are looked up by `workbench.pipeline.wiring`."""
    if not isinstance(tree, dict):
        raise PipelineError(name, f'expected {{"version": 1, "stages": [...]}}, got {kind(tree)}')
    if isinstance(tree.get("format"), str):
        raise PipelineError(
            f"{name}: format", f"expected a pipeline, this is a file of another kind: '{tree['format']}'"
        )
    for key in tree:
        if key not in KEYS:
            raise PipelineError(f"{name}: {key}", f"unknown key{nearest(key, KEYS)}")
    version = _member(tree, name, "version", int, None)
    if version != VERSION:
        raise PipelineError(f"{name}: version", f"expected {VERSION}, got {version}")
    inputs = _member(tree, name, "inputs", dict, {})
    for key in inputs:
        if not NAME.fullmatch(key):
            raise PipelineError(f"{name}: inputs", f"expected names of letters, digits and _, got {key!r}")
    stages = _member(tree, name, "stages", list, None)
    if not stages:
        raise PipelineError(f"{name}: stages", "expected at least one stage")
    for i, entry in enumerate(stages):
        _check_stage(entry, f"{name}: stages[{i}]")
    seed = _member(tree, name, "seed", int, 0)
    if not 0 <= seed < 2**63:
        raise PipelineError(f"{name}: seed", f"expected an integer from 0 to 2^63 - 1, got {seed}")
    title = _member(tree, name, "title", str, Path(name).stem)
    return PipelineDocument(name, base_dir, title, seed, inputs, tuple(stages))


def _check_stage(entry: Any, where: str) -> None:
    if not isinstance(entry, dict):
        raise PipelineError(where, f"expected an object, got {kind(entry)}")
    _member(entry, where, "stage", str, None, ".")
    if not ID.fullmatch(_member(entry, where, "id", str, "x", ".")):
        raise PipelineError(f"{where}.id", f"expected letters, digits, '_', '-' and '.', got {entry['id']!r}")
    _member(entry, where, "write", bool, True, ".")
    for source, given in _member(entry, where, "from", dict, {}, ".").items():
        if not all(isinstance(part, str) for part in (given if isinstance(given, list) else [given])):
            raise PipelineError(f"{where}.from.{source}", "expected the id of an earlier stage, or a list of ids")


def _member(tree: Mapping[str, Any], where: str, key: str, kind_: type, default: Any, link: str = ": ") -> Any:
    if key not in tree:
        if default is None:
            raise PipelineError(where, f"key '{key}' is missing{nearest(key, tree)}")
        return default
    if type(tree[key]) is not kind_:
        raise PipelineError(f"{where}{link}{key}", f"expected {KINDS[kind_]}, got {kind(tree[key])}")
    return tree[key]


KINDS = {
    dict: "an object",
    list: "an array",
    str: "a string",
    bool: "true or false",
    int: "an integer",
    float: "a number",
}


def kind(value: Any) -> str:
    """The JSON type of a value, in words."""
    return KINDS.get(type(value), "null" if value is None else type(value).__name__)


REFERENCE = re.compile(r"\$\{([^{}]*)\}")


class FromCaller(str):
    """A string from the command line or from Python: a path in it starts at the working directory.

    A string in the document starts at the document's directory instead; both may meet in one parameter.
    """


class Copied(FromCaller):
    """A file known by its URL, of which a copy lies on this machine: results name the URL, stages read the copy."""

    copy: Path

    @classmethod
    def of(cls, url: str, copy: Path) -> Copied:
        """The file `url`, to be read from `copy`."""
        made = cls(url)
        made.copy = copy
        return made


def from_caller(value: Any) -> Any:
    """`value` with every string in it marked as the caller's."""
    if isinstance(value, FromCaller):
        return value
    if isinstance(value, Path | str):
        return FromCaller(value)
    if isinstance(value, list | tuple):
        return [from_caller(part) for part in value]
    if isinstance(value, dict):
        return {key: from_caller(part) for key, part in value.items()}
    return value


def substitute(value: Any, inputs: Mapping[str, Any], where: str) -> Any:
    """Replace references in `value`: a string that is one reference takes the input's value and type, others its text.

    Raises PipelineError at `where` for an unknown input, a broken reference, or a value that has no place in a text.
    """
    if isinstance(value, list):
        return [substitute(part, inputs, f"{where}[{i}]") for i, part in enumerate(value)]
    if isinstance(value, dict):
        return {key: substitute(part, inputs, f"{where}.{key}") for key, part in value.items()}
    if not isinstance(value, str) or "${" not in value:
        return value
    for name in references(value):
        if name not in inputs:
            raise PipelineError(where, f"unknown input '{name}'{nearest(name, inputs)}")
    if REFERENCE.fullmatch(value):
        return inputs[value[2:-1]]
    if "${" in REFERENCE.sub("", value):
        raise PipelineError(where, f"expected references like ${{name}}, got {value!r}")
    text = REFERENCE.sub(lambda found: _as_text(inputs[found[1]], found[1], where), value)
    first = REFERENCE.match(value)
    marked = isinstance(inputs[first[1]] if first else value, FromCaller)
    return FromCaller(text) if marked else text


def references(value: Any) -> Iterator[str]:
    """Names of the inputs that a value refers to."""
    if isinstance(value, str):
        yield from REFERENCE.findall(value)
    elif isinstance(value, list | dict):
        for part in value.values() if isinstance(value, dict) else value:
            yield from references(part)


def _as_text(value: Any, name: str, where: str) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, int | float):
        return json.dumps(value)
    raise PipelineError(
        where, f"input '{name}' is {kind(value)}: only a string, number or boolean can be inserted into a text"
    )
