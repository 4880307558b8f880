"""What a calibration says about itself: misfit, postures rejected, warnings."""

from __future__ import annotations

import math

import numpy as np

from workbench.api import Float
from workbench.plugins.calibration.bundle import Fit
from workbench.plugins.calibration.model import Linear, Noise
from workbench.plugins.calibration.observations import Observations, Passes
from workbench.plugins.calibration.scales import AXES, Scales
from workbench.plugins.calibration.solve import Answer
from workbench.plugins.calibration.values import Method, Rejected, SphereProfiles

FEW = 6  # postures below which hardly anything checks the answer
NOISY = 2.0  # over the stated noise of the profile's points


def rejections(
    profiles: SphereProfiles, passes: Passes, result: Fit, seen: Observations, linear: Linear, off: Float
) -> tuple[Rejected, ...]:
    """Frames that do not count: without an arc, repeats that contradict, gross postures."""
    gross = [
        Rejected(
            frame,
            f"gross pose: the sphere is off by {r[0]:+.2f} mm in x and {r[1]:+.2f} mm in z, "
            f"{np.sqrt(distance):.0f} standard deviations in all",
        )
        for frames, good, r, distance in zip(seen.frames, result.used, linear.residual, off, strict=True)
        if not good
        for frame in frames
    ]
    return tuple(sorted([*profiles.rejected, *passes.rejected, *gross], key=lambda one: one.frame))


def warnings(
    result: Fit,
    answer: Answer,
    scales: Scales,
    profiles: SphereProfiles,
    stated: Noise,
    systematic_mm: float | None,
    method: Method,
) -> tuple[str, ...]:
    """Warnings in plain words; empty when all is well."""
    said = []
    count = int(result.used.sum())
    gross = int((~result.used).sum())
    if gross:
        which = [
            str(frame)
            for frames, good in zip(answer.seen.frames, result.used, strict=True)
            if not good
            for frame in frames
        ]
        said.append(f"{gross} of {count + gross} postures rejected as gross (frames {', '.join(which[:12])})")
    if answer.misfit:
        said.append(_misfit(answer, stated, systematic_mm))
    for axis, free, error, variance in zip(AXES, scales.free, scales.error, np.diag(scales.covariance), strict=True):
        if free:
            size = f"{abs(100 * error):.1f} +- {100 * math.sqrt(variance):.1f} % too {'long' if error > 0 else 'short'}"
            said.append(
                f"the profiler's {axis} is {size}: taken out here, and of scans that use this calibration; check the "
                "sensor's scale in that axis"
            )
    if count < FEW:
        said.append(
            f"only {count} postures: {answer.fit.freedom} more measured values than unknowns, so a wrong pose "
            "or profile may pass unnoticed; take nine or more"
        )
    if answer.radius_free:
        found, stated_mm = 2 * answer.fit.estimate.radius_mm, profiles.sphere_diameter_mm
        said.append(f"the sphere's diameter is {found:.3f} mm by the data, stated {stated_mm:.3f} mm: set free")
    if not answer.alone:
        said.append(
            "a second answer, with the sphere on the other side of the laser plane, fits nearly as well: add "
            "postures with the sphere on both sides"
        )
    if profiles.noise_mm > NOISY * profiles.stated_noise_mm:
        said.append(
            f"points scatter by {profiles.noise_mm:.3f} mm about their circles, stated "
            f"{profiles.stated_noise_mm:g} mm: check exposure, and the sphere's surface"
        )
    if method != "bundle":
        said.append(f"method '{method}' is for comparison; its uncertainty is propagated from the stated noise")
    return tuple(said)


def _misfit(answer: Answer, stated: Noise, systematic_mm: float | None) -> str:
    fit = answer.stated
    text = (
        f"misfit that repeatability cannot explain: chi-square {fit.chi2:.0f} on {fit.freedom} degrees of "
        f"freedom; the residuals ask for pose errors of {answer.noise.pose_mm:.2f} mm an axis, stated are "
        f"{stated.pose_mm:g} mm: a systematic robot error, a sphere that moved, or a wrong noise"
    )
    if systematic_mm is not None:
        return f"{text}; systematic errors of {systematic_mm:.2f} mm an axis are allowed for"
    return f"{text}; robot_error 'correlated' allows for errors that near postures share"
