"""One part measured by a rival, beside its truth."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bench.open.rivals import Measure, rival
from bench.score.parts import Drawn, Part, part, plain
from bench.score.parts import group as group_of
from workbench.errors import WorkbenchError
from workbench.scan import write
from workbench.score import scorer


@dataclass
class Result:
    """What was found of one part, by quantity."""

    group: str
    simulator: str
    seed: int
    about: str
    refused: str = ""
    crashed: str = ""
    seconds: float = 0.0
    found: dict[str, scorer.Found] = field(default_factory=dict)
    passed_wrongly: int = 0  # sections beyond 4 u with the verdict `pass`
    passed: bool = False  # whether the part's verdict is `pass`, too: no condition holds it back


Task = tuple[str, str, int, Path, str]  # group, simulator, seed, folder, rival


def one(task: Task) -> Result:
    """A part of a group, fetched or drawn, and measured."""
    group, simulator, seed, keep, name = task
    chosen = group_of(group)
    return measure(part(simulator, chosen.recordings, seed, keep), rival(name).measure, group, chosen.declared)


def measure(part: Part, method: Measure, group: str, declared: Mapping[str, Any]) -> Result:
    """The part measured; declared: what is declared in its group beside what every user declares."""
    result, answer = Result(group, part.simulator, part.seed, part.about), {}
    start = time.process_time()
    try:
        answer = dict(method(part.recording, {**part.declared, **declared}))
    except WorkbenchError as error:
        result.refused = str(error)
    except Exception as error:  # the score goes on where a method crashes; it is told
        result.refused = result.crashed = repr(error)
    result.seconds = time.process_time() - start
    result.found = scorer.compare(part.truth, answer)
    result.passed = answer.get("verdict") == "pass"
    for section in answer.get("sections", ()):
        alone = scorer.compare(part.truth, {"sections": [section]}).values()
        wrong = any(np.any(np.abs(found.error) > 4.0 * found.u) for found in alone)
        result.passed_wrongly += wrong and section.get("verdict") == "pass"
    return result


def alone(drawn: Drawn, engine: str = "product") -> Result:
    """A part that nobody keeps, written to a file and measured."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "part.h5")
        write(drawn.recording, path)
        truth = {name: plain(column) for name, column in drawn.truth.items()}
        return measure(Part("alone", 0, path, truth, drawn.declared, drawn.about), rival(engine).measure, "alone", {})


def named(condition: str, seed: int) -> Result:
    """A part under a named condition, measured by the product with its defaults."""
    with tempfile.TemporaryDirectory() as folder:
        return one((condition, "named", seed, Path(folder), "product"))
