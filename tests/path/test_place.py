"""No path is passed whose place nothing shows; recordings that are wrong as a whole are told by touched points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.recordings import frames
from tests.seldom import seldom
from workbench import cloud as clouds
from workbench import edge, path, scan
from workbench.api import inverse
from workbench.artefacts import Check, Cloud, PathGate, PointSet, RawEdge, Recording, Toolpath
from workbench.errors import InputError
from workbench.units import Float

DATA = Path(__file__).parents[2] / "data" / "synthetic"
Spoil = Callable[[Recording], Recording]


def planned(recording: Recording) -> tuple[Toolpath, RawEdge, Cloud]:
    points = clouds.denoise(scan.fuse(recording))
    raw = edge.segment_raw(points, upper_side=[0, 0, 1])
    return path.feed(path.layers(raw, points), points, raw), raw, points


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Half of an arc: less to fit."""
    whole = scan.read(recording=DATA / "raw_arc.h5")
    return frames(whole, np.arange(len(whole.time_s) // 2))


@pytest.fixture(scope="module")
def sound(recording: Recording) -> tuple[Toolpath, RawEdge, Cloud]:
    return planned(recording)


@pytest.fixture(scope="module")
def touched(sound: tuple[Toolpath, RawEdge, Cloud]) -> list[tuple[float, float, float]]:
    """On the end face and on the upper surface, at both ends and in the middle, as the true scan has them."""
    _, raw, points = sound
    everywhere, found = points.points_mm, []
    for i in np.linspace(0.08, 0.92, 3) * (len(raw.arc_length_mm) - 1):
        at = int(i)
        upper = raw.upper_position_mm[at]
        places = ((raw.position_mm[at] + upper) / 2, *(upper + mm * raw.upper_inward[at] for mm in (4, 14)))
        found += [everywhere[np.linalg.norm(everywhere - place, axis=1).argmin()] for place in places]
    return [tuple(place.tolist()) for place in found]


def gate_of(plan: tuple[Toolpath, RawEdge, Cloud], **more: object) -> PathGate:
    toolpath, raw, points = plan
    return path.check(toolpath, raw, points, **more)


def test_a_sound_scan_is_a_shape_until_something_shows_its_place(sound, touched):
    alone = gate_of(sound)
    assert (alone.passed, alone.clean, alone.shape_only) == (True, False, True)
    assert any("turned by 1 deg about the flange's x, y, z it moves the path by" in said for said in alone.unchecked)
    placed = gate_of(sound, touched_mm=touched)
    assert (placed.clean, placed.shape_only) == (True, False)
    assert not any("hand-eye pose: turned" in said for said in placed.unchecked)
    one_face = gate_of(sound, touched_mm=touched[::3])
    assert one_face.shape_only
    assert "the touched points leave" in one_face.cause
    in_the_middle = gate_of(sound, touched_mm=touched[3:6])
    assert in_the_middle.shape_only


def test_points_that_all_lie_to_one_side_of_the_scan_contradict_it(sound, touched) -> None:
    """Each by less than the surface's own uncertainty, all by the same: the part stands there, not where it was."""
    _, raw, _ = sound
    aside = 0.45 * (raw.normal[raw.seen].mean(axis=0) + raw.across[raw.seen].mean(axis=0))
    together = [tuple((place + aside).tolist()) for place in np.array(touched)]
    refused = gate_of(sound, touched_mm=together)
    assert not refused.passed
    assert "mm beside the scan, together" in refused.reason
    told = [float(value) for value in refused.reason.split("by (")[1].split(")")[0].split(", ")]
    assert np.allclose(told, aside, atol=0.15)
    by_chance = np.random.default_rng(2).normal(0.0, 0.15, (len(touched), 3)).clip(-0.3, 0.3)
    assert gate_of(sound, touched_mm=[tuple(one) for one in (np.array(touched) + by_chance).tolist()]).clean


def test_a_scan_that_stops_on_the_edge_says_what_leads_mill_beyond_it(sound) -> None:
    toolpath, raw, points = sound
    said = [one for one in gate_of(sound).unchecked if "part beyond the scan" in one]
    assert len(said) == 1
    inner = (raw.frame_arc_length_mm > 5.0) & (raw.frame_arc_length_mm < raw.arc_length_mm[-1] - 5.0)
    ended = replace(raw, frame_arc_length_mm=np.where(inner, raw.frame_arc_length_mm, np.nan))
    assert not any("part beyond the scan" in one for one in gate_of((toolpath, ended, points)).unchecked)


def test_a_pose_that_the_recording_has_beside_the_calibration_is_told_with_its_size(sound) -> None:
    toolpath, raw, points = sound
    other = points.flange_from_profiler @ pose((0, 0, 0), (5.0, 0, 0))
    told = gate_of((toolpath, raw, replace(points, recorded_flange_from_profiler=other))).unchecked
    assert any("the path lies 5.0 mm elsewhere" in one for one in told)
    assert not any("elsewhere" in one for one in gate_of(sound).unchecked)


@pytest.mark.parametrize("mm", [0.5, 2.0])
def test_points_touched_beside_the_edge_are_measured_from_the_face_they_lie_on(sound, touched, mm):
    """On end face and upper surface, `mm` from where they meet; half a millimetre and more off either is told."""
    _, raw, _ = sound
    beside: list[Float] = []
    for at in (np.array([0.1, 0.9]) * (len(raw.arc_length_mm) - 1)).astype(int):
        upper, inward = raw.upper_position_mm[at], raw.upper_inward[at]
        down = raw.position_mm[at] - upper
        down /= np.linalg.norm(down)
        beside += [upper + mm * down, upper + mm * inward]
    placed = gate_of(sound, touched_mm=[*touched, *beside])
    assert (placed.clean, placed.cause) == (True, gate_of(sound, touched_mm=touched).cause)
    out = -raw.upper_inward.mean(axis=0)
    assert "mm off the scanned surface" in gate_of(sound, touched_mm=[beside[0] + 0.7 * out]).reason


def test_a_point_touched_among_scattered_returns_lies_on_no_face(sound, touched):
    """As where a clamp or chips returned: a plane through these would pass for the surface."""
    toolpath, raw, points = sound
    away = np.full(points.keep.shape, np.inf)
    away[points.keep] = np.linalg.norm(points.points_mm - touched[0], axis=1)
    scattered = points.z_mm + np.where(away < 8.0, np.random.default_rng(2).normal(0.0, 3.0, away.shape), 0.0)
    placed = gate_of((toolpath, raw, replace(points, z_mm=scattered.astype(np.float32))), touched_mm=touched)
    assert not placed.passed
    assert "touched point 1 lies nowhere on the scanned surface" in placed.reason


def test_two_passes_turned_about_the_edge_show_the_place(sound: tuple[Toolpath, RawEdge, Cloud]) -> None:
    """Where they see the edge in one place; turned about another axis they would share the hand-eye's error."""
    toolpath, raw, points = sound
    agree = Check("pass_disagreement_mm", 0.01, 0.1, True, "", "")
    told = tuple(one for one in toolpath.evidence if one.name != agree.name)
    second = np.arange(len(points.time_s)) >= len(points.time_s) // 2
    middle = np.flatnonzero(second)[second.sum() // 2]
    cases = ((raw.tangent, 20.0, (agree,), True), (raw.tangent, 0.0, (agree,), False))
    cases += ((raw.normal, 20.0, (agree,), False), (raw.tangent, 20.0, (), False))
    for about, deg, evidence, shown in cases:
        axis = about[raw.seen].mean(axis=0)
        pose, keep = points.base_from_profiler.copy(), points.keep.copy()
        turn = Rotation.from_rotvec(deg * axis / np.linalg.norm(axis), degrees=True)
        pose[middle, :3, :3], keep[middle] = turn.as_matrix() @ pose[middle, :3, :3], False
        cloud = replace(points, base_from_profiler=pose, keep=keep, pass_index=second.astype(np.int64))
        assert gate_of((replace(toolpath, evidence=told + evidence), raw, cloud)).shape_only != shown


def test_what_1_deg_costs_is_the_lever_of_the_hand_eye(sound: tuple[Toolpath, RawEdge, Cloud]) -> None:
    """Against the path of the same recording with a hand-eye that is turned by 1 deg: to a fifth, as arms differ."""
    toolpath, _, points = sound
    said = next(text for text in gate_of(sound).unchecked if "1 deg about the flange" in text)
    told = [float(number) for number in said.split("path by ")[1].removesuffix(" mm").split(", ")]
    flange = points.base_from_profiler @ inverse(points.flange_from_profiler)
    places = np.concatenate([layer.position_mm for layer in toolpath.layers])
    at = np.linalg.norm(places[:, None] - flange[None, :, :3, 3], axis=2).argmin(axis=1)
    arm = np.einsum("nji,nj->ni", flange[at, :3, :3], places - flange[at, :3, 3])
    for axis, mm in enumerate(told):
        turn = Rotation.from_rotvec(np.eye(3)[axis], degrees=True).as_matrix()
        moved = np.linalg.norm(arm @ turn.T - arm, axis=1)
        assert np.sqrt((moved**2).mean()) == pytest.approx(mm, rel=0.2, abs=0.1)


def turned(recording: Recording, hand_eye: Float) -> Recording:
    return replace(recording, flange_from_profiler=recording.flange_from_profiler @ hand_eye)


def pose(rotvec_deg: tuple[float, float, float], mm: tuple[float, float, float]) -> Float:
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = Rotation.from_rotvec(rotvec_deg, degrees=True).as_matrix(), mm
    return made


def tools_position(one: Recording) -> Recording:
    turns = Rotation.from_quat(one.robot_quaternion_wxyz, scalar_first=True)
    return replace(one, robot_position_mm=one.robot_position_mm + turns.apply([40.0, -60, 90]))


def table_turning(one: Recording) -> Recording:
    share = (one.robot_time_s - one.robot_time_s[0]) / np.ptp(one.robot_time_s)
    middle = one.robot_position_mm.mean(axis=0)
    turns = Rotation.from_rotvec(np.outer(share, [0, 0, 1.0]), degrees=True)
    return replace(one, robot_position_mm=turns.apply(one.robot_position_mm - middle) + middle)


def tracked(one: Recording) -> Recording:
    middle = np.nanmean(np.where(np.isfinite(one.z_mm), one.x_mm, np.nan), axis=1, keepdims=True)
    return replace(one, x_mm=(one.x_mm - middle).astype(np.float32))


WRONG: dict[str, Spoil] = {
    "profiles tracked": tracked,
    "position of the tool, orientation of the flange": tools_position,
    "hand-eye turned and moved": lambda one: turned(one, pose((15, 0, 0), (0, 12, 0))),
    "robot in another base": lambda one: replace(one, robot_position_mm=one.robot_position_mm + np.array([0, 0, 525])),
    "turntable turning by 1 deg": table_turning,
    "z scale 5 % off": lambda one: replace(one, z_mm=(1.05 * one.z_mm).astype(np.float32)),
}
OFTEN = ("profiles tracked", "hand-eye turned and moved", "turntable turning by 1 deg", "z scale 5 % off")


@pytest.mark.parametrize("kind", [*OFTEN, *seldom(*(kind for kind in WRONG if kind not in OFTEN))])
def test_a_recording_that_is_wrong_as_a_whole_never_passes(recording, sound, touched, kind):
    """Not alone, and not with points that were touched where the part really is, but where it lies within 1 mm."""
    try:
        plan = planned(WRONG[kind](frames(recording, np.arange(0, len(recording.time_s), 3))))
    except InputError:
        return
    assert not gate_of(plan).clean
    true, found = sound[0].layers[-1].position_mm, plan[0].layers[-1].position_mm
    off = max(np.linalg.norm(true - place, axis=1).min() for place in found[10:-10])
    assert not gate_of(plan, touched_mm=touched).clean or off < 1.0


def test_what_a_cloud_without_poses_leaves_open_moves_the_path_by_what_is_said() -> None:
    """The path turned by 1 deg, mirrored and stretched by 1 %: the frame, the handedness, the scale."""
    points = clouds.read(file=DATA / "raw_edge.laz")
    mirrored = replace(points, points_mm=points.points_mm * [-1, 1, 1])
    assert isinstance(points, PointSet)
    gridded, raw = edge.segment_cloud(mirrored, upper_side=[0, 0, 1])
    plan = path.feed(path.layers(raw, gridded), gridded, raw)
    gate = path.check(plan, raw, gridded)
    assert gate.shape_only
    places = np.concatenate([plan.in_base(layer.position_mm) for layer in plan.layers])
    turned = [Rotation.from_rotvec(axis, degrees=True).apply(places) - places for axis in np.eye(3)]
    costs = {
        "frame: turned": [np.sqrt((moved**2).sum(axis=1).mean()) for moved in turned],
        "handedness": [2 * abs(places[:, k]).mean() for k in range(3)],
        "scale": [np.linalg.norm(np.ptp(1.01 * places, axis=0)) - np.linalg.norm(np.ptp(places, axis=0))],
    }
    for what, expected in costs.items():
        (said,) = (text for text in gate.unchecked if what in text)
        told = said.split("the path by ")[-1].split(" is ")[-1].split(" mm")[0].split(", ")
        assert [float(one) for one in told] == pytest.approx(expected, rel=0.01, abs=0.51 if "hand" in what else 0.06)
