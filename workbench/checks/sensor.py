"""What a sensor's own filters leave in its profiles: smoothing over columns, steps of values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from workbench.geometry.blocks import as_input
from workbench.geometry.medians import median, row_medians
from workbench.kernels import kernel
from workbench.units import THIRD, TO_SD, AnyArray, Bool, Float, Int

PIECE = 48  # columns of one straight piece
LAGS = 24
SAMPLE, FEW, MANY = 40, 12, 120  # frames
LEAST_PIECES = 40
MEAN_CORRELATION, LEAST_BENDS = -0.25, 1000
ENOUGH = 8000  # values whose median is known to 1.5 %
PERIODS, NEAR = np.arange(0.1, 0.481, 0.01)[:, None], 5  # per column; of these, that one missing period spans
WIPED = 4.0  # times less power than at some longer and some shorter period: noise has 2.6 at most, a mean over 5 13
CURVED = 4  # terms of a cubic, which follows a sphere or a wave within a piece
WIDTHS = np.geomspace(1.0, PIECE, 400)  # columns of a Gaussian filter
MOST_RESOLVED = 6.0  # columns of a mean whose periods a piece tells apart
LEAST_PAIRS = 500
UNEVEN_SHARE = 0.02
BENT = 4.0  # median bends: an outlier that was averaged enters and leaves the mean by a smaller one
STRAIGHT, LEAST_NOISE_MM = 1.4, 1e-6  # median misfits: a bent, broken or rough piece has more; held values have less
ROUNDED, NO_NOISE_MM = 4.0, 3e-5  # misfits without noise: steps of float32, or less than what any filter leaves of one
QUIET_MM = 1e-3  # second differences of lateral places then: with axes swapped the noise is in these
THIRD_OF_NOISE = THIRD / TO_SD  # the median of third differences: rays in a fan bend a steep face
EVEN = 0.05  # by how much steps that are alike differ
TOP, HALF, BELOW = (np.linspace(*ends, 9) for ends in ((0.42, 0.5), (0.2, 0.3), (0.1, 0.3)))  # per sample: `fading`
FILTERED = 0.05  # as little of the noise is left at two columns where a filter has smoothed by 0.7 columns and more
DIGITS = 4.0  # times the power of rounding: no more than that is left
LEAST_ROWS = 20
SERIES, BLOCK = 80, 1920  # columns that are followed from frame to frame, and over how many frames
# Quaternions that are looked at, numbers that are alike, how many have to differ, how near to a multiple they are, how
# many are.
QUATERNIONS, ALIKE, DIFFERENT, ON_STEP, MOST_ON_STEP = 200, 1e-5, 3, 2e-3, 0.9
SLOPES = 0, 1, 2, 3  # columns before a gap, over which its slope is taken; 0: the last range is held
SURE_SD, MOST_MORE = 4.0, 0.03  # 80 recordings of the third simulator have up to 4.3, with too few to count
# Times the logarithm of how many lie one place off over two off: normal noise is denser at its middle than these on
# average by 0.8 of that; noise of heavy tails by more.
PEAKED = 2.5
# Of second differences: medians within which noise is dense; digits of float32 a bin, and times coarser from one to the
# next; bins; share of their mean that is a valley.
CORE, SCALES, COARSER, LEAST_BINS, VALLEYS, VALLEY = 2.5, (1, 6, 36, 216), 6, 4, 40, 0.25
PACKED = "returns packed into the first columns, lost ones left out: export every column, lost returns as NaN"
WIDER = 4.0  # times the digits: steps of fewer hide where noise is wide
LEAST_FILLED, APART = 30, 8  # columns apart, whose noise no median or hold has made alike
POSITION_DIGIT = 1e-6  # mm: a position in metres or inches is a multiple to no more
STEP_SHARE = 0.02  # of the least step: values that are off a multiple by more are not rounded to it


@dataclass(frozen=True, slots=True)
class SensorTraces:
    """What the noise of profiles and the values themselves show; NaN where nothing does."""

    mean_columns: float  # width of a moving mean over columns, or of a filter that smooths likewise; 0: none
    mean_frames: float  # likewise from frame to frame
    held_end_share: float  # of short gaps, those that a filter has filled; nearly 1 of a median


def sensor_traces(x_mm: AnyArray, z_mm: AnyArray, pass_index: Int) -> SensorTraces:
    """Look at some frames of lateral places and ranges (N, M) of passes (N,); without noise no mean leaves a trace."""
    rows, series = some(z_mm), _series(z_mm, pass_index)
    z, many = rows.astype(np.float64), some(z_mm, MANY).astype(np.float64)
    digit = _digit(many, step_mm(rows))
    mean, pieces = moving_mean(z), _straight_pieces(z)
    if len(pieces) < LEAST_PIECES:  # where each frame has one, or none
        pieces = _straight_pieces(many)
    least = ROUNDED * float(np.spacing(np.float32(np.nanmax(np.abs(z), initial=0.0))))
    if len(pieces) and np.median(pieces.std(axis=1)) < max(least, NO_NOISE_MM) and _bends(some(x_mm)) < QUIET_MM:
        return SensorTraces(0.0, 0.0, _filled_share(many, digit))
    if len(pieces) >= LEAST_PIECES and fading(pieces, digit) < FILTERED:  # smoothed: by how far neighbours are alike
        level = _off_trend(pieces, CURVED)
        alike = _by_lag(level, np.ones(level.shape, bool), 3)
        one, two = alike[0] - alike[1:3] - digit**2 / 12.0
        mean = max(mean, _gaussian_width(float(two) / max(float(one), 1e-30)))
    elif len(pieces) >= LEAST_PIECES and mean <= MOST_RESOLVED:
        wiped = wiped_out(pieces)
        mean = (mean or wiped) if wiped else 0.0
    return SensorTraces(
        mean_columns=mean,
        mean_frames=moving_mean(series) if _bends(series) < _bends(z) else 0.0,  # else the part moves in the view
        held_end_share=_filled_share(many, digit),
    )


def _gaussian_width(ratio: float) -> float:
    """Columns of a mean that leaves as much noise as a Gaussian filter, by how much more neighbours' neighbours differ.

    Of what a Gaussian of standard deviation s leaves, noise k columns apart has a correlation of exp(-k^2 / (4 s^2)),
    and the mean squared differences over two columns and over one have a ratio of 1 + a + a^2 + a^3, a that of
    neighbours. A cubic taken off changes both alike. 0: neighbours are not alike; at most PIECE.
    """
    neighbours = np.exp(-math.pi / WIDTHS**2)
    return float(np.interp(ratio, 1.0 + neighbours + neighbours**2 + neighbours**3, WIDTHS, left=0.0))


def some(grid: AnyArray, count: int = SAMPLE) -> AnyArray:
    """So many frames of a grid (N, M), evenly."""
    return np.asarray(grid[np.unique(np.linspace(0, len(grid) - 1, count if len(grid) else 0).astype(int))])


def shared_range(z_mm: AnyArray) -> tuple[float, float] | None:
    """A range (mm) that far more returns of a grid (N, M) have to the digit than any other, and their share; or None.

    Only 0, the least and the greatest one are looked at: what sensors write for no return, or where they saturate.
    """
    rows = some(z_mm)
    found, count = np.unique(rows[np.isfinite(rows)], return_counts=True)
    if len(found) < FEW:
        return None
    most, others = int(count.argmax()), count[1:-1][found[1:-1] != 0.0]
    is_code = found[most] in (found[0], found[-1], 0.0) and count[most] > FEW * others.max(initial=0)
    return (float(found[most]), float(count[most] / count.sum())) if is_code else None


def steadiest(x_mm: AnyArray, z_mm: AnyArray) -> tuple[float, str]:
    """How little a statistic of some frames (N, M) varies, over what noise makes of it; the least of these, and which.

    Noise is by how even and odd columns differ, of ranges by no more than neighbours do: a median that lies between two
    faces is here on one of them, there on the other. 0 of frames that were zeroed, levelled or centred one by one, 0.7
    and more of others; 1 at most, and of what is rounded to steps wider than the noise. NaN: too few tell.
    """
    grids = np.stack([some(x_mm), some(z_mm)]).astype(np.float64)
    grids[:, np.isnan(grids).any(axis=0)] = np.nan
    wide = np.isfinite(grids[1, :, ::2]).any(axis=1) & np.isfinite(grids[1, :, 1::2]).any(axis=1)
    if wide.sum() < FEW:
        return float("nan"), ""
    every, even, odd = (_statistics(grids[:, wide, start::step]) for start, step in ((0, 1), (0, 2), (1, 2)))
    noise, least_mm = 0.5 * (even - odd).std(axis=1), max(step_mm(grids[1]), LEAST_NOISE_MM)
    noise[:3] = np.minimum(noise[:3], _bends(grids[1]))
    share = np.where(noise > least_mm, every.std(axis=1) / np.maximum(noise, least_mm), 1.0)
    names = "mean range", "median range", "least range", "slope", "mean place along x"
    return min(float(share.min()), 1.0), names[int(share.argmin())]


def _statistics(grids: Float) -> Float:
    """Mean, median, least and slope of ranges, mean of places, (5, n): of places and ranges (2, n, M)."""
    (x, z), means = grids, np.nanmean(grids, axis=2)
    off = x - means[0, :, None]
    slope = np.nansum(off * z, axis=1) / np.maximum(np.nansum(off**2, axis=1), LEAST_NOISE_MM)
    return np.stack([means[1], np.nanmedian(z, axis=1), np.nanmin(z, axis=1), slope, means[0]])


def is_packed(x_mm: AnyArray, z_mm: AnyArray) -> bool:
    """Whether the returns of every frame of a grid (N, M) fill its first columns, and x leaps where some are left out.

    Their number varies; most frames have steps that are half as long again as the usual one.
    """
    seen = np.isfinite(z_mm)
    if np.ptp(seen.sum(axis=1)) == 0 or (seen[:, 1:] & ~seen[:, :-1]).any():
        return False
    step = np.abs(np.diff(np.where(seen, x_mm, np.nan), axis=1))
    return bool((step > 1.5 * np.nanmedian(step)).any(axis=1).mean() > 0.5)


def _filled_share(z: Float, digit_mm: float) -> float:
    """Of the short gaps in rows of ranges (n, M), the share that a filter has filled; nearly 1 of a median.

    Such a value lies to the digit where its neighbour, or that and the slope over one to three columns, put it. How
    many noise puts there is told by their numbers one and two digits off: by their mean, where noise is wide, and by
    a parabola through them. What is more than either, by SURE_SD standard deviations, MOST_MORE and as much as noise
    of heavy tails is denser at its middle, is a filter's. Noise below the digit makes such values by itself. How wide
    noise is, these numbers tell too: on a rough face neighbours are more alike than returns far apart.
    """
    found, spread = 0.0, _bends(np.diff(z[:, ::APART], axis=1)) / THIRD_OF_NOISE
    if not digit_mm <= spread < math.inf:
        return 0.0
    for way in (z, z[:, ::-1]):
        for k in SLOPES if way is z else SLOPES[2:]:  # over one column, or none, both ways are the same
            # what is off is a multiple of 1 / k where ranges are rounded: counts end halfway between two of these
            share, edge = (1.0 / k, (k // 2 + 0.5) / k) if k else (0.0, 0.5)
            there, one, two = np.maximum(1.0, _counts_off(as_input(way), k, share, edge * digit_mm)).tolist()
            if two - one > SURE_SD * math.sqrt(one + two):
                continue  # steps wider than this digit, as of a mean of rounded ranges; noise is the denser, the nearer
            flat, bent = 0.25 * (one + two), max((2.0 * one - 0.5 * two) / 3.0, 0.0)  # one and two: on both sides
            peak = max(MOST_MORE, PEAKED * (math.log(one / two) - SURE_SD * math.sqrt(1.0 / one + 1.0 / two)))
            surely = max(
                there - flat * (1.0 + peak) - SURE_SD * np.sqrt(1.25 * flat + 1.0),
                there
                - bent * (1.0 + MOST_MORE)
                - max(bent - 0.5 * one, 0.0)
                - SURE_SD * np.sqrt(bent + (4.0 * one + 0.25 * two) / 9.0 + 1.0),
            )
            if surely > LEAST_FILLED:
                wider = float(_counts_off(as_input(way), k, share, WIDER * edge * digit_mm)[1:].sum())
                if (one + two) * WIDER > 0.5 * wider:  # else noise leaves valleys: these are steps of a few digits
                    found = max(found, there - min(flat, bent))
    lost = np.isnan(z)
    short = lost[:, 1:-1] & ~(lost[:, :-2] & lost[:, 2:])
    return found / (found + float(np.count_nonzero(short))) if found else 0.0


@kernel
def _counts_off(z: Float, k: int, share: float, edge_mm: float) -> Int:
    """How many ranges of rows (n, M) lie off where a share of the rise over k columns puts them: (3,).

    By less than `edge_mm`, from there to less than three times it, and from there to less than five times it.
    """
    below_one, below_three, below_five = 0, 0, 0
    for i in range(z.shape[0]):
        for j in range(k + 1, z.shape[1]):  # no branch: many at a time
            near = z[i, j - 1]
            off = abs(z[i, j] - near - (near - z[i, j - 1 - k]) * share)
            below_one += off < edge_mm
            below_three += off < 3.0 * edge_mm
            below_five += off < 5.0 * edge_mm
    return np.array([below_one, below_three - below_one, below_five - below_three])


def _digit(z: Float, step_mm: float) -> float:
    """To what rows of ranges (n, M) are rounded, mm: to `step_mm` or float32's digits at least.

    Steps of a few digits of float32, and those that begin elsewhere in every row, leave valleys between the second
    differences that noise makes. Where too few differences are small enough to show valleys, it is the least step that
    the next coarser look shows.
    """
    digits = np.spacing(np.abs(z).astype(np.float32))
    coarsest = float(np.nanmax(digits, initial=np.spacing(np.float32(1.0))))
    found, may_be = _step_among(z, coarsest)
    if not found and np.isfinite(digits).any():  # coarser digits fill the valleys between steps of a few finer ones
        usual = float(np.nanmedian(digits))
        found, _ = _step_among(np.where(digits > usual, np.nan, z), usual)
    return max(step_mm, found or may_be)


def _step_among(z: Float, digit: float) -> tuple[float, float]:
    """The step that rows of ranges (n, M) of such digits show, mm, 0: none; and the least that it may be."""
    off = np.abs(np.diff(z, n=2, axis=1)) / digit
    off = off[np.isfinite(off)]
    if len(off) < LEAST_PAIRS:
        return 0.0, digit
    core, may_be = CORE * median(off[:: 1 + off.size // ENOUGH]), 1
    for scale in SCALES:
        bins = min(VALLEYS, int(core / scale))
        near = off[off < bins * scale] / scale
        found = _first_peak(near, bins) if bins >= LEAST_BINS else 0.0
        if found:
            return digit * scale * found, digit
        if bins == VALLEYS and len(near) < LEAST_PAIRS:
            may_be = COARSER * scale
    return 0.0, digit * may_be


def _first_peak(off: Float, bins: int) -> float:
    """Where values (n,) between 0 and `bins` gather beyond a valley; 0: they have none.

    Of steps, many lie one step away beside those at 0; beyond a valley in the tail of noise, few do.
    """
    count = np.bincount(off.astype(int), minlength=bins).astype(float)
    low = np.flatnonzero(count[1:] < VALLEY * count.mean())
    if len(off) < LEAST_PAIRS or not len(low):
        return 0.0
    first = 1 + int(low[0])
    high = np.flatnonzero(count[first:] > 2.0 * VALLEY * count.mean())
    if not len(high):
        return 0.0
    begin = first + int(high[0])
    ends = np.flatnonzero(count[begin:] < VALLEY * count.mean())
    end = begin + int(ends[0]) if len(ends) else bins
    if count[begin:end].sum() < VALLEY * count[:first].sum():
        return 0.0
    return float(np.median(off[(off >= begin) & (off < end)]))


def _bends(z: Float) -> float:
    """Median size of the second differences along rows of ranges; infinite: there are none."""
    bend = np.abs(np.diff(z, n=2, axis=1))
    bend = bend[np.isfinite(bend)]
    return median(bend[:: 1 + bend.size // ENOUGH]) if bend.size else float("inf")


def fading(rows: Float, digit_mm: float) -> float:
    """Power of noise (n, PIECE) at periods of about two samples, over that at longer ones; NaN: too few rows.

    White noise has 1, noise with a correlation of 0.8 from neighbour to neighbour 0.25, for it still is new in each
    sample; roughness adds to long periods, but the sensor's own noise stays at all. A smoothing filter takes it away:
    a Gaussian of standard deviation s samples leaves exp(-(2 pi f s)^2) of the power at frequency f. A corner within
    the rows adds to long periods as roughness does: periods of four samples count too, unless all that is left at two
    is the rounding of values to `digit_mm`.
    """
    if len(rows) < LEAST_ROWS:
        return float("nan")
    top, below, half = _powers(rows, TOP, BELOW, HALF)
    rounding = _white(digit_mm) / 12.0 * len(TOP)
    return top / max(below if top < DIGITS * rounding else min(below, half), 1e-300)


def _series(z_mm: AnyArray, pass_index: Int) -> Float:
    """Ranges (columns, frames) of some columns over the middle of the longest pass."""
    at = np.flatnonzero(pass_index == np.bincount(pass_index - pass_index.min()).argmax() + pass_index.min())
    start = max(len(at) - BLOCK, 0) // 2
    columns = some(np.arange(z_mm.shape[1]), SERIES)
    return np.asarray(z_mm[at[None, start : start + BLOCK], columns[:, None]].astype(np.float64))


def wiped_out(rows: Float) -> float:
    """The longest period that rows of noise (n, PIECE) lack, while longer and shorter ones are there, columns; or 0.

    A mean over columns has such periods, and so has a filter that leaves much of the noise alone. Noise of any other
    origin changes smoothly with the period, and a rough surface adds to long ones.

    Example:
        >>> noise = np.random.default_rng(0).normal(size=(200, PIECE + 4))
        >>> filtered = np.apply_along_axis(np.convolve, 1, noise, np.ones(5) / 5.0, "valid")
        >>> wiped_out(noise[:, :PIECE]), round(wiped_out(filtered), 1)
        (0.0, 5.0)
    """
    power = np.array(_powers(rows, *PERIODS))
    around = np.minimum(np.maximum.accumulate(power), np.maximum.accumulate(power[::-1])[::-1])
    lacks = around > WIPED * power
    first = int(lacks.argmax())
    return float(1.0 / PERIODS[first + int(power[first : first + NEAR].argmin())][0]) if lacks.any() else 0.0


def _off_trend(rows: Float, terms: int = 2) -> Float:
    """Rows (n, PIECE) less their straight line over the columns: a mean of ranges leaves the lateral places noisy."""
    t = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, PIECE), terms))[0]
    return np.asarray(rows - (rows @ t) @ t.T)


def _powers(rows: Float, *bands: Float) -> tuple[float, ...]:
    """Median over rows (n, PIECE) of their power at the frequencies (k,) per column of each band, all together."""
    frequency = np.concatenate(bands)
    phase = 2.0 * np.pi * np.arange(PIECE)[:, None] * np.minimum(frequency, 1.0 - frequency)
    wave = np.hanning(PIECE)[:, None] * np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
    square = (rows @ wave) ** 2
    square = square[:, : frequency.size] + square[:, frequency.size :]
    ends = np.cumsum([0, *map(len, bands)])
    return tuple(float(np.median(square[:, i:j].sum(axis=1))) for i, j in pairwise(ends))


def _white(sigma: float) -> float:
    """Power of white noise of this standard deviation at each frequency, as `_powers` have it."""
    return sigma**2 * float((np.hanning(PIECE) ** 2).sum())


def _straight_pieces(z: Float) -> Float:
    """Pieces (n, PIECE) of rows of ranges (m, M) that returned as a whole, less their line; not bent or rough ones."""
    pieces = z[:, : z.shape[1] // PIECE * PIECE].reshape(-1, PIECE)
    off = _off_trend(pieces[np.isfinite(pieces).all(axis=1)])
    size = off.std(axis=1)
    return off[(size > LEAST_NOISE_MM) & (size < STRAIGHT * np.median(size))] if size.size else off


def _by_lag(values: Float, used: Bool, lags: int) -> Float:
    """Mean product (lags,) of values (n, M) so many columns apart, of those that are used; 0: of too few. By FFT."""
    size = _fast_size(values.shape[1] + lags)
    total, count = (
        np.fft.irfft((np.abs(np.fft.rfft(one, size)) ** 2).sum(axis=0), size)[:lags]
        for one in (values, used.astype(float))
    )
    return np.asarray(total * (count > LEAST_PAIRS) / np.maximum(count, 1.0))


def _fast_size(least: int) -> int:
    """A length that an FFT is fast at; `scipy.fft` has the least one, and takes 0.15 s of every start to import."""
    return min(odd << max(0, math.ceil(math.log2(least / odd))) for odd in (1, 3, 5, 9, 15))


def moving_mean(z: Float) -> float:
    """Columns over which rows of ranges (n, M) were averaged; 0: over none.

    A mean over k columns makes z[j + 1] - z[j] the difference of two returns k columns apart. So second differences,
    which know nothing of a straight face, have a correlation of -1/2 at k columns apart. Noise of any other origin has
    its least there at one column, and fades.
    """
    bend = np.diff(z, n=2, axis=1)
    known = np.isfinite(bend)
    if known.sum() < LEAST_BENDS or bend.shape[1] < 4:
        return 0.0
    bend[np.abs(np.where(known, bend, np.inf)) > BENT * np.median(np.abs(bend[known]))] = np.nan
    used = np.isfinite(bend)
    bend = np.where(used, bend, 0.0)
    products = _by_lag(bend, used, min(LAGS, bend.shape[1] - 1))
    if not products[0] > 0.0:
        return 0.0
    best = 2 + int(np.argmin(products[2:]))
    alternate = products[1] < 3.0 * MEAN_CORRELATION * products[0]  # as of two cameras; a mean has 2, noise 8/3
    return float(best) if products[best] < MEAN_CORRELATION * products[0] and not alternate else 0.0


def step_mm(values: AnyArray) -> float:
    """The step of which all values are multiples, as far as float32 can tell; 0: none."""
    found = np.unique(values[np.isfinite(values)])
    if len(found) < 3:
        return 0.0
    found = found.astype(np.float64)
    gaps = np.diff(found)
    digit = float(np.finfo(np.float32).eps * np.abs(found).max())  # as large as that of float32, or up to twice
    gaps = gaps[gaps > 2.0 * digit]
    if not gaps.size:
        return 0.0
    step = float(np.percentile(gaps, 2))
    if step < 20.0 * digit:  # finer than what float32 could tell apart
        return 0.0
    near = gaps[gaps < 30.0 * step]
    step = float(near[near < 1.5 * step].mean())  # single gaps are rounded to float32's digits
    off = np.abs(near / step - np.round(near / step)) * step
    return step if np.percentile(off, 95) < STEP_SHARE * step + 4.0 * digit else 0.0


def uneven_step_mm(x_mm: AnyArray, z_mm: AnyArray) -> float:
    """The step to which lateral places of a grid (N, M) were rounded, where that made their spacing uneven; else 0."""
    x = np.where(np.isfinite(some(z_mm)), some(x_mm), np.nan)  # any x may be written for lost returns
    step, spacing = step_mm(x), np.abs(np.diff(x, axis=1))
    spacing = spacing[np.isfinite(spacing)]
    uneven = np.abs(spacing - np.median(spacing)) > 0.5 * step if spacing.size else np.zeros(1, bool)
    return step if uneven.mean() > UNEVEN_SHARE else 0.0


def uneven_share(grid: AnyArray) -> float:
    """Share of the steps from column to column of some frames (N, M) that differ from the frame's usual one, or are 0.

    NaN: no two neighbours are seen.
    """
    step = np.diff(some(grid, FEW).astype(np.float64), axis=1)
    usual = row_medians(step)[:, None]
    known = np.isfinite(step)
    return float((np.abs(step - usual) >= EVEN * np.abs(usual))[known].mean()) if known.any() else float("nan")


def column_pitch_mm(x_mm: AnyArray) -> float:
    """Mean distance of neighbouring columns of some frames (N, M); NaN: there is none."""
    spacing = np.abs(np.diff(some(x_mm, FEW).astype(np.float64), axis=1))
    spacing = spacing[np.isfinite(spacing)]
    return float(spacing.mean()) if spacing.size else float("nan")


def position_step_mm(position_mm: Float) -> float:
    """The step, 10, 1 or 0.1 mm, of which all coordinates of the positions (n, 3) are multiples; 0: of none."""
    for step in (10.0, 1.0, 0.1):
        if (np.abs(position_mm / step - np.round(position_mm / step)) < POSITION_DIGIT / step).all():
            return step
    return 0.0


def quaternion_step(wxyz: Float) -> float:
    """The decimal step to which (nearly) all quaternions (n, 4) were rounded before they got their length 1; 0: none.

    Such a step turns poses by as much, in rad (root mean square). Quaternions about an axis of the robot tell nothing:
    numbers that are 0 or alike are multiples of anything.
    """
    some = np.abs(np.unique(wxyz, axis=0))
    some = some[np.linspace(0, len(some) - 1, min(len(some), QUATERNIONS)).astype(int)]
    numbers = np.sort(some, axis=1)
    some = some[(np.diff(numbers, axis=1) > ALIKE).sum(axis=1) + (numbers[:, 0] > ALIKE) >= DIFFERENT]
    for step in (0.1, 0.01, 0.001):
        largest = some.max(axis=1, initial=0.0)
        near = np.round(largest / step)[:, None] + np.array([-1.0, 0.0, 1.0])  # the length was 1 to within a step
        multiple = some[:, None, :] * (near / np.maximum(largest, step)[:, None])[:, :, None]
        found = (np.abs(multiple - np.round(multiple)) < ON_STEP).all(axis=2).any(axis=1)
        if len(some) and found.mean() > MOST_ON_STEP:
            return step
    return 0.0
