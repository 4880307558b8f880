"""The raw edge that planning is timed on is what it says, and the peers find the distances that ours are."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.speed.distances import (
    RADIUS_MM,
    THICKNESS_MM,
    layer_problems,
    long_raw_edge,
    open3d_distances,
    section_frames,
    tree_distances,
)
from bench.speed.rows import planned
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


def test_the_edge_is_an_arc_and_right_handed(short):
    edge, _ = short
    assert np.linalg.det(np.stack([edge.across, edge.normal, edge.tangent], axis=2)) == pytest.approx(1)
    turn = math.acos(float(edge.tangent[0] @ edge.tangent[-1]))
    assert turn == pytest.approx(20.0 / RADIUS_MM, rel=1e-3)
    assert np.diff(edge.position_mm, axis=0) @ edge.tangent[10] == pytest.approx(1.0, abs=1e-3)


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


def test_rows_extrapolate_the_peers_and_compare_with_the_goals():
    stages_s = {"path.layers": 0.2, "path.feed": 1.5, "all": 1.9, "path.check": 0.4}
    found = {"stages_s": stages_s, "distances_s": {"ours": 1.0, "open3d": 0.4, "tree": 1.2}}
    whole, checked, open3d, tree = planned(found | {"points": 50_000, "peer_points": 1_000, "layers": 10})
    assert (whole.met, whole.factor, checked.met) == (True, 1.9, None)
    assert (open3d.factor, open3d.met) == (pytest.approx(20), False)
    assert (tree.factor, tree.met, tree.other) == (pytest.approx(60), True, "60 s")
    assert "path.feed 1.5 s" in whole.what
