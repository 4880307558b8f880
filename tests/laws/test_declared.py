"""What a user declares and the returns contradict is not used, and that is told."""

from __future__ import annotations

import numpy as np
import pytest

from bench.score.analytic import milled_part
from bench.score.measure import alone
from bench.score.named import simulated
from tests.seldom import seldom
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.scan import fuse


@pytest.mark.parametrize("seed", [18_006_010, *seldom(18_006_016)])
def test_a_rounded_edge_that_is_declared_sharp_is_measured_as_a_rounded_one(seed: int) -> None:
    recording, truth = simulated("swept_rounded", seed)
    part = milled_part(recording, truth, {"edge_condition": "sharp"})
    found = alone(part).found["root_mm"]
    assert (np.abs(found.error) < 3.0 * found.u).all()
    nominal = {name: part.declared[name] for name in ("root_nominal_mm", "bevel_nominal_deg")}
    edge = segment(denoise(fuse(recording)), edge_condition="sharp", **nominal)
    assert any("declared sharp" in warning for warning in edge.warnings)
