"""Collision and clearance: by hand where shapes are simple, and against our own distance of two capsules."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import open3d
import pytest

from workbench.robot import Cell, CollisionModel, read_cell
from workbench.robot.kinematics import motions
from workbench.units import Float

from .conftest import plainly


def test_home_is_free_and_names_its_closest_pair(cell: Cell) -> None:
    model = CollisionModel(cell)
    assert model.collision(np.zeros(6)) is None
    found = model.clearance(np.zeros(6))
    assert found is not None
    assert found.distance_mm > 10


def test_forearm_in_the_floor(cell: Cell) -> None:
    down = np.radians([90.0, 80, 60, 0, 0, 0])
    pair = CollisionModel(cell).collision(down)
    assert pair is not None
    assert "floor" in pair
    clearance = CollisionModel(cell).clearance(down)
    assert clearance is not None
    assert clearance.distance_mm == 0


def test_height_above_the_floor(cell_file: Any) -> None:
    """With the floor and the flange alone, clearance is the flange's lowest point above z = 0."""
    everything = ["base_link", "link_1", "link_2", "link_3", "link_4", "link_5", "tool", "turntable"]

    def only_flange(tree: Any) -> None:
        plainly(tree)
        tree["may_touch"] = [[a, b] for a in [*everything, "link_6"] for b in [*everything, "floor"] if a != b]
        tree["may_touch"].remove(["link_6", "floor"])

    model = CollisionModel(read_cell(cell_file(only_flange)))
    found = model.clearance(np.zeros(6))
    assert found is not None
    assert found.pair == ("link_6", "floor")
    assert abs(found.distance_mm - (2260 - 80)) < 1e-3  # a disc of 80 mm upright at 2,260 mm


def test_margin_counts_as_collision(cell_file: Any) -> None:
    free = CollisionModel(read_cell(cell_file())).clearance(np.zeros(6))
    assert free is not None
    wide = read_cell(cell_file(lambda tree: tree.update(margin_mm=free.distance_mm + 1)))
    assert CollisionModel(wide).collision(np.zeros(6)) == free.pair


def test_turntable_carries_its_fixture(cell_file: Any) -> None:
    """A post on the turntable's rim stands in the arm's way at one angle and not at the opposite one."""
    post = {"name": "post", "on": "turntable", "pose": {"position_mm": [-450, 0, 820]}, "box_mm": [80, 80, 2600]}
    model = CollisionModel(read_cell(cell_file(lambda tree: tree["fixtures"].append(post))))
    assert model.collision(np.zeros(6), 0.0) is not None
    assert "post" in (model.collision(np.zeros(6), 0.0) or ())
    assert model.collision(np.zeros(6), np.pi) is None


LONG = {"pose": {"position_mm": [0, 0, -50]}, "box_mm": [1600, 200, 100]}  # a table along x at 0
POST = {"name": "post", "pose": {"position_mm": [2000, 700, 450]}, "box_mm": [60, 60, 900]}  # beside it, along y


def _table(tree: Any, *bodies: Any, tilts: bool = False, on: str = "base", **more: Any) -> None:
    """A table with bodies of its own, on a cradle or not, and a post on what carries it."""
    plainly(tree)
    tree["turntable"]["shapes"] = list(bodies)
    tree["fixtures"].append(POST | {"on": on} | more)
    if tilts:
        at = tree["turntable"]["base_from_turntable"]["position_mm"]
        tree["turntable"]["tilt"] = {
            "base_from_tilt": {"position_mm": [at[0], at[1], at[2] - 100], "quaternion_wxyz": [0.5, 0.5, 0.5, 0.5]},
            "shapes": [{"box_mm": [80, 80, 80]}],
        }


ON_THE_TILT = {"tilts": True, "on": "tilt", "pose": {"position_mm": [700, 0, 0]}, "box_mm": [60, 400, 60]}


@pytest.mark.parametrize("more", [{}, {"tilts": True}, ON_THE_TILT], ids=["one axis", "two axes", "on the tilt"])
def test_a_long_table_turns_into_a_post(cell_file: Any, more: Any) -> None:
    model = CollisionModel(read_cell(cell_file(lambda tree: _table(tree, LONG, **more))))
    assert model.collision(np.zeros(6), 0.0) is None
    assert set(model.collision(np.zeros(6), np.pi / 2) or ()) == {"turntable", "post"}


def told(cell: Cell, *bodies: str) -> list[str]:
    """What the cell says that it leaves out of the collision of two bodies."""
    pairs = [f"collision of {a} and {b}" for a, b in (bodies, bodies[::-1])]
    return [text for text in cell.unchecked if text.startswith(tuple(pairs))]


FOOT = {"pose": {"position_mm": [0, 0, -300]}, "box_mm": [200, 200, 400]}  # stands on the floor, however it turns


def test_where_a_table_stands_nothing_is_looked_at_nor_told(cell_file: Any) -> None:
    made = read_cell(cell_file(lambda tree: _table(tree, LONG, FOOT)))
    assert all(CollisionModel(made).collision(np.zeros(6), angle) is None for angle in (-0.4, 0.0, 0.4))
    assert not told(made, "turntable", "floor")
    lower = dict(FOOT, pose={"position_mm": [0, 0, -298]})  # a gap narrower than bodies must keep, however it turns
    made = read_cell(cell_file(lambda tree: (_table(tree, LONG, lower), tree.update(margin_mm=5))))
    assert CollisionModel(made).collision(np.zeros(6)) is None
    assert told(made, "turntable", "floor")


def test_a_table_that_meets_a_post_and_leaves_it_is_no_joint(cell_file: Any) -> None:
    across = LONG | {"box_mm": [200, 1600, 100]}
    made = read_cell(cell_file(lambda tree: _table(tree, across)))
    assert CollisionModel(made).collision(np.zeros(6), 0.0) == ("turntable", "post")
    assert CollisionModel(made).collision(np.zeros(6), np.pi / 2) is None


def test_what_may_touch_and_come_apart_is_told(cell_file: Any) -> None:
    made = read_cell(cell_file(lambda tree: (_table(tree, LONG, FOOT), tree.update(may_touch=[["turntable", "post"]]))))
    assert CollisionModel(made).collision(np.zeros(6), np.pi / 2) is None
    assert told(made, "turntable", "post")
    joint = read_cell(cell_file(lambda tree: (_table(tree, FOOT), tree.update(may_touch=[["base_link", "link_1"]]))))
    assert not told(joint, "base_link", "link_1")  # neighbours along the arm


def test_a_value_for_each_axis_is_asked_for(cell_file: Any) -> None:
    model = CollisionModel(read_cell(cell_file(lambda tree: _table(tree, LONG, tilts=True))))
    with pytest.raises(ValueError, match="argument"):
        model.collision(np.zeros(6), np.zeros(3))


def test_a_table_of_a_mesh_may_meet_what_it_stands_on_twice(cell_file: Callable[..., Path]) -> None:
    foot = open3d.geometry.TriangleMesh.create_box(200, 200, 400).translate((-100, -100, -500))
    path = cell_file(lambda tree: _table(tree, {"mesh": "foot.stl"}))
    assert open3d.io.write_triangle_mesh(str(path.parent / "foot.stl"), foot.compute_triangle_normals())
    made = read_cell(path)
    assert CollisionModel(made).collision(np.zeros(6), 0.3) is None
    assert told(made, "turntable", "floor")


def test_a_tool_that_turns_into_the_wrist_is_found(cell_file: Any) -> None:
    """A spindle hung back beside the wrist: apart at one angle of axis 6, in it where the wrist is wider."""
    back = {"pose": {"position_mm": [0, 140, -150]}, "box_mm": [60, 60, 200]}

    def change(tree: Any) -> None:
        plainly(tree)
        tree["tool"]["shapes"].append(back)

    path = cell_file(change)
    urdf = path.parent / "irb6700_150_320.urdf"
    wide = '<link name="link_5"><collision><origin xyz="0.1 0.15 0"/><geometry><box size="0.1 0.3 0.1"/></geometry>'
    text = urdf.read_text()
    at = text.index('<link name="link_5"')
    end = text.index("</link>", at)
    urdf.write_text(text[:at] + wide + "</collision>" + text[end:])
    model = CollisionModel(read_cell(path))
    hits = [model.collision(np.array([0, 0, 0, 0, 0, np.radians(deg)])) for deg in range(-180, 180, 15)]
    assert ("link_5", "tool") in hits
    assert None in hits


def test_capsules_against_our_own_distance(cell: Cell, postures: Any) -> None:
    """fcl's verdict on the capsules of the arm: two segments' distance less two radii."""
    model = CollisionModel(cell)
    shapes = cell.shapes
    pairs = [
        (a, b)
        for a, b in model.pairs
        if {shapes[a].kind, shapes[b].kind} == {"capsule"} and shapes[a].link >= 0 and shapes[b].link >= 0
    ]
    checked = 0
    for q in postures(60, 21):
        model._place(q, 0.0)
        moved = motions(cell.chain, q)
        for a, b in pairs:
            ends = [moved[shapes[i].link] @ shapes[i].pose for i in (a, b)]
            (radius_a, length_a), (radius_b, length_b) = shapes[a].size_mm, shapes[b].size_mm
            gap = segments(ends, [length_a, length_b]) - radius_a - radius_b
            if abs(gap) > 0.01:
                assert model._touch(a, b) == (gap < 0)
                checked += 1
            if gap > 0.01:
                assert abs(model._distance(a, b) - gap) < 1e-2
    assert checked > 400


def segments(poses: list[Float], lengths: list[float]) -> float:
    """Distance of two segments along z of their poses: of the lines where both feet lie inside, else of an end."""
    (a, u), (b, v) = ((pose[:3, 3], pose[:3, 2] * length) for pose, length in zip(poses, lengths, strict=True))
    feet = np.linalg.lstsq(np.column_stack([u, -v]), b - a, rcond=None)[0]
    if (np.abs(feet) <= 0.5).all():
        return float(np.linalg.norm(a + feet[0] * u - b - feet[1] * v))
    ends = [(a + t * u, b, v) for t in (-0.5, 0.5)] + [(b + t * v, a, u) for t in (-0.5, 0.5)]
    return min(float(np.linalg.norm(p - m - w * np.clip((p - m) @ w / (w @ w), -0.5, 0.5))) for p, m, w in ends)
