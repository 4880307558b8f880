"""The lower bound of the clearance: nothing that fcl calls colliding is called free, and the bound is a bound.

Collision of many postures at once: the answers are those of fcl alone, pair by pair.
"""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import open3d
import pytest
from scipy.spatial.transform import Rotation

from workbench.robot import (
    Cell,
    CollisionModel,
    CollisionScreen,
    Shape,
    Turntable,
    cell_strokes,
    motions,
    read_cell,
    standing_poses,
)
from workbench.robot.bounds import FREE, SAFE_MM
from workbench.robot.cell_model import ON_BASE, ON_CRADLE, ON_TURNTABLE

from .conftest import plainly


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
    plainly(tree)
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


def test_a_cell_without_bodies() -> None:
    """No URDF shape, tool shape, fixture or envelope: nothing can touch, nothing is drawn, nothing fails inside."""
    bare = dataclasses.replace(read_cell(Path("data/robot/cell.json")), shapes=())
    screen = CollisionScreen(bare)
    assert not screen.swept(np.zeros((3, 5, 6)), np.zeros((3, 5))).any()
    assert (screen.bound_mm(np.zeros((2, 6))) > 0).all()
    assert cell_strokes(bare, np.zeros(6), 0.0) == []


def test_no_posture_is_judged_otherwise(crowd: Cell) -> None:
    margin_mm, rng = 25.0, np.random.default_rng(6)
    full = dataclasses.replace(crowd, margin_mm=margin_mm)
    q = rng.uniform(full.chain.limits[:, 0], full.chain.limits[:, 1], (600, 6))
    table = rng.uniform(-np.pi, np.pi, 600)
    screen, model = CollisionScreen(full), CollisionModel(full)
    hits = screen.hits(q, table)
    assert 100 < (hits == FREE).sum() < 500
    free = screen.bound_mm(q, table) > margin_mm + SAFE_MM
    assert free.sum() > 0.8 * (hits == FREE).sum()  # the bound is worth asking
    assert not (free & (hits != FREE)).any()
    some = slice(0, 200)
    found = [model.gaps(one, angle)[0].distance_mm for one, angle in zip(q[some], table[some].tolist(), strict=True)]
    assert screen.clearances_mm(q[some], table[some]) == pytest.approx(found)
    for one, angle, hit in zip(q, table, hits, strict=True):
        assert (model.collision(one, angle) is None) == (hit == FREE)
        if hit != FREE:
            assert model.gaps(one, angle)[0].distance_mm < max(margin_mm, 1e-12)
            assert screen.pair(hit) == model.names(hit)


def tilted(cell: Cell) -> Cell:
    """The cell with its turntable on an axis askew below it, which carries a post."""
    frame, post = np.eye(4), np.eye(4)
    frame[:3, :3] = Rotation.from_rotvec([1.2, -0.4, 0.3]).as_matrix()
    frame[:3, 3] = cell.turntable.base_from_turntable[:3, 3] - [100, 50, 200]
    post[:3, 3] = 0, 0, 500
    tilt = Turntable(frame, np.array([-2.0, 2.0]), 0.3, tilts=True)
    shapes = (*cell.shapes, Shape("tilt", ON_CRADLE, "box", (200.0, 150.0, 900.0), post))
    return dataclasses.replace(cell, turntable=dataclasses.replace(cell.turntable, on=tilt), shapes=shapes)


@pytest.mark.parametrize("kind", ["track", "positioner"])
def test_what_external_axes_move_is_held_against_what_stands(cell: Cell, postures: Any, kind: str) -> None:
    """Boxes and meshes against boxes too, none of them on the robot: fcl's distances are never less than the bound."""
    rng, at = np.random.default_rng(35), np.eye(4)
    at[:3, 3] = 1300, -300, 300
    floor = np.linalg.inv(cell.turntable.base_from_turntable) @ at
    beside = (
        Shape("box", ON_BASE, "box", (300.0, 200.0, 700.0), at),
        Shape("plate", ON_TURNTABLE, "box", (700.0, 300.0, 40.0), np.eye(4) if kind == "positioner" else floor),
        Shape("drum", ON_TURNTABLE, "cylinder", (200.0, 500.0), np.eye(4)),
    )
    cell = dataclasses.replace(cell, shapes=(*cell.shapes, *beside))
    if kind == "track":
        cell = dataclasses.replace(cell, turntable=dataclasses.replace(cell.turntable, slides=True))
        values = np.radians(rng.uniform(-600, 600, 300))
    else:
        cell, values = tilted(cell), rng.uniform(-2, 2, (300, 2))
    model, joints = CollisionModel(cell), postures(300, 35)
    bounds, _ = CollisionScreen(cell).pair_bounds_mm(joints, values)
    links = motions(cell.chain, joints)
    standing = [i for i, pair in enumerate(model.pairs) if not any(1 <= cell.shapes[s].link <= 6 for s in pair)]
    found = np.array([model.distances(links[n], standing_poses(cell, values[n]), standing) for n in range(len(joints))])
    assert {"box", "plate", "drum"} <= {name for i in standing for name in model.names(i)}
    assert (np.maximum(bounds[:, standing], 0) <= found + 1e-2).all()
    assert (found == 0).any(axis=1).sum() > 10
    assert (bounds[:, standing] > 0)[found > 200].mean() > 0.9  # and worth asking


@pytest.mark.parametrize("axis", ["stands", "turns", "slides", "tilts"])
def test_what_is_proven_along_a_way_is_free_between_its_places(cell: Cell, axis: str) -> None:
    assert cell.turntable is not None
    clamp = np.eye(4)
    clamp[:3, 3] = (0, 0, 600)
    cell = dataclasses.replace(
        cell,
        turntable=dataclasses.replace(cell.turntable, slides=axis == "slides"),
        shapes=(*cell.shapes, Shape("clamp", ON_TURNTABLE, "box", (600.0, 300.0, 900.0), clamp)),
    )
    if axis == "tilts":
        cell = tilted(dataclasses.replace(cell, may_touch=(*cell.may_touch, ("tilt", "floor"), ("turntable", "floor"))))
    rng = np.random.default_rng(12)
    pose = np.eye(4)
    pose[:3, 3] = (2000, -430, 1500) if axis == "turns" else (1300, -600, 1500)  # in the way of the clamp, or not
    full = dataclasses.replace(cell, shapes=(*cell.shapes, Shape("post", ON_BASE, "cylinder", (150.0, 1500.0), pose)))
    low, high = cell.chain.limits.T
    at, between = np.linspace(0, 1, 25), np.linspace(0, 1, 193)  # every place, and seven between
    start, go, bend = (rng.uniform(-1, 1, (80, 1, 6)) * size for size in ((high - low) / 2, 0.5, 0.3))
    table, screen = rng.uniform(-np.pi, np.pi, 80), CollisionScreen(full)

    def way(share: np.ndarray) -> np.ndarray:
        s = share[None, :, None]
        return np.asarray((low + high) / 2 + 0.8 * start + go * s + bend * np.sin(3 * s))

    def external(share: np.ndarray) -> np.ndarray:
        goes = {"stands": 0.0, "turns": 0.4, "slides": np.radians(600), "tilts": 0.3}[axis]
        turn = np.asarray(table[:, None] + goes * share + 0.1 * goes * np.sin(3 * share))
        return np.stack([0.6 * np.sin(turn), turn], axis=2) if axis == "tilts" else turn

    open_ = screen.swept(way(at), external(at))
    every = external(between).reshape(-1, *([2] if axis == "tilts" else []))
    hits = screen.hits(way(between).reshape(-1, 6), every).reshape(80, -1)
    met = [screen.pair(hit) for hit in np.unique(hits[hits != FREE])]
    assert axis != "turns" or {"clamp", "post"} in map(set, met)
    near = np.round(between * 24).astype(int)
    assert not (~open_[:, near] & (hits != FREE)).any()
    assert 0.05 < open_.mean() < 0.6
    assert (hits != FREE).any(axis=1).sum() > 10


def test_what_tool_and_part_may_be_off_keeps_their_bodies_farther_apart(cell: Cell) -> None:
    """By hand: the clearance, and twice what either is off; links of the robot are where its joints say."""
    rng = np.random.default_rng(7)
    q = rng.uniform(cell.chain.limits[:, 0], cell.chain.limits[:, 1], (300, 6))
    end = max(i for i, shape in enumerate(cell.shapes) if shape.body == "tool")
    cutter = dataclasses.replace(cell.shapes[end], body="cutter")
    cell = dataclasses.replace(cell, shapes=(*cell.shapes[:end], cutter, *cell.shapes[end + 1 :]))
    unsure = dataclasses.replace(
        cell, margin_mm=10.0, margins=dataclasses.replace(cell.margins, flange_mm=30, part_mm=40)
    )
    screen, around = CollisionScreen(unsure), {"floor", "turntable"}
    judged, nearer = screen.hits(q, np.zeros(300)), 0
    for one, hit in zip(q, judged, strict=True):
        near = set()
        for gap in CollisionModel(cell).gaps(one):
            off = np.hypot(
                30.0 * bool({"tool", "cutter"}.intersection(gap.pair)), 40.0 * bool(around.intersection(gap.pair))
            )
            if gap.distance_mm < 10 + 2 * off:
                near.add(gap.pair)
        assert (hit == FREE) == (not near)
        assert hit == FREE or screen.pair(hit) in near
        nearer += hit != FREE and CollisionModel(dataclasses.replace(cell, margin_mm=10.0)).collision(one) is None
    assert nearer > 10


def test_bodies_that_no_posture_takes_apart_are_named(cell: Cell) -> None:
    """A post through axis 1, a drum round it, but no wall beside it; fcl finds the same at random postures."""
    screen = CollisionScreen(cell)
    assert screen.always_near() is None
    pose = np.eye(4)
    pose[:3, 3] = 0, 0, 500
    drum = Shape("drum", ON_BASE, "cylinder", (3000.0, 300.0), pose)
    beside = pose.copy()
    beside[:3, 3] = -600, 0, 500
    wall = Shape("wall", ON_BASE, "box", (400.0, 400.0, 900.0), beside)
    for shape, named in ((drum, True), (wall, False)):
        here = dataclasses.replace(cell, shapes=(*cell.shapes, shape))
        found, model = CollisionScreen(here).always_near(), CollisionModel(here)
        assert (found is not None) == named
        if found:
            low, high = cell.chain.limits.T
            for q in np.random.default_rng(8).uniform(low, high, (50, 6)):
                assert found in {gap.pair for gap in model.gaps(q) if gap.near}
