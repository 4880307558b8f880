"""What frames leave of a smooth course together: steps and waves along the edge, and what they leave open.

A milled edge changes smoothly. Where the end of a face jumps, its returns may be lost on one side of the jump, or
something may prolong it on the other; a step that is really there looks alike. The level that most of the edge has is
taken for the face's; a stretch off it is its own or that one's, alike likely.
"""

from __future__ import annotations

import numpy as np

from workbench.units import Float, Int

REACH, LEAST = 10, 3  # cells on each side of a step that tell it, and that are needed
SURE, MORE_THAN = 5.0, 5.2  # standard uncertainties of a step; of one cell's value, 1.5 columns: one alone says nothing
MOST_STEPS = 12
LAGS, LEAST_FRAMES, STRAY = (1, 2, 3), 48, 4.0  # frames apart; standard deviations; frames of a pass


def steps(s: Float, value: Float, u: Float) -> list[tuple[float, float]]:
    """Places and heights of the steps in values (c,) of cells at rising s (c,) mm; u (c,): of one value.

    By the change that a cubic of the cells' numbers with a step in it has at each place, within REACH cells, over what
    it leaves: by numbers, a gap is no room to swing in.
    """
    found: list[tuple[float, float]] = []
    value = value.copy()
    for _ in range(MOST_STEPS):
        best = (SURE, 0, 0.0)
        for k in range(LEAST, value.size - LEAST + 1):
            near = slice(max(k - REACH, 0), k + REACH)
            x, y = (np.arange(value.size)[near] - k) / REACH, value[near]
            shapes = np.column_stack([x >= 0.0, np.vander(x, 4)])
            inverse = np.linalg.pinv(shapes.T @ shapes)
            fitted = inverse @ (shapes.T @ y)
            left = float(((y - shapes @ fitted) ** 2).sum()) / max(y.size - 5, 1)
            height, sigma = float(fitted[0]), float(np.sqrt(max(left, float(u[near].mean()) ** 2) * inverse[0, 0]))
            if abs(height) > MORE_THAN * float(u[near].mean()) and abs(height) > best[0] * sigma:
                best = (abs(height) / sigma, k, height)
        if best[1] == 0:
            break
        _, k, height = best
        found.append((0.5 * float(s[k - 1] + s[k]), height))
        value[k:] -= height
    return sorted(found)


def level_doubt(found: list[tuple[float, float]], at: Float) -> tuple[Float, Float]:
    """What steps (place, height) make of values at rising `at` (m,) mm: correction (m,) and standard uncertainty (m,).

    Off the level that most of the edge has, a value is half-way to it, uncertain by as much; on it, by the square of
    the share that the others have.
    """
    level = np.sum([height * (at >= place) for place, height in found], axis=0) if found else np.zeros(at.size)
    levels, number = np.unique(np.round(level, 6), return_inverse=True)
    share = np.bincount(number) / at.size
    most = int(share.argmax())
    off = levels[most] - levels[number]
    return 0.5 * off, np.where(number == most, (1.0 - share[most]) ** 2 * np.ptp(levels), 0.5 * np.abs(off))


def waves_u(s: Float, left: Float, pass_index: Int, floor: float) -> float:
    """Root mean square of what neighbouring frames leave together, of residuals (N,) of frames at s (N,); 0: nothing.

    Noise is each frame's own. What goes together from frame to frame, or turns its sign with them, is a wave that the
    course does not follow (chatter). By the autocovariance, where it is certain; `floor`: what frames share by columns.
    """
    found = 0.0
    for number in np.unique(pass_index):
        on = np.flatnonzero((pass_index == number) & np.isfinite(s) & np.isfinite(left))
        if on.size < LEAST_FRAMES:
            continue
        value = left[on[np.argsort(s[on], kind="stable")]]
        value = value - np.median(value)  # passes may lie beside each other
        usual = STRAY * 1.4826 * float(np.median(np.abs(value)))
        value = value.clip(-usual, usual)
        own = float((value**2).mean())
        shared = max(abs(float((value[lag:] * value[:-lag]).mean())) for lag in LAGS)
        if shared > SURE * own / np.sqrt(on.size):
            found = max(found, shared)
    return float(np.sqrt(max(found - floor**2, 0.0)))
