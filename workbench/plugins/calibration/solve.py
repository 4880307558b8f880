"""From circles to the hand-eye pose: signs, maximum likelihood, gross postures, and whether it is the only answer.

Whether the postures determine the answer is asked of the predicted uncertainty, and answered in words. The rank of a
matrix does not tell (noise makes degenerate sets full rank) and the scatter of the sphere centres does not either (it
is small along what nothing determines). The predicted uncertainty does: of the translation where the sphere was seen,
and of the rotation as a displacement at the field's edge.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from workbench.api import DEG, Float, InputError, estimator, inverse, vector_from_rotation
from workbench.plugins.calibration import bundle
from workbench.plugins.calibration.bundle import Fit
from workbench.plugins.calibration.model import Estimate, Noise, View, cross_matrix, linearise, view_of, volume_u
from workbench.plugins.calibration.observations import Observations, Passes, distinct_postures
from workbench.plugins.calibration.shared_errors import settled
from workbench.plugins.calibration.suspicions import suspected

COARSER = (1.0, 4.0, 16.0)  # the robot's noise in the search, until most postures agree: it may have systematic errors
COARSE_STEPS = 12  # of the fits from the grid of clock offsets
TRIED = 6  # answers of the search that are refined
HOPELESS = 0.5  # RMS residual of the centres, in sphere radii, beyond which nothing explains the data
CONTRADICTED = 9.0  # gain in chi-square with the radius free: 3 standard deviations
LOOKED_AT = 60  # observations, when a mistake in the poses is sought
FREE_RADIUS = 0.05  # uncertainty of a sphere's radius that the data contradict, over the radius
NOTED = 1.5  # over the stated noise: then it is the noise, not the postures, that a refusal speaks of
GROSS_ROUNDS = 3  # frames beside a gross one, which it had pulled the fit off, come back
OFFSET_GRID_MM, MAX_OFFSETS = 1.0, 200  # how finely clock offsets are searched

MIN_POSTURES = 4
ALIKE_RAD = 3 * DEG  # orientations that differ by less hardly count
OFFSET_MM = 0.2  # largest uncertainty of the clock's offset, as motion of the scans
MOVE_DIFFERENTLY = (
    "all scans move alike, so the clock's offset cannot be told from a shift along the motion: scan back and forth, "
    "and across"
)
ALIKE_MM = 1.5  # sphere centres likewise


@dataclass(frozen=True)
class Answer:
    """The hand-eye pose as found, and the observations that it rests on."""

    fit: Fit
    seen: Observations
    noise: Noise  # that the fit rests on: the robot's as large as the residuals say, the sphere's radius set free
    stated: Fit  # with the noise as stated: its chi-square tells a misfit
    alone: bool  # False: the design had to exclude a rival
    misfit: bool  # the residuals are larger than the stated noise explains
    with_offset: bool = False
    radius_free: bool = False  # the data contradict the sphere's stated radius


def solve(
    seen: Observations,
    noise: Noise,
    design: Float | None = None,
    *,
    where: str = "postures",
    limit_mm: float = 0.75,
    view: View | None = None,
    judged: bool = True,
) -> Answer:
    """The hand-eye pose from circles and poses (`observations.from_arrays`).

    Args:
        seen: circles with covariances and the flange's poses.
        noise: the robot's repeatability and what is known of the sphere's radius.
        design: flange_from_profiler (4, 4) to begin with, off by up to 20 deg and 50 mm; None: unknown.
        where: the recording, for messages.
        limit_mm: largest predicted uncertainty of a point, RMS over the field of view, that is accepted.
        view: the field of view; None: where the circles lie.
        judged: whether the limit holds for the noise that the residuals ask for too, not for the stated one alone.

    Raises:
        InputError: too few postures, an undetermined direction, two answers that fit equally, or none that fits.
    """
    check_postures(seen, where)
    view = view or view_of(seen.circle)
    refined = _refine(_search(seen, noise, design), seen, noise)
    best = refined[0]
    _check_explains(best, seen, noise, where, design)
    demand = Demand(view, limit_mm, where)
    check_fit(best, seen, noise, demand)  # before rivals: with nothing determined there are many
    best, alone = only_answer(refined, design, seen, noise, where)
    found = settled(best, seen, noise)
    stated, misfit = best, found.misfit
    best, final = _with_free_radius(found.fit, seen, found.noise)
    if final is not found.noise and seen.scans:
        found = settled(best, seen, dataclasses.replace(noise, radius_u_mm=final.radius_u_mm))
        best, final = found.fit, found.noise
    if judged:
        check_fit(best, seen, final, demand, raised=asked(noise, final))
    return Answer(best, seen, final, stated, alone, misfit, radius_free=final.radius_u_mm > noise.radius_u_mm)


def asked(stated: Noise, final: Noise) -> str:
    """What the residuals ask of the robot's noise, in words; empty where it is as stated."""
    if final.pose_mm < NOTED * stated.pose_mm:
        return ""
    return f"the residuals ask for pose errors of {final.pose_mm:.2f} mm an axis, stated are {stated.pose_mm:g} mm"


def solve_with_offset(
    passes: Passes,
    noise: Noise,
    design: Float | None = None,
    *,
    where: str = "postures",
    limit_mm: float = 0.75,
    view: View | None = None,
) -> Answer:
    """The same with the clock's offset, from scans over the sphere: a grid of offsets, then all unknowns together.

    Scans that determine nothing near the first fit are refused; `check_scans` judges what comes out.
    """
    view = view or view_of(passes.circle)
    low, high = passes.offset_range()
    speed = _speed(passes.place((low + high) / 2))
    count = int(np.clip((high - low) * speed / OFFSET_GRID_MM, 0, MAX_OFFSETS - 1)) + 1
    grid = low + (np.arange(count) + 0.5) / count * (high - low)
    blurred = dataclasses.replace(noise, pose_mm=float(np.hypot(noise.pose_mm, 0.3 * speed * (high - low) / count)))
    starts = []
    for offset in grid:
        ranked = next(bundle.candidates(passes.place(offset), blurred, design))[:2]
        starts += [(score, dataclasses.replace(one, offset_s=float(offset))) for score, one in ranked]
    fits: list[Fit] = []
    for _, start in sorted(starts, key=lambda pair: pair[0])[:TRIED]:
        coarse = bundle.fit(start, passes, blurred, with_offset=True, steps=COARSE_STEPS)
        if not fits:  # what is not determined here is not determined anywhere near
            first = bundle.fit(coarse.estimate, passes, noise, with_offset=True, steps=1)
            check_scans(first, passes, noise, Demand(view, limit_mm, where))
        if not any(bundle.same(coarse.estimate, other.estimate) for other in fits):
            fits.append(bundle.fit(coarse.estimate, passes, noise, with_offset=True))
    best = min(fits, key=lambda one: one.chi2)
    seen = passes.place(best.estimate.offset_s)
    for _ in range(GROSS_ROUNDS):
        used = bundle.left_out(best, seen, noise) < bundle.GROSS
        if (used == best.used).all() or (~used).mean() > estimator.MOST_GROSS:
            break
        best = bundle.fit(best.estimate, passes, noise, used=used, with_offset=True)
        seen = passes.place(best.estimate.offset_s)
    _check_explains(best, seen, noise, where, design)
    found = settled(best, passes, noise, with_offset=True)
    seen = passes.place(found.fit.estimate.offset_s)
    return Answer(found.fit, seen, found.noise, best, True, found.misfit, with_offset=True)


def check_scans(best: Fit, passes: Passes, noise: Noise, demand: Demand, raised: str = "") -> None:
    """Refuse scans that tell neither the pose nor the clock's offset well enough."""
    seen = passes.place(best.estimate.offset_s)
    check_fit(best, seen, noise, demand, with_offset=True, raised=raised)
    check_offset(float(np.sqrt(best.covariance[10, 10])), _speed(seen), demand.where)


def _speed(seen: Observations) -> float:
    return float(np.linalg.norm(seen.velocity[:, :3], axis=1).max())


def _search(seen: Observations, noise: Noise, design: Float | None) -> list[Estimate]:
    """Answers that explain most postures, best first."""
    best: list[tuple[float, Estimate]] = []
    for coarser in COARSER:
        rough = dataclasses.replace(noise, pose_mm=coarser * noise.pose_mm, pose_deg=coarser * noise.pose_deg)
        found: list[tuple[float, Estimate]] = []
        for ranked in bundle.candidates(seen, rough, design):
            found += ranked
            apart = bundle.distances(min(ranked, key=lambda pair: pair[0])[1], seen, rough) > bundle.SLACK * bundle.GATE
            if apart.mean() <= estimator.MOST_GROSS:
                break
        best = sorted(found, key=lambda pair: pair[0])
        if (bundle.distances(best[0][1], seen, rough) > bundle.SLACK * bundle.GATE).mean() <= estimator.MOST_GROSS:
            break
    near = [one for score, one in best if score <= 4 * best[0][0] + 2 * bundle.GATE / bundle.SLACK]
    return near[:TRIED]


def _refine(starts: list[Estimate], seen: Observations, noise: Noise) -> list[Fit]:
    """Maximum likelihood from each start, the better first; the same answer once."""
    fits = (bundle.without_gross(start, seen, noise) for start in starts)
    return sorted(bundle.distinct(fits, lambda one: one.estimate, 1e-3, 1e-5), key=_cost)


def _with_free_radius(best: Fit, seen: Observations, noise: Noise) -> tuple[Fit, Noise]:
    """The fit with the sphere's radius free where the data contradict the stated one, else as it is."""
    free = dataclasses.replace(noise, radius_u_mm=FREE_RADIUS * noise.radius_mm)
    if free.radius_u_mm <= noise.radius_u_mm or len(seen) < 6:
        return best, noise
    other = bundle.without_gross(best.estimate, seen, free)
    fits = other.chi2 < best.chi2 - CONTRADICTED and (other.used >= best.used).all()
    return (other, free) if fits else (best, noise)


def check_fit(
    best: Fit, seen: Observations, noise: Noise, demand: Demand, *, with_offset: bool = False, raised: str = ""
) -> None:
    """Refuse a fit that leaves a point of the field more uncertain than is demanded."""
    used = seen.subset(best.used)

    def cause() -> str:
        return raised or cause_of(used.base_from_flange, linearise(best.estimate, used, noise).centre, with_offset)

    refuse_undetermined(best.covariance[:6, :6], best.estimate, demand, cause)


def _check_explains(best: Fit, seen: Observations, noise: Noise, where: str, design: Float | None) -> None:
    """Refuse data that no hand-eye pose explains, with the mistake in the poses without which one would."""
    # The misfit is that of three quarters of the postures: it has to reach beyond those that every start explains.
    enough = (1.0 - estimator.MOST_GROSS) * (len(seen) - 1) > bundle.SEED_SIZE
    if enough and _unexplained(best.estimate, seen, noise) > 1.0:
        looked_at = np.isin(np.arange(len(seen)), np.linspace(0, len(seen) - 1, LOOKED_AT).astype(int))
        few = seen.subset(looked_at)

        def misfit(poses: Float) -> float:
            read = dataclasses.replace(few, base_from_flange=poses[looked_at])
            return _unexplained(next(bundle.candidates(read, noise, design))[0][1], read, noise)

        if mistake := suspected(seen.base_from_flange, misfit, 1.0):
            raise InputError(where, f"no hand-eye pose explains the postures; suspicion: {mistake}")
    linear = linearise(best.estimate, seen, noise)
    rms = float(np.sqrt(np.mean(np.sum(linear.residual[best.used, :2] ** 2, axis=1))))
    if rms > HOPELESS * noise.radius_mm or not np.isfinite(rms):
        raise InputError(
            where,
            f"no hand-eye pose explains the postures: the best leaves {rms:.2f} mm; expected poses of the flange in "
            "the base, one sphere that does not move, and a right-handed profiler frame",
        )


def _unexplained(estimate: Estimate, seen: Observations, noise: Noise) -> float:
    """Squared distance, in gates, within which an answer explains the postures but for as many as may be gross."""
    off = bundle.distances(estimate, seen, noise)
    return float(np.quantile(off, 1.0 - estimator.MOST_GROSS)) / (bundle.SLACK * bundle.GATE)


# Is the answer the only one? Where all sphere centres lie near one plane, its mirror image fits as well.

RIVAL = 16.0  # an answer whose chi-square is larger by less cannot be excluded: odds of e^8
REACH_MM, REACH_RAD = 100.0, 35 * DEG  # beyond it the design excludes an answer (it may be off by 50 mm and 20 deg)
CLEAR = 0.1  # distance of the sphere's centre from the laser plane, in radii, that has a side


def only_answer(
    refined: list[Fit], design: Float | None, seen: Observations, noise: Noise, where: str
) -> tuple[Fit, bool]:
    """The best answer, and whether it is the only one: one that the design's pose excludes is told, others refused."""
    best = refined[0]
    scale = max(1.0, best.chi2 / max(best.freedom, 1))  # a misfit blurs what can be told apart
    mirrored = [one for one in refined[1:] if _mirrored(one, best, seen, noise)]
    rivals = [one for one in mirrored if _cost(one) < _cost(best) + RIVAL]
    if not rivals:
        return best, not any(_cost(one) < _cost(best) + RIVAL * scale for one in mirrored)
    near = [one for one in [best, *rivals] if design is None or _within_reach(one.estimate, design)]
    if len(near) == 1:
        return near[0], False
    first, second = (near or [best, *rivals])[:2]
    turn = np.linalg.norm(vector_from_rotation(first.estimate.rotation.T @ second.estimate.rotation)) / DEG
    shift = np.linalg.norm(first.estimate.translation_mm - second.estimate.translation_mm)
    raise InputError(
        where,
        f"the postures do not determine on which side of the laser plane the sphere's centre lies: two answers, "
        f"{turn:.1f} deg and {shift:.1f} mm apart, fit almost equally (chi-square {first.chi2:.1f} and "
        f"{second.chi2:.1f}); add postures, with the sphere on both sides of the plane",
    )


def _cost(one: Fit) -> float:
    """Chi-square; a posture left out costs what would just have kept it."""
    return one.chi2 + bundle.GROSS * int((~one.used).sum())


def _mirrored(one: Fit, other: Fit, seen: Observations, noise: Noise) -> bool:
    """Whether two answers see the sphere's centre on different sides in some posture, clear of the laser plane."""
    y, y_other = (linearise(fit.estimate, seen, noise).centre[:, 1] for fit in (one, other))
    clear = np.minimum(np.abs(y), np.abs(y_other)) > CLEAR * noise.radius_mm
    return bool((clear & (y * y_other < 0) & one.used & other.used).any())


def _within_reach(estimate: Estimate, design: Float) -> bool:
    turn = np.linalg.norm(vector_from_rotation(estimate.rotation @ design[:3, :3].T))
    return bool(turn < REACH_RAD and np.linalg.norm(estimate.translation_mm - design[:3, 3]) < REACH_MM)


# Whether the postures determine the answer.


def directions(covariance: Float, estimate: Estimate, view: View) -> tuple[tuple[str, float], ...]:
    """The six principal directions of the uncertainty, worst first: in words, and the uncertainty in mm.

    From the hand-eye covariance (6, 6). Rotations are about the middle of the field of view and count by what they
    move at the RMS distance of its points.
    """
    R = estimate.rotation
    change = np.zeros((6, 6))  # to the profiler's axes: translation of the middle, rotation times lever
    change[:3, :3] = R.T
    change[:3, 3:] = -R.T @ cross_matrix(view.axes(R)[0])
    change[3:, 3:] = view.lever_mm * R.T
    values, vectors = np.linalg.eigh(change @ covariance @ change.T)
    return tuple((_words(vectors[:, i]), float(np.sqrt(max(values[i], 0.0)))) for i in range(5, -1, -1))


def check_postures(seen: Observations, where: str) -> None:
    """Refuse fewer than four postures; frames of a scan are judged by the uncertainty alone."""
    if seen.scans:
        return
    count = distinct_postures(seen.base_from_flange)
    if count < MIN_POSTURES:
        raise InputError(
            where,
            f"expected at least {MIN_POSTURES} distinct postures that see the sphere, found {count} (of {len(seen)} "
            "passes; repeats of a posture do not count): the hand-eye pose and the sphere's centre remain "
            "undetermined; turn the flange about two axes and move the sphere through the field of view",
        )


class Demand(NamedTuple):
    """What the answer must be good for."""

    view: View
    limit_mm: float  # largest uncertainty of a point, RMS over the field
    where: str  # the recording


def refuse_undetermined(covariance: Float, estimate: Estimate, demand: Demand, cause: Callable[[], str]) -> None:
    """Refuse a covariance that leaves a point of the field more uncertain than the limit: which direction, and why."""
    view, limit_mm, where = demand
    total = volume_u(covariance, estimate.rotation, view)
    if total <= limit_mm:
        return
    found = directions(covariance, estimate, view)
    also = sum(u > limit_mm for _, u in found[1:])
    more = f" and {also} more direction{'s' * (also > 1)}" if also else ""
    size = f"{total:.3g} mm" if total < 1000 else "more than a metre"
    raise InputError(
        where,
        f"the postures do not determine {found[0][0]}{more} well enough: predicted uncertainty {size} over the field "
        f"of view of {2 * view.half_mm[0]:.0f} by {2 * view.half_mm[1]:.0f} mm, allowed {limit_mm:g} mm (max_u_mm); "
        f"{cause()}",
    )


def check_offset(u_s: float, speed_mm_s: float, where: str) -> None:
    """Refuse a clock offset that only the noise of the scans' motion tells: they move alike."""
    if u_s * speed_mm_s > OFFSET_MM:
        raise InputError(
            where,
            f"the scans do not determine the clock's offset: predicted uncertainty {1e3 * u_s:.3g} ms, "
            f"{u_s * speed_mm_s:.2g} mm of motion, allowed {OFFSET_MM:g} mm; {MOVE_DIFFERENTLY}",
        )


def _words(v: Float) -> str:
    """A direction (6,) of translation and scaled rotation in the profiler's axes, in words."""
    turns = float(v[3:] @ v[3:]) > 0.5
    part = v[3:] if turns else v[:3]
    part = part / np.linalg.norm(part)
    part = part * np.sign(part[np.argmax(np.abs(part))])
    axis = "xyz"[int(np.argmax(np.abs(part)))]
    along = (
        f"the profiler's {axis}"
        if np.abs(part).max() > 0.97
        else "({:.2f}, {:.2f}, {:.2f}) in profiler axes".format(*part)
    )
    return f"the rotation about {along}" if turns else f"the translation along {along}"


def cause_of(base_from_flange: Float, centre: Float, with_offset: bool, what: str = "sphere") -> str:
    """Why a set of poses (k, 4, 4) is weak, and what would mend it; what is seen, at (k, 3) in the profiler frame."""
    between = inverse(base_from_flange[:1]) @ base_from_flange
    turns = vector_from_rotation(between[:, :3, :3])
    turning = np.linalg.svd(turns - turns.mean(axis=0), compute_uv=False) / np.sqrt(len(turns))
    spread = np.linalg.svd(centre - centre.mean(axis=0), compute_uv=False) / np.sqrt(len(centre))
    if turning[0] < ALIKE_RAD:
        return "all postures have nearly the same orientation: turn the flange about two different axes"
    if turning[1] < ALIKE_RAD:
        if _two_clusters(turns):
            return "there are only two orientations: add a third, turned about another axis"
        return "all postures turn about one axis: turn the flange about a second one"
    if spread[0] < ALIKE_MM:
        return f"the {what} lies at one point of the profile in all postures: move it through the field of view"
    if spread[1] < ALIKE_MM:
        return f"the {what} lies on one line of the field of view: spread it over its width and depth"
    if with_offset:
        return MOVE_DIFFERENTLY
    return f"add postures that differ in orientation and in where the {what} lies in the profile"


def _two_clusters(turns: Float) -> bool:
    """Whether rotation vectors (k, 3) gather in two places."""
    far = np.linalg.norm(turns - turns[0], axis=1)
    other = turns[np.argmax(far)]
    return bool((np.minimum(far, np.linalg.norm(turns - other, axis=1)) < ALIKE_RAD).all())
