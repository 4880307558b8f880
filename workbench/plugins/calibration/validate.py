"""`calibrate.validate`: how well the calibration predicts postures that it was not made from."""

from __future__ import annotations

import json
import math
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.api import Document, Float, Recording, frozen, stage
from workbench.plugins.calibration.held_out import HeldOut, by_folds, second_recording
from workbench.plugins.calibration.model import Noise
from workbench.plugins.calibration.observations import Observations, by_pass
from workbench.plugins.calibration.plan import estimate_of
from workbench.plugins.calibration.scales import rescaled, sensor_of
from workbench.plugins.calibration.values import Calibration, SphereProfiles, Validation

NEAR_EQUATOR = 0.1  # |y| over the largest, below which w says nothing of y


@stage("calibrate.validate")
def validate(
    calibration: Calibration,
    profiles: SphereProfiles,
    recording: Recording,
    *,
    folds: Annotated[
        int, Field(ge=0, le=100, description="number of parts that are held out in turn; 0: each posture by itself")
    ] = 0,
    pose_noise_mm: Annotated[float, Field(gt=0, le=5, description="as in calibrate.hand_eye")] = 0.07,
    pose_noise_deg: Annotated[float, Field(ge=0, le=1, description="as in calibrate.hand_eye")] = 0.01,
    sphere_radius_u_mm: Annotated[float, Field(gt=0, le=5, description="as in calibrate.hand_eye")] = 0.05,
) -> tuple[Validation, Document]:
    """Measure the calibration's error on held-out postures: predicted against measured sphere centres.

    Of the calibration's own recording, postures are left out part by part and predicted from a fit of the others. Of
    a second recording, only where its sphere stood is fitted; the hand-eye pose is the calibration's. The spread of
    fitted centres is not used anywhere: it is small along just the directions that nothing determines.

    Args:
        calibration: what to validate.
        profiles: circles of the recording to validate on.
        recording: the calibration's own, or a second one.
        folds: in how many parts the calibration's own recording is held out.
        pose_noise_mm: the robot's repeatability in position, each axis.
        pose_noise_deg: the same in orientation.
        sphere_radius_u_mm: how well the sphere's radius is known.

    Raises:
        InputError: too few postures to hold any out.
    """
    noise = Noise(pose_noise_mm, pose_noise_deg, profiles.sphere_diameter_mm / 2, sphere_radius_u_mm)
    estimate = estimate_of(calibration)
    seen = by_pass(rescaled(profiles, recording, sensor_of(calibration)), recording).place(estimate.offset_s)
    if recording.source == calibration.hand_eye.source:
        seen = seen.subset(calibration.used)
        how, held = by_folds(estimate, seen, noise, folds, recording.source)
    else:
        how = f"a second recording, {recording.source}"
        held = second_recording(calibration, estimate, seen, noise, recording.source)
    found = _validation(how, seen, held)
    return found, _document(found)


def _validation(how: str, seen: Observations, held: HeldOut) -> Validation:
    """In mm along the profiler's axes; w tells y where the centre is off the plane."""
    y = np.where(np.abs(held.y_mm) > NEAR_EQUATOR * np.abs(held.y_mm).max(), held.y_mm, np.nan)
    change = np.zeros((len(y), 3, 3))
    change[:, 0, 0] = change[:, 2, 1] = 1.0
    change[:, 1, 2] = -1 / (2 * y)
    error = np.einsum("kij,kj->ki", change, np.nan_to_num(held.residual))
    variance = np.einsum("kij,kjl,kil->ki", change, held.covariance, change)
    error[np.isnan(y), 1] = np.nan
    return Validation(
        how=how,
        frames=seen.frames,
        error_mm=frozen(error),
        u_mm=frozen(np.sqrt(variance)),
        rms_mm=float(np.sqrt(np.mean(np.sum(error[:, ::2] ** 2, axis=1)))),
        expected_mm=float(np.sqrt(np.mean(np.sum(variance[:, ::2], axis=1)))),
        misfit=held.chi2 / held.freedom,
        freedom=held.freedom,
    )


def _document(found: Validation) -> Document:
    """`calibration_validation.json`: strict JSON."""
    rows = [
        {"frames": list(frames), "error_mm": _plain(error), "u_mm": _plain(u)}
        for frames, error, u in zip(found.frames, found.error_mm, found.u_mm, strict=True)
    ]
    content = {
        "how": found.how,
        "rms_mm": found.rms_mm,
        "expected_mm": found.expected_mm,
        "misfit": found.misfit,
        "freedom": found.freedom,
        "postures": rows,
    }
    return Document("calibration_validation.json", (json.dumps(content, allow_nan=False, indent=1) + "\n").encode())


def _plain(values: Float) -> list[float | None]:
    return [float(v) if math.isfinite(v) else None for v in values]
