"""Axes of arrays, as annotations say them (`Shaped[Float, "n 3"]`), are checked while the tests run.

`install()` makes `workbench.units.Shaped` jaxtyping's before any other module of the package is imported, and lets
every dataclass and named tuple of the package be checked when it is made, every function when it is called: an axis
that is another one fails the first test that meets it. Users pay nothing: outside the tests a shape is an annotation.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib.abc
import importlib.machinery
import inspect
import sys
from collections.abc import Sequence
from types import FunctionType, ModuleType
from typing import Any

import jaxtyping
import numpy as np
from beartype.door import is_bearable

PACKAGE, KEYWORD_ONLY = "workbench", inspect.Parameter.KEYWORD_ONLY
RIGHT: set[Any] = set()  # shapes of arrays that were found right: most calls are of shapes that came before


def install() -> None:
    """Check the shapes of all that the package makes from now on."""
    from workbench import units

    units.Shaped = jaxtyping.Shaped
    sys.meta_path.insert(0, _Finder())


def unchecked(function: Any) -> Any:
    """The function without its check: for tests of what it refuses itself."""
    return getattr(function, "__wrapped__", function)


def check_module(module: ModuleType) -> None:
    """Check the dataclasses, named tuples and functions that a module defines."""
    for name, value in list(vars(module).items()):
        if getattr(value, "__module__", None) != module.__name__ or not _said(value):
            continue
        if isinstance(value, FunctionType):
            setattr(module, name, _checked_call(value))
        elif isinstance(value, type) and dataclasses.is_dataclass(value):
            _check(value, "__init__")
        elif isinstance(value, type) and issubclass(value, tuple):
            _check(value, "__new__")


def _checked_call(function: FunctionType) -> Any:
    taken, names = inspect.signature(function).parameters, [*_said(function)]
    place = {name: k for k, name in enumerate(taken) if name in names and taken[name].kind is not KEYWORD_ONLY}

    @functools.wraps(function)
    def checked(*given: Any, **named: Any) -> Any:
        values = {name: given[k] for name, k in place.items() if k < len(given)}
        _check_values(function, values | {name: named[name] for name in names if name in named})
        return function(*given, **named)

    return checked


def _said(what: Any) -> dict[str, str]:
    """The annotations of a function or of a class's own fields that name axes; named tuples keep references."""
    own = what.__dict__ if isinstance(what, type) else {"__annotations__": getattr(what, "__annotations__", {})}
    said = {name: getattr(one, "__forward_arg__", one) for name, one in own.get("__annotations__", {}).items()}
    return {name: text for name, text in said.items() if "Shaped[" in str(text)}


def _check(kind: Any, maker: str) -> None:
    made, names = getattr(kind, maker), [*_said(kind)]

    @functools.wraps(made)
    def checked(*given: Any, **named: Any) -> Any:
        out = made(*given, **named)
        self = given[0] if maker == "__init__" else out
        if type(self) is kind:
            _check_values(kind, {name: getattr(self, name) for name in names})
        return out

    setattr(kind, maker, checked)


@functools.cache
def _shapes(what: Any) -> dict[str, Any]:
    space = dict(vars(sys.modules[what.__module__]))
    return {name: eval(text, space) for name, text in _said(what).items()}


def _check_values(what: Any, values: dict[str, Any]) -> None:
    key = (what, *((name, getattr(one, "shape", None), getattr(one, "dtype", None)) for name, one in values.items()))
    plain = all(one is None or type(one) is np.ndarray for one in values.values())
    if plain and key in RIGHT:
        return
    with jaxtyping.jaxtyped("context"):
        for name, value in values.items():
            if not is_bearable(value, _shapes(what)[name]):
                found = getattr(value, "shape", type(value).__name__)
                raise AssertionError(f"{what.__qualname__}, {name}: expected {_said(what)[name]}, found {found}")
    if plain:
        RIGHT.add(key)


class _Finder(importlib.abc.MetaPathFinder):
    """Finds the package's modules as they are found otherwise, and checks them once they are imported."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if not name.startswith(PACKAGE + "."):
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is not None and isinstance(spec.loader, importlib.machinery.SourceFileLoader):
            spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


class _Loader(importlib.machinery.SourceFileLoader):
    def exec_module(self, module: ModuleType) -> None:
        super().exec_module(module)
        check_module(module)
