"""`path.simplify` against a controller of our own that runs the moves: lines, circles through three points, slerp."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from workbench.artefacts import Layer, Toolpath, Travel
from workbench.errors import InputError
from workbench.path import simplify

from ..program.paths import Shape, all_points, circle, deviations, mill_path, run_move

SHAPES = {
    "straight": Shape(),
    "convex 300": Shape(bend=1 / 300),
    "convex 3000": Shape(bend=1 / 3000),
    "concave 300": Shape(bend=-1 / 300),
    "convex 300, wave": Shape(bend=1 / 300, wave_mm=0.01),
}


def run(path, moves):
    points, quaternions, _ = all_points(path)
    new = np.append(True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9)
    return deviations(points[new], quaternions[new], moves.position_mm, moves.quaternion_wxyz, moves.via_position_mm)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_key_points_stay_within_the_tolerances_at_a_tenth_of_the_targets(shape: Shape) -> None:
    path = mill_path(shape)
    moves = simplify(path)
    off_mm, off_deg = run(path, moves)
    assert off_mm.max() <= 0.01 + 1e-5
    assert off_deg.max() <= 0.05 + 1e-4
    assert moves.points_before == len(all_points(path)[0])
    assert 10 * len(moves.layer) <= moves.points_before


@pytest.mark.parametrize("shape", [SHAPES["convex 300"], SHAPES["concave 300"]], ids=["convex", "concave"])
def test_an_arc_of_300_mm_is_one_circular_move_a_stretch(shape: Shape) -> None:
    moves = simplify(mill_path(shape))
    cuts = moves.circular & moves.cutting
    assert cuts.sum() == 2
    for k in np.flatnonzero(cuts):
        centre, _, sweep = circle(moves.position_mm[k - 1], moves.via_position_mm[k], moves.position_mm[k])
        radius = np.linalg.norm(moves.position_mm[k] - centre)
        assert radius * sweep == pytest.approx(600 * radius / 300, rel=0.01)


def test_a_controller_off_its_circle_is_noticed() -> None:
    """The tests above rest on it."""
    path = mill_path(SHAPES["convex 300"])
    moves = simplify(path)
    assert run(path, replace(moves, via_position_mm=moves.via_position_mm + np.array([0, 0, 0.03])))[0].max() > 0.02
    turned = np.where(moves.cutting[:, None], moves.quaternion_wxyz @ np.eye(4)[[1, 0, 2, 3]], moves.quaternion_wxyz)
    assert run(path, replace(moves, quaternion_wxyz=turned))[1].max() > 1


@pytest.mark.parametrize("bend", [0, 1 / 300])
def test_cutting_measured_and_layer_change_at_targets_only(bend: float) -> None:
    path = mill_path(Shape(bend=bend, lifted_mm=(200, 300)))
    moves = simplify(path)
    for layer in path.layers:
        change = np.flatnonzero(np.diff(2 * layer.cutting + layer.measured))
        for i in [0, *change, len(layer.cutting) - 1]:
            assert np.linalg.norm(moves.position_mm - layer.position_mm[i], axis=1).min() == 0
        cuts = np.flatnonzero((moves.layer == layer.index) & moves.cutting)
        length = sum(np.linalg.norm(np.diff(way(moves, k), axis=0), axis=1).sum() for k in cuts)
        assert length == pytest.approx(600 - 100 - 20, rel=0.01)
    assert run(path, moves)[0].max() <= 0.01 + 1e-5
    assert set(moves.layer.tolist()) == {0, 1, 2}


def test_the_feed_of_a_move_is_its_slowest_points() -> None:
    path = mill_path(Shape(layers=1))
    layer = path.layers[0]
    ramp = np.where(layer.cutting, np.linspace(1, 3, len(layer.cutting)), 6.0)
    path = replace(path, layers=(replace(layer, feed_mm_s=ramp),))
    moves = simplify(path, feed_tolerance=0.25)
    starts = [int(np.argmin(np.linalg.norm(layer.position_mm - p, axis=1))) for p in moves.position_mm]
    cuts = [k for k in np.flatnonzero(moves.cutting)]
    assert 5 <= len(cuts) <= 8  # 1.25^5 = 3.05
    for k in cuts:
        inside = ramp[starts[k - 1] + 1 : starts[k] + 1]
        assert moves.feed_mm_s[k] == inside.min()
        assert inside.max() <= 1.25 * inside.min() + 1e-9
    assert sum(simplify(path, feed_tolerance=5).cutting) == 1


def test_arcs_keep_to_what_controllers_can_do() -> None:
    """On a course of 330 deg: none turns by more than 170 deg, the via lies in the middle."""
    path = mill_path(Shape(bend=1 / 50, length_mm=288, wave_mm=0.02, wave_length_mm=60))
    moves = simplify(path)
    sweeps = []
    for k in np.flatnonzero(moves.circular):
        start, via, target = moves.position_mm[k - 1], moves.via_position_mm[k], moves.position_mm[k]
        sweeps.append(np.degrees(circle(start, via, target)[2]))
        assert np.linalg.norm(via - start) == pytest.approx(np.linalg.norm(target - via), rel=1e-6)
        turns = moves.quaternion_wxyz[k - 1], moves.via_quaternion_wxyz[k], moves.quaternion_wxyz[k]
        begin, middle, end = (Rotation.from_quat(q, scalar_first=True) for q in turns)
        half = (middle * begin.inv()).as_rotvec()
        assert np.linalg.norm(half) > 1e-3
        np.testing.assert_allclose((end * middle.inv()).as_rotvec(), half, atol=1e-9)
    assert min(sweeps) >= 4.2
    assert max(sweeps) <= 170
    assert sum(sweeps) > 500
    assert run(path, moves)[0].max() <= 0.01 + 1e-5
    whole = simplify(mill_path(Shape(bend=1 / 50, length_mm=288, layers=1)))
    cuts = np.flatnonzero(whole.circular & whole.cutting)
    assert len(cuts) == 2
    for k in cuts:
        sweep = circle(whole.position_mm[k - 1], whole.via_position_mm[k], whole.position_mm[k])[2]
        assert np.degrees(sweep) <= 170
    assert np.isnan(moves.via_position_mm[~moves.circular]).all()


def test_a_layer_begins_and_ends_at_a_target_though_the_way_goes_straight_on() -> None:
    x = np.arange(40.0)[:, None] * [[1.0, 0, 0]]
    q = np.tile([1.0, 0, 0, 0], (40, 1))
    path = with_points(mill_path(Shape(length_mm=5)), x[10:20], q[10:20])
    layer = replace(path.layers[0], cutting=np.zeros(10, bool))
    around = tuple(Travel(x[part], q[part], np.ones(len(x[part]))) for part in (slice(0, 10), slice(20, 40)))
    moves = simplify(replace(path, layers=(layer,), travels=around))
    assert moves.position_mm[:, 0].tolist() == [0, 9, 19, 39]
    assert moves.layer.tolist() == [0, 0, 1, 0]


def way(moves, k):
    """Places on move k."""
    via = moves.via_position_mm[k] if moves.circular[k] else None
    return run_move(moves.position_mm[k - 1], via, moves.position_mm[k])


def with_points(path: Toolpath, position, quaternion) -> Toolpath:
    """A path of one layer through poses, without travels."""
    n = len(position)
    layer = Layer(
        1, 0.0, np.arange(float(n)), position, quaternion, np.ones(n), np.ones(n, bool), np.ones(n, bool), np.ones(n)
    )
    return replace(path, layers=(layer,), travels=())


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10**6),
    size=st.floats(1e-4, 30),
    chord=st.sampled_from([1e-3, 0.01, 0.3]),
    angle=st.sampled_from([0.01, 0.05, 2.0]),
)
def test_random_paths_stay_within_any_tolerance(seed: int, size: float, chord: float, angle: float) -> None:
    """Smooth and rough ones, helices, still turns: random walks in position and orientation of many scales."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(30, 120))
    smooth = np.ones(int(rng.integers(1, 30)))
    walk = np.stack([np.convolve(column, smooth, "same") for column in rng.normal(size=(7, n))], axis=1)
    position = np.stack([np.arange(n), np.zeros(n), np.zeros(n)], axis=1) + size * walk[:, :3]
    quaternion = np.array([1.0, 0, 0, 0]) + 0.01 * size * walk[:, 3:]
    quaternion *= rng.choice([-1, 1], size=(n, 1)) / np.linalg.norm(quaternion, axis=1, keepdims=True)
    path = with_points(mill_path(Shape(length_mm=5)), position, quaternion)
    moves = simplify(path, chord_tolerance_mm=chord, angle_tolerance_deg=angle, least_sweep_deg=1)
    off_mm, off_deg = run(path, moves)
    assert off_mm.max() <= chord * 1.01 + 1e-4
    assert off_deg.max() <= angle * 1.01 + 1e-3


def test_a_path_of_one_pose_is_refused() -> None:
    path = with_points(mill_path(Shape(length_mm=5)), np.zeros((3, 3)), np.tile([1.0, 0, 0, 0], (3, 1)))
    with pytest.raises(InputError, match="at least two different poses, found 1"):
        simplify(path)
    with pytest.raises(InputError, match="at least one layer"):
        simplify(replace(path, layers=()))
