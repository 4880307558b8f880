"""A part: its recipe, what a cutter has left of it, the analytic surface that rays meet, and its exact truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import InputError
from workbench.geometry.moves import within
from workbench.geometry.poses import inverse, mapped, pose_from, rotation_from_rpy
from workbench.storage import digest_of
from workbench.strict_json import read_json
from workbench.synthetic import raycast
from workbench.synthetic.groove_truth import rounded
from workbench.synthetic.raycast import CUT_REACH_MM, CutTerms
from workbench.synthetic.recipe import Course, Part, Placement, Recipe
from workbench.synthetic.recipe_file import parse_recipe
from workbench.units import DEG, Bool, Float, Shaped

CONVERGING = 1.3  # a unit of u is at least 1/1.3 mm long wherever a cutter is
_CLEAR_MM = 0.5  # a height this far above the stock says the same as any greater one
_CUT_MM = 1e-3  # less than this below the raw surface is not cut
_STRAIGHT_MM = 0.05  # a profile that leaves its line by more is no bevel's
_LEAST_FACE_MM = 0.5  # a narrower face tells no angle


@dataclass(frozen=True, slots=True, eq=False)
class Cut:
    """What milling has left of a raw part, as heights over the plane of a bevel (dexels).

    In the section plane at u the plane starts on the end face, `root_mm` from the lower edge, at `bevel` to it; w
    counts up the plane from there, heights along its outward normal. One height is the lowest that the cutter's surface
    has reached on that line; where it lies above `stock_mm` nothing was cut. Material above a cutter that went *into*
    the part counts as removed: such a slot is deeper than it is, never shallower.
    """

    height_mm: Shaped[Float, "U W"]
    stock_mm: Shaped[Float, "U W"]  # of the raw part; -inf where the line misses it
    u_step_mm: float  # column i of lines lies at u = i u_step_mm
    w_first_mm: float
    w_step_mm: float
    root_mm: float
    bevel: float  # rad
    times: int  # how often the part was milled: every scan after it draws other random numbers

    @property
    def u(self) -> Float:
        """u (U,) of the columns."""
        return np.asarray(np.arange(self.height_mm.shape[0]) * self.u_step_mm)

    @property
    def w_mm(self) -> Float:
        """w (W,) of the rows."""
        return np.asarray(self.w_first_mm + np.arange(self.height_mm.shape[1]) * self.w_step_mm)

    def terms(self, twist: float) -> CutTerms:
        """The cut as the ray kernels see it, on an end face that turns by `twist` rad/mm."""
        height = self._even_height()
        return CutTerms(
            height,
            self.u_step_mm,
            self.w_first_mm,
            self.w_step_mm,
            self.root_mm,
            math.cos(self.bevel),
            math.sin(self.bevel),
            self._safe_share(height, abs(twist) * float(np.ptp(self.w_mm) + np.abs(self.root_mm))),
        )

    def _even_height(self) -> Float:
        """The heights, lowered in the air beside the cut face: walls there cost the rays many small steps."""
        on_face: Bool = self.height_mm < self.stock_mm
        rows, columns = np.arange(on_face.shape[1]), np.arange(len(on_face))
        first, last = np.argmax(on_face, axis=1), rows[-1] - np.argmax(np.flip(on_face, axis=1), axis=1)
        nearest = self.height_mm[columns[:, None], np.clip(rows, first[:, None], last[:, None])]
        above = np.max(self.stock_mm, axis=1, keepdims=True) + _CLEAR_MM
        neighbours = np.where(np.any(on_face, axis=1, keepdims=True), nearest, above)
        return np.minimum(self.height_mm, np.maximum(self.stock_mm + _CLEAR_MM, neighbours))

    def _safe_share(self, height: Float, turning: float) -> Float:
        """Per column 1 / (a bound on the gradient of the height over the cut face), as far as a step may go."""
        along, up = np.zeros(len(height)), np.max(np.abs(np.diff(height, axis=1)), axis=1) / self.w_step_mm
        along[:-1] = np.max(np.abs(np.diff(height, axis=0)), axis=1) / self.u_step_mm
        near = math.ceil(CONVERGING * CUT_REACH_MM / self.u_step_mm) + 1
        steepest = np.hypot(CONVERGING * (_greatest_near(along, near) + turning), _greatest_near(up, near))
        return np.asarray(1.0 / (1.05 * np.hypot(1.0, steepest)))


@dataclass(frozen=True, slots=True, eq=False)
class Workpiece:
    """A part on its table, in its clamps, before the scanner and the robot that its recipe describes."""

    recipe: Recipe
    cut: Cut | None = None  # None: as the recipe made it


def _greatest_near(values: Float, reach: int) -> Float:
    """The greatest of each value (n,) and `reach` neighbours on both sides; scipy.ndimage takes 0.3 s to import."""
    padded = np.pad(values, reach, constant_values=-np.inf)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).max(axis=1))


def profile_sizes(cut: Cut, u: Float) -> tuple[Float, Float]:
    """Root face (mm) and bevel angle (deg) at u, as cut; NaN where there is no face to speak of.

    In each section a straight line, p = p0 + slope w, is fitted to the cut profile between the root edge and the upper
    edge; the root ends where that line meets the end face, p = w tan(bevel). Where the profile is no straight line, a
    compound bevel's or a J preparation's, there is no such face.
    """
    on_face = cut.stock_mm - cut.height_mm > _CUT_MM
    count, height = on_face.sum(axis=1), np.where(on_face, cut.height_mm, 0.0)
    made = (count - 1) * cut.w_step_mm >= _LEAST_FACE_MM
    some = np.where(made, count, 1)
    mean_w, mean_p = on_face @ cut.w_mm / some, height.sum(axis=1) / some
    off_mean = np.where(on_face, cut.w_mm - mean_w[:, None], 0.0)
    slope = np.sum(off_mean * height, axis=1) / np.where(made, np.sum(off_mean**2, axis=1), 1.0)
    foot = (mean_p - slope * mean_w) / (math.tan(cut.bevel) - slope)
    root, bevel_deg = cut.root_mm + foot / math.cos(cut.bevel), (cut.bevel - np.arctan(slope)) / DEG
    off = np.where(on_face, height - mean_p[:, None] - slope[:, None] * off_mean, 0.0)
    made &= np.max(np.abs(off), axis=1) < _STRAIGHT_MM
    root[~made] = bevel_deg[~made] = np.nan
    return np.interp(u, cut.u, root), np.interp(u, cut.u, bevel_deg)


_BENDS = {"straight": raycast.STRAIGHT, "arc": raycast.ARC, "wavy": raycast.WAVY}
_ROUGHNESS_WAVES = 16


def build_surface(part: Part, seed: int = 0, cut: Cut | None = None) -> raycast.Surface:
    """The part's surface, less what was cut. `seed` draws the roughness; all else follows from the recipe."""
    curve, length = part.curve, part.length_mm
    bend = 1.0 / curve.radius_mm if curve.shape == "arc" else 0.0
    rough = _roughness(part.roughness_mm, np.random.default_rng([seed, 0x50A]))
    burrs = np.array(
        [[float(b.edge == "upper"), b.from_mm, b.to_mm, b.height_mm, b.width_mm] for b in part.burrs]
    ).reshape(-1, 5)
    twist = part.end_face_twist_deg * DEG / length
    tilt = part.end_face_tilt_deg * DEG - 0.5 * twist * length
    return raycast.Surface(
        bend=_BENDS[curve.shape],
        curvature=bend if curve.sense == "convex" else -bend,
        wave_amplitude=curve.amplitude_mm,
        wave_number=2 * math.pi / curve.wavelength_mm,
        wave_phase=curve.phase_deg * DEG,
        length=length,
        width=part.plate_width_mm,
        tilt=tilt,
        tilt_cos=math.cos(tilt),
        tilt_sin=math.sin(tilt),
        twist=twist,
        milled=part.kind == "milled",
        thickness=_course(part.thickness_mm, length),
        root=_course(part.root_mm, length),
        bevel=_course(part.bevel_deg, length, DEG),
        roughness=rough,
        rough_reach=float(np.sum(rough[:, 0])),
        burrs=burrs,
        top=part.thickness_mm.highest + sum(b.height_mm for b in part.burrs),
        relax=_safe_step(rough, burrs, abs(twist) * (part.thickness_mm.highest + raycast.OUTREACH_MM)),
        reserve=float(2 * np.sum(rough[:, 0]) + np.sum(burrs[:, 3])),
        cut=raycast.UNCUT if cut is None else cut.terms(twist),
    )


def clamp_boxes(part: Part, surface: raycast.Surface) -> Float:
    """The clamps as boxes (c, 10) for `raycast.enter_box`: each lies along its stretch's chord."""
    boxes = np.empty((len(part.clamps), 10))
    for box, clamp in zip(boxes, part.clamps, strict=True):
        ends, middle = edge_frames(surface, np.array([clamp.from_mm, clamp.to_mm])), 0.5 * (clamp.from_mm + clamp.to_mm)
        centre = edge_frames(surface, np.array([middle]))[0]
        along = (ends[:, :3, 3] - centre[:3, 3]) @ centre[:3, 1]
        box[:4] = *centre[:2, 3], *centre[:2, 1]
        box[4:] = *along, -clamp.reach_in_mm, clamp.reach_out_mm, -2.0, surface.top + clamp.height_mm
    return boxes


def edge_frames(surface: raycast.Surface, u: Float) -> Float:
    """part_from_edge (n, 4, 4) at u: origin on the lower edge; x outwards (horizontal), y along t, z up."""
    frames = np.zeros((len(u), 4, 4))
    x, y, tx, ty = raycast.edge_points(surface, np.array(u, dtype=float)).T
    frames[:, 0, 0], frames[:, 1, 0] = ty, -tx
    frames[:, 0, 1], frames[:, 1, 1] = tx, ty
    frames[:, 2, 2] = frames[:, 3, 3] = 1.0
    frames[:, 0, 3], frames[:, 1, 3] = x, y
    return frames


def end_face_axes(surface: raycast.Surface, u: Float, outward: Float, up: Float) -> tuple[Float, Float]:
    """n and m (n, 3) at u (n,): the end face's outward normal, and the direction across it from the lower edge."""
    tilt = (surface.tilt + surface.twist * u)[:, None]
    return np.cos(tilt) * outward - np.sin(tilt) * up, np.cos(tilt) * up + np.sin(tilt) * outward


def arc_length(surface: raycast.Surface, u: Float) -> Float:
    """Arc length (mm) of the lower edge from the part's start to u (ascending); u itself unless the edge is wavy."""
    if surface.bend != raycast.WAVY:
        return np.array(u, dtype=float)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    steps = np.diff(u, prepend=0.0)
    at = (u - steps)[:, None] + steps[:, None] * (nodes + 1) / 2
    steep = surface.wave_amplitude * surface.wave_number * np.cos(surface.wave_number * at + surface.wave_phase)
    return np.asarray(np.cumsum(np.sqrt(1 + steep**2) @ weights * steps / 2))


def course_values(course: raycast.CourseTerms, u: Float) -> Float:
    """A course's values at u (n,)."""
    return np.asarray(course[0] + course[1] * u + course[2] * np.sin(course[3] * u + course[4]), dtype=float)


def pose(placement: Placement) -> Float:
    """The 4x4 matrix of a placement: R = Rz(roll) Ry(pitch) Rx(yaw) (section 3 of the paper)."""
    return pose_from(rotation_from_rpy(*(angle * DEG for angle in placement.rpy_deg)), np.array(placement.position_mm))


def _course(course: Course, length: float, unit: float = 1.0) -> raycast.CourseTerms:
    slope, wave_number = (course.end - course.start) / length, 2 * math.pi / course.wavelength_mm
    return course.start * unit, slope * unit, course.amplitude * unit, wave_number, course.phase_deg * DEG


def _roughness(greatest: float, rng: np.random.Generator) -> Float:
    """Random waves of 0.7 to 20 mm, the shorter the lower, with a standard deviation of a third of `greatest`."""
    if greatest == 0.0:
        return np.zeros((0, 4))
    wavelength = np.exp(rng.uniform(math.log(0.7), math.log(20.0), _ROUGHNESS_WAVES))
    direction = rng.uniform(0, math.pi, _ROUGHNESS_WAVES)
    amplitude = np.sqrt(wavelength) / np.linalg.norm(np.sqrt(wavelength)) * math.sqrt(2) * greatest / 3
    wave = 2 * math.pi / wavelength
    phase = rng.uniform(0, 2 * math.pi, _ROUGHNESS_WAVES)
    return np.stack([amplitude, wave * np.cos(direction), wave * np.sin(direction), phase], axis=1)


def _safe_step(rough: Float, burrs: Float, turning: float) -> float:
    """1 / (a bound on |grad F|), so that a step of that share of F never jumps through a wall; 0 for a smooth part."""
    if len(rough) + len(burrs) == 0:
        return 0.0
    steepest = 2.0 * math.sqrt(np.sum((rough[:, 0] * np.hypot(rough[:, 1], rough[:, 2])) ** 2))
    if len(burrs):
        along = np.pi * burrs[:, 3] / (burrs[:, 2] - burrs[:, 1])
        steepest += np.max(np.hypot(0.86 * burrs[:, 3] / burrs[:, 4], along))
    steepest += turning
    return float(1.0 / math.hypot(1.05, steepest))


STATION_MM = 0.5
FORMAT, VERSION, DIGEST = "bevel-truth", 1, "recording_sha256"


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The part as built. Stations lie every 0.5 mm or so along the lower edge, from the part's start to its end.

    Root face (mm) and bevel angle (deg) hold in the section plane, normal to the tangent; both are NaN on a raw edge,
    and as cut on a part that was milled in simulation.
    Arc length counts from the part's start, seen or not: a measured edge begins at its first seen point.
    """

    recipe: Recipe
    arc_length_mm: Shaped[Float, " n"]
    position_mm: Shaped[Float, "n 3"]  # lower edge in the base
    tangent: Shaped[Float, "n 3"]  # t = m x n
    normal: Shaped[Float, "n 3"]  # outward normal of the root face or end face
    across: Shaped[Float, "n 3"]  # m: from the lower to the upper side
    root_mm: Shaped[Float, " n"]
    bevel_deg: Shaped[Float, " n"]
    thickness_mm: Shaped[Float, " n"]
    seen: Shaped[Bool, " n"]  # False: under a clamp, or outside the scan
    _parameter: Shaped[Float, " n"] = field(repr=False)  # u of the stations
    _surface: raycast.Surface = field(repr=False)

    def root_mm_at(self, position_mm: Float) -> Float:
        """Root face (...,) at the section of the base points (..., 3): that of the nearest point of the lower edge."""
        u = self._parameter_at(position_mm)
        if self._surface.milled:
            return course_values(self._surface.root, u)
        return np.interp(u, self._parameter, self.root_mm)

    def bevel_deg_at(self, position_mm: Float) -> Float:
        """Bevel angle (...,) at the section of the base points (..., 3)."""
        u = self._parameter_at(position_mm)
        if self._surface.milled:
            return course_values(self._surface.bevel, u) / DEG
        return np.interp(u, self._parameter, self.bevel_deg)

    def arc_length_mm_at(self, position_mm: Float) -> Float:
        """Arc length (...,) of the sections of the base points (..., 3), from the part's start."""
        u = self._parameter_at(position_mm)
        return np.interp(u, self._parameter, self.arc_length_mm)

    def seen_at(self, position_mm: Float) -> Bool:
        """Whether the station nearest to each base point (..., 3) was seen."""
        u = self._parameter_at(position_mm)
        nearest = np.rint(np.interp(u, self._parameter, np.arange(len(self._parameter)))).astype(int)
        within = (u > self._parameter[0] - STATION_MM) & (u < self._parameter[-1] + STATION_MM)
        return np.asarray(self.seen[nearest] & within)

    def _parameter_at(self, position_mm: Float) -> Float:
        part_from_base = inverse(pose(self.recipe.part.base_from_part))
        points = mapped(part_from_base, np.asarray(position_mm, dtype=float))
        u = raycast.project_all(self._surface, points.reshape(-1, 3))[:, 0]
        return np.asarray(u.reshape(points.shape[:-1]))

    def document(self) -> dict[str, Any]:
        """The content of a truth file: strict JSON, null for what is not."""
        columns = {
            name: rounded(getattr(self, name))
            for name in ("arc_length_mm", "position_mm", "tangent", "normal", "across", "root_mm", "bevel_deg")
        }
        return {
            "format": FORMAT,
            "version": VERSION,
            "frame": "base",
            "seed": self.recipe.seed,
            "kind": "milled" if np.isfinite(self.root_mm).any() else "raw",
            **columns,
            "thickness_mm": rounded(self.thickness_mm),
            "seen": self.seen.tolist(),
            "base_from_part": pose(self.recipe.part.base_from_part).tolist(),
            "flange_from_profiler": pose(self.recipe.robot.flange_from_profiler).tolist(),
            "recipe": self.recipe.model_dump(mode="json"),
        }


def build_truth(recipe: Recipe, seen_parameters: list[Float] | None = None, cut: Cut | None = None) -> Truth:
    """The truth of `recipe`, less what was cut; `seen_parameters`: where each pass's frames saw it, none: all of it."""
    part = recipe.part
    surface = build_surface(part, recipe.seed)
    u = np.linspace(0.0, part.length_mm, round(part.length_mm / STATION_MM) + 1)
    base_from_edge = pose(part.base_from_part) @ edge_frames(surface, u)
    outward, up = base_from_edge[:, :3, 0], base_from_edge[:, :3, 2]
    normal, across = end_face_axes(surface, u, outward, up)
    root, bevel_deg = _as_ordered(surface, u) if cut is None else profile_sizes(cut, u)
    return Truth(
        recipe=recipe,
        arc_length_mm=arc_length(surface, u),
        position_mm=base_from_edge[:, :3, 3],
        tangent=base_from_edge[:, :3, 1],
        normal=normal,
        across=across,
        root_mm=root,
        bevel_deg=bevel_deg,
        thickness_mm=course_values(surface.thickness, u),
        seen=seen_near(u, seen_parameters, recipe.robot.frame_pitch_mm),
        _parameter=u,
        _surface=surface,
    )


def milled_truth(workpiece: Workpiece) -> Truth:
    """The truth of a workpiece as it is now: root face and bevel angle as cut, NaN where no face was cut.

    In each section a line is fitted to the cut profile between the root edge and the upper edge; the root ends where
    it meets the end face. Between the stations both are interpolated.
    """
    return build_truth(workpiece.recipe, cut=workpiece.cut)


def _as_ordered(surface: raycast.Surface, u: Float) -> tuple[Float, Float]:
    """Root face and bevel angle (deg) at u as the recipe states them; NaN on a raw edge."""
    if not surface.milled:
        return np.full(len(u), np.nan), np.full(len(u), np.nan)
    return course_values(surface.root, u), course_values(surface.bevel, u) / DEG


def read_truth(path: str | Path) -> Truth:
    """The truth in the file `path` (format bevel-truth), built anew from its recipe.

    InputError: it is none, or the recording beside it is not the one whose truth it tells.
    """
    document = read_json(Path(path))
    recording = Path(str(path).removesuffix(".truth.json") + ".h5")
    if DIGEST in document and recording.is_file() and digest_of(recording) != document[DIGEST]:
        raise InputError(f"{path}: {DIGEST}", f"expected the digest of {recording.name}: this is another one's truth")
    if (document.get("format"), document.get("version")) != (FORMAT, VERSION):
        raise InputError(str(path), f"format '{FORMAT}', version {VERSION}")
    truth = build_truth(parse_recipe(document.get("recipe"), source=str(path)))
    seen = document.get("seen")
    if not isinstance(seen, list) or len(seen) != len(truth.seen):
        raise InputError(f"{path}: seen", f"a list of {len(truth.seen)} values, one a station")
    truth.seen[:] = seen
    return truth


def seen_near(u: Float, seen_parameters: list[Float] | None, frame_pitch_mm: float) -> Bool:
    """Stations within three quarters of the frame pitch of a frame that sees the edge."""
    if seen_parameters is None:
        return np.ones(len(u), dtype=bool)
    found = [within(u, at, 0.75 * frame_pitch_mm + 1e-9) for at in seen_parameters]
    return np.asarray(np.any(found, axis=0))
