"""`calibrate.robot`: the robot's joint offsets and lengths beside the hand-eye pose, from a sphere in many postures."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from workbench.api import (
    DEG,
    Chapter,
    Document,
    Float,
    HandEye,
    InputError,
    InputFile,
    Recording,
    Shaped,
    estimator,
    inverse,
    stage,
    vector_from_rotation,
)
from workbench.plugins.calibration.arm_errors import (
    NO_ERRORS,
    ArmErrors,
    arm_errors,
    chain_of,
    erring_flange,
    robot_results,
)
from workbench.plugins.calibration.determinacy import Demand, cause_of, too_open
from workbench.plugins.calibration.model import (
    SIZE,
    Estimate,
    Noise,
    View,
    carried,
    linearise,
    rows_of,
    volume_u,
    volume_weight,
)
from workbench.plugins.calibration.observations import Observations, by_pass
from workbench.plugins.calibration.solve import solve
from workbench.plugins.calibration.tables import JOINTS, enough, fit_fields, fit_words, noisy, rms_mm
from workbench.plugins.calibration.values import Rejected, SphereProfiles
from workbench.plugins.calibration.verdicts import Sensor, hand_eye_file, hand_eye_of, serves, view_of
from workbench.plugins.csv_table import Table
from workbench.plugins.ranges import BevelDeg, BevelToleranceDeg, Deviation, LengthMm, NoiseDeg, NoiseMm, ToleranceMm

if TYPE_CHECKING:
    from workbench.api import Chain

LEAST_POSTURES = 30  # for some fifteen parameters beside the ten of the sphere and the hand-eye pose
SAME_MM, SAME_RAD = 1.0, 0.1 * DEG  # by which a recorded pose may differ from the cell's model at its joint angles
COARSER = (16.0, 4.0, 1.0)  # the robot's noise in turn: its errors as built are larger, and the first steps long
MOST_MISFIT = 25.0  # residuals of five times the noise: it is no such robot, or a wrong side of the laser plane
CORRECTED = "for a controller into which the joint offsets and lengths of robot.json are entered, and for no other"
BUILT_MM = 5.0  # limit of the start's uncertainty, with the robot as built: it only starts


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """Hand-eye pose and sphere, as in `model`, and the errors of the arm."""

    estimate: Estimate
    errors: Shaped[Float, " P"]


class Posed:
    """Circles of a sphere from a flange that errs as its arm does: unknown are those of `model`, then the errors."""

    def __init__(self, seen: Observations, joints: Float, noise: Noise, chain: Chain, arm: ArmErrors) -> None:
        self.seen, self.joints, self.noise, self.chain, self.arm = seen, joints, noise, chain, arm
        self.back = inverse(erring_flange(chain, NO_ERRORS, np.zeros(0), joints)[0])

    def rows(self, at: Together) -> estimator.Rows:
        """The recorded poses are moved by what the errors move the flange by."""
        flange, by_errors = erring_flange(self.chain, self.arm, at.errors, self.joints)
        poses = self.seen.here.base_from_flange @ self.back @ flange
        moved = replace(self.seen, flange=replace(self.seen.here, base_from_flange=poses))
        linear = linearise(at.estimate, moved, self.noise)
        ball = rows_of(linear, moved, self.noise, at.estimate)
        return ball.beside(linear.by_pose @ by_errors, at.errors, self.arm.prior)

    def moved(self, at: Together, step: Float) -> Together:
        """Steps in the order of the unknowns."""
        return Together(at.estimate.moved(step[:SIZE]), at.errors + step[SIZE:])


@stage("calibrate.robot")
def robot(
    profiles: SphereProfiles,
    recording: Recording,
    *,
    cell: InputFile,
    joints: InputFile,
    pose_noise_mm: NoiseMm = 0.07,
    pose_noise_deg: NoiseDeg = 0.01,
    sphere_radius_u_mm: NoiseMm = 0.05,
    offset_prior_deg: Deviation = 0.3,
    length_prior_mm: LengthMm = 1.0,
    tilt_prior_deg: NoiseDeg = 0.02,
    max_u_mm: ToleranceMm = 2.0,
    root_tolerance_mm: ToleranceMm = 0.5,
    bevel_tolerance_deg: BevelToleranceDeg = 1.0,
    bevel_deg: BevelDeg = 40.0,
) -> tuple[HandEye, Document, Document, Chapter]:
    """Estimate the robot's joint offsets and lengths with the hand-eye pose, from a sphere.

    As `calibrate.hand_eye`, with the flange's pose from joint angles and the arm's errors (product of exponentials):
    docs/howto/calibrate_robot.md.

    Args:
        profiles: circles from `calibrate.circles`.
        recording: flange poses, all postures held still; the profiler's clock does not matter.
        cell: the cell file with the robot's URDF.
        joints: a CSV of each pass and its six joint angles in degrees (docs/howto/calibrate_robot.md).
        pose_noise_mm: as in `calibrate.hand_eye`.
        pose_noise_deg: as in `calibrate.hand_eye`.
        sphere_radius_u_mm: as in `calibrate.hand_eye`.
        offset_prior_deg: standard deviation of a joint's zero as built; 0: right, not estimated.
        length_prior_mm: of where an axis lies beside the one before; 0: right, not estimated.
        tilt_prior_deg: of an axis' direction; 0: right, not estimated.
        max_u_mm: largest accepted u of the hand-eye pose over the field of view, as predicted.
        root_tolerance_mm: as in `calibrate.hand_eye`.
        bevel_tolerance_deg: of its bevel angle; `handeye.json` says whether the hand-eye pose alone serves both.
        bevel_deg: as in `calibrate.hand_eye`.

    Raises:
        InputError: scans instead of postures, too few postures, angles of other poses, an undetermined direction.

    Example:
        >>> from workbench import scan
        >>> from workbench.plugins import calibration
        >>> ball = scan.read(recording="data/calibration/sphere_robot.h5")
        >>> arcs = calibration.circles(ball)
        >>> files = {"cell": "data/robot/cell.json", "joints": "data/calibration/sphere_joints.csv"}
        >>> pose, hand_eye, document, chapter = calibration.robot(arcs, ball, **files)
        >>> chapter.title, hand_eye.name, document.name
        ('Robot calibration', 'handeye.json', 'robot.json')
    """
    noise = Noise(pose_noise_mm, pose_noise_deg, profiles.sphere_diameter_mm / 2, sphere_radius_u_mm)
    where, chain = f"{recording.source}: /robot", chain_of(cell)
    assert chain is not None
    seen = _postures(profiles, recording, where)
    angles = read_joints(joints, seen, recording, chain)
    view = view_of(profiles, recording)
    start = solve(seen, noise, recording.flange_from_profiler, where=where, limit_mm=BUILT_MM, view=view).found.estimate
    arm = arm_errors(chain, offset_prior_deg * DEG, length_prior_mm, tilt_prior_deg * DEG)

    passes = tuple(int(recording.pass_index[frames[0]]) for frames in seen.frames)
    labels = estimator.Labels(where, passes, "pass", "did the sphere move, do joints and poses belong together?")
    begun = together(start, seen, angles, noise, chain, arm).at
    found, left_out = estimator.without_blunders(Posed(seen, angles, noise, chain, arm), begun, labels, lengths=2)
    if found.misfit > MOST_MISFIT:
        raise InputError(
            where,
            f"no joint offsets and lengths explain the postures: residuals are "
            f"{math.sqrt(found.misfit):.0f} times the stated noise; did the sphere move?",
        )
    kept, estimate, covariance = found.used, found.at.estimate, found.covariance
    used = seen.subset(kept)
    built = together(start, used, angles[kept], noise, chain, NO_ERRORS)
    centre = linearise(estimate, used, noise).centre
    demand, cause = Demand(view, max_u_mm, where), cause_of(used.here.base_from_flange, centre, False, "sphere")
    demand.refuse(too_open(covariance[:6, :6], estimate, demand, lambda: cause))
    u, rms = volume_u(covariance[:6, :6], estimate.rotation, view), rms_mm(found.rows.residual[kept, :2])
    slope = found.rows.jacobian[kept, :2]
    place_u2 = np.einsum("nij,jk,nik->ni", slope, covariance, slope).mean()
    seen_u = math.sqrt(place_u2 + rms**2 / 2.0)
    verdict = enough(seen_u, bevel_deg, root_tolerance_mm, "the profiler on the corrected robot", "add postures")
    warnings = tuple(left_out.values()) + noisy(found, "the sphere's places", "did it move, does the robot repeat?")
    both = as_flange_errors(chain, arm, found, angles[kept], view)
    hand_eye = hand_eye_of(estimate, both, view, recording, Sensor(np.zeros(2), np.zeros(2)))
    more = {
        "flange_from_profiler": hand_eye.flange_from_profiler,
        "hand_eye_covariance": covariance[:6, :6],
        "volume_u_mm": u,
        "u_mm": seen_u,
        "sphere_center_mm": estimate.center_mm,
        "sphere_diameter_mm": 2.0 * estimate.radius_mm,
        "residual_rms_as_built_mm": rms_mm(built.rows.residual[:, :2]),
        "residual_rms_mm": rms,
        "postures": len(used),
        **fit_fields(found, left_out, verdict, warnings, labels.name),
    }
    said = (
        f"The sphere's places lie {rms:.3f} mm RMS (x and z) from the model, {more['residual_rms_as_built_mm']:.3f} mm "
        f"with the robot as built. {fit_words(found)} A point over the field of view: "
        f"u = {hand_eye.volume_u_mm:.3f} mm of the hand-eye pose with these errors, {u:.3f} mm by itself."
    )
    document, chapter = robot_results(arm, found.at.errors, covariance[SIZE:, SIZE:], more, said, recording.part)
    serving = serves(
        both,
        estimate.rotation,
        view,
        bevel_deg,
        (root_tolerance_mm, bevel_tolerance_deg),
        ("the hand-eye pose, with the corrected robot,", "add postures"),
    )
    rejected = {one.frame: one.cause for one in profiles.rejected}
    rejected |= {frame: left_out[passes[k]] for k in np.flatnonzero(~kept) for frame in seen.frames[k]}
    how = f"beside {len(arm)} joint offsets and lengths: u = {seen_u:.3f} mm of a place with both (robot.json)"
    of_pose = {
        **{name: more[name] for name in ("sphere_center_mm", "sphere_diameter_mm", "residual_rms_mm")},
        "method": how,
        "frames_used": sorted(frame for frames in used.frames for frame in frames),
        "warnings": [*warnings, *([CORRECTED] if len(arm) else [])],
    }
    causes = [Rejected(*one) for one in sorted(rejected.items())]
    return hand_eye, hand_eye_file(hand_eye, recording.part, serving, causes, of_pose), document, chapter


def as_flange_errors(chain: Chain, arm: ArmErrors, found: estimator.Fit[Together], joints: Float, view: View) -> Float:
    """Covariance (6, 6) of the hand-eye pose together with what the arm's errors do to the flange in all postures.

    An error of the arm acts partly as another base, which scan and cut share, partly as another flange, which is as
    another hand-eye pose, and for the rest from posture to posture: least squares over the joint angles (n, 6), by
    what an error does over the field of view.
    """
    flange, by_error = erring_flange(chain, arm, found.at.errors, joints)
    to_own = flange[:, :3, :3].mT
    base = carried(to_own, flange[:, :3, 3])  # of the flange, by another base
    own = np.concatenate([to_own @ by_error[:, :3], by_error[:, 3:]], axis=1)
    as_pose = carried(np.eye(3), found.at.estimate.translation_mm)  # a flange that turns carries the profiler along
    weight = np.linalg.cholesky(volume_weight(found.at.estimate.rotation, view)).T
    rows = np.concatenate([np.broadcast_to(weight, (len(joints), 6, 6)), weight @ as_pose @ base], axis=2)
    seen = weight @ as_pose @ own
    parts = np.linalg.lstsq(rows.reshape(-1, 12), seen.reshape(-1, len(arm)), rcond=None)[0]
    both = np.concatenate([np.eye(6), parts[:6]], axis=1)
    of = np.r_[0:6, SIZE : SIZE + len(arm)]
    covariance = both @ found.covariance[np.ix_(of, of)] @ both.T
    return np.asarray((covariance + covariance.T) / 2.0)


def _postures(profiles: SphereProfiles, recording: Recording, where: str) -> Observations:
    seen = by_pass(profiles, recording)
    if seen.here.scans:
        raise InputError(where, "expected postures held still (one pose a pass), found scans over the sphere")
    if len(seen) < LEAST_POSTURES:
        raise InputError(
            where,
            f"expected {LEAST_POSTURES} postures or more that see the sphere, found {len(seen)}: "
            "joint offsets and lengths need them",
        )
    return seen


def read_joints(path: InputFile, seen: Observations, recording: Recording, chain: Chain) -> Float:
    """Joint angles (k, 6) of the observations, rad; held against the recorded poses."""
    table = Table(path, ("pass", *JOINTS), 1)
    number = [int(v) for v in table.numbers(("pass",))[:, 0]]
    angles = dict(zip(number, table.numbers(JOINTS) * DEG, strict=True))
    if len(angles) < len(number):
        raise InputError(str(path), "expected each pass once")
    wanted = [int(recording.pass_index[frames[0]]) for frames in seen.frames]
    missing = [one for one in wanted if one not in angles]
    if missing:
        raise InputError(str(path), f"expected the joint angles of pass {missing[0]}, which sees the sphere")
    found = np.array([angles[one] for one in wanted])
    apart = inverse(erring_flange(chain, NO_ERRORS, np.zeros(0), found)[0]) @ seen.here.base_from_flange
    shift = np.linalg.norm(apart[:, :3, 3], axis=1)
    turn = np.linalg.norm(vector_from_rotation(apart[:, :3, :3]), axis=1)
    worst = int(np.maximum(shift / SAME_MM, turn / SAME_RAD).argmax())
    if shift[worst] > SAME_MM or turn[worst] > SAME_RAD:
        raise InputError(
            str(path),
            f"pass {wanted[worst]}: by the cell's model these angles put the flange "
            f"{shift[worst]:.2f} mm and {turn[worst] / DEG:.2f} deg from the recorded pose: another "
            "robot, base, flange frame, or count of the angles?",
        )
    return found


def together(
    start: Estimate, seen: Observations, joints: Float, noise: Noise, chain: Chain, arm: ArmErrors
) -> estimator.Fit[Together]:
    """Hand-eye pose, sphere and errors of the arm, from `start` and the robot as built.

    Circles' sizes say nothing at first: a wrong side of the laser plane would stay.
    """
    by_place = seen.covariance.copy()
    by_place[:, 2, 2] += noise.radius_mm**4
    places, at = replace(seen, covariance=by_place), Together(start, np.zeros(len(arm)))
    for circles, coarser in ((places, COARSER[0]), *((seen, one) for one in COARSER)):
        found = estimator.fit(Posed(circles, joints, noise.times(coarser), chain, arm), at)
        at = found.at
    return found
