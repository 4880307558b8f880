"""The estimator under every instrument: least squares with noise, priors and blunders, and what remains open.

An instrument (`Instrument`) says what its observations leave of a prediction (`Rows`) and how an estimate moves. Here,
once for all of them:

- Gauss-Newton on the weighted residuals, steps that make it worse, or that cannot be solved, shortened (J. Nocedal,
  S. Wright, Numerical Optimization, 2nd ed. 2006, section 10.3). Weights follow the estimate. Priors are observations:
  what comes out is the maximum a posteriori, and with flat priors generalised least squares.
- Noise is each observation's own, or that of poses which several share (`Shared`): a recorded pose errs once for all
  that is seen from it, an observation between two takes a share of both (Woodbury's identity on a block-tridiagonal
  matrix: the cost grows with the observations, not with their cube).
- Blunders are left out by the studentised residual, the distance from the fit of all others (W. Baarda, A
  testing procedure for use in geodetic networks, 1968; R. Cook, S. Weisberg, Residuals and Influence in Regression,
  1982).
- The covariance is the inverse information, larger by chi-square over its degrees of freedom where that exceeds 1
  (R. Birge, Phys. Rev. 40, 1932), and as good as infinite along what nothing determines.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np
import scipy

from workbench.errors import InputError
from workbench.units import Bool, Float, Int, Shaped

S = TypeVar("S")  # an instrument's estimate of its unknowns

STEPS, CONVERGED = 40, 1e-10  # of a step's length in standard deviations, squared
GO_ON = 8  # of many starts
WANDERS = 5  # steps in a row that lower chi-square no more: rounding (a clock from 1970), or nothing determines it
WORSE = (1.5, 1.0)  # chi-square may grow so much by a step (factor, and more): weights move with the estimate
OPEN = 1e-14  # eigenvalue of the scaled information below which nothing determines a direction
ALONE = 1e-6  # share of its noise that the residual keeps, along what an observation determines alone
GROSS = 5.0  # studentised residual of a blunder, as the length of three standard normal numbers
THREE_QUARTERS = 2.03  # quantile of the length of three standard normal numbers
MOST_GROSS = 0.25  # share of the observations; with more, nobody knows which are right
TURNS = 12  # of fitting and choosing
DOUBTFUL = 2.0  # times the noise, from which three quarters may not be the right ones
LEAST_FREEDOM = 4  # to tell a blunder from noise


@dataclass(frozen=True, slots=True, eq=False)
class Shared:
    """m observations that share errors of poses, each error in standard deviations of it.

    Poses lie in a row; an observation takes the share `fraction` of the next pose's error and the rest of its own
    pose's. Errors of `whole` are common to all m.
    """

    rows: Shaped[Int, " m"]  # of the observations
    alone: Shaped[Float, "m d d"]  # covariance of what is theirs alone
    own: Shaped[Float, "m d e"]  # change with a pose's e errors
    pose: Shaped[Int, " m"]
    fraction: Shaped[Float, " m"]
    poses: int
    whole: Shaped[Float, "m d v"]

    def only(self, keep: Bool) -> Shared:
        """Of the observations marked in `keep` (n,), renumbered."""
        kept, number = keep[self.rows], np.cumsum(keep) - 1
        parts = {name: getattr(self, name)[kept] for name in ("alone", "own", "pose", "fraction", "whole")}
        return replace(self, rows=number[self.rows[kept]], **parts)

    def product(self, columns: Float) -> tuple[Float, float]:
        """C^T S^-1 C (c, c) of columns C (m, d, c) and the covariance S of the m observations together; log det S."""
        joined, log_size = _within_poses(np.concatenate([columns, self.whole], axis=2), self)
        kept = columns.shape[2]
        common = np.eye(self.whole.shape[2]) + joined[kept:, kept:]
        joined = joined[:kept, :kept] - joined[:kept, kept:] @ np.linalg.solve(common, joined[kept:, :kept])
        return joined, log_size + float(np.linalg.slogdet(common)[1])


def _within_poses(columns: Float, shared: Shared) -> tuple[Float, float]:
    """C^T S^-1 C (c, c) of columns C (m, d, c) and log det S, but for the errors that all have in common.

    I + U^T D^-1 U is block-tridiagonal, with D what observations have alone and U what poses' errors make of it.
    """
    inverse, own = np.linalg.inv(shared.alone), shared.own.mT
    weighted, size = inverse @ columns, shared.own.shape[2]
    joined = np.tensordot(columns, weighted, axes=([0, 1], [0, 1]))
    square, side = own @ inverse @ shared.own, own @ weighted  # (m, e, e), (m, e, c)
    diagonal, below = np.zeros((2, shared.poses + 1, size, size))
    at_poses = np.zeros((shared.poses + 1, size, columns.shape[2]))
    after, before = shared.fraction[:, None, None], 1 - shared.fraction[:, None, None]
    np.add.at(diagonal, shared.pose, before**2 * square)
    np.add.at(diagonal, shared.pose + 1, after**2 * square)
    np.add.at(below, shared.pose, before * after * square)
    np.add.at(at_poses, shared.pose, before * side)
    np.add.at(at_poses, shared.pose + 1, after * side)
    band = np.zeros((2 * size, shared.poses + 1, size))  # LAPACK's lower band storage
    band[0] = 1.0
    row, column = np.tril_indices(size)
    band[row - column, :, column] += diagonal[:, row, column].T
    row, column = np.indices((size, size)).reshape(2, -1)
    band[size + row - column, :-1, column] += below[:-1, row, column].T
    flat = at_poses.reshape(-1, columns.shape[2])
    factor = scipy.linalg.cholesky_banded(band.reshape(2 * size, -1), lower=True, check_finite=False)
    joined = joined - flat.T @ scipy.linalg.cho_solve_banded((factor, True), flat, check_finite=False)
    log_size = 2.0 * float(np.log(factor[0]).sum()) + float(np.linalg.slogdet(shared.alone)[1].sum())
    return joined, log_size


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """What n observations of d values each say about P unknowns, at an estimate of these."""

    residual: Shaped[Float, "n d"]  # measured less predicted
    jacobian: Shaped[Float, "n d P"]  # of the prediction
    covariance: Shaped[Float, "n d d"]  # of each observation's noise, what it shares included
    values: Shaped[Float, " n"]  # how many of the d say something new; less where observations repeat each other
    prior: Shaped[Float, "P P"]  # information that there is before, about the unknowns
    away: Shaped[Float, " P"]  # from the estimate to what is expected before
    shared: tuple[Shared, ...] = ()

    @classmethod
    def posed(
        cls,
        residual: Float,
        jacobian: Float,
        alone: Float,
        own: Float,
        pose: Int,
        values: Float,
        prior: Float,
        away: Float,
    ) -> Rows:
        """As `Rows`, of observations that share `own` (n, d, e) with those of their pose (n,), as in `Shared`."""
        n, d = residual.shape
        shared = Shared(np.arange(n), alone, own, pose, np.zeros(n), int(pose.max()) + 1, np.zeros((n, d, 0)))
        covariance = alone + own @ own.mT
        return cls(residual, jacobian, covariance, values, prior, away, (shared,))

    def only(self, keep: Bool) -> Rows:
        """The observations marked in `keep` (n,)."""
        if keep.all():
            return self
        parts = {name: getattr(self, name)[keep] for name in ("residual", "jacobian", "covariance", "values")}
        shared = tuple(one.only(keep) for one in self.shared if keep[one.rows].any())
        return replace(self, **parts, shared=shared)

    def beside(self, change: Float, at: Float, u: Float) -> Rows:
        """With q more unknowns `at` (q,), 0 but for their u (q,), that change the prediction by (n, d, q) each."""
        return replace(
            self,
            jacobian=np.concatenate([self.jacobian, change], axis=2),
            prior=scipy.linalg.block_diag(self.prior, np.diag(u**-2.0)),
            away=np.append(self.away, -at),
        )

    def freedom(self, used: Bool) -> int:
        """Degrees of freedom of a fit to the observations `used` (n,)."""
        known = int(np.count_nonzero(np.diagonal(self.prior)))
        return round(float(self.values[used].sum())) + known - len(self.prior)

    def product(self, columns: Float) -> Float:
        """C^T S^-1 C (c, c) of columns C (n, d, c) and the covariance S of all observations."""
        return self._weighted(columns)[0]

    def _weighted(self, columns: Float) -> tuple[Float, float]:
        """As `product`, with log det S."""
        alone = np.ones(len(columns), bool)
        for one in self.shared:
            alone[one.rows] = False
        own, covariance = columns[alone], self.covariance[alone]
        out = np.tensordot(own, np.linalg.solve(covariance, own), axes=([0, 1], [0, 1]))
        log_size = float(np.linalg.slogdet(covariance)[1].sum())
        for one in self.shared:
            joined, more = one.product(columns[one.rows])
            out, log_size = out + joined, log_size + more
        return np.asarray(out), log_size

    def normal(self) -> Normal:
        """The normal equations, prior included."""
        joined, log_size = self._weighted(np.concatenate([self.jacobian, self.residual[..., None]], axis=2))
        pull = self.prior @ self.away
        chi2 = float(joined[-1, -1] + self.away @ pull)
        return Normal(joined[:-1, :-1] + self.prior, joined[:-1, -1] + pull, chi2, log_size)


@dataclass(frozen=True, slots=True, eq=False)
class Normal:
    """Weighted least squares in normal form."""

    information: Shaped[Float, "P P"]
    side: Shaped[Float, " P"]
    chi2: float  # sum of the weighted squares
    log_size: float  # logarithm of the determinant of the observations' covariance

    @property
    def restricted(self) -> float:
        """Restricted log-likelihood of the noise, up to a constant (H. Patterson, R. Thompson, Biometrika 58, 1971)."""
        left = self.chi2 - float(self.side @ self.step())
        return -0.5 * (left + float(np.linalg.slogdet(self.information)[1]) + self.log_size)

    def step(self) -> Float:
        """To the minimum (P,), none along what nothing determines; unknowns differ in size, so scaled first."""
        scale = 1.0 / np.sqrt(np.maximum(np.diagonal(self.information), 1e-12))
        scaled = scale[:, None] * self.information * scale
        return np.asarray(scale * np.linalg.lstsq(scaled, scale * self.side, rcond=1e-13)[0])


def inverse_information(information: Float) -> Float:
    """Inverse (P, P) of an information matrix; huge, not infinite, in directions that nothing determines."""
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information), 1e-12))
    values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    return np.asarray(scale[:, None] * (vectors / np.maximum(values, OPEN)) @ vectors.T * scale)


def standard_u(covariance: Float) -> Float:
    """Standard uncertainties (k,) of a covariance (k, k)."""
    return np.sqrt(np.diagonal(covariance))


def times_u(change: Float, covariance: Float) -> float:
    """Length of a change (k,) over its standard uncertainty along itself, by a covariance (k, k)."""
    return float(change @ change / np.sqrt(max(float(change @ covariance @ change), 1e-300)))


def worst(covariance: Float) -> tuple[float, Float]:
    """Greatest standard uncertainty of a covariance (k, k), and its direction (k,), the largest part positive."""
    values, vectors = np.linalg.eigh(covariance)
    way = vectors[:, -1]
    return float(np.sqrt(max(values[-1], 0.0))), way * np.sign(way[np.abs(way).argmax()])


class Instrument(Protocol[S]):
    """What is measured with: a prediction of its observations, and unknowns."""

    def rows(self, at: S) -> Rows:
        """What all observations say at an estimate."""

    def moved(self, at: S, step: Float) -> S:
        """The estimate after a step (P,) in the unknowns."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit(Generic[S]):
    """An estimate, what it rests on and how sure it is."""

    at: S
    rows: Rows  # of all observations, at the estimate
    used: Shaped[Bool, " n"]
    information: Shaped[Float, "P P"]
    chi2: float

    @property
    def freedom(self) -> int:
        """Degrees of freedom."""
        return self.rows.freedom(self.used)

    @property
    def misfit(self) -> float:
        """Chi-square over its degrees of freedom."""
        return self.chi2 / max(self.freedom, 1)

    @property
    def inverse(self) -> Float:
        """Covariance (P, P) of the unknowns by the stated noise."""
        return inverse_information(self.information)

    @property
    def covariance(self) -> Float:
        """Covariance (P, P) of the unknowns, larger where the residuals are larger than the noise; priors stay."""
        return self._scaled(self.information, self.rows.prior, self.misfit if self.freedom > 0 else 1.0)

    @staticmethod
    def _scaled(information: Float, prior: Float, misfit: float) -> Float:
        """Inverse of an information matrix of which all but the prior is less by a misfit above 1."""
        return inverse_information((information - prior) / max(1.0, misfit) + prior)

    @property
    def distance(self) -> Float:
        """Of each observation (n,) from the fit of the others, in standard deviations as three normal numbers have."""
        return distance(self.rows, self.used, self.inverse)

    @property
    def usual(self) -> float:
        """How far off three quarters of all observations lie over what noise makes it, one left out as far off."""
        return usual(self.distance, self.used)

    def carried(self, change: Float) -> Float:
        """Change of the unknowns (P, q) by errors, not fitted, that change the observations by (n, d, q)."""
        columns = np.concatenate([self.rows.jacobian, change], axis=2)
        joined = self.rows.only(self.used).product(columns[self.used])
        size = len(self.information)
        return np.asarray(self.inverse @ joined[:size, size:])

    def tested(self, change: Float) -> tuple[Float, Float]:
        """What q more unknowns would be, 0 as fitted, that change the prediction by (n, d, q); and their covariance.

        The covariance is huge where the other unknowns do the same, and larger where the residuals are.
        """
        rows, more = self.rows, change.shape[2]
        columns = np.concatenate([rows.jacobian, change, rows.residual[..., None]], axis=2)
        joined, prior = rows.only(self.used).product(columns[self.used]), np.pad(rows.prior, (0, more))
        information, push = joined[:-1, :-1] + prior, joined[-1 - more : -1, -1]
        found = inverse_information(information)[-more:, -more:] @ push
        rest = (self.chi2 - found @ push) / max(self.freedom - more, 1)
        return found, self._scaled(information, prior, rest)[-more:, -more:]


def distance(rows: Rows, used: Bool, covariance: Float) -> Float:
    """As `Fit.distance`, of a fit with this covariance (P, P) of its unknowns."""
    sign = np.where(used, -1.0, 1.0)[:, None, None]
    factor = np.linalg.cholesky(rows.covariance)
    white, J = np.linalg.solve(factor, rows.residual[..., None])[..., 0], np.linalg.solve(factor, rows.jacobian)
    spread = np.eye(J.shape[1]) + sign * (J @ covariance @ J.mT)
    size = np.einsum("ni,nij,nj->n", white, np.linalg.pinv(spread, rcond=ALONE, hermitian=True), white)
    return as_of_three(size, J.shape[1])


def fit(instrument: Instrument[S], start: S, used: Bool | None = None, steps: int = STEPS) -> Fit[S]:
    """The estimate of greatest posterior probability from a start near it, on the observations `used` (n,).

    It ends where no shorter step can be solved either: what has run away shows in its misfit.
    """
    at, rows = start, instrument.rows(start)
    used = np.ones(len(rows.residual), bool) if used is None else used
    now = rows.only(used).normal()
    seen = [now.chi2]
    for _ in range(steps):
        step = now.step()
        length = step @ now.information @ step
        for _ in range(6):
            tried = _tried(instrument, instrument.moved(at, step), used)
            if tried is not None and tried[2].chi2 < WORSE[0] * now.chi2 + WORSE[1]:
                break
            step = step / 3.0
        if tried is None:
            break
        at, rows, now = tried
        seen.append(now.chi2)
        if length < CONVERGED or min(seen[-WANDERS:]) >= min(seen[:-WANDERS], default=np.inf):
            break
    return Fit(at, rows, used, now.information, now.chi2)


def from_all_about(instrument: Instrument[S], starts: Iterable[S]) -> Fit[S]:
    """The likeliest of fits from many starts: those that come nearest in two steps go on."""
    rough = sorted((fit(instrument, one, steps=2) for one in starts), key=lambda one: one.chi2)
    return min((fit(instrument, one.at) for one in rough[:GO_ON]), key=lambda one: one.chi2)


def _tried(instrument: Instrument[S], at: S, used: Bool) -> tuple[S, Rows, Normal] | None:
    """What the observations say at an estimate; None where that cannot be solved or is not finite."""
    try:
        rows = instrument.rows(at)
        normal = rows.only(used).normal()
    except np.linalg.LinAlgError:
        return None
    solved = np.isfinite(normal.chi2) and np.isfinite(normal.side).all() and np.isfinite(normal.information).all()
    return (at, rows, normal) if solved else None


def as_of_three(chi2: Float, values: int) -> Float:
    """Length of three standard normal numbers that is as rare as `chi2` of so many values.

    By the cube root of chi-square, which is nearly normal (E. Wilson, M. Hilferty, Proc. Nat. Acad. Sci. 17, 1931).
    """
    bend, of_three = 2.0 / (9.0 * values), 2.0 / 27.0
    normal = (np.cbrt(chi2 / values) - 1.0 + bend) / np.sqrt(bend)
    return np.asarray(np.sqrt(3.0 * np.maximum(1.0 - of_three + normal * np.sqrt(of_three), 0.0) ** 3))


def jacobian_of(predict: Callable[[Float], Float], steps: Float) -> Float:
    """Derivative (n, d, P) at 0 of a prediction (n, d) by the unknowns (P,), by central differences of `steps` (P,)."""
    columns = [(predict(one) - predict(-one)) / (2.0 * size) for one, size in zip(np.diag(steps), steps, strict=True)]
    return np.stack(columns, axis=-1)


@dataclass(frozen=True, slots=True)
class Labels:
    """How messages speak of the observations."""

    where: str  # the file
    numbers: tuple[int, ...]  # of each observation there
    name: str = "line"  # what a number counts
    ask: str = ""  # what may be wrong where they contradict each other


def usual(distance: Float, used: Bool) -> float:
    """As `Fit.usual`, of distances (n,)."""
    return float(np.quantile(np.where(used, distance, np.inf), 1.0 - MOST_GROSS, method="lower") / THREE_QUARTERS)


def far_off(distance: Float, used: Bool) -> Bool:
    """Which observations (n,) all others contradict: far off beside three quarters of *all*.

    One left out counts as far off there. More noise than stated is no blunder, and neither is what the model does not
    hold (gears, gravity).
    """
    return np.asarray(distance > GROSS * max(1.0, usual(distance, used)))


def nearest(instrument: Instrument[S], at: S) -> Bool:
    """Three quarters of the observations (n,), those nearest to an estimate; all, where that would check nothing."""
    rows = instrument.rows(at)
    everything = np.ones(len(rows.residual), bool)
    kept = _nearest(distance(rows, everything, np.zeros_like(rows.prior)))
    return kept if rows.freedom(kept) >= LEAST_FREEDOM else everything


def _nearest(distance: Float) -> Bool:
    kept = np.zeros(len(distance), bool)
    kept[np.argsort(distance, kind="stable")[: len(distance) - int(MOST_GROSS * len(distance))]] = True
    return kept


def sound(instrument: Instrument[S], start: S, halves: int = 20) -> Fit[S]:
    """The fit without what all others contradict; of all observations where too many would go, or nothing checks it.

    Three quarters that agree best with each other come first: fitted and chosen in turn, and where they do not agree,
    from halves drawn at random (P. Rousseeuw, K. Van Driessen, Computing LTS regression for large data sets, Data
    Mining and Knowledge Discovery 12, 2006). What is not far off them comes back.
    """
    found = _chosen(instrument, start, nearest(instrument, start))
    if halves and found.usual > DOUBTFUL:
        rng, count = np.random.default_rng(0), len(found.used)
        drawn = (rng.permutation(count) <= count // 2 for _ in range(halves))
        begun = [fit(instrument, found.at, one, 3) for one in drawn if found.rows.freedom(one) >= LEAST_FREEDOM]
        chosen = (_chosen(instrument, one.at, one.used) for one in sorted(begun, key=lambda one: one.usual)[:1])
        found = min((found, *chosen), key=lambda one: one.usual)
    for _ in range(TURNS):
        kept = ~far_off(found.distance, found.used)
        if (kept == found.used).all() or found.rows.freedom(kept) < LEAST_FREEDOM:
            break
        found = fit(instrument, found.at, kept)
    return found if (~found.used).mean() <= MOST_GROSS else fit(instrument, start)


def _chosen(instrument: Instrument[S], start: S, used: Bool) -> Fit[S]:
    """The fit to three quarters of the observations, those nearest to it; begun with `used` (n,)."""
    found = fit(instrument, start, used)
    for _ in range(TURNS):
        kept = _nearest(found.distance)
        if (kept == found.used).all() or found.rows.freedom(kept) < LEAST_FREEDOM:
            break
        found = fit(instrument, found.at, kept)
    return found


def without_blunders(
    instrument: Instrument[S], start: S, labels: Labels, *, spare: int = LEAST_FREEDOM, lengths: int = 3
) -> tuple[Fit[S], dict[int, str]]:
    """The fit without blunders: what all others contradict most is left out, one by one.

    More noise than stated is no blunder, and neither is what the model does not hold (gears, gravity): an observation
    must be far off beside three quarters of *all*, those left out before counted as far off.

    Args:
        instrument: predicts the observations.
        start: of every fit.
        labels: for what is said.
        spare: degrees of freedom that must be there to judge.
        lengths: how many of an observation's values, the first, are mm.

    Returns: the fit, and by number of the observation why it is left out.

    Raises:
        InputError: more blunders than can be told apart.
    """
    found, left_out = fit(instrument, start), dict[int, str]()
    count = len(found.used)
    while True:
        distance = np.where(found.used, found.distance, np.inf)
        worst = int(np.where(found.used, distance, -1.0).argmax())
        if found.freedom < spare or not far_off(distance, found.used)[worst]:
            return found, left_out
        if (~found.used).sum() + 1 > MOST_GROSS * count:
            raise contradictory(found.misfit, labels)
        used = found.used.copy()
        used[worst] = False
        found = fit(instrument, start, used)
        away, number = float(np.linalg.norm(found.rows.residual[worst, :lengths])), labels.numbers[worst]
        left_out[number] = f"{labels.name} {number} is left out: it lies {away:.2f} mm from where all other rows put it"


def contradictory(misfit: float, labels: Labels) -> InputError:
    """The refusal of observations that contradict each other."""
    words = f"the rows contradict each other: a misfit of {misfit:.0f} where 1 is usual; {labels.ask}"
    return InputError(labels.where, words)


def alike(place: Int, turn: Float, same: float) -> Float:
    """Observations (n,) that say the same as each, itself included: of one place (n,), turned by less than `same`.

    `turn` (n, n): between observations, rad. What is wrong in a posture is wrong in it however often it is written
    down, so that all of a posture's observations weigh as much as one.
    """
    return np.asarray(((place[:, None] == place[None, :]) & (turn <= same)).sum(axis=1), dtype=np.float64)
