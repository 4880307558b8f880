"""Hand-eye poses from anywhere: where to begin, which answers there are, and what is wrong where there is none.

For a rotation of the profiler all else follows by linear least squares, whatever is seen: rotations all about and the
design's are tried, the likeliest are fitted (`estimator`), and the same answer counts once. An answer that explains the
profiles as well as the best one is a rival; the design's pose may exclude it. Where none explains them, the known
mistakes in a recording's poses are tried in turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import compress, islice
from typing import Protocol, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.api import DEG, Float, InputError, estimator, rotation_from_vector, vector_from_rotation
from workbench.plugins.calibration.determinacy import Demand, cause_of, offset_open, speed_of, too_open
from workbench.plugins.calibration.model import Estimate
from workbench.plugins.calibration.observations import Flange, Timed
from workbench.plugins.calibration.suspicions import Fitted, suspected

S = TypeVar("S")

NEAR = 20 * DEG  # by which the design's pose may be off: it is turned so far each way
TRIED, REFINED = 12, 6  # starts, and answers of these, the likeliest
ROUGH_STEPS = 12  # before what is unlikely is left out
OFFSET_GRID_MM, MAX_OFFSETS = 3.0, 60  # how finely clock offsets are searched
THINNED = 200  # observations that a search looks at
LOOKED_AT = 60  # likewise, where a mistake in the poses is sought
SAME = np.repeat([0.5, 0.02], 3)  # mm and rad, within which two answers are one
UNUSUAL = 10.0  # times the noise, that three quarters of what is seen lie off: it is no noise
RIVAL = 16.0  # an answer whose chi-square is larger by less cannot be excluded: odds of e^8
APART = 5.0  # standard deviations between answers that are two
REACH_MM, REACH_RAD = 100.0, 35 * DEG  # beyond it the design excludes an answer (it may be off by 50 mm and 20 deg)


class Target(estimator.Instrument[S], Protocol[S]):
    """What stands still in the base and is seen by the profiler; among its unknowns is the hand-eye pose.

    Where it is seen by a clock whose offset is unknown (`Timed`), the last of them is the offset.
    """

    @property
    def what(self) -> str:
        """It is, in words."""

    @property
    def flange(self) -> Flange | Timed:
        """Where it is seen from."""

    def searched(self, most: int, flange: Flange | None = None) -> Target[S]:
        """Of so many observations at most; from another flange of all, if given."""

    def starts(self, rotations: Float, offsets_s: Float, most: int) -> list[tuple[float, S]]:
        """What fits best beside rotations (m, 3, 3) and offsets (o,), the likeliest first, and how far off it is.

        `most`: of these rotations and offsets that are looked into, where that takes a fit.
        """

    def shown(self, at: S) -> Float:
        """Where it lies in the profiler frame (k, 3)."""

    @staticmethod
    def pose(at: S) -> Estimate:
        """The hand-eye pose of an estimate."""


def located(
    target: Target[S], design: Float | None, demand: Demand, mistaken: str, ask: str
) -> tuple[estimator.Fit[S], bool]:
    """The likeliest answer, and whether it is the only one.

    Args:
        target: that is seen.
        design: flange_from_profiler (4, 4) to begin with, off by up to 20 deg and 50 mm; None: unknown.
        demand: what the answer must be good for.
        mistaken: what may be wrong where no pose explains the profiles.
        ask: what tells two answers apart.

    Raises:
        InputError: an undetermined direction, two answers that fit equally, or none that fits.
    """
    fits = _all_answers(target, design, demand.where)
    _refuse_unexplained(target, fits, design, demand.where, mistaken)
    demand.refuse(undetermined(target, fits[0].at, fits[0].inverse, demand))  # before rivals: where nothing is are many
    return _only_answer(fits, target, design, demand.where, ask)


def undetermined(target: Target[S], at: S, covariance: Float, demand: Demand, why: str = "") -> str:
    """What an answer with this covariance (P, P) leaves more uncertain than is demanded; empty: nothing.

    why: it does so, where that is known.
    """
    pose = target.pose(at)
    flange, own_clock = target.flange.at(pose.offset_s), isinstance(target.flange, Timed)

    def cause() -> str:
        return why or cause_of(flange.base_from_flange, target.shown(at), own_clock, target.what)

    said = too_open(covariance[:6, :6], pose, demand, cause)
    if said or not own_clock:
        return said
    return offset_open(math.sqrt(covariance[-1, -1]), flange)


def _all_answers(target: Target[S], design: Float | None, where: str) -> list[estimator.Fit[S]]:
    """The likeliest answers, each once and without what contradicts it, the best first; none where all run away.

    About the design's pose; from rotations all about, where there is none, or none near it explains what is seen.
    """
    offsets_s = _offsets(target.flange, where)
    if design is not None:
        turns = np.concatenate([np.zeros((1, 3)), NEAR * np.eye(3), -NEAR * np.eye(3)])
        near = _answers(target, rotation_from_vector(turns) @ design[:3, :3], offsets_s)
        if near and off(near[0]) <= UNUSUAL:
            return near
    return _answers(target, Rotation.create_group("I").as_matrix(), offsets_s)


def _offsets(flange: Flange | Timed, where: str) -> Float:
    """Clock offsets to begin with, so near to each other that one is right enough."""
    if not isinstance(flange, Timed):
        return np.zeros(1)
    low, high = flange.range_s
    if low > high:
        raise InputError(
            where.replace("/robot", "/profiles/time"),
            "no clock offset puts the frames of all scans within the robot's poses",
        )
    count = int(np.clip((high - low) * speed_of(flange.at((low + high) / 2)) / OFFSET_GRID_MM, 0, MAX_OFFSETS - 1)) + 1
    return low + (np.arange(count) + 0.5) / count * (high - low)


def _answers(target: Target[S], rotations: Float, offsets_s: Float) -> list[estimator.Fit[S]]:
    few = target.searched(THINNED)
    starts = islice(_distinct((at for _, at in few.starts(rotations, offsets_s, TRIED)), target), TRIED)
    rough = sorted(_solved(partial(_rough, few), starts), key=lambda one: one.chi2)
    best = islice(_distinct((one.at for one in rough), target), REFINED)
    fits = sorted(_solved(partial(estimator.sound, target, halves=0), best), key=cost)
    again = _solved(partial(estimator.sound, target), (one.at for one in fits[:1]))
    return sorted([*again, *fits[1:]], key=cost)


def _rough(target: Target[S], at: S) -> estimator.Fit[S]:
    return estimator.fit(target, at, estimator.nearest(target, at), ROUGH_STEPS)


def _solved(fit: Callable[[S], estimator.Fit[S]], starts: Iterable[S]) -> list[estimator.Fit[S]]:
    """The fits from all starts but those that run away: errors of poses infinitely far away have no inverse."""
    found = []
    for at in starts:
        with suppress(np.linalg.LinAlgError):
            found.append(fit(at))
    return found


def _distinct(every: Iterable[S], target: Target[S]) -> Iterator[S]:
    """Estimates that are none of those before."""
    kept: list[Estimate] = []
    for at in every:
        pose = target.pose(at)
        if all(np.abs(between(pose, other) / SAME).max() > 1.0 for other in kept):
            kept.append(pose)
            yield at


def between(one: Estimate, other: Estimate) -> Float:
    """From a hand-eye pose to another: translation (mm), rotation vector (rad), as a covariance of one counts."""
    turn = vector_from_rotation(other.rotation @ one.rotation.T)
    return np.concatenate([other.translation_mm - one.translation_mm, turn])


def cost(one: estimator.Fit[S]) -> float:
    """Chi-square; an observation left out costs what would just have kept it."""
    return one.chi2 + estimator.GROSS**2 * int((~one.used).sum())


def off(one: estimator.Fit[S]) -> float:
    """How far off three quarters of what is seen lie, over the noise; and no less than what a fit rests on does."""
    return max(one.usual, math.sqrt(one.misfit))


def _only_answer(
    fits: list[estimator.Fit[S]], target: Target[S], design: Float | None, where: str, ask: str
) -> tuple[estimator.Fit[S], bool]:
    """The best answer, and whether it is the only one: one that the design's pose excludes is told, others refused."""
    best, others = fits[0], [one for one in fits[1:] if _two(fits[0], one, target)]
    rivals = [one for one in others if cost(one) < cost(best) + RIVAL]
    if not rivals:  # a misfit blurs what can be told apart
        return best, all(cost(one) > cost(best) + RIVAL * max(1.0, best.misfit) for one in others)
    near = [best, *rivals]
    if design is not None:
        built = Estimate(design[:3, :3], design[:3, 3], np.zeros(3), 0.0)
        off_mm, off_rad = (
            np.linalg.norm([between(built, target.pose(one.at))[part] for one in near], axis=1)
            for part in (slice(3), slice(3, 6))
        )
        near = list(compress(near, (off_mm < REACH_MM) & (off_rad < REACH_RAD)))
    if len(near) == 1:
        return near[0], False
    first, second = (near or [best, *rivals])[:2]
    apart = between(target.pose(first.at), target.pose(second.at))
    raise InputError(
        where,
        f"two hand-eye poses, {np.linalg.norm(apart[3:]) / DEG:.1f} deg and {np.linalg.norm(apart[:3]):.1f} mm apart, "
        f"explain the profiles equally (chi-square {first.chi2:.1f} and {second.chi2:.1f}): {ask}",
    )


def _two(best: estimator.Fit[S], other: estimator.Fit[S], target: Target[S]) -> bool:
    """Whether they are two answers, beyond what the better one leaves open."""
    d = between(target.pose(best.at), target.pose(other.at))
    return bool(d @ np.linalg.solve(best.covariance[:6, :6], d) > APART**2 and np.abs(d / SAME).max() > 1.0)


def _refuse_unexplained(
    target: Target[S], fits: list[estimator.Fit[S]], design: Float | None, where: str, ask: str
) -> None:
    """Refuse profiles that no pose explains, with the mistake in the flange's poses without which one would.

    The misfit is that of three quarters of what is seen: it has to reach beyond what every answer explains.
    """
    left = off(fits[0]) if fits else np.inf
    if fits and (fits[0].freedom < estimator.LEAST_FREEDOM or left <= UNUSUAL / 2.0):
        return
    mistake = suspicion(target, target.pose(fits[0].at).offset_s if fits else 0.0, design, min(UNUSUAL, left / 4.0))
    if not mistake and left <= UNUSUAL:
        return
    said = f"suspicion: {mistake}" if mistake else ask
    found = f"the best leaves {left:.0f} times the noise" if fits else "every one runs away"
    raise InputError(where, f"no hand-eye pose explains the profiles: {found}; {said}")


def suspicion(target: Target[S], offset_s: float, design: Float | None, most: float) -> str:
    """The mistake in the flange's poses without which profiles lie at most so many times the noise off; empty: none."""
    flange = target.flange.at(offset_s)
    turns = Rotation.create_group("I").as_matrix() if design is None else design[None, :3, :3]

    def begin(poses: Float) -> tuple[float, Fitted]:
        read = target.searched(LOOKED_AT, replace(flange, base_from_flange=poses))
        begun = read.starts(turns, np.zeros(1), REFINED // 2)[:2]

        def misfit() -> float:
            fits = _solved(partial(_rough, read), (at for _, at in begun))
            return min((off(one) for one in fits), default=np.inf)

        return begun[0][0], misfit

    return suspected(flange.base_from_flange, begin, most)
