"""Which parts are scored: groups of recordings drawn by seed from simulators that share no code, kept as files.

A kept part is a recording (`NAME.h5`) and `NAME.json`: what every user declares, and the truth at stations along the
edge, so that any program can measure it and any other score it.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.harness import ROOT
from workbench.artefacts import Recording
from workbench.scan import write
from workbench.user_folder import UserFolder

SOURCES = tuple(ROOT / name for name in ("workbench/synthetic", "bench/score", "bench/drawn", "bench/simulators"))
JUDGES = ("__main__.py", "measure.py", "scorer.py", "table.py")  # draw nothing
OTHERS = tuple(ROOT / "bench" / name for name in ("outside.py", "odd_plates.py", "faulty.py", "recordings.py"))


class Drawn(NamedTuple):
    """A part of a simulator."""

    recording: Recording
    truth: Mapping[str, Any]  # position_mm (n, 3), seen (n,), and root_mm, bevel_deg or normal, across, tangent or ...
    declared: Mapping[str, Any]
    about: str


@dataclass(frozen=True)
class Part:
    """A kept part."""

    simulator: str
    seed: int
    recording: Path
    truth: Mapping[str, Any]
    declared: Mapping[str, Any]
    about: str


Draw = Callable[[int], Drawn]


@dataclass(frozen=True)
class Group:
    """Parts that are scored together: what they are, from which simulators, and what is declared of all of them."""

    what: str
    recordings: str  # a key of a simulator's `DRAWS`
    declared: Mapping[str, Any]


GROUPS = {
    "sharp": Group(
        "ordinary parts with sharp edges, seen at 35 to 55 deg, declared sharp", "sharp", {"edge_condition": "sharp"}
    ),
    "undeclared": Group("the same recordings, nothing declared", "sharp", {}),
    "worn": Group(
        "burrs, roundings of 0.01 to 0.3 mm, a sensor with 1 um rms of linearity error, robot errors as a process, "
        "seen at 20 to 50 deg",
        "worn",
        {},
    ),
    "below": Group("as worn, but for burrs, seen at -20 to 5 deg; the upper side is declared", "below", {}),
    "odd": Group("odd parts and faults of a shop, one kind per seed", "odd", {}),
    "raw": Group("raw edges: place along n and m, axis, heading; robot errors as a process", "raw", {}),
    "raw_undeclared": Group(
        "the same recordings, nothing said of the robot", "raw", {"robot_noise_mm": None, "robot_noise_length_mm": None}
    ),
    "groove": Group("grooves: gap and depth, declared sharp", "groove", {"edge_condition": "sharp"}),
    "groove_undeclared": Group("the same recordings, nothing declared", "groove", {}),
    "hand_eye": Group("calibration spheres: the profiler's pose on the flange", "sphere", {}),
}


def group(name: str) -> Group:
    """A group, or the parts under a named condition (`bench/score/named.py`) with nothing declared."""
    return GROUPS.get(name) or Group(name, name, {})


def simulators() -> Mapping[str, Mapping[str, Draw]]:
    """By name, what each can draw."""
    from bench.score import analytic, named, outsider, spheres, swept, triangulated

    return {
        "analytic": analytic.DRAWS | {"sphere": spheres.analytic},
        "swept": swept.DRAWS,
        "outside": outsider.DRAWS,
        "triangulated": triangulated.DRAWS,
        "named": named.DRAWS,
        "rays": {"sphere": spheres.rays},
        "sections": {"sphere": spheres.sections},
    }


def part(simulator: str, recordings: str, seed: int, keep: Path) -> Part:
    """Part `seed`, from the folder if it lies there."""
    path = keep / f"{recordings}-{simulator}-{seed}.json"
    recording = path.with_suffix(".h5")
    if not path.exists():
        drawn = simulators()[simulator][recordings](seed)
        keep.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(f".{os.getpid()}")
        told = {
            "declared": drawn.declared,
            "about": drawn.about,
            "truth": {k: plain(v) for k, v in drawn.truth.items()},
        }
        partial.write_text(json.dumps(told), encoding="utf-8")
        write(drawn.recording, recording, compression="lzf")
        partial.replace(path)
    told = json.loads(path.read_text(encoding="utf-8"))
    return Part(simulator, seed, recording, told["truth"], told["declared"], told["about"])


def plain(column: Any) -> Any:
    """Numbers as JSON has them: to a nanometre."""
    values = np.asarray(column)
    return values.tolist() if values.dtype == bool else np.round(values.astype(float), 9).tolist()


@cache
def digest() -> str:
    """Of all that draws parts: those of other sources are other parts."""
    files = [*(path for folder in SOURCES for path in sorted(folder.rglob("*.py"))), *OTHERS]
    drawing = (path.read_bytes() for path in files if path.name not in JUDGES)
    return hashlib.sha256(b"".join(drawing)).hexdigest()[:12]


def kept() -> Path:
    """Where drawn recordings are kept, by the digest of what draws them."""
    return (UserFolder().path or Path("out")) / "score" / digest()
