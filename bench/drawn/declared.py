"""Conditions as declarations: what a drawn recipe has in the place of its usual values.

A declaration is a part of a recipe's document in which a function of the random numbers stands for what is drawn, in
the order in which it stands there: it belongs to the seed. What depends on the rest of the document is a function of
both; a tuple is several conditions, one after the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

Document: TypeAlias = dict[str, Any]
Generator: TypeAlias = np.random.Generator
Draw: TypeAlias = Callable[[Generator], Any]
Change: TypeAlias = Callable[[Generator, Document], None]
Condition: TypeAlias = Document | Change | tuple["Condition", ...]


def uniform(low: float, high: float) -> Draw:
    return lambda rng: rng.uniform(low, high)


def log_uniform(low: float, high: float) -> Draw:
    """Evenly in the logarithm."""
    return lambda rng: math.exp(rng.uniform(math.log(low), math.log(high)))


def either(*values: Any) -> Draw:
    return lambda rng: rng.choice(values).item()


def sign(rng: Generator) -> float:
    return float(rng.choice([-1, 1]))


def sometimes(share: float, condition: Condition) -> Change:
    """The condition, on such a share of the parts."""

    def change(rng: Generator, document: Document) -> None:
        if rng.random() < share:
            apply(condition, rng, document)

    return change


def apply(condition: Condition, rng: Generator, document: Document) -> None:
    """Bring the document under the condition, in place."""
    if isinstance(condition, dict):
        _merge(document, _made(rng, condition))
    elif isinstance(condition, tuple):
        for one in condition:
            apply(one, rng, document)
    else:
        condition(rng, document)


def _made(rng: Generator, declared: Any) -> Any:
    if isinstance(declared, dict):
        return {key: _made(rng, value) for key, value in declared.items()}
    return declared(rng) if callable(declared) else declared


def _merge(document: Document, change: Document) -> None:
    for key, value in change.items():
        if isinstance(value, dict) and key in document:
            _merge(document[key], value)
        else:
            document[key] = value
