"""Joint moves whose time the program says: what they ask of each joint, between their rows and across them."""

from __future__ import annotations

import numpy as np

from workbench.robot.cell import Cell
from workbench.robot.way import Way
from workbench.units import Float, Int

ROUNDING = 1e-6  # of a share


def rated(cell: Cell) -> Float:
    """Largest speeds (7,) of the joints and the turntable, rad/s."""
    return np.append(cell.chain.speeds, cell.turntable.speed if cell.turntable else np.inf)


def axis_name(i: int) -> str:
    """Of seven: the joints and the turntable."""
    return "the turntable" if i == 6 else f"joint {i + 1}"


def timed_faults(cell: Cell, way: Way) -> tuple[list[tuple[int, float, str, str]], float]:
    """What is beyond a joint's speed or acceleration, segment, share, kind, finding; and the largest share of a speed.

    All angles go evenly between two rows. What a joint's speed changes by at a row, it does in the time of the shorter
    step beside it; where timed moves begin and end the robot stands, and half a step leads from and to that.
    """
    if not way.timed.any():
        return [], 0.0
    moved = np.column_stack([way.joints[:, 1] - way.joints[:, 0], way.turntable[:, 2] - way.turntable[:, 0]])
    rate = np.where(way.timed[:, None], moved / way.duration_s[:, None], 0.0)
    speed = np.abs(rate) / rated(cell)
    faults = _worst(speed, np.arange(len(rate)), "speed")
    most = cell.rated_accelerations
    if most is not None:
        still, step = np.zeros((1, 7)), np.where(way.timed, way.duration_s, np.inf)
        change = np.abs(np.diff(np.concatenate([still, rate, still]), axis=0))
        before, after = np.append(np.inf, step), np.append(step, np.inf)
        within = np.minimum(before, after) * np.where(np.isinf(before + after), 0.5, 1.0)
        here = np.arange(len(step) + 1) - np.isinf(after)  # the segment that begins at the row, or ends there
        faults += _worst(change / within[:, None] / most, here, "acceleration")
    return faults, float(speed.max())


def _worst(asked: Float, segment: Int, kind: str) -> list[tuple[int, float, str, str]]:
    """Where most (n, 7) is asked of a joint, if that is more than it can."""
    i, joint = np.unravel_index(int(asked.argmax()), asked.shape)
    if asked[i, joint] <= 1 + ROUNDING:
        return []
    name = axis_name(int(joint))
    return [(int(segment[i]), 1.0, kind, f"{name} would need {asked[i, joint]:.2f} times its largest {kind}")]
