"""What a stage is: a typed function from artefacts to artefacts, under one name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])
REGISTRY: dict[str, Callable[..., Any]] = {}


def stage(name: str) -> Callable[[F], F]:
    """Register a function as the stage `name` ('family.verb')."""

    def register(function: F) -> F:
        REGISTRY[name] = function
        return function

    return register
