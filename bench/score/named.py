"""Parts under every named condition of two simulators, and mixtures of them, with nothing declared."""

from __future__ import annotations

from functools import partial
from typing import Any

from bench.drawn import plates
from bench.drawn.plates import CONDITIONS, RAW_CONDITIONS, random_recipe
from bench.drawn.seeds import generator
from bench.drawn.swept import RAW_SWEPT_CONDITIONS, SWEPT_CONDITIONS, random_swept_recipe
from bench.score.analytic import milled_part, raw_part
from bench.score.parts import Drawn
from bench.simulators.swept import simulate_swept
from workbench.artefacts import Recording
from workbench.synthetic import Recipe, parse_recipe, simulate_recording

# not raw_robot: an error of the hand-eye moves the whole edge in the base, and no recording shows it
ANALYTIC = (*CONDITIONS, "mixed", *(name for name in RAW_CONDITIONS if name != "raw_robot"), "raw_mixed")
SWEPT = (*SWEPT_CONDITIONS, *RAW_SWEPT_CONDITIONS)
_SHAPES = (plates.arc, plates.wavy)
_FAULTS = (
    plates.oblique,
    plates.two_pass,
    plates.reversed,
    plates.outliers,
    plates.missing,
    plates.coarse,
    plates.noisy,
    plates.correlated,
    plates.robot_error,
    plates.clamps,
    plates.vibration,
)
_RAW_FAULTS = (
    plates.oblique,
    plates.reversed,
    plates.outliers,
    plates.missing,
    plates.noisy,
    plates.clamps,
)


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
    if condition in ("mixed", "raw_mixed"):
        return simulate_recording(mixed_recipe(seed, raw_edge=condition == "raw_mixed"))
    return simulate_recording(random_recipe(condition, seed))


def mixed_recipe(seed: int, raw_edge: bool) -> Recipe:
    """Two to four conditions of the package's simulator at once, a curved edge among them half of the time."""
    rng = generator(seed, "raw_mixed" if raw_edge else "mixed")
    document = plates.draw_plate(rng, seed)
    faults = _RAW_FAULTS if raw_edge else _FAULTS
    chosen = [faults[i] for i in rng.choice(len(faults), rng.integers(2, 5), replace=False)]
    if rng.random() < 0.5:
        chosen.append(_SHAPES[rng.integers(len(_SHAPES))])
    if raw_edge:
        first = [plates.as_is, plates.rough, plates.drift, plates.burrs, plates.two_raw_passes][rng.integers(5)]
        plates.raw(first)(rng, document)
    for condition in chosen:
        condition(rng, document)
    document["title"] = "mixed"
    return parse_recipe(document, source="mixed")


DRAWS = {condition: partial(drawn, condition) for condition in (*ANALYTIC, *SWEPT)}
