"""Some profiles of each pass on one lateral grid, and how each lies on the next: motion that needs no poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.units import AnyArray, Bool, Float, Int

FRAMES = (24, 400)  # least and most profiles of a pass that are looked at
EVERY = 12  # frames between two of them, unless that gives too few or too many
GRID = 256  # places across the view
JUMP_STEPS = 8.0  # slope beyond which two neighbouring returns are not one surface
ROUNDS = 8  # of Gauss and Newton, at most
SETTLED = (1e-4, 1e-4, 1e-6)  # mm, mm, rad: motions are then known better than noise lets them
SHARE = 0.5  # of the places that must agree
HUBER_SIGMAS = 2.5
MISFITS, LEAST_MISFIT_MM = 3.0, 0.01  # of the usual misfit: more is another shape, such as a clamp
STEPS, LEAST_STEP_MM = 8.0, 2.0  # of the usual motion from profile to profile: more is none
LEAST_TURN = 0.03  # rad; likewise of the usual turn


@dataclass(frozen=True, eq=False)
class Chain:
    """k profiles of one pass, and the k - 1 motions in the laser plane that lay each on the one before.

    A point (x, z) of profile i + 1 lies in profile i at (x + shift_x + turn (z - z0), z + shift_z - turn (x - x0)).
    What a profile does not show, such as a shift along its only line, is taken as 0.
    """

    frames: Int  # (k,) indices into the recording
    centre: Float  # (2,) x0, z0, mm
    shift_x: Float  # (k - 1,) mm
    shift_z: Float  # (k - 1,)
    turn: Float  # (k - 1,) rad
    good: Bool  # (k - 1,) the two profiles agree on at least half of what both show
    misfit_mm: Float  # (k - 1,) robust standard deviation of what is left, normal to the profile
    turn_u: Float  # (k - 1,) standard uncertainty of the turn by the noise of the profiles, rad; large on round shapes

    def few(self) -> Few:
        """Up to five of the profiles, evenly along the pass."""
        at = np.unique(np.linspace(0, len(self.frames) - 1, 5).astype(int))
        point, turn, stretch = self.track
        return Few(self.frames[at], (point[at], turn[at], stretch[at]))

    @cached_property
    def track(self) -> tuple[Float, Float, Int]:
        """A point that goes with the section (k, 2), its turn (k,) rad, and the stretch (k,) that it is in.

        Stretches are parted where profiles do not agree, such as at a clamp.
        """
        count = len(self.frames)
        point, angle = np.empty((count, 2)), np.zeros(count)
        point[0] = self.centre
        x0, z0 = self.centre
        for i in range(count - 1):  # the inverse of the motion, to first order in the small turn
            x, z = point[i] - (self.shift_x[i], self.shift_z[i])
            f = self.turn[i]
            point[i + 1] = x - f * (z - z0), z + f * (x - x0)
            angle[i + 1] = angle[i] + f
        return point, angle, np.concatenate([[0], np.cumsum(~self.good)])


@dataclass(frozen=True, slots=True, eq=False)
class Few:
    """Some of a chain's profiles."""

    frames: Int  # (k,)
    track: tuple[Float, Float, Int]  # as of Chain


def chains(x_mm: AnyArray, z_mm: AnyArray, pass_index: Int) -> dict[int, Chain]:
    """A chain for each pass (N,) of a grid (N, M) that has three profiles or more with returns."""
    found = {}
    for number in np.unique(pass_index):
        frames = sampled(np.flatnonzero(pass_index == number))
        made = _chain(x_mm, z_mm, frames)
        if made is not None:
            found[int(number)] = made
    return found


def sampled(frames: Int) -> Int:
    """Every twelfth of `frames`, but some at least and not too many."""
    count = int(np.clip(len(frames) // EVERY, *FRAMES))
    return np.asarray(frames[np.unique(np.linspace(0, len(frames) - 1, count).astype(int))])


def _chain(x_mm: AnyArray, z_mm: AnyArray, frames: Int) -> Chain | None:
    x, z = x_mm[frames].astype(np.float64), z_mm[frames].astype(np.float64)
    valid = np.isfinite(x) & np.isfinite(z)
    used = valid.sum(axis=1) >= 16
    if used.sum() < 3:
        return None
    x, z, valid, frames = x[used], z[used], valid[used], frames[used]
    low, high = float(x[valid].min()), float(x[valid].max())
    if not high > low:
        return None
    at = np.linspace(low, high, GRID)
    surface = np.stack([_on_grid(x[i][valid[i]], z[i][valid[i]], at) for i in range(len(x))])
    return _registered(surface, at, frames)


def _on_grid(x: Float, z: Float, at: Float) -> Float:
    """z at places `at`; NaN across gaps and jumps, where neighbouring returns are no one surface."""
    if x[0] > x[-1]:
        x, z = x[::-1], z[::-1]
    if (np.diff(x) < 0).any():
        order = np.argsort(x, kind="stable")
        x, z = x[order], z[order]
    right = np.clip(np.searchsorted(x, at), 1, len(x) - 1)
    step, rise = x[right] - x[right - 1], np.abs(z[right] - z[right - 1])
    usual = float(np.median(np.diff(x)))
    made = np.interp(at, x, z, left=np.nan, right=np.nan)
    made[(step > 4.0 * usual + 1e-9) | (rise > JUMP_STEPS * np.maximum(step, usual))] = np.nan
    return np.asarray(made)


def _registered(surface: Float, at: Float, frames: Int) -> Chain | None:
    """Each row of `surface` (k, GRID) laid on the one before, all pairs at once."""
    pitch = at[1] - at[0]
    if not np.isfinite(surface).any():
        return None
    z0 = float(np.nanmedian(surface))
    x0 = float(at[GRID // 2])
    before, after = surface[:-1], surface[1:]
    slope = _slopes(before, pitch)
    pairs = len(before)
    motion = np.zeros((pairs, 3))  # shift_x, shift_z, turn
    x, z = np.broadcast_to(at, after.shape), after
    rows = np.arange(pairs)[:, None]
    reach = at[-1] - at[0]
    ridge = np.diag([1.0, 1.0, reach**2]) * 1e-3
    spread = np.full(pairs, np.inf)
    for _ in range(ROUNDS):
        dx, dz, turn = (motion[:, [k]] for k in range(3))
        there = (x + dx + turn * (z - z0) - at[0]) / pitch
        cell = np.clip(np.nan_to_num(there).astype(np.int64), 0, GRID - 2)
        share = there - cell
        z_there = (1.0 - share) * before[rows, cell] + share * before[rows, cell + 1]
        g = slope[rows, cell]
        residual = z_there - (z + dz - turn * (x - x0))
        usable = np.isfinite(residual) & np.isfinite(g) & (there >= 0) & (there <= GRID - 1)
        flat = np.where(usable, 1.0 / np.sqrt(1.0 + np.where(usable, g, 0.0) ** 2), 0.0)  # to normal distances
        off = np.where(usable, residual, 0.0) * flat
        spread = _spread(off, usable)
        cut = HUBER_SIGMAS * np.maximum(spread, 1e-6)[:, None]
        weight = np.where(usable, np.minimum(1.0, cut / np.maximum(np.abs(off), 1e-12)), 0.0)
        g = np.where(usable, g, 0.0)
        jacobian = np.stack([g, -np.ones_like(g), g * np.where(usable, z - z0, 0.0) + (x - x0)], axis=-1)
        jacobian *= flat[..., None]
        weighted = jacobian * weight[..., None]
        normal = np.einsum("pij,pik->pjk", weighted, jacobian)
        step = np.linalg.solve(normal + ridge, -np.einsum("pij,pi->pj", weighted, off)[..., None])[..., 0]
        motion += np.clip(step, [-2.0, -2.0, -0.05], [2.0, 2.0, 0.05])
        if (np.abs(step) < SETTLED).all():
            break
    agreeing = (usable & (np.abs(off) < 4.0 * np.maximum(spread, 0.01)[:, None])).sum(axis=1)
    both = np.minimum(np.isfinite(before).sum(axis=1), np.isfinite(after).sum(axis=1))
    usual = max(float(np.median(spread)), LEAST_MISFIT_MM)
    moved = np.hypot(motion[:, 0], motion[:, 1])
    good = (agreeing >= np.maximum(SHARE * both, 8)) & (spread < MISFITS * usual)
    good &= moved < max(LEAST_STEP_MM, STEPS * float(np.median(moved)))
    turned = np.abs(motion[:, 2])
    good &= turned < max(LEAST_TURN, STEPS * float(np.median(turned)))
    variance = np.linalg.inv(normal + 1e-9 * ridge)[:, 2, 2]
    return Chain(
        frames, np.array([x0, z0]), motion[:, 0], motion[:, 1], motion[:, 2], good, spread, spread * np.sqrt(variance)
    )


def _slopes(surface: Float, pitch: float) -> Float:
    """dz/dx at the cells of the grid, over three of them on each side where they are there."""
    slope = np.full(surface.shape, np.nan)
    for reach in (1, 2, 3):
        rise = (surface[:, 2 * reach :] - surface[:, : -2 * reach]) / (2 * reach * pitch)
        inner = slope[:, reach:-reach]
        np.copyto(inner, rise, where=np.isfinite(rise))
    return slope


def _spread(off: Float, usable: Bool) -> Float:
    """Robust standard deviation a row, from the median of what is usable."""
    size = np.sort(np.where(usable, np.abs(off), np.inf), axis=1)
    middle = np.maximum(usable.sum(axis=1) - 1, 0) // 2
    return np.asarray(size[np.arange(len(size)), middle] / 0.6745)
