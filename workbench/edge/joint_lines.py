"""The faces of a joint as lines in the section planes of its course, and what lengths and angles between them rest on.

A template says which faces follow each other and gives every length as a function of their lines, and of what else
is told of the joint; how a length moves with each, and so what it owes to them, is found from that function alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from workbench.artefacts import DIRECTIONS, FORM, TANGENT, Corner, Quantity, Term, kind_of
from workbench.edge.directions import wrapped
from workbench.edge.frame_order import scatter
from workbench.edge.residual_image import FaceForm
from workbench.errors import InputError
from workbench.geometry.along import between
from workbench.geometry.course import Course, fit_course
from workbench.geometry.curves import covered
from workbench.geometry.processes import ROUGH
from workbench.geometry.sections import SectionLines, crossing, on_line
from workbench.units import DEG, Bool, Float, Int, Shaped

CORNERS = "corners of the faces: range noise and robot position noise"
RETURNS = "where the returns end: step and footprint of the columns"
HIDDEN = "a face that the view hides: square, or up to a bevel along the line of sight"
LEAST_U_MM, LEAST_U_DEG = 1e-3, 2e-3
STEP_RAD, STEP_MM = 1e-4, 1e-3  # by which lines are moved, to see what follows of it
LEAST_MOVE = 0.05  # mm a mm, by which a length moves with a place, for it to rest on that
LEAST_FRAMES = 6  # that show a length
PARALLEL = 0.05  # lines whose directions differ by less, rad

Values: TypeAlias = dict[str, Float]  # by name: (N,)
Slopes: TypeAlias = dict[str, list[tuple[float, float]]]  # of a length by each line's direction (mm/rad) and place


class Along(NamedTuple):
    """Where N frames and m stations lie on the course of a joint."""

    s: Shaped[Float, " N"]  # mm; NaN: not seen
    group: Shaped[Int, " N"]  # pass of each frame
    at: Shaped[Float, " m"]
    tangent_u: Shaped[Float, " m"]  # rad, of the course's direction
    ordered: bool  # whether the frames show the order in which they were taken

    @property
    def safe(self) -> Float:
        """The frames' arc lengths (N,), 0 where they are not known."""
        return np.where(np.isfinite(self.s), self.s, 0.0)

    def near(self, value: Float) -> Float:
        """Means (m,) of values (N,), not below 0, of the frames about each station; of the nearest where none is."""
        shown = np.isfinite(self.s) & np.isfinite(value)
        station = np.rint(np.interp(self.s[shown], self.at, np.arange(self.at.size))).astype(np.int64)
        count = np.bincount(station, minlength=self.at.size)
        total = np.bincount(station, np.maximum(value[shown], 0.0), self.at.size)
        return np.interp(self.at, self.at[count > 0], total[count > 0] / count[count > 0])


class Place(NamedTuple):
    """What is known of a joint beside its lines: where returns end on a face, or a fillet lies."""

    value: Shaped[Float, " m"]  # mm, at the stations; NaN: not known
    u: Float  # by noise
    variance: Float | float = 0.0  # of single frames (N,), mm^2
    form_u: float = 0.0  # by the form of a fillet
    returns_u: Float | float = 0.0  # by where the returns end
    alike_u: float = 0.0  # by how columns see an end, alike at all of them
    column: float = 0.0  # mm by which it steps from frame to frame
    unlit: float = 0.0  # it may lie so much farther or nearer, in a shadow


@dataclass(frozen=True, slots=True, eq=False)
class FaceLine:
    """A face in every frame: its line in the section planes, its direction as a course, obliquity taken back."""

    section: SectionLines
    course: Course  # of the direction, rad
    place: Shaped[Float, "N 2"]
    angle: Shaped[Float, " N"]  # direction in each frame's section, rad

    def direction(self, along: Along) -> Float:
        """At the stations (m,), rad."""
        return self.course.value(along.at)

    def direction_u(self, along: Along) -> Float:
        """Its standard uncertainty (m,), rad."""
        of = self.section
        about = self.course.value(np.where(np.isfinite(of.s), of.s, 0.0))
        unordered = 0.0 if along.ordered else scatter(wrapped(of.angle - about), of.angle_variance)
        return np.hypot(self.course.u(along.at), unordered)


def joined(
    sections: Sequence[SectionLines], s: Float, group: Int, wander: Float, hangs: Float | None = None
) -> list[FaceLine]:
    """Faces that meet one another in this order: directions, corners by them, what their drift adds (method, eq. (7)).

    s, group (N,): as `Along` has them. wander (N, 2): of the whole joint beside its curve: poses err so, it does not
    drift. hangs (N, 2): a place on the last face; None: its corner with the one before.
    """
    own = []
    for one in sections:
        about = float(np.angle(np.nanmean(np.exp(1j * one.angle))))
        own.append(_by_pass(one.s, about + wrapped(one.angle - about), one.angle_variance, group, s))
    pairs = list(zip(sections, own, strict=True))
    meets = [meeting(a.place, of.value, b.place, on.value) for (a, of), (b, on) in pairwise(pairs)]
    meets.append(meets[-1] if hangs is None else hangs)
    return [_square(*pair, place, place - wander, s, group) for pair, place in zip(pairs, meets, strict=True)]


class _Own(NamedTuple):
    """A value in N frames as each pass shows it by itself; what obliquity adds differs between them."""

    value: Shaped[Float, " N"]
    slope: Shaped[Float, " N"]
    stiffness: tuple[Float, ...] | None  # of the courses of all passes; None: none shows it


def _by_pass(at: Float, value: Float, variance: Float | None, group: Int, s: Float) -> _Own:
    """By values (N,) at `at` (N,), in the frames' own sections at s (N,)."""
    safe, good = np.where(np.isfinite(s), s, 0.0), np.isfinite(at) & np.isfinite(value)
    course, slope, stiffness = value.copy(), np.zeros(s.size), list[Float]()
    for one in np.unique(group[good]):
        mine = group == one
        if (good & mine).sum() < 3 or np.ptp(value[good & mine]) == 0.0:
            continue
        found = fit_course(at[mine], value[mine], None if variance is None else variance[mine], group[mine])
        course[mine], slope[mine] = found.value(safe[mine]), found.slope(safe[mine])
        stiffness += found.stiffness
    return _Own(course, slope, (np.unique(np.concatenate(stiffness), axis=0),) if stiffness else None)


def _square(section: SectionLines, own: _Own, meet: Float, drifts: Float, s: Float, group: Int) -> FaceLine:
    """A face that an oblique profile sees, in the section of the frame's own s.

    meet (N, 2): a place on it; drifts (N, 2): what of that may drift along the edge.
    """
    safe = np.where(np.isfinite(s), s, 0.0)
    across = np.stack([-np.sin(own.value), np.cos(own.value)], axis=1)
    along = np.stack([np.cos(own.value), np.sin(own.value)], axis=1)
    drift = np.stack([_by_pass(s, drifts[:, k], None, group, s).slope for k in (0, 1)], axis=1)
    lever = ((section.place - meet) * along).sum(axis=1)
    turn = between(s, section.run * ((drift * across).sum(axis=1) + lever * own.slope), safe)
    moved = drift + (lever * own.slope)[:, None] * across  # of the centroid, a mm along the edge
    place = section.place - (own.slope * section.run * section.spread)[:, None] * across
    place = place - (section.s - s)[:, None] * moved
    seen = own.value + wrapped(section.angle - own.value) - turn  # passes are turned by each its own
    course = fit_course(section.s, seen, section.angle_variance, group, stiffness=own.stiffness, shared=ROUGH)
    return FaceLine(section, course, place, course.value(safe))


def advance(lines: Sequence[FaceLine]) -> Float:
    """How arc length advances over the laser plane (N, 2), mm a mm, by the runs of lines; across all of these only."""
    angle, run = (np.stack(of, axis=1) for of in zip(*((one.angle, one.section.run) for one in lines), strict=True))
    seen = np.isfinite(angle + run)
    ways = np.where(seen[..., None], np.stack([np.cos(angle), np.sin(angle)], axis=2), 0.0)
    return np.asarray(np.einsum("nik,nk->ni", np.linalg.pinv(ways, rcond=PARALLEL), np.where(seen, run, 0.0)))


def moved_by_tangent(way: Float, off: Float) -> tuple[Float, Float]:
    """By how much (N,), mm, a radian of the edge's direction moves `off` (N, 2) along and square to an upper surface.

    A frame shows its ends so far apart along the edge as `way` (N, 2), of `advance`, says; the surface turns too.
    way, off: along and square to the surface.
    """
    return np.hypot((way * off).sum(axis=1), way[:, 0] * off[:, 1]), way[:, 1] * off[:, 1]


def meeting(place: Float, angle: Float, other_place: Float, other_angle: Float) -> Float:
    """Where two lines meet (N, 2)."""
    return on_line(place, angle, crossing(place, angle, other_place, other_angle))


class JointLines:
    """All faces of a joint, with their forms."""

    def __init__(
        self,
        source: str,
        lines: Sequence[FaceLine],
        forms: Sequence[FaceForm],
        along: Along,
        between_mm: float = 0.0,
    ) -> None:
        """Between: how far the faces stand apart, where they do not all meet."""
        self.source, self.along, self.between_mm = source, along, between_mm
        self.lines, self.forms = tuple(lines), tuple(forms)

    def in_frames(self, places: Mapping[str, Place]) -> dict[str, Float]:
        """Places in the frames (N,); NaN where no station has it."""
        known = {key: 0.0 if np.isfinite(one.value).any() else math.nan for key, one in places.items()}
        safe = self.along.safe
        return {key: between(self.along.at, one.value, safe) + known[key] for key, one in places.items()}

    def lengths(
        self,
        values: Callable[[Mapping[str, Float]], Values],
        own: Slopes,
        follow: Slopes,
        ends: Mapping[str, Place],
        by_tangent: Values,
    ) -> dict[str, Quantity]:
        """All lengths, `values` of the places in the frames.

        Slopes by the lines: `own` where the places stay, and `follow` where they go with the lines, as returns do.
        by_tangent: by how much a radian of the edge's direction moves each in every frame (N,), mm.
        """
        at = {key: np.nan_to_num(place) for key, place in self.in_frames(ends).items()}  # of none no length is known
        each = values(at)
        moved = {key: values(at | {key: place + STEP_MM}) for key, place in at.items()}
        out = {}
        for name, value in each.items():
            by = {key: abs(typical(other[name] - value, 0.0)) / STEP_MM for key, other in moved.items()}
            moves = [(ends[key], move) for key, move in by.items() if move > LEAST_MOVE]
            variance = sum(move**2 * one.variance for one, move in moves)
            step = sum(move * one.column for one, move in moves)
            found = self.course(name, value, own[name], variance, step)
            out[name] = self._length(name, found, follow[name], moves, by_tangent[name])
        return out

    def _length(
        self,
        name: str,
        found: Smooth,
        slopes: list[tuple[float, float]],
        moves: Sequence[tuple[Place, float]],
        by_tangent: Float,
    ) -> Quantity:
        """A length by its course; moves: by how much it moves with each place, mm a mm."""
        square = sum((by * one.u) ** 2 for one, by in moves)
        terms = self.terms(np.sqrt(found.u**2 + square), slopes, by_tangent)
        terms[FORM] = np.hypot(terms[FORM], math.hypot(*(by * one.form_u for one, by in moves)))
        alike = sum(by * one.alike_u for one, by in moves)
        ends = np.sqrt(alike**2 + sum(np.square(by * one.returns_u) for one, by in moves))
        if np.any(ends):
            terms[RETURNS] = np.full(found.value.size, ends)
        value = np.where(np.isfinite(sum(one.value for one, _ in moves)), found.value, np.nan)
        return hidden(Quantity.of(name, value, terms), math.hypot(*(by * one.unlit for one, by in moves)))

    def slopes(self, values: Callable[[list[Float], list[Float]], Values]) -> Slopes:
        """How lengths, a function of the lines' places (N, 2) and directions (N,), move with each line: medians."""
        places, angles = [one.place for one in self.lines], [one.angle for one in self.lines]
        before = values(places, angles)
        out: Slopes = {name: [] for name in before}
        for k, one in enumerate(self.lines):
            rotated, moved = list(angles), list(places)
            rotated[k] = one.angle + STEP_RAD
            moved[k] = one.place + STEP_MM * np.stack([-np.sin(one.angle), np.cos(one.angle)], axis=1)
            by_turn, by_move = values(places, rotated), values(moved, angles)
            for name, value in before.items():
                pair = (by_turn[name] - value) / STEP_RAD, (by_move[name] - value) / STEP_MM
                out[name].append((typical(pair[0], 0.0), typical(pair[1], 0.0)))
        return out

    def course(
        self,
        name: str,
        value: Float,
        slopes: list[tuple[float, float]],
        variance: Float | float = 0.0,
        step: float = 0.0,
    ) -> Smooth:
        """A length's values (N,) along the joint.

        variance (N,): what they have beside that of the faces' places; step: by which ends of columns move them.

        NaN where no frame that agrees with it is near.

        Raises:
            InputError: too few frames show it, or agree on it.
        """
        own = sum(
            by_move**2 * one.section.offset_variance for one, (_, by_move) in zip(self.lines, slopes, strict=True)
        )
        total = np.asarray(own) + variance + 1e-10
        shown = int(np.isfinite(value + total).sum())
        if shown < LEAST_FRAMES:
            raise InputError(
                self.source, f"expected at least {LEAST_FRAMES} profiles that show {name}, found {shown}: no joint?"
            )
        course = fit_course(self.along.s, value, total, self.along.group, shared=ROUGH._replace(resolution=step))
        if course.kept.sum() < LEAST_FRAMES:
            raise InputError(self.source, f"{name} is another one in every profile: no joint?")
        left = value - course.value(self.along.safe)
        unordered = 0.0 if self.along.ordered else scatter(left, total)
        at = np.where(self.near(course.kept), course.value(self.along.at), np.nan)
        return Smooth(at, np.hypot(course.u(self.along.at), unordered))

    def near(self, shown: Bool) -> Bool:
        """Stations (m,) near frames that are `shown` (N,)."""
        return covered(np.where(shown, self.along.s, np.nan), self.along.group, self.along.at)

    def terms(self, u: Float, slopes: list[tuple[float, float]], by_tangent: Float) -> dict[str, Float]:
        """Standard uncertainties (m,) by source of a length whose course leaves u (m,)."""
        directions = [
            by_turn * one.course.u(self.along.at) for one, (by_turn, _) in zip(self.lines, slopes, strict=True)
        ]
        whole = (
            sum(one.width_mm for one in self.forms) + self.between_mm
        )  # what the sensor errs by walks on between the faces
        bent = []
        for one, (by_turn, by_move) in zip(self.forms, slopes, strict=True):
            bent.append(by_move * one.offset_u_mm * math.sqrt(whole / one.width_mm))
            bent.append(max(abs(by_turn) - 0.5 * one.width_mm * abs(by_move), 0.0) * one.turn_u)
        return {
            CORNERS: np.hypot(u, LEAST_U_MM),
            DIRECTIONS: np.hypot.reduce(directions),
            TANGENT: self.along.tangent_u * np.sqrt(self.along.near(by_tangent**2)),
            FORM: np.hypot.reduce(bent),
        }

    def turns(self, first: int, second: int) -> dict[str, Float]:
        """Standard uncertainties (m,) by source of the angle between two of the lines, deg."""
        one, other = self.lines[first], self.lines[second]
        run_a, run_b = one.section.run, other.section.run
        square = run_a**2 + run_b**2 - 2.0 * run_a * run_b * np.cos(one.angle - other.angle)
        lever = np.sqrt(self.along.near(square))
        sources = {
            DIRECTIONS: np.hypot(one.direction_u(self.along), other.direction_u(self.along)),
            TANGENT: self.along.tangent_u * lever,
            FORM: np.hypot(self.forms[first].turn_u, self.forms[second].turn_u),
        }
        terms_deg = {source: u / DEG for source, u in sources.items()}
        terms_deg[DIRECTIONS] = np.hypot(terms_deg[DIRECTIONS], LEAST_U_DEG)
        return terms_deg


class Smooth(NamedTuple):
    """Values along a joint and their u at its stations (m,)."""

    value: Float
    u: Float


def hidden(size: Quantity, reach_mm: float) -> Quantity:
    """The size, with in its u that a face which is not seen may reach so far."""
    more = (Term(HIDDEN, kind_of(HIDDEN), reach_mm / math.sqrt(3.0)),) if reach_mm else ()
    return replace(size, terms=(*size.terms, *more))


def corners(lengths: dict[str, Quantity]) -> dict[str, Corner]:
    """The corners, whose coordinates stand among the lengths as `left_root:a` and `left_root:b`, and leave them."""
    out = {}
    for name in [key.removesuffix(":a") for key in lengths if key.endswith(":a")]:
        a, b = lengths.pop(f"{name}:a"), lengths.pop(f"{name}:b")
        out[name] = Corner(np.stack([a.value, b.value], axis=1), np.stack([a.u, b.u], axis=1))
    return out


def typical(value: Float, nothing: float = math.nan) -> float:
    """Median of the finite values; `nothing` where there is none."""
    finite = value[np.isfinite(value)]
    return float(np.median(finite)) if finite.size else nothing
