"""Random parts under named conditions, for statistics over many of them: nothing is chosen to be easy to measure."""

from __future__ import annotations

import zlib

import numpy as np

from workbench.errors import InputError, nearest
from workbench.synthetic.draws import Document, draw_disturbances, draw_part, draw_pass, draw_robot, draw_scanner
from workbench.synthetic.milled_conditions import CONDITIONS
from workbench.synthetic.raw_conditions import RAW_CONDITIONS
from workbench.synthetic.recipe import Recipe
from workbench.synthetic.recipe_file import parse_recipe

__all__ = ["CONDITIONS", "RAW_CONDITIONS", "random_recipe"]


def random_recipe(condition: str, seed: int) -> Recipe:
    """A recipe drawn at random under `condition`; the same seed gives the same recipe.

    Unless the condition (a key of CONDITIONS) says otherwise: a straight milled edge of 80 to 160 mm anywhere in the
    base, root 0.8 to 3 mm, bevel 30 to 50 deg, both drifting, thickness 5 to 12 mm, noise 0.012 mm, pitch 0.05 mm,
    0.5 % outliers. Keys of RAW_CONDITIONS draw raw edges in the same way.
    """
    known = CONDITIONS | RAW_CONDITIONS
    if condition not in known:
        raise InputError(f"condition '{condition}'", "a named condition" + nearest(condition, known))
    rng = np.random.default_rng([seed, zlib.crc32(condition.encode())])
    document: Document = {
        "title": condition,
        "seed": seed,
        "part": draw_part(rng),
        "scanner": draw_scanner(rng),
        "disturbances": draw_disturbances(rng),
        "robot": draw_robot(rng),
    }
    document["passes"] = [draw_pass(rng, document)]
    known[condition](rng, document)
    return parse_recipe(document, source=condition)
