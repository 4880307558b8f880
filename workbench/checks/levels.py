"""Single returns of many frames that stand on one level beside a face, beyond its end: what a step shows of itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.units import Float

# Within how much, of each frame's next ones, times as many as right beside it, how far from the face across and along
# it, how many at least, leaning by how much to it.
LEVEL_MM, NEXT, ALONE, LEVEL_FROM_MM, LEVEL_AWAY_MM = 0.1, 2, 2.0, 0.3, 0.15
LEVEL_TO_MM, LEVEL_POINTS, LEVEL_LEAN = 3.0, 3, 0.2

Beyond = tuple[Float, Float]  # of returns beyond an end of a frame's face: distance from it along the face, and across


def one_level(ends: Sequence[Beyond], frames: int) -> tuple[float, float]:
    """Share of some frames whose next returns beyond one end stand on the level on which most of them do; that, mm.

    What falls off from the face step by step is its rounded or chamfered edge; what begins at its end, a surface of the
    plate; nearly as many right beside the level, or a level that leans, are those of some other surface.
    """
    frame = np.repeat(np.arange(len(ends)), [len(away[:NEXT]) for away, _ in ends])
    away, across = (np.concatenate([end[k][:NEXT] for end in ends]) if ends else np.zeros(0) for k in (0, 1))
    falls = np.unique(frame[np.abs(across) <= LEVEL_FROM_MM])
    near = (away > LEVEL_AWAY_MM) & (away < LEVEL_TO_MM) & (np.abs(across) < LEVEL_TO_MM) & ~np.isin(frame, falls)
    frame, away, across = frame[near], away[near], across[near]
    best = (0.0, 0.0)
    for low in np.unique(np.round(across / (0.5 * LEVEL_MM))) * 0.5 * LEVEL_MM:
        on = (across >= low) & (across < low + LEVEL_MM)
        beside = (across >= low - LEVEL_MM) & (across < low + 2.0 * LEVEL_MM) & ~on
        share = len(np.unique(frame[on])) / frames
        if share > best[0] and on.sum() > max(LEVEL_POINTS, ALONE * beside.sum()):
            spread = float(np.ptp(away[on]))
            lean = abs(float(np.polyfit(away[on], across[on], 1)[0])) if spread > 0.0 else 0.0
            best = (share, abs(low + 0.5 * LEVEL_MM)) if lean < LEVEL_LEAN else best
    return best
