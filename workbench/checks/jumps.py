"""Positions that jump along the way: an encoder that slips, a robot whose zero was set anew within a scan."""

from __future__ import annotations

import numpy as np

from workbench.units import Float, Int

LEAST_POSES = 12  # of a pass
ALIKE = 0.5  # of the faster velocity, by which those before and after a jump may differ: they are one motion
SHORT = 0.5  # of the usual time between two poses
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
        by_time = way - 0.5 * (velocity[:-4] + velocity[4:]) * while_s
        by_count = way - 1.5 * (step[:-4] + step[4:])
        off = np.minimum(np.linalg.norm(by_time, axis=1), np.linalg.norm(by_count, axis=1))
        before, after = np.linalg.norm(velocity[:-4], axis=1), np.linalg.norm(velocity[4:], axis=1)
        alike = np.linalg.norm(velocity[:-4] - velocity[4:], axis=1) <= ALIKE * np.maximum(before, after)
        whole = took > SHORT * np.median(took)  # over less, velocities are the positions' noise
        single = alike & whole[:-4] & whole[4:] & (off > SINGLE * np.quantile(off, 0.9))
        found = max(found, float(off[single].max(initial=0.0)))
    return found
