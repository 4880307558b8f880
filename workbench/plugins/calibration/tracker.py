"""`calibrate.tracker`: a robot seen by a laser tracker: where it stands, its targets, and what its geometry is off."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
import scipy
from pydantic import Field

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
    RobotFile,
    Shaped,
    inverse,
    pose_from,
    rotation_from_vector,
    stage,
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
from workbench.plugins.calibration.model import cross_matrix
from workbench.plugins.calibration.tables import (
    JOINTS,
    POSE,
    Table,
    check_misfit,
    enough,
    noisy,
    poses,
    studentised,
    without_gross,
)

if TYPE_CHECKING:
    from workbench.api import Chain

PLACE = ("tracker_x_mm", "tracker_y_mm", "tracker_z_mm")
ORDERLY = "are they in mm, and in the order of the postures?"
LEAST_POSTURES = 4
STEPS, CONVERGED = 30, 1e-8  # of a step's length in standard deviations, squared
SAME_MM, SAME = 0.1, 0.02 * DEG  # between flange poses: less is the same posture, as a robot repeats it
MOST_MM = 5.0  # that readings may lie off, RMS an axis: no robot is so badly built, as the lengths' prior says
BEYOND = 5.0  # standard deviations of how a robot is built
START_ROUNDS = 30  # of registration and lever arms in turn, each by medians


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """n readings of targets on the flange, at postures of the robot."""

    base_from_flange: Shaped[Float, "n 4 4"]  # as the model says
    joints: Shaped[Float, "n 6"] | None  # rad
    target: Shaped[Int, " n"]
    place_mm: Shaped[Float, "n 3"]  # in the tracker's frame
    targets: tuple[str, ...]
    lines: tuple[int, ...]

    def only(self, keep: Int) -> Seen:
        """Some of the readings."""
        return replace(
            self,
            base_from_flange=self.base_from_flange[keep],
            joints=None if self.joints is None else self.joints[keep],
            target=self.target[keep],
            place_mm=self.place_mm[keep],
            lines=tuple(self.lines[i] for i in keep),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """Registration, targets and errors of the arm, with their covariance: t, turn (tracker), targets, errors."""

    tracker_from_base: Shaped[Float, "4 4"]
    target_mm: Shaped[Float, "t 3"]  # in the flange
    errors: Shaped[Float, " P"]
    covariance: Float  # (6 + 3 t + P, ...)
    residual_mm: Shaped[Float, "n 3"]
    predicted_u_mm: Shaped[Float, " n"]  # of a reading's place, RMS of the three axes, without its own noise
    misfit: float
    freedom: int
    distance: Shaped[Float, " n"]


@stage("calibrate.tracker")
def tracker(
    *,
    readings: InputFile,
    cell: InputFile | None = None,
    tracker_noise_mm: Annotated[float, Field(gt=0, le=5)] = 0.02,
    robot_noise_mm: Annotated[float, Field(ge=0, le=5)] = 0.05,
    robot_noise_deg: Annotated[float, Field(ge=0, le=1)] = 0.005,
    offset_prior_deg: Annotated[float, Field(ge=0, le=5)] = 0.3,
    length_prior_mm: Annotated[float, Field(ge=0, le=20)] = 1.0,
    tilt_prior_deg: Annotated[float, Field(ge=0, le=1)] = 0.0,
    root_tolerance_mm: Annotated[float, Field(gt=0, le=10)] = 0.5,
    bevel_deg: Annotated[float, Field(ge=10, le=75)] = 40.0,
    part: PartNames = NO_NAMES,
) -> tuple[Document, Chapter]:
    """Register a robot to a laser tracker, and estimate what its joint offsets and lengths are off.

    A reading is one place of one target at one posture: x = T (base_from_flange p), registration T and target p
    unknown. With joint angles and the cell's model also the robot's offsets, lengths and, on request, tilts of axes are
    estimated (maximum a posteriori, Gauss-Newton); priors, what is left out or open, `robot.json`:
    docs/howto/calibrate_robot.md. Where residuals are larger than the noise the covariance grows with them, never the
    other way.

    Args:
        readings: a CSV of tracker readings (docs/howto/calibrate_robot.md).
        cell: the cell file with the robot's URDF, where the readings have joint angles; null: the table's poses are
            taken as they are.
        tracker_noise_mm: standard deviation of a reading, each axis.
        robot_noise_mm: repeatability of a flange position, each axis.
        robot_noise_deg: of its orientation, each axis.
        offset_prior_deg: standard deviation of a joint's zero as built; 0: right, not estimated.
        length_prior_mm: of where an axis lies beside the one before; 0: right, not estimated.
        tilt_prior_deg: of an axis' direction; 0: right, not estimated.
        root_tolerance_mm: of the root face that the robot must serve.
        bevel_deg: angle of the bevel that it mills.
        part: whose calibration it is: robot, robot_serial, recorded_at (ISO 8601), operator, for the file and the page.

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
    priors = Priors(offset_prior_deg * DEG, length_prior_mm, tilt_prior_deg * DEG)
    arm = NO_ERRORS if chain is None else arm_errors(chain, priors)
    sigma = (tracker_noise_mm, robot_noise_mm, robot_noise_deg * DEG)

    def fit(rows: Int, arm: ArmErrors = arm) -> Tracked:
        try:
            return solve(every.only(rows), chain, arm, sigma, where)
        except np.linalg.LinAlgError:  # its errors have run away
            raise _no_such_robot(where, arm, math.inf) from None

    found, kept, left_out = without_gross(
        len(every.lines),
        fit,
        lambda one, row: _away_mm(one, every, row, chain, arm),
        every.lines,
        where,
        ORDERLY,
    )
    built = fit(kept, NO_ERRORS) if len(arm) else found
    rms = float(np.sqrt(np.mean(found.residual_mm**2)))
    if rms > MOST_MM:
        raise _no_such_robot(where, arm, rms)
    check_misfit(found, where, ORDERLY)
    u = float(np.sqrt(np.mean(found.predicted_u_mm**2) + max(rms**2 - tracker_noise_mm**2, 0.0)))
    good, verdict = enough(
        u, bevel_deg, root_tolerance_mm, "the robot", "estimate tilts too, or calibrate where it works"
    )
    reasons = tuple(left_out.values()) + noisy(found, "the readings", "does the robot repeat, is a target loose?")
    reasons += _not_as_built(arm, found.errors)
    who = UNKNOWN_PART.with_names(part)
    document = arm_document(
        arm,
        found.errors,
        found.covariance[-len(arm) :, -len(arm) :] if len(arm) else np.zeros((0, 0)),
        {
            "part": asdict(who),
            "tracker_from_base": found.tracker_from_base,
            "registration_covariance": found.covariance[:6, :6],
            "targets": [
                {
                    "name": name,
                    "position_mm": found.target_mm[k],
                    "covariance_mm2": found.covariance[6 + 3 * k : 9 + 3 * k, 6 + 3 * k : 9 + 3 * k],
                }
                for k, name in enumerate(every.targets)
            ],
            "residual_rms_as_built_mm": float(np.sqrt(np.mean(built.residual_mm**2))),
            "residual_rms_mm": rms,
            "u_mm": u,
            "misfit": found.misfit,
            "readings": len(kept),
            "left_out": [{"line": line, "cause": cause} for line, cause in left_out.items()],
            "good_enough": good,
            "verdict": verdict,
            "warnings": reasons,
        },
    )
    html = arm_html(
        document,
        f"Readings lie {rms:.3f} mm RMS an axis from the model, {document['residual_rms_as_built_mm']:.3f} mm as "
        f"built. Chi-square over degrees of freedom {found.misfit:.2f} on {found.freedom}.",
    )
    return (
        Document(RobotFile.NAME, RobotFile.written(document)),
        Chapter(
            "Robot calibration",
            html,
            summary=verdict,
            part=who,
            about="instruments",
            warnings=reasons + tuple(document["left_as_built"]),
        ),
    )


def _no_such_robot(where: str, arm: ArmErrors, rms_mm: float) -> InputError:
    by = "such a robot" if len(arm) else "these poses"
    far = f"{rms_mm:.3g} mm RMS" if math.isfinite(rms_mm) else "far"
    return InputError(
        where,
        f"the readings lie {far} from where {by} would put them: are joint angles in deg, in the URDF's order and "
        "senses, poses the flange's, positions in mm and right-handed, rows in the order of the postures?",
    )


def _not_as_built(arm: ArmErrors, values: Float) -> tuple[str, ...]:
    """A warning for each error that is far beyond how well the robot was said to be built."""
    return tuple(
        f"the {arm.names[k]} is {abs(values[k]) / arm.prior[k]:.0f} times what was stated of how it was built: does "
        "the table count the joints as the cell's URDF does?"
        for k in np.flatnonzero(np.abs(values) > BEYOND * arm.prior)
    )


def chain_of(cell: InputFile | None) -> Chain | None:
    """The cell's robot; None without a cell."""
    from workbench.api import read_cell

    return None if cell is None else read_cell(cell).chain


def read_readings(path: InputFile, chain: Chain | None) -> Seen:
    """The table: joint angles (with a cell) or the flange's pose, the target's name, its place."""
    table = Table(path, (*(POSE if chain is None else JOINTS), *PLACE), LEAST_POSTURES)
    place = table.numbers(PLACE)
    targets, target = table.labels("target", "target")
    if chain is None:
        joints, flange = None, poses(table)
    else:
        joints = table.numbers(JOINTS) * DEG
        flange = flange_poses(chain, joints)
    seen = Seen(flange, joints, target, place, targets, tuple(table.lines))
    if (count := len(_postures(seen))) < LEAST_POSTURES:
        raise InputError(str(path), f"expected at least {LEAST_POSTURES} different postures, found {count}")
    return seen


def solve(seen: Seen, chain: Chain | None, arm: ArmErrors, sigma: tuple[float, float, float], where: str) -> Tracked:
    """Gauss-Newton on registration, targets and errors. `sigma`: of a reading, a position (mm), an orientation (rad).

    Readings of one posture share its pose's error.
    """
    count, size = len(seen.targets), 6 + 3 * len(seen.targets) + len(arm)
    frame, points = _start(seen)
    x = np.zeros(len(arm))
    groups = _postures(seen)
    for _ in range(STEPS):
        flange, by_errors = seen.base_from_flange, np.zeros((len(seen.lines), 6, len(arm)))
        if chain is not None and seen.joints is not None:
            now, more = corrected(chain, arm, x)
            flange, by_errors = flange_poses(now, seen.joints), pose_derivatives(now, more, seen.joints)
        point = points[seen.target]
        in_base = np.einsum("nij,nj->ni", flange[:, :3, :3], point) + flange[:, :3, 3]
        turned = in_base @ frame[:3, :3].T
        off = seen.place_mm - (turned + frame[:3, 3])
        by_pose = np.concatenate(
            [np.broadcast_to(np.eye(3), (len(point), 3, 3)), -flange[:, :3, :3] @ cross_matrix(point)], axis=2
        )
        by_pose = frame[:3, :3] @ by_pose
        rows = np.zeros((len(point), 3, size))
        rows[:, :, :3], rows[:, :, 3:6] = np.eye(3), -cross_matrix(turned)
        for k in range(count):
            mine = seen.target == k
            rows[mine, :, 6 + 3 * k : 9 + 3 * k] = frame[:3, :3] @ flange[mine, :3, :3]
        rows[:, :, size - len(arm) :] = by_pose @ by_errors
        white, right = _whitened(rows, off, by_pose, groups, sigma)
        prior = np.zeros((size, size))
        prior[np.arange(size - len(arm), size), np.arange(size - len(arm), size)] = arm.prior**-2
        pull = np.concatenate([np.zeros(size - len(arm)), -x / arm.prior**2])
        information = np.einsum("nij,nik->jk", white, white) + prior
        covariance = inverse_information(information)
        step = covariance @ (np.einsum("nij,ni->j", white, right) + pull)
        if step @ information @ step < CONVERGED:
            break
        frame = pose_from(rotation_from_vector(step[3:6]) @ frame[:3, :3], frame[:3, 3] + step[:3])
        points, x = points + step[6 : 6 + 3 * count].reshape(-1, 3), x + step[6 + 3 * count :]
    freedom = 3 * len(seen.lines) - size + len(arm)
    if freedom < 0:
        raise InputError(
            where, f"{len(seen.lines)} readings of {count} targets leave the registration open: measure more postures"
        )
    misfit = float(((right**2).sum() + ((x / arm.prior) ** 2).sum()) / max(freedom, 1))
    distance = studentised(right, white, covariance)
    covariance = covariance * max(1.0, misfit if freedom > 0 else 1.0)
    u = np.sqrt(np.einsum("nij,jk,nik->n", rows, covariance, rows) / 3.0)
    return Tracked(frame, points, x, covariance, off, u, misfit, freedom, distance)


def _start(seen: Seen) -> tuple[Float, Float]:
    """Registration and targets, in turn and by medians, so that a blunder does not draw them."""
    points, weight = np.zeros((len(seen.targets), 3)), np.ones(len(seen.lines))
    frame = np.eye(4)
    for _ in range(START_ROUNDS):
        at = np.einsum("nij,nj->ni", seen.base_from_flange[:, :3, :3], points[seen.target])
        at += seen.base_from_flange[:, :3, 3]
        share = weight / weight.sum()
        a, b = share @ at, share @ seen.place_mm
        left, _, right = np.linalg.svd((share[:, None] * (seen.place_mm - b)).T @ (at - a))
        turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
        frame = pose_from(turn, b - turn @ a)
        back = inverse(frame)
        local = inverse(seen.base_from_flange) @ _homogeneous(seen.place_mm @ back[:3, :3].T + back[:3, 3])
        points = np.stack([np.median(local[seen.target == k, :3, 0], axis=0) for k in range(len(points))])
        away = np.linalg.norm(local[:, :3, 0] - points[seen.target], axis=1)
        scale = max(float(np.median(away)), 1e-6)
        weight = 1.0 / np.maximum(1.0, away / scale) ** 2
    return frame, points


def _homogeneous(points: Float) -> Float:
    return np.concatenate([points, np.ones((len(points), 1))], axis=1)[:, :, None]


def _postures(seen: Seen) -> list[Int]:
    """Rows of each posture: readings whose pose error is one, those of a robot that came back to it too."""
    place, turn = seen.base_from_flange[:, :3, 3], seen.base_from_flange[:, :3, :3].reshape(len(seen.lines), 9)
    distance = scipy.spatial.distance
    apart = np.hypot(distance.pdist(place) / SAME_MM, distance.pdist(turn) / (math.sqrt(2.0) * SAME))
    near = distance.squareform(apart) <= 1.0
    count, number = scipy.sparse.csgraph.connected_components(near, directed=False)
    return [np.flatnonzero(number == k) for k in range(count)]


def _whitened(
    rows: Float, off: Float, by_pose: Float, groups: list[Int], sigma: tuple[float, float, float]
) -> tuple[Float, Float]:
    """Jacobian (n, 3, P) and residuals (n, 3), whitened by the readings' own noise and their postures'."""
    spread = by_pose * np.repeat([sigma[1], sigma[2]], 3)
    white, right = np.empty_like(rows), np.empty_like(off)
    for group in groups:
        m = 3 * len(group)
        shared = spread[group].reshape(m, 6)
        factor = np.linalg.cholesky(sigma[0] ** 2 * np.eye(m) + shared @ shared.T)
        white[group] = np.linalg.solve(factor, rows[group].reshape(m, -1)).reshape(len(group), 3, -1)
        right[group] = np.linalg.solve(factor, off[group].reshape(m)).reshape(len(group), 3)
    return white, right


def inverse_information(information: Float) -> Float:
    """Inverse of an information matrix; huge, not infinite, in directions that nothing determines."""
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information), 1e-12))
    values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    return np.asarray(scale[:, None] * (vectors / np.maximum(values, 1e-14)) @ vectors.T * scale)


def flange_poses(chain: Chain, joints: Float) -> Float:
    """`base_from_flange` (n, 4, 4)."""
    from workbench.api import forward_kinematics

    return forward_kinematics(chain, joints)


def _away_mm(found: Tracked, seen: Seen, row: int, chain: Chain | None, arm: ArmErrors) -> float:
    """How far a reading lies from where a fit without it puts it."""
    flange = seen.base_from_flange[row]
    if len(found.errors) and chain is not None and seen.joints is not None:
        flange = flange_poses(corrected(chain, arm, found.errors)[0], seen.joints[row])
    point = flange[:3, :3] @ found.target_mm[seen.target[row]] + flange[:3, 3]
    place = found.tracker_from_base[:3, :3] @ point + found.tracker_from_base[:3, 3]
    return float(np.linalg.norm(place - seen.place_mm[row]))
