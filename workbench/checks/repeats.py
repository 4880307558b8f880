"""Frames and passes that stand more than once in a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.geometry.grids import frame_digests
from workbench.units import AnyArray, Bool, Int, Shaped

LEAST_RETURNS = 16  # of a frame: with fewer, frames may well be alike
NOISE_MM = 1e-4  # of neighbouring returns: frames without any noise were computed, and may be alike
ALIKE = 0.9  # correlation of the noise of two frames of different passes that are copies of one


@dataclass(frozen=True, slots=True, eq=False)
class Repeats:
    """What a recording shows more than once."""

    copies: Shaped[Bool, " N"]  # frames that are bit for bit an earlier one of their own pass
    longest: int  # most frames in a row of one pass that are one and the same
    passes: dict[int, int]  # pass that is a copy: the one that it is a copy of

    @property
    def share(self) -> float:
        """Of all frames, those that are copies within their pass."""
        return float(self.copies.mean()) if self.copies.size else 0.0


def find_repeats(x_mm: AnyArray, z_mm: AnyArray, pass_index: Int) -> Repeats:
    """Compare all frames of a grid (N, M) with each other, by the digests of their ranges, and passes by their noise.

    Frames with few returns and recordings without noise do not count: they may be alike and yet right.
    """
    frames = len(z_mm)
    alike = _alike_passes(z_mm, pass_index)
    none = Repeats(np.zeros(frames, bool), 0, alike)
    if frames < 2 or not _has_noise(z_mm):
        return none
    digest = frame_digests(z_mm)
    _, first = np.unique(digest, return_index=True)
    if len(first) == frames:  # the usual case: no two are alike
        return none
    counted = np.isfinite(z_mm).sum(axis=1) >= LEAST_RETURNS
    copies, longest = np.zeros(frames, bool), 1
    sets: list[tuple[int, frozenset[int]]] = []
    passes = {}
    for number in np.unique(pass_index):
        at = np.flatnonzero((pass_index == number) & counted)
        own = digest[at]
        _, first = np.unique(own, return_index=True)
        copies[np.delete(at, first)] = True
        longest = max(longest, _longest_run(own))
        found = frozenset(own.tolist())
        known = next((n for n, s in sets if found and len(found & s) > 0.5 * len(found)), None)
        if known is not None:
            passes[int(number)] = known
        sets.append((int(number), found))
    return Repeats(copies, longest, alike | passes)


def _has_noise(z_mm: AnyArray) -> bool:
    """Whether neighbouring returns of some frames scatter as measured ones do."""
    some = z_mm[np.unique(np.linspace(0, len(z_mm) - 1, 9).astype(int))].astype(np.float64)
    bend = np.abs(np.diff(some, n=2, axis=1))
    bend = bend[np.isfinite(bend)]
    return bool(bend.size and np.median(bend) > NOISE_MM)


def _longest_run(values: Int) -> int:
    if not len(values):
        return 0
    edges = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0, [True]]))
    return int(np.diff(edges).max())


def _alike_passes(z_mm: AnyArray, pass_index: Int) -> dict[int, int]:
    """By copy, the original, of passes of as many frames whose noise is the same although no frame is bit for bit.

    A second pass over the same plate has the same shape, but noise of its own.
    """
    numbers = np.unique(pass_index)
    found, bends = {}, {}
    for number in numbers:
        at = np.flatnonzero(pass_index == number)
        some = at[np.unique(np.linspace(0, len(at) - 1, 5).astype(int))]
        bends[int(number)] = (len(at), np.diff(z_mm[some].astype(np.float64), n=4, axis=1))
    for i, copy in enumerate(map(int, numbers)):
        for original in map(int, numbers[:i]):
            (count_a, a), (count_b, b) = bends[copy], bends[original]
            if count_a == count_b and a.shape == b.shape and _correlation(a, b) > ALIKE:
                found[copy] = original
                break
    return found


def _correlation(a: AnyArray, b: AnyArray) -> float:
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 100:
        return 0.0
    u, v = a[both], b[both]
    limit = 10.0 * np.median(np.abs(u)) + 1e-12  # jumps have no part in it
    inside = (np.abs(u) < limit) & (np.abs(v) < limit)
    if inside.sum() < 100 or not u[inside].std() * v[inside].std() > 0:
        return 0.0
    return float(np.corrcoef(u[inside], v[inside])[0, 1])
