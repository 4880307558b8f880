"""A burr that rises out of a face hides its end: the edge is told where the burr begins, within its uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bench.drawn.seeds import generator
from bench.drawn.swept import random_swept_recipe
from bench.score.analytic import milled_part, raw_part
from bench.score.measure import Result, alone
from bench.simulators.swept import simulate_swept
from bench.simulators.swept.recipe import SweptRecipe
from tests.seldom import seldom

SEED = 18_200_000
LENGTH_MM = 0.4
MOST = 3.0  # times u, in the worst section


def measured(name: str, lean_deg: float, begins: float) -> Result:
    document: dict[str, Any] = random_swept_recipe(name, SEED).model_dump(mode="json")
    document["part"]["burrs"] = [
        {
            "direction": "in_plane",
            "from_mm": 0.0,
            "to_mm": document["part"]["spine"]["length_mm"],
            "height_mm": LENGTH_MM,
            "ragged": 0.1,
            "lean_deg": lean_deg,
            "begins": begins,
        }
    ]
    recording, truth = simulate_swept(SweptRecipe.model_validate(document))
    if document["part"]["kind"] == "raw":
        return alone(raw_part(recording, truth, name, generator("a burr", SEED)))
    return alone(milled_part(recording, truth))


@pytest.mark.parametrize(
    ("name", "size", "lean_deg", "begins"),  # begins: 0 growing, 1 even
    [
        ("swept_plain", "root_mm", 8.0, 1.0),
        ("swept_plain", "root_mm", 25.0, 0.0),
        ("swept_raw_plain", "along_m_mm", 8.0, 0.0),
        ("swept_raw_plain", "along_m_mm", 25.0, 1.0),
        *seldom(("swept_plain", "root_mm", 25.0, 1.0), ("swept_raw_plain", "along_m_mm", 25.0, 0.0)),
    ],
)
def test_a_burr_that_rises_out_of_a_face_does_not_move_its_edge(
    name: str, size: str, lean_deg: float, begins: float
) -> None:
    part = measured(name, lean_deg, begins)
    assert not part.refused
    error, u = part.found[size].error, part.found[size].u
    assert np.abs(error / u).max() < MOST
    assert np.median(u) < 0.7 * LENGTH_MM  # less than that nothing were known of the burr
