"""Burrs are reported where they stand, and move no edge."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.score.measure import one
from tests.seldom import seldom
from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Cloud, MilledEdge
from workbench.edge import segment

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
    for condition, seed in (("outliers_5", 3), ("two_pass", 1), ("arc", 1), ("noisy", 1)):
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


def prolonged(cloud: Cloud, edge: MilledEdge, from_mm: float, to_mm: float) -> Cloud:
    """The root face goes on in its own plane, by 0.1 mm in the middle of a stretch."""
    x, z, keep, root = cloud.x_mm.copy(), cloud.z_mm.copy(), cloud.keep.copy(), edge.faces[ROOT_FACE]
    pitch, at = float(np.nanmedian(np.diff(x, axis=1))), edge.frame_arc_length_mm
    for i in np.flatnonzero((at > from_mm) & (at < to_mm)):
        on, bevel = (np.flatnonzero(edge.labels[i] == label) for label in (ROOT_FACE, BEVEL_FACE))
        way = int(np.sign(on.mean() - bevel.mean()))
        end = on.max() if way > 0 else on.min()
        slope = root.sxz[i] / root.sxx[i]
        height = 0.1 * np.sin(np.pi * (at[i] - from_mm) / (to_mm - from_mm))
        for k in range(1, round(height / (abs(pitch) * np.hypot(1.0, slope))) + 1):
            column = end + way * k
            x[i, column] = x[i, end] + way * k * pitch
            z[i, column] = root.z_mean[i] + slope * (x[i, column] - root.x_mean[i])
            keep[i, column] = True
    return dataclasses.replace(cloud, x_mm=x, z_mm=z, keep=keep)


@pytest.mark.parametrize("seed", [1005, *seldom(1077)])  # 0.09 and 0.12 mm high at most, 3 and 2 columns
def test_a_low_burr_on_half_of_an_edge_is_no_root_face(seed: int, tmp_path: Path) -> None:
    root = one(("worn", "triangulated", seed, tmp_path, "product")).found["root_mm"]
    assert (np.abs(root.error) < 2.0 * root.u).mean() > 0.95
    assert np.median(np.abs(root.error)) < 0.02


def footed(cloud: Cloud, edge: MilledEdge, from_mm: float, to_mm: float) -> Cloud:
    """The root face's fifth beside the bevel stands out of its line, by up to twice the noise, along a stretch."""
    z, root, at = cloud.z_mm.copy(), edge.faces[ROOT_FACE], edge.frame_arc_length_mm
    for i in np.flatnonzero((at > from_mm) & (at < to_mm)):
        on, bevel = (np.flatnonzero(edge.labels[i] == label) for label in (ROOT_FACE, BEVEL_FACE))
        beside = on[np.argsort(np.abs(on - bevel.mean()))][: on.size // 5]
        outwards = np.sign(bevel.mean() - on.mean()) * np.sign(root.sxz[i])
        z[i, beside] += outwards * np.linspace(2.0, 1.0, beside.size) * root.noise_mm
    return dataclasses.replace(cloud, z_mm=z)


def test_what_stands_beside_the_corner_turns_no_bevel_angle(scanned: Scans) -> None:
    scan = scanned(part=part())
    plain = segment(scan.cloud)
    with_foot = segment(footed(scan.cloud, plain, 15.0, 30.0))
    at = np.linspace(3.0, 47.0, 45)
    angle = [np.interp(at, e.arc_length_mm, e.bevel.value) for e in (plain, with_foot)]
    u = np.interp(at, with_foot.arc_length_mm, with_foot.bevel.u)
    assert np.abs(angle[1] - angle[0]).max() < 0.1
    assert (np.abs(angle[1] - angle[0]) < 2.0 * u).all()


def test_the_edge_lies_where_the_root_face_ends_under_what_stands_out_of_it(scanned: Scans) -> None:
    scan = scanned(part=part())
    plain = segment(scan.cloud)
    other = segment(prolonged(scan.cloud, plain, 15.0, 35.0))
    at = np.linspace(3.0, 47.0, 45)

    def along(edge: MilledEdge, columns: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(at, edge.arc_length_mm, column) for column in columns.T], axis=1)

    off = along(other, other.position_mm) - along(plain, plain.position_mm)
    below = -(off * along(plain, plain.across)).sum(axis=1)
    longer = along(other, other.root.value[:, None]) - along(plain, plain.root.value[:, None])
    assert np.abs(below - longer[:, 0]).max() < 0.01
    assert np.abs(below).max() < 0.05
