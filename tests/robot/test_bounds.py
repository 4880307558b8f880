"""The lower bound of the clearance: nothing that fcl calls colliding is called free, and the bound is a bound."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import open3d
import pytest

from workbench.errors import InputError
from workbench.robot import Cell, CollisionModel, bounding_volumes, clearance_bound_mm, read_cell
from workbench.robot.bounds import SAFE_MM, Pairs
from workbench.robot.picture import cell_picture


def crowded(tree: Any) -> None:
    """Boxes and flat cylinders on turntable, base and tool, so that each meets each; a mesh for a workpiece."""
    tree["fixtures"] += [
        {"name": "clamp", "on": "turntable", "pose": {"position_mm": [200, 0, 150]}, "box_mm": [100, 300, 300]},
        {
            "name": "rail",
            "pose": {"position_mm": [900, -900, 1400], "quaternion_wxyz": [0.8, 0, 0.6, 0]},
            "box_mm": [600, 80, 80],
        },
        {"name": "lamp", "pose": {"position_mm": [1500, 800, 1800]}, "sphere_mm": 200},
        {
            "name": "drum",
            "pose": {"position_mm": [1200, 900, 900], "quaternion_wxyz": [0.8, 0.6, 0, 0]},
            "cylinder_mm": [350, 120],
        },
    ]
    tree["margin_mm"] = 0
    tree["workpiece"] = {"mesh": "cube.stl", "pose": {"position_mm": [-300, -100, 0]}}
    tree["tool"]["shapes"] += [
        {"box_mm": [60, 200, 90], "pose": {"position_mm": [0, 0, 60]}},
        {"cylinder_mm": [110, 30], "pose": {"position_mm": [0, 0, 120]}},
    ]


@pytest.fixture
def crowd(cell_file: Any) -> Cell:
    path = cell_file(crowded)
    mesh = open3d.geometry.TriangleMesh.create_box(200, 300, 250)
    mesh.compute_triangle_normals()
    assert open3d.io.write_triangle_mesh(path.parent / "cube.stl", mesh)
    return read_cell(path)


def test_nothing_that_collides_is_called_free(crowd: Cell, postures: Any) -> None:
    joints, table = postures(2500, 31), np.random.default_rng(31).uniform(-3, 3, 2500)
    bound = clearance_bound_mm(crowd, bounding_volumes(crowd), joints, table)
    model = CollisionModel(crowd)
    collides = np.array([model.collision(q, t) is not None for q, t in zip(joints, table, strict=True)])
    free = bound > SAFE_MM
    assert not (free & collides).any()
    assert collides.sum() > 200
    assert free.sum() > 0.8 * (~collides).sum()  # and it is worth asking


def test_bound_is_below_the_clearance_and_close_to_it(crowd: Cell, postures: Any) -> None:
    joints = postures(250, 32)
    bound = clearance_bound_mm(crowd, bounding_volumes(crowd), joints, 0.4)
    model = CollisionModel(crowd)
    found = [model.clearance(q, 0.4) for q in joints]
    clearance = np.array([one.distance_mm for one in found if one is not None])
    assert (np.maximum(bound, 0) <= clearance + 1e-2).all()
    assert np.median(clearance - np.maximum(bound, 0)) < 1.0


def test_box_and_capsules_are_exact(cell_file: Any) -> None:
    """Robot and floor alone are capsules and a box, the flange's disc set aside: the bound is fcl's distance."""

    def bare(tree: Any) -> None:
        tree["tool"]["shapes"] = []
        tree["turntable"]["shapes"] = []
        others = ["base_link", "link_1", "link_2", "link_3", "link_4", "link_5", "floor"]
        tree["may_touch"] = [["link_6", other] for other in others]

    cell = read_cell(cell_file(bare))
    rng = np.random.default_rng(33)
    joints = rng.uniform(-0.9, 0.9, (100, 6))
    bound = clearance_bound_mm(cell, bounding_volumes(cell), joints)
    model = CollisionModel(cell)
    for q, low in zip(joints, bound, strict=True):
        found = model.clearance(q)
        assert found is not None
        assert abs(found.distance_mm - max(low, 0)) < 0.1


def test_a_cell_without_bodies() -> None:
    """No URDF shape, tool shape, fixture or envelope: nothing can touch, nothing is drawn, nothing fails inside."""
    bare = dataclasses.replace(read_cell(Path("data/robot/cell.json")), shapes=())
    assert not Pairs(bare).swept(np.zeros((3, 5, 6)), np.zeros(3)).any()
    assert (clearance_bound_mm(bare, bounding_volumes(bare), np.zeros((2, 6))) > 0).all()
    with pytest.raises(InputError, match="expected bodies to draw"):
        cell_picture(bare, np.zeros(6), 0.0)
