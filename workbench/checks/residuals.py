"""What frames leave of a smooth edge together: a step within a pass, every second frame beside the others, waves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from workbench.geometry.medians import median, row_medians
from workbench.units import Bool, Float, Int, Shaped

BINS, FRAMES_A_BIN = 96, 3  # of a pass at the most; frames of each at the least, whose median withstands strays
# Bins on each side of a step: looked at, and left out right beside it, for one that is sudden and one that takes a
# while; needed.
SCALES, LEAST = ((8, 1), (16, 2)), 4
# Standard uncertainties of a step, of two places together: good raw edges reach 4.5, rough ones 6.9, slips of 0.1 to
# 0.5 mm 6 to 60.
SURE_STEP, SURE_ROUGH = 5.5, 8.0
GAP = 2.5  # times the usual distance of bins: what lies beyond tells no step
SURE = 5.0  # of a difference of every second frame, or of what frames in a row go together by
STRAY = 4.0  # standard deviations beyond which a frame counts no more for what its neighbours share
LAGS, WINDOWS = (1, 2, 3), (1, 6)  # frames apart; over the whole edge, and over a part of it
LEAST_FRAMES = 48  # that tell how frames go together

Along = tuple[Shaped[Float, "N 3"], Shaped[Float, "N 3"]]  # places in the base, and the direction in which they count


def steps_mm(s: Float, ways: Sequence[Sequence[Along]], passes: Int, rough: bool = False) -> Float:
    """How uncertain an edge is along each of `ways`, at N frames at arc lengths s (N,), by a step within its pass, mm.

    An encoder that slips moves all that comes after it, once, while the profiles go on. Which side of it is right
    nothing tells: half of its square is in both. A step of the edge itself looks alike. Where several places tell one
    way, all of them must step: what covers an end of a face moves that one alone. 0 where none is certain; of a rough
    face it must be more so, which steps by itself.
    """
    out = np.zeros((s.size, len(ways)))
    for number in np.unique(passes):
        mine = np.flatnonzero((passes == number) & np.isfinite(s))
        if mine.size >= LEAST_FRAMES:
            here = [[(place[mine], axis[mine]) for place, axis in way] for way in ways]
            scales = SCALES[:1] if rough else SCALES
            found = max((_step(s[mine], here, *scale) for scale in scales), key=lambda one: one.certain)
            if found.certain > (SURE_ROUGH if rough else SURE_STEP):
                out[mine] = np.abs(found.mm) / math.sqrt(2.0)
    return out


class _Step(NamedTuple):
    certain: float  # its standard uncertainties, of all ways together
    mm: Shaped[Float, " w"]  # along each way


def _step(s: Float, ways: Sequence[Sequence[Along]], looked: int, beside: int) -> _Step:
    """The step that is most certain, of frames of one pass in order of time."""
    size = max(FRAMES_A_BIN, s.size // BINS)
    bins = s.size // size
    mean_s = s[: bins * size].reshape(bins, size).mean(axis=1)
    between = np.arange(LEAST + beside, bins - LEAST - beside + 1)
    if not between.size:
        return _Step(0.0, np.zeros(len(ways)))
    reach = np.arange(beside, beside + looked)
    around = between[:, None] + np.concatenate([-reach[::-1] - 1, reach])
    inside = (around >= 0) & (around < bins)
    around = around.clip(0, bins - 1)
    gap = np.abs(np.diff(mean_s))
    stretch = np.concatenate([[0], np.cumsum(gap > GAP * median(gap))])
    inside &= (stretch[around] == stretch[between][:, None]) & (stretch[between] == stretch[between - 1])[:, None]
    x = mean_s[around] - 0.5 * (mean_s[between - 1] + mean_s[between])[:, None]
    x = x / np.maximum(np.abs(x).max(axis=1, keepdims=True), 1e-9)
    side = np.broadcast_to(np.repeat([-0.5, 0.5], looked), x.shape)
    window = _Window(size, between, around, inside, np.stack([side, np.ones_like(x), x, x**2, x**3], axis=2))
    found, certain = np.zeros((len(ways), between.size)), np.zeros(between.size)
    for k, way in enumerate(ways):
        told = np.stack([_fitted_steps(window, place, axis) for place, axis in way])
        least = np.take_along_axis(told, np.abs(told[:, 0]).argmin(axis=0)[None, None], axis=0)[0]
        alike = (np.sign(told[:, 0]) == np.sign(told[:1, 0])).all(axis=0)
        found[k] = np.where(alike, least[0], 0.0)
        certain += np.where(alike, np.abs(told[:, 1]).min(axis=0) ** 2, 0.0)
    best = int(certain.argmax())
    return _Step(math.sqrt(certain[best]), found[:, best])


class _Window(NamedTuple):
    """The bins around each of k places between bins, r of them, and what is fitted to them."""

    size: int  # frames a bin
    between: Shaped[Int, " k"]
    around: Shaped[Int, "k r"]
    inside: Shaped[Bool, "k r"]
    shape: Shaped[Float, "k r 5"]  # the step, and a cubic


def _fitted_steps(window: _Window, place: Float, axis: Float) -> Float:
    """Steps (2, k) of places (n, 3) along axes (n, 3), mm, and over their standard uncertainties; 0: not told."""
    count = len(place) // window.size
    cells = place[: count * window.size].reshape(count, window.size, 3).transpose(0, 2, 1).reshape(-1, window.size)
    middle = row_medians(cells).reshape(count, 3)
    across = middle[window.around] - middle[window.between][:, None]
    value = np.einsum("kri,ki->kr", across, axis[: count * window.size : window.size][window.between])
    weight = (window.inside & np.isfinite(value)).astype(float)
    value, half = np.nan_to_num(value), weight.shape[1] // 2
    enough = np.minimum(weight[:, :half].sum(axis=1), weight[:, half:].sum(axis=1)) >= LEAST
    if not enough.any():
        return np.zeros((2, enough.size))
    shape = window.shape
    weighted = np.swapaxes(weight[:, :, None] * shape, 1, 2)
    inverse = np.linalg.inv(weighted @ shape + 1e-9 * np.eye(shape.shape[2]))
    fitted = (inverse @ (weighted @ value[:, :, None]))[:, :, 0]
    left = weight * (value - np.einsum("kri,ki->kr", shape, fitted))
    variance = (left**2).sum(axis=1) / np.maximum(weight.sum(axis=1) - shape.shape[2], 1.0)
    variance = np.maximum(np.maximum(variance, median(variance[enough])), 1e-12)
    step = np.where(enough, fitted[:, 0], 0.0)
    return np.stack([step, step / np.sqrt(variance * np.maximum(inverse[:, 0, 0], 1e-12))])


def every_second(left: Float, passes: Int) -> float:
    """Half of what every second frame differs from those between, of residuals (N,); 0 where it is not certain.

    An exposure, or two lasers, that alternate: nothing tells which of them measure the part.
    """
    found = 0.0
    for number in np.unique(passes):
        mine = left[passes == number]
        one, other = (of[np.isfinite(of)] for of in (mine[::2], mine[1::2]))
        if min(one.size, other.size) < LEAST_FRAMES // 2:
            continue
        middle = median(one), median(other)
        scatter = [median(np.abs(of - m)) / 0.6745 for of, m in zip((one, other), middle, strict=True)]
        apart = abs(middle[0] - middle[1])
        if apart > SURE * 1.2533 * math.hypot(scatter[0] / math.sqrt(one.size), scatter[1] / math.sqrt(other.size)):
            found = max(found, 0.5 * apart)
    return found


def together_u(s: Float, left: Float, passes: Int, at: Float, floor: float = 0.0) -> Float:
    """What neighbouring frames leave of a smooth course together, at stations (k,), of residuals (N,) at s (N,).

    Noise is each frame's own. What goes together from frame to frame, or turns its sign with them, is the part: waves
    that a course does not follow, such as chatter's. By products of frames some apart, over the whole edge and over a
    part of it, where they are certain; `floor`: standard deviation that frames share by their columns.
    """
    out = np.zeros(at.size)
    for number in np.unique(passes):
        on = np.flatnonzero((passes == number) & np.isfinite(s) & np.isfinite(left))
        if on.size < LEAST_FRAMES:
            continue
        on = on[np.argsort(s[on], kind="stable")]
        usual = STRAY * median(np.abs(left[on])) / 0.6745
        value = left[on].clip(-usual, usual)
        shared = np.zeros(on.size)
        for parts in WINDOWS:
            window = max(on.size // parts, LEAST_FRAMES)
            count, own = (_over(of, window) for of in (np.ones(on.size), value**2))
            for lag in LAGS:
                mean = np.abs(_over(np.append(value[lag:] * value[:-lag], np.zeros(lag)), window)) / count
                shared = np.maximum(shared, np.where(mean > SURE * own / count / np.sqrt(count), mean, 0.0))
        out = np.maximum(out, np.sqrt(np.maximum(np.interp(at, s[on], shared) - floor**2, 0.0)))
    return out


def _over(value: Float, window: int) -> Float:
    """Sums of values (n,) over `window` of them about each."""
    total = np.concatenate([[0.0], np.cumsum(value)])
    first = np.maximum(np.arange(value.size) - window // 2, 0)
    return np.asarray(total[np.minimum(first + window, value.size)] - total[first])
