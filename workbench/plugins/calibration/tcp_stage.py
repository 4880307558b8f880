"""`calibrate.tcp`: where the tool's tip and axis are on the flange, from touching fixed points in many postures."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
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
    InputError,
    InputFile,
    Int,
    PartNames,
    Recording,
    Shaped,
    ToolFile,
    estimator,
    nearest,
    pieces,
    stage,
)
from workbench.plugins.calibration.scanned import LEAST_POSTURES, UNSAID, UNUSED, Scanner
from workbench.plugins.calibration.tables import (
    LENGTHS,
    LONGER,
    POSE,
    Course,
    by_point,
    check_misfit,
    enough,
    fit_fields,
    fit_words,
    lever_noise,
    likeliest,
    noisy,
    not_included,
    poses,
    refuse_open,
    results,
    rms_mm,
    sentence,
    ways,
)
from workbench.plugins.calibration.values import SphereProfiles
from workbench.plugins.csv_table import Table
from workbench.plugins.ranges import BevelDeg, Deviation, NoiseDeg, NoiseMm, ToleranceMm

KNOWN = ("px_mm", "py_mm", "pz_mm")
ASKED = "are poses the flange's, in mm, with the quaternion's w first?"
LEAST_TOUCHES = 4
ALONE_MM = 1e-3  # of a typed reference by itself
SAME_POSTURE = 1.0 * DEG  # between touches of one tool point and reference, that count as one
STAND_OFF = "stand_off_mm"
BENDS = "the tool gives way to its weight by {:.2f} mm{} where it lies level"
STIFF = "the points are those of the tool upright; is it tight? Below 0: the base's z points down, or it is no weight"
BEND_MM = 0.1  # of a tool, that no touch need show, for its size
ANYWHERE = 100.0  # radii of a ball: standard deviation of where on it the tool point lies
FAR_BETTER = 0.25  # a misfit over another's: touches along the tool fit its mirror image, beyond the ball, as well


@dataclass(frozen=True, slots=True, eq=False)
class Touches:
    """n touches: the flange stands so that a tool point lies on a reference point, or beside it by a known distance."""

    base_from_flange: Shaped[Float, "n 3 4"]  # rotation and position
    tool_point: Shaped[Int, " n"]  # number of the tool point
    reference: Shaped[Int, " n"]
    tool_names: tuple[str, ...]
    reference_names: tuple[str, ...]
    known_mm: Shaped[Float, "r 3"]  # references as measured in the base; NaN: unknown
    known_covariance: Float  # (3 k, 3 k) of those that are known, in their order, mm^2
    stand_off_mm: Shaped[Float, " n"]  # of the tool point from the reference; NaN: not said, on it
    lines: tuple[int, ...]  # of the file

    @property
    def distance_mm(self) -> Float:
        """The distances (n,), 0 where nothing is said."""
        return np.nan_to_num(self.stand_off_mm)


@stage("calibrate.tcp")
def tcp(
    profiles: SphereProfiles | None = None,
    recording: Recording | None = None,
    *,
    touches: InputFile,
    references: InputFile | None = None,
    hand_eye: InputFile | None = None,
    robot_noise_mm: NoiseMm = 0.05,
    robot_noise_deg: NoiseDeg = 0.01,
    touch_noise_mm: Deviation = 0.02,
    reference_u_mm: NoiseMm = 0.05,
    max_u_mm: ToleranceMm = 0.2,
    least_reach_mm: Annotated[float, Field(ge=0, le=1000)] = 25.0,
    root_tolerance_mm: ToleranceMm = 0.5,
    bevel_deg: BevelDeg = 40.0,
    part: PartNames = NO_NAMES,
) -> tuple[Document, Chapter]:
    """Determine the tool's points on the flange from touches, and its axis from two of them.

    Weighted least squares: touch i means R_i p + t_i = c, or |R_i p + t_i - c| = d (`stand_off_mm`), for the tool point
    p and the reference c. A touch off by 5 standard deviations is left out, a drift or step of the references over the
    rows is taken out. The first tool point is the tip, the last one gives the axis.

    Args:
        profiles: of scanned references: circles from `calibrate.circles`.
        recording: of scanned references: their postures.
        touches: a CSV of touches (docs/howto/calibrate_tool.md).
        references: of scanned spheres: a CSV of passes and the references that they show.
        hand_eye: of scanned spheres: the profiler's handeye.json; null: the recording's own.
        robot_noise_mm: standard deviation of a flange position, each axis.
        robot_noise_deg: of its orientation, each axis.
        touch_noise_mm: of a touch, each axis.
        reference_u_mm: standard uncertainty, each axis, of a reference that the table gives.
        max_u_mm: greatest accepted u of a tool point along any direction.
        least_reach_mm: least distance of a tool point from the flange's middle (smaller: metres or inches?).
        root_tolerance_mm: of the root face that the tool must serve.
        bevel_deg: angle of the bevel that it mills.
        part: robot, robot_serial, recorded_at (ISO 8601), operator, for the file and the page.

    Raises:
        InputError: an unusable table; touches that leave a direction open; more blunders than can be told apart.

    Example:
        >>> from workbench.plugins import calibration
        >>> tool, chapter = calibration.tcp(touches="data/calibration/touches.csv")
        >>> chapter.title
        'Tool calibration'
    """
    every = read_touches(touches, reference_u_mm)
    believed: tuple[str, ...] = ()
    if references is None and hand_eye is not None:
        raise InputError(str(hand_eye), UNUSED.format("references, a table of the passes that show them"))
    if references is not None:
        if profiles is None or recording is None:
            raise InputError(str(references), "expected a recording that shows them (scan.read, calibrate.circles)")
        scanner = Scanner(profiles, recording, hand_eye, (robot_noise_mm, robot_noise_deg))
        _check_stand_off(every, scanner.radius_mm, str(touches))
        every = with_scanned(every, references, scanner)
        believed = scanner.warnings
    noise = math.hypot(robot_noise_mm, touch_noise_mm), robot_noise_deg * DEG
    labels = estimator.Labels(str(touches), every.lines, ask=ASKED)
    begun = _begun(every, noise)
    touching, start = _Touching(every, noise), begun
    bends = Course(touching.by_weight(begun)[..., None], BENDS, ask=STIFF)
    course = likeliest(estimator.sound(touching, begun), (*ways("the references", every.lines), bends))
    if course is not None:
        start = np.append(begun, np.zeros(course.change.shape[2]))
    found, left_out = estimator.without_blunders(_Touching(every, noise, course=course), start, labels)
    check_misfit(found, labels)
    names, t = every.tool_names, 3 * len(every.tool_names)
    place, spread = found.at[: t + 3 * len(every.reference_names)].reshape(-1, 3), found.covariance[:t, :t]
    of = [spread[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(len(names))]
    exchanged = _check_places(place, names, least_reach_mm, str(touches))
    apart = noisy(found, "the touches", "is the tool loose, a pose or its unit wrong, the robot less accurate?")
    if course is not None:
        size = found.at[len(begun) :]
        said = course.words.format(size[0] if size.size == 1 else np.linalg.norm(size), "")
        apart = (f"{said}: that is taken out; {course.ask}", *apart)
    widest, ask = [estimator.worst(one) for one in of], apart or ("turn the flange about axes across that direction",)
    for name, worst in zip(names, widest, strict=True):
        refuse_open(str(touches), f"the tool point '{name}'", *worst, "flange", max_u_mm, ask)
    axis, u = _axis(place, spread, names), [one[0] for one in widest]
    verdict = enough(
        u[0],
        bevel_deg,
        root_tolerance_mm,
        "the tool",
        "touch in more orientations, or with less noise",
        but=[UNSAID] if believed else (),
    )
    warnings = tuple(left_out.values()) + apart + believed + exchanged
    document = {
        "frame": "flange",
        "points": [
            {"name": name, "position_mm": place[k], "u_mm": u[k], "covariance_mm2": of[k]}
            for k, name in enumerate(names)
        ],
        "axis": axis,
        "covariance_mm2": spread,
        "references": [
            {"name": name, "position_mm": place[len(names) + k]} for k, name in enumerate(every.reference_names)
        ],
        "residual_rms_mm": rms_mm(found.rows.residual[found.used]),
        "touches": int(found.used.sum()),
        "not_included": _not_included(found, touching, of, names),
        **fit_fields(found, left_out, verdict, warnings),
    }
    head = ("Tool point", "x, mm", "y, mm", "z, mm", "u, least certain direction, mm")
    rows = [(name, *(f"{v:.3f}" for v in place[k]), f"{u[k]:.3f}") for k, name in enumerate(names)]
    axis_words = "" if axis is None else f"Axis: u = {axis['u_deg']:.3f}° about the least certain direction. "
    html = pieces.table_html(head, rows) + pieces.paragraph(f"{axis_words}{fit_words(found)} {sentence(verdict[1])}")
    return results(ToolFile, "Tool calibration", UNKNOWN_PART.with_names(part), document, html)


def _not_included(
    found: estimator.Fit[Float], touching: _Touching, of: list[Float], names: tuple[str, ...]
) -> list[str]:
    """What no touch need show, by the tool point that it would change most; of: covariances (3, 3) of these."""
    causes = {
        f"a tool that gives way to its weight by {BEND_MM:g} mm where it lies level": BEND_MM
        * touching.by_weight(found.at),
        LONGER: LENGTHS * touching.position,
    }

    def sized(change: Float) -> tuple[str, float]:
        moved = change[: 3 * len(names)].reshape(-1, 3)
        times = [estimator.times_u(away, one) for one, away in zip(of, moved, strict=True)]
        k = int(np.argmax(times))
        return f"the tool point '{names[k]}' by {np.linalg.norm(moved[k]):.3f} mm", times[k]

    return not_included(found, causes, sized)


def with_scanned(touches: Touches, path: InputFile, scanner: Scanner) -> Touches:
    """The touches with the references that the scanner saw in the place of those that are typed."""
    table = Table(path, ("reference", "pass"), LEAST_POSTURES)
    names, which = table.labels("reference", "?")
    passes, every = table.numbers(("pass",))[:, 0], touches.reference_names
    for name in names:
        if name not in every:
            raise InputError(str(path), f"'{name}' is no reference of the touches{nearest(name, every)}")
    shown = {k: which == names.index(name) for k, name in enumerate(every) if name in names}
    places = scanner.places([passes[rows] for rows in shown.values()], [table.place(rows) for rows in shown.values()])
    known_mm, moved = np.full_like(touches.known_mm, np.nan), places.shared.reshape(3 * len(shown), -1)
    known_mm[list(shown)] = places.center_mm
    covariance = scipy.linalg.block_diag(*places.covariance) + moved @ moved.T
    return replace(touches, known_mm=known_mm, known_covariance=covariance)


def read_touches(path: InputFile, reference_u_mm: float) -> Touches:
    """The table: reference, flange pose; optional: tool_point, and the reference as measured in the base."""
    table = Table(path, ("reference", *POSE), LEAST_TOUCHES)
    known = table.numbers(KNOWN, blank=True)
    tools, tool = table.labels("tool_point", "tip")
    references, reference = table.labels("reference", "?")
    measured = np.full((len(references), 3), np.nan)
    for k, name in enumerate(references):
        said = known[reference == k]
        full = np.isfinite(said).all(axis=1)
        if (np.isfinite(said).any(axis=1) & ~full).any() or (full.any() and np.ptp(said[full], axis=0).max() > 1e-9):
            raise InputError(str(path), f"expected one px_mm, py_mm, pz_mm for reference '{name}', or none")
        measured[k] = said[full][0] if full.any() else np.nan
    count = int(np.isfinite(measured).all(axis=1).sum())
    # One error for all of them, as of a hand-eye pose: it displaces nothing but them, and the tool carries it in full.
    shared = reference_u_mm**2 * np.kron(np.ones((count, count)), np.eye(3)) + ALONE_MM**2 * np.eye(3 * count)
    stand_off = table.numbers((STAND_OFF,), blank=True)[:, 0]
    if (stand_off < 0.0).any():
        raise InputError(f"{table.place(stand_off < 0.0)}: {STAND_OFF}", "expected 0 or more")
    return Touches(
        poses(table)[:, :3], tool, reference, tools, references, measured, shared, stand_off, tuple(table.lines)
    )


def _check_stand_off(touches: Touches, radius_mm: float, where: str) -> None:
    """Refuse touches of a scanned sphere that do not say how far from its centre the tool point stays."""
    unsaid, within = np.isnan(touches.stand_off_mm), (touches.distance_mm > 0.0) & (touches.distance_mm < radius_mm)
    if (unsaid | within).any():
        raise InputError(
            f"{where}: line {touches.lines[int((unsaid | within).argmax())]}: {STAND_OFF}",
            f"expected the tool point's distance from the centre of the scanned sphere: its radius, {radius_mm:g} mm, "
            "and that of the ball that touches it; or 0 where a pin target takes the sphere's place",
        )


class _Touching:
    """Touches as the estimator sees them: unknown are tool points (flange), references (base) and their way, mm."""

    def __init__(
        self,
        touches: Touches,
        noise: tuple[float, float],
        offset: Float | None = None,
        course: Course | None = None,
    ) -> None:
        """`noise`: of position (mm) and orientation (rad), each axis.

        `offset`: where the tool points lie from their references (n, 3); None: the touches' distance away, anywhere.
        `course`: which the touches tell, by more unknowns; None: all is as it should be.
        """
        self.rotation, self.position = touches.base_from_flange[:, :, :3], touches.base_from_flange[:, :, 3]
        self.tool_point, self.noise = touches.tool_point, noise
        n, tools, refs = len(self.rotation), len(touches.tool_names), len(touches.reference_names)
        self.tools = tools
        of_tool = by_point(self.rotation, touches.tool_point, tools)
        of_reference = by_point(np.tile(-np.eye(3), (n, 1, 1)), touches.reference, refs)
        way = np.zeros((n, 3, 0)) if course is None else course.change
        self.slope = np.concatenate([of_tool, of_reference, way], axis=2)
        self.offset = np.zeros((n, 3)) if offset is None else offset
        self.ball_mm = touches.distance_mm if offset is None else np.zeros(n)
        turn = np.arccos(np.clip((np.einsum("nij,mij->nm", self.rotation, self.rotation) - 1.0) / 2.0, -1.0, 1.0))
        nearby = np.linalg.norm(self.position[:, None] - self.position[None], axis=2)
        ball = touches.distance_mm > 0.0  # round a ball the flange need not turn
        turn = turn + np.divide(nearby, touches.distance_mm, out=np.zeros_like(turn), where=ball)
        self.alike = estimator.alike(touches.tool_point * refs + touches.reference, turn, SAME_POSTURE)
        held = 3 * tools + np.flatnonzero(np.isfinite(touches.known_mm))
        self.prior = np.zeros((self.slope.shape[2],) * 2)
        self.prior[np.ix_(held, held)] = np.linalg.inv(touches.known_covariance)
        self.expected = np.zeros(self.slope.shape[2])
        self.expected[held] = touches.known_mm[np.isfinite(touches.known_mm)]

    def rows(self, x: Float) -> estimator.Rows:
        """Residuals from where the tool point should be: of a ball, its nearest place, with any other as good."""
        apart = self.slope @ x + self.position - self.offset
        way = apart / np.maximum(np.linalg.norm(apart, axis=1), 1e-12)[:, None]
        lever = np.einsum("nij,nj->ni", self.rotation, self.tool(x))
        round_it = (ANYWHERE * self.ball_mm[:, None, None]) ** 2 * (np.eye(3) - way[:, :, None] * way[:, None, :])
        covariance = (lever_noise(lever, *self.noise) + round_it) * self.alike[:, None, None]
        values = np.where(self.ball_mm > 0.0, 1, 3) / self.alike
        residual = self.ball_mm[:, None] * way - apart
        return estimator.Rows(residual, self.slope, covariance, values, self.prior, self.expected - x)

    def moved(self, x: Float, step: Float) -> Float:
        """All unknowns are lengths."""
        return x + step

    def tool(self, x: Float) -> Float:
        """The tool points (n, 3) in the flange, mm."""
        return np.asarray(x[: 3 * self.tools].reshape(-1, 3)[self.tool_point])

    def by_weight(self, x: Float) -> Float:
        """Change (n, 3) of the touches by a tool that gives way to its weight by 1 mm where it lies level.

        It gives way across its axis, or where a single point tells none, across the way from the flange.
        """
        tip, last = x[:3], x[3 * self.tools - 3 : 3 * self.tools]
        axis = tip - last if self.tools > 1 else tip
        along = self.rotation @ (axis / max(float(np.linalg.norm(axis)), 1e-9))
        return np.asarray(along[:, 2:] * along - np.eye(3)[2])


def _begun(touches: Touches, noise: tuple[float, float]) -> Float:
    """Where to begin: each tool point on its reference, or where a ball keeps it off.

    There it lies towards the flange, as a tool that presses, or where that beginning has left it, if that explains the
    touches far better.
    """
    on = _Touching(touches, noise, np.zeros((len(touches.lines), 3)))
    plain = estimator.fit(on, np.zeros(on.slope.shape[2])).at
    if not touches.distance_mm.any():
        return plain
    lever = np.einsum("nij,nj->ni", on.rotation, on.tool(plain))
    away = -touches.distance_mm[:, None] * lever / np.maximum(np.linalg.norm(lever, axis=1), 1e-12)[:, None]
    pressed, other = (
        estimator.fit(_Touching(touches, noise), start)
        for start in (estimator.fit(_Touching(touches, noise, away), plain).at, plain)
    )
    return other.at if other.misfit < FAR_BETTER * pressed.misfit else pressed.at


def _check_places(place: Float, names: tuple[str, ...], least_mm: float, where: str) -> tuple[str, ...]:
    """Refuse a tool as flat as the flange, or as long as inverted poses make it: they fit as well.

    A warning where the tip is no farther from the flange than the point from which the axis comes.
    """
    away = np.linalg.norm(place, axis=1)
    reach, reference = away[: len(names)], away[len(names) :].min()
    for name, one in zip(names, reach, strict=True):
        if one < least_mm:
            raise InputError(
                where,
                f"the tool point '{name}' would lie {one:.3g} mm from the flange's middle, expected {least_mm:g} mm "
                "or more (least_reach_mm): are positions in mm, and the flange's?",
            )
    if reach.min() > reference:
        raise InputError(
            where,
            f"the tool would reach {reach.min():.0f} mm from the flange, to a reference only {reference:.0f} mm from "
            "the robot's base: are the poses inverted (flange_from_base), or in a frame at the reference, not the "
            "base's? A tool as long as that needs a reference farther from the base.",
        )
    if len(names) < 2 or reach[0] > reach[-1]:
        return ()
    return (
        f"the tip '{names[0]}', the table's first tool point, lies nearer to the flange ({reach[0]:.0f} mm) than "
        f"'{names[-1]}' ({reach[-1]:.0f} mm): is the table's order, or a name, exchanged?",
    )


def _axis(place: Float, covariance: Float, names: tuple[str, ...]) -> dict[str, object] | None:
    """The axis, towards the tip: from the last tool point of the table to its first; None for a single one."""
    if len(names) < 2:
        return None
    apart = place[0] - place[len(names) - 1]
    length = np.linalg.norm(apart)
    if length < 1.0:
        raise InputError("touches", f"expected tool points 1 mm or more apart for the axis, found {length:.3f} mm")
    pick = np.zeros((3, len(covariance)))
    pick[:, :3], pick[:, -3:] = np.eye(3), -np.eye(3)
    across = (np.eye(3) - np.outer(apart, apart) / length**2) @ pick / length
    turn = across @ covariance @ across.T
    return {
        "from": names[-1],
        "to": names[0],
        "direction": apart / length,
        "covariance_rad2": turn,
        "u_deg": estimator.worst(turn)[0] / DEG,
    }
