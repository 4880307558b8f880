"""What lies before a root, nearer to the sensor, ends the returns of its bevel: the root is not told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.score.measure import alone
from bench.score.swept import groove
from tests.seldom import seldom
from workbench.artefacts import Recording

BREAK_MM, COLUMNS, RADIUS_MM = 1.5, 20, 1.0  # where a profile falls by so much a bevel ends; a cable, in columns


def behind_a_cable(scan: Recording) -> Recording:
    z = scan.z_mm.copy()
    for row in z:
        on = np.flatnonzero(np.isfinite(row))
        breaks = np.flatnonzero((np.abs(np.diff(row[on])) > BREAK_MM) | (np.diff(on) > COLUMNS))
        if breaks.size:
            middle = on[breaks[0]]
            upwards = np.sign(row[on[0]] - row[middle])
            over = np.sqrt(1.0 - np.linspace(-0.99, 0.99, 2 * COLUMNS) ** 2)
            hidden = slice(max(middle - COLUMNS, 0), middle + COLUMNS)
            row[hidden] = row[on[0]] + upwards * RADIUS_MM * (1.0 + over[: row[hidden].size])
    return replace(scan, z_mm=z)


@pytest.mark.parametrize("seed", [18_004_000, *seldom(18_004_003)])
def test_a_root_behind_a_cable_is_not_told(seed: int) -> None:
    """Gaps were 47 to 100 u off."""
    part = groove(seed)
    found = alone(part._replace(recording=behind_a_cable(part.recording)))
    assert not found.crashed
    assert all((np.abs(one.error) < 4.0 * one.u).all() for one in found.found.values())
