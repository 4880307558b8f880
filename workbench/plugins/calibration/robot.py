"""`calibrate.robot`: the robot's joint offsets and lengths beside the hand-eye pose, from a sphere in many postures."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from workbench.api import (
    DEG,
    Chapter,
    Document,
    Float,
    HandEye,
    HandEyeFile,
    InputError,
    InputFile,
    Int,
    Recording,
    RobotFile,
    Shaped,
    frozen,
    inverse,
    pose_from,
    rpy_from_rotation,
    stage,
    vector_from_rotation,
)
from workbench.plugins.calibration.arm_errors import (
    NO_ERRORS,
    ArmErrors,
    Priors,
    arm_document,
    arm_errors,
    arm_html,
    corrected,
    pose_derivatives,
)
from workbench.plugins.calibration.model import (
    SIZE,
    Estimate,
    Noise,
    View,
    cross_matrix,
    linearise,
    view_of_points,
    volume_u,
    volume_weight,
)
from workbench.plugins.calibration.observations import Observations, by_pass
from workbench.plugins.calibration.solve import Demand, check_determined, solve
from workbench.plugins.calibration.tables import JOINTS, Table, enough, noisy, studentised, without_gross
from workbench.plugins.calibration.tracker import chain_of, flange_poses, inverse_information
from workbench.plugins.calibration.values import SphereProfiles
from workbench.plugins.calibration.verdicts import serves

if TYPE_CHECKING:
    from workbench.api import Chain

LEAST_POSTURES = 30  # for some fifteen parameters beside the ten of the sphere and the hand-eye pose
SAME_MM, SAME_RAD = 1.0, 0.1 * DEG  # by which a recorded pose may differ from the cell's model at its joint angles
COARSER = (16.0, 4.0, 1.0)  # the robot's noise in turn: its errors as built are larger, and the first steps long
STEPS, CONVERGED = 30, 1e-8  # of a step's length in standard deviations, squared
MOST_MISFIT = 25.0  # residuals of five times the noise: it is no such robot, or a wrong side of the laser plane
CORRECTED = "for a controller into which the joint offsets and lengths of robot.json are entered, and for no other"
BUILT_MM = 5.0  # limit of the start's uncertainty, with the robot as built: it only starts


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """Hand-eye pose, sphere and errors of the arm, with the covariance of all: as in `model`, then the errors."""

    estimate: Estimate
    errors: Shaped[Float, " P"]
    covariance: Float  # (10 + P, 10 + P)
    residual: Shaped[Float, "k 3"]  # of x_c, z_c and w
    misfit: float
    freedom: int
    distance: Shaped[Float, " k"]
    place_u_mm: float  # of the sphere's place as predicted in these postures, RMS of x and z


@stage("calibrate.robot")
def robot(
    profiles: SphereProfiles,
    recording: Recording,
    *,
    cell: InputFile,
    joints: InputFile,
    pose_noise_mm: Annotated[float, Field(gt=0, le=5)] = 0.07,
    pose_noise_deg: Annotated[float, Field(ge=0, le=1)] = 0.01,
    sphere_radius_u_mm: Annotated[float, Field(gt=0, le=5)] = 0.05,
    offset_prior_deg: Annotated[float, Field(ge=0, le=5)] = 0.3,
    length_prior_mm: Annotated[float, Field(ge=0, le=20)] = 1.0,
    max_u_mm: Annotated[float, Field(gt=0, le=10)] = 2.0,
    root_tolerance_mm: Annotated[float, Field(gt=0, le=10)] = 0.5,
    bevel_tolerance_deg: Annotated[float, Field(gt=0, le=30)] = 1.0,
    bevel_deg: Annotated[float, Field(ge=10, le=75)] = 40.0,
) -> tuple[HandEye, Document, Document, Chapter]:
    """Estimate joint offsets and lengths of the robot beside the hand-eye pose, from a sphere in 30 postures or more.

    The model of `calibrate.hand_eye` with the flange's pose from the joint angles and the arm's errors (product of
    exponentials), otherwise as `calibrate.tracker`; a posture that all others contradict by 5 standard deviations is
    left out. `robot.json` and `handeye.json` belong to the corrected robot (docs/howto/calibrate_robot.md).

    Args:
        profiles: circles from `calibrate.circles`.
        recording: flange poses, all postures held still; the profiler's clock does not matter.
        cell: the cell file with the robot's URDF.
        joints: a CSV of each pass and its six joint angles in degrees, as the cell's model counts
            (docs/howto/calibrate_robot.md).
        pose_noise_mm: repeatability of a flange position, each axis.
        pose_noise_deg: of its orientation, each axis.
        sphere_radius_u_mm: standard uncertainty of the sphere's stated radius.
        offset_prior_deg: standard deviation of a joint's zero as built; 0: right, not estimated.
        length_prior_mm: of where an axis lies beside the one before; 0: right, not estimated.
        max_u_mm: largest predicted uncertainty of a hand-eye pose over the field of view; a larger one is refused, and
            the direction named.
        root_tolerance_mm: of the root face that robot and profiler must serve.
        bevel_tolerance_deg: of its bevel's angle, by the hand-eye pose alone; `handeye.json` says whether its pose
            serves both.
        bevel_deg: angle of the bevel that is measured.

    Raises:
        InputError: scans instead of postures, too few of them, angles that are not those of the recorded poses, an
            undetermined direction.

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
    shown = profiles.frame
    view = view_of_points(recording.x_mm[shown].astype(float), recording.z_mm[shown].astype(float), seen.circle)
    start = solve(seen, noise, recording.flange_from_profiler, where=where, limit_mm=BUILT_MM, view=view).fit.estimate
    arm = arm_errors(chain, Priors(offset_prior_deg * DEG, length_prior_mm))

    def fit(rows: Int, arm: ArmErrors = arm) -> Together:
        return together(start, seen.subset(np.isin(np.arange(len(seen)), rows)), angles[rows], noise, chain, arm)

    passes = tuple(int(recording.pass_index[frames[0]]) for frames in seen.frames)
    found, kept, left_out = without_gross(
        len(seen),
        fit,
        lambda one, row: _away_mm(one, seen, angles, row, noise, chain, arm),
        passes,
        where,
        "did the sphere move, do joints and poses belong together?",
        row_name="pass",
    )
    if found.misfit > MOST_MISFIT:
        raise InputError(
            where,
            f"no joint offsets and lengths explain the postures: residuals are "
            f"{math.sqrt(found.misfit):.0f} times the stated noise; did the sphere move?",
        )
    built = fit(kept, NO_ERRORS)
    used = seen.subset(np.isin(np.arange(len(seen)), kept))
    covariance = found.covariance[:6, :6]
    check_determined(covariance, found.estimate, used, noise, Demand(view, max_u_mm, where))
    u = volume_u(covariance, found.estimate.rotation, view)
    seen_u = math.hypot(found.place_u_mm, _rms(found) / math.sqrt(2.0))
    good, verdict = enough(seen_u, bevel_deg, root_tolerance_mm, "the profiler on the corrected robot", "add postures")
    warnings = tuple(left_out.values()) + noisy(found, "the sphere's places", "did it move, does the robot repeat?")
    pose = pose_from(found.estimate.rotation, found.estimate.translation_mm)
    document = arm_document(
        arm,
        found.errors,
        found.covariance[SIZE:, SIZE:],
        {
            "part": asdict(recording.part),
            "flange_from_profiler": pose,
            "hand_eye_covariance": covariance,
            "volume_u_mm": u,
            "u_mm": seen_u,
            "sphere_center_mm": found.estimate.center_mm,
            "sphere_diameter_mm": 2.0 * found.estimate.radius_mm,
            "residual_rms_as_built_mm": _rms(built),
            "residual_rms_mm": _rms(found),
            "misfit": found.misfit,
            "postures": len(kept),
            "left_out": [{"pass": number, "cause": cause} for number, cause in left_out.items()],
            "good_enough": good,
            "verdict": verdict,
            "warnings": warnings,
        },
    )
    both = as_flange_errors(chain, arm, found, angles[kept], view)
    together_u = volume_u(both, found.estimate.rotation, view)
    html = arm_html(
        document,
        f"The sphere's places lie {_rms(found):.3f} mm RMS (x and z) from the model, {_rms(built):.3f} mm with the "
        f"robot as built. Chi-square over degrees of freedom {found.misfit:.2f} on {found.freedom}. A point over the "
        f"field of view: u = {together_u:.3f} mm of the hand-eye pose with these errors, {u:.3f} mm by itself.",
    )
    hand_eye = HandEye(frozen(pose), frozen(both), recording.source, recording.part.recorded_at, together_u)
    pose_serves = serves(
        both,
        found.estimate.rotation,
        view,
        bevel_deg,
        (root_tolerance_mm, bevel_tolerance_deg),
        ("the hand-eye pose, with the corrected robot,", "add postures"),
    )
    return (
        hand_eye,
        _hand_eye_document(
            hand_eye, document, recording, profiles, used, _causes(seen, kept, passes, left_out), pose_serves
        ),
        Document(RobotFile.NAME, RobotFile.written(document)),
        Chapter(
            "Robot calibration",
            html,
            summary=verdict,
            part=recording.part,
            about="instruments",
            warnings=warnings + tuple(document["left_as_built"]),
        ),
    )


def as_flange_errors(chain: Chain, arm: ArmErrors, found: Together, joints: Float, view: View) -> Float:
    """Covariance (6, 6) of the hand-eye pose together with what the arm's errors do to the flange in all postures.

    An error of the arm acts partly as another base, which scan and cut share, partly as another flange, which is as
    another hand-eye pose, and for the rest from posture to posture: least squares over the joint angles (n, 6), by
    what an error does over the field of view.
    """
    now, more = corrected(chain, arm, found.errors)
    flange, by_error = flange_poses(now, joints), pose_derivatives(now, more, joints)
    to_own = np.swapaxes(flange[:, :3, :3], 1, 2)
    moves = np.concatenate([to_own, -to_own @ cross_matrix(flange[:, :3, 3])], axis=2)  # of the flange, by another base
    base = np.concatenate([moves, np.concatenate([np.zeros_like(to_own), to_own], axis=2)], axis=1)
    own = np.concatenate([to_own @ by_error[:, :3], by_error[:, 3:]], axis=1)
    as_pose = np.eye(6)  # a flange that turns carries the profiler along
    as_pose[:3, 3:] = -cross_matrix(found.estimate.translation_mm)
    weight = np.linalg.cholesky(volume_weight(found.estimate.rotation, view)).T
    rows = np.concatenate([np.broadcast_to(weight, (len(joints), 6, 6)), weight @ as_pose @ base], axis=2)
    seen = weight @ as_pose @ own
    parts = np.linalg.lstsq(rows.reshape(-1, 12), seen.reshape(-1, len(arm)), rcond=None)[0]
    both = np.concatenate([np.eye(6), parts[:6]], axis=1)
    of = np.r_[0:6, SIZE : SIZE + len(arm)]
    covariance = both @ found.covariance[np.ix_(of, of)] @ both.T
    return np.asarray((covariance + covariance.T) / 2.0)


def _causes(seen: Observations, kept: Int, passes: tuple[int, ...], left_out: dict[int, str]) -> dict[int, str]:
    """By frame of the recording, why its posture is left out."""
    rows = set(range(len(seen))) - set(kept.tolist())
    return {frame: left_out[passes[row]] for row in rows for frame in seen.frames[row]}


def _hand_eye_document(
    hand_eye: HandEye,
    robot_json: dict[str, Any],
    recording: Recording,
    profiles: SphereProfiles,
    used: Observations,
    causes: dict[int, str],
    verdict: tuple[bool, str],
) -> Document:
    """`handeye.json`: the pose that goes with the corrected robot, as planning and inspection read it."""
    pose = hand_eye.flange_from_profiler
    rejected = {one.frame: one.cause for one in profiles.rejected} | causes
    count, u = len(robot_json["parameters"]), robot_json["u_mm"]
    content = {
        "part": asdict(recording.part),
        "flange_from_profiler": pose,
        "translation_mm": pose[:3, 3],
        "rotation_rpy_deg": [angle / DEG for angle in rpy_from_rotation(pose[:3, :3])],
        "covariance": hand_eye.covariance,
        **{name: robot_json[name] for name in ("sphere_center_mm", "sphere_diameter_mm")},
        "volume_u_mm": hand_eye.volume_u_mm,
        "time_offset_s": None,
        "time_offset_u_s": None,
        "residual_rms_mm": robot_json["residual_rms_mm"],
        "method": f"beside {count} joint offsets and lengths: u = {u:.3f} mm of a place with both (robot.json)",
        "frames_used": sorted(frame for frames in used.frames for frame in frames),
        "frames_rejected": [{"frame": frame, "cause": cause} for frame, cause in sorted(rejected.items())],
        "good_enough": verdict[0],
        "verdict": verdict[1],
        "warnings": [*robot_json["warnings"], *([CORRECTED] if count else [])],
    }
    return Document(HandEyeFile.NAME, HandEyeFile.written(content))


def _postures(profiles: SphereProfiles, recording: Recording, where: str) -> Observations:
    seen = by_pass(profiles, recording).place()
    if seen.scans:
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
    apart = inverse(flange_poses(chain, found)) @ seen.base_from_flange
    shift = np.linalg.norm(apart[:, :3, 3], axis=1)
    turn = np.linalg.norm(vector_from_rotation(apart[:, :3, :3]), axis=1)
    worst = int(np.argmax(np.maximum(shift / SAME_MM, turn / SAME_RAD)))
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
) -> Together:
    """Hand-eye pose, sphere and errors of the arm, from `start` and the robot as built."""
    by_place = seen.covariance.copy()
    by_place[:, 2, 2] += (
        noise.radius_mm**4
    )  # circles' sizes say nothing yet: a wrong side of the laser plane would stay
    begun = _Fit(start, np.zeros(len(arm)), dataclasses.replace(seen, covariance=by_place), joints, noise, chain, arm)
    begun = begun.settled(_coarser(noise, COARSER[0]))
    found = _Fit(begun.estimate, begun.x, seen, joints, noise, chain, arm)
    for coarser in COARSER:
        found = found.settled(_coarser(noise, coarser))
    return found.result()


def _coarser(noise: Noise, factor: float) -> Noise:
    return dataclasses.replace(noise, pose_mm=factor * noise.pose_mm, pose_deg=factor * noise.pose_deg)


class _Fit:
    """Gauss-Newton about an estimate and errors x (P,), under one noise."""

    def __init__(
        self,
        estimate: Estimate,
        x: Float,
        seen: Observations,
        joints: Float,
        noise: Noise,
        chain: Chain,
        arm: ArmErrors,
    ) -> None:
        self._of = (seen, joints, chain, arm)
        self.estimate, self.x, self._noise = estimate, x, noise
        now, more = corrected(chain, arm, x)
        moved = inverse(flange_poses(chain, joints)) @ flange_poses(now, joints)
        linear = linearise(estimate, dataclasses.replace(seen, base_from_flange=seen.base_from_flange @ moved), noise)
        rows = np.concatenate([linear.jacobian, linear.by_pose @ pose_derivatives(now, more, joints)], axis=2)
        factor = np.linalg.cholesky(linear.covariance)
        self.residual, self._rows = linear.residual, rows
        self._white, self._right = (
            np.linalg.solve(factor, rows),
            np.linalg.solve(factor, linear.residual[..., None])[..., 0],
        )
        self._prior = np.zeros(SIZE + len(arm))
        self._prior[SIZE - 1], self._prior[SIZE:] = noise.radius_u_mm**-2, arm.prior**-2
        self._pull = np.concatenate([np.zeros(SIZE), -x])
        self._pull[SIZE - 1] = noise.radius_mm - estimate.radius_mm
        self.information = np.einsum("nij,nik->jk", self._white, self._white) + np.diag(self._prior)
        self.chi2 = float((self._right**2).sum() + (self._prior * self._pull**2).sum())

    def settled(self, noise: Noise) -> _Fit:
        """The fit under another noise; steps that make it worse are shortened."""
        now = self._at(self.estimate, self.x, noise)
        for _ in range(STEPS):
            side = np.einsum("nij,ni->j", now._white, now._right) + now._prior * now._pull
            step = inverse_information(now.information) @ side
            length = float(step @ now.information @ step)
            then = now
            for _ in range(6):
                then = now._at(now.estimate.moved(step[:SIZE]), now.x + step[SIZE:], noise)
                if then.chi2 < 1.5 * now.chi2 + 1.0:  # weights move with the estimate, so it may rise a little
                    break
                step = step / 3.0
            now = then
            if length < CONVERGED:
                break
        return now

    def _at(self, estimate: Estimate, x: Float, noise: Noise) -> _Fit:
        seen, joints, chain, arm = self._of
        return _Fit(estimate, x, seen, joints, noise, chain, arm)

    def result(self) -> Together:
        """The answer."""
        freedom = 3 * len(self._right) + 1 - SIZE
        misfit = self.chi2 / max(freedom, 1)
        covariance = inverse_information(self.information)
        distance = studentised(self._right, self._white, covariance)
        covariance = covariance * max(1.0, misfit)
        u = math.sqrt(float(np.einsum("nij,jk,nik->ni", self._rows, covariance, self._rows)[:, :2].mean()))
        return Together(self.estimate, self.x, covariance, self.residual, misfit, freedom, distance, u)


def _away_mm(
    found: Together, seen: Observations, joints: Float, row: int, noise: Noise, chain: Chain, arm: ArmErrors
) -> float:
    """How far the sphere of a posture lies, in x and z, from where a fit without it puts it."""
    one = seen.subset(np.arange(len(seen)) == row)
    q = joints[row : row + 1]
    now = flange_poses(corrected(chain, arm, found.errors)[0] if len(found.errors) else chain, q)
    one = dataclasses.replace(one, base_from_flange=one.base_from_flange @ inverse(flange_poses(chain, q)) @ now)
    return float(np.linalg.norm(linearise(found.estimate, one, noise).residual[0, :2]))


def _rms(found: Together) -> float:
    return math.sqrt(float(np.mean((found.residual[:, :2] ** 2).sum(axis=1))))
