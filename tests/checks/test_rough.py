"""Rough faces are no frames out of order, and do not hide them."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from bench.drawn.swept import random_swept_recipe
from bench.simulators.swept import simulate_swept
from workbench.artefacts import Check, Recording
from workbench.checks import judge_recording


@cache
def rough(sd_mm: float) -> Recording:
    """A raw plate whose end face waves over 4 mm: its section wanders by 0.12 and 0.16 mm in the view."""
    recipe = random_swept_recipe("swept_raw_rough", 5007).model_dump()
    recipe["part"]["roughness"]["sd_mm"] = sd_mm
    return simulate_swept(type(random_swept_recipe("swept_raw_rough", 5007)).model_validate(recipe))[0]


def wiggle(recording: Recording) -> Check:
    return {one.name: one for one in judge_recording(recording)}["wiggle_mm"]


def in_order(recording: Recording, order: np.ndarray) -> Recording:
    return dataclasses.replace(recording, x_mm=recording.x_mm[order], z_mm=recording.z_mm[order])


@pytest.mark.parametrize("sd_mm", [0.2, 0.3])
def test_a_rough_face_is_no_disorder_of_frames(sd_mm: float) -> None:
    assert wiggle(rough(sd_mm)).passed


@pytest.mark.parametrize("block", [1, 12])
def test_frames_out_of_order_are_told_on_a_rough_face_too(block: int) -> None:
    recording = rough(0.3)
    blocks = np.array_split(np.arange(len(recording.time_s)), len(recording.time_s) // block)
    mixed = [blocks[k] for k in np.random.default_rng(1).permutation(len(blocks))]
    assert not wiggle(in_order(recording, np.concatenate(mixed))).passed


def test_poses_that_jump_are_told_on_a_rough_face_too() -> None:
    recording = rough(0.3)
    noise = np.random.default_rng(2).normal(0.0, 0.3, recording.robot_position_mm.shape)
    jumping = dataclasses.replace(recording, robot_position_mm=recording.robot_position_mm + noise)
    good, bad = ({one.name: one for one in judge_recording(r)}["pose_noise_mm"] for r in (recording, jumping))
    assert good.passed
    assert not bad.passed
