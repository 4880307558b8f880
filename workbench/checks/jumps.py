"""Positions that jump along the way: an encoder that slips, a robot whose zero was set anew within a scan."""

from __future__ import annotations

import numpy as np

from workbench.units import Float, Int

LEAST_POSES = 12  # of a pass
ALIKE = 0.5  # of the faster velocity, by which those before and after a jump may differ: they are one motion
SINGLE = 8.0  # times what nine in ten of a pass's poses are off: a jump is single, noise and sway are everywhere


def jump_mm(time_s: Float, position_mm: Float, pass_index: Int) -> float:
    """The greatest single jump of positions (k, 3) at times (k,), against the motion before and after it, mm.

    Over three steps: a pose that comes late, and is made up for, is none.
    """
    found = 0.0
    for number in np.unique(pass_index):
        mine = pass_index == number
        if mine.sum() < LEAST_POSES:
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
