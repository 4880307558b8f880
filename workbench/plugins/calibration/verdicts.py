"""What a calibration says about itself: misfit, postures rejected, warnings."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from workbench.api import (
    DEG,
    Bool,
    Document,
    Float,
    HandEye,
    Part,
    Recording,
    estimator,
    frozen,
    pieces,
    pose_from,
    result_file,
    rpy_from_rotation,
)
from workbench.plugins.calibration.circles_stage import fit_arc
from workbench.plugins.calibration.model import Estimate, Linear, Noise, View, place_u, view_of_points, volume_u
from workbench.plugins.calibration.observations import Observations, by_pass
from workbench.plugins.calibration.solve import Answer
from workbench.plugins.calibration.tables import enough
from workbench.plugins.calibration.values import Method, Rejected, SphereProfiles

AXES = ("x", "z")
STEP = 1e-3  # relative, for differences


@dataclass(frozen=True)
class Sensor:
    """What is taken out of a profiler's x and z: errors of scale (2,), about the place (2,) mm that stays.

    Scales about the middle of the view and about the sensor's origin differ by a shift, which is the pose's.
    """

    error: Float
    middle_mm: Float

    def true(self, recording: Recording) -> tuple[Float, Float]:
        """x and z (N, M) of a recording, mm."""
        x, z = (
            middle + (measured.astype(float) - middle) / (1.0 + error)
            for measured, middle, error in zip(
                (recording.x_mm, recording.z_mm), self.middle_mm, self.error, strict=True
            )
        )
        return x, z

    def more(self, axis: int) -> Sensor:
        """The same with a little more error of one axis."""
        return replace(self, error=self.error + STEP * np.eye(2)[axis])


def view_of(profiles: SphereProfiles, recording: Recording, sensor: Sensor | None = None) -> View:
    """The field in which the points of frames with circles lie, by what `sensor` takes out of them, and the circles."""
    x, z = (recording.x_mm, recording.z_mm) if sensor is None else sensor.true(recording)
    return view_of_points(x[profiles.frame], z[profiles.frame], profiles.circle)


def sensor_of(hand_eye: HandEye) -> Sensor:
    """What its calibration took out."""
    return Sensor(np.array(hand_eye.sensor_scale) - 1.0, np.array(hand_eye.sensor_middle_mm))


def rescaled(profiles: SphereProfiles, recording: Recording, sensor: Sensor) -> SphereProfiles:
    """The circles through the same points with the scales' errors taken out."""
    if not sensor.error.any():
        return profiles
    both, sense = ((recording.x_mm, recording.z_mm), sensor.true(recording)), float(profiles.sense)
    circle, covariance = profiles.circle.copy(), profiles.covariance.copy()
    for k, frame in enumerate(profiles.frame):
        on = profiles.on_arc[frame]
        points = ([part[frame, on].astype(float) for part in xz] for xz in both)
        (old, before, *_), (new, after, _, fitted) = (
            fit_arc(x, z, circle[k], sense, profiles.noise_mm) for x, z in points
        )
        if fitted:
            circle[k] += new - old
            covariance[k] = after * (covariance[k, 1, 1] / before[1, 1])
    return replace(profiles, circle=circle, covariance=covariance)


def observed(profiles: SphereProfiles, recording: Recording, sensor: Sensor) -> Observations:
    """Circles from which a sensor's errors are taken out, joined with the poses; and what these errors change.

    A scaled sphere is no sphere: its circle's centre moves with its place in the view, its arc bends otherwise.
    """
    here, *more = (
        by_pass(rescaled(profiles, recording, one), recording) for one in (sensor, sensor.more(0), sensor.more(1))
    )
    change = np.stack([(one.circle - here.circle) / STEP for one in more], axis=2)
    return replace(here, by_scale=change, scale=sensor.error)


def hand_eye_of(estimate: Estimate, covariance: Float, view: View, recording: Recording, sensor: Sensor) -> HandEye:
    """A hand-eye pose as other stages take it, with its covariance (6, 6) and what is taken out of the sensor."""
    (x, z), (middle_x, middle_z) = sensor.error, sensor.middle_mm
    return HandEye(
        frozen(pose_from(estimate.rotation, estimate.translation_mm)),
        frozen(covariance),
        recording.source,
        recording.part.recorded_at,
        volume_u(covariance, estimate.rotation, view),
        (1.0 + x, 1.0 + z),
        (middle_x, middle_z),
    )


def serves(
    covariance: Float,
    rotation: Float,
    view: View,
    bevel_deg: float,
    tolerances: tuple[float, float],
    words: tuple[str, str],
) -> tuple[bool, str]:
    """Whether a hand-eye pose serves a bevel, and the sentence that says so: of its covariance (6, 6) over the view.

    tolerances: of the root face (mm) and of the bevel angle (deg); words: what it is, and what to do else.
    """
    turn_u_deg = math.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1]) / DEG
    return enough(
        place_u(covariance, rotation, view), bevel_deg, tolerances[0], *words, turn=(turn_u_deg, tolerances[1])
    )


def hand_eye_file(
    eye: HandEye, part: Part, verdict: tuple[bool, str], rejected: Iterable[Rejected], more: dict[str, Any]
) -> Document:
    """`handeye.json`, which inspection and planning read by their input `hand_eye`; `more`: what else was found."""
    pose = eye.flange_from_profiler
    content = {
        "part": asdict(part),
        "flange_from_profiler": pose,
        "translation_mm": pose[:3, 3],
        "rotation_rpy_deg": [angle / DEG for angle in rpy_from_rotation(pose[:3, :3])],
        "covariance": eye.covariance,
        "volume_u_mm": eye.volume_u_mm,
        "sensor_scale": eye.sensor_scale,
        "sensor_middle_mm": eye.sensor_middle_mm,
        **dict.fromkeys(("sphere_center_mm", "sphere_diameter_mm", "time_offset_s", "time_offset_u_s")),
        **more,
        "frames_rejected": [{"frame": one.frame, "cause": one.cause} for one in rejected],
        "good_enough": verdict[0],
        "verdict": verdict[1],
    }
    return result_file("handeye.json", content)


def directions_html(directions: Iterable[tuple[str, float]]) -> str:
    """Principal directions of the uncertainty, in words and mm, as a table."""
    head = ("Direction, least certain first", "u over the field of view, mm")
    return pieces.table_html(head, [(words, f"{u:.3f}") for words, u in directions])


def pose_facts(eye: HandEye, clock_s: tuple[float, float] | None) -> list[tuple[str, str]]:
    """Names and values for the report, each with its u; `clock_s`: the clock's offset and its u, where it was found."""
    pose, u = eye.flange_from_profiler, estimator.standard_u(np.asarray(eye.covariance))
    place = ", ".join(f"{v:.3f} ± {s:.3f}" for v, s in zip(pose[:3, 3], u[:3], strict=True))
    facts = [
        ("Predicted RMS error of a point over the field of view", f"{eye.volume_u_mm:.3f} mm"),
        ("Translation tx, ty, tz", f"{place} mm"),
        ("Rotation roll, pitch, yaw", ", ".join(f"{a / DEG:.3f}°" for a in rpy_from_rotation(pose[:3, :3]))),
        ("u of the rotation about the flange's axes", ", ".join(f"{s / DEG:.4f}°" for s in u[3:])),
    ]
    if clock_s is not None:
        offset, offset_u = clock_s
        facts.append(("Profiler's clock ahead of the robot's", f"{1e3 * offset:.2f} ± {1e3 * offset_u:.2f} ms"))
    return facts


FEW = 6  # postures below which hardly anything checks the answer
NOISY = 2.0  # over the stated noise of the profile's points


def rejections(
    profiles: SphereProfiles, used: Bool, seen: Observations, linear: Linear, off: Float
) -> tuple[Rejected, ...]:
    """Frames that do not count: without an arc, repeats that contradict, gross postures."""
    gross = [
        Rejected(
            frame,
            f"gross pose: the sphere is off by {r[0]:+.2f} mm in x and {r[1]:+.2f} mm in z, "
            f"{distance:.0f} standard deviations in all",
        )
        for frames, good, r, distance in zip(seen.frames, used, linear.residual, off, strict=True)
        if not good
        for frame in frames
    ]
    return tuple(sorted([*profiles.rejected, *seen.rejected, *gross], key=lambda one: one.frame))


def warnings(
    answer: Answer,
    scale_u: Float,
    profiles: SphereProfiles,
    stated: Noise,
    systematic_mm: float | None,
    method: Method,
) -> tuple[str, ...]:
    """Warnings in plain words; empty when all is well."""
    said, found = [], answer.found
    gross = [frames for frames, good in zip(answer.seen.frames, found.used, strict=True) if not good]
    count = len(found.used) - len(gross)
    if gross:
        which = ", ".join([str(frame) for frames in gross for frame in frames][:12])
        said.append(f"{len(gross)} of {len(found.used)} postures rejected as gross (frames {which})")
    if found.misfit:
        fit, but = answer.stated, "robot_error 'correlated' allows for errors that near postures share"
        if systematic_mm is not None:
            but = f"systematic errors of {systematic_mm:.2f} mm an axis are allowed for"
        said.append(
            f"misfit that repeatability cannot explain: chi-square {fit.chi2:.0f} on {fit.freedom} degrees of "
            f"freedom; the residuals ask for pose errors of {found.noise.pose_mm:.2f} mm an axis, stated are "
            f"{stated.pose_mm:g} mm: a systematic robot error, a sphere that moved, or a wrong noise; {but}"
        )
    for k, (axis, error, u) in enumerate(zip(AXES, found.estimate.scale, scale_u, strict=True), 1):
        if k in answer.free:
            size = f"{abs(100 * error):.1f} ± {100 * u:.1f} % too {'long' if error > 0 else 'short'}"
            said.append(
                f"the profiler's {axis} is {size}: taken out here, and of scans that use this calibration; check the "
                "sensor's scale in that axis"
            )
    if count < FEW:
        said.append(
            f"only {count} postures: {answer.stated.freedom} more measured values than unknowns, so a wrong pose "
            "or profile may pass unnoticed; take nine or more"
        )
    if 0 in answer.free:
        diameter_mm, stated_mm = 2 * found.estimate.radius_mm, profiles.sphere_diameter_mm
        said.append(f"the sphere's diameter is {diameter_mm:.3f} mm by the data, stated {stated_mm:.3f} mm: set free")
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
