"""What a scanning pass will tell of a bevel: predicted standard uncertainties, before anything moves.

The terms and sensitivities are those of the budget (docs/method.md, 5), and so are the engine's own functions where it
has them: what a view does not see of the broken edge, for edges of the prior (`edge.broken_end`), and the form of the
faces by the sensor's linearity (`edge.residual_image`). What averages along the edge does so over a length that was
measured on simulated parts (docs/scan_planning.md). Several passes are one likelihood.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.edge.broken_end import (
    UNLIKELY,
    beyond_of,
    together_log,
    weights,
)
from workbench.edge.column_errors import Linearity
from workbench.edge.end_templates import (
    PRIORS,
    SIZES,
    Depths,
    EdgeCondition,
    EndTemplates,
    EndView,
    Pixels,
    SeenEnd,
    end_phases,
    end_templates,
    free_depths,
    possible_pixels,
    rendered_end,
    seen_end,
)
from workbench.edge.last_returns import DEEP_MM, DEPTH_U_MM, SAMPLE_FRAMES, end_groups
from workbench.edge.lower_fillet import LIT_COLUMNS
from workbench.edge.residual_image import PLACES, SHRUNK, STRETCH_MM, FaceForm, FaceImage, SeenBy, forms
from workbench.units import DEG, Float, Shaped

# Length of edge over which the engine's courses average, mm: of an end told by column steps that drift past it, of a
# corner, of a face's direction. Medians over simulated parts (docs/scan_planning.md).
CORNER_MM, DIRECTION_MM = 6.0, 30.0
MOST_INCIDENCE = 70.0 * DEG  # of a ray on a face that is to be measured
LEAST_COLUMNS = 12  # on a face that is to be measured
RESERVE = 1.15  # over what is predicted, that nine of ten scans stay within: noise alone
DRAWS = 2  # of noise, over which what the residual image will say is averaged

UNDECLARED = Linearity()


class Joint(NamedTuple):
    """The nominal joint: one plate's bevel."""

    thickness_mm: float
    root_mm: float
    bevel: float  # rad
    raw: bool = False  # scanned before it is milled, too

    @property
    def bevel_width_mm(self) -> float:
        """Of the bevel face, in the section."""
        return (self.thickness_mm - self.root_mm) / math.cos(self.bevel)

    @property
    def section_mm(self) -> Float:
        """Corners in the section, along n and m from the lower edge: root face, bevel face, (3, 2); raw: and above."""
        back = (self.thickness_mm - self.root_mm) * math.tan(self.bevel)
        of_raw = [[0.0, self.thickness_mm]] if self.raw else []
        return np.array([[0.0, 0.0], [0.0, self.root_mm], [-back, self.thickness_mm], *of_raw])


@dataclass(frozen=True, slots=True)
class Profiler:
    """A laser line profiler as its `sensor.json` declares it; all that the prediction needs of it."""

    columns: int
    range_mm: tuple[float, float]
    width_mm: tuple[float, float]  # of the laser line at these ranges
    noise_mm: float
    noise_columns: float = 1.0
    linearity: Linearity = UNDECLARED
    triangulation: float = 0.0  # rad
    camera_side: str = "y"
    file: Path | None = None  # that told so

    @property
    def middle_mm(self) -> float:
        """The stand-off in the middle of the measuring range."""
        return 0.5 * (self.range_mm[0] + self.range_mm[1])

    def line_mm(self, range_mm: float) -> float:
        """Width of the laser line at a range."""
        return float(np.interp(range_mm, self.range_mm, self.width_mm))

    def pitch_mm(self, range_mm: float) -> float:
        """Between columns, across."""
        return self.line_mm(range_mm) / self.columns


class Knowledge(NamedTuple):
    """What is declared of robot and edge."""

    robot_noise_mm: float = 0.07
    hand_eye_turn: float = 0.0  # standard uncertainty of the laser plane's direction, rad
    edge_condition: EdgeCondition = "unknown"
    roughness_mm: float = 0.0  # of the root face, three standard deviations


class View(NamedTuple):
    """How a pass looks at the edge."""

    elevation: float  # of the scanner above the root face's normal, rad
    standoff_mm: float
    frame_pitch_mm: float
    lead: float = 0.0  # of the laser plane from the section plane, rad


class PassInformation(NamedTuple):
    """What one pass tells; variances of single frames, of frames `per_mm` along the edge."""

    view: View
    per_mm: float
    end_mm: float  # standard deviation of a frame's root face, at its end
    step_mm: float  # between columns along the root face; 0: the end is a corner with the lower surface
    lower_mm: float  # standard uncertainty of the lower surface at that corner; 0: it is not seen
    root: float  # of a frame's directions, rad
    bevel: float
    root_run: float  # mm along the edge by mm along the face
    bevel_run: float
    root_form: FaceForm
    bevel_form: FaceForm
    seen: tuple[SeenEnd, ...]  # for each of `edges_of` the prior, all templates; empty: nothing is hidden


class Predicted(NamedTuple):
    """Predicted standard uncertainties of root face, mm, and bevel angle, deg."""

    root_mm: float  # root mean square over the edges that are held possible
    bevel_deg: float
    most_root_mm: float  # by the edge of the prior that hides most


def incidences(joint: Joint, view: View) -> tuple[float, float, float]:
    """Of the rays on root face, bevel face and lower surface, rad; more than a right angle: turned away."""
    lean = math.cos(view.lead)
    of = (view.elevation, view.elevation - joint.bevel, 0.5 * math.pi + view.elevation)
    root, bevel, lower = (math.acos(max(-1.0, min(1.0, math.cos(one) * lean))) for one in of)
    return root, bevel, lower


def hidden_why(joint: Joint, profiler: Profiler, view: View) -> str | None:
    """Why a pass with this view cannot measure the joint; None: it can."""
    root, bevel, lower = incidences(joint, view)
    further = [("plate's surfaces", min(lower, math.pi - lower))] if joint.raw else []  # a raw edge ends at them
    for face, incidence in (("root face", root), ("bevel face", bevel), *further):
        if incidence > MOST_INCIDENCE:
            return f"the {face} at {incidence / DEG:.0f} deg of incidence, at most {MOST_INCIDENCE / DEG:g}"
    across, away = seen_extent_mm(joint, view)
    if room_mm(joint, profiler, view) < 0.0:
        wide = profiler.line_mm(view.standoff_mm - 0.5 * away)
        return f"a section of {across:.1f} mm across in a laser line of {wide:.1f} mm"
    near, far = profiler.range_mm
    if view.standoff_mm - 0.5 * away - MARGIN_MM < near or view.standoff_mm + 0.5 * away + MARGIN_MM > far:
        return f"{away:.1f} mm of depth about {view.standoff_mm:.0f} mm in a measuring range of {near:g} to {far:g} mm"
    pitch = profiler.pitch_mm(view.standoff_mm)
    for face, width, incidence in (("root face", joint.root_mm, root), ("bevel face", joint.bevel_width_mm, bevel)):
        if (count := width * math.cos(incidence) / pitch) < LEAST_COLUMNS:
            return f"{count:.0f} columns on the {face}, at least {LEAST_COLUMNS}"
    return None


MARGIN_MM = 1.0  # of the view, that stay free on both sides of the section


def seen_extent_mm(joint: Joint, view: View) -> tuple[float, float]:
    """How far the section reaches across the rays and along them."""
    s, c = math.sin(view.elevation), math.cos(view.elevation)
    across = joint.section_mm @ np.array([-s, c])
    away = joint.section_mm @ np.array([c, s])
    return float(np.ptp(across)), float(np.ptp(away))


def room_mm(joint: Joint, profiler: Profiler, view: View) -> float:
    """By how much the section may move across the laser line."""
    across, away = seen_extent_mm(joint, view)
    return profiler.line_mm(view.standoff_mm - 0.5 * away) - across - 2.0 * MARGIN_MM


@functools.lru_cache(maxsize=1024)
def information(
    joint: Joint, profiler: Profiler, known: Knowledge, view: View, length_mm: float
) -> PassInformation | None:
    """What one pass tells of an edge `length_mm` long; None: it cannot measure the joint (`hidden_why`).

    The range noise grows with the incidence i as 1/sqrt(cos i): less light comes back.
    """
    if hidden_why(joint, profiler, view) is not None:
        return None
    root_i, bevel_i, lower_i = incidences(joint, view)
    pitch = profiler.pitch_mm(view.standoff_mm)
    root, bevel = (
        _face(profiler, width, incidence, pitch)
        for width, incidence in ((joint.root_mm, root_i), (joint.bevel_width_mm, bevel_i))
    )
    is_corner = lower_i < MOST_INCIDENCE
    frames = min(max(round(length_mm / view.frame_pitch_mm), 1), SAMPLE_FRAMES)
    steep = abs(math.tan(view.elevation))
    place = root.place_mm * (1.0 / math.tan(joint.bevel) + (0.0 if is_corner else steep))
    tilt = math.tan(abs(view.lead))
    root_form, bevel_form = _forms((root, bevel), profiler, view, length_mm)
    return PassInformation(
        view=view,
        per_mm=1.0 / view.frame_pitch_mm,
        end_mm=math.hypot(place, bevel.place_mm / math.sin(joint.bevel)),
        step_mm=0.0 if is_corner else pitch / math.cos(view.elevation),
        lower_mm=LIT_COLUMNS * pitch if is_corner else 0.0,
        root=root.turn,
        bevel=bevel.turn,
        root_run=tilt * abs(math.sin(view.elevation)),
        bevel_run=tilt * abs(math.sin(view.elevation - joint.bevel)),
        root_form=root_form,
        bevel_form=bevel_form,
        seen=()
        if is_corner
        else _broken(joint.root_mm, profiler, known, view._replace(lead=0.0, frame_pitch_mm=0.0), frames),
    )


class _Face(NamedTuple):
    """One face in one frame."""

    width_mm: float
    incidence: float  # rad
    columns: float  # on it
    free: float  # as many that err alone
    noise_mm: float  # of a return, across the face
    place_mm: float  # standard deviation of its line's place
    turn: float  # and direction, rad


def _face(profiler: Profiler, width_mm: float, incidence: float, pitch_mm: float) -> _Face:
    count = width_mm * math.cos(incidence) / pitch_mm
    free = max(count / profiler.noise_columns, 2.0)
    noise = profiler.noise_mm * math.sqrt(math.cos(incidence))  # of the range 1/sqrt(cos), across the face cos of that
    place = noise / math.sqrt(free)
    return _Face(width_mm, incidence, count, free, noise, place, place * math.sqrt(12.0) / width_mm)


def _forms(faces: Sequence[_Face], profiler: Profiler, view: View, length_mm: float) -> list[FaceForm]:
    """What the residual images of the faces will leave open, on average over noise."""
    rng, at, total = np.random.default_rng(1), np.zeros(1), np.zeros((len(faces), 3))
    for _ in range(DRAWS):
        images = [_image(one, view, length_mm, rng) for one in faces]
        found = forms(images, at, profiler.linearity)
        total += np.square([[one.turn_u[0], one.lower_u_mm[0], one.upper_u_mm[0]] for one in found])
    rms = np.sqrt(total / DRAWS)[:, :, None]
    return [
        FaceForm(one[0], one[1], one[2], face.width_mm, *np.zeros((3, 1))) for one, face in zip(rms, faces, strict=True)
    ]


def _image(face: _Face, view: View, length_mm: float, rng: np.random.Generator) -> FaceImage:
    """A residual image of noise alone."""
    places = int(min(face.columns, PLACES))
    place = np.asarray((np.arange(places) + 0.5 - 0.5 * places) * face.width_mm / places)
    line = np.stack([np.ones(places), place / place[-1]], axis=1)
    left = np.eye(places) - line @ np.linalg.pinv(line)  # each frame's residuals are those beside its own line
    variance, lean = face.noise_mm**2 * places / face.free, 1.0 / math.cos(face.incidence)
    frames = min(length_mm, STRETCH_MM) / view.frame_pitch_mm
    mean = math.sqrt(variance / frames) * (left @ rng.normal(size=places))[None]
    alike = (1.0 - SHRUNK) * left + SHRUNK * np.diag(np.diag(left))  # as the engine takes it
    noise, of_pass = variance * alike[None] / frames, np.zeros(1, np.int64)
    ends = np.array([0.0, length_mm])
    seen = SeenBy(ends, np.zeros(2), np.zeros(2), place / lean, place * face.columns / face.width_mm, lean)
    return FaceImage(np.zeros((1, 2)), mean, noise, place, np.array([math.tan(face.incidence)]), of_pass, (seen,))


# The broken end: edges of the prior, as a pass would see them.


EVERY = 4  # of the engine's sizes that is taken


@functools.lru_cache(maxsize=8)
def _templates(condition: EdgeCondition) -> EndTemplates:
    """The engine's, by some of the sizes: what they tell on average is the same."""
    every = end_templates(PRIORS[condition])
    kinds = [np.zeros(1, np.int64)]
    kinds += [1 + kind * SIZES + np.arange(0, SIZES, EVERY) for kind in range((every.turn.size - 1) // SIZES)]
    return every.of(np.concatenate(kinds))


@functools.lru_cache(maxsize=32)
def edges_of(condition: EdgeCondition) -> tuple[float, ...]:
    """Radii, mm, of the edges that stand for the prior: in the middle of either half, and one of a hundred has more."""
    prior, templates = PRIORS[condition], end_templates(PRIORS[condition])
    round_ = (templates.turn == 0.0) & (templates.size_mm > 0.0)
    along = np.append(0.0, np.cumsum(np.exp(templates.log_prior[round_])))
    size = np.append(0.0, templates.size_mm[round_])
    return tuple(np.interp(LEVELS, prior.sharp + (1.0 - prior.sharp) * along / along[-1], size).tolist())


LEVELS = (0.25, 0.75, 0.99)


def decay_columns(noise_columns: float) -> float:
    """Over which an exponential correlation falls to 1/e whose sum over all columns is `noise_columns`."""
    return 1.0 / math.log((noise_columns + 1.0) / (noise_columns - 1.0)) if noise_columns > 1.0 else 0.0


@functools.lru_cache(maxsize=256)
def _broken(root_mm: float, profiler: Profiler, known: Knowledge, view: View, frames: int) -> tuple[SeenEnd, ...]:
    """How each edge of the prior would look in some frames, and what each template would say of that."""
    pitch = profiler.pitch_mm(view.standoff_mm)
    root = _face(profiler, root_mm, abs(view.elevation), pitch)
    step = pitch / math.cos(view.elevation)
    edges = end_groups(min(root.columns, DEEP_MM / step))
    length = profiler.linearity.length_mm / math.cos(view.elevation)
    middle = 0.5 * (edges[1:] + edges[:-1]) * step
    pattern = profiler.linearity.rms_mm**2 * (1.0 - np.exp(-np.ptp(middle) / length))
    far = np.abs(middle[:, None] - middle[None, :]) / max(length, 1e-6)
    column = np.arange(math.ceil(edges[-1]))
    share = np.maximum(np.minimum(edges[1:, None], column + 1.0) - np.maximum(edges[:-1, None], column), 0.0)
    share /= np.diff(edges)[:, None]
    alike = np.exp(-np.abs(column[:, None] - column) / max(decay_columns(profiler.noise_columns), 1e-6))
    covariance = (
        root.noise_mm**2 / frames * (share @ alike @ share.T)
        + pattern * np.exp(-far)
        + DEPTH_U_MM**2 * np.eye(middle.size)
    )
    phases = end_phases(True)
    blank = EndView(
        Depths(np.zeros(middle.size), covariance, free_depths(edges * step)),
        edges * step,
        view.elevation,
        step,
        phases,
        0.0,
        0.0,
        possible_pixels(len(phases)),
    )
    templates = _templates(known.edge_condition)
    sizes = np.array(edges_of(known.edge_condition))
    # a pixel a column wide, which returns where half of it is filled
    usual = Pixels(np.array([[1.0, 0.5, 0.0]]), np.zeros(1, np.int64), np.ones(1))
    none, most, first = np.zeros(sizes.size), np.full(sizes.size, MOST_INCIDENCE), np.zeros(sizes.size, np.int64)
    depth, shift, _ = rendered_end(blank._replace(pixels=usual), sizes, none, most, first, none)
    means = depth - blank.nearer * shift
    return tuple(seen_end(blank._replace(known=blank.known._replace(mean=mean)), templates) for mean in means)


def combined(joint: Joint, known: Knowledge, passes: Sequence[PassInformation], length_mm: float) -> Predicted:
    """What is told by all passes together, as the engine fuses them."""
    root_u = _parallel([one.root / math.sqrt(one.per_mm * DIRECTION_MM) for one in passes])
    bevel_u = _parallel([one.bevel / math.sqrt(one.per_mm * DIRECTION_MM) for one in passes])
    count = np.array([one.per_mm for one in passes])
    rounding, rounding_most, share = _rounding(known, passes, count)
    each = [_end_u_mm(one) for one in passes]
    end = _parallel([u / math.sqrt(max(w, 1e-12)) for u, w in zip(each, share, strict=True)])
    course = math.sqrt(12.0 / (count.sum() * min(length_mm, DIRECTION_MM) ** 3))  # of frames that err each for itself
    by_robot = known.robot_noise_mm * math.hypot(math.sqrt(2.0) / length_mm, course)
    tangent = math.hypot(by_robot, known.hand_eye_turn)
    by_root = np.array([one.per_mm / one.root**2 for one in passes])
    by_bevel = np.array([one.per_mm / one.bevel**2 for one in passes])
    run_r, run_b = (
        float((by * [getattr(one, name) for one in passes]).sum() / by.sum())
        for by, name in ((by_root, "root_run"), (by_bevel, "bevel_run"))
    )
    root_form = _mean_form([one.root_form for one in passes], by_root)
    bevel_form = _mean_form([one.bevel_form for one in passes], by_bevel)
    by_end = share * count / (share * count).sum()
    steep = float(by_end @ [abs(math.tan(one.view.elevation)) * (one.step_mm > 0.0) for one in passes])
    lower_mm = float(by_end @ [one.lower_mm for one in passes])
    beta = joint.bevel
    lever = 0.5 * joint.bevel_width_mm
    directions = math.hypot(lever / math.sin(beta) * bevel_u, 0.5 * joint.root_mm / math.tan(beta) * root_u)
    corner = (root_form[2] / math.tan(beta), root_form[1] * steep, bevel_form[1] / math.sin(beta))
    leverage = math.sqrt(max(run_r**2 + run_b**2 - 2.0 * run_r * run_b * math.cos(beta), 0.0))
    seen = math.hypot(end, directions, tangent * run_r * joint.root_mm, lower_mm, *corner)
    bevel = math.hypot(root_u, bevel_u, tangent * leverage, root_form[0], bevel_form[0])
    return Predicted(math.hypot(seen, rounding), bevel / DEG, math.hypot(seen, rounding_most))


def _parallel(u: Sequence[float]) -> float:
    """Standard uncertainty of the weighted mean of independent values."""
    return 1.0 / math.sqrt(sum(1.0 / one**2 for one in u))


def _end_u_mm(one: PassInformation) -> float:
    """Of the end's course by one pass whose columns drift past it.

    A frame whose noise is below a column's step tells the end where a step passes it: in d/noise of the frames, to the
    noise.
    """
    return math.sqrt(one.end_mm**2 + one.end_mm * one.step_mm) / math.sqrt(one.per_mm * CORNER_MM)


def _rounding(known: Knowledge, passes: Sequence[PassInformation], count: Float) -> tuple[float, float, Float]:
    """What passes with `count` (k,) frames leave open of the broken end, mm: over the prior (rms), and at most.

    And the passes' weights (k,).
    """
    hidden = _hidden_u_mm(known, passes)
    share = weights(np.zeros(len(passes)), np.sqrt(np.mean(hidden**2, axis=0)))
    left = hidden @ (share * count) / (share * count).sum()
    return float(np.sqrt(np.mean(left[:-1] ** 2))), float(left.max()), share


def _hidden_u_mm(known: Knowledge, passes: Sequence[PassInformation]) -> Float:
    """What each pass leaves open of the broken end, given all, for each edge of the prior: (e, k)."""
    out = np.zeros((len(edges_of(known.edge_condition)), len(passes)))
    blind = [k for k, one in enumerate(passes) if one.seen]
    if not blind:
        return out
    prior = _templates(known.edge_condition).log_prior[:, None]
    for number in range(len(out)):
        seen = [passes[k].seen[number] for k in blind]
        log = prior + together_log(seen)
        share = np.exp(log - log.max())
        share[share.sum(axis=1) < EVERY * UNLIKELY * share.sum()] = 0.0  # as the engine cuts its templates finer
        share /= share.sum()
        for k, one in zip(blind, seen, strict=True):
            out[number, k] = beyond_of(share, one)[1]
    return out


def _mean_form(form: Sequence[FaceForm], weight: Shaped[Float, " k"]) -> Float:
    """Turn, and place at the lower and the upper end (3,), of a face that several passes see: what lasts stays."""
    each = np.array([[one.turn_u[0], one.lower_u_mm[0], one.upper_u_mm[0]] for one in form])
    return np.asarray(np.sqrt(weight @ each**2 / weight.sum()))
