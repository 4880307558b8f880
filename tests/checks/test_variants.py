"""Random variants of good recordings, inspected and planned: right, or refused in one sentence.

A draw of each; `python -m bench.confidently_wrong` takes hundreds.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import bench.confidently_wrong.__main__ as study
from bench.confidently_wrong.__main__ import NAMED, inspected, planned
from bench.confidently_wrong.kinds import Kind
from bench.drawn.plates import random_recipe
from workbench.artefacts import Recording
from workbench.geometry.poses import quaternion_from_rotation
from workbench.scan.fuse import flange_poses
from workbench.synthetic import Truth, simulate_recording

Vary = Callable[[Recording, np.random.Generator], Recording]


def moved(r: Recording, rng: np.random.Generator) -> Recording:
    """The whole cell, by a rigid motion."""
    turn = Rotation.random(rng=rng)
    quaternion = (turn * Rotation.from_quat(r.robot_quaternion_wxyz[:, [1, 2, 3, 0]])).as_quat()[:, [3, 0, 1, 2]]
    return dataclasses.replace(r, robot_position_mm=turn.apply(r.robot_position_mm), robot_quaternion_wxyz=quaternion)


def frames(r: Recording, which: np.ndarray) -> Recording:
    return dataclasses.replace(
        r,
        time_s=r.time_s[which],
        x_mm=r.x_mm[which],
        z_mm=r.z_mm[which],
        pass_index=r.pass_index[which],
        intensity=None,
    )


def decimated(r: Recording, rng: np.random.Generator) -> Recording:
    every = int(rng.integers(2, 6))
    return frames(r, np.arange(0, len(r.time_s), every))


def half_lost(r: Recording, rng: np.random.Generator) -> Recording:
    return frames(r, np.flatnonzero(rng.random(len(r.time_s)) < 0.5))


def cropped_frames(r: Recording, rng: np.random.Generator) -> Recording:
    n = len(r.time_s)
    start = int(rng.integers(0, n - 10))
    return frames(r, np.arange(start, min(n, start + int(rng.integers(2, n)))))


def cropped_columns(r: Recording, rng: np.random.Generator) -> Recording:
    m = r.x_mm.shape[1]
    start = int(rng.integers(0, m // 2))
    columns = np.s_[:, start : start + int(rng.integers(20, m))]
    return dataclasses.replace(r, x_mm=r.x_mm[columns].copy(), z_mm=r.z_mm[columns].copy(), intensity=None)


def fewer_columns(r: Recording, rng: np.random.Generator) -> Recording:
    every = np.s_[:, :: int(rng.integers(2, 5))]
    return dataclasses.replace(r, x_mm=r.x_mm[every].copy(), z_mm=r.z_mm[every].copy(), intensity=None)


def noisy(r: Recording, rng: np.random.Generator) -> Recording:
    noise = rng.normal(0, rng.choice([0.02, 0.05, 0.3, 2.0]), r.z_mm.shape).astype(np.float32)
    return dataclasses.replace(r, z_mm=r.z_mm + noise)


def sparse(r: Recording, rng: np.random.Generator) -> Recording:
    lost = rng.random(r.z_mm.shape) < rng.choice([0.5, 0.9, 0.99])
    return dataclasses.replace(r, z_mm=np.where(lost, np.float32(np.nan), r.z_mm))


def columns_reversed(r: Recording, rng: np.random.Generator) -> Recording:
    return dataclasses.replace(r, x_mm=r.x_mm[:, ::-1].copy(), z_mm=r.z_mm[:, ::-1].copy(), intensity=None)


def scaled(r: Recording, rng: np.random.Generator) -> Recording:
    by = float(rng.choice([1e-3, 0.1, 10.0, 25.4]))
    return dataclasses.replace(r, x_mm=r.x_mm * by, z_mm=r.z_mm * by, robot_position_mm=r.robot_position_mm * by)


def permuted(r: Recording, rng: np.random.Generator) -> Recording:
    which = rng.permutation(len(r.time_s))
    return dataclasses.replace(r, x_mm=r.x_mm[which], z_mm=r.z_mm[which], intensity=None)


def empty_frames(r: Recording, rng: np.random.Generator) -> Recording:
    lost = rng.random(len(r.time_s)) < rng.choice([0.5, 0.95])
    return dataclasses.replace(r, z_mm=np.where(lost[:, None], np.float32(np.nan), r.z_mm))


def mirrored(r: Recording, rng: np.random.Generator) -> Recording:
    return dataclasses.replace(r, x_mm=-r.x_mm)


def rolled(r: Recording, rng: np.random.Generator) -> Recording:
    """Profiles turned in their own plane, by any angle."""
    angle = rng.uniform(0, 2 * np.pi)
    c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    return dataclasses.replace(r, x_mm=c * r.x_mm - s * r.z_mm, z_mm=s * r.x_mm + c * r.z_mm)


def repeated(r: Recording, rng: np.random.Generator) -> Recording:
    which = np.sort(rng.integers(0, len(r.time_s), len(r.time_s)))
    return dataclasses.replace(r, x_mm=r.x_mm[which], z_mm=r.z_mm[which], intensity=None)


def spikes(r: Recording, rng: np.random.Generator) -> Recording:
    hit = rng.random(r.z_mm.shape) < rng.choice([0.001, 0.1])
    return dataclasses.replace(r, z_mm=np.where(hit, rng.normal(0, 1e3, r.z_mm.shape).astype(np.float32), r.z_mm))


def striped(r: Recording, rng: np.random.Generator) -> Recording:
    lost = rng.random(r.z_mm.shape[1]) < rng.choice([0.3, 0.9])
    return dataclasses.replace(r, z_mm=np.where(lost[None], np.float32(np.nan), r.z_mm))


def held_values(r: Recording, rng: np.random.Generator) -> Recording:
    """Whole frames, or whole columns, of one range."""
    z = r.z_mm.copy()
    if rng.random() < 0.5:
        z[rng.random(len(z)) < 0.5] = 150.0
    else:
        z[:, rng.random(z.shape[1]) < 0.5] = 150.0
    return dataclasses.replace(r, z_mm=z)


def few(r: Recording, rng: np.random.Generator) -> Recording:
    start = int(rng.integers(0, len(r.time_s) - 6))
    return frames(r, np.arange(start, start + int(rng.integers(1, 6))))


def passes_cut(r: Recording, rng: np.random.Generator) -> Recording:
    """One pass told as several, each with the poses of its own ends."""
    count = int(rng.integers(2, 5))
    number = np.sort(rng.integers(0, count, len(r.time_s)))
    poses = flange_poses(r)
    ends = np.concatenate([np.flatnonzero(number == k)[[0, -1]] for k in np.unique(number)])
    return dataclasses.replace(
        r,
        pass_index=number,
        robot_time_s=r.time_s[ends],
        robot_pass=number[ends],
        robot_position_mm=poses[ends, :3, 3],
        robot_quaternion_wxyz=quaternion_from_rotation(poses[ends, :3, :3]),
    )


def two_of_them(r: Recording, rng: np.random.Generator) -> Recording:
    for k in rng.choice(len(SINGLE), 2, replace=False):
        r = SINGLE[k](r, rng)
        if len(r.time_s) < 12:
            break
    return r


TRUE: list[Vary] = [moved, decimated, half_lost, columns_reversed, fewer_columns, cropped_frames, noisy]
SINGLE: list[Vary] = [
    *TRUE,
    cropped_columns,
    sparse,
    scaled,
    permuted,
    empty_frames,
    mirrored,
    rolled,
    repeated,
    spikes,
    striped,
    held_values,
    few,
    passes_cut,
]
ANY: list[Vary] = [*SINGLE[len(TRUE) :], two_of_them]
# What a single pass of a flange that hardly turns cannot show, and results name: a hand-eye pose of another sense,
# frames in another order on a part that lies still in the view.
UNSEEN: dict[Vary, Any] = {rolled: "flange", mirrored: "flange", permuted: "order", two_of_them: "flange"}


@functools.cache
def part(condition: str) -> tuple[Recording, Truth]:
    """Every third frame of a drawn part."""
    recording, truth = simulate_recording(random_recipe(condition, 300))
    return frames(recording, np.arange(0, len(recording.time_s), 3)), truth


JUDGES: tuple[Callable[[Recording, Truth, Kind], str], ...] = inspected, planned
CASES = [
    pytest.param(k, vary, judge, id=f"{judge.__name__}-{vary.__name__}", marks=[pytest.mark.slow] * ((k + of) % 2))
    for k, vary in enumerate([*TRUE, *ANY])
    for of, judge in enumerate(JUDGES)
    if (vary, judge) != (moved, planned)  # a moved part has another upper side
]


@pytest.mark.parametrize(("k", "vary", "judge"), CASES)
def test_a_variant_is_right_or_refused(k: int, vary: Vary, judge: Callable[[Recording, Truth, Kind], str]) -> None:
    """Each is inspected or planned; the other way round by `make test-slow`."""
    straight = vary is passes_cut or k % 2 == 0  # two poses tell a straight motion
    recording, truth = part(("" if judge is inspected else "raw_") + ("straight" if straight else "arc"))
    spoilt = vary(recording, np.random.default_rng([0, k]))
    outcome = judge(spoilt, truth, Kind(vary, (), UNSEEN.get(vary, "")))
    assert outcome not in ("crashed", "confidently wrong")


@pytest.mark.parametrize(
    ("unseen", "shape_only", "outcome"),
    [("sensor", True, NAMED), ("sensor", False, "confidently wrong"), ("", True, "confidently wrong")],
)
def test_a_path_beside_the_part_is_named_only_as_a_shape_and_of_what_cannot_be_seen(
    unseen: Any, shape_only: bool, outcome: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording, truth = part("raw_straight")
    edge = SimpleNamespace(position_mm=truth.position_mm + 2.0 * truth.across, checks=())
    decision = SimpleNamespace(passed=True, shape_only=shape_only)
    monkeypatch.setattr(study, "plan_as_a_user", lambda *_: (edge, None, decision))
    assert planned(recording, truth, Kind(moved, (), unseen)) == outcome
    edge.position_mm = truth.position_mm
    assert planned(recording, truth, Kind(moved, (), unseen)) == "right"
