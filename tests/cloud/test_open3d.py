"""Clouds to Open3D and back; Open3D's registration as a stage; organised PCD."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.seldom import seldom
from workbench.api import pose_from, rotation_from_vector
from workbench.artefacts import PointSet
from workbench.cloud import denoise, register
from workbench.cloud import read as read_cloud
from workbench.compare import surface
from workbench.edge import segment
from workbench.errors import InputError, PipelineError
from workbench.export import cloud as export_cloud
from workbench.scan import fuse, read

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def cloud():
    return denoise(fuse(read(recording=ROOT / "data" / "synthetic" / "milled_edge.h5")))


@pytest.fixture(scope="module")
def corner():
    """Three faces of different sizes that meet: nothing of it can slide."""
    rng = np.random.default_rng(3)
    u, v = rng.uniform(0, 1, (2, 30_000))
    face = np.arange(30_000) % 3
    points = np.choose(
        face[:, None],
        [
            np.stack([60 * u, 40 * v, 0 * u], axis=1),
            np.stack([60 * u, 0 * u, 25 * v], axis=1),
            np.stack([0 * u, 40 * u, 25 * v * (1 - 0.5 * u)], axis=1),
        ],
    )
    return points + np.array([1000.0, -300.0, 700.0]) + rng.normal(0, 0.02, points.shape)


def test_a_cloud_goes_to_open3d_with_its_grid(cloud):
    edge = segment(cloud)
    made = cloud.to_open3d(edge)
    points, frame, column = (made.point[name].numpy() for name in ("positions", "frame", "column"))
    assert points.dtype == np.float64
    assert len(points) == cloud.keep.sum()
    assert cloud.keep[frame[:, 0], column[:, 0]].all()
    some = 12_345
    pose, i, j = cloud.base_from_profiler[frame[some, 0]], frame[some, 0], column[some, 0]
    np.testing.assert_allclose(points[some], (pose @ [cloud.x_mm[i, j], 0, cloud.z_mm[i, j], 1])[:3], atol=1e-9)
    assert (made.point["face"].numpy()[:, 0] == edge.labels[frame[:, 0], column[:, 0]]).all()
    np.testing.assert_array_equal(cloud.points_mm, points)
    assert len(made.to_legacy().points) == len(points)


def test_point_sets_go_to_open3d_and_back():
    points = np.random.default_rng(0).normal(0, 100, (500, 3))
    there = PointSet(points).to_open3d()
    np.testing.assert_array_equal(PointSet.from_open3d(there).points_mm, points)
    np.testing.assert_array_equal(PointSet.from_open3d(there.to_legacy()).points_mm, points)


@pytest.mark.parametrize("turn", [[0.5, -1.0, 2.0], *seldom([0.1, 0, 0], [0, 3.0, 0])])
def test_register_finds_a_cloud_wherever_it_lies(turn, corner, tmp_path):
    reference = tmp_path / "reference.xyz"
    np.savetxt(reference, corner[::2], fmt="%.5f")
    away = pose_from(rotation_from_vector(np.array(turn)), np.array([-400.0, 2000.0, 30.0]))
    cloud = PointSet(corner[1::2] @ away[:3, :3].T + away[:3, 3])
    moved, document = register(cloud, reference=reference, voxel_mm=2.0)
    assert np.abs(moved.points_mm - corner[1::2]).max() < 0.03  # noise 0.02 mm, 15,000 points
    told = json.loads(document.content)
    np.testing.assert_allclose(np.array(told["reference_from_cloud"]) @ away, np.eye(4), atol=0.2)
    assert told["overlap"] > 0.9


def test_register_refuses_another_part(corner, tmp_path):
    rng = np.random.default_rng(4)
    ball = rng.normal(size=(8000, 3))
    np.savetxt(tmp_path / "ball.xyz", 30 * ball / np.linalg.norm(ball, axis=1)[:, None], fmt="%.5f")
    with pytest.raises(InputError, match="expected 90 %; another part"):
        register(PointSet(corner[::3]), reference=tmp_path / "ball.xyz", voxel_mm=4.0, least_overlap=0.9)


def test_an_organised_pcd_keeps_the_grid_for_pcl(cloud, tmp_path):
    edge = segment(cloud)
    document = export_cloud(cloud, edge, format="pcd", organised=True)
    frames, columns = cloud.keep.shape
    head, _, body = document.content.partition(b"DATA binary\n")
    assert f"WIDTH {columns}\nHEIGHT {frames}\n".encode() in head
    grid = np.frombuffer(body, [("xyz", "<f4", 3), ("label", "<u4")]).reshape(frames, columns)
    assert (np.isfinite(grid["xyz"]).all(axis=2) == cloud.keep).all()
    assert (grid["label"][cloud.keep] == edge.labels[cloud.keep]).all()
    (tmp_path / "cloud.pcd").write_bytes(document.content)
    back = read_cloud(file=tmp_path / "cloud.pcd")
    np.testing.assert_allclose(back.points_mm, cloud.points_mm, atol=2e-4)
    with pytest.raises(InputError, match="expected format 'pcd'"):
        export_cloud(cloud, format="ply", organised=True)


def test_a_stage_takes_open3ds_cloud_where_points_are_enough(cloud):
    tensor = cloud.to_open3d()
    for one in (tensor, tensor.to_legacy()):
        made = surface(points=one, most_points=2000)
        np.testing.assert_array_equal(
            made.points_mm, surface(points=PointSet.from_open3d(one), most_points=2000).points_mm
        )
    with pytest.raises(PipelineError, match="a PointCloud of Open3D: it has no profiles"):
        segment(tensor)
