"""Second returns (ghosts) of a part of a face: places on it whose returns stand beside it in frame after frame."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from workbench.geometry import tracking
from workbench.geometry.medians import medians
from workbench.units import Bool, Float, Float32, Int

BLOCKS, BLOCK = 60, 16  # stretches of a pass that are judged each by itself, at most; frames looked at of each, about
PLACES = 16  # on a face, along it
NEAR_MM = 0.6  # of a face's line: returns further off are another surface's
ON, ASIDE, WIDER = 0.5, 2.0, 2.0  # times a return's noise: places on the face, and off it, with a jump; their scatter
ALIKE = 0.7  # of the furthest of them, at an end of the face, is how far off the nearest one is
LEAST_RETURNS = 40  # in a place: of fewer the scatter is known to a fifth at best

_POWERS = np.linspace(-1.0, 1.0, PLACES)[:, None] ** np.arange(3)
_THREE = np.array(list(combinations(range(PLACES), 3)))
_THROUGH = _POWERS @ np.linalg.inv(_POWERS[_THREE])  # all places of the parabola through any three


def ghosts(x: Float32, z: Float32, keep: Bool, sums: Float, seen: Bool) -> Bool:
    """Returns (n, M) of a pass within bevel or root face that are none of it; sums (n, 4, 8): `geometry.tracking`'s.

    A face is straight, or bows: the parabola through three of its places that most of the others lie on.
    """
    out = np.zeros(keep.shape, bool)
    frames = np.flatnonzero(seen)
    if not frames.size:
        return out
    blocks = min(BLOCKS, max(1, frames.size // BLOCK))
    number = ((np.arange(frames.size) + 0.5) * blocks / frames.size).astype(np.int64)
    step = frames.size // (BLOCKS * BLOCK) // 2 * 2 + 1  # odd, and the first as far from its end as the last
    looked = slice((frames.size - 1) * (step + 1) // 2 % step, None, step)
    for face in (tracking.BEVEL, tracking.ROOT):
        off, place, _ = _image(x, z, keep, sums[:, face], frames[looked])
        middle, scatter = _medians(off, place + number[looked, None] * (PLACES + 1), blocks)
        for k in range(blocks):
            beside = _beside(middle[k], scatter[k])
            if beside.any():
                block = frames[number == k]
                _, place, part = _image(x, z, keep, sums[:, face], block)
                out[block, part] |= np.append(beside, False)[place]
    return out


def _image(x: Float32, z: Float32, keep: Bool, sums: Float, frames: Int) -> tuple[Float, Int, slice]:
    """How far returns (f, m) lie off the line of a face, mm, their places on it, rising with x, and their columns.

    Those of none have the place PLACES.
    """
    row = sums[frames]
    ends = row[:, [tracking.FIRST, tracking.LAST]].astype(np.int64)
    at, level, sxx, sxz = row[:, [tracking.X_MEAN, tracking.Z_MEAN, tracking.SXX, tracking.SXZ]].T[:, :, None]
    part = slice(int(ends.min()), int(ends.max()) + 1)
    across = x[frames % len(x), part].astype(float)
    ends = np.take_along_axis(across, ends - part.start, axis=1)
    low, high = ends.min(axis=1, keepdims=True), ends.max(axis=1, keepdims=True)
    off = z[frames, part] - level - sxz / sxx * (across - at)
    on = keep[frames, part] & (np.abs(off) < NEAR_MM) & (low <= across) & (across < high)
    return off, np.where(on, (across - low) / (high - low) * PLACES, PLACES).astype(np.int64), part


def _medians(off: Float, group: Int, blocks: int) -> tuple[Float, Float]:
    """Median and scatter (blocks, PLACES) of what returns are off, by their groups."""
    order = np.argsort(group.ravel().astype(np.int16), kind="stable")
    values, group = off.ravel()[order], group.ravel()[order]
    edges = np.searchsorted(group, np.arange(blocks * (PLACES + 1) + 1))
    count = np.diff(edges)
    middle = medians(values, edges)
    scatter = 1.4826 * medians(np.abs(values - np.repeat(middle, count)), edges)
    middle[count < LEAST_RETURNS] = scatter[count < LEAST_RETURNS] = np.nan
    return middle.reshape(blocks, -1)[:, :PLACES], scatter.reshape(blocks, -1)[:, :PLACES]


def _beside(middle: Float, scatter: Float) -> Bool:
    """The places (PLACES,) that stand beside the face, by the medians and the scatter of their returns."""
    known = np.isfinite(middle)
    noise = np.median(scatter[known]) if known.any() else np.nan
    wide, away = scatter > WIDER * noise, np.zeros(PLACES)
    if np.nanmax(np.abs(np.diff(middle)), initial=0.0) > ASIDE * noise:  # a wave has no sides
        curves = (_THROUGH @ middle[_THREE][..., None])[..., 0]
        off = np.abs(middle - curves) / noise
        cost = np.where(np.isfinite(off), np.minimum(off / ON, 1.0), 1.0).sum(axis=1)
        away = off[cost.argmin()]
    beside = (away > ASIDE) | wide
    on, away = np.flatnonzero(known & ~beside), np.where(beside & ~wide, away, np.nan)
    if np.isfinite(away).sum() >= on.size:  # nothing tells which of them are the face
        return np.zeros(PLACES, bool)
    for end in (slice(on[0]), slice(on[-1] + 1, None)):
        far = away[end][np.isfinite(away[end])]
        if far.size < 2 or far.min() < ALIKE * far.max():  # it may be the face that bends
            beside[end] = False
    return np.asarray(beside)
