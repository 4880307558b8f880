"""`handeye.json` (INTERFACES section 4; docs/pipelines.md): strict JSON, mm, s, degrees only where the name says so."""

from __future__ import annotations

from dataclasses import asdict

from workbench.api import DEG, Document, HandEyeFile, rpy_from_rotation
from workbench.plugins.calibration.values import Calibration


def hand_eye_document(found: Calibration) -> Document:
    """The calibration as the file that inspection and planning read by their input `hand_eye`."""
    pose = found.hand_eye.flange_from_profiler
    content = {
        "part": asdict(found.part),
        "flange_from_profiler": pose,
        "translation_mm": pose[:3, 3],
        "rotation_rpy_deg": [angle / DEG for angle in rpy_from_rotation(pose[:3, :3])],
        "covariance": found.covariance,
        "sensor_scale": found.hand_eye.sensor_scale,
        "sensor_middle_mm": found.hand_eye.sensor_middle_mm,
        "sensor_scale_u": found.sensor_scale_u,
        "sphere_center_mm": found.sphere_center_mm,
        "sphere_diameter_mm": 2 * found.sphere_radius_mm,
        "time_offset_s": found.time_offset_s,
        "time_offset_u_s": found.time_offset_u_s,
        "volume_u_mm": found.volume_u_mm,
        "residual_rms_mm": found.residual_rms_mm,
        "method": found.method,
        "frames_used": found.frames_used,
        "frames_rejected": [{"frame": one.frame, "cause": one.cause} for one in found.frames_rejected],
        "warnings": found.warnings,
    }
    return Document(HandEyeFile.NAME, HandEyeFile.written(content))
