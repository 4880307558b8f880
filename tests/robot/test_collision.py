"""Collision and clearance: by hand where shapes are simple, and against our own distance of two capsules."""

from typing import Any

import numpy as np

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
