"""Good recordings pass every check; each fault is seen by the check that is there for it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d, median_filter
from scipy.spatial.transform import Rotation

from bench import outside
from bench.confidently_wrong.kinds import KINDS
from bench.drawn import spheres
from bench.drawn.plates import random_recipe
from bench.drawn.swept import random_swept_recipe
from bench.score import outsider, triangulated
from bench.simulators.swept import simulate_swept
from scripts.checks_table import limits_table
from tests.checks.conftest import good, pooled
from tests.seldom import seldom
from workbench.api import pose_from
from workbench.artefacts import Check, Recording
from workbench.checks import LIMITS, consistent_conventions, judge_recording, judged, refuse_failed
from workbench.errors import InputError
from workbench.plugins.calibration import circles
from workbench.scan import read
from workbench.synthetic import simulate_recording, simulate_sphere

GOOD = [
    *("arc", "oblique", "partial_view", "outliers_5", "coarse", "correlated"),
    *("raw_rough", "raw_below", "raw_square"),
]
MORE = seldom(
    *("two_pass", "clamps"),  # tests/edge measures them, which it could not if a check refused them
    *("paper", "wavy", "reversed", "missing_20", "noisy", "robot_error"),
    *("raw_straight", "raw_arc", "raw_two_pass"),
)


def spoilt(recording: Recording, **changes: object) -> Recording:
    return dataclasses.replace(recording, **changes)  # type: ignore[arg-type]


def failed(recording: Recording) -> dict[str, str]:
    return {check.name: check.finding for check in judge_recording(recording) if not check.passed}


@pytest.mark.parametrize("condition", [*GOOD, *MORE])
def test_a_good_recording_passes_every_check(condition: str) -> None:
    checks = judge_recording(good(condition))
    assert [check.name for check in checks if not check.passed] == []
    assert all(check.reason for check in checks)


RNG = np.random.default_rng(3)
HONEST = ["swept_there_and_back", "swept_reversal", "swept_twist", "swept_helix", "swept_saddle", "swept_ring"]


@pytest.mark.parametrize(("condition", "seed"), [(condition, 1 + k % 2) for k, condition in enumerate(HONEST)])
def test_edges_that_turn_and_passes_that_turn_back_are_honest(condition: str, seed: int) -> None:
    recording, _ = simulate_swept(random_swept_recipe(condition, seed))
    assert failed(recording) == {}


@pytest.mark.parametrize(
    "draw",
    [
        lambda: outsider.below(11_510_011),  # most ranges within 1 mm of 0, where float32 has 10,000 digits a step
        lambda: outsider.raw(11_720_007),  # medians between two faces lie on either: taken for the noise of the mean
        lambda: outsider.below(11_000_000),  # waves under an oblique laser plane turn the section by 2.2 deg
        lambda: outsider.below(18_800_005),  # an orientation that rounding alone changes: taken for one that hangs
        lambda: outside.simulate(8_950_000, True),  # two digits of noise on faces that a fan of rays bends: no filter
    ],
)
def test_what_was_refused_once_and_is_sound_passes_every_check(draw: Callable[[], Any]) -> None:
    assert failed(draw().recording) == {}


@pytest.mark.parametrize("every", [4, *seldom(3)])
def test_a_ring_in_a_few_frames_keeps_its_angle_to_the_laser_plane(every: int) -> None:
    """Over profiles 9 mm apart the way about a ring of 45 mm looked 8 deg oblique, here more, there less."""
    recording, _ = simulate_swept(random_swept_recipe("swept_ring", 5))
    some = {name: getattr(recording, name)[::every] for name in ("time_s", "x_mm", "z_mm", "pass_index")}
    assert failed(spoilt(recording, intensity=None, **some)) == {}


def test_a_mirrored_range_is_named_where_the_edge_waves() -> None:
    """Twist and variation of the angle are small; that the mirror takes nearly all of both is no chance."""
    recording = good("wavy", 1)
    named = failed(spoilt(recording, z_mm=-recording.z_mm))
    assert "twist_deg" in named
    assert all("suspicion: the sign of z of the profiles is wrong" in one for one in named.values())


def test_a_cause_in_the_returns_leaves_what_a_reading_of_the_poses_explains() -> None:
    """Ranges in steps of 0.03 mm make no angle of 80 deg."""
    recording = swaying()
    turned = recording.robot_quaternion_wxyz[:, [1, 2, 3, 0]]
    named = failed(spoilt(recording, robot_quaternion_wxyz=turned, z_mm=np.round(recording.z_mm / 0.03) * 0.03))
    assert "quaternions are stored x y z w" in named["obliquity_deg"]


def test_frames_in_reverse_order_are_named() -> None:
    recording = swaying()
    told = failed(spoilt(recording, x_mm=recording.x_mm[::-1].copy(), z_mm=recording.z_mm[::-1].copy()))
    assert any("the frames are in reverse order" in one for one in told.values())


def test_one_orientation_to_the_last_digit_is_told() -> None:
    recording = good("robot_error", 11)
    first = np.repeat(recording.robot_quaternion_wxyz[:1], len(recording.robot_quaternion_wxyz), axis=0)
    held = spoilt(recording, robot_quaternion_wxyz=first)
    rounded = np.round(first + np.random.default_rng(0).uniform(-6e-7, 6e-7, first.shape), 6)  # as a driver writes it
    rounded /= np.linalg.norm(rounded, axis=1, keepdims=True)
    for one, is_told in ((recording, False), (held, True), (spoilt(recording, robot_quaternion_wxyz=rounded), True)):
        found = {check.name: check.finding for check in judge_recording(one)}
        assert ("same to the last digit" in found["flange_turn_deg"]) == is_told
        assert "a pass has 2 poses only: noise in them would not show" in found["flange_turn_deg"]


def over_frames(r: Recording, count: int) -> np.ndarray:
    before = np.maximum(np.arange(len(r.z_mm))[:, None] - np.arange(count), 0)
    return np.mean([r.z_mm[before[:, k]] for k in range(count)], axis=0).astype("f4")


def coded(r: Recording, code: float) -> Recording:
    lost = ~np.isfinite(r.z_mm) | (np.random.default_rng(5).random(r.z_mm.shape) < 0.05)
    return spoilt(r, z_mm=np.where(lost, code, r.z_mm).astype(np.float32))


def saturated(r: Recording) -> Recording:
    return spoilt(r, z_mm=np.clip(r.z_mm, *np.nanquantile(r.z_mm, [0.15, 0.8]).astype(np.float32)))


def levelled(r: Recording, degree: int) -> Recording:
    """Every frame less its mean, or less its slope."""
    z = r.z_mm.astype(float)
    for row, x in zip(z, r.x_mm.astype(float), strict=True):
        seen = np.isfinite(row)
        row[seen] -= np.polyval(np.polyfit(x[seen], row[seen], degree), x[seen]) - degree * row[seen].mean()
    return spoilt(r, z_mm=(z + 150.0).astype(np.float32))


def two_digits(r: Recording) -> Recording:
    quaternion = np.round(r.robot_quaternion_wxyz, 2)
    return spoilt(r, robot_quaternion_wxyz=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True))


def coarse(r: Recording) -> Recording:
    return spoilt(r, z_mm=(np.round(r.z_mm * 2) / 2).astype(np.float32))


def other_order(r: Recording) -> Recording:
    """Angles of the hand-eye pose in another order."""
    assert r.flange_from_profiler is not None
    pose = r.flange_from_profiler
    turn = Rotation.from_euler("XYZ", Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX")).as_matrix()
    return spoilt(r, flange_from_profiler=pose_from(turn, pose[:3, 3]))


FAULTS = {  # of `bench.confidently_wrong`: the check that fails, and what it says
    "positions in m": ("reach_mm", "metres read as mm"),
    "positions in inches": ("reach_mm", "inches"),
    "profiles in m": ("view_width_mm", "metres"),
    "poses frozen": ("standing_share", "frozen"),
    "every 20th frame 20 times": ("repeated_run", "repeating scanner"),
    "last frames ten late": ("repeated_run", "times in a row"),
    "scanner hangs for an eighth": ("repeated_run", "frozen"),
    "quaternions x y z w": ("obliquity_deg", "x y z w"),
    "hand-eye inverted": ("obliquity_deg", "hand-eye pose is inverted"),
    "hand-eye transposed": ("obliquity_deg", "transposed"),
    "hand-eye translation in m": ("hand_eye_mm", "metres"),
    "mean over 5 columns": ("mean_columns", "over 5 columns"),
    "Gauss over 3 columns": ("mean_columns", "smoothing filter"),
    "Savitzky-Golay over 7 columns": ("mean_columns", "smoothing filter"),
    "x rounded to 0.2 mm": ("lateral_step_mm", "rounded to 0.2 mm: export"),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_seen_and_named(kind: str) -> None:
    name, words = FAULTS[kind]
    found = failed(KINDS[kind].spoil(good(), np.random.default_rng(0)))
    assert name in found, found
    assert words in found[name]


def test_a_driver_that_reads_each_frame_twice_is_no_fault() -> None:
    twice = KINDS["every frame twice"].spoil(good(), np.random.default_rng(0))
    checks, once = judged(twice)
    assert all(one.passed for one in checks)
    assert next(one.value for one in checks if one.name == "repeated_share") == 0.5
    assert 2 * len(once.time_s) == len(twice.time_s)


def test_a_refusal_names_the_first_suspicion_in_one_short_line() -> None:
    first = r"off square; suspicion: hand-eye angles of order [^;]* \(or \d+ others\)"
    with pytest.raises(InputError, match=first) as told:
        refuse_failed(judge_recording(other_order(good())), "a.h5")
    assert len(told.value.expected) <= 200


@pytest.mark.parametrize(
    ("spoil", "name", "words"),
    [
        (
            other_order,
            "obliquity_deg",
            "suspicion: hand-eye angles of order Z-Y-X (moving), read as",
        ),
        (partial(coded, code=0.0), "held_end_share", "the range 0 mm to the digit: the sensor's code"),
        (partial(coded, code=-9999.0), "held_end_share", "the range -9999 mm to the digit"),
        (two_digits, "orientation_step_deg", "rounded to 0.01"),
        (coarse, "range_step_mm", "rounded to 0.5 mm: export them at full resolution"),
        (partial(levelled, degree=0), "frames_vary", "the mean range is the same in every frame: were they zeroed"),
        (partial(levelled, degree=1), "frames_vary", "the slope is the same in every frame"),
        (saturated, "held_end_share", "or ranges that saturate?"),
        (lambda _: KINDS["x and z swapped"].spoil(good("arc", 46), None), "mean_columns", "axes x and z swapped"),
        (lambda _: KINDS["poses noisy by 0.3 mm"].spoil(good("arc", 46), RNG), "pose_noise_mm", "noisy, or rounded"),
    ],
)
def test_a_fault_of_some_recordings_is_named(spoil: Callable[[Recording], Recording], name: str, words: str) -> None:
    assert words in failed(spoil(good()))[name]


@pytest.mark.parametrize(
    ("narrower", "step_mm", "is_told"), [(25.4, 0.01, False), (25.4, 0.3, True), (4.0, 1.0, False)]
)
def test_a_narrow_view_is_one_in_inches_only_if_it_was_scanned_coarsely(
    narrower: float, step_mm: float, is_told: bool
) -> None:
    """A part that fills 3 mm of a view of 7.5 mm is none."""
    r = good("straight")
    along = r.robot_position_mm[-1] - r.robot_position_mm[0]
    way = along / np.linalg.norm(along) * step_mm * (len(r.time_s) - 1)
    narrow = spoilt(
        r,
        x_mm=r.x_mm / narrower,
        z_mm=np.where(np.abs(r.x_mm) < 6.0, r.z_mm / narrower, np.nan),
        robot_position_mm=r.robot_position_mm[0] + np.linspace(0, 1, len(r.robot_time_s))[:, None] * way,
    )
    assert ("view_width_mm" in failed(narrow)) == is_told


@pytest.mark.parametrize(("condition", "sigma"), [("noisy", 1.5), *seldom(("straight", 1.5), ("wavy", 5.0))])
def test_a_filter_that_leaves_long_periods_is_seen(condition: str, sigma: float) -> None:
    r = good(condition)
    z = gaussian_filter1d(r.z_mm.astype(float), sigma, axis=1).astype("f4")
    assert "smoothing filter" in failed(spoilt(r, z_mm=z))["mean_columns"]


def test_a_filter_is_seen_of_ranges_that_float32_rounds_coarsely() -> None:
    """What it leaves between neighbours is less than a step of them: that is no sensor without noise."""
    r = good()
    far = (gaussian_filter1d(r.z_mm.astype(float), 5.0, axis=1) + 650.0).astype("f4")
    assert "smoothing filter" in failed(spoilt(r, z_mm=far))["mean_columns"]


def test_a_few_returns_show_no_filter() -> None:
    """Of noise in scattered threes few pairs lie so many columns apart: chance alone made a mean over 13 to 20."""
    r = good()
    x = r.x_mm[:, : r.x_mm.shape[1] // 3 * 3]
    for seed in range(4):
        rng = np.random.default_rng(seed)
        z = np.full((*x.shape[:1], x.shape[1] // 3, 3), np.nan, np.float32)
        for row in z:
            row[rng.choice(len(row), 30, replace=False)] = 100.0 + rng.normal(0.0, 0.01, (30, 3))
        assert "mean_columns" not in failed(spoilt(r, x_mm=x, z_mm=z.reshape(x.shape), intensity=None))


def test_few_frames_show_no_order() -> None:
    recording = read(recording=Path("data/synthetic/groove.h5"))
    few = np.random.default_rng(1).permutation(len(recording.time_s))[:8]
    few = spoilt(
        recording,
        time_s=np.sort(recording.time_s[few]),
        x_mm=recording.x_mm[few],
        z_mm=recording.z_mm[few],
        pass_index=recording.pass_index[few],
    )
    found = {one.name: one for one in judge_recording(few)}
    assert found["order_share"].value is None
    assert "which does not show their order" in found["order_share"].finding
    assert found["wiggle_mm"].value is None


def test_a_mean_over_frames_is_told_and_not_refused() -> None:
    """What it hides of a face's end is in the uncertainty."""
    r = good()
    found = {one.name: one for one in judge_recording(spoilt(r, z_mm=over_frames(r, 5)))}["mean_frames"]
    assert (found.value, found.passed) == (5.0, True)
    assert "averaged over 5 frames" in found.finding


def test_a_rough_surface_is_no_filter() -> None:
    """Texture correlates from column to column as a mean over a few makes it; the sensor's noise does not."""
    r = good("raw_straight", 43)
    rng = np.random.default_rng(12)
    frames, columns = r.z_mm.shape
    wave = np.fft.rfftfreq(columns, float(np.nanmedian(np.abs(np.diff(r.x_mm, axis=1)))))
    for shortest, sd in ((0.15, 0.08), (0.3, 0.1), (0.2, 0.03)):
        some = ((wave > 0.2) & (wave < 1 / shortest)) * np.exp(2j * np.pi * rng.random((frames, wave.size)))
        texture = np.fft.irfft(some, columns, axis=1)
        rough = spoilt(r, z_mm=(r.z_mm + texture * sd / texture.std()).astype("f4"))
        assert "mean_columns" not in failed(rough)


@pytest.mark.parametrize(("condition", "columns"), [("straight", 2), ("correlated", 9)])
def test_means_over_columns_are_seen(columns: int, condition: str) -> None:
    checks = judge_recording(spoilt(good(condition, 43), z_mm=pooled(good(condition, 43), columns)))
    found = next(one for one in checks if one.name == "mean_columns")
    assert (found.value, found.passed) == (pytest.approx(columns, rel=0.15), columns <= 3)


def test_a_mean_of_rounded_ranges_holds_none_at_the_ends_of_gaps() -> None:
    """Thirds of a digit lie on each other, or a step of float32 apart, and none between: 4 of 8 were refused so."""
    recording = triangulated.sharp(11_900_002).recording
    assert "held_end_share" not in failed(KINDS["mean over 3 columns"].spoil(recording, RNG))


SPHERES = list(spheres.SOUND)


def test_columns_that_alternate_are_no_mean() -> None:
    recording = good("coarse")
    second = np.arange(recording.z_mm.shape[1], dtype=np.float32) % 2
    assert failed(spoilt(recording, z_mm=recording.z_mm + np.float32(0.06) * second)) == {}


@pytest.mark.parametrize("condition", [*SPHERES[::4], *seldom(*(one for k, one in enumerate(SPHERES) if k % 4))])
def test_good_calibration_recordings_pass_every_check(condition: str) -> None:
    recording, _ = simulate_sphere(spheres.random_sphere_recipe(condition, 900))
    assert failed(recording) == {}


def test_a_calibration_recording_is_judged() -> None:
    recording, _ = simulate_sphere(spheres.random_sphere_recipe(SPHERES[0], 901))
    first = np.zeros(len(recording.time_s), int)
    for words, changes in (
        ("a frozen or repeating scanner", {"x_mm": recording.x_mm[first], "z_mm": recording.z_mm[first]}),
        ("metres read as mm", {"robot_position_mm": recording.robot_position_mm / 1e3}),
    ):
        with pytest.raises(InputError, match=words):
            circles(spoilt(recording, **changes))
    assert len(circles(recording).frame) > 0


def test_passes_that_disagree() -> None:
    r = good("raw_two_pass")
    moved = r.robot_position_mm + np.where(r.robot_pass == r.robot_pass[-1], 1.0, 0.0)[:, None] * (3.0, 3.0, 3.0)
    assert "pass_disagreement_mm" in failed(spoilt(r, robot_position_mm=moved))


def test_a_pass_that_is_a_copy_counts_once() -> None:
    r = good()
    number = np.concatenate([np.full(len(r.time_s), k) for k in range(3)])
    poses = np.concatenate([np.full(len(r.robot_time_s), k) for k in range(3)])
    thrice = spoilt(
        r,
        time_s=np.tile(r.time_s, 3),
        x_mm=np.tile(r.x_mm, (3, 1)),
        z_mm=np.tile(r.z_mm, (3, 1)),
        pass_index=number,
        robot_time_s=np.tile(r.robot_time_s, 3),
        robot_position_mm=np.tile(r.robot_position_mm, (3, 1)),
        robot_quaternion_wxyz=np.tile(r.robot_quaternion_wxyz, (3, 1)),
        robot_pass=poses,
    )
    assert "2 of 3 passes are copies" in next(c.finding for c in judge_recording(thrice) if c.name == "repeated_share")
    assert set(judged(thrice)[1].pass_index) == {0}
    dithered = thrice.z_mm + np.random.default_rng(3).normal(0, 1e-5, thrice.z_mm.shape).astype("f4")
    assert set(judged(spoilt(thrice, z_mm=dithered))[1].pass_index) == {0}
    assert judged(r)[1] is r


def swaying() -> Recording:
    """A dense stream that turns to and fro by 3 deg about the edge."""
    r = good()
    assert r.flange_from_profiler is not None
    start, stop = r.robot_position_mm[0], r.robot_position_mm[-1]
    time = np.linspace(r.robot_time_s[0] - 0.5, r.robot_time_s[-1] + 0.5, 1500)
    along = (stop - start) / np.linalg.norm(stop - start)
    share = (time - r.robot_time_s[0]) / (r.robot_time_s[-1] - r.robot_time_s[0])
    rotation = Rotation.from_quat(r.robot_quaternion_wxyz[0][[1, 2, 3, 0]])
    sway = np.radians(3.0) * np.sin(2 * np.pi * time / 2.0)
    turn = Rotation.from_rotvec(sway[:, None] * along)
    profiler = (turn * rotation).as_matrix() @ r.flange_from_profiler[:3, :3]
    # the profile of a plate turned by -sway in its own plane, about the profiler's y axis
    at = np.radians(3.0) * np.sin(2 * np.pi * r.time_s / 2.0) * np.sign(profiler[0][:, 1] @ along)
    x0, z0 = float(np.nanmean(r.x_mm)), float(np.nanmean(r.z_mm))
    hold = r.flange_from_profiler @ (x0, 0.0, z0, 1.0)  # runs straight, so the flange does not
    lever = (turn * rotation).apply(hold[:3]) - rotation.apply(hold[:3])
    c, s = np.cos(at)[:, None], np.sin(at)[:, None]
    x, z = r.x_mm - x0, r.z_mm - z0
    return spoilt(
        r,
        x_mm=(x0 + c * x - s * z).astype("f4"),
        z_mm=(z0 + s * x + c * z).astype("f4"),
        robot_time_s=time,
        robot_position_mm=start + share[:, None] * (stop - start) - lever,
        robot_quaternion_wxyz=(turn * rotation).as_quat()[:, [3, 0, 1, 2]],
        robot_pass=np.zeros(1500, np.int64),
    )


@pytest.mark.parametrize("sways", [True, False])
def test_a_scan_that_does_not_sway_says_nothing_of_the_clocks(sways: bool) -> None:
    recording = swaying() if sways else good()
    found = next(c for c in judge_recording(recording) if c.name == "flange_turn_deg")
    assert ("does not show whether the clocks agree" in found.finding) != sways


def test_the_right_reading_is_among_those_that_agree() -> None:
    r = good("arc")
    assert consistent_conventions(r)[0][0].name == "as it is read"
    wrong = spoilt(r, robot_quaternion_wxyz=r.robot_quaternion_wxyz[:, [1, 2, 3, 0]])
    names = [one.name for one, _ in consistent_conventions(wrong)]
    assert "quaternions are stored x y z w, not w x y z" in names
    assert "as it is read" not in names


def test_limits_that_a_user_sets() -> None:
    r = spoilt(good(), z_mm=pooled(good(), 5))
    wide = judge_recording(r, limits={"mean_columns": 6})
    assert [check.name for check in wide if check.loosened] == ["mean_columns"]
    refuse_failed(wide, "r.h5")
    with pytest.raises(InputError, match=r"averaged .* over 5 columns.*limit 3.1; scan.fuse.limits sets it"):
        refuse_failed(judge_recording(r), "r.h5")


def test_the_table_has_every_check() -> None:
    """If this fails: python -m scripts.checks_table"""
    table = Path(__file__).parents[2] / "docs" / "tables" / "checks.csv"
    assert table.read_text() == limits_table()
    assert all(one.reason and one.meaning for one in LIMITS.values())


@pytest.mark.parametrize("skipped", [2, 5])
def test_columns_that_the_sensor_skips_are_no_lost_returns(skipped: int) -> None:
    r = good("straight")
    keep = np.arange(r.z_mm.shape[1]) % skipped == 1
    there = judged(spoilt(r, z_mm=np.where(keep, r.z_mm, np.nan).astype("f4")))[1]
    assert np.array_equal(there.z_mm, r.z_mm[:, keep], equal_nan=True)


@pytest.mark.parametrize("side", [1, -1])
def test_a_window_that_ends_on_a_part_that_moves_is_the_view(side: int) -> None:
    r = good("straight")
    seen = np.flatnonzero(np.isfinite(r.z_mm).any(axis=0))
    columns, at = np.arange(r.z_mm.shape[1]), int(np.mean(seen[[0, -1]]))
    keep = columns > at if side > 0 else columns < at
    there = judged(spoilt(r, z_mm=np.where(keep, r.z_mm, np.nan).astype("f4")))[1]
    assert there.z_mm.shape[1] <= keep.sum()
    ends = np.isfinite(there.z_mm)[:, 0 if side > 0 else -1]
    assert ends.mean() > 0.9


@pytest.mark.parametrize("columns", [5])
def test_a_median_over_returns_and_losses_is_told_by_the_ends_of_faces(columns: int) -> None:
    """It rounds nothing off but the last columns, which passed for a rounded edge: 0.2 mm of root face at u 0.02."""
    recording, _ = simulate_recording(random_recipe("arc", 7_900_016))
    assert {one.name: one for one in judge_recording(recording)}["held_end_share"].value == 0.0
    seen = np.isfinite(recording.z_mm)
    held = median_filter(np.where(seen, recording.z_mm, 1e3), (1, columns))
    spoilt_one = spoilt(recording, z_mm=np.where(seen, held, np.nan).astype("f4"))
    found = {one.name: one for one in judge_recording(spoilt_one)}["held_end_share"]
    assert not found.passed
    assert "median filter" in found.finding


def test_mirrored_axes_along_an_arc_are_told_by_the_reading_that_steadies_the_laser_plane() -> None:
    """The plane's angle to the edge varies by 7.5 deg, which a wavy edge may; un-mirrored it varies by 0.3."""
    r, _ = simulate_recording(random_recipe("raw_arc", 7_700_001))
    mirrored = r.robot_position_mm * [1.0, -1.0, 1.0]
    found = {one.name: one for one in judge_recording(spoilt(r, robot_position_mm=mirrored))}["obliquity_varies_deg"]
    assert not found.passed
    assert "the robot's axes are x, -y, z" in found.finding
    assert found.value < LIMITS["obliquity_varies_deg"].bound  # by the common limit alone it would have passed


def test_blind_columns_are_told_and_widen_u() -> None:
    recording, _ = simulate_recording(random_recipe("straight", 5_250_200))
    named = {one.name: one for one in judge_recording(recording)}
    assert named["blind_columns"].value == 0
    z = recording.z_mm.copy()
    z[:, 300:308] = np.nan
    found = {one.name: one for one in judge_recording(spoilt(recording, z_mm=z))}["blind_columns"]
    assert (found.value, found.passed) == (8, True)
    assert "8 columns between others that measure never return" in found.finding


def test_whole_numbers_for_positions_are_told() -> None:
    recording = good("straight")
    named = {one.name: one for one in judge_recording(recording)}
    assert named["position_step_mm"].value == 0
    rounded = spoilt(recording, robot_position_mm=np.round(recording.robot_position_mm))
    found = {one.name: one for one in judge_recording(rounded)}["position_step_mm"]
    assert (found.value, found.passed) == (1.0, True)
    assert "would not show" in found.finding


@pytest.mark.parametrize(
    ("columns", "back", "step_mm"), [(1, 1, 0.002), (5, 3, 0.0), *seldom((1, 1, 0.0), (1, 3, 0.0), (5, 3, 0.002))]
)
def test_gaps_that_continue_the_slope_before_them_are_told(columns: int, back: int, step_mm: float) -> None:
    """Single losses on steep faces beside a surface behind them: filled, a root face is up to 0.12 mm longer."""
    recording = simulate_recording(random_recipe("straight", 8_920_005))[0]
    good = _told(_rounded_z(recording, step_mm))
    assert good.value < 0.1, good
    z = recording.z_mm.astype(float)
    for i, j in zip(*np.nonzero(np.isfinite(z[:, :-1]) & ~np.isfinite(z[:, 1:])), strict=True):
        if j >= back:
            slope = (z[i, j] - z[i, j - back]) / back
            for k in range(1, min(columns, z.shape[1] - 1 - j) + 1):
                if np.isfinite(z[i, j + k]):
                    break
                z[i, j + k] = z[i, j] + k * slope
    assert not _told(_rounded_z(spoilt(recording, z_mm=z.astype(np.float32)), step_mm)).passed


def _rounded_z(recording: Recording, step_mm: float) -> Recording:
    return spoilt(recording, z_mm=np.round(recording.z_mm / step_mm) * step_mm) if step_mm else recording


def _told(recording: Recording) -> Check:
    return {one.name: one for one in judge_recording(recording)}["held_end_share"]


def test_steps_of_a_few_of_float32_s_digits_are_found_where_these_double() -> None:
    """At 256 mm: steps of 0.00007 and 0.0001 mm seemed none, and returns that are alike to the digit a filter's."""
    r = good("straight")
    z = r.z_mm.astype(float) + 256.0 - np.nanpercentile(r.z_mm, 70.0)
    assert _told(spoilt(r, z_mm=(np.round(z / 7e-5) * 7e-5).astype("f4"))).value < 0.05


def test_a_filter_is_seen_where_most_frames_have_one_straight_piece() -> None:
    """36 of them in 40 frames were too few to ask: the edge was 0.9 mm off at 4 u, and its plan passed."""
    recording, _ = simulate_recording(random_recipe("raw_straight", 11_713_000))
    assert "mean_columns" in failed(KINDS["Gauss over 3 columns"].spoil(recording, RNG))


def test_frames_that_no_longer_lie_on_each_other_are_refused() -> None:
    """Shuffled, no seven of them go together: every check of the motion had nothing to judge by, and all passed."""
    recording, _ = simulate_recording(random_recipe("two_pass", 8_930_003))
    order = np.random.default_rng(1).permutation(len(recording.time_s))
    shuffled = spoilt(recording, x_mm=recording.x_mm[order], z_mm=recording.z_mm[order])
    named = {one.name: one for one in judge_recording(shuffled)}
    assert named["obliquity_deg"].value is None
    assert not named["together_share"].passed
    assert "out of order" in named["together_share"].finding
    assert {one.name: one for one in judge_recording(recording)}["together_share"].value > 0.9


@pytest.mark.parametrize("axes", ["axes y x z", *seldom("axes z y x", "axes y z x")])
def test_swapped_axes_of_a_saddle_are_refused_although_the_plate_is_twisted(axes: str) -> None:
    """The right reading leaves the saddle's own twist, and a sixth of how much the obliquity varies."""
    recording, _ = simulate_swept(random_swept_recipe("swept_raw_saddle", 8_980_005))
    assert [one.name for one in judge_recording(recording) if not one.passed] == []
    swapped = KINDS[axes].spoil(recording, np.random.default_rng(1))
    failed = {one.name: one for one in judge_recording(swapped) if not one.passed}
    assert "obliquity_varies_deg" in failed
    assert "the robot's axes are" in failed["obliquity_varies_deg"].finding


def test_rounded_ranges_that_drift_are_no_filter() -> None:
    """Each row is rounded to steps that begin elsewhere: second differences of 0 are many, as are those of a step."""
    recording, _ = simulate_recording(random_recipe("straight", 8_936_001))
    drift = np.linspace(0.0, 0.1, len(recording.z_mm))[:, None]
    assert _told(spoilt(recording, z_mm=(recording.z_mm + drift).astype(np.float32))).value < 0.1


def test_where_neighbours_scatter_nothing_tells_the_order_of_frames() -> None:
    """A wavy part that lies still to 0.04 mm, its frames shuffled: what varies along it is lost, and it is said so."""
    recording, _ = simulate_recording(random_recipe("wavy", 8_995_110))
    order = np.random.default_rng(1).permutation(len(recording.time_s))
    shuffled = spoilt(recording, x_mm=recording.x_mm[order], z_mm=recording.z_mm[order])
    good, found = ({one.name: one for one in judge_recording(r)}["order_share"] for r in (recording, shuffled))
    assert "the recording does not show which" not in good.finding
    assert "frames out of order; the recording does not show which" in found.finding
