"""From circles to the hand-eye pose: maximum likelihood, gross postures, and whether it is the only answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from workbench.api import Float, estimator
from workbench.plugins.calibration.determinacy import Demand, check_postures
from workbench.plugins.calibration.model import LEAST_MM, Estimate, Noise, Sphere, View
from workbench.plugins.calibration.observations import Observations
from workbench.plugins.calibration.search import located, off, suspicion, undetermined
from workbench.plugins.calibration.shared_errors import Settled, settled

SURE = 2e-3  # probability, two-sided, below which a stated radius or scale is contradicted: freeing one costs little
NOTED = 1.5  # over the stated noise: then it is the noise, not the postures, that a refusal speaks of
NO_SUCH = "expected poses of the flange in the base, one sphere that does not move, and a right-handed profiler frame"
SMALLER = 0.6  # of a sphere's stated diameter, over the largest circle: 0.8 of the radius beside the plane always
OTHER_SIDE = (
    "they do not tell on which side of the laser plane the sphere's centre lies; add postures, with the sphere on both "
    "sides of the plane"
)


@dataclass(frozen=True)
class Answer:
    """The hand-eye pose as found, and the observations that it rests on."""

    found: Settled
    sphere: Sphere  # with the noise as stated, but for what the data contradict
    stated: estimator.Fit[Estimate]  # of it: its chi-square tells a misfit
    alone: bool  # False: the design had to exclude a rival
    free: tuple[int, ...] = ()  # what the data contradict: 0 the sphere's radius, 1 and 2 the profiler's x and z

    @property
    def seen(self) -> Observations:
        """By the clock as found."""
        return self.sphere.seen.place(self.found.estimate.offset_s)


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
        seen: circles with covariances and the flange's poses; scans tell the offset of a clock of their own.
        noise: the robot's repeatability, and what is known of the sphere's radius and the profiler's scales.
        design: flange_from_profiler (4, 4) to begin with, off by up to 20 deg and 50 mm; None: unknown.
        where: the recording, for messages.
        limit_mm: largest predicted uncertainty of a point, RMS over the field of view, that is accepted.
        view: the field of view; None: the least, about the circles' middle.
        judged: whether the limit holds for the noise that the residuals ask for too, not for the stated one alone.

    Raises:
        InputError: too few postures, an undetermined direction, two answers that fit equally, or none that fits.
    """
    check_postures(seen.here, where, "sphere")
    x, z = seen.circle[:, :2].mean(axis=0).tolist()
    sphere, demand = Sphere(seen, noise), Demand(view or View((x, z), LEAST_MM), limit_mm, where)
    largest, stated = 2.0 * np.sqrt(seen.circle[:, 2].max()), 2.0 * noise.radius_mm
    ask = f"suspicion: another sphere: all circles are within {largest:.3g} mm, stated is a diameter of {stated:g} mm"
    best, alone = located(sphere, design, demand, ask if largest < SMALLER * stated else NO_SUCH, OTHER_SIDE)
    answer = _freed(Answer(settled(best, sphere), sphere, best, alone))
    if judged:
        check_determined(answer, demand, design)
    return answer


def check_determined(answer: Answer, demand: Demand, design: Float | None) -> None:
    """Refuse an answer that leaves a point of the field, or the clock's offset, more uncertain than is demanded.

    With the mistake in the poses, begun at the design's, that would explain residuals larger than noise.
    """
    found, sphere, why = answer.found, answer.sphere, ""
    if found.noise.pose_mm >= NOTED * sphere.noise.pose_mm:  # it is the noise, not the postures
        why = (
            f"the residuals ask for pose errors of {found.noise.pose_mm:.2f} mm an axis, stated are "
            f"{sphere.noise.pose_mm:g} mm"
        )
    used = Sphere(sphere.seen.subset(found.used), found.noise)
    said = undetermined(used, found.estimate, found.covariance, demand, why=why)
    if said and why and (mistake := suspicion(sphere, found.estimate.offset_s, design, off(answer.stated) / 2.0)):
        said = f"{said}; suspicion: {mistake}"
    demand.refuse(said)


def _freed(answer: Answer) -> Answer:
    """The answer with those of radius and scales free that the data contradict, the most contradicted first.

    By the ratio of likelihoods, residuals as large as they are with it free: misfit that it explains is no noise.
    """
    found, known = answer.found, answer.sphere.noisy(answer.found.noise)
    held = estimator.fit(known, found.estimate, found.used)
    every = range(1 + len(found.estimate.scale))
    tried = [estimator.fit(known.noisy(found.noise.freed(k)), found.estimate, found.used) for k in every]
    which, freedom = min(every, key=lambda k: tried[k].chi2), held.freedom - 1
    if freedom < estimator.LEAST_FREEDOM:
        return answer
    left = min(max(tried[which].chi2 / freedom, 1e-9), 1.0)
    if 2.0 * scipy.special.stdtr(freedom, -np.sqrt(max(held.chi2 - tried[which].chi2, 0.0) / left)) > SURE:
        return answer
    sphere = answer.sphere.noisy(answer.sphere.noise.freed(which))
    stated = estimator.sound(sphere, tried[which].at)
    return _freed(Answer(settled(stated, sphere), sphere, stated, answer.alone, (*answer.free, which)))
