"""Which parts are measured: every named condition of both simulators, and mixtures of them; recordings are kept."""

from __future__ import annotations

import hashlib
import pickle
import zlib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from bench.coverage.conditions import RAW_SWEPT_CONDITIONS, SWEPT_CONDITIONS, random_swept_recipe
from workbench.artefacts import Recording
from workbench.synthetic import (
    CONDITIONS,
    RAW_CONDITIONS,
    Recipe,
    conditions,
    parse_recipe,
    random_recipe,
    simulate_recording,
)
from workbench.synthetic.conditions import draw_disturbances, draw_part, draw_pass, draw_robot, draw_scanner
from workbench.synthetic.swept import simulate_swept

SOURCES = Path(__file__).resolve().parents[2] / "workbench" / "synthetic"
DRAWN = Path(__file__), Path(__file__).with_name("conditions.py"), Path(__file__).parents[1] / "recipes.py"
# not raw_robot: an error of the hand-eye moves the whole edge in the base, and no recording shows it
ANALYTIC = (*CONDITIONS, "mixed", *(name for name in RAW_CONDITIONS if name != "raw_robot"), "raw_mixed")
SWEPT = (*SWEPT_CONDITIONS, *RAW_SWEPT_CONDITIONS)
_SHAPES = (conditions.arc, conditions.wavy)
_FAULTS = (
    conditions.oblique,
    conditions.two_pass,
    conditions.reversed,
    conditions.outliers,
    conditions.missing,
    conditions.coarse,
    conditions.noisy,
    conditions.correlated,
    conditions.robot_error,
    conditions.clamps,
    conditions.vibration,
)
_RAW_FAULTS = (
    conditions.oblique,
    conditions.reversed,
    conditions.outliers,
    conditions.missing,
    conditions.noisy,
    conditions.clamps,
)


def is_raw(condition: str) -> bool:
    """Whether its parts are raw edges."""
    return condition.removeprefix("swept_").startswith("raw_")


def part(condition: str, seed: int, kept: Path | None) -> tuple[Recording, Any]:
    """The recording and the truth of part `seed`; from the folder `kept` if it was simulated before, by this source."""
    path = None if kept is None else kept / f"{_digest()}-{condition}-{seed}.pickle"
    if path is not None and path.exists():
        return pickle.loads(path.read_bytes())  # type: ignore[no-any-return]
    made = _simulated(condition, seed)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        partial.write_bytes(pickle.dumps(made, protocol=5))
        partial.replace(path)
    return made


def _simulated(condition: str, seed: int) -> tuple[Recording, Any]:
    if condition.startswith("swept_"):
        return simulate_swept(random_swept_recipe(condition, seed))
    if condition in ("mixed", "raw_mixed"):
        return simulate_recording(mixed_recipe(seed, raw_edge=condition == "raw_mixed"))
    return simulate_recording(random_recipe(condition, seed))


def mixed_recipe(seed: int, raw_edge: bool) -> Recipe:
    """Two to four conditions of the first simulator at once, a curved edge among them half of the time."""
    rng = np.random.default_rng([seed, zlib.crc32(b"raw_mixed" if raw_edge else b"mixed")])
    document: dict[str, Any] = {
        "seed": seed,
        "part": draw_part(rng),
        "scanner": draw_scanner(rng),
        "disturbances": draw_disturbances(rng),
        "robot": draw_robot(rng),
    }
    document["passes"] = [draw_pass(rng, document)]
    faults = _RAW_FAULTS if raw_edge else _FAULTS
    chosen = [faults[i] for i in rng.choice(len(faults), rng.integers(2, 5), replace=False)]
    if rng.random() < 0.5:
        chosen.append(_SHAPES[rng.integers(len(_SHAPES))])
    if raw_edge:
        first = [conditions.straight, conditions.rough, conditions.drift, conditions.burrs, conditions.two_raw_passes][
            rng.integers(5)
        ]
        first(rng, document)
    for condition in chosen:
        condition(rng, document)
    document["title"] = "mixed"
    return parse_recipe(document, source="mixed")


@cache
def _digest() -> str:
    files = [*sorted(SOURCES.rglob("*.py")), *DRAWN]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:12]
