"""Collision and clearance: by hand where shapes are simple, and against our own distance of two capsules."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import open3d
import pytest

from workbench.robot import Cell, CollisionModel, read_cell

from .conftest import plainly


def test_height_above_the_floor(cell_file: Any) -> None:
    """With the floor and the flange alone, clearance is the flange's lowest point above z = 0."""
    everything = ["base_link", "link_1", "link_2", "link_3", "link_4", "link_5", "tool", "turntable"]

    def only_flange(tree: Any) -> None:
        plainly(tree)
        tree["may_touch"] = [[a, b] for a in [*everything, "link_6"] for b in [*everything, "floor"] if a != b]
        tree["may_touch"].remove(["link_6", "floor"])

    model = CollisionModel(read_cell(cell_file(only_flange)))
    found = model.gaps(np.zeros(6))[0]
    assert found.pair == ("link_6", "floor")
    assert abs(found.distance_mm - (2260 - 80)) < 1e-3  # a disc of 80 mm upright at 2,260 mm


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


LYING = {"pose": LONG["pose"] | {"quaternion_wxyz": [0.5**0.5, 0, 0.5**0.5, 0]}, "cylinder_mm": [50, 1600]}
BESIDE = {"pose": {"position_mm": [700, 0, -50]}, "cylinder_mm": [100, 100]}  # upright, but off the axis
HINGED = {  # its far end is on the axis
    "pose": {"position_mm": [801.56, 0, -50], "quaternion_wxyz": [0.5**0.5, 0, -(0.5**0.5), 0]},
    "cylinder_mm": [50, 1600],
}


@pytest.mark.parametrize(
    ("table", "more"),
    [(LONG, {}), (LONG, {"tilts": True}), (LONG, ON_THE_TILT), (LYING, {}), (BESIDE, {}), (HINGED, {})],
    ids=["one axis", "two axes", "on the tilt", "a lying cylinder", "a cylinder beside", "one from the axis outwards"],
)
def test_a_long_table_turns_into_a_post(cell_file: Any, table: Any, more: Any) -> None:
    model = CollisionModel(read_cell(cell_file(lambda tree: _table(tree, table, **more))))
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
    for above_mm in (0.5, 2.0):  # gaps narrower than bodies must keep, however it turns
        foot = dict(FOOT, pose={"position_mm": [0, 0, above_mm - 300]})
        made = read_cell(cell_file(lambda tree, foot=foot: (_table(tree, LONG, foot), tree.update(margin_mm=5))))
        assert CollisionModel(made).collision(np.zeros(6)) is None
        assert bool(told(made, "turntable", "floor")) == (above_mm > 1)


def test_only_an_axis_own_body_is_borne(cell_file: Any) -> None:
    clamp = {"name": "clamp", "on": "turntable", **FOOT}
    model = CollisionModel(read_cell(cell_file(lambda tree: (_table(tree, LONG), tree["fixtures"].append(clamp)))))
    assert set(model.collision(np.zeros(6)) or ()) == {"floor", "clamp"}
    rail = {"name": "rail", "pose": {"position_mm": [0, 0, 100]}, "box_mm": [5000, 300, 300]}

    def change(tree: Any) -> None:
        plainly(tree)
        del tree["turntable"]
        tree["track"] = {"direction": [1, 0, 0], "limits_mm": [-400, 400], "speed_mm_s": 1000}
        tree["fixtures"] = [rail]

    cell = read_cell(cell_file(change))
    named = (replace(one, body="turntable") if one.body == "rail" else one for one in cell.shapes)  # of no table
    model = CollisionModel(replace(cell, shapes=tuple(named)))
    assert set(model.collision(np.zeros(6)) or ()) == {"base_link", "turntable"}


@pytest.mark.parametrize("turns", [False, True], ids=["the post", "the table"])
def test_a_mesh_is_borne_by_what_is_round(cell_file: Any, turns: bool) -> None:
    disc = {"pose": {"position_mm": [0, 0, -50]}, "cylinder_mm": [300, 100]}
    post = {"name": "post", "pose": {"position_mm": [2000, 0, 0]}}

    def change(tree: Any) -> None:
        _table(tree, {"mesh": "block.stl"} if turns else disc)
        tree["fixtures"][-1] = post | ({"cylinder_mm": [50, 1100]} if turns else {"mesh": "block.stl"})

    path = cell_file(change)
    block = open3d.geometry.TriangleMesh.create_box(80, 60, 405)
    assert open3d.io.write_triangle_mesh(str(path.parent / "block.stl"), block.compute_triangle_normals())
    made = read_cell(path)
    assert CollisionModel(made).collision(np.zeros(6)) is None
    assert not told(made, "turntable", "post")


def test_a_table_that_meets_a_post_and_leaves_it_is_no_joint(cell_file: Any) -> None:
    across = LONG | {"box_mm": [200, 1600, 100]}
    made = read_cell(cell_file(lambda tree: _table(tree, across)))
    assert CollisionModel(made).collision(np.zeros(6), 0.0) == ("turntable", "post")
    assert CollisionModel(made).collision(np.zeros(6), np.pi / 2) is None


def test_what_may_touch_and_come_apart_is_told(cell_file: Any) -> None:
    made = read_cell(cell_file(lambda tree: (_table(tree, LONG, FOOT), tree.update(may_touch=[["turntable", "post"]]))))
    assert CollisionModel(made).collision(np.zeros(6), np.pi / 2) is None
    assert told(made, "turntable", "post")
    touch = [["base_link", "link_1"], ["link_4", "tool"], ["turntable", "floor"]]
    joint = read_cell(cell_file(lambda tree: (_table(tree, LONG, FOOT), tree.update(may_touch=touch))))
    assert not told(joint, "turntable", "floor")  # one stands on it, the other far above
    assert not told(joint, "base_link", "link_1")  # neighbours along the arm
    assert told(joint, "link_4", "tool")  # two joints between them


@pytest.mark.parametrize(("limit_deg", "comes_apart"), [(2, False), (90, True)])
def test_what_may_touch_is_told_if_it_comes_apart_within_limits(cell_file, limit_deg, comes_apart):
    def change(tree: Any) -> None:
        _table(tree, LONG, pose={"position_mm": [2700, 0, 205]}, box_mm=[60, 60, 400])  # 5 mm deep in the table
        tree["turntable"]["limits_deg"] = [-limit_deg, limit_deg]

    assert CollisionModel(read_cell(cell_file(change))).collision(np.zeros(6)) == ("turntable", "post")
    allowed = cell_file(lambda tree: (change(tree), tree.update(may_touch=[["turntable", "post"]])))
    assert bool(told(read_cell(allowed), "turntable", "post")) == comes_apart


@pytest.mark.parametrize("more", [{}, {"tilts": True}, {"tilts": True, "on": "tilt"}])
def test_what_a_later_scan_may_touch_is_told_whatever_its_size(cell_file: Any, more: Any) -> None:
    touch = [["workpiece", "post"], ["cutter", "workpiece"]]

    def change(tree: Any) -> None:
        _table(tree, LONG, **more)
        tree["may_touch"] = touch
        tree["tool"]["shapes"][2]["body"] = "cutter"

    made = read_cell(cell_file(change))
    assert told(made, "workpiece", "post")
    assert not told(made, "cutter", "workpiece")


SLOPED = {  # a stand whose top is 12 deg off level: the table is 12 to 100 mm deep in it
    "pose": {"position_mm": [2000, 0, 268], "quaternion_wxyz": [np.cos(np.pi / 30), np.sin(np.pi / 30), 0, 0]},
    "box_mm": [100, 1500, 300],
}


def test_what_always_touches_but_not_alike_is_told(cell_file: Any) -> None:
    made = read_cell(cell_file(lambda tree: _table(tree, LONG, **SLOPED)))
    assert CollisionModel(made).collision(np.zeros(6), np.pi / 2) is None
    assert told(made, "turntable", "post")
    touch = [["turntable", "post"], ["tool", "link_5"]]
    made = read_cell(cell_file(lambda tree: (_table(tree, LONG, **SLOPED), tree.update(may_touch=touch))))
    assert any("$.may_touch" in text for text in told(made, "post", "turntable"))
    assert not told(made, "link_5", "tool")  # round about axis 6


def test_a_cradle_and_a_tool_are_borne_by_what_carries_them(cell_file: Any) -> None:
    bearing = {"tilts": True, "pose": {"position_mm": [2000, 0, 340]}, "box_mm": [300, 60, 60]}
    made = read_cell(cell_file(lambda tree: _table(tree, **bearing)))
    assert told(made, "tilt", "post")
    assert CollisionModel(made).collision(np.zeros(6), np.zeros(2)) is None
    path = cell_file(lambda tree: (plainly(tree), tree["tool"]["shapes"].append({"box_mm": [60, 500, 400]})))
    _wrist(path, '<origin xyz="0.05 0 0"/><geometry><box size="0.2 0.6 0.1"/></geometry>')
    made = read_cell(path)
    assert told(made, "link_5", "tool")
    assert CollisionModel(made).collision(np.zeros(6)) is None


def test_a_table_may_meet_its_cradle_where_the_base_is_far(cell_file: Any) -> None:
    arm = {"pose": {"position_mm": [700, 0, 0]}, "box_mm": [60, 60, 400]}

    def change(tree: Any) -> None:
        _table(tree, LONG, tilts=True)
        tree["turntable"]["tilt"]["shapes"].append(arm | {"pose": {"position_mm": [0, 100, 700]}})

    assert CollisionModel(read_cell(cell_file(change))).collision(np.zeros(6), np.zeros(2)) == ("turntable", "tilt")


@pytest.mark.parametrize("gap_mm", [0.0, 2.0])
def test_a_table_of_a_mesh_may_meet_what_it_stands_on_twice(cell_file: Callable[..., Path], gap_mm: float) -> None:
    foot = open3d.geometry.TriangleMesh.create_box(200, 200, 400).translate((-100, -100, gap_mm - 500))
    path = cell_file(lambda tree: (_table(tree, {"mesh": "foot.stl"}), tree.update(margin_mm=5)))
    assert open3d.io.write_triangle_mesh(str(path.parent / "foot.stl"), foot.compute_triangle_normals())
    made = read_cell(path)
    assert CollisionModel(made).collision(np.zeros(6), 0.3) is None
    assert told(made, "turntable", "floor")


def _wrist(path: Path, shape: str) -> None:
    """Give link 5 of a cell's robot another body."""
    urdf = path.parent / "irb6700_150_320.urdf"
    text = urdf.read_text()
    at = text.index('<link name="link_5"')
    end = text.index("</link>", at)
    urdf.write_text(f'{text[:at]}<link name="link_5"><collision>{shape}</collision>{text[end:]}')


def test_a_tool_that_turns_into_the_wrist_is_found(cell_file: Any) -> None:
    """A spindle hung back beside the wrist: apart at one angle of axis 6, in it where the wrist is wider."""
    back = {"pose": {"position_mm": [0, 140, -150]}, "box_mm": [60, 60, 200]}

    def change(tree: Any) -> None:
        plainly(tree)
        tree["tool"]["shapes"].append(back)

    path = cell_file(change)
    _wrist(path, '<origin xyz="0.1 0.15 0"/><geometry><box size="0.1 0.3 0.1"/></geometry>')
    model = CollisionModel(read_cell(path))
    hits = [model.collision(np.array([0, 0, 0, 0, 0, np.radians(deg)])) for deg in range(-180, 180, 15)]
    assert ("link_5", "tool") in hits
    assert None in hits
