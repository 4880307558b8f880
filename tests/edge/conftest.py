"""Simulated scans of edges, as clouds, with the truth they were made from."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from bench.drawn.plates import random_recipe
from workbench.artefacts import Cloud, Edge
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.scan import fuse
from workbench.synthetic import Recipe, Truth, parse_recipe, simulate_recording


@dataclass(frozen=True)
class Scan:
    """A scanned part; what the stages make of it is made once, when it is asked for."""

    recipe: Recipe
    cloud: Cloud
    truth: Truth

    @functools.cached_property
    def edge(self) -> Edge:
        return segment(self.cloud)


def scan_of(recipe: Recipe) -> Scan:
    recording, truth = simulate_recording(recipe)
    # Poses without noise look held, and faces that drift under an oblique laser plane look turned.
    return Scan(recipe, denoise(fuse(recording)), truth)


@pytest.fixture(scope="session")
def drawn() -> Callable[[str, int], Scan]:
    """`drawn(condition, seed)`: a part drawn at random under a named condition, a frame every 0.4 mm."""

    @functools.cache
    def make(condition: str, seed: int) -> Scan:
        recipe = random_recipe(condition, seed)
        return scan_of(recipe.model_copy(update={"robot": recipe.robot.model_copy(update={"frame_pitch_mm": 0.4})}))

    return make


@pytest.fixture(scope="session")
def scanned() -> Callable[..., Scan]:
    """`scanned(part=..., scanner=..., ...)`: 50 mm of a straight edge of 1.5 mm and 40 deg, unless told otherwise."""

    @functools.cache
    def make(changes: str) -> Scan:
        document: dict[str, Any] = {"format": "bevel-recipe", "version": 1, "seed": 5, "scanner": {"columns": 500}}
        document |= {"part": {"length_mm": 60.0}, "passes": [{"from_mm": 5.0, "to_mm": 55.0}]}
        for key, value in json.loads(changes).items():
            document[key] = {**document.get(key, {}), **value} if isinstance(value, dict) else value
        return scan_of(parse_recipe(document))

    return lambda **changes: make(json.dumps(changes))
