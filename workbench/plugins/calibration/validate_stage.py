"""`calibrate.validate`: how well the calibration predicts postures that it was not made from."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import NamedTuple

import numpy as np

from workbench.api import (
    Document,
    Float,
    InputError,
    Recording,
    Shaped,
    estimator,
    frozen,
    result_file,
    stage,
)
from workbench.plugins.calibration.determinacy import MIN_POSTURES
from workbench.plugins.calibration.model import Estimate, Noise, Sphere, by_circle
from workbench.plugins.calibration.observations import Observations
from workbench.plugins.calibration.plan_stage import estimate_of, seen_again
from workbench.plugins.calibration.scanned import start_center
from workbench.plugins.calibration.tables import rms_mm
from workbench.plugins.calibration.values import Calibration, SphereProfiles, Validation

# Postures that a calibration is not made from: left out in turn, or a second recording.


class HeldOut(NamedTuple):
    """Postures predicted, not fitted: residuals of (x_c, z_c, w) and their covariance."""

    residual: Shaped[Float, "k 3"]
    covariance: Shaped[Float, "k 3 3"]
    y_mm: Shaped[Float, " k"]  # of the sphere's centre
    chi2: float
    freedom: int


def each_held_out(estimate: Estimate, seen: Observations, noise: Noise, source: str) -> HeldOut:
    """Each posture, and each scan as a whole, predicted from a fit of all the others; chi-square with correlations."""
    scans = [scan.rows for scan in seen.here.scans]
    passes = [*np.setdiff1d(np.arange(len(seen)), np.concatenate([[], *scans]))[:, None].astype(int), *scans]
    if len(passes) <= MIN_POSTURES:
        raise InputError(
            f"{source}: /robot",
            f"{len(passes)} postures are too few to hold 1 out: expected {MIN_POSTURES} others at least",
        )
    each = []
    for one in passes:
        out = np.isin(np.arange(len(seen)), one)
        fitted, held = estimator.fit(Sphere(seen, noise), estimate, ~out), Sphere(seen.subset(out), noise)
        rows = held.rows(fitted.at)
        normal = replace(rows, prior=fitted.information, away=0.0 * rows.away).normal()  # the others are what is known
        chi2 = normal.chi2 - float(normal.side @ normal.step())
        each.append(_held_out(held, fitted.at, fitted.inverse, chi2, rows.residual.size))
    order = np.argsort(np.concatenate(passes))
    residual, covariance, y = (np.concatenate(part)[order] for part in list(zip(*each, strict=True))[:3])
    return HeldOut(residual, covariance, y, sum(one.chi2 for one in each), 3 * len(seen))


def _held_out(sphere: Sphere, at: Estimate, spread: Float, chi2: float, freedom: int) -> HeldOut:
    """By an estimate, the first of whose unknowns have this covariance."""
    rows = sphere.rows(at)
    change = rows.jacobian[..., : len(spread)]
    covariance = rows.covariance + change @ spread @ change.mT
    return HeldOut(rows.residual, covariance, sphere.shown(at)[:, 1], chi2, freedom)


def second_recording(
    calibration: Calibration, estimate: Estimate, seen: Observations, noise: Noise, source: str
) -> HeldOut:
    """A second recording: where its sphere stood is fitted with the calibration's hand-eye pose."""
    if len(seen) < 2:
        raise InputError(f"{source}: /robot", f"expected at least 2 postures to validate on, found {len(seen)}")
    known = estimate, estimator.inverse_information(calibration.covariance)
    found = estimator.fit(Sphere(seen, noise, known=known), start_center(estimate, seen, noise))
    ball = replace(estimate, center_mm=found.at.center_mm, radius_mm=found.at.radius_mm)
    return _held_out(Sphere(seen, noise), ball, calibration.covariance, found.chi2, found.freedom)


NEAR_EQUATOR = 0.1  # |y| over the largest, below which w says nothing of y


@stage("calibrate.validate")
def validate(
    calibration: Calibration,
    profiles: SphereProfiles,
    recording: Recording,
) -> tuple[Validation, Document]:
    """Measure the calibration's error on held-out postures: predicted against measured sphere centres.

    Each posture, or scan, is predicted from a fit of the others; in a second recording only the sphere's place is
    fitted.

    Args:
        calibration: what to validate.
        profiles: circles of the recording to validate on.
        recording: the calibration's own, or a second one.

    Raises:
        InputError: too few postures to hold any out.

    Example:
        >>> from workbench import scan
        >>> from workbench.plugins import calibration
        >>> ball = scan.read(recording="data/synthetic/sphere.h5")
        >>> arcs = calibration.circles(ball)
        >>> pose, found, document = calibration.hand_eye(arcs, ball)
        >>> held_out, document = calibration.validate(found, arcs, ball)
        >>> held_out.error_mm.shape
        (12, 3)
    """
    estimate, seen = estimate_of(calibration), seen_again(calibration, profiles, recording)
    noise = replace(calibration.noise, radius_mm=profiles.sphere_diameter_mm / 2)
    if recording.source == calibration.hand_eye.source:
        seen = seen.subset(calibration.used)
        how, held = "each posture predicted from the others", each_held_out(estimate, seen, noise, recording.source)
    else:
        how = f"a second recording, {recording.source}"
        held = second_recording(calibration, estimate, seen, noise, recording.source)
    y = np.where(np.abs(held.y_mm) > NEAR_EQUATOR * np.abs(held.y_mm).max(), held.y_mm, np.nan)
    change = by_circle(y)  # to mm along the profiler's axes; w tells y where the centre is off the plane
    error = np.einsum("kij,kj->ki", change, np.nan_to_num(held.residual))
    variance = np.einsum("kij,kjl,kil->ki", change, held.covariance, change)
    error[np.isnan(y), 1] = np.nan
    found = Validation(
        how=how,
        frames=seen.frames,
        error_mm=frozen(error),
        u_mm=frozen(np.sqrt(variance)),
        rms_mm=rms_mm(error[:, ::2]),
        expected_mm=np.sqrt(np.mean(np.sum(variance[:, ::2], axis=1))),
        misfit=held.chi2 / held.freedom,
        freedom=held.freedom,
    )
    rows = [
        {"frames": list(frames), "error_mm": error, "u_mm": u}
        for frames, error, u in zip(found.frames, found.error_mm, found.u_mm, strict=True)
    ]
    names = ("how", "rms_mm", "expected_mm", "misfit", "freedom")
    content = {"part": asdict(recording.part), **{name: getattr(found, name) for name in names}, "postures": rows}
    return found, result_file("calibration_validation.json", content)
