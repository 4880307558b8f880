"""How much a section wanders in the view by a rough face, which neither frames out of order nor poses make."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from workbench.checks.profiles import GRID, Chain, chains, on_grid, slopes
from workbench.units import AnyArray, Float, Int

RUNS, RUN_FRAMES = 8, 24  # of a pass, evenly: frames next to each other, which show a rough face at nearly one place
# Of how a place goes from profile to profile, that frames next to each other may differ by: on rough faces they do by
# 0.01 to 0.03 of it, out of order by as much as profiles.
SMOOTH = 0.05
WHOLE = 1.5  # times what a face waves within its height, it waves as a whole: 0.4 to 1.8 on ten rough ones
SURFACE_MM = 0.6  # farther lies another surface
LEAST_BENDS = 8  # third differences that tell
THIRD, RAYLEIGH = math.sqrt(20.0), 1.1774  # of 1, -3, 3, -1; the median length of two normal numbers


def rough_mm(x_mm: AnyArray, z_mm: AnyArray, pass_index: Int, found: Mapping[int, Chain]) -> float:
    """What rough faces make of the wiggle (`Consistency.wiggle_mm`), mm; the least of all passes.

    Of a section that wanders across its way two more things are looked at. Frames next to each other all but agree
    where the face waves along the edge, and differ as much as any where they are out of order. And what waves as a
    whole does so from place to place within its height too, while a part that moves keeps its shape.
    """
    shares = (_of_pass(x_mm, z_mm, np.flatnonzero(pass_index == number), found[number]) for number in found)
    return min(shares, default=0.0)


def _of_pass(x_mm: AnyArray, z_mm: AnyArray, frames: Int, chain: Chain) -> float:
    bends = _bends(chain)
    if len(bends) < LEAST_BENDS:
        return 0.0
    size = np.linalg.norm(bends, axis=1)
    usual = bends[size <= 5.0 * np.median(size)]
    across = np.linalg.eigh(usual.T @ usual)[1][:, -1]  # the way in which the place wanders
    waves = float(np.median(np.abs(bends @ across))) / 0.6745
    beside, within = [], []
    for x, z, one in _neighbours(x_mm, z_mm, frames):
        beside.append(np.abs(_bends(one) @ across))
        within.append(_left(x, z, one, across))
    jumps = np.concatenate(beside) if beside else np.zeros(0)
    if jumps.size < LEAST_BENDS or not np.percentile(jumps, 95.0) < 1.96 * SMOOTH * waves:
        return 0.0
    shape2 = _left(x_mm, z_mm, chain, across) ** 2 - float(np.median(within)) ** 2  # the sensor's noise taken off
    share = min(1.0, WHOLE**2 * max(shape2, 0.0) / waves**2)
    return math.sqrt(share) * float(np.median(size)) / RAYLEIGH


def _bends(chain: Chain) -> Float:
    """Third differences (b, 2) of the section's place, as large as the noise of single places, mm."""
    point, _, stretch = chain.track
    return np.asarray(np.diff(point, n=3, axis=0)[stretch[3:] == stretch[:-3]] / THIRD)


def _neighbours(x_mm: AnyArray, z_mm: AnyArray, frames: Int) -> Iterator[tuple[AnyArray, AnyArray, Chain]]:
    """Chains of frames next to each other, with their profiles."""
    for start in np.unique(np.linspace(0, max(len(frames) - RUN_FRAMES, 0), RUNS).astype(np.int64)):
        run = frames[start : start + RUN_FRAMES]
        for one in chains(x_mm[run], z_mm[run], np.zeros(run.size, np.int64)).values():
            yield x_mm[run], z_mm[run], one


def _left(x_mm: AnyArray, z_mm: AnyArray, chain: Chain, across: Float) -> float:
    """What profiles laid on each other leave, mm: rms (the median) of surfaces that tell their place `across` (2,)."""
    surface, at = on_grid(*(of[chain.frames].astype(np.float64) for of in (x_mm, z_mm)))
    before, after = surface[:-1], surface[1:]
    pitch = at[1] - at[0]
    x0, z0 = chain.centre
    there = (at + chain.shift_x[:, None] + chain.turn[:, None] * (after - z0) - at[0]) / pitch
    cell = np.clip(np.nan_to_num(there), 0.0, GRID - 2.0).astype(np.int64)
    row = np.arange(len(before))[:, None]
    slope = slopes(before, pitch)[row, cell]
    left = before[row, cell] + (there - cell) * (before[row, cell + 1] - before[row, cell])
    left -= after + chain.shift_z[:, None] - chain.turn[:, None] * (at - x0)
    flat = 1.0 / np.sqrt(1.0 + slope**2)
    left = left * flat
    told = chain.good[:, None] & (there >= 0.0) & (there <= GRID - 1.0) & (np.abs(left) < SURFACE_MM)
    weight = np.where(told, ((across[0] * slope - across[1]) * flat) ** 2, 0.0)
    square = (weight * np.where(told, left, 0.0) ** 2).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-12)
    return float(np.sqrt(np.median(square[chain.good]))) if chain.good.any() else 0.0
