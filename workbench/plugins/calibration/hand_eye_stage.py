"""`calibrate.hand_eye`: the profiler's pose on the flange, from the circles of a fixed sphere in many postures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from workbench.api import (
    Document,
    Float,
    HandEye,
    InputError,
    InputFile,
    Recording,
    Seed,
    certified_length,
    estimator,
    frozen,
    pose_from,
    stage,
)
from workbench.plugins.calibration import methods
from workbench.plugins.calibration.determinacy import Demand, directions
from workbench.plugins.calibration.model import (
    SIZE,
    Estimate,
    Noise,
    Sphere,
    View,
    by_circle,
    linearise,
    signed_centres,
    to_base,
    volume_u,
)
from workbench.plugins.calibration.observations import Timed
from workbench.plugins.calibration.shared_errors import Settled, correlated, settled
from workbench.plugins.calibration.solve import Answer, check_determined, solve
from workbench.plugins.calibration.suspicions import pose_warnings
from workbench.plugins.calibration.tables import LENGTHS, LONGER, not_included
from workbench.plugins.calibration.values import Calibration, Method, SphereProfiles
from workbench.plugins.calibration.verdicts import (
    Sensor,
    hand_eye_file,
    hand_eye_of,
    observed,
    rejections,
    rescaled,
    serves,
    view_of,
    warnings,
)
from workbench.plugins.ranges import BevelDeg, BevelToleranceDeg, NoiseDeg, NoiseMm, SensorScaleU, ToleranceMm

ROUNDS, SMALL = 4, 0.003  # of circles by the sensor's scales; change of these in which circles move evenly
SAME_SPHERE = 0.02  # share of its diameter by which a certificate may differ from what a recording states
NEAR_EQUATOR_MM = 0.3  # a smaller h is taken for that when its uncertainty is asked


@stage("calibrate.hand_eye")
def hand_eye(
    profiles: SphereProfiles,
    recording: Recording,
    *,
    method: Method = "bundle",
    pose_noise_mm: NoiseMm = 0.07,
    pose_noise_deg: NoiseDeg = 0.01,
    sphere_radius_u_mm: NoiseMm = 0.05,
    sphere_certificate: InputFile | None = None,
    sensor_scale_u: SensorScaleU = 0.003,
    robot_error: Literal["independent", "correlated"] = "independent",
    max_u_mm: ToleranceMm = 0.75,
    root_tolerance_mm: ToleranceMm = 0.5,
    bevel_tolerance_deg: BevelToleranceDeg = 1.0,
    bevel_deg: BevelDeg = 40.0,
    seed: Seed = 0,
) -> tuple[HandEye, Calibration, Document]:
    """Find the profiler's pose on the flange from a fixed sphere (the paper's section 3; equations (1) to (3)).

    Maximum likelihood on (x_c, z_c, w = r^2) (docs/calibration.md). Scans over the sphere also give the offset of a
    profiler's own clock.

    Args:
        profiles: circles from `calibrate.circles`.
        recording: flange poses; /hand_eye, if there, is the design's pose to begin with, off by up to 20 deg and 50 mm.
        method: 'bundle': maximum likelihood; the paper's, for comparison: 'analytic' (Kabsch on pairs of pure
            translation), 'genetic'.
        pose_noise_mm: repeatability of the robot: standard deviation of a flange position, each axis.
        pose_noise_deg: the same of its orientation.
        sphere_radius_u_mm: standard uncertainty of the sphere's stated radius; free where the data contradict it.
        sphere_certificate: the sphere's DCC (PTB's XML), whose diameter and uncertainty replace those stated; null:
            none.
        sensor_scale_u: standard uncertainty of the profiler's x and z, as a share; free where the data contradict it.
        robot_error: 'independent' between postures, or 'correlated': near postures share systematic errors, estimated
            from the data.
        max_u_mm: largest accepted u over the field of view, as predicted.
        root_tolerance_mm: of a bevel planned by the pose; the verdict says whether it serves.
        bevel_tolerance_deg: likewise.
        bevel_deg: angle of that bevel.
        seed: of the genetic algorithm.

    Raises:
        InputError: too few postures, an undetermined direction (named), two answers that fit equally, none that fits; a
            certificate that cannot be read, or of another sphere.

    Example:
        >>> from workbench import scan
        >>> from workbench.plugins import calibration
        >>> ball = scan.read(recording="data/synthetic/sphere.h5")
        >>> arcs = calibration.circles(ball)
        >>> pose, *rest = calibration.hand_eye(arcs, ball)
        >>> pose.flange_from_profiler.shape
        (4, 4)
    """
    unused: tuple[str, ...] = ()
    if sphere_certificate is not None:
        profiles, sphere_radius_u_mm, unused = _certified(profiles, sphere_certificate)
    noise = Noise(pose_noise_mm, pose_noise_deg, profiles.sphere_diameter_mm / 2, sphere_radius_u_mm)
    where = f"{recording.source}: /robot"
    answer, view, sensor = _solved(profiles, recording, noise, where, max_u_mm)
    x_u, z_u = answer.sphere.noise.scale_u
    wide = replace(answer.sphere.noise, scale_u=(max(x_u, sensor_scale_u), max(z_u, sensor_scale_u)))
    # scales that are held stay as stated, and scans that are read by them too: the pose makes up for their errors
    scaled = answer.sphere.noisy(wide)
    fitted = estimator.fit(scaled, answer.found.estimate, answer.found.used)
    found, systematic_mm = replace(answer.found, covariance=settled(fitted, scaled).covariance), None
    if robot_error == "correlated" and answer.seen.here.scans:
        raise InputError(where, "robot_error 'correlated' is for postures held still, found scans over the sphere")
    if robot_error == "correlated":
        found, systematic_mm = correlated(found, answer.seen, wide)
    if method != "bundle":
        found = _by_method(method, answer, recording.flange_from_profiler, seed, where)
    answer = replace(answer, found=found)
    check_determined(answer, Demand(view, max_u_mm, where), recording.flange_from_profiler)
    verdict = serves(
        found.covariance[:6, :6],
        found.estimate.rotation,
        view,
        bevel_deg,
        (root_tolerance_mm, bevel_tolerance_deg),
        ("the hand-eye pose", "add postures, first those of calibration_plan.csv"),
    )
    calibration = _calibration(method, (answer, view, sensor), profiles, recording, noise, systematic_mm, verdict)
    far = pose_warnings(found.estimate, recording.flange_from_profiler)
    left = _not_included(fitted, answer, view, calibration.volume_u_mm)
    calibration = replace(calibration, warnings=(*calibration.warnings, *far, *unused), not_included=left)
    names = ("sensor_scale_u", "sphere_center_mm", "time_offset_s", "time_offset_u_s", "residual_rms_mm", "method")
    more = {name: getattr(calibration, name) for name in (*names, "frames_used", "warnings", "not_included")}
    more["sphere_diameter_mm"] = 2.0 * calibration.sphere_radius_mm
    file = hand_eye_file(calibration.hand_eye, recording.part, verdict, calibration.frames_rejected, more)
    return calibration.hand_eye, calibration, file


def _not_included(found: estimator.Fit[Estimate], answer: Answer, view: View, u_mm: float) -> tuple[str, ...]:
    """What a robot whose lengths are off changes: no sphere that stands at one place shows it."""
    seen, at = answer.seen, found.at
    by_pose = linearise(at, seen, answer.found.noise).by_pose[..., :3]
    moved = LENGTHS * np.einsum("kij,kj->ki", by_pose, seen.here.base_from_flange[:, :3, 3])

    def sized(change: Float) -> tuple[str, float]:
        size = volume_u(np.outer(change[:6], change[:6]), at.rotation, view)
        return f"points of the field by {size:.3f} mm (RMS)", size / u_mm

    return tuple(not_included(found, {LONGER: moved}, sized))


def _certified(profiles: SphereProfiles, certificate: Path) -> tuple[SphereProfiles, float, tuple[str, ...]]:
    """The circles with the certificate's diameter, the radius' standard uncertainty, mm, and what is left out."""
    found = certified_length(certificate, ("diameter", "durchmesser"))
    stated = profiles.sphere_diameter_mm
    if abs(found.value_mm / stated - 1.0) > SAME_SPHERE:
        said = f"certifies a diameter of {found.value_mm:g} mm, the recording states {stated:g} mm: another sphere?"
        raise InputError(str(certificate), said)
    return replace(profiles, sphere_diameter_mm=found.value_mm), found.u_mm / 2.0, found.left_out


def _solved(
    profiles: SphereProfiles, recording: Recording, noise: Noise, where: str, limit_mm: float
) -> tuple[Answer, View, Sensor]:
    """The answer, by circles found anew where the sensor's errors, which it has, are no longer small; and the view."""
    sensor = Sensor(np.zeros(2), np.array(view_of(profiles, recording).middle_mm))
    for _ in range(ROUNDS):
        seen = observed(profiles, recording, sensor)
        view = view_of(rescaled(profiles, recording, sensor), recording, sensor)
        design = recording.flange_from_profiler
        answer = solve(seen, noise, design, where=where, limit_mm=limit_mm, view=view, judged=False)
        free, before = [1 + k in answer.free for k in (0, 1)], sensor.error
        sensor = replace(sensor, error=np.where(free, answer.found.estimate.scale, 0.0))
        if np.abs(sensor.error - before).max() < SMALL:
            break
    return answer, view, sensor


def _by_method(method: Method, answer: Answer, design: Float | None, seed: int, where: str) -> Settled:
    """Another method's pose, on the postures and signs that the bundle found, with the errors that it propagates."""
    fit, seen = answer.found, answer.seen.subset(answer.found.used)
    linear = linearise(fit.estimate, seen, fit.noise)
    P = signed_centres(fit.estimate, linear, seen)
    poses = seen.here.base_from_flange
    centres = methods.Centres(P, poses[:, :3, :3], poses[:, :3, 3])
    begin = pose_from(fit.estimate.rotation, fit.estimate.translation_mm)
    rule: Callable[[methods.Centres], Float]
    if method == "analytic":
        rule, pose = methods.analytic, methods.analytic(centres, where)
    elif design is None:
        raise InputError(where, "method 'genetic' searches about the design's pose: /hand_eye is missing")
    else:
        rule, pose = partial(methods.two_step, begin), methods.genetic(design, centres, seed)
    h = linear.centre[:, 1]
    change = by_circle(np.copysign(np.maximum(np.abs(h), NEAR_EQUATOR_MM), h))
    spread = methods.propagated(rule, centres, change @ linear.covariance @ change.mT)
    estimate = replace(fit.estimate, rotation=pose[:3, :3], translation_mm=pose[:3, 3])
    center = to_base(P, estimate, seen).mean(axis=0)
    covariance = fit.covariance.copy()
    covariance[:6], covariance[:, :6] = 0.0, 0.0
    covariance[:6, :6] = spread
    return replace(fit, covariance=covariance, estimate=replace(estimate, center_mm=center))


def _calibration(
    method: Method,
    solved: tuple[Answer, View, Sensor],
    profiles: SphereProfiles,
    recording: Recording,
    stated: Noise,
    systematic_mm: float | None,
    verdict: tuple[bool, str],
) -> Calibration:
    answer, view, sensor = solved
    result, seen = answer.found, answer.seen
    estimate, noise, scale_u = result.estimate, result.noise, estimator.standard_u(result.covariance)[SIZE : SIZE + 2]
    with_offset = isinstance(answer.sphere.flange, Timed)
    linear = linearise(estimate, seen, noise)
    covariance = result.covariance[:6, :6]
    centre, before = signed_centres(estimate, linear, seen), estimate
    if (design := recording.flange_from_profiler) is not None:
        before = replace(estimate, rotation=design[:3, :3], translation_mm=design[:3, 3])
    used = [frame for frames, good in zip(seen.frames, result.used, strict=True) for frame in frames if good]
    off = estimator.distance(Sphere(seen, noise).rows(estimate), result.used, result.covariance[: SIZE + 2, : SIZE + 2])
    offset_u = np.sqrt(result.covariance[-1, -1]) if with_offset else None
    pairs = [(frame, k) for k in np.flatnonzero(result.used) for frame in seen.frames[k]]
    frame, k = np.array(pairs).T
    (x, z), (middle_x, y, middle_z) = sensor.true(recording), np.moveaxis(linear.centre[k, :, None], 1, 0)
    away = np.sqrt((x[frame] - middle_x) ** 2 + y**2 + (z[frame] - middle_z) ** 2)
    off_sphere = away[profiles.on_arc[frame]] - estimate.radius_mm
    return Calibration(
        part=recording.part,
        method=method,
        hand_eye=hand_eye_of(estimate, covariance, view, recording, sensor),
        sensor_scale_u=(scale_u[0], scale_u[1]),
        sphere_center_mm=estimate.center_mm,
        sphere_radius_mm=estimate.radius_mm,
        covariance=frozen(covariance),
        volume_u_mm=volume_u(covariance, estimate.rotation, view),
        directions=directions(covariance, estimate, view),
        noise=noise,
        view=view,
        time_offset_s=estimate.offset_s if with_offset else None,
        time_offset_u_s=offset_u,
        frames=seen.frames,
        centre_mm=centre,
        center_base_before_mm=to_base(centre * (np.nan if design is None else 1.0), before, seen),
        center_base_mm=to_base(centre, estimate, seen),
        residual=linear.residual,
        distance=off,
        used=result.used,
        residual_rms_mm=np.sqrt(np.mean(off_sphere**2)),
        misfit=answer.stated.chi2 / max(answer.stated.freedom, 1),
        systematic_mm=systematic_mm,
        frames_used=tuple(sorted(used)),
        frames_rejected=rejections(profiles, result.used, seen, linear, off),
        good_enough=verdict[0],
        verdict=verdict[1],
        warnings=warnings(answer, scale_u, profiles, stated, systematic_mm, method),
    )
