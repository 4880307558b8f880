"""From circles to the hand-eye pose: maximum likelihood, gross postures, and whether it is the only answer."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from workbench.api import Float, estimator
from workbench.plugins.calibration.determinacy import Demand, check_postures
from workbench.plugins.calibration.model import SIZE, Estimate, Noise, Sphere, View, view_of
from workbench.plugins.calibration.observations import Observations
from workbench.plugins.calibration.search import located, undetermined
from workbench.plugins.calibration.shared_errors import Settled, settled

CONTRADICTED = 9.0  # chi-square of the data against the stated radius: 3 standard deviations
FREE_RADIUS = 0.05  # uncertainty of a sphere's radius that the data contradict, over the radius
NOTED = 1.5  # over the stated noise: then it is the noise, not the postures, that a refusal speaks of
NO_SUCH = "expected poses of the flange in the base, one sphere that does not move, and a right-handed profiler frame"
OTHER_SIDE = (
    "they do not tell on which side of the laser plane the sphere's centre lies; add postures, with the sphere on both "
    "sides of the plane"
)


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
        noise: the robot's repeatability and what is known of the sphere's radius.
        design: flange_from_profiler (4, 4) to begin with, off by up to 20 deg and 50 mm; None: unknown.
        where: the recording, for messages.
        limit_mm: largest predicted uncertainty of a point, RMS over the field of view, that is accepted.
        view: the field of view; None: where the circles lie.
        judged: whether the limit holds for the noise that the residuals ask for too, not for the stated one alone.

    Raises:
        InputError: too few postures, an undetermined direction, two answers that fit equally, or none that fits.
    """
    check_postures(seen.here, where, "sphere")
    sphere, demand = Sphere(seen, noise), Demand(view or view_of(seen.circle), limit_mm, where)
    best, alone = located(sphere, design, demand, NO_SUCH, OTHER_SIDE)
    answer = _with_free_radius(Answer(settled(best, sphere), sphere, best, alone))
    if judged:
        check_determined(answer, demand)
    return answer


def check_determined(answer: Answer, demand: Demand) -> None:
    """Refuse an answer that leaves a point of the field, or the clock's offset, more uncertain than is demanded."""
    found, sphere, why = answer.found, answer.sphere, ""
    if found.noise.pose_mm >= NOTED * sphere.noise.pose_mm:  # it is the noise, not the postures
        why = (
            f"the residuals ask for pose errors of {found.noise.pose_mm:.2f} mm an axis, stated are "
            f"{sphere.noise.pose_mm:g} mm"
        )
    used = Sphere(sphere.seen.subset(found.used), found.noise)
    demand.refuse(undetermined(used, found.estimate, found.covariance, demand, why=why))


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
