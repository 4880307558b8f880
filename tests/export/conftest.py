"""One inspected part, and what a run would tell of its recording."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from bench.drawn.plates import random_recipe
from workbench.artefacts import Cloud, Edge, Inspection, Provenance
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic import simulate_recording


@dataclass(frozen=True)
class Inspected:
    cloud: Cloud
    edge: Edge
    inspection: Inspection


@pytest.fixture(scope="session")
def inspected() -> Inspected:
    recording, _ = simulate_recording(random_recipe("clamps", 5))
    cloud = denoise(fuse(recording))
    edge = segment(cloud)
    return Inspected(cloud, edge, sections(edge))


@pytest.fixture
def provenance() -> Provenance:
    return Provenance("t", (("hand_eye", "h.json", "00"), ("recording", "part 7.h5", "ab12")), {}, {}, 0)
