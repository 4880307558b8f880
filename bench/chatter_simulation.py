"""Milling in the time domain, to judge what `stiffness.chatter` says.

Every tooth, in slices along its helix, cuts what stands between it and the surface that was left there: chips end where
a tooth leaves the material, run-out makes them uneven. Two runs that differ by a millionth of the feed show whether
a difference grows. Nothing is linearised and nothing periodic is assumed; by itself, of the package's model it takes
the modes and the cutting coefficients only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.api import AnyArray, Float, kernel
from workbench.plugins.stiffness.stability import Dynamics, Milling, limits, screened

STEPS, SLICES = 96, 8  # of a tooth's pitch; of the depth
SMALL = 1e-6  # of the feed per tooth
CALM_S = 1.5  # in which added damping fades, so that the cut begins without a blow
DECADES = 1.0  # by which the difference must have changed
SWINGS = 0.1  # of the motion, between neighbouring turns, beyond which it chatters already
PERIODS = 40_000  # at most


class Run(NamedTuple):
    """A cut as it is simulated; SI units."""

    stiffness: Float  # (n,) 1/s^2
    damping: Float  # (n,) 1/s
    shape: Float  # (3, n)
    chip: Float  # (3,) N/m^2: tangential, radial, axial
    angles: Float  # (2,) entry and exit
    offset: Float  # (flutes,) of each tooth's radius, m
    depth: float
    lag: float  # of the whole depth, rad
    feed: float  # a tooth, m
    period: float


def verdict(dynamics: Dynamics, cut: Milling, depth_mm: float, feed_mm: float = 0.05, runout_mm: float = 0.0) -> bool:
    """Whether a small difference dies out, of one place with modes that are damped apart from each other."""
    turn = 2 * np.pi * np.arange(cut.flutes) / cut.flutes
    sense = 1.0 if cut.entry >= 0 else -1.0
    run = Run(
        np.diagonal(dynamics.stiffness[0]).copy(),
        np.diagonal(dynamics.damping[0]).copy(),
        np.ascontiguousarray(dynamics.shape[0]),
        np.array(cut.chip) * 1e6,
        np.array([cut.entry, cut.exit]),
        runout_mm / 1e3 * np.cos(turn - 0.3),
        depth_mm / 1e3,
        cut.lag * depth_mm,
        sense * feed_mm / 1e3,
        cut.period_s,
    )
    return bool(_difference(run, PERIODS, SMALL * abs(run.feed), DECADES) < 0.0)


@kernel
def _difference(run: Run, periods: int, small: float, decades: float) -> float:
    """Change of the difference of two runs, in powers of ten, when it has changed by `decades` or time is over."""
    n, flutes = len(run.stiffness), len(run.offset)
    surface = np.zeros((2, SLICES, flutes * STEPS))
    q, v, before = np.zeros((2, n)), np.zeros((2, n)), np.zeros((2, n))
    begun, peak, last = 0.0, 0.0, 0.0
    # periods after which it repeats: even teeth that flip every other one chatter, and a turn would not show it
    again = 1 if run.offset.max() == run.offset.min() else flutes
    calm = int(CALM_S / run.period)
    block = max(int(0.2 / run.period), 2 * flutes)  # periods over which the largest difference counts
    for p in range(periods):
        if p == calm:
            for i in range(n):
                v[1, i] += small * np.sqrt(run.stiffness[i]) * (1.0 if i % 2 == 0 else -1.0)
        _tooth(run, surface, q, v, p, max(1.0 - p / calm, 0.0) ** 2)
        if p % again == 0:  # then it was where it is, unless it chatters already
            if p > calm and _energy(run, q[0], before[0], v[0], before[1]) > SWINGS**2 * _energy(
                run, q[0], 0.0 * q[0], v[0], 0.0 * v[0]
            ):
                return decades
            before[0], before[1] = q[0], v[0]
        peak = max(peak, _energy(run, q[1], q[0], v[1], v[0]))
        if p % block == block - 1:
            last = 0.5 * np.log10(peak + 1e-300) - begun
            peak = 0.0
            if p < calm + 3 * block:
                begun += last
            elif abs(last) > decades:
                return last
    return last


@kernel
def _energy(run: Run, q: AnyArray, other: AnyArray, v: AnyArray, otherwise: AnyArray) -> float:
    size = 0.0
    for i in range(len(q)):
        size += run.stiffness[i] * (q[i] - other[i]) ** 2 + (v[i] - otherwise[i]) ** 2
    return size


@kernel
def _tooth(run: Run, surface: AnyArray, q: AnyArray, v: AnyArray, period: int, fade: float) -> None:
    """One tooth's period of both runs; `fade` of the added damping is left."""
    force = np.zeros(3)
    for k in range(STEPS):
        for one in range(2):
            _push(run, surface[one], q[one], period * STEPS + k, surface.shape[2], force)
            for i in range(len(run.stiffness)):
                push = run.shape[0, i] * force[0] + run.shape[1, i] * force[1] + run.shape[2, i] * force[2]
                damping = run.damping[i] + fade * np.sqrt(run.stiffness[i])
                v[one, i] += run.period / STEPS * (push - run.stiffness[i] * q[one, i] - damping * v[one, i])
                q[one, i] += run.period / STEPS * v[one, i]


@kernel
def _push(run: Run, surface: AnyArray, q: AnyArray, step: int, turn: int, force: AnyArray) -> None:
    """Force of all teeth on the cutter, and the surface that they leave."""
    x, y = 0.0, step * run.feed / STEPS
    for i in range(len(q)):
        x += run.shape[0, i] * q[i]
        y += run.shape[1, i] * q[i]
    force[0], force[1], force[2] = 0.0, 0.0, 0.0
    for j in range(len(run.offset)):
        place = (step - j * STEPS) % turn
        for s in range(SLICES):
            angle = 2 * np.pi * (place + 0.5) / turn - run.lag * (s + 0.5) / SLICES
            angle = (angle - run.angles[0]) % (2 * np.pi) + run.angles[0]
            if angle > run.angles[1]:
                continue
            sine, cosine = np.sin(angle), np.cos(angle)
            out = x * cosine + y * sine + run.offset[j]
            chip = out - surface[s, place]
            if chip <= 0.0:
                continue
            surface[s, place] = out
            width = run.depth / SLICES
            tangential, radial = run.chip[0] * chip * width, run.chip[1] * chip * width
            force[0] += tangential * sine - radial * cosine
            force[1] -= tangential * cosine + radial * sine
            force[2] += run.chip[2] * chip * width


def case(rng: np.random.Generator) -> tuple[Dynamics, Milling]:
    """Six modes of a robot and a cut, at random."""
    hz = np.sort(np.exp(rng.uniform(np.log(5), np.log(120), 6)))
    w, zeta = 2 * np.pi * hz, rng.uniform(0.01, 0.06, 6)
    shape = rng.normal(size=(3, 6)) / np.sqrt(np.exp(rng.uniform(np.log(30), np.log(600), 6)))
    last = float(np.arccos(1 - 2 * rng.uniform(0.05, 1.0)))
    up = bool(rng.integers(2))
    kt = rng.uniform(400, 2500)
    cut = Milling(
        (kt, kt * rng.uniform(0.1, 0.5), kt * rng.uniform(0.0, 0.3)),
        int(rng.integers(2, 5)),
        0.0 if up else -last,
        last if up else 0.0,
        float(rng.uniform(0, 0.1)),
        float(rng.uniform(3000, 9000)),
    )
    return Dynamics(np.diag(w**2)[None], np.diag(2 * zeta * w)[None], shape[None]), cut


def agreement(cases: int, seed: int, runout_mm: float = 0.0) -> tuple[int, int]:
    """Verdicts at 0.9 and 1.1 of the limit that agree, of how many."""
    rng, right, asked = np.random.default_rng(seed), 0, 0
    for _ in range(cases):
        dynamics, cut = case(rng)
        limit = float(limits(dynamics, cut, 50.0, np.minimum(screened(dynamics, cut, 50.0) / 4, 1.0))[0])
        if np.isfinite(limit):
            asked += 2
            stable = [verdict(dynamics, cut, share * limit, runout_mm=runout_mm) for share in (0.9, 1.1)]
            right += stable[0] + (not stable[1])
    return right, asked
