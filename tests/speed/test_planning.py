"""The raw edge that planning is timed on is what it says, and the peers find the distances that ours are."""

from __future__ import annotations

import numpy as np
import pytest

from bench.speed.distances import (
    THICKNESS_MM,
    layer_problems,
    long_raw_edge,
    open3d_distances,
    section_frames,
    tree_distances,
)
from workbench.artefacts import ROOT_FACE, UPPER_SURFACE
from workbench.geometry import grids
from workbench.path import layers
from workbench.path.feed import remaining_stock, stock_distances


@pytest.fixture(scope="module")
def short():
    return long_raw_edge(20.0)


def test_the_cloud_lies_on_the_plate(short):
    edge, cloud = short
    points = grids.fuse(cloud.x_mm, cloud.z_mm, cloud.base_from_profiler, np.zeros(3)).astype(float)
    corner, _, normal, across = section_frames(len(points))
    off = points - corner[:, None]
    g, v = np.einsum("ijk,ik->ij", off, normal), np.einsum("ijk,ik->ij", off, across)
    face, surface = edge.labels == ROOT_FACE, edge.labels == UPPER_SURFACE
    assert np.abs(g[face]).max() < 0.1
    assert (v[face].min(), v[face].max()) == (pytest.approx(0, abs=0.1), pytest.approx(THICKNESS_MM, abs=0.1))
    assert v[surface] == pytest.approx(THICKNESS_MM, abs=0.1)
    assert g[surface].max() < 0.1
    assert (face | surface == cloud.keep).all()
    assert cloud.keep.sum() > 100_000


def test_the_peers_agree_with_each_other():
    rng = np.random.default_rng(0)
    samples, points = rng.normal(size=(5, 4, 3)), rng.normal(size=(300, 3))
    expected = np.linalg.norm(samples[:, :, None] - points, axis=3).min(axis=(1, 2))
    assert open3d_distances(samples, points) == pytest.approx(expected, abs=1e-9)
    assert tree_distances(samples, points) == pytest.approx(expected, abs=1e-12)


def test_ours_are_the_distances_of_the_peers(short):
    """But for sampled axes and faces, and points within the noise of a layer's face."""
    edge, cloud = short
    toolpath = layers(edge, cloud, depth_of_cut_mm=1.5)
    remaining = remaining_stock(toolpath, cloud, edge)
    problems = list(layer_problems(toolpath, cloud))
    assert len(problems) == len(toolpath.layers) == 5
    for done, (layer, problem) in enumerate(zip(toolpath.layers, problems, strict=True)):
        ours, peers = stock_distances(remaining, toolpath, layer, done), tree_distances(*problem)
        assert ours == pytest.approx(peers, abs=0.03)
        assert 3.4 < ours[layer.cutting].min() < 5.0 + 0.1
