"""What the judge lets pass is free all along; what lies between the targets does not escape it."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.artefacts import Judgement, ProgramMove
from workbench.robot import Cell, CollisionModel, inverse_kinematics, read_cell, refusal
from workbench.robot.judge import judge

from .conftest import plainly
from .programs import START, driven, outsiders_least, program, shifted, start_pose, to

ROUTE = [(100, 0, 0), (100, 250, 0), (-50, 250, 60), (0, 0, 0)]


def kinds(found: Judgement) -> set[str]:
    return {violation.kind for violation in found.violations}


def route(cell: Cell, **more: Any) -> tuple[ProgramMove, ...]:
    a = start_pose(cell)
    return tuple(to(i, shifted(a, by, (0, 3 * i, 0)), **more) for i, by in enumerate(ROUTE, 2))


def test_a_free_program_passes_with_the_outsiders_numbers(cell: Cell) -> None:
    made = program(cell, *route(cell))
    found = judge(cell, made)
    assert found.passed, found.violations
    clearance, limit = outsiders_least(cell, made)
    assert clearance - 30 < found.clearance_mm < clearance + 0.01
    assert found.nearest.distance_mm == pytest.approx(clearance, abs=0.5)  # places are 5 mm apart, the outsider's 2
    assert 0 <= found.nearest.arc_length_mm <= found.length_mm
    assert found.limit_margin == pytest.approx(limit, abs=np.radians(0.1))
    assert found.length_mm == pytest.approx(100 + 250 + np.hypot(150, 60) + np.linalg.norm([50, 250, 60]), abs=0.01)
    assert found.time_s == pytest.approx(found.length_mm / 20, rel=1e-3)


def clamped(cell_file: Callable[..., Path], at: Any, size: float) -> Cell:
    def change(tree: Any) -> None:
        plainly(tree)
        box = {"name": "clamp", "pose": {"position_mm": list(map(float, at))}, "box_mm": [size] * 3}
        tree["fixtures"].append(box)

    return read_cell(cell_file(change))


def test_a_clamp_between_targets_100_mm_apart_is_found(cell: Cell, cell_file: Callable[..., Path]) -> None:
    """Both targets are free; the spindle runs through the clamp between them (studies of sparse points)."""
    a = start_pose(cell)
    axis = a[:3, 2]
    full = clamped(cell_file, a[:3, 3] + [0, 50, 0] - 60 * axis, 30.0)
    made = program(full, to(7, shifted(a, (0, 100, 0))))
    model = CollisionModel(full)
    _, joints, _ = driven(full, made)
    assert model.collision(joints[0]) is None
    assert model.collision(joints[-1]) is None
    assert any(model.collision(q) for q in joints)
    found = judge(full, made)
    assert not found.passed
    (hit,) = (violation for violation in found.violations if violation.kind == "collision")
    assert hit.line == 7
    assert 5 < hit.arc_length_mm < 95
    assert "clamp" in hit.finding
    assert "tool" in hit.finding
    assert judge(cell, made).passed


def test_a_bump_thinner_than_any_step_is_found(cell: Cell, cell_file: Callable[..., Path]) -> None:
    """A needle of 0.2 mm across the way: samples of half a millimetre may miss it."""
    a = start_pose(cell)
    thick = clamped(cell_file, a[:3, 3] + [0, 40.1, 0] - 30 * a[:3, 2], 10.0)
    needle = [dataclasses.replace(s, size_mm=(0.2,) * 3) if s.size_mm == (10.0,) * 3 else s for s in thick.shapes]
    thin = dataclasses.replace(thick, shapes=tuple(needle))
    assert (0.2,) * 3 in [shape.size_mm for shape in thin.shapes]
    assert not judge(thin, program(thin, to(2, shifted(a, (0, 100, 0))))).passed


def test_clearance_counts_and_the_uncertainty_of_tool_and_part(cell: Cell, cell_file: Callable[..., Path]) -> None:
    a = start_pose(cell)
    made = program(cell, to(2, shifted(a, (0, 100, 0))))
    beside = clamped(cell_file, a[:3, 3] + [0, 50, 0] - 30 * a[:3, 2] + np.array([0, 0, -16.0]), 10.0)
    gap = outsiders_least(beside, made)[0]
    assert 1 < gap < 50
    wide = dataclasses.replace(beside, margin_mm=gap + 0.05)
    tight = dataclasses.replace(beside, margin_mm=gap - 0.3)
    assert kinds(judge(wide, made)) == {"collision"}
    assert judge(tight, made).passed
    blurred = dataclasses.replace(tight, margins=dataclasses.replace(tight.margins, flange_mm=0.2))
    assert kinds(judge(blurred, made)) == {"collision"}


def test_what_stands_nearer_than_a_scan_lets_know_is_told(cell_file: Callable[..., Path]) -> None:
    """A table on a foot 6 mm above the floor, however it turns: enough for 5 mm, not for 2 u more."""

    def change(tree: Any) -> None:
        plainly(tree)
        tree["margin_mm"] = 5
        tree["turntable"]["shapes"] = [{"pose": {"position_mm": [0, 0, -294]}, "box_mm": [200, 200, 400]}]

    clear = read_cell(cell_file(change))
    vague = dataclasses.replace(clear, margins=dataclasses.replace(clear.margins, part_mm=1.0))
    told = [
        [text for text in judge(one, program(one, *route(one))).unchecked if "floor" in text] for one in (clear, vague)
    ]
    assert told[0] == []
    assert "6.0 mm apart" in told[1][0]


def test_a_joint_limit_between_targets(cell: Cell) -> None:
    """A sweep of the base axis: the limit is passed in the middle of nothing but by a joint move."""
    low, high = cell.chain.limits[0]
    there = START.copy()
    there[0] = high - np.radians(1.0)
    found = judge(cell, program(cell, ProgramMove(5, "J", "t", "base", joints=there)))
    assert kinds(found) == {"limit"}
    assert found.violations[0].line == 5
    assert "joint 1" in found.violations[0].finding
    there[0] = high - np.radians(2.1)
    assert judge(cell, program(cell, ProgramMove(5, "J", "t", "base", joints=there))).passed
    assert low < 0


def test_a_wrist_that_stretches_between_targets(cell: Cell) -> None:
    """q5 from +12 to -12 deg and back: both targets are sound, the way between passes the singularity."""
    start = np.radians([0, 30, 10, 0, 12, 0])
    end = start.copy()
    end[4] = -end[4]
    made = program(cell, to(3, start_pose(cell, end)), joints=start)
    found = judge(cell, made)
    assert "singular" in kinds(found)
    assert {violation.line for violation in found.violations} == {3}
    moved = program(cell, ProgramMove(3, "J", "t", "base", joints=end), joints=start)
    through = judge(cell, moved)
    assert through.passed  # the axes go through it unharmed
    assert np.isnan(through.condition), "no limit holds there"


def test_a_joint_that_cannot_follow(cell: Cell) -> None:
    made = program(cell, to(4, shifted(start_pose(cell), (0, 200, 0)), feed_mm_s=7000.0))
    found = judge(cell, made)
    assert kinds(found) == {"speed"}
    assert found.speed_share > 1
    slow = program(cell, to(4, shifted(start_pose(cell), (0, 200, 0)), feed_mm_s=700.0))
    assert judge(cell, slow).speed_share == pytest.approx(found.speed_share / 10, rel=0.01)


def test_accelerations_are_judged_where_they_are_stated(cell: Cell) -> None:
    strict = dataclasses.replace(cell, accelerations=np.full(6, np.radians(0.5)))
    a = start_pose(cell)
    moves = (
        to(2, shifted(a, (0, 100, 0)), feed_mm_s=200.0, zone_mm=1.0),
        to(3, shifted(a, (80, 150, 0)), feed_mm_s=200.0),
    )
    assert "acceleration" in kinds(judge(strict, program(strict, *moves)))
    assert judge(cell, program(cell, *moves)).passed


def test_corners_are_rounded_within_their_zone(cell: Cell) -> None:
    sharp, round_ = (judge(cell, program(cell, *route(cell, zone_mm=zone))) for zone in (0.0, 20.0))
    assert sharp.passed
    assert round_.passed
    assert round_.length_mm < sharp.length_mm - 5


@pytest.mark.parametrize(
    ("move", "finding"),
    [
        (lambda a: ProgramMove(9, "J", "t", "base", pose=a), "a joint move to a pose"),
        (lambda a: ProgramMove(9, "J", "t", "base", joints=START, zone_mm=5.0), "a joint move that blends"),
        (lambda a: to(9, shifted(a, (0, 0, 0), (175, 0, 0))), "turns by 175 deg"),
        (
            lambda a: ProgramMove(9, "C", "t", "base", pose=shifted(a, (9, 0, 0)), via=shifted(a, (4, 0, 0))),
            "on a line",
        ),
        (lambda a: ProgramMove(9, "L", "other", "base", pose=a), "the tool 'other' is neither"),
        (lambda a: ProgramMove(9, "L", "t", "elsewhere", pose=a), "the work object 'elsewhere' is neither"),
    ],
)
def test_what_no_way_can_be_made_of(cell: Cell, move: Callable[[Any], ProgramMove], finding: str) -> None:
    found = judge(cell, program(cell, move(start_pose(cell))))
    assert not found.passed
    assert found.violations[0].line == 9
    assert finding in found.violations[0].finding


def test_configurations_are_held_against_the_program(cell: Cell) -> None:
    def quadrants(joints: Any, cell: Cell) -> tuple[int, ...]:
        return tuple(int(np.floor(q / (np.pi / 2))) for q in joints)

    a = start_pose(cell)
    made = program(cell, to(2, shifted(a, (0, 50, 0)), configuration=(0, 0, 0, -1, 0, 0)))
    right = judge(cell, made, configuration=quadrants)
    there = driven(cell, made)[1][-1]
    assert right.passed == (quadrants(there, cell) == (0, 0, 0, -1, 0, 0))
    wrong = program(cell, to(2, shifted(a, (0, 50, 0)), configuration=(7, 7, 7, 7, 7, 7)))
    assert kinds(judge(cell, wrong, configuration=quadrants)) == {"configuration"}


def test_what_a_turntable_carries_runs_into_nothing_that_stands(cell_file: Callable[..., Path]) -> None:
    """A beam on the turntable, swung through a post between two places that are free; both thin, as it stays short."""

    beam = {"name": "beam", "on": "turntable", "pose": {"position_mm": [0, 0, 30]}, "box_mm": [4, 1800, 40]}
    post = {"name": "post", "pose": {"position_mm": [2220, 820, 500]}, "box_mm": [4, 4, 1000]}

    def change(tree: Any) -> None:
        plainly(tree)
        tree["fixtures"] += [beam, post]

    cell, turned = read_cell(cell_file(change)), np.radians(-30)
    for angle in (0.0, turned):
        assert CollisionModel(cell).collision(START, angle) is None
    found = judge(cell, program(cell, to(2, start_pose(cell), turntable=turned)))
    (fault,) = [fault for fault in found.violations if fault.kind == "collision"]
    assert "beam" in fault.finding
    assert "post" in fault.finding


def test_the_ways_to_and_from_where_the_operator_looks_are_driven(cell_file: Callable[..., Path]) -> None:
    """A clamp where the spindle is 400 mm back from the cut, and not 50."""
    joints, feed = START + np.radians([[0.0] * 6, [1.0, 0, 0, 0, 0, 0]]), np.full(2, 20.0)

    def found(probe: Any) -> Any:
        def change(tree: Any) -> None:
            clamp = {"name": "clamp", "pose": {"position_mm": [2760, -30, 1010]}, "box_mm": [40, 40, 40]}
            tree["fixtures"].append(clamp)
            tree["process"]["probe"] = probe

        return refusal(read_cell(cell_file(change)), joints, np.zeros(2), feed, 0)

    assert found(None) is None
    assert found({"distance_mm": 60}) is None
    assert found({"distance_mm": 400}) == ("collision", ("tool", "clamp"))
    kind, _ = found({"distance_mm": 900})
    assert kind == "unreachable"


def test_an_axis_that_crosses_a_boundary_within_a_corner_counts_as_both(cell: Cell) -> None:
    """24 laws whose joint 1 crosses 0 about a target that is passed by: what is said of the target itself holds."""

    def quarters(joints: Any, cell: Cell) -> tuple[int, ...]:
        return tuple(int(np.floor(q / (np.pi / 2))) for q in joints[[0]])

    rng, free = np.random.default_rng(5), []
    for _ in range(24):
        start = START + np.append(np.radians(rng.uniform(0.4, 1.5)), np.zeros(5))
        a = start_pose(cell, start)
        corner = shifted(a, (rng.uniform(-9, 9), rng.uniform(-2, 2) - a[1, 3], 0))
        end = shifted(corner, (rng.uniform(-9, 9), -30, 0))
        target = inverse_kinematics(cell.chain, corner[None] @ np.linalg.inv(cell.flange_from_cutter))[0]
        said = quarters(target[np.nanargmin(np.abs(target - start).max(axis=1))], cell)
        made = program(cell, to(2, corner, zone_mm=5.0, configuration=said), to(3, end), joints=start)
        free.append("configuration" not in kinds(judge(cell, made, configuration=quarters)))
        far = program(cell, to(2, corner, zone_mm=5.0, configuration=(said[0] + 5,)), to(3, end), joints=start)
        free.append("configuration" in kinds(judge(cell, far, configuration=quarters)))
    assert all(free)
