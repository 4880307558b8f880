"""Parts of the package's simulator."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from bench.confidently_wrong.kinds import KINDS
from bench.drawn.declared import apply
from bench.drawn.plates import CONDITIONS as PLATES
from bench.drawn.plates import draw_plate, random_recipe
from bench.drawn.seeds import generator, nominal
from bench.score.errors import about_robot, as_real
from bench.score.face import local_face, rough_upper_side
from bench.score.parts import Drawn
from workbench.synthetic import parse_recipe, simulate_recording
from workbench.synthetic.prism_scan import simulate_prism

ORDINARY = ("straight", "arc", "wavy", "oblique", "reversed", "two_pass")
CONDITIONS = (
    "clamps",
    "vibration",
    "robot_error",
    "partial_view",
    "outliers_5",
    "missing_20",
    "correlated",
    "coarse",
)
SPOILS = (
    "mean over 3 columns",
    "3 columns lost at every end",
    "median over 5 columns",
    "last range held over 2 columns",
    "z rounded to 0.02 mm",
    "mean over 3 frames",
    "8 blind columns at the end",
    "lost returns interpolated",
    "every 8th column returns",
    "clock 20 ms late",
)
RAW = ("straight", "arc", "wavy", "drift", "rough", "twist", "burrs", "below", "two_pass", "clamps")


def milled(rng: np.random.Generator, seed: int, elevation_deg: tuple[float, float], condition: str) -> tuple[Any, Any]:
    """Recording and truth of a straight part under a condition."""
    document = draw_plate(rng, seed, elevation_deg) | {"title": condition}
    apply(PLATES[condition], rng, document)
    return simulate_recording(parse_recipe(document, source=f"analytic {seed}"))


def milled_part(recording: Any, truth: Any, known: Mapping[str, Any] = MappingProxyType({}), about: str = "") -> Drawn:
    """A milled part, of which a user knows the nominal sizes and what is `known` besides."""
    stations = {name: getattr(truth, name) for name in ("position_mm", "seen", "root_mm", "bevel_deg")}
    declared = nominal(truth.root_mm.mean(), truth.bevel_deg.mean()) | known
    return Drawn(recording, stations, declared, about or truth.recipe.title)


def sharp(seed: int) -> Drawn:
    rng = generator("score analytic sharp", seed)
    return milled_part(*milled(rng, seed, (35.0, 55.0), ORDINARY[rng.integers(len(ORDINARY))]))


def odd(seed: int) -> Drawn:
    """Every kind in turn."""
    rng = generator("score analytic odd", seed)
    number = seed % (len(CONDITIONS) + len(SPOILS))
    condition = CONDITIONS[number] if number < len(CONDITIONS) else "straight"
    recording, truth = milled(rng, seed, (25.0, 60.0), condition)
    if number < len(CONDITIONS):
        return milled_part(recording, truth)
    about = SPOILS[number - len(CONDITIONS)]
    return milled_part(KINDS[about].spoil(recording, rng), truth, about=about)


def raw(seed: int) -> Drawn:
    rng = generator("score analytic raw", seed)
    name = f"raw_{RAW[seed % len(RAW)]}"
    return raw_part(*simulate_recording(random_recipe(name, seed)), name, rng)


def raw_part(recording: Any, truth: Any, about: str, rng: np.random.Generator | None = None) -> Drawn:
    """A raw edge, its upper side known to 10 deg; with `rng` its sensor and robot err as real ones do."""
    recording, known = (recording, {}) if rng is None else as_real(recording, rng, 0.01, 0.06)
    up = rough_upper_side(truth, rng)
    robot = truth.recipe.robot  # its slow errors are declared, since no scan shows them
    slow = math.hypot(getattr(robot, "drift_mm", 0.0) / 12**0.5, getattr(robot, "smooth_error_mm", 0.0) / 2**0.5)
    stations = local_face(truth) | {"seen": truth.seen}
    declared = {"kind": "raw", "upper_side": list(up), "robot_drift_u_mm": slow} | known
    return Drawn(recording, stations, declared, f"{about}, {about_robot(known)}" if known else about)


def groove(seed: int) -> Drawn:
    from bench.drawn.grooves import random_prism_recipe

    recipe = random_prism_recipe(("V", "Y", "HV", "HY")[seed % 4], seed)
    bare = recipe.groove.model_copy(update={"mounds": type(recipe.groove.mounds)()})
    return groove_part(*simulate_prism(recipe.model_copy(update={"groove": bare})))


def groove_part(recording: Any, truth: Any) -> Drawn:
    """A groove, at the stations' origins of a groove.json: midway between the upper edges."""
    upper = [truth.sizes.corners[f"{side}_upper"] for side in ("left", "right")]
    middle = 0.5 * (upper[0] + upper[1])
    place = truth.position_mm + middle[:, :1] * truth.normal + middle[:, 1:] * truth.across
    stations = {"position_mm": place, "seen": truth.seen}
    stations |= {"gap_mm": truth.sizes.gap_mm, "depth_mm": truth.sizes.depth_mm}
    return Drawn(recording, stations, {"kind": "groove"}, f"groove {truth.type}")


DRAWS = {"sharp": sharp, "odd": odd, "raw": raw, "groove": groove}
