"""`calibrate.turntable`: the axis of a turntable in the robot's base, from markers measured at several angles."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import scipy
from pydantic import Field
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
    Recording,
    Shaped,
    TurntableFile,
    estimator,
    frame_about,
    pieces,
    pose_from,
    rotation_from_vector,
    stage,
)
from workbench.plugins.calibration.scanned import UNSAID, UNUSED, Places, Scanner
from workbench.plugins.calibration.tables import (
    CHANCE,
    Course,
    by_point,
    check_misfit,
    enough,
    even,
    fit_fields,
    fit_words,
    likeliest,
    noisy,
    not_included,
    refuse_open,
    results,
    rms_mm,
    sentence,
    ways,
)
from workbench.plugins.calibration.values import SphereProfiles
from workbench.plugins.csv_table import Table
from workbench.plugins.ranges import BevelDeg, NoiseDeg, NoiseMm, ToleranceMm

MARKERS = "the markers"
POINT = ("x_mm", "y_mm", "z_mm")
ASKED = "are they in mm, and is each marker the same point at all angles?"
LEAST_TURN_DEG = 5.0  # between two angles: less shows no axis
SAME_ANGLE = 0.1 * DEG  # between places of one marker, that count as one
STEP = 1e-5  # rad, for differences
SURE = 5.0  # standard uncertainties by which the angles are not the table's
UPRIGHT = 0.7  # of the axis' z: nearer to the vertical than to the horizontal
CHECKED = 0.01  # u of the angles' scale, up to which the points check it
TIMES = np.geomspace(1.0, 100.0, 10)  # the stated noise of angles
AT_REST = 1e-3  # of the points' noise: as good as no drift, whatever the order of the rows
FREE = 1e3  # likewise: no prior
DRIFT_MM = 0.1  # that the points need not show, for its size
UNLIKELY = 4.0  # gain of log-likelihood, from which angles are noisier than stated


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """n measured points: marker k at a table angle."""

    places: Places
    angle: Shaped[Float, " n"]  # rad, as the table counts
    marker: Shaped[Int, " n"]
    lines: tuple[int, ...]
    markers: int

    @property
    def point_mm(self) -> Float:
        """In the base (n, 3)."""
        return self.places.center_mm


@dataclass(frozen=True, slots=True, eq=False)
class Axis:
    """The axis: a point on it and its direction; rising angles turn about it. And the markers at angle 0."""

    point_mm: Shaped[Float, " 3"]
    frame: Shaped[Float, "3 3"]  # rows: two unit vectors square to the axis, those of the covariance, and its direction
    marker_mm: Shaped[Float, "k 3"]  # from the point
    drift_mm: Shaped[Float, " 3"]  # of all markers, from the first row to the last


class _Turning:
    """Marker q at angle a lies at c + R(d, a) q + D t: unknown are c and d, each along two axes, drift D and markers.

    The table's angle at a stop errs once for all markers there. The drift's prior is 0, with `drift` times the points'
    noise as u.
    """

    def __init__(self, marks: Marks, angle_noise: float, course: Course | None = None) -> None:
        self.marks, self.angle_noise, self.drift = marks, angle_noise, AT_REST if course is None else FREE
        self.course = course or even(MARKERS, marks.lines)
        self.alike = estimator.alike(marks.marker, np.abs(marks.angle[:, None] - marks.angle), SAME_ANGLE)
        self.middle = marks.point_mm.mean(axis=0)
        self.stop = np.unique(np.round(marks.angle / SAME_ANGLE), return_inverse=True)[1]

    def predicted(self, at: Axis) -> Float:
        there = np.einsum("nij,nj->ni", self.rotation(at), at.marker_mm[self.marks.marker])
        return np.asarray(at.point_mm + there + self.course.change @ at.drift_mm)

    def rotation(self, at: Axis) -> Float:
        return rotation_from_vector(self.marks.angle[:, None] * at.frame[2])

    def sway(self, at: Axis) -> Float:
        """Change (n, 3) of the points with the table's angle."""
        return np.cross(at.frame[2], self.marks.point_mm - at.point_mm)

    def rows(self, at: Axis) -> estimator.Rows:
        n, size = len(self.alike), 7 + 3 * self.marks.markers
        alone = self.marks.places.covariance * self.alike[:, None, None]
        sway = self.angle_noise * self.sway(at)[..., None]
        columns = (
            np.tile(at.frame[:2].T, (n, 1, 1)),
            estimator.jacobian_of(lambda turn: self.predicted(_tilted(at, turn)), np.full(2, STEP)),
            self.course.change,
            by_point(self.rotation(at), self.marks.marker, self.marks.markers),
        )
        slope, prior = np.concatenate(columns, axis=2), np.zeros((size, size))
        prior[4:7, 4:7] = np.linalg.inv(self.drift**2 * self.marks.places.covariance.mean(axis=0))
        away = np.zeros(size)
        away[4:7] = -at.drift_mm
        residual, values = self.marks.point_mm - self.predicted(at), 3.0 / self.alike
        return estimator.Rows.posed(residual, slope, alone, sway, self.stop, values, prior, away)

    def moved(self, at: Axis, step: Float) -> Axis:
        """The point stays where the axis is nearest to the middle of all points."""
        then = _tilted(at, step[2:4])
        point = at.point_mm + step[:2] @ at.frame[:2]
        slid = (self.middle - point) @ then.frame[2] * then.frame[2]
        markers, drift = at.marker_mm + step[7:].reshape(-1, 3) - slid, at.drift_mm + step[4:7]
        return replace(then, point_mm=point + slid, marker_mm=markers, drift_mm=drift)

    def begun(self) -> Axis:
        """The best of fits from directions all about: for one direction point and markers follow at once."""
        zero = np.zeros((self.marks.markers, 3))
        frames = frame_about(Rotation.create_group("I").as_matrix()[:, 2])
        starts = [Axis(self.middle, one, zero, np.zeros(3)) for one in frames]
        best = estimator.from_all_about(self, starts).at
        return replace(best, frame=frame_about(best.frame[2]))  # the same from whatever start


@stage("calibrate.turntable")
def turntable(
    profiles: SphereProfiles | None = None,
    recording: Recording | None = None,
    *,
    marks: InputFile,
    hand_eye: InputFile | None = None,
    pose_noise_mm: NoiseMm = 0.07,
    pose_noise_deg: NoiseDeg = 0.01,
    noise_mm: NoiseMm = 0.05,
    angle_noise_deg: NoiseDeg = 0.002,
    reach_mm: Annotated[float, Field(gt=0, le=5000)] = 200.0,
    max_u_mm: ToleranceMm = 0.2,
    root_tolerance_mm: ToleranceMm = 0.5,
    bevel_deg: BevelDeg = 40.0,
    part: PartNames = NO_NAMES,
) -> tuple[Document, Chapter]:
    """Determine a turntable's axis in the base from markers measured at two or more angles.

    Marker q at angle a lies at c + R(d, a) (q - c): least squares over direction d, axis point c and markers. A point
    off by 5 standard deviations is left out. A drift over the rows, or a step after a row or beyond an angle, and the
    error of each angle are unknowns.

    Args:
        profiles: of scanned spheres: circles from `calibrate.circles`.
        recording: of scanned spheres: their postures.
        marks: a CSV of markers (docs/howto/calibrate_tool.md).
        hand_eye: as in `calibrate.tcp`.
        pose_noise_mm: as in `calibrate.hand_eye`.
        pose_noise_deg: as in `calibrate.hand_eye`.
        noise_mm: standard deviation of a measured point, each axis.
        angle_noise_deg: of the table's angle.
        reach_mm: how far parts reach along the axis, each way from the markers' middle.
        max_u_mm: greatest accepted u of the axis over that reach.
        root_tolerance_mm: as in `calibrate.tcp`.
        bevel_deg: as in `calibrate.tcp`.
        part: as in `calibrate.tcp`.

    Raises:
        InputError: an unusable table; too few angles or markers; an axis that remains open.

    Example:
        >>> from workbench.plugins import calibration
        >>> table, chapter = calibration.turntable(marks="data/calibration/marks.csv")
        >>> chapter.title
        'Turntable calibration'
    """
    scanner = None
    if profiles is not None and recording is not None:
        scanner = Scanner(profiles, recording, hand_eye, (pose_noise_mm, pose_noise_deg))
    elif hand_eye is not None:
        raise InputError(str(hand_eye), UNUSED.format("a recording that shows them (scan.read, calibrate.circles)"))
    every = read_marks(marks, noise_mm, scanner)
    believed = () if scanner is None else scanner.warnings
    labels = estimator.Labels(str(marks), every.lines, ask=ASKED)
    table = _Turning(every, angle_noise_deg * DEG)
    if round(3.0 * (1.0 / table.alike).sum()) < 4 + 3 * every.markers:
        raise InputError(
            str(marks),
            f"{len(every.lines)} points of {every.markers} markers leave the axis open: measure "
            "two markers at two angles, or one at three",
        )
    table, start = _as_noisy(table)
    found, left_out = estimator.without_blunders(table, start, labels, spare=estimator.LEAST_FREEDOM + 3)
    check_misfit(found, labels)
    if not np.isin(np.arange(every.markers), every.marker[found.used]).all():
        raise InputError(str(marks), "a marker was measured at one angle only, and contradicts the others")
    axis, shift = found.at, found.carried(every.places.shared)[:4]
    covariance = found.covariance[:4, :4] + shift @ shift.T
    spread_mm2, apart = _drift(found, table.course)
    covariance[:2, :2] += spread_mm2  # any time between first and last row is as likely
    by_scale = table.sway(axis) * (every.angle - every.angle[found.used].mean())[:, None]
    (scale,), ((variance,),) = found.tested(by_scale[..., None])
    scale_u = math.sqrt(variance)
    if abs(scale) > SURE * scale_u:
        raise InputError(
            str(marks),
            f"the points turn by {1.0 + scale:.6g} times the angles given, to {scale_u:.2g} (u): are angle_deg "
            "the table's own angles, in deg?",
        )
    apart += noisy(found, "the points", "is each marker the same point at all angles, does the table wobble?")
    u, direction = worst(axis, covariance, every.point_mm[found.used], reach_mm)
    ask = [*(apart or ("measure at angles farther apart, or markers farther from the axis",))]
    ask += ["or know the hand-eye pose better"] if every.places.shared.size else []
    refuse_open(str(marks), "the axis", u, direction, f"base, over a reach of {reach_mm:g} mm", max_u_mm, ask)
    but = [UNSAID] if believed else []
    warnings = tuple(left_out.values()) + apart + believed
    if axis.frame[2, 2] < -UPRIGHT:
        warnings += (
            "the axis points down, against the base's z: rising angles turn clockwise seen from above; if the table "
            "counts the other way, columns x_mm and y_mm are swapped, or the angles' sign is wrong",
        )
    if scale_u > CHECKED:
        but.append("the points do not check the table's angles")
        warnings += (
            f"the table's angles are believed: the points tell them to {100.0 * scale_u:.2g} % only, and an "
            "error of them displaces the axis; measure at a third angle, or a marker farther from the others",
        )
    verdict = enough(u, bevel_deg, root_tolerance_mm, "the table", "measure more angles or markers", but=but)
    document = {
        "frame": "base",
        "base_from_turntable": pose_from(axis.frame.T, axis.point_mm),
        "axis_point_mm": axis.point_mm,
        "axis_direction": axis.frame[2],
        "across": axis.frame[:2],
        "covariance": covariance,
        "u_mm": u,
        "direction_u_deg": estimator.worst(covariance[2:, 2:])[0] / DEG,
        "residual_rms_mm": rms_mm(found.rows.residual[found.used]),
        "points": int(found.used.sum()),
        "not_included": _not_included(found, every, covariance, reach_mm),
        **fit_fields(found, left_out, verdict, warnings),
    }
    html = pieces.paragraph(
        f"Axis through ({', '.join(f'{v:.3f}' for v in axis.point_mm)}) mm along "
        f"({', '.join(f'{v:.5f}' for v in axis.frame[2])}); u = {u:.3f} mm in the least certain direction over a "
        f"reach of {reach_mm:g} mm. {fit_words(found)}"
    ) + pieces.paragraph(sentence(verdict[1]))
    return results(TurntableFile, "Turntable calibration", UNKNOWN_PART.with_names(part), document, html)


def _as_noisy(table: _Turning) -> tuple[_Turning, Axis]:
    """The table with its angles' noise as stated or larger, and a drift, as the points ask; and a first fit."""
    sound = estimator.sound(table, table.begun())
    # asked for where angles err as stated: larger errors of a few would explain a drift as well
    courses = ways(MARKERS, table.marks.lines, angle_deg=table.marks.angle / DEG)
    course = likeliest(sound, courses, sound.at.frame[:2].T)
    angle = table.marks.angle - table.marks.angle.mean()
    scaled = (table.sway(sound.at) * angle[:, None])[..., None]  # angles of another scale are no noise

    def noisier(times: float) -> _Turning:
        return _Turning(table.marks, table.angle_noise * times, course)

    def likelihood(times: float) -> float:
        rows = noisier(times).rows(sound.at).beside(scaled, np.zeros(1), np.full(1, np.inf))
        return rows.only(sound.used).normal().restricted

    best = max(TIMES, key=likelihood)
    return noisier(best if likelihood(best) > likelihood(1.0) + UNLIKELY else 1.0), sound.at


def _drift(found: estimator.Fit[Axis], course: Course) -> tuple[Float, tuple[str, ...]]:
    """Mean square (2, 2) of the axis' way across itself, from halfway, and the warning; 0: by chance."""
    across = found.at.frame[:2]
    drift, covariance = across @ found.at.drift_mm, across @ found.covariance[4:7, 4:7] @ across.T
    if drift @ np.linalg.solve(covariance, drift) < scipy.special.chdtri(2, CHANCE):
        return np.zeros((2, 2)), ()
    said = course.words.format(np.hypot(*drift), " across the axis")
    why = "the axis is that of halfway, and the uncertainties hold that"
    return course.share * (np.outer(drift, drift) + covariance), (
        f"{said}: {why}; did base, table or what measures them move or warm up?",
    )


def read_marks(path: InputFile, noise_mm: float, scanner: Scanner | None) -> Marks:
    """The table: marker, angle_deg, x_mm, y_mm, z_mm; of scanned spheres marker, angle_deg, pass.

    A sphere's passes at one angle are one point.
    """
    columns = ("angle_deg", *POINT) if scanner is None else ("angle_deg", "pass")
    table = Table(path, ("marker", *columns) if scanner is None else columns, 2)
    values = table.numbers(columns)
    names, marker = table.labels("marker", "?" if scanner is None else "sphere")
    angle, lines = values[:, 0], np.array(table.lines)
    if np.ptp(angle) < LEAST_TURN_DEG:
        raise InputError(
            str(path),
            f"expected angles {LEAST_TURN_DEG:g} deg or more apart, found {np.ptp(angle):.3g} deg: no axis shows",
        )
    if scanner is None:
        own, point = np.tile(noise_mm**2 * np.eye(3), (len(values), 1, 1)), values[:, 1:]
        places = Places(point, own, np.zeros((len(values), 3, 0)))
    else:
        pairs, which = np.unique(np.column_stack([marker, angle]), axis=0, return_inverse=True)
        members = [np.flatnonzero(which.reshape(-1) == k) for k in range(len(pairs))]
        marker, angle = pairs[:, 0].astype(int), pairs[:, 1]
        lines = lines[[rows[0] for rows in members]]
        places = scanner.places([values[rows, 1] for rows in members], [f"{path}: line {line}" for line in lines])
    return Marks(places, angle * DEG, marker, tuple(lines.tolist()), len(names))


def ends(axis: Axis, points_mm: Float, reach_mm: float) -> list[Float]:
    """How the axis' ends, over its reach about points (n, 3), lie across it by what the covariance is of (2, 4)."""
    middle = ((points_mm - axis.point_mm) @ axis.frame[2]).mean()
    return [np.concatenate([np.eye(2), along * np.eye(2)], axis=1) for along in (middle - reach_mm, middle + reach_mm)]


def worst(axis: Axis, covariance: Float, points_mm: Float, reach_mm: float) -> tuple[float, Float]:
    """Greatest standard uncertainty of the axis' place over its reach about points (n, 3), and its direction (3,)."""
    places = (estimator.worst(at @ covariance @ at.T) for at in ends(axis, points_mm, reach_mm))
    u, way = max(places, key=lambda one: one[0])
    return u, way @ axis.frame[:2]


def _not_included(found: estimator.Fit[Axis], marks: Marks, covariance: Float, reach_mm: float) -> list[str]:
    """What a drift that the points do not tell would change, along that axis of the base where it changes most."""
    causes = {
        f"a drift by {DRIFT_MM:g} mm along {name} from the first row to the last": DRIFT_MM * change
        for name, change in zip("xyz", np.moveaxis(even(MARKERS, marks.lines).change, 2, 0), strict=True)
    }
    places = ends(found.at, marks.point_mm[found.used], reach_mm)

    def sized(change: Float) -> tuple[str, float]:
        moved = [at @ change[:4] for at in places]
        times = [estimator.times_u(one, at @ covariance @ at.T) for one, at in zip(moved, places, strict=True)]
        return f"the axis by {np.linalg.norm(moved, axis=1).max():.3f} mm over its reach", max(times)

    return not_included(found, causes, sized)[:1]


def _tilted(at: Axis, turn: Float) -> Axis:
    direction = at.frame[2] + turn @ at.frame[:2]
    return replace(at, frame=frame_about(direction / np.linalg.norm(direction), at.frame[0]))
