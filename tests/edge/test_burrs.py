"""Burrs are reported where they stand, and move no edge."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.score.measure import one
from workbench.edge.steps import readings

Scans = Callable[..., Any]
BURR = {"edge": "lower", "from_mm": 20.0, "to_mm": 30.0, "height_mm": 0.4, "width_mm": 0.5}


def part(*burrs: dict[str, Any]) -> dict[str, Any]:
    return {"length_mm": 60.0, "burrs": list(burrs)}


def test_a_burr_at_the_lower_edge_is_reported_where_it_stands(scanned: Scans) -> None:
    edge = scanned(part=part(BURR)).edge
    at = edge.arc_length_mm[edge.burr_stations] + 5.0  # the scan starts 5 mm into the part
    assert at.size >= 4  # it swells and fades: above half its height over 5 mm
    assert at.min() > 19.5
    assert at.max() < 30.5
    assert np.abs(at - 25).min() < 1


def test_no_burr_is_invented(scanned: Scans, drawn: Scans) -> None:
    assert scanned(part=part()).edge.burr_stations.size == 0
    for condition, seed in (("two_pass", 1), ("arc", 1), ("noisy", 1)):
        assert drawn(condition, seed).edge.burr_stations.size == 0


def test_a_burr_does_not_move_the_edge(scanned: Scans) -> None:
    plain, burred = (scanned(part=part(*burrs)).edge for burrs in ((), (BURR,)))
    at = np.linspace(1, 48, 48)
    for k in range(3):
        with_burr = np.interp(at, burred.arc_length_mm, burred.position_mm[:, k])
        without = np.interp(at, plain.arc_length_mm, plain.position_mm[:, k])
        # along x arc length may start a column's step apart
        assert np.abs(with_burr - without).max() < (0.3 if k == 0 else 0.05)
    size = [np.nanmedian(e.root.value) for e in (plain, burred)]
    assert size[0] == pytest.approx(size[1], abs=0.03)


def test_burrs_that_stand_out_of_a_third_of_an_edge_turn_no_bevel_angle(tmp_path: Path) -> None:
    bevel = one(("worn", "swept", 8950005, tmp_path, "product")).found["bevel_deg"]
    assert (np.abs(bevel.error) < 3.0 * bevel.u).all()
    assert np.abs(bevel.error).max() < 0.5  # 4.4 where they turn it


@pytest.mark.parametrize("height_mm", [0.2, 4.0])
def test_a_stretch_off_the_face_is_none_of_its_own_however_high(height_mm: float) -> None:
    s = np.arange(80.0)
    noise = np.random.default_rng(3).normal(0.0, 0.01, s.size)
    value = noise + np.where((s > 20) & (s < 45), height_mm, 0.0)
    found = readings(s, value, np.full(s.size, 0.01), s)
    assert (found.own[21:45] < 0.01).all()
    assert np.median(found.own[:20]) > 0.9
    back = readings(s, value[::-1], np.full(s.size, 0.01), s)
    assert back.own[::-1] == pytest.approx(found.own, abs=1e-2)
