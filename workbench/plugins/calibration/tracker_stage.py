"""`calibrate.tracker`: a robot seen by a laser tracker: where it stands, its targets, and what its geometry is off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.api import (
    DEG,
    NO_NAMES,
    UNKNOWN_PART,
    Chapter,
    Document,
    Float,
    InputError,
    InputFile,
    Int,
    PartNames,
    Shaped,
    estimator,
    pose_from,
    rotation_from_vector,
    stage,
)
from workbench.plugins.calibration.arm_errors import (
    NO_ERRORS,
    ArmErrors,
    arm_errors,
    chain_of,
    erring_flange,
    robot_results,
)
from workbench.plugins.calibration.model import cross_matrix
from workbench.plugins.calibration.observations import posture_of
from workbench.plugins.calibration.tables import (
    JOINTS,
    LENGTHS,
    POSE,
    by_point,
    check_misfit,
    enough,
    fit_fields,
    fit_words,
    noisy,
    not_included,
    poses,
)
from workbench.plugins.csv_table import Table
from workbench.plugins.ranges import BevelDeg, Deviation, LengthMm, NoiseDeg, NoiseMm, ToleranceMm

if TYPE_CHECKING:
    from workbench.api import Chain

PLACE = ("tracker_x_mm", "tracker_y_mm", "tracker_z_mm")
ORDERLY = (
    "are joint angles in deg, in the URDF's order and senses, poses the flange's, positions in mm and right-handed, "
    "rows in the order of the postures?"
)
LEAST_POSTURES = 4
SAME_MM, SAME = 0.1, 0.02 * DEG  # between flange poses: less is the same posture, as a robot repeats it
MOST_MM = 5.0  # that readings may lie off, RMS an axis: no robot is so badly built, as the lengths' prior says
BEYOND = 5.0  # standard deviations of how a robot is built
SAG, COUPLING = 0.01 * DEG, 1e-3  # of what the arm's model lacks, for its sizes


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """n readings of targets on the flange, at postures of the robot."""

    flange: Shaped[Float, "n 4 4"]  # base_from_flange as the model says
    joints: Shaped[Float, "n 6"] | None  # rad
    target: Shaped[Int, " n"]
    place_mm: Shaped[Float, "n 3"]  # in the tracker's frame
    targets: tuple[str, ...]
    lines: tuple[int, ...]

    @property
    def posture(self) -> Int:
        """Number (n,) of each reading's posture: its pose error is one, also where a robot came back to it."""
        return posture_of(self.flange, SAME_MM, SAME)


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """Registration, targets and errors of the arm, as the unknowns' order is: 6, t times 3, P."""

    tracker_from_base: Shaped[Float, "4 4"]
    target_mm: Shaped[Float, "t 3"]  # in the flange
    errors: Shaped[Float, " P"]


class Tracking:
    """A target p on the flange F is seen at x = T F(q, e) p: unknown are T, the targets and the arm's errors e."""

    def __init__(self, seen: Readings, chain: Chain | None, arm: ArmErrors, sigma: tuple[float, float, float]) -> None:
        """`sigma`: of a reading (mm), of the flange's position (mm) and orientation (rad), each axis."""
        self.seen, self.chain, self.arm, self.posture, self.sigma = seen, chain, arm, seen.posture, sigma
        self.alone, self.spread = sigma[0] ** 2 * np.eye(3), np.repeat(sigma[1:], 3)

    def rows(self, at: Tracked) -> estimator.Rows:
        """Residuals of the places; readings of one posture share its pose's error."""
        seen, n, size = self.seen, len(self.seen.lines), 6 + at.target_mm.size
        flange, by_errors = seen.flange, np.zeros((n, 6, 0))
        if self.chain is not None and seen.joints is not None:
            flange, by_errors = erring_flange(self.chain, self.arm, at.errors, seen.joints)
        frame, turn, point = at.tracker_from_base[:3, :3], flange[:, :3, :3], at.target_mm[seen.target]
        beyond = (np.einsum("nij,nj->ni", turn, point) + flange[:, :3, 3]) @ frame.T
        by_pose = frame @ np.concatenate([np.tile(np.eye(3), (n, 1, 1)), -turn @ cross_matrix(point)], axis=2)
        moves = np.tile(np.eye(3), (n, 1, 1)), -cross_matrix(beyond)
        columns, none = (*moves, by_point(frame @ turn, seen.target, len(seen.targets))), np.zeros((size, size))
        slope = np.concatenate(columns, axis=2)
        own, alone, values = by_pose * self.spread, np.tile(self.alone, (n, 1, 1)), np.full(n, 3.0)
        residual = seen.place_mm - beyond - at.tracker_from_base[:3, 3]
        places = estimator.Rows.posed(residual, slope, alone, own, self.posture, values, none, none[0])
        return places.beside(by_pose @ by_errors, at.errors, self.arm.prior)

    def moved(self, at: Tracked, step: Float) -> Tracked:
        """The registration turns in the tracker's axes."""
        frame, last = at.tracker_from_base, 6 + at.target_mm.size
        frame = pose_from(rotation_from_vector(step[3:6]) @ frame[:3, :3], frame[:3, 3] + step[:3])
        return Tracked(frame, at.target_mm + step[6:last].reshape(-1, 3), at.errors + step[last:])

    def begun(self) -> Tracked:
        """The best of fits of the robot as built, from rotations all about: all else follows from one."""
        built, none = Tracking(self.seen, None, NO_ERRORS, self.sigma), np.zeros((len(self.seen.targets), 3))
        turns = Rotation.create_group("I").as_matrix()
        starts = (Tracked(pose_from(turn, np.zeros(3)), none, np.zeros(0)) for turn in turns)
        return replace(estimator.from_all_about(built, starts).at, errors=np.zeros(len(self.arm)))


@stage("calibrate.tracker")
def tracker(
    *,
    readings: InputFile,
    cell: InputFile | None = None,
    tracker_noise_mm: NoiseMm = 0.02,
    robot_noise_mm: Deviation = 0.05,
    robot_noise_deg: NoiseDeg = 0.005,
    offset_prior_deg: Deviation = 0.3,
    length_prior_mm: LengthMm = 1.0,
    tilt_prior_deg: NoiseDeg = 0.02,
    root_tolerance_mm: ToleranceMm = 0.5,
    bevel_deg: BevelDeg = 40.0,
    part: PartNames = NO_NAMES,
) -> tuple[Document, Chapter]:
    """Register a robot to a laser tracker, and estimate its joint offsets and lengths.

    x = T (base_from_flange p), registration T and target p unknown (docs/howto/calibrate_robot.md). Residuals above the
    noise enlarge the covariance.

    Args:
        readings: a CSV of tracker readings (docs/howto/calibrate_robot.md).
        cell: the cell file with the robot's URDF, for readings with joint angles; null: the table has poses.
        tracker_noise_mm: standard deviation of a reading, each axis.
        robot_noise_mm: as in `calibrate.tcp`.
        robot_noise_deg: as in `calibrate.tcp`.
        offset_prior_deg: standard deviation of a joint's zero as built; 0: right, not estimated.
        length_prior_mm: of where an axis lies beside the one before; 0: right, not estimated.
        tilt_prior_deg: as in `calibrate.robot`.
        root_tolerance_mm: as in `calibrate.tcp`.
        bevel_deg: angle of the bevel that it mills.
        part: as in `calibrate.tcp`.

    Raises:
        InputError: an unusable table or cell; too few postures; more blunders than can be told apart.

    Example:
        >>> from workbench.plugins import calibration
        >>> files = {"cell": "data/robot/cell.json", "readings": "data/calibration/tracker.csv"}
        >>> document, chapter = calibration.tracker(**files)
        >>> chapter.title, document.name
        ('Robot calibration', 'robot.json')
    """
    where, chain = str(readings), chain_of(cell)
    every = read_readings(readings, chain)
    priors = offset_prior_deg * DEG, length_prior_mm, tilt_prior_deg * DEG
    arm = NO_ERRORS if chain is None else arm_errors(chain, *priors)
    sigma = (tracker_noise_mm, robot_noise_mm, robot_noise_deg * DEG)
    tracking, labels = Tracking(every, chain, arm, sigma), estimator.Labels(where, every.lines, ask=ORDERLY)
    start = tracking.begun()
    found, left_out = estimator.without_blunders(tracking, start, labels)
    residual, count = found.rows.residual[found.used], len(every.targets)
    rms = np.sqrt(np.mean(residual**2))
    if not rms <= MOST_MM:
        raise InputError(
            where,
            f"the readings lie {rms:.3g} mm RMS from where {'such a robot' if len(arm) else 'these poses'} would put "
            f"them: {ORDERLY}",
        )
    check_misfit(found, labels)
    built = estimator.fit(
        Tracking(every, chain, NO_ERRORS, sigma), replace(start, errors=np.zeros(0)), found.used
    ).rows.residual[found.used]
    slope, covariance = found.rows.jacobian[found.used], found.covariance
    predicted = np.einsum("nij,jk,nik->ni", slope, covariance, slope).mean()
    u = np.sqrt(predicted + max(rms**2 - tracker_noise_mm**2, 0.0))
    verdict = enough(u, bevel_deg, root_tolerance_mm, "the robot", "estimate tilts too, or calibrate where it works")
    warnings = tuple(left_out.values()) + noisy(found, "the readings", "does the robot repeat, is a target loose?")
    times = np.abs(found.at.errors) / arm.prior
    warnings += tuple(
        f"the {name} is {much:.0f} times what was stated of how it was built: does the table count the joints as the "
        "cell's URDF does?"
        for name, much in zip(arm.names, times, strict=True)
        if much > BEYOND
    )
    more = {
        "tracker_from_base": found.at.tracker_from_base,
        "registration_covariance": covariance[:6, :6],
        "targets": [
            {
                "name": name,
                "position_mm": found.at.target_mm[k],
                "covariance_mm2": covariance[6 + 3 * k : 9 + 3 * k, 6 + 3 * k : 9 + 3 * k],
            }
            for k, name in enumerate(every.targets)
        ],
        "residual_rms_as_built_mm": np.sqrt(np.mean(built**2)),
        "residual_rms_mm": rms,
        "u_mm": u,
        "readings": len(residual),
        "not_included": _not_included(found, every, arm),
        **fit_fields(found, left_out, verdict, warnings),
    }
    return robot_results(
        arm,
        found.at.errors,
        covariance[6 + 3 * count :, 6 + 3 * count :],
        more,
        f"Readings lie {rms:.3f} mm RMS an axis from the model, {more['residual_rms_as_built_mm']:.3f} mm as built. "
        f"{fit_words(found)}",
        UNKNOWN_PART.with_names(part),
    )


def _not_included(found: estimator.Fit[Tracked], every: Readings, arm: ArmErrors) -> list[str]:
    """What the arm's model lacks, with the parameter that it would change most against its uncertainty."""
    if every.joints is None or not len(arm):
        return []
    first, turned = found.rows.jacobian.shape[2] - len(arm), every.joints
    offset = {name[-1]: found.rows.jacobian[..., first + k] for k, name in enumerate(arm.names) if "offset" in name}
    causes = {f"a tracker's scale off by {LENGTHS:g}, or a robot 9 K warmer": LENGTHS * every.place_mm}
    for joint in ("2", "3"):
        if joint in offset:
            sags = SAG * np.sin(turned[:, int(joint) - 1])[:, None] * offset[joint]
            causes[f"a joint {joint} that sags by {SAG / DEG:g} deg and the sine of its angle"] = sags
    if "6" in offset:
        causes[f"a joint 6 that joint 5 turns along by {COUPLING:g}"] = COUPLING * turned[:, 4, None] * offset["6"]
    u = estimator.standard_u(found.covariance[first:, first:])

    def sized(change: Float) -> tuple[str, float]:
        times = np.abs(change[first:]) / u
        k = int(times.argmax())
        by = f"{change[first + k] / DEG:.3f} deg" if arm.twist[k, 3:].any() else f"{change[first + k]:.2f} mm"
        return f"the {arm.names[k]} by {by}", float(times[k])

    return not_included(found, causes, sized)


def read_readings(path: InputFile, chain: Chain | None) -> Readings:
    """The table: joint angles (with a cell) or the flange's pose, the target's name, its place."""
    table = Table(path, (*(POSE if chain is None else JOINTS), *PLACE), LEAST_POSTURES)
    place, (targets, target) = table.numbers(PLACE), table.labels("target", "target")
    joints = None if chain is None else table.numbers(JOINTS) * DEG
    flange = (
        poses(table) if chain is None or joints is None else erring_flange(chain, NO_ERRORS, np.zeros(0), joints)[0]
    )
    seen = Readings(flange, joints, target, place, targets, tuple(table.lines))
    if (count := int(seen.posture.max()) + 1) < LEAST_POSTURES:
        raise InputError(str(path), f"expected at least {LEAST_POSTURES} different postures, found {count}")
    if 3 * len(seen.lines) < 6 + 3 * len(targets):
        words = f"{len(seen.lines)} readings of {len(targets)} targets leave the registration open"
        raise InputError(str(path), f"{words}: measure more postures")
    return seen
