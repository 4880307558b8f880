"""Some profiles of each pass on one lateral grid, and how each lies on the next: motion that needs no poses."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Check
from workbench.checks.sensor import some
from workbench.geometry.along import by_pass
from workbench.geometry.blocks import as_input, evenly
from workbench.geometry.medians import median_of, row_medians, select
from workbench.kernels import kernel
from workbench.units import THIRD, TO_SD, AnyArray, Bool, Float, Int, Shaped

RUNS, RUN_FRAMES = 8, 24  # of a pass, evenly: frames next to each other, which show a rough face at nearly one place
LEAST_BENDS = 8  # third differences that tell
MEDIAN, NINE_IN_TEN = 1.1774, 2.146  # length of two normal numbers of standard deviation 1
SMOOTH_MM, IN_ORDER = 0.02, 0.08  # of the profiles of a chain: what scatters by less, and less of its way, is in order
ALIKE_MM = 0.003  # what places may differ by for the noise of profiles alone
SMOOTH = 0.1  # of that, which frames next to each other scatter by: on ten rough faces by 0.01 to 0.03 of it


class Disorder(NamedTuple):
    """How much the section's place in the view jumps from frame to frame."""

    jumps_mm: float  # robust standard deviation
    share: float  # that over how much the place varies over the whole pass; about 1 where frames are out of order


def disorder(x_mm: AnyArray, z_mm: AnyArray, pass_index: Int, found: Mapping[int, Chain]) -> Disorder:
    """Of the worst pass. Frames out of order scatter as much between neighbours as over the pass.

    Where profiles some frames apart scatter, frames next to each other are asked: on a face that waves they all but
    agree. By third differences: a bend of the way has none.
    """
    worst = Disorder(float("nan"), float("nan"))  # unknown
    for number, chain in found.items():
        jumps, point, stretch = _jumps_mm([chain], MEDIAN, 50.0), chain.track[0], chain.track[2]
        varies = float(point[stretch == np.bincount(stretch).argmax()].std(axis=0).max())
        if jumps > min(SMOOTH_MM, IN_ORDER * varies):
            near = _jumps_mm(_runs(x_mm, z_mm, np.flatnonzero(pass_index == number)), NINE_IN_TEN, 90.0)
            jumps = near if near < SMOOTH * jumps else jumps
        share = jumps / varies if varies > 0.0 else 0.0 * jumps
        worst = Disorder(float(np.fmax(worst.jumps_mm, jumps)), float(np.fmax(worst.share, share)))
    return worst


def in_order(checks: Sequence[Check]) -> bool:
    """Whether profiles show the order in which they were taken, by what a recording's checks found."""
    values = [check.value for check in checks if check.name == "order_share"]
    return all(value is not None and value <= IN_ORDER for value in values)


def _jumps_mm(found: Iterable[Chain], size: float, percentile: float) -> float:
    """Standard deviation of the section's place off an even way, of some chains; NaN: too few profiles tell."""
    bends = [np.zeros(0)]
    for chain in found:
        point, _, stretch = chain.track
        bends.append(np.linalg.norm(np.diff(point, n=3, axis=0)[stretch[3:] == stretch[:-3]], axis=1))
    every = np.concatenate(bends)
    return float(np.percentile(every, percentile)) / size / THIRD if every.size >= LEAST_BENDS else float("nan")


def _runs(x_mm: AnyArray, z_mm: AnyArray, frames: Int) -> Iterator[Chain]:
    """Chains of frames next to each other."""
    for start in evenly(max(len(frames) - RUN_FRAMES, 0) + 1, RUNS):
        run = frames[start : start + RUN_FRAMES]
        yield from chains(x_mm[run], z_mm[run], np.zeros(run.size, np.int64)).values()


FRAMES = (24, 400)  # least and most profiles of a pass that are looked at
EVERY = 12  # frames between two of them, unless that gives too few or too many
GRID = 256  # places across the view
NOISY_STEPS = 5.0  # of the usual difference of neighbouring returns, that noise alone hardly makes
JUMP_STEPS = 8.0  # slope beyond which two neighbouring returns are not one surface
ROUNDS = 8  # of Gauss and Newton, at most
RIDGE = 1e-3  # of a place, mm^2: what profiles do not show stays 0
SETTLED = (1e-4, 1e-4, 1e-6)  # mm, mm, rad: motions are then known better than noise lets them
MOST_STEP = (2.0, 2.0, 0.05)  # mm, mm, rad: of one round
SHARE = 0.5  # of the places that must agree
HUBER_SIGMAS = 2.5
MISFITS, LEAST_MISFIT_MM = 3.0, 0.01  # of the usual misfit: more is another shape, such as a clamp
STEPS, LEAST_STEP_MM = 8.0, 2.0  # of the usual motion from profile to profile: more is none
SLOPE_REACHES = 3, 16  # cells of the grid on each side of a slope; of profiles whose shape their noise hides
LEAST_CELLS = 3  # of a slope
SHAPED, MEDIAN_OF_SQUARE = 10.0, 0.455  # times the noise; of a squared standard normal number
LEAST_TURN = 0.03  # rad; likewise of the usual turn


@dataclass(frozen=True, eq=False)
class Chain:
    """k profiles of one pass, and the k - 1 motions in the laser plane that lay each on the one before.

    A point (x, z) of profile i + 1 lies in profile i at (x + shift_x + turn (z - z0), z + shift_z - turn (x - x0)).
    What a profile does not show, such as a shift along its only line, is taken as 0.
    """

    frames: Shaped[Int, " k"]  # indices into the recording
    centre: Shaped[Float, " 2"]  # x0, z0, mm
    shift_x: Float  # (k - 1,) mm
    shift_z: Float  # (k - 1,)
    turn: Float  # (k - 1,) rad
    good: Bool  # (k - 1,) the two profiles agree on at least half of what both show
    turn_u: Float  # (k - 1,) standard uncertainty of the turn by the noise of the profiles, rad; large on round shapes

    @cached_property
    def track(self) -> tuple[Float, Float, Int]:
        """A point that goes with the section (k, 2), its turn (k,) rad, and the stretch (k,) that it is in.

        Stretches are parted where profiles do not agree, such as at a clamp.
        """
        angle = np.concatenate([[0.0], np.cumsum(self.turn)])
        point = self.carried(self.centre, 0)
        return point, angle, np.concatenate([[0], np.cumsum(~self.good)])

    def carried(self, start: Float, first: int) -> Float:
        """Where a point of profile `first` that goes with the section is in that and the later ones: (k - first, 2)."""
        x0, z0 = self.centre
        point = np.empty((len(self.frames) - first, 2))
        point[0] = start
        for i in range(first, len(self.frames) - 1):  # the inverse of the motion, to first order in the small turn
            x, z = point[i - first] - (self.shift_x[i], self.shift_z[i])
            f = self.turn[i]
            point[i + 1 - first] = x - f * (z - z0), z + f * (x - x0)
        return point


def chains(x_mm: AnyArray, z_mm: AnyArray, pass_index: Int, least: int = FRAMES[0]) -> dict[int, Chain]:
    """A chain for each pass (N,) of a grid (N, M) that has three profiles or more with returns.

    least: profiles of a pass that are looked at, where it has them.
    """
    found = {}
    for frames in by_pass(pass_index):
        made = _chain(x_mm, z_mm, sampled(frames, least))
        if made is not None:
            found[int(pass_index[frames[0]])] = made
    return found


def mirrored_frames(x_mm: AnyArray, z_mm: AnyArray, chain: Chain) -> list[int]:
    """From which frames on the profiles of a chain lie on those before in a mirror, and not as they are."""
    if not 0.5 < chain.good.mean() < 1.0:  # else nothing shows how well they lie on each other
        return []
    surface, at = on_grid(*(grid[chain.frames].astype(np.float64) for grid in (x_mm, z_mm)))
    is_mirrored = np.append(0, np.cumsum(~chain.good))[:, None] % 2 == 1
    other = _registered(np.where(is_mirrored, surface[:, ::-1], surface), at, chain.frames)
    return chain.frames[1:][other.good & ~chain.good].tolist() if other else []


def sampled(frames: Int, least: int = FRAMES[0]) -> Int:
    """Every twelfth of `frames`, but some at least and not too many."""
    count = int(np.clip(len(frames) // EVERY, least, FRAMES[1]))
    return some(frames, count)


def _chain(x_mm: AnyArray, z_mm: AnyArray, frames: Int) -> Chain | None:
    x, z = x_mm[frames].astype(np.float64), z_mm[frames].astype(np.float64)
    valid = np.isfinite(x) & np.isfinite(z)
    used = valid.sum(axis=1) >= 16
    if used.sum() < 3:
        return None
    surface, at = on_grid(x[used], z[used])
    return _registered(surface, at, frames[used]) if at[-1] > at[0] else None


def on_grid(x: Float, z: Float) -> tuple[Float, Float]:
    """z (k, GRID) of k profiles (k, m) at places (GRID,) over all that they show; NaN where they show no surface."""
    valid = np.isfinite(x) & np.isfinite(z)
    at = np.linspace(float(x[valid].min()), float(x[valid].max()), GRID)
    surface = np.empty((len(x), GRID))
    if at[-1] > at[0]:
        _on_grid(x, z, valid, at, surface)
    return surface, at


@kernel
def _on_grid(x: Float, z: Float, valid: Bool, at: Float, out: Float) -> None:
    """Fill out (k, m): z of k profiles at places (m,); NaN across gaps and jumps: neighbours there are no surface."""
    u, w, step, climb = np.empty(x.shape[1]), np.empty(x.shape[1]), np.empty(x.shape[1]), np.empty(x.shape[1])
    for i in range(x.shape[0]):
        count = 0
        for j in range(x.shape[1]):
            if valid[i, j]:
                u[count], w[count] = x[i, j], z[i, j]
                count += 1
        if u[0] > u[count - 1]:
            for j in range(count // 2):
                u[j], u[count - 1 - j] = u[count - 1 - j], u[j]
                w[j], w[count - 1 - j] = w[count - 1 - j], w[j]
        for j in range(1, count):  # nearly always in order
            k, one, other = j, u[j], w[j]
            while k > 0 and u[k - 1] > one:
                u[k], w[k] = u[k - 1], w[k - 1]
                k -= 1
            u[k], w[k] = one, other
        for j in range(1, count):
            step[j - 1], climb[j - 1] = u[j] - u[j - 1], abs(w[j] - w[j - 1])
        usual = median_of(step, count - 1)
        noise = NOISY_STEPS * median_of(climb, count - 1)  # columns may stand closer together than returns scatter
        right = 1
        for m in range(at.size):
            while right < count - 1 and u[right] < at[m]:
                right += 1
            wide, rise = u[right] - u[right - 1], w[right] - w[right - 1]
            one_surface = wide <= 4.0 * usual + 1e-9 and abs(rise) <= max(JUMP_STEPS * max(wide, usual), noise)
            out[i, m] = np.nan
            if one_surface and u[0] <= at[m] <= u[count - 1]:
                out[i, m] = w[right - 1] + (rise * (at[m] - u[right - 1]) / wide if wide > 0.0 else rise)


def _registered(surface: Float, at: Float, frames: Int) -> Chain | None:
    """Each row of `surface` (k, GRID) laid on the one before."""
    pitch = at[1] - at[0]
    if not np.isfinite(surface).any():
        return None
    centre = np.array([at[GRID // 2], np.nanmedian(surface)])
    before, after = surface[:-1], surface[1:]
    slope = _told_slopes(before, pitch)
    pairs = len(before)
    motion = np.zeros((pairs, 3))  # shift_x, shift_z, turn
    spread, normal, agreeing = np.full(pairs, np.inf), np.zeros((pairs, 3, 3)), np.zeros(pairs, np.int64)
    known = as_input(surface), as_input(slope), as_input(at), as_input(centre)
    _lay(*known, motion, spread, normal, agreeing)
    both = np.minimum(np.isfinite(before).sum(axis=1), np.isfinite(after).sum(axis=1))
    usual = max(float(np.median(spread)), LEAST_MISFIT_MM)
    moved = np.hypot(motion[:, 0], motion[:, 1])
    good = (agreeing >= np.maximum(SHARE * both, 8)) & (spread < MISFITS * usual)
    good &= moved < max(LEAST_STEP_MM, STEPS * float(np.median(moved)))
    rotation = np.abs(motion[:, 2])
    good &= rotation < max(LEAST_TURN, STEPS * float(np.median(rotation)))
    ridge = RIDGE * np.diag([1.0, 1.0, (at[-1] - at[0]) ** 2])
    variance = np.linalg.inv(normal + 1e-9 * ridge)[:, 2, 2]
    return Chain(frames, centre, motion[:, 0], motion[:, 1], motion[:, 2], good, spread * np.sqrt(variance))


def _told_slopes(surface: Float, pitch: float) -> Float:
    """dz/dx at the cells of profiles (k, m), over as few as tell a shape; the median of one that is a line.

    A line tells no shift along itself. Noise is in both profiles; taken for a shape, it would lay them on each other
    anywhere. Its slopes vary as much from one place to the next as over the whole profile; those of a bevel's profile
    vary 200 to 5,000 times as much.
    """
    few, many = SLOPE_REACHES
    slope, size = _slopes(surface, pitch, few)
    apart = 2 * few + 1  # cells between which slopes share no point
    near = (slope[:, apart:] - slope[:, :-apart]) ** 2 * size[:, apart:]
    noise = row_medians(near) / (2.0 * MEDIAN_OF_SQUARE)
    lines = np.flatnonzero(_varies(slope, size) < SHAPED * noise)
    slope[lines], size = _slopes(surface[lines], pitch, many)
    lines = lines[_varies(slope[lines], size) < SHAPED * noise[lines]]
    slope[lines] = np.where(np.isfinite(slope[lines]), row_medians(slope[lines])[:, None], np.nan)
    return slope


def _varies(slope: Float, size: Float) -> Float:
    """Mean square (k,) by which slopes (k, m) vary along their rows, as the variance of noise that varies them so."""
    square = (slope - row_medians(slope)[:, None]) ** 2 * size
    return np.asarray(np.nansum(square, axis=1) / np.maximum(np.isfinite(square).sum(axis=1), 1))


def _slopes(surface: Float, pitch: float, reach: int) -> tuple[Float, Float]:
    """Least-squares dz/dx over `reach` cells on each side of each cell (k, m), and by what noise's variance is divided.

    Over one surface: no gap lies between. NaN where it has fewer than three cells.
    """
    here, at = np.isfinite(surface), np.arange(surface.shape[1])
    ends = np.where(here, -1, at), np.where(here, at.size, at)
    begin = np.maximum(np.maximum.accumulate(ends[0], axis=1) + 1, at - reach)
    stop = np.minimum(np.minimum.accumulate(ends[1][:, ::-1], axis=1)[:, ::-1], at + reach + 1)
    stop = np.maximum(stop, begin)

    def over(values: AnyArray) -> Float:
        total = np.pad(np.cumsum(values, axis=1), ((0, 0), (1, 0)))
        return np.asarray(np.take_along_axis(total, stop, axis=1) - np.take_along_axis(total, begin, axis=1))

    x, z = pitch * at, np.where(here, surface - row_medians(surface)[:, None], 0.0)
    count = (stop - begin).astype(float)
    count[count < LEAST_CELLS] = np.nan
    middle = pitch * (begin + stop - 1) / 2.0
    size = pitch**2 * count * (count**2 - 1.0) / 12.0
    return (over(x * z) - middle * over(z)) / size, size


@kernel(error_model="numpy")
def _lay(
    surface: Float, slope: Float, at: Float, centre: Float, motion: Float, spread: Float, normal: Float, agreeing: Int
) -> None:
    """Lay each row of `surface` (k, m) on the one before, by Gauss and Newton with Huber's weights.

    Fills motion (k - 1, 3), spread (k - 1,): robust standard deviation of what is left, normal (k - 1, 3, 3): the
    normal equations, agreeing (k - 1,): places at which no more is left than noise. slope (k - 1, m): of the rows.
    """
    off, work, jacobian, rows = np.empty(at.size), np.empty(at.size), np.empty((at.size, 3)), np.empty((3, 4))
    ridge = RIDGE, RIDGE, RIDGE * (at[-1] - at[0]) ** 2
    for p in range(motion.shape[0]):
        for _ in range(ROUNDS):
            used = _offsets(surface[p], slope[p], surface[p + 1], at, centre, motion[p], off, jacobian)
            for j in range(used):
                work[j] = abs(off[j])
            spread[p] = select(work, used, (used - 1) // 2) * TO_SD if used else np.inf
            agreeing[p] = _equations(off[:used], jacobian, spread[p], rows)
            for a in range(3):
                for b in range(3):
                    normal[p, a, b] = rows[a, b]
                rows[a, a] += ridge[a]
            solve_three(rows)
            settled = True
            for a in range(3):
                settled &= abs(rows[a, 3]) < SETTLED[a]
                motion[p, a] += min(max(rows[a, 3], -MOST_STEP[a]), MOST_STEP[a])
            if settled:
                break


@kernel(error_model="numpy")
def _offsets(
    before: Float, slope: Float, after: Float, at: Float, centre: Float, motion: Float, off: Float, jacobian: Float
) -> int:
    """Fill off (m,), what a motion leaves between two profiles (m,) along their normals, and its derivatives (m, 3).

    Only places that both show are filled in, from the first on; returns how many.
    """
    m, pitch, used = at.size, at[1] - at[0], 0
    x0, z0 = centre
    for j in range(m):
        z = after[j]
        there = (at[j] + motion[0] + motion[2] * (z - z0) - at[0]) / pitch
        if not 0.0 <= there <= m - 1:
            continue
        cell = min(int(there), m - 2)
        share = there - cell
        g = slope[cell]
        left = (1.0 - share) * before[cell] + share * before[cell + 1]
        left -= z + motion[1] - motion[2] * (at[j] - x0)
        if not (np.isfinite(left) and np.isfinite(g)):
            continue
        flat = 1.0 / math.sqrt(1.0 + g * g)  # to normal distances
        off[used] = left * flat
        jacobian[used, 0], jacobian[used, 1] = g * flat, -flat
        jacobian[used, 2] = (g * (z - z0) + at[j] - x0) * flat
        used += 1
    return used


@kernel(error_model="numpy")
def _equations(off: Float, jacobian: Float, spread: float, rows: Float) -> int:
    """Fill rows (3, 4): the normal equations of what is left (n,). Returns at how many places that is noise alone."""
    cut, agreeing = HUBER_SIGMAS * max(spread, 1e-6), 0
    rows[:, :] = 0.0
    for j in range(off.size):
        weight = min(1.0, cut / max(abs(off[j]), 1e-12))
        agreeing += abs(off[j]) < 4.0 * max(spread, 0.01)
        for a in range(3):
            for b in range(3):
                rows[a, b] += weight * jacobian[j, a] * jacobian[j, b]
            rows[a, 3] -= weight * jacobian[j, a] * off[j]
    return agreeing


@kernel(error_model="numpy")
def solve_three(rows: Float) -> None:
    """Replace the last column of three equations (3, 4), whose matrix is positive definite, by their solution."""
    for a in range(3):
        for b in range(a + 1, 3):
            share = rows[b, a] / max(rows[a, a], 1e-12)
            for c in range(a, 4):
                rows[b, c] -= share * rows[a, c]
    for a in range(2, -1, -1):
        for b in range(a + 1, 3):
            rows[a, 3] -= rows[a, b] * rows[b, 3]
        rows[a, 3] /= max(rows[a, a], 1e-12)
