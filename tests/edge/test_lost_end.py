"""Where the end of the root face is lost, the lower edge and its direction are those of the rest, or in u."""

from __future__ import annotations

import numpy as np
import pytest

from bench.simulators.swept import SweptRecipe, simulate_swept
from tests.seldom import seldom
from workbench import cloud, edge, scan

STRAIGHT, ARC = {"shape": "straight"}, {"shape": "arc", "radius_mm": 300}


@pytest.mark.parametrize(("spine", "columns"), [(ARC, 8), *seldom((STRAIGHT, 25), (STRAIGHT, 8), (ARC, 25))])
def test_the_edge_does_not_turn_where_its_end_is_lost(spine: dict[str, object], columns: int) -> None:
    recipe = {
        "simulator": "swept",
        "seed": 3,
        "part": {"root_mm": 3.0, "spine": {**spine, "length_mm": 100}},
        "scanner": {"columns": 600, "pitch_mm": 0.05},
        "losses": {"edge_columns": columns, "edge_from_mm": -1, "edge_to_mm": 12},
        "passes": [{"way_mm": [2, 98], "elevation_deg": 45, "oblique_deg": 4}],
    }
    recording, truth = simulate_swept(SweptRecipe.model_validate(recipe))
    found = edge.segment(cloud.denoise(scan.fuse(recording)), root_nominal_mm=3.0)
    at = [int(np.argmin(np.linalg.norm(truth.position_mm - place, axis=1))) for place in found.position_mm]
    off = np.arccos(np.clip(np.abs((found.tangent * truth.tangent[at]).sum(axis=1)), 0.0, 1.0))
    assert np.degrees(off.max()) < 1.2  # 3 to 18 deg where it follows the lost end
    assert (np.abs(found.root.value - truth.root_mm[at]) < 3.0 * found.root.u).all()
    assert (np.abs(found.bevel.value - truth.bevel_deg[at]) < 3.0 * found.bevel.u).all()
