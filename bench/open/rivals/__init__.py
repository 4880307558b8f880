"""Rivals: a file each, all behind one interface.

A rival has TITLE, TRACKS and

    measure(recording: Path, declared: Mapping) -> Mapping

where `declared` is what every participant is told of the recording (`declared.json`: `kind`, `root_nominal_mm`,
`bevel_nominal_deg`, `upper_side`, `edge_condition`, `robot_noise_mm`, ...) and the answer is the recording's entry in a
submission (`workbench schema submission`): `sections`, or `flange_from_profiler` with its u. Refused: any exception.
A rival of which only results are kept (`frozen`) reads them instead.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

Measure = Callable[[Path, Mapping[str, Any]], Mapping[str, Any]]
NAMES = ("product", "gaussian_process", "robust_lines", "per_profile", "open3d_planes")
FROZEN = Path(__file__).with_name("frozen")


class Rival(NamedTuple):
    """A method: what it is, which tracks it takes part in, what it answers."""

    name: str
    title: str
    tracks: tuple[str, ...]
    measure: Measure


def rival(name: str) -> Rival:
    """The method in the file of this name, imported when it is asked for."""
    module = importlib.import_module(f"bench.open.rivals.{name}")
    return Rival(name, module.TITLE, module.TRACKS, module.measure)
