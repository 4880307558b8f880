"""YAML files that mean what the same JSON would: YAML 1.2's plain types, no key twice, no aliases, an object on top.

PyYAML follows YAML 1.1, where `on` is true, `1e5` a text and `1:30` ninety; here these are two texts and a number.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import yaml

from workbench.errors import InputError
from workbench.storage import regular_file
from workbench.strict_json import MAX_BYTES, read_json

SUFFIXES = (".yaml", ".yml")
PLAIN = {
    "null": (r"~|null|", "~n", ""),
    "bool": (r"true|false", "tf"),
    "int": (r"[-+]?[0-9]+", "-+0123456789"),
    "float": (r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?", "-+.0123456789"),
}


def read_document(path: Path) -> dict[str, Any]:
    """The object in a JSON file, or in a YAML file by its suffix (`.yaml`, `.yml`).

    Raises:
        InputError: it cannot be read, is too large or not strict; with line and column where they are known.
    """
    return read_yaml(path) if path.suffix.lower() in SUFFIXES else read_json(path)


def read_yaml(path: Path) -> dict[str, Any]:
    """The object in a YAML file; errors as `read_document`."""
    if regular_file(path).st_size > MAX_BYTES:
        raise InputError(str(path), f"expected YAML of at most {MAX_BYTES} bytes")
    try:
        document = yaml.load(path.read_bytes().decode("utf-8-sig"), StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{path}: line {mark.line + 1}, column {mark.column + 1}" if mark else str(path)
        raise InputError(where, f"expected YAML: {error.problem or error.context}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start}", "expected YAML in UTF-8") from None
    except yaml.reader.ReaderError as error:
        raise InputError(f"{path}: character {error.position}", f"expected YAML: {error.reason}") from None
    except RecursionError:
        raise InputError(str(path), "expected YAML nested less deeply") from None
    except OSError as error:
        raise InputError(str(path), f"expected YAML: {error.strerror}") from None
    if not isinstance(document, dict):
        raise InputError(f"{path}: $", "expected an object")
    return document


class StrictLoader(yaml.SafeLoader):  # type: ignore[misc]
    """PyYAML's safe loader with the types of YAML 1.2 and nothing that JSON lacks."""

    yaml_implicit_resolvers: dict[Any, Any] = {}  # noqa: RUF012 (PyYAML's own name)

    def compose_node(self, parent: Any, index: Any) -> Any:
        """A node; an alias could stand for the whole tree again, many times over."""
        if self.check_event(yaml.AliasEvent):
            raise _refusal("expected no aliases", self.peek_event().start_mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """A mapping whose keys are texts, none twice."""
        seen = set()
        for key, _ in node.value:
            if key.tag != "tag:yaml.org,2002:str":
                raise _refusal("expected a text as key", key.start_mark)
            if key.value in seen:
                raise _refusal(f"key '{key.value}' stands twice", key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)  # type: ignore[no-any-return]

    def number(self, node: Any) -> float:
        """A finite number, whole where it is written so."""
        try:
            value = int(node.value) if re.fullmatch(PLAIN["int"][0], node.value) else float(node.value)
            if math.isfinite(value):
                return value
        except (ValueError, OverflowError):
            pass
        raise _refusal("expected a finite number", node.start_mark)

    def other(self, node: Any) -> Any:
        """What carries another type's tag: dates, sets, Python's own."""
        raise _refusal(f"expected no tag such as '{node.tag}'", node.start_mark)


def _refusal(problem: str, mark: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


for _name, (_pattern, *_first) in PLAIN.items():
    StrictLoader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_name}", re.compile(f"^(?:{_pattern})$"), [c for text in _first for c in text or [""]]
    )
StrictLoader.yaml_constructors = {
    f"tag:yaml.org,2002:{_kind}": yaml.SafeLoader.yaml_constructors[f"tag:yaml.org,2002:{_kind}"]
    for _kind in ("null", "bool", "str", "seq", "map")
}
StrictLoader.add_constructor("tag:yaml.org,2002:int", StrictLoader.number)
StrictLoader.add_constructor("tag:yaml.org,2002:float", StrictLoader.number)
StrictLoader.add_constructor(None, StrictLoader.other)
