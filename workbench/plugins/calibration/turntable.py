"""`calibrate.turntable`: the axis of a turntable in the robot's base, from markers measured at several angles."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Annotated

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
    HandEye,
    InputError,
    InputFile,
    Int,
    PartNames,
    Recording,
    Shaped,
    TurntableFile,
    pieces,
    rotation_from_vector,
    stage,
)
from workbench.plugins.calibration.model import Noise
from workbench.plugins.calibration.scanned import BELIEVED, known_hand_eye, seen_by, sphere_place
from workbench.plugins.calibration.tables import (
    LEAST_FREEDOM,
    Table,
    check_misfit,
    enough,
    noisy,
    shared,
    studentised,
    without_gross,
)
from workbench.plugins.calibration.values import SphereProfiles

POINT = ("x_mm", "y_mm", "z_mm")
ASKED = "are they in mm, and is each marker the same point at all angles?"
LEAST_TURN_DEG = 5.0  # between two angles: less shows no axis
SAME_ANGLE = 0.1 * DEG  # between places of one marker, that count as one
SURE = 5.0  # standard uncertainties by which the angles are not the table's
CHECKED = 0.01  # u of the angles' scale, up to which the points check it


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """n measured points: marker k at a table angle."""

    point_mm: Shaped[Float, "n 3"]  # in the base
    angle: Shaped[Float, " n"]  # rad, as the table counts
    marker: Shaped[Int, " n"]
    lines: tuple[int, ...]
    markers: int
    covariance: Shaped[Float, "n 3 3"]  # of the points, mm^2
    shared: (
        Float  # (n, 3, q): what one error for all of them moves them by, per standard deviation of each of its parts
    )

    def only(self, keep: Int) -> Marks:
        """Some of the points."""
        lines = tuple(self.lines[i] for i in keep)
        return replace(
            self,
            point_mm=self.point_mm[keep],
            angle=self.angle[keep],
            marker=self.marker[keep],
            lines=lines,
            covariance=self.covariance[keep],
            shared=self.shared[keep],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Axis:
    """The axis: a point on it, nearest to the markers' middle, and its direction; rising angles turn about it."""

    point_mm: Shaped[Float, " 3"]
    direction: Shaped[Float, " 3"]
    across: Shaped[Float, "2 3"]  # unit vectors square to it: the axes of the covariance
    covariance: Shaped[Float, "4 4"]  # of the point along both (mm), and of the direction's turn towards both (rad)
    residual_mm: Shaped[Float, "n 3"]
    misfit: float
    freedom: int
    distance: Shaped[Float, " n"]  # of each point from the rest, in its standard deviations
    marker_mm: Shaped[Float, "k 3"]  # from the axis' point, at angle 0
    scale: float  # of the angles, that the points show: 1, but for its u
    scale_u: float


@stage("calibrate.turntable")
def turntable(
    profiles: SphereProfiles | None = None,
    recording: Recording | None = None,
    *,
    marks: InputFile,
    hand_eye: InputFile | None = None,
    pose_noise_mm: Annotated[float, Field(gt=0, le=5)] = 0.07,
    pose_noise_deg: Annotated[float, Field(ge=0, le=1)] = 0.01,
    noise_mm: Annotated[float, Field(gt=0, le=5)] = 0.05,
    angle_noise_deg: Annotated[float, Field(ge=0, le=1)] = 0.002,
    reach_mm: Annotated[float, Field(gt=0, le=5000)] = 200.0,
    max_u_mm: Annotated[float, Field(gt=0, le=10)] = 0.2,
    root_tolerance_mm: Annotated[float, Field(gt=0, le=10)] = 0.5,
    bevel_deg: Annotated[float, Field(ge=10, le=75)] = 40.0,
    part: PartNames = NO_NAMES,
) -> tuple[Document, Chapter]:
    """Determine a turntable's axis in the base from the same markers, measured at two or more of its angles.

    Marker q (any point that the scanner finds again) at angle a lies at c + R(d, a) (q - c): least squares over
    direction d, a point c of the axis and the markers; the covariance is larger where the residuals ask for it. Places
    at angles less than 0.1 deg apart weigh as much as one; a point that all others contradict by 5 standard deviations
    is left out, with the cause. `turntable.json` holds the pose for a cell file (docs/howto/calibrate_tool.md).

    Args:
        profiles: of scanned spheres: circles from `calibrate.circles`.
        recording: of scanned spheres: their postures.
        marks: a CSV of markers (docs/howto/calibrate_tool.md).
        hand_eye: of scanned spheres: a handeye.json of the profiler that scanned them; null: the recording's own.
        pose_noise_mm: of scanned spheres: repeatability of a flange position, each axis.
        pose_noise_deg: likewise of its orientation.
        noise_mm: standard deviation of a measured point, each axis.
        angle_noise_deg: of the table's angle.
        reach_mm: how far along the axis, each way from the markers' middle, parts will be.
        max_u_mm: greatest u of the axis over that reach; a larger one is refused, and the direction named.
        root_tolerance_mm: of the root face that the table must serve.
        bevel_deg: angle of the bevel that is milled on it.
        part: whose calibration it is: robot, robot_serial, recorded_at (ISO 8601), operator, for the file and the page.

    Raises:
        InputError: an unusable table; too few angles or markers; an axis that remains open.

    Example:
        >>> from workbench.plugins import calibration
        >>> table, chapter = calibration.turntable(marks="data/calibration/marks.csv")
        >>> chapter.title
        'Turntable calibration'
    """
    believed: tuple[str, ...] = ()
    if profiles is None or recording is None:
        every = read_marks(marks, noise_mm)
    else:
        noise, eye = (
            Noise(pose_noise_mm, pose_noise_deg, profiles.sphere_diameter_mm / 2),
            known_hand_eye(hand_eye, recording),
        )
        every = scanned_marks(marks, profiles, recording, eye, noise)
        believed = () if eye.covariance is not None else (BELIEVED,)
    found, rows, left_out = without_gross(
        len(every.lines),
        lambda rows: solve(every.only(rows), angle_noise_deg * DEG, str(marks)),
        lambda fit, row: _away_mm(fit, every, row),
        every.lines,
        str(marks),
        ASKED,
        spare=LEAST_FREEDOM + 3,
    )
    check_misfit(found, str(marks), ASKED)
    kept = every.only(rows)
    _check_angles(found, str(marks))
    apart = noisy(found, "the points", "is each marker the same point at all angles, does the table wobble?")
    u, direction = worst(found, kept, reach_mm)
    if not u <= max_u_mm:
        axes = ", ".join(f"{v:+.2f}" for v in direction)
        raise InputError(
            str(marks),
            f"u = {u:.3g} mm of the axis along ({axes}) in the base, over a reach of "
            f"{reach_mm:g} mm, expected at most {max_u_mm:g} mm: "
            + "; ".join(apart or ("measure at angles farther apart, or markers farther from the axis",))
            + ("; or know the hand-eye pose better" if every.shared.size else ""),
        )
    good, verdict = enough(u, bevel_deg, root_tolerance_mm, "the table", "measure more angles or markers")
    warnings = tuple(left_out.values()) + apart + believed
    if believed:
        good, verdict = False, f"{verdict}; not good enough: nobody says how well the hand-eye pose is known"
    if found.scale_u > CHECKED:
        good, verdict = False, f"{verdict}; not good enough: the points do not check the table's angles"
        warnings += (
            f"the table's angles are believed: the points tell them to {100.0 * found.scale_u:.2g} % only, and an "
            "error of them displaces the axis; measure at a third angle, or a marker farther from the others",
        )
    who = UNKNOWN_PART.with_names(part)
    document = {
        "format": "turntable-calibration",
        "version": 1,
        "part": asdict(who),
        "frame": "base",
        "base_from_turntable": _pose(found),
        "axis_point_mm": found.point_mm,
        "axis_direction": found.direction,
        "across": found.across,
        "covariance": found.covariance,
        "u_mm": u,
        "direction_u_deg": math.sqrt(float(np.linalg.eigvalsh(found.covariance[2:, 2:])[-1])) / DEG,
        "residual_rms_mm": float(np.sqrt(np.mean((found.residual_mm**2).sum(axis=1)))),
        "misfit": found.misfit,
        "points": len(kept.lines),
        "left_out": [{"line": line, "cause": cause} for line, cause in left_out.items()],
        "good_enough": good,
        "verdict": verdict,
        "warnings": warnings,
    }
    html = pieces.paragraph(
        f"Axis through ({', '.join(f'{v:.3f}' for v in found.point_mm)}) mm along "
        f"({', '.join(f'{v:.5f}' for v in found.direction)}); u = {u:.3f} mm in the least certain direction over a "
        f"reach of {reach_mm:g} mm. Chi-square over degrees of freedom {found.misfit:.2f} on {found.freedom}."
    ) + pieces.paragraph(f"{verdict[:1].upper() + verdict[1:]}.")
    return (
        Document(TurntableFile.NAME, TurntableFile.written(document)),
        Chapter("Turntable calibration", html, summary=verdict, part=who, about="instruments", warnings=warnings),
    )


def scanned_marks(
    path: InputFile, profiles: SphereProfiles, recording: Recording, hand_eye: HandEye, noise: Noise
) -> Marks:
    """The table of scanned spheres: marker, angle_deg, pass; a sphere's passes at one angle are one point."""
    table = Table(path, ("angle_deg", "pass"), 2)
    angle, number = table.numbers(("angle_deg", "pass")).T
    names, marker = table.labels("marker", "sphere")
    _check_turn(angle, path)
    seen = seen_by(hand_eye, profiles, recording)
    passes = np.array([recording.pass_index[frames[0]] for frames in seen.frames])
    groups = sorted({(int(m), float(a)) for m, a in zip(marker, angle, strict=True)})
    members = [np.flatnonzero((marker == m) & (angle == a)) for m, a in groups]
    lines = tuple(table.lines[rows[0]] for rows in members)
    places = [
        sphere_place(hand_eye, seen.subset(np.isin(passes, number[rows])), noise, f"{path}: line {line}")
        for rows, line in zip(members, lines, strict=True)
    ]
    own = np.zeros((6, 0)) if hand_eye.covariance is None else np.linalg.cholesky(hand_eye.covariance)
    return Marks(
        np.array([one.center_mm for one in places]),
        np.array([a for _, a in groups]) * DEG,
        np.array([m for m, _ in groups]),
        lines,
        len(names),
        np.array([one.covariance for one in places]),
        np.array([one.by_hand_eye for one in places]) @ own,
    )


def read_marks(path: InputFile, noise_mm: float) -> Marks:
    """The table: marker, angle_deg, x_mm, y_mm, z_mm."""
    table = Table(path, ("marker", "angle_deg", *POINT), 2)
    values = table.numbers(("angle_deg", *POINT))
    names, marker = table.labels("marker", "?")
    _check_turn(values[:, 0], path)
    own = np.tile(noise_mm**2 * np.eye(3), (len(values), 1, 1))
    shared = np.zeros((len(values), 3, 0))
    return Marks(values[:, 1:], values[:, 0] * DEG, marker, tuple(table.lines), len(names), own, shared)


def _check_turn(angle_deg: Float, path: InputFile) -> None:
    if np.ptp(angle_deg) < LEAST_TURN_DEG:
        raise InputError(
            str(path),
            f"expected angles {LEAST_TURN_DEG:g} deg or more apart, found {np.ptp(angle_deg):.3g} deg: no axis shows",
        )


def solve(marks: Marks, angle_noise: float, where: str) -> Axis:
    """Least squares with the noise of points and of the table's angle over each marker's radius."""
    turn = np.abs(marks.angle[:, None] - marks.angle[None, :])
    once = np.sqrt(shared(marks.marker, turn, SAME_ANGLE))[:, None, None]
    freedom = 3 * round(float((once**-2.0).sum())) - 4 - 3 * marks.markers
    if freedom < 0:
        raise InputError(
            where,
            f"{len(marks.lines)} points of {marks.markers} markers leave the axis open: measure "
            "two markers at two angles, or one at three",
        )
    if not np.isin(np.arange(marks.markers), marks.marker).all():
        raise InputError(where, "a marker was measured at one angle only, and contradicts the others")
    middle = marks.point_mm.mean(axis=0)
    direction = _first_direction(marks)
    across = _across(direction)
    first = np.concatenate([_first_point(marks, direction, middle, across), np.zeros(2)])
    unknown = np.concatenate([first, np.zeros(3 * marks.markers)])
    unknown[4:] = _markers(marks, middle + first[:2] @ across, direction).ravel()
    root = _whitening(marks.covariance)

    def off(x: Float) -> Float:
        away = _predicted(marks, x, middle, direction, across) - marks.point_mm
        return np.asarray(np.einsum("nij,nj->ni", root, away).ravel())

    root = root / once
    for _ in range(2):  # the angle's noise has the radius of the answer
        fitted = scipy.optimize.least_squares(off, unknown, x_scale="jac", method="lm", xtol=1e-14, ftol=1e-14)
        unknown = fitted.x
        axis = _direction(unknown, direction, across)
        arm = np.cross(axis, marks.point_mm - (middle + unknown[:2] @ across))
        root = _whitening(marks.covariance + angle_noise**2 * arm[:, :, None] * arm[:, None, :]) / once
    fitted = scipy.optimize.least_squares(off, unknown, x_scale="jac", method="lm", xtol=1e-14, ftol=1e-14)
    jacobian, misfit = fitted.jac, float(2.0 * fitted.cost / max(freedom, 1))
    scale = np.linalg.norm(jacobian, axis=0) + 1e-30
    values, vectors = np.linalg.eigh((jacobian / scale).T @ (jacobian / scale))
    inverse = (vectors / np.maximum(values, 1e-12 * values[-1])) @ vectors.T / scale[:, None] / scale
    white = fitted.fun.reshape(-1, 3)
    rows = jacobian.reshape(-1, 3, unknown.size)
    distance = studentised(white, rows, inverse)
    shift = np.einsum("pq,njq,njk,nkr->pr", inverse[:4], rows, root, marks.shared)
    turned_by, arms = marks.angle[:, None] - marks.angle.mean(), marks.point_mm - (middle + fitted.x[:2] @ across)
    found, turned = _direction(fitted.x, direction, across), _across(_direction(fitted.x, direction, across), across)
    return Axis(
        middle + fitted.x[:2] @ across,
        found,
        turned,
        inverse[:4, :4] * max(1.0, misfit if freedom > 0 else 1.0) + shift @ shift.T,
        _predicted(marks, fitted.x, middle, direction, across) - marks.point_mm,
        misfit,
        freedom,
        distance,
        fitted.x[4:].reshape(-1, 3),
        *_angle_scale(fitted, np.einsum("nij,nj->ni", root, np.cross(found, arms) * turned_by)),
    )


def _whitening(covariance: Float) -> Float:
    """Inverse square roots (n, 3, 3)."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors / np.sqrt(values)[:, None, :]) @ np.swapaxes(vectors, 1, 2))


def _angle_scale(fitted: scipy.optimize.OptimizeResult, slope: Float) -> tuple[float, float]:
    """By what factor the angles would fit best, and its standard uncertainty: one Gauss-Newton step with it free.

    `slope` (n, 3): the change of the whitened residuals with the factor.
    """
    column = slope.ravel()
    left = column - fitted.jac @ np.linalg.lstsq(fitted.jac, column, rcond=1e-10)[0]
    size = float(left @ left)
    if size <= 1e-9 * float(column @ column):
        return 1.0, math.inf
    step = -float(left @ fitted.fun) / size
    freedom = max(len(column) - fitted.jac.shape[1] - 1, 1)
    rest = float(((fitted.fun + step * left) ** 2).sum()) / freedom
    return 1.0 + step, math.sqrt(max(1.0, rest) / size)


def _check_angles(found: Axis, where: str) -> None:
    if abs(found.scale - 1.0) > SURE * found.scale_u:
        raise InputError(
            where,
            f"the points turn by {found.scale:.4g} times the angles given, to {found.scale_u:.2g} (u): are angle_deg "
            "the table's own angles, in deg?",
        )


def worst(found: Axis, marks: Marks, reach_mm: float) -> tuple[float, Float]:
    """Greatest standard uncertainty of the axis' place over its reach, and its direction (3,)."""
    most, way = 0.0, found.across[0]
    middle = float(((marks.point_mm - found.point_mm) @ found.direction).mean())
    for along in (middle - reach_mm, middle + reach_mm):
        at = np.concatenate([np.eye(2), along * np.eye(2)], axis=1)
        values, vectors = np.linalg.eigh(at @ found.covariance @ at.T)
        if values[-1] > most:
            most, way = float(values[-1]), vectors[:, -1] @ found.across
    return math.sqrt(most), way


def _predicted(marks: Marks, x: Float, middle: Float, direction: Float, across: Float) -> Float:
    axis, point = _direction(x, direction, across), middle + x[:2] @ across
    turned = rotation_from_vector(marks.angle[:, None] * axis)
    return np.asarray(point + np.einsum("nij,nj->ni", turned, x[4:].reshape(-1, 3)[marks.marker]))


def _direction(x: Float, direction: Float, across: Float) -> Float:
    turned = direction + x[2:4] @ across
    return np.asarray(turned / np.linalg.norm(turned))


def _across(direction: Float, near: Float | None = None) -> Float:
    """Two unit vectors square to the axis; `near` others, if given."""
    hint = np.eye(3)[np.argmin(np.abs(direction))] if near is None else near[0]
    a = hint - (hint @ direction) * direction
    a = a / np.linalg.norm(a)
    return np.stack([a, np.cross(direction, a)])


def _first_direction(marks: Marks) -> Float:
    """The axis that turns differences between markers, or a marker's way, as the angles say (rough)."""
    best, least = np.array([0.0, 0.0, 1.0]), math.inf
    grid = _sphere(400)
    middle = marks.point_mm.mean(axis=0)
    for axis in grid:
        across = _across(axis)
        point = middle + _first_point(marks, axis, middle, across) @ across
        q = _markers(marks, point, axis)
        turned = rotation_from_vector(marks.angle[:, None] * axis)
        off = point + np.einsum("nij,nj->ni", turned, q[marks.marker]) - marks.point_mm
        if (off**2).sum() < least:
            best, least = axis, float((off**2).sum())
    return best


def _first_point(marks: Marks, axis: Float, middle: Float, across: Float) -> Float:
    """Coordinates (2,) along `across` of the axis' point, linear in points and markers for a given direction."""
    n, k = len(marks.lines), marks.markers
    turned = rotation_from_vector(marks.angle[:, None] * axis)
    rows, right = np.zeros((3 * n, 2 + 3 * k)), (marks.point_mm - middle).reshape(-1)
    rows[:, :2] = np.tile(across.T, (n, 1))
    for i in range(n):
        rows[3 * i : 3 * i + 3, 2 + 3 * marks.marker[i] : 5 + 3 * marks.marker[i]] = turned[i]
    return np.asarray(np.linalg.lstsq(rows, right, rcond=1e-12)[0][:2])


def _markers(marks: Marks, point: Float, axis: Float) -> Float:
    """Markers (k, 3) from the axis' point at angle 0, each the mean of its measured places turned back."""
    back = rotation_from_vector(-marks.angle[:, None] * axis)
    at = np.einsum("nij,nj->ni", back, marks.point_mm - point)
    return np.stack([at[marks.marker == k].mean(axis=0) for k in range(marks.markers)])


def _sphere(count: int) -> Float:
    """Directions (count, 3) spread evenly (Fibonacci)."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, math.pi * (1.0 + math.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z**2)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)


def _pose(found: Axis) -> Float:
    """base_from_turntable (4, 4): z along the axis, origin on it."""
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = *found.across, found.direction, found.point_mm
    return pose


def _away_mm(found: Axis, marks: Marks, row: int) -> float:
    """How far a point lies from where a fit without it puts it."""
    known = found.marker_mm[marks.marker[row]]
    turned = rotation_from_vector(marks.angle[row] * found.direction)
    return float(np.linalg.norm(found.point_mm + turned @ known - marks.point_mm[row]))
