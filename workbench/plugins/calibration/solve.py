"""From circles to the hand-eye pose: maximum likelihood, gross postures, and whether it is the only answer.

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
from workbench.plugins.calibration.model import (
    SIZE,
    Estimate,
    Noise,
    Sphere,
    View,
    cross_matrix,
    linearise,
    view_of,
    volume_u,
)
from workbench.plugins.calibration.observations import Observations, Passes, distinct_postures
from workbench.plugins.calibration.search import answers, only_answer, refuse_unexplained
from workbench.plugins.calibration.shared_errors import Settled, settled

CONTRADICTED = 9.0  # chi-square of the data against the stated radius: 3 standard deviations
FREE_RADIUS = 0.05  # uncertainty of a sphere's radius that the data contradict, over the radius
NOTED = 1.5  # over the stated noise: then it is the noise, not the postures, that a refusal speaks of
OFFSET_GRID_MM, MAX_OFFSETS = 3.0, 60  # how finely clock offsets are searched
NO_SUCH = "expected poses of the flange in the base, one sphere that does not move, and a right-handed profiler frame"
OTHER_SIDE = (
    "they do not tell on which side of the laser plane the sphere's centre lies; add postures, with the sphere on both "
    "sides of the plane"
)

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

    found: Settled
    sphere: Sphere  # with the noise as stated, but for a radius that the data contradict
    stated: estimator.Fit[Estimate]  # of it: its chi-square tells a misfit
    alone: bool  # False: the design had to exclude a rival
    radius_free: bool = False  # the data contradict the sphere's stated radius

    @property
    def seen(self) -> Observations:
        """By the clock as found."""
        return self.sphere.seen.place(self.found.estimate.offset_s)


def solve(
    passes: Observations | Passes,
    noise: Noise,
    design: Float | None = None,
    *,
    with_offset: bool = False,
    where: str = "postures",
    limit_mm: float = 0.75,
    view: View | None = None,
    judged: bool = True,
) -> Answer:
    """The hand-eye pose from circles and poses (`observations.from_arrays`).

    Args:
        passes: circles with covariances and the flange's poses.
        noise: the robot's repeatability and what is known of the sphere's radius.
        design: flange_from_profiler (4, 4) to begin with, off by up to 20 deg and 50 mm; None: unknown.
        with_offset: whether the offset of the profiles' clock is unknown; scans tell it.
        where: the recording, for messages.
        limit_mm: largest predicted uncertainty of a point, RMS over the field of view, that is accepted.
        view: the field of view; None: where the circles lie.
        judged: whether the limit holds for the noise that the residuals ask for too, not for the stated one alone.

    Raises:
        InputError: too few postures, an undetermined direction, two answers that fit equally, or none that fits.
    """
    if not (isinstance(passes, Passes) and with_offset):
        passes = passes.place()
    check_postures(passes.place(), where)
    demand = Demand(view or view_of(passes.circle), limit_mm, where)
    sphere = Sphere(passes, noise, with_offset)
    fits = answers(sphere, design, _offsets(passes) if isinstance(passes, Passes) else np.zeros(1))
    flange = passes.place(fits[0].at.offset_s if fits else 0.0).base_from_flange
    refuse_unexplained(sphere, fits, flange, design, where, NO_SUCH)
    begun = Settled(fits[0].at, fits[0].inverse, fits[0].used, noise, False)
    check_determined(Answer(begun, sphere, fits[0], True), demand)  # before rivals: where nothing is, there are many
    best, alone = only_answer(fits, sphere, design, where, OTHER_SIDE)
    answer = _with_free_radius(Answer(settled(best, sphere), sphere, best, alone))
    if judged:
        check_determined(answer, demand, asked(noise, answer.found.noise))
    return answer


def asked(stated: Noise, final: Noise) -> str:
    """What the residuals ask of the robot's noise, in words; empty where it is as stated."""
    if final.pose_mm < NOTED * stated.pose_mm:
        return ""
    return f"the residuals ask for pose errors of {final.pose_mm:.2f} mm an axis, stated are {stated.pose_mm:g} mm"


def _offsets(passes: Passes) -> Float:
    """Clock offsets to begin with, so near to each other that one is right enough."""
    low, high = passes.offset_range()
    speed = _speed(passes.place((low + high) / 2))
    count = int(np.clip((high - low) * speed / OFFSET_GRID_MM, 0, MAX_OFFSETS - 1)) + 1
    return np.asarray(low + (np.arange(count) + 0.5) / count * (high - low))


def _speed(seen: Observations) -> float:
    return float(np.linalg.norm(seen.velocity[:, :3], axis=1).max())


def _with_free_radius(answer: Answer) -> Answer:
    """The answer with the sphere's radius free where the data contradict the stated one, else as it is."""
    sphere, found = answer.sphere, answer.found
    noise, size = found.noise, SIZE - 1
    off2, told2 = (found.estimate.radius_mm - noise.radius_mm) ** 2, noise.radius_u_mm**2 - found.covariance[size, size]
    u_mm = FREE_RADIUS * noise.radius_mm
    if u_mm <= noise.radius_u_mm or len(sphere.seen) < 6 or off2 <= CONTRADICTED * told2:
        return answer
    sphere = sphere.noisy(dataclasses.replace(sphere.noise, radius_u_mm=u_mm))
    stated = estimator.sound(sphere, found.estimate)
    return Answer(settled(stated, sphere), sphere, stated, answer.alone, True)


def check_determined(answer: Answer, demand: Demand, raised: str = "") -> None:
    """Refuse an answer that leaves a point of the field, or the clock's offset, more uncertain than is demanded."""
    found, seen, with_offset = answer.found, answer.seen, answer.sphere.with_offset
    used = seen.subset(found.used)

    def cause() -> str:
        return raised or cause_of(
            used.base_from_flange, linearise(found.estimate, used, found.noise).centre, with_offset
        )

    refuse_undetermined(found.covariance[:6, :6], found.estimate, demand, cause)
    if with_offset:
        check_offset(float(np.sqrt(found.covariance[SIZE, SIZE])), _speed(seen), demand.where)


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
