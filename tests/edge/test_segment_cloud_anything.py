"""Clouds of anything: an edge, or one line that says why not; never another error."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from bench.drawn.swept import random_swept_recipe
from bench.simulators.swept import simulate_swept
from workbench.artefacts import PointSet
from workbench.cloud import denoise
from workbench.edge import segment_cloud
from workbench.errors import InputError
from workbench.scan import fuse
from workbench.units import Float

COUNTS = (0, 100, 200)


def plain_shapes(rng: np.random.Generator, n: int) -> Iterator[tuple[str, Float]]:
    """n points of shapes that have no milled edge."""
    flat = rng.uniform(0, 50, (n, 3)) * [1, 1, 0]
    ball = rng.normal(size=(n, 3))
    cube = rng.uniform(0, 20, (n, 3))
    cube[np.arange(n), rng.integers(0, 3, n)] = rng.choice([0.0, 20.0], n)
    turn = rng.uniform(0, 2 * np.pi, n)
    yield "blob", rng.normal(size=(n, 3)) * rng.uniform(0.1, 50, 3)
    yield "plane", flat
    yield "noisy plane", flat + 0.01 * rng.normal(size=(n, 3))
    yield "sphere", 30 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    yield "cube", cube
    yield "cylinder", np.stack([5 * np.cos(turn), 5 * np.sin(turn), rng.uniform(0, 80, n)], axis=1)
    yield "line", rng.uniform(0, 100, (n, 1)) * rng.normal(size=3)
    yield "one place", np.tile(rng.normal(size=3), (n, 1))
    yield "places many times", np.repeat(20 * rng.normal(size=(n // 50 + 1, 3)), 50, axis=0)
    yield "lattice", np.stack(np.unravel_index(np.arange(n), (50, 20, 2)), axis=1) * rng.uniform(0.05, 2)


def strange_edges(rng: np.random.Generator, n: int) -> Iterator[tuple[str, Float]]:
    """What has something of an edge, and clouds beyond all measure."""
    s, w = rng.uniform(0, rng.uniform(0.5, 80), 5 * n), rng.uniform(0, 8, 5 * n)
    up = np.maximum(w - 1.5, 0)
    edge = np.stack([s, np.minimum(w, 1.5) + up * np.cos(0.7), up * np.sin(0.7)], axis=1)
    yield "edge", edge + rng.choice([0, 0.01, 0.2, 1]) * rng.normal(size=edge.shape)
    yield "edge at a right angle to itself", np.concatenate([edge, edge[:, [1, 0, 2]]])
    yield "edge three times", np.repeat(edge, 3, axis=0)
    yield "edge in pieces", edge[(s % 7 < 1) | (s > 70)]
    yield "edge and a point far off", np.concatenate([edge, [[1e7, 0, 0]]])
    yield "edge and a point not so far off", np.concatenate([edge, [[2e4, 0, 0]]])
    yield "far off", edge + 1e9
    yield "huge", edge * 10.0 ** rng.uniform(3, 150)
    yield "tiny", edge * 1e-9


@pytest.mark.parametrize("seed", range(len(COUNTS)))
def test_any_cloud_gives_an_edge_or_one_line(seed: int):
    rng = np.random.default_rng(seed)
    for name, points in (*plain_shapes(rng, COUNTS[seed]), *strange_edges(rng, COUNTS[seed])):
        for options in ({}, {"use_order": False}, {"upper_side": (0.0, 0.0, 1.0)}):
            refusal = one_line_or_edge(PointSet(points, f"{name}.ply"), **options)
            assert refusal or "edge" in name or name in ("far off", "cube"), f"{name}: an edge, where there is none"
            assert not refusal or (refusal.startswith(f"{name}.ply: ") and "\n" not in refusal), refusal


@pytest.mark.slow
def test_a_ring_whose_slices_determine_no_course_gets_one_line() -> None:
    """It ended in numpy's LinAlgError."""
    recording, _ = simulate_swept(random_swept_recipe("swept_ring", 17_660_005))
    cloud = denoise(fuse(recording))
    ring = PointSet(cloud.placed(*np.nonzero(cloud.keep)), "ring.ply")
    assert one_line_or_edge(ring, root_nominal_mm=2.0).startswith("ring.ply: ")


def one_line_or_edge(points: PointSet, **options: Any) -> str:
    """The refusal; nothing where an edge was found, and that is whole."""
    try:
        cloud, edge = segment_cloud(points, **options)
    except InputError as error:
        return str(error)
    assert edge.labels.shape == cloud.keep.shape
    assert np.isfinite(edge.tangent).all()
    return ""
