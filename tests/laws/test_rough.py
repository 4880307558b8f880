"""Roughness that hangs together over less than the waves of an edge is noise of all that is told along it."""

from __future__ import annotations

import numpy as np
import pytest

from bench.joints import JOINTS, measured
from bench.recordings import with_values
from bench.score.measure import alone
from bench.score.parts import simulators
from tests.seldom import seldom
from workbench.artefacts import Recording
from workbench.scan import fuse
from workbench.units import Float

RMS_MM, LENGTH_MM, WAVES = 0.01, 2.0, 400


def roughened(recording: Recording, seed: int) -> Recording:
    """Ranges off by a field over the part's surfaces; correlation exp(-(d / length)^2 / 2) in every direction."""
    rng = np.random.default_rng([10_600_003, seed])
    frame, column = np.nonzero(np.isfinite(recording.x_mm + recording.z_mm))
    place = fuse(recording).placed(frame, column)
    place = place - place.mean(axis=0)
    off = np.zeros(frame.size)
    for wave, phase in zip(rng.normal(size=(WAVES, 3)) / LENGTH_MM, rng.uniform(0.0, 2.0 * np.pi, WAVES), strict=True):
        off += np.cos(place @ wave + phase)
    z = recording.z_mm.copy()
    z[frame, column] += (RMS_MM * np.sqrt(2.0 / WAVES) * off).astype(np.float32)
    return with_values(recording, z_mm=z)


def angles(kind: str, seed: int) -> Float:
    """Errors of the angles of a rough part over their u."""
    if kind == "milled":
        part = simulators()["swept"]["sharp"](seed)
        found = alone(part._replace(recording=roughened(part.recording, seed)))
        return found.found["bevel_deg"].error / found.found["bevel_deg"].u
    joint = JOINTS["prism"][1](kind, seed)
    rows = measured(joint._replace(recording=roughened(joint.recording, seed)))[1]
    return np.array([error / u for name, error, u in rows if name.endswith("_deg")])


@pytest.mark.parametrize(("kind", "seed"), [("milled", 10_600_022), *seldom(("V", 10_600_010))])
def test_roughness_is_in_u_of_angles(kind: str, seed: int) -> None:
    assert np.abs(angles(kind, seed)).max() < 4.0
