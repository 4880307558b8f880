"""Is the answer the only one? Where all sphere centres lie near one plane, its mirror image fits as well."""

from __future__ import annotations

import numpy as np

from workbench.api import DEG, Float, InputError, vector_from_rotation
from workbench.plugins.calibration import bundle
from workbench.plugins.calibration.bundle import Fit
from workbench.plugins.calibration.model import Estimate, Noise, linearise
from workbench.plugins.calibration.observations import Observations

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
