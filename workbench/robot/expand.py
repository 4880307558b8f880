"""A URDF out of xacro: run as a process of its own by `urdf`, since xacro evaluates expressions of the file as Python.

`python -P expand.py FILE OUT.urdf`; on standard input JSON: `packages` (name to folder), `arguments` (name to text).

xacro hides the built-in functions from expressions, which known ways get around. So no expression may reach what they
rest on; a hook, which nothing takes out again, refuses whatever is not reading the packages' files; time, memory and
output end early; the environment is empty.
"""

from __future__ import annotations

import errno
import json
import os
import re
import sys
import unicodedata
from collections.abc import Callable
from types import ModuleType
from typing import Any

from workbench.children import confine, library
from workbench.errors import nearest

REFUSED, ODD = 2, re.compile(r"__|\bgi_")  # ways from a value to the interpreter
INNER = ("vars", "type")  # functions that hand the interpreter's own objects out
HARMLESS = {"builtins.id", "compile", "exec", "glob.glob", "glob.glob/2", "os.listdir", "os.scandir"}
SECONDS, MEMORY, OUTPUT = 10, 2**30, 2**24
PYTHON = "<expression>", "<string>"  # what xacro calls the sources of expressions


def main() -> int:
    """Expand FILE into OUT; status 2 with one line on standard output where that cannot be."""
    file, out = sys.argv[1:]
    xacro, given = library("xacro"), json.load(sys.stdin)
    library("xacro.substitution_args")  # imports yaml
    xacro.xml.dom.minidom.parseString("<a/>")  # imports its parser
    for name in INNER:
        del xacro._global_symbols["python"][name]
    _packages(given["packages"], file)
    arguments = _Arguments(given["arguments"])
    with open(out, "w", encoding="utf-8") as result:
        confine(0, SECONDS, OUTPUT, MEMORY)
        os.environ.clear()
        sys.addaudithook(_hook([os.path.dirname(file), *given["packages"].values()]))
        try:
            result.write(xacro.process_file(file, mappings=arguments).documentElement.toxml())
            for name in sorted(set(given["arguments"]) - arguments.asked):
                raise ValueError(f"the file has no argument '{name}'{nearest(name, sorted(arguments.asked))}")
        except Exception as error:
            inside = xacro.filestack[-1] if xacro.filestack else file
            print(*_cause(error).split(), "" if inside == file else f"(in {inside})")
            return REFUSED
    return 0


def _cause(error: Any) -> str:
    """What xacro's errors are about: they repeat the error within them, which knows the expression that it is of."""
    suffix = ""
    while inner := getattr(error, "exc", None):
        error, suffix = inner, error.suffix or suffix
    name = f": {error.filename}" if isinstance(error, OSError) and error.filename else ""
    said = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return f"{said}{name} {suffix}"


class _Arguments(dict[str, str]):
    """Arguments, and which of them the file asked for."""

    def __init__(self, given: dict[str, str]) -> None:
        super().__init__(given)
        self.asked: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return super().__contains__(name)


def _packages(folders: dict[str, str], file: str) -> None:
    """Where `$(find NAME)` finds packages: it asks ROS for them, which is not there."""

    def found(name: str) -> str:
        if name not in folders:
            raise ValueError(
                f"the package '{name}' is nowhere around {file}: expected its folder in the cell's "
                f"$.robot.packages{nearest(name, folders)}"
            )
        return folders[name]

    for name in ("ament_index_python", "ament_index_python.packages"):
        sys.modules[name] = ModuleType(name)
    sys.modules["ament_index_python.packages"].get_package_share_directory = found  # type: ignore[attr-defined]


def _hook(folders: list[str]) -> Callable[[str, tuple[Any, ...]], None]:
    """What looks at every event of this process from here on, and raises where it is none of expanding a file."""
    inside = tuple(os.path.join(os.path.abspath(folder), "") for folder in folders)

    def hook(event: str, what: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = what
            writes = flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC)
            if not writes and isinstance(path, str) and os.path.abspath(path).startswith(inside):
                return
            raise PermissionError(errno.EACCES, "it may read no file outside its packages", str(path))
        if event not in HARMLESS:
            raise PermissionError(f"it may only be expanded, and asks for {event}")
        if event == "compile" and what[1] in PYTHON:
            source = what[0].decode() if isinstance(what[0], bytes) else str(what[0])
            if odd := ODD.search(unicodedata.normalize("NFKC", source)):
                raise PermissionError(f"an expression may not hold {odd[0]}: {source.strip()}")

    return hook


if __name__ == "__main__":
    sys.exit(main())
