"""`calibrate.tcp`: where the tool's tip and axis are on the flange, from touching fixed points in many postures."""

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
    Part,
    PartNames,
    Recording,
    Shaped,
    ToolFile,
    nearest,
    pieces,
    stage,
)
from workbench.plugins.calibration.model import Noise
from workbench.plugins.calibration.observations import Observations
from workbench.plugins.calibration.scanned import BELIEVED, LEAST_POSTURES, Place, known_hand_eye, seen_by, sphere_place
from workbench.plugins.calibration.tables import (
    POSE,
    Table,
    check_misfit,
    enough,
    noisy,
    poses,
    shared,
    studentised,
    without_gross,
)
from workbench.plugins.calibration.values import SphereProfiles

KNOWN = ("px_mm", "py_mm", "pz_mm")
ASKED = "are poses the flange's, in mm, with the quaternion's w first?"
LEAST_TOUCHES = 4
ALONE_MM = 1e-3  # of a typed reference by itself
SAME_POSTURE = 1.0 * DEG  # between touches of one tool point and reference, that count as one
STAND_OFF = "stand_off_mm"
FAR_BETTER = 0.25  # a misfit over another's: touches along the tool fit its mirror image, beyond the ball, as well
ROUNDS = 3  # the lever of the orientation's noise is the answer's own
MOST_ROUNDS = 40  # where balls are touched, whose normals are the answer's too


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
    def beside_mm(self) -> Float:
        """The distances (n,), 0 where nothing is said."""
        return np.nan_to_num(self.stand_off_mm)

    def only(self, keep: Int) -> Touches:
        """Some of the touches."""
        return replace(
            self,
            base_from_flange=self.base_from_flange[keep],
            tool_point=self.tool_point[keep],
            reference=self.reference[keep],
            stand_off_mm=self.stand_off_mm[keep],
            lines=tuple(self.lines[i] for i in keep),
        )


@dataclass(frozen=True, slots=True, eq=False)
class ToolPoints:
    """Tool points in the flange, with what the touches leave open."""

    position_mm: Shaped[Float, "t 3"]
    covariance: Float  # (3 t, 3 t) mm^2
    reference_mm: Shaped[Float, "r 3"]  # in the base
    residual_mm: Shaped[Float, "n 3"]
    misfit: float  # chi-square over degrees of freedom
    freedom: int
    distance: Shaped[Float, " n"]  # of each touch from the rest, in standard deviations of that


@stage("calibrate.tcp")
def tcp(
    profiles: SphereProfiles | None = None,
    recording: Recording | None = None,
    *,
    touches: InputFile,
    references: InputFile | None = None,
    hand_eye: InputFile | None = None,
    robot_noise_mm: Annotated[float, Field(gt=0, le=5)] = 0.05,
    robot_noise_deg: Annotated[float, Field(ge=0, le=1)] = 0.01,
    touch_noise_mm: Annotated[float, Field(ge=0, le=5)] = 0.02,
    reference_u_mm: Annotated[float, Field(gt=0, le=5)] = 0.05,
    max_u_mm: Annotated[float, Field(gt=0, le=10)] = 0.2,
    least_reach_mm: Annotated[float, Field(ge=0, le=1000)] = 25.0,
    root_tolerance_mm: Annotated[float, Field(gt=0, le=10)] = 0.5,
    bevel_deg: Annotated[float, Field(ge=10, le=75)] = 40.0,
    part: PartNames = NO_NAMES,
) -> tuple[Document, Chapter]:
    """Determine the tool's points on the flange from touches, and its axis from two points on it.

    Touch i says R_i p + t_i = c, or |R_i p + t_i - c| = d where a ball keeps the tool point off (`stand_off_mm`), for
    the tool point p and the reference c: unknown (at least three orientations), typed, or shown by the passes of a
    recording. Weighted least squares by the robot's position and, with the lever |p|, its orientation. Touches in
    postures less than 1 deg apart (of a ball: and as near) weigh as much as one; one that all others contradict by 5
    standard deviations is left out, with the cause. The first tool point of the table is the tip; the axis runs to it
    from the last one. `tcp.json`: points, axis, covariance (docs/howto/calibrate_tool.md).

    Args:
        profiles: of scanned references: circles from `calibrate.circles`.
        recording: of scanned references: their postures.
        touches: a CSV of touches (docs/howto/calibrate_tool.md).
        references: of scanned spheres: a CSV of the passes that show a reference: reference, pass.
        hand_eye: of scanned spheres: a handeye.json of the profiler that scanned them; null: the recording's own.
        robot_noise_mm: standard deviation of a flange position, each axis.
        robot_noise_deg: of its orientation, each axis.
        touch_noise_mm: of a touch, each axis.
        reference_u_mm: standard uncertainty of a reference that the table gives, each axis; one for all of them.
        max_u_mm: greatest u of a tool point along any direction; a larger one is refused, and the direction named.
        least_reach_mm: a tool point nearer to the flange's middle is refused: positions in metres or inches make such
            tools.
        root_tolerance_mm: of the root face that the tool must serve.
        bevel_deg: angle of the bevel that it mills.
        part: whose calibration it is: robot, robot_serial, recorded_at (ISO 8601), operator, for the file and the page.

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
    if references is not None:
        if profiles is None or recording is None:
            raise InputError(str(references), "expected a recording that shows them (scan.read, calibrate.circles)")
        eye = known_hand_eye(hand_eye, recording)
        shown = Noise(robot_noise_mm, robot_noise_deg, profiles.sphere_diameter_mm / 2)
        _check_stand_off(every, profiles.sphere_diameter_mm / 2.0, str(touches))
        every = with_scanned(every, references, seen_by(eye, profiles, recording), recording, eye, shown)
        believed = () if eye.covariance is not None else (BELIEVED,)
    noise = math.hypot(robot_noise_mm, touch_noise_mm), robot_noise_deg * DEG
    found, kept, left_out = without_gross(
        len(every.lines),
        lambda rows: solve(every.only(rows), noise),
        lambda fit, row: _away_mm(fit, every, row),
        every.lines,
        str(touches),
        ASKED,
    )
    check_misfit(found, str(touches), ASKED)
    _check_reach(found, every.tool_names, least_reach_mm, str(touches))
    apart = noisy(found, "the touches", "is the tool loose, a pose or its unit wrong, the robot less accurate?")
    _check_determined(found, every.tool_names, max_u_mm, str(touches), apart)
    axis = _axis(found, every.tool_names)
    u = [worst(found, k)[0] for k in range(len(every.tool_names))]
    good, verdict = enough(
        u[0], bevel_deg, root_tolerance_mm, "the tool", "touch in more orientations, or with less noise"
    )
    if believed:
        good, verdict = False, f"{verdict}; not good enough: nobody says how well the hand-eye pose is known"
    warnings = tuple(left_out.values()) + apart + believed + _tip_nearest(found, every.tool_names)
    who = UNKNOWN_PART.with_names(part)
    document = {
        "format": "tool-calibration",
        "version": 1,
        "part": asdict(who),
        "frame": "flange",
        "points": [
            {
                "name": name,
                "position_mm": found.position_mm[k],
                "u_mm": u[k],
                "covariance_mm2": found.covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3],
            }
            for k, name in enumerate(every.tool_names)
        ],
        "axis": axis,
        "covariance_mm2": found.covariance,
        "references": [
            {"name": name, "position_mm": found.reference_mm[k]} for k, name in enumerate(every.reference_names)
        ],
        "residual_rms_mm": float(np.sqrt(np.mean((found.residual_mm**2).sum(axis=1)))),
        "misfit": found.misfit,
        "touches": len(kept),
        "left_out": [{"line": line, "cause": cause} for line, cause in left_out.items()],
        "good_enough": good,
        "verdict": verdict,
        "warnings": warnings,
    }
    return Document(ToolFile.NAME, ToolFile.written(document)), _chapter(found, every, u, axis, verdict, warnings, who)


def with_scanned(
    touches: Touches, path: InputFile, seen: Observations, recording: Recording, hand_eye: HandEye, noise: Noise
) -> Touches:
    """The touches with the references that the scanner saw in the place of those that are typed."""
    table = Table(path, ("reference", "pass"), LEAST_POSTURES)
    names, which = table.labels("reference", "?")
    number, passes = table.numbers(("pass",))[:, 0], np.array([recording.pass_index[f[0]] for f in seen.frames])
    unknown = [name for name in names if name not in touches.reference_names]
    if unknown:
        raise InputError(
            str(path), f"'{unknown[0]}' is no reference of the touches{nearest(unknown[0], touches.reference_names)}"
        )
    known_mm = np.full_like(touches.known_mm, np.nan)
    blocks: dict[int, Place] = {}
    for k, name in enumerate(names):
        r, line = touches.reference_names.index(name), table.lines[int(np.flatnonzero(which == k)[0])]
        shown = seen.subset(np.isin(passes, number[which == k]))
        blocks[r] = sphere_place(hand_eye, shown, noise, f"{path}: line {line}")
        known_mm[r] = blocks[r].center_mm
    places = [blocks[r] for r in sorted(blocks)]
    moved = np.concatenate([one.by_hand_eye for one in places])
    shared = 0.0 if hand_eye.covariance is None else moved @ hand_eye.covariance @ moved.T
    covariance = scipy.linalg.block_diag(*(one.covariance for one in places)) + shared
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
    beside = table.numbers((STAND_OFF,), blank=True)[:, 0]
    if (beside < 0.0).any():
        raise InputError(f"{path}: line {table.lines[int(np.argmax(beside < 0.0))]}: {STAND_OFF}", "expected 0 or more")
    return Touches(
        poses(table)[:, :3], tool, reference, tools, references, measured, shared, beside, tuple(table.lines)
    )


def _check_stand_off(touches: Touches, radius_mm: float, where: str) -> None:
    """Refuse touches of a scanned sphere that do not say how far from its centre the tool point stays."""
    unsaid, within = np.isnan(touches.stand_off_mm), (touches.beside_mm > 0.0) & (touches.beside_mm < radius_mm)
    if (unsaid | within).any():
        raise InputError(
            f"{where}: line {touches.lines[int(np.argmax(unsaid | within))]}: {STAND_OFF}",
            f"expected the tool point's distance from the centre of the scanned sphere: its radius, {radius_mm:g} mm, "
            "and that of the ball that touches it; or 0 where a pin target takes the sphere's place",
        )


def solve(touches: Touches, noise: tuple[float, float]) -> ToolPoints:
    """Weighted least squares. `noise`: of position (mm) and orientation (rad), each axis.

    Where balls are touched, begun with tool points on the references; then each lies beside its reference towards the
    flange, as a tool that presses, or where that beginning has left it, if that explains the touches far better.
    """
    plain = _fit(touches, noise, np.zeros((len(touches.lines), 3)))
    if not touches.beside_mm.any():
        return plain
    towards = -np.einsum("nij,nj->ni", touches.base_from_flange[:, :, :3], plain.position_mm[touches.tool_point])
    pressed, other = (_fit(touches, noise, way) for way in (towards, plain.residual_mm))
    return other if other.misfit < FAR_BETTER * pressed.misfit else pressed


def _fit(touches: Touches, noise: tuple[float, float], way: Float) -> ToolPoints:
    """The same from where each tool point lies beside its reference, directions `way` (n, 3); 0: on it, all of them."""
    rotation, position = touches.base_from_flange[:, :, :3], touches.base_from_flange[:, :, 3]
    n, tools, refs = len(rotation), len(touches.tool_names), len(touches.reference_names)
    size = 3 * (tools + refs)
    rows, right = np.zeros((3 * n, size)), -position.reshape(-1)
    for i in range(n):
        a, b = 3 * touches.tool_point[i], 3 * (tools + touches.reference[i])
        rows[3 * i : 3 * i + 3, a : a + 3] = rotation[i]
        rows[3 * i : 3 * i + 3, b : b + 3] = -np.eye(3)
    prior, prior_right = _prior(touches, size)
    points = np.zeros((tools, 3))
    turn = np.arccos(np.clip((np.einsum("nij,mij->nm", rotation, rotation) - 1.0) / 2.0, -1.0, 1.0))
    nearby = np.linalg.norm(position[:, None] - position[None], axis=2)  # round a ball the flange need not turn
    turn = turn + np.divide(nearby, touches.beside_mm, out=np.zeros_like(turn), where=touches.beside_mm > 0.0)
    once = np.sqrt(shared(touches.tool_point * refs + touches.reference, turn, SAME_POSTURE))[:, None, None]
    beside = np.where(way.any(axis=1), touches.beside_mm, 0.0)
    for _ in range(MOST_ROUNDS if beside.any() else ROUNDS):
        way = way / np.maximum(np.linalg.norm(way, axis=1), 1e-12)[:, None]
        lever = np.einsum("nij,nj->ni", rotation, points[touches.tool_point])
        root = _whitening(lever, noise[0], noise[1], np.where(beside[:, None] > 0.0, way, 0.0)) / once
        white = np.einsum("nij,njk->nik", root, rows.reshape(n, 3, size)).reshape(3 * n, size)
        target = right + (beside[:, None] * way).reshape(-1)
        seen = np.einsum("nij,nj->ni", root, target.reshape(n, 3)).reshape(-1)
        whole, wanted = np.concatenate([white, prior]), np.concatenate([seen, prior_right])
        information = whole.T @ whole
        inverse = np.linalg.pinv(information, rcond=1e-13, hermitian=True)
        answer = inverse @ whole.T @ wanted
        points = answer[: 3 * tools].reshape(tools, 3)
        apart = (rows @ answer - right).reshape(n, 3)
        way = np.where(beside[:, None] > 0.0, apart, way)
    off = (white @ answer - seen).reshape(n, 3)
    distance = studentised(off, white.reshape(n, 3, size), inverse)
    told = np.where(beside > 0.0, 1, 3) * once[:, 0, 0] ** -2.0
    freedom = round(float(told.sum())) + len(prior) - size
    misfit = float(((whole @ answer - wanted) ** 2).sum() / max(freedom, 1))
    covariance = inverse[: 3 * tools, : 3 * tools] * max(1.0, misfit if freedom > 0 else 1.0)
    covariance = covariance + _open(information, tools)
    length = np.linalg.norm(apart, axis=1)[:, None]
    residual = apart * (1.0 - beside[:, None] / np.maximum(length, 1e-12))
    return ToolPoints(
        points, covariance, answer[3 * tools : 3 * (tools + refs)].reshape(refs, 3), residual, misfit, freedom, distance
    )


def _prior(touches: Touches, size: int) -> tuple[Float, Float]:
    """Whitened rows (p, size) that hold the measured references, and their right side."""
    known = np.flatnonzero(np.isfinite(touches.known_mm).all(axis=1))
    first = 3 * (len(touches.tool_names) + known)
    rows = np.zeros((3 * len(known), size))
    rows[np.arange(3 * len(known)), (first[:, None] + np.arange(3)).ravel()] = 1.0
    factor = np.linalg.inv(np.linalg.cholesky(touches.known_covariance))
    return factor @ rows, factor @ touches.known_mm[known].ravel()


def _whitening(lever: Float, sigma_mm: float, sigma: float, way: Float) -> Float:
    """Inverse square roots (n, 3, 3) of the touches' covariances: position, and orientation over the lever (n, 3).

    A ball that is touched, its normal `way` (n, 3), tells what lies along that, in the first row; 0: a point.
    """
    across = (lever**2).sum(axis=1)[:, None, None] * np.eye(3) - lever[:, :, None] * lever[:, None, :]
    covariance = sigma_mm**2 * np.eye(3) + sigma**2 * across
    values, vectors = np.linalg.eigh(covariance)
    root = (vectors / np.sqrt(values)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    ball = way.any(axis=1)
    root[ball] = 0.0
    root[ball, 0] = way[ball] / np.sqrt(np.einsum("ni,nij,nj->n", way, covariance, way)[ball])[:, None]
    return np.asarray(root)


def _open(information: Float, tools: int) -> Float:
    """Covariance (3 t, 3 t) of the directions that nothing determines: as good as infinite."""
    values, vectors = np.linalg.eigh(information)
    free = vectors[: 3 * tools, values < 1e-12 * values[-1]]
    return np.asarray(1e12 * free @ free.T)


def _away_mm(found: ToolPoints, touches: Touches, row: int) -> float:
    """How far a touch lies from where a fit without it puts it."""
    frame, point = touches.base_from_flange[row], found.position_mm[touches.tool_point[row]]
    apart = np.linalg.norm(frame[:, :3] @ point + frame[:, 3] - found.reference_mm[touches.reference[row]])
    return float(abs(apart - touches.beside_mm[row]))


def worst(found: ToolPoints, k: int) -> tuple[float, Float]:
    """Greatest standard uncertainty of tool point k, and its direction (3,) in the flange."""
    values, vectors = np.linalg.eigh(found.covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3])
    return math.sqrt(max(float(values[-1]), 0.0)), vectors[:, -1]


def _check_reach(found: ToolPoints, names: tuple[str, ...], least_mm: float, where: str) -> None:
    for k, name in enumerate(names):
        reach = float(np.linalg.norm(found.position_mm[k]))
        if reach < least_mm:
            raise InputError(
                where,
                f"the tool point '{name}' would lie {reach:.3g} mm from the flange's middle, expected {least_mm:g} mm "
                "or more (least_reach_mm): are positions in mm, and the flange's?",
            )


def _tip_nearest(found: ToolPoints, names: tuple[str, ...]) -> tuple[str, ...]:
    """A warning where the tip is no farther from the flange than the point from which the axis comes."""
    tip, last = (float(np.linalg.norm(found.position_mm[k])) for k in (0, -1))
    if len(names) < 2 or tip > last:
        return ()
    return (
        f"the tip '{names[0]}', the table's first tool point, lies nearer to the flange ({tip:.0f} mm) than "
        f"'{names[-1]}' ({last:.0f} mm): is the table's order, or a name, exchanged?",
    )


def _check_determined(
    found: ToolPoints, names: tuple[str, ...], max_u_mm: float, where: str, apart: tuple[str, ...]
) -> None:
    for k, name in enumerate(names):
        u, direction = worst(found, k)
        if u > max_u_mm:
            axes = ", ".join(f"{v:+.2f}" for v in direction * np.sign(direction[np.argmax(np.abs(direction))]))
            size = "nothing determines" if u > 1e3 else f"u = {u:.2f} mm of"
            raise InputError(
                where,
                f"{size} the tool point '{name}' along ({axes}) in the flange, expected u of at "
                f"most {max_u_mm:g} mm: " + "; ".join(apart or ("turn the flange about axes across that direction",)),
            )


def _axis(found: ToolPoints, names: tuple[str, ...]) -> dict[str, object] | None:
    """The axis, towards the tip: from the last tool point of the table to its first; None for a single one."""
    if len(names) < 2:
        return None
    apart = found.position_mm[0] - found.position_mm[-1]
    length = float(np.linalg.norm(apart))
    if length < 1.0:
        raise InputError("touches", f"expected tool points 1 mm or more apart for the axis, found {length:.3f} mm")
    last = 3 * (len(names) - 1)
    pick = np.zeros((3, found.covariance.shape[0]))
    pick[:, :3], pick[:, last : last + 3] = np.eye(3), -np.eye(3)
    across = np.eye(3) - np.outer(apart, apart) / length**2
    turn = across @ pick @ found.covariance @ pick.T @ across / length**2
    return {
        "from": names[-1],
        "to": names[0],
        "direction": apart / length,
        "covariance_rad2": turn,
        "u_deg": math.sqrt(float(np.linalg.eigvalsh(turn)[-1])) / DEG,
    }


def _chapter(
    found: ToolPoints,
    touches: Touches,
    u: list[float],
    axis: dict[str, object] | None,
    verdict: str,
    warnings: tuple[str, ...],
    who: Part,
) -> Chapter:
    rows = [
        (name, *(f"{v:.3f}" for v in found.position_mm[k]), f"{u[k]:.3f}") for k, name in enumerate(touches.tool_names)
    ]
    head = ("Tool point", "x, mm", "y, mm", "z, mm", "u, least certain direction, mm")
    turned = "" if axis is None else f"Axis: u = {axis['u_deg']:.3f}° about the least certain direction. "
    html = pieces.table_html(head, rows) + pieces.paragraph(
        f"{turned}Chi-square over degrees of freedom {found.misfit:.2f} on {found.freedom}. "
        f"{verdict[:1].upper() + verdict[1:]}."
    )
    return Chapter("Tool calibration", html, summary=verdict, part=who, about="instruments", warnings=warnings)
