"""Returns that become rare towards the end of a face, as under soot: the end is told within its uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.score.measure import alone
from bench.score.named import drawn
from bench.score.swept import groove
from workbench.artefacts import Recording

FADE = 8  # columns
BREAK_MM, BREAK_COLUMNS = 1.5, 10  # where a profile goes on so far away, a face ends
MOST = 3.0  # times u, in the worst section


def faded(scan: Recording) -> Recording:
    """Beside every break of a profile the k-th column returns in a share (k + 1/2) / FADE of the frames."""
    z, rng = scan.z_mm.copy(), np.random.default_rng(18_004_000)
    for row in z:
        on = np.flatnonzero(np.isfinite(row))
        broken = (np.abs(np.diff(row[on])) > BREAK_MM) | (np.diff(on) > BREAK_COLUMNS)
        ends = [(on[:-1][broken], -1), (on[1:][broken], 1), (on[:1], 1), (on[-1:], -1)]
        for k in range(FADE):
            at = np.unique(np.concatenate([side + step * k for side, step in ends]).clip(0, row.size - 1))
            row[at[rng.random(at.size) > (k + 0.5) / FADE]] = np.nan
    return replace(scan, z_mm=z)


@pytest.mark.parametrize(
    ("draw", "size"),
    [
        (lambda: drawn("swept_plain", 18_004_002), "root_mm"),
        (lambda: drawn("swept_raw_plain", 18_004_001), "along_m_mm"),
        (lambda: groove(18_004_001), "gap_mm"),
    ],
    ids=["milled", "raw", "groove"],
)
def test_a_fading_end_is_within_its_uncertainty(draw, size) -> None:
    part = draw()
    found = alone(part._replace(recording=faded(part.recording), declared=part.declared | {"edge_condition": "sharp"}))
    assert not found.refused
    assert np.abs(found.found[size].error / found.found[size].u).max() < MOST
