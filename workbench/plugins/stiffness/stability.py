"""When milling chatters: mode coupling and regeneration in one periodic delay equation, judged and screened.

In the frame of a path point (x into the material, y along the feed, z to the tip), u the tool's displacement and tau
the time from tooth to tooth:

    q'' + C q' + W q = U^T b A(t) (u(t) - u(t - tau)),    u = U q,

with unit modal masses and A what a chip of 1 mm along a depth b of 1 mm pushes by. The term in u(t) alone is mode
coupling (Pan et al. 2006), that in u(t - tau) the wave that the tooth before left (regeneration).

`limits` is the judge: the modes are integrated exactly over steps of the tooth's period under a force that is linear in
time, what makes A periodic is averaged over each step exactly, and the spectral radius of the map over one period tells
(full-discretisation: Ding et al., Int. J. Mach. Tools Manuf. 50 (2010) 502; Floquet). `screened` is for maps: where
teeth come much faster than the modes swing, the delay is a velocity, and one constant matrix tells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from workbench.api import Float, Shaped
from workbench.plugins.stiffness.elastic import MM

STEPS = 40  # of a tooth's period, at least
PER_SWING = 24  # steps of the fastest mode's period, at least
SLICES = 16  # of the depth along the helix
EXACT = 1e-9  # of a spectral radius
RATIO = 1.2  # between neighbouring depths of the search
FINER = 7  # depths between two neighbours, in each round of the search
ROUNDS = 2
ON_AXIS = 1e-6  # of a mode's frequency: growth that counts for none where nothing damps
CROSSES = 1e-4  # of a depth, its imaginary part, that is rounding or as good as a crossing


class Dynamics(NamedTuple):
    """A structure at the tool, by mass-normalised coordinates; n of them at each of k places."""

    stiffness: Shaped[Float, "k n n"]  # 1/s^2
    damping: Shaped[Float, "k n n"]  # 1/s
    shape: Shaped[Float, "k 3 n"]  # displacement of the tool, 1/sqrt(kg), in the place's frame

    def at(self, index: int) -> Dynamics:
        """One place."""
        return Dynamics(*(part[index : index + 1] for part in self))

    @property
    def fastest_hz(self) -> float:
        """The highest frequency of any place."""
        return float(np.sqrt(np.abs(np.linalg.eigvals(self.stiffness)).max()) / (2 * np.pi))


class Milling(NamedTuple):
    """How a tooth meets the material."""

    chip: tuple[float, float, float]  # K_tc, K_rc, K_ac, N/mm^2
    flutes: int
    entry: float  # angles from x towards y, rad
    exit: float
    lag: float  # of the helix, rad a mm of depth
    rpm: float

    @property
    def period_s(self) -> float:
        """From tooth to tooth."""
        return 60.0 / (self.rpm * self.flutes)


def milling(
    chip: tuple[float, float, float], flutes: int, diameter_mm: float, radial_mm: float, helix: float, rpm: float
) -> tuple[Milling, Milling]:
    """The cut as the path runs, which is up-milling, and with the feed the other way: down-milling."""
    last = float(np.arccos(max(1.0 - 2.0 * radial_mm / diameter_mm, -1.0)))
    lag = float(np.tan(helix)) / (diameter_mm / 2)
    return Milling(chip, flutes, 0.0, last, lag, rpm), Milling(chip, flutes, -last, 0.0, lag, rpm)


def mean_direction(cut: Milling) -> Float:
    """A (3, 2) averaged over a turn, N/mm^2: the helix changes nothing in it."""
    return np.asarray(_integrals(cut, np.array([cut.entry, cut.exit]))[1] * cut.flutes / (2 * np.pi))


def _integrals(cut: Milling, angle: Float) -> Float:
    """Integral of A of one tooth from the entry to angles (n,), which may turn often: (n, 3, 2)."""
    kt, kr, ka = cut.chip
    turns, within = np.divmod(angle - cut.entry, 2 * np.pi)

    def upto(end: Float) -> Float:
        p, q = cut.entry, end
        both = (np.sin(q) ** 2 - np.sin(p) ** 2) / 2
        half, wave = (q - p) / 2, (np.sin(2 * q) - np.sin(2 * p)) / 4
        sine, cosine = half - wave, half + wave  # of the squares
        rows = [
            [kt * both - kr * cosine, kt * sine - kr * both],
            [-kt * cosine - kr * both, -kt * both - kr * sine],
            [ka * (np.sin(q) - np.sin(p)), ka * (np.cos(p) - np.cos(q))],
        ]
        return np.moveaxis(np.array(rows), -1, 0)

    whole = upto(np.array([cut.exit]))
    return turns[:, None, None] * whole + upto(np.minimum(cut.entry + within, cut.exit))


def directions(cut: Milling, depth_mm: Float, steps: int) -> Float:
    """A averaged over each step of a tooth's period (d, steps, 3, 2), N/mm^2, at depths (d,)."""
    pitch = 2 * np.pi / cut.flutes
    edges = np.arange(steps + 1) * pitch / steps
    lag = cut.lag * np.asarray(depth_mm, float)
    slices = (np.arange(SLICES) + 0.5) / SLICES
    back = lag[:, None] * slices + pitch * np.arange(cut.flutes)[:, None, None]  # (flutes, d, slices)
    upto = _integrals(cut, (edges - back[..., None]).ravel()).reshape(*back.shape, steps + 1, 3, 2)
    return np.asarray(np.diff(upto, axis=3).sum(axis=0).mean(axis=1) * steps / pitch)


def limits(dynamics: Dynamics, cut: Milling, largest_mm: float, start_mm: Float | None = None) -> Float:
    """Least depth (k,) at which the cut is unstable, mm, to 0.3 %; infinite where none is up to `largest_mm`.

    Args:
        dynamics: of k places.
        cut: the same at all.
        largest_mm: that is looked at.
        start_mm: (k,) from which the search begins; None: a hundredth of the largest. Stable depths below it are told.
    """
    first = np.full(len(dynamics.shape), largest_mm / 100) if start_mm is None else np.maximum(start_mm, 1e-6)
    found = np.full(len(dynamics.shape), np.inf)
    for k, low in enumerate(first):
        one = Judge(dynamics.at(k), cut)
        count = max(int(np.ceil(np.log(largest_mm / low) / np.log(RATIO))), 1)
        depth = np.geomspace(low, largest_mm, count + 1) if low < largest_mm else np.array([largest_mm])
        found[k] = _least(one, depth)
    return found


def _least(judge: Judge, depth: Float) -> float:
    """The first of rising depths that is unstable, refined towards the one before it."""
    unstable = judge.radius(depth) > 1.0
    if not unstable.any():
        return float(np.inf)
    at = int(unstable.argmax())
    low, high = (depth[at - 1] if at else 0.0), float(depth[at])
    if at == 0:  # from below: nothing is known of smaller ones
        low = high / RATIO
        while judge.radius(np.array([low]))[0] > 1.0 and low > high * 1e-3:
            low, high = low / RATIO, low
    for _ in range(ROUNDS):
        between = np.linspace(low, high, FINER + 2)
        unstable = np.append(judge.radius(between[1:-1]) > 1.0, True)
        first = int(unstable.argmax())
        low, high = float(between[first]), float(between[first + 1])
    return (low + high) / 2


class Judge:
    """Spectral radius of the map over one tooth's period, for one place."""

    def __init__(self, dynamics: Dynamics, cut: Milling) -> None:
        self.cut, self.steps = cut, max(STEPS, int(np.ceil(PER_SWING * dynamics.fastest_hz * cut.period_s)))
        n, step = dynamics.shape.shape[2], cut.period_s / self.steps
        whole = np.zeros((2 * n + 6, 2 * n + 6))  # q, q' in periods, force, slope of the force
        whole[:n, n : 2 * n] = np.eye(n) / cut.period_s
        whole[n : 2 * n, :n] = -dynamics.stiffness[0] * cut.period_s
        whole[n : 2 * n, n : 2 * n] = -dynamics.damping[0]
        whole[n : 2 * n, 2 * n : 2 * n + 3] = dynamics.shape[0].T * cut.period_s
        whole[2 * n : 2 * n + 3, 2 * n + 3 :] = np.eye(3) / step
        through = scipy.linalg.expm(whole * step)[: 2 * n]
        self.free = through[:, : 2 * n]
        self.last = through[:, 2 * n + 3 :]  # by the force at the step's end
        self.first = through[:, 2 * n : 2 * n + 3] - self.last
        self.seen = np.hstack([dynamics.shape[0, :2], np.zeros((2, n))])

    def radius(self, depth_mm: Float) -> Float:
        """At depths (d,): above 1, the cut is unstable."""
        depth = np.asarray(depth_mm, float)
        push = directions(self.cut, depth, self.steps) * depth[:, None, None, None] * MM  # (d, steps, 3, 2), N/m
        at_end = self.last @ push  # the force at a step's end hangs on where the tool is by then
        back = np.linalg.inv(np.eye(2) - self.seen @ at_end)
        whole = np.eye(len(self.free)) + at_end @ back @ self.seen
        at_start = self.first @ push
        own, late = whole @ (self.free + at_start @ self.seen), np.concatenate([at_start, at_end], axis=3)
        steps = np.concatenate([own, -whole @ late], axis=3)
        maps = _period(steps, self.seen)
        return np.array([spectral_radius(one) for one in maps])


def spectral_radius(square: Float) -> float:
    """The spectral radius; of all eigenvalues where ARPACK does not settle on one."""
    begin = np.cos(np.arange(len(square)) ** 2)  # else random, and no run would give the last one's bytes
    try:
        roots = scipy.sparse.linalg.eigs(square, 1, v0=begin, tol=EXACT, return_eigenvectors=False)
    except scipy.sparse.linalg.ArpackNoConvergence:
        roots = np.linalg.eigvals(square)
    return float(np.abs(roots).max())


def _period(steps: Float, seen: Float) -> Float:
    """The map over one period (d, w, w): of the state, then of where the tool was at the starts of its steps, two each.

    `steps` (d, k, n, n + 4): the state after each by that before it and where the tool was a period ago at both ends.
    """
    d, count, n, _ = steps.shape
    state = np.broadcast_to(np.eye(n, n + 2 * count), (d, n, n + 2 * count))
    then = np.eye(2 * count, n + 2 * count, n).reshape(count, 2, -1)
    then = np.concatenate([then, [seen @ state[0]]])  # the period before ended where this one begins
    was = np.empty((d, count, 2, n + 2 * count))
    for k in range(count):
        was[:, k] = seen @ state
        state = steps[:, k, :, :n] @ state + steps[:, k, :, n:] @ then[k : k + 2].reshape(4, -1)
    return np.concatenate([state, was.reshape(d, 2 * count, -1)], axis=1)


def screened(dynamics: Dynamics, cut: Milling, largest_mm: float, *, regeneration: bool = True) -> Float:
    """Least depth (k,) at which the averaged cut is unstable, mm, infinite where none is up to `largest_mm`.

    No window is stepped over: where stability ends, two eigenvalues of F + b B T sum to 0, so a symmetric X has
    (F + b B T) X + X (F + b B T)' = 0. In Z = T X (2, 2n) that is an eigenvalue problem for 1/b.

    Args:
        dynamics: of k places.
        cut: the same at all.
        largest_mm: that is looked at.
        regeneration: the delay as a velocity; else mode coupling alone, each tooth on an even surface.
    """
    free, by, to = averaged(dynamics, cut, regeneration=regeneration)
    k, m = free.shape[:2]
    roots, ways = np.linalg.eig(free)
    slowest = roots.real.max(axis=1)
    roots = roots - np.maximum(slowest + ON_AXIS, 0.0)[:, None]  # without damping all sums would be 0
    enters, seen = np.linalg.solve(ways, by.astype(complex)), to @ ways
    sums = 1.0 / (roots[:, :, None] + roots[:, None, :])
    whole = -np.einsum("kcm,kja,kmj->kcjam", seen, enters, sums)
    each = np.arange(m)
    whole[:, :, each, :, each] -= np.einsum("kci,kia,kij->jkca", seen, enters, sums)
    inverse = np.linalg.eigvals(whole.reshape(k, 2 * m, 2 * m))
    crosses = (np.abs(inverse.imag) < CROSSES * np.abs(inverse)) & (inverse.real * largest_mm >= 1.0)
    found = np.min(np.where(crosses, 1.0 / np.where(crosses, inverse.real, 1.0), np.inf), axis=1)
    return np.where(slowest > ON_AXIS, 0.0, found)


def averaged(dynamics: Dynamics, cut: Milling, *, regeneration: bool = True) -> tuple[Float, Float, Float]:
    """The averaged cut's motion (k, 2n, 2n), of q and q', without a cut, and what 1 mm of depth adds.

    That is (k, 2n, 2) by (k, 2, 2n): forces of where the tool is or, with regeneration, how fast it moves.
    Time in units of the modes' own.
    """
    k, n = dynamics.shape.shape[0], dynamics.shape.shape[2]
    scale = np.sqrt(np.abs(np.trace(dynamics.stiffness, axis1=1, axis2=2) / n))[:, None, None]
    pushed = dynamics.shape.mT @ mean_direction(cut) * MM
    free, by, to = np.zeros((k, 2 * n, 2 * n)), np.zeros((k, 2 * n, 2)), np.zeros((k, 2, 2 * n))
    free[:, :n, n:] = np.eye(n)
    free[:, n:, :n], free[:, n:, n:] = -dynamics.stiffness / scale**2, -dynamics.damping / scale
    by[:, n:] = pushed * cut.period_s / scale if regeneration else pushed / scale**2
    to[:, :, n:] = dynamics.shape[:, :2] if regeneration else 0.0
    to[:, :, :n] = 0.0 if regeneration else dynamics.shape[:, :2]
    return free, by, to
