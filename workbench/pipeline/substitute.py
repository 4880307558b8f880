"""`${name}` in a pipeline: inputs put in place of references, and where a relative path among them starts."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from workbench.errors import PipelineError, nearest
from workbench.pipeline.document import kind

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
        where, f"input '{name}' is {kind(value)}: inside a text only a string, number or boolean can stand"
    )
