"""The measured loop's figures from parts whose errors are known."""

from __future__ import annotations

import pytest

from bench.metrology.measured.part import MeasuredResult
from bench.metrology.measured.summary import (
    SINE,
    MeasuredSummary,
)


def part(seed: int, root: float = 1.51, blind: float = 1.9, bevel: float = 40.02, u: float = 0.01) -> MeasuredResult:
    places = {"root_mm": root, "root_blind_mm": blind, "bevel_deg": bevel, "correction_u_mm": u}
    places |= {"bevel_blind_deg": bevel + 0.1, "correction_u_deg": 0.02}
    columns = {k: [v] * 20 for k, v in places.items()}
    return MeasuredResult("repeating", seed, places=columns, seconds={"milling": 2.0})


def test_figures_of_known_parts() -> None:
    beyond = MeasuredResult("repeating", 9, beyond="too deep", places={"root_blind_mm": [0.6, 0.7]})
    found = MeasuredSummary("repeating", [*(part(seed) for seed in range(4)), beyond])
    assert (len(found.results), len(found.good), len(found.beyond), found.blind_too_deep) == (5, 4, 1, 1)
    assert found.corrected == pytest.approx([0.01] * 3)
    assert found.blind == pytest.approx([0.4] * 3)
    assert found.predicted.bias == pytest.approx(0.01 * SINE)
    assert found.too_deep == []
    assert list(found.shortcomings) == []
    assert "| repeating | 5 | 4 | 1 | 0 |" in MeasuredSummary.text([found], "command")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"root": 1.56}, "repeating: root"),
        ({"bevel": 40.2}, "repeating: bevel"),
        ({"root": 0.9, "blind": 1.2}, "repeating: 12 cut too deep"),
        ({"u": 0.001}, "repeating: finished root within 2u of the correction"),
        ({"bevel": 40.06}, "repeating: finished bevel within 2u of the correction"),
    ],
)
def test_what_falls_short_is_said(changed: dict[str, float], words: str) -> None:
    parts = [part(seed, **changed) for seed in range(12)]
    assert words in list(MeasuredSummary("repeating", parts).shortcomings)
    assert list(MeasuredSummary.worst(parts, 1))
