"""Returns that become rare towards the end of a face: soot, worn paint, light that hardly comes back.

Over `fade` columns before its end a face returns with a probability that falls evenly to 0. The last return of a frame
then lies some columns before the end, and behind it more are missing than elsewhere on the face: that tells `fade`.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from scipy.special import betaln

from workbench.geometry.along import by_pass
from workbench.kernels import kernel
from workbench.units import AnyArray, Bool, Float, Int, Shaped

FADES = (0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0)  # columns
NONE = 0.5  # columns: over less nothing fades, since the last one before the end lies half of one off it
PRIOR, OTHERWISE = 0.1, 0.01  # probability that returns fade at all; that they go missing in another manner
BEHIND, REACH, COLUMNS = 8, 24, 40  # columns behind the last return: that tell it, that tell what is usual; of the sums
LEAST_FRAMES, MOST_FRAMES, LOOKED_AT = 30, 300, 1000  # of a pass; that count, as neighbours see the same soot
DARK = 0.1  # of the frames in which a column returns at least, that is not blind


class _Faded(NamedTuple):
    """What each of FADES makes of the columns near the end."""

    behind: Shaped[Float, "f b"]  # share missing in the columns behind the last return
    beyond: Shaped[Float, " f"]  # columns of the face beyond the last return: mean
    scatter: Shaped[Float, " f"]  # and standard deviation


@kernel
def returns_share(column: int, fade: float) -> float:
    """Share of the frames in which the `column`-th one before the end returns, for what they may return at all."""
    return 1.0 if column + 0.5 >= fade else (column + 0.5) / fade


def faded_columns(z_mm: AnyArray, outwards: Shaped[Int, " N"], seen: Shaped[Bool, " N"], pass_index: Int) -> Float:
    """Over how many columns before its end a face fades (N,), by pass; 0: its returns end at once.

    Args:
        z_mm: (N, M) NaN where nothing came back.
        outwards: column of the face's last return; negative: the face ends towards column 0.
        seen: frames that show the end.
        pass_index: of each frame.

    Example:
        >>> z, share = np.ones((400, 60)), np.minimum((np.arange(60.0) + 0.5) / 6.0, 1.0)
        >>> z[np.random.default_rng(1).random(z.shape) > share] = np.nan
        >>> last = -np.isfinite(z).argmax(axis=1)
        >>> faded_columns(z, last, last < 0, np.zeros(400, int))[:2].round(1).tolist()
        [6.0, 6.0]
    """
    out = np.zeros(outwards.size)
    for of_pass in by_pass(pass_index):
        mine = of_pass[seen[of_pass]]
        if mine.size < LEAST_FRAMES:
            continue
        mine = mine[:: math.ceil(mine.size / LOOKED_AT)]
        returned = np.isfinite(z_mm[mine])
        at = np.abs(outwards[mine])[:, None] - np.sign(outwards[mine])[:, None] * np.arange(1, REACH + 1)
        inside = (at >= 0) & (at < returned.shape[1])
        at = np.where(inside, at, 0)
        told = inside & (returned.mean(axis=0) > DARK)[at]
        missing = told & ~np.take_along_axis(returned, at, axis=1)
        out[of_pass] = _likely(missing.sum(axis=0), told.sum(axis=0))
    return out


def beyond_columns(fade: Float) -> tuple[Float, Float]:
    """Columns of a face that fades over `fade` (n,) beyond the last return: mean and standard deviation (n,)."""
    known = NONE, *FADES[1:]
    return np.interp(fade, known, _faded().beyond), np.interp(fade, known, _faded().scatter)


def _likely(missing: Int, told: Int) -> float:
    """The mean of what frames leave likely, of which so many miss (r,) of those (r,) in each column behind the last."""
    near, of = missing[:BEHIND].astype(float), told[:BEHIND].astype(float)
    usual = (missing[BEHIND:].sum() + 0.5) / (told[BEHIND:].sum() + 1.0)
    counts = min(1.0, MOST_FRAMES / max(float(of.max()), 1.0))
    near, of = counts * near, counts * of
    share = usual + (1.0 - usual) * _faded().behind
    log = (near * np.log(share) + (of - near) * np.log1p(-share)).sum(axis=1)
    log += np.log(np.append(1.0 - PRIOR, np.full(len(FADES) - 1, PRIOR / (len(FADES) - 1))))
    other = np.log(OTHERWISE) + betaln(near + 1.0, of - near + 1.0).sum()  # each column by itself: no end fades so
    weight = np.exp(log - max(log.max(), other))
    return float(weight @ FADES / (weight.sum() + np.exp(other - max(log.max(), other))))


@functools.cache
def _faded() -> _Faded:
    returns = np.array([[returns_share(k, fade) for k in range(COLUMNS + BEHIND)] for fade in FADES])
    before = np.cumprod(np.concatenate([np.ones((len(FADES), 1)), 1.0 - returns], axis=1), axis=1)[:, :-1]
    last = (returns * before)[:, :COLUMNS]
    behind = [(last * (1.0 - returns[:, k : k + COLUMNS])).sum(axis=1) for k in range(1, BEHIND + 1)]
    mean, square = (last @ np.arange(float(COLUMNS)) ** k for k in (1, 2))
    return _Faded(np.stack(behind, axis=1), mean, np.sqrt(square - mean**2))
