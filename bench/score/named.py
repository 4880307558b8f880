"""Parts under every named condition of two simulators, with nothing declared."""

from __future__ import annotations

from functools import partial
from typing import Any

from bench.drawn.plates import CONDITIONS, RAW_CONDITIONS, random_recipe
from bench.drawn.swept import RAW_SWEPT_CONDITIONS, SWEPT_CONDITIONS, random_swept_recipe
from bench.score.analytic import milled_part, raw_part
from bench.score.parts import Drawn
from bench.simulators.swept import simulate_swept
from workbench.artefacts import Recording
from workbench.synthetic import simulate_recording

ANALYTIC = (*CONDITIONS, *RAW_CONDITIONS)
SWEPT = (*SWEPT_CONDITIONS, *RAW_SWEPT_CONDITIONS)


def is_raw(condition: str) -> bool:
    """Whether its parts are raw edges."""
    return condition.removeprefix("swept_").startswith("raw_")


def drawn(condition: str, seed: int) -> Drawn:
    """Part `seed`; of a raw one the upper side is known to 10 deg, and the robot's slow error is declared."""
    recording, truth = simulated(condition, seed)
    return raw_part(recording, truth, truth.recipe.title) if is_raw(condition) else milled_part(recording, truth)


def simulated(condition: str, seed: int) -> tuple[Recording, Any]:
    """The recording and its truth."""
    if condition.startswith("swept_"):
        return simulate_swept(random_swept_recipe(condition, seed))
    return simulate_recording(random_recipe(condition, seed))


DRAWS = {condition: partial(drawn, condition) for condition in (*ANALYTIC, *SWEPT)}
