"""What the times and places of poses show of a fault: clocks that are apart, positions that jump."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from workbench.checks.motion import section_turns, twisted
from workbench.checks.profiles import Chain
from workbench.geometry.poses import vector_from_rotation
from workbench.units import DEG, Float, Int

JUMP_POSES = 12  # of a pass
ALIKE = 0.5  # of the faster velocity, by which those before and after a jump may differ: they are one motion
SINGLE = 8.0  # times what nine in ten of a pass's poses are off: a jump is single, noise and sway are everywhere


def jump_mm(time_s: Float, position_mm: Float, pass_index: Int) -> float:
    """The greatest single jump of positions (k, 3) at times (k,), against the motion before and after it, mm.

    Over three steps: a pose that comes late, and is made up for, is none.
    """
    found = 0.0
    for number in np.unique(pass_index):
        mine = pass_index == number
        if mine.sum() < JUMP_POSES:
            continue
        time, place = time_s[mine], position_mm[mine]
        step, took = np.diff(place, axis=0), np.diff(time)
        velocity = step / np.maximum(took, 1e-9)[:, None]
        way, while_s = place[4:-1] - place[1:-4], (time[4:-1] - time[1:-4])[:, None]
        by_time = _beyond(way, velocity[:-4] * while_s, velocity[4:] * while_s)
        by_count = _beyond(way, 3.0 * step[:-4], 3.0 * step[4:])
        off = np.minimum(by_time, by_count)
        before, after = np.linalg.norm(velocity[:-4], axis=1), np.linalg.norm(velocity[4:], axis=1)
        alike = np.linalg.norm(velocity[:-4] - velocity[4:], axis=1) <= ALIKE * np.maximum(before, after)
        single = alike & (off > SINGLE * np.quantile(off, 0.9))
        found = max(found, float(off[single].max(initial=0.0)))
    return found


def _beyond(way: Float, one: Float, other: Float) -> Float:
    """By how much ways (k, 3) miss what motions from `one` to `other` (k, 3) can go, mm: slowing down is no jump."""
    missed = np.linalg.norm(way - 0.5 * (one + other), axis=1) - 0.5 * np.linalg.norm(other - one, axis=1)
    return np.asarray(np.maximum(missed, 0.0))


STEP_S = 0.04  # for the derivative of the poses: over less it is their noise
DEGREE = 5  # of what the plate itself may do along the edge: a slow twist
MOST_TURN = 5.0 * DEG  # from place to place: around a small ring chords stand for the edge, and their error sways too
LEAST_RATE = 2.0 * DEG  # per second, of the turning that is not slow: with less 5 ms turn the section by 0.01 deg


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """profile time = robot time + offset; NaN where the motion does not show it."""

    offset_s: float
    u_s: float


def clock_offset(chains: Mapping[int, Chain], poses_at: Callable[[int, float], Float]) -> ClockOffset:
    """From the section's turn about the edge that poses (number, shift in s) -> (k, 4, 4) leave unexplained.

    A plate does not turn to and fro as the scanner does. What is left of the section's turn, less a slow twist, is
    therefore compared with how that turn changes with the time at which the poses are taken. What goes with the
    orientation itself is left out: an oblique section is sheared by it.
    """
    above, below, square, count = 0.0, 0.0, 0.0, 0
    for number, chain in chains.items():
        poses = [poses_at(number, shift) for shift in (-STEP_S / 2, STEP_S / 2)]
        if not _sways(*poses):
            continue
        now, later = (section_turns(chain, one) for one in poses)
        if now is None or later is None or not 12 <= len(now[1]) == len(later[1]):  # where poses stand still it differs
            continue
        if np.median(np.linalg.norm(np.diff(now[2], axis=0), axis=1)) > MOST_TURN:
            continue
        rate, left = (later[1] - now[1]) / STEP_S, (now[1] + later[1]) / 2.0
        slow = twisted((now[0] + later[0]) / 2.0, DEGREE)
        if np.std(rate - slow @ (slow.T @ rate)) < LEAST_RATE:
            continue
        known = np.diff(np.concatenate([slow[:, 1:], now[2]], axis=1), axis=0)
        basis = np.linalg.svd(known, full_matrices=False)[0]
        rate, left = np.diff(rate), np.diff(left)
        rate, left = rate - basis @ (basis.T @ rate), left - basis @ (basis.T @ left)
        usual = np.median(np.abs(left)) / 0.6745 + 1e-9
        inside = np.abs(left) < 6.0 * usual
        above, below = above + float(rate[inside] @ left[inside]), below + float(rate[inside] @ rate[inside])
        square, count = square + float(left[inside] @ left[inside]), count + int(inside.sum())
    if count < 12 or below <= 0:
        return ClockOffset(float("nan"), float("nan"))
    slope = above / below
    noise = np.sqrt(max(square - slope * above, 0.0) / max(count - DEGREE - 1, 1))
    u = float(noise / np.sqrt(below))
    return ClockOffset(float(slope), u)


def _sways(before: Float, after: Float) -> bool:
    """Whether poses (k, 4, 4), STEP_S apart, turn unevenly enough for any direction of an edge to show an offset."""
    rate = vector_from_rotation(np.swapaxes(before[:, :3, :3], 1, 2) @ after[:, :3, :3]) / STEP_S
    return bool(np.linalg.norm(rate.std(axis=0)) > LEAST_RATE)
