"""Sizes and corners of a groove along it, from both plates' lines in every profile, each with u by source."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from workbench.artefacts import Corner, Quantity, Term, kind_of
from workbench.edge.frame_order import scatter
from workbench.edge.groove_form import SURE, WALKS, likely_walk
from workbench.edge.groove_frames import Lines
from workbench.edge.groove_profile import BELOW_MM
from workbench.edge.steps import readings
from workbench.errors import InputError
from workbench.geometry.course import Course, fit_course
from workbench.geometry.curves import covered
from workbench.geometry.silhouette import CELL_MM, Ends, find_end
from workbench.units import DEG, Bool, Float, Int, Shaped

# A line over a random walk of rms e about it is turned by sqrt(18) e over its width, and off at its ends by sqrt(2) e.
WALK_TURN, WALK_OFFSET = 4.2, 1.4

WAVE_MM = 20.0  # of length, for each degree of a rough course
LEAST_DEPTH_MM = 4.0  # of a groove whose faces are not seen, for judging the levels of its plates
# Sources of uncertainty (GUM 4.2, 4.3).
FACES = "faces: range noise, form and robot position noise"
RETURNS = "where the returns end: step and footprint of the columns"
PATTERN = "fixed pattern of the columns: what every profile repeats"
DIRECTION = "direction of the groove: robot position noise and hand-eye pose"
HIDDEN = "a face that the view hides: square, or up to a bevel along the line of sight"
# Of a column's step: where in it a return is lost depends on the sensor and on what lies behind; less where the last
# returns tell how a column sees an end.
STEP_SHARE, SEEN_SHARE = 0.3, 0.12
# Of the stretch over which columns see an end in part: how far beyond the end the last return's middle may lie. By the
# fill f from which on a column returns (1 - 2 f) / (2 - 2 f); half of all sensors ask for half a column (`edge.rim`).
CUT_OFF, CUT_OFF_U = 0.17, 0.19
MOST_MIXED = 2.0  # columns by which a last return that sees an end in part is off its face's line
JOINED_STEPS = 3.0  # by which last returns of two plates differ in level where these meet
JOINED_SHARE = 1.0  # where the other plate's returns follow at once: the last one or two may be of either
END_SHARE, ROUNDED_U_MM = 0.6, 0.03  # of an upper surface that ends above a face that is not seen: its rounding too
LEAST_U_MM, LEAST_U_DEG = 1e-3, 2e-3
FORM_U_MM = 3e-3  # of a fillet's arc without its flank: by the study its radius is off by so much times the lever
LEAST_ENDS, LEAST_TOGETHER = 6, 0.25  # profiles that show an end, and their share that agrees on it
TOGETHER_STEPS, LOST_RUN, LOST_BESIDE_MM = 2.0, 4, 1.0  # ends further off are lost; so many in a row are one tack weld
LOST_PROFILES, LEAST_LOST, MOST_LOST = 31, 0.05, 0.6  # that are taken together; share of their columns without return
JUMP_PROFILES = 5  # that a sudden change of an end takes at most, and whose median noise does not move
SHOWS = 0.5  # share of the profiles that show a root face, for it to be measured
CLEAR_MM = 0.3  # by which the line of sight must clear the other plate
SURE_STEPS, SURE_FACE_MM, SURE_LEAN = 3.0, 0.5, 0.14  # a root face of this height would return so many columns
SHADOW_MM, SHADOW_COLUMNS, SHADOW_FAN = 0.3, 3.0, math.tan(3.0 * DEG)  # lower root; how near a ray; spread of the fan
GRAZING_DEG = 18.0  # between face and ray, below which a sensor may return nothing
STEEP_DEG = 5.0  # bevels begin there (ISO 9692-1, steep-flanked V)
EVEN = 0.1  # of the depth: the levels of two roots differ by more where plates are not prepared alike
UNSEEN = ("edge", "hidden")  # kinds of plates of whose faces nothing, or a fillet only, is seen
BETWEEN = 1.25  # by simulation: it goes on between two plates, and turns a line the way that it moves its end
UNTOLD = 2.0  # a gap of which a second bevel that is not seen may take half, or more, is not told
CHOSEN = 0.7  # of the noise, by which the last return of a face may be off in the mean: mixed, or let in by its error
PREPARED = ("bevel", "round", "hidden")  # kinds with a root below and inwards of the upper corner


class View(NamedTuple):
    """How the scanner stands to the groove, and what is known of the groove's direction at k stations."""

    skew: float  # tangent of the angle between the laser plane's normal and the groove
    lean: float  # how far the range axis goes right a mm upwards
    direction_u: Shaped[Float, " k"]  # rad, of the groove's direction
    tilt_u: Shaped[Float, " k"]  # rad, of the plates' about it
    ordered: bool  # whether the profiles show the order in which they were taken


class GrooveSizes:
    """Sizes and corners of a groove at stations, from both plates' lines in every profile."""

    def __init__(self, source: str, lines: list[Lines], s: Float, group: Int, at: Float, view: View) -> None:
        self.source, self.lines, self.s, self.group, self.at, self.lean = source, lines, s, group, at, view.lean
        self.ordered, self.tilt_u, u = view.ordered, view.tilt_u, view.direction_u
        self.scale_u = view.skew * u + u**2  # relative error of lengths in the section plane
        self.turn_u = view.skew * u + 0.5 * u**2  # rad, of angles, likewise
        self.sizes: dict[str, Quantity] = {}
        self.corners: dict[str, Corner] = {}
        self.upper: dict[str, tuple[_Course, _Course]] = {}
        self.slope_u: dict[str, Float] = {}  # (k,) rad, of a face's direction: by the slope of its corner's course
        self._bevel_shared = 0.0
        self.root_face_seen = self.root_face_excluded = False
        self.shadowed = False  # whether one root lies in the other plate's shadow
        self.high = 0.0  # mm by which the right root's upper edge lies above the left one's
        self.uneven = math.nan  # that, over the greater depth; NaN: one plate is not prepared, or a root not seen

    @property
    def hidden_deg(self) -> float:
        """The greatest angle at which a face may fall inwards, below an upper surface's end, without returns.

        One that leans away from the rays; or one that they graze, or that is as dark as the other plate's bevel may be
        bright, as far as columns beyond the end return nothing.
        """
        leans = zip(self.leans, self.lines, strict=True)
        dark = max(
            (90.0 - typical(one.plate - one.face) / DEG for one in self.lines if one.kind == "bevel"), default=0.0
        )
        shown = [typical(one.corner[:, 1] - one.last[:, 1]) for one in self.lines if one.kind not in UNSEEN]
        depth = max((one for one in shown if one > 0.0), default=LEAST_DEPTH_MM)
        return max(
            (
                math.atan(lean) / DEG + min(math.atan(one.missing / depth) / DEG, max(GRAZING_DEG, dark))
                for lean, one in leans
                if one.kind == "edge"
            ),
            default=0.0,
        )

    @property
    def leans(self) -> tuple[float, float]:
        """Tangent of the angle by which the view leans over each plate: what falls inwards more steeply is hidden."""
        return -self.lean, self.lean

    @property
    def hides_bevels(self) -> bool:
        """Whether a plate of which nothing is seen below its upper surface may have a bevel."""
        return self.hidden_deg > STEEP_DEG

    def measure(self, doubtful: bool) -> None:
        """Fill `sizes` and `corners`; doubtful: nobody said that a face which is not seen is square."""
        left, right = self.lines
        ends = [typical(one.edge_step) if one.kind in UNSEEN else 0.0 for one in self.lines]
        edge_u = math.hypot(*map(_edge_u, self.lines))
        hidden = np.zeros(self.at.size)
        # From the other plate's corner: the sections' origin, midway between both, follows half of a false end.
        towards = left.corner[:, 0] + right.corner[:, 0]
        for one, end in zip(self.lines, ends, strict=True):
            if end:  # a tack weld, or lost returns, hide the end of an upper surface in some profiles
                near = self._together(towards, np.isfinite(towards) & np.isfinite(self.s), 2.0 * end, end)
                one.corner[~near] = np.nan
                hidden[~covered(np.where(near, self.s, np.nan), self.group, self.at)] = np.nan
        self.lines = [self._turned(name, one) for name, one in zip(("left", "right"), self.lines, strict=True)]
        left, right = self.lines
        wide = [one.corner_variance[:, 0] for one in self.lines]
        width = self._course(-right.corner[:, 0] - left.corner[:, 0], wide[0] + wide[1])
        shared = self._shared(*wide)
        walked = math.hypot(shared, *(self._corner_walk(one) for one in self.lines))
        self._mm("width_mm", width.value + hidden, width.u, edge_u, walked)
        step = self._course(
            right.corner[:, 1] - left.corner[:, 1], left.corner_variance[:, 1] + right.corner_variance[:, 1]
        )
        turned = [math.hypot(one.form_turn, self._turned_by_walk(one.plate_mm)) for one in self.lines]
        lever = np.abs(width.value) * np.hypot(self.tilt_u, 0.5 * math.hypot(*turned))
        plates = [math.hypot(self._walked(one.plate_mm), one.form_mm) for one in self.lines]
        between = math.sqrt(BETWEEN * self.walk * max(typical(np.abs(width.value)), 0.0))
        high = math.hypot(self._shared(*(one.corner_variance[:, 1] for one in self.lines)), *plates, between)
        self._mm("misalignment_mm", step.value, np.hypot(step.u, lever), 0.0, high)
        self.misalignment = step.value
        falls = [self._fall(name, one) for name, one in zip(("left", "right"), self.lines, strict=True)]
        both = [fall for fall in falls if fall is not None]
        if len(both) == 2:
            value = self._course(
                math.pi + right.face + left.face,
                left.face_variance + right.face_variance,
                0.5 * (left.face_s + right.face_s),
            )
            self._deg(
                "included_deg",
                value.value,
                value.u,
                math.hypot(
                    self._shared(left.face_variance, right.face_variance),
                    *(self._turned_by_walk(one.face_mm) for one in self.lines),
                    *(self._chosen(one) for one in self.lines),
                ),
                ("left", "right"),
            )
        elif both and "hidden" not in (left.kind, right.kind) and not (doubtful and self.hides_bevels):
            self._deg(
                "included_deg",
                math.pi / 2 - both[0][0],
                both[0][1],
                self._bevel_shared,
                (("left", "right")[falls.index(both[0])],),
            )
        roots = [self._root(one, fall) for one, fall in zip(self.lines, falls, strict=True)]
        roots = self._lit(roots, typical(width.value), typical(step.value))
        roots = self._unlit(roots)
        depths = [root for root, one in zip(roots, self.lines, strict=True) if one.kind in PREPARED]
        if depths:
            n = len(depths)
            self._mm(
                "depth_mm",
                np.asarray(sum(d.depth for d in depths)) / n,
                np.sqrt(sum(d.depth_u**2 for d in depths)) / n,
                sum(d.depth_end for d in depths) / n,  # by one sensor, alike at both
                high,
            )
        square = [typical(one.corner[:, 1] - one.last[:, 1]) for one in self.lines if one.kind == "square"]
        told = [depth for depth in (*square, *(typical(d.depth) for d in depths)) if math.isfinite(depth)]
        self.depth = max(told, default=LEAST_DEPTH_MM)
        self._mm(
            "gap_mm",
            width.value + hidden - sum(r.run for r in roots),
            np.sqrt(width.u**2 + sum(r.run_u**2 for r in roots)),
            math.hypot(sum(r.run_end for r in roots), edge_u),
            math.hypot(shared, *(self._face_walk(one) for one in self.lines)),
        )
        self._unseen(roots, falls, max(told, default=math.inf), typical(width.value), doubtful)
        round_ = [one for one in self.lines if one.kind in ("round", "hidden")]
        if round_:
            radius = [self._course(one.fillets.radius, one.fillets.variances()[0]) for one in round_]
            n = len(radius)
            arc_lever = max(typical(one.radius_lever) if one.kind == "hidden" else 0.0 for one in round_)
            self._mm(
                "root_radius_mm",
                np.asarray(sum(r.value for r in radius)) / n,
                np.sqrt(sum(r.u**2 for r in radius)) / n,
                0.0,
                self._shared(*(one.fillets.variances()[0] for one in round_)) / n,
                math.hypot(FORM_U_MM * arc_lever, *(one.fillets.form_u()[0] / n for one in round_)),
            )
        self._corners(roots)
        self._root_faces(roots)

    def _unseen(
        self,
        roots: list[_Root],
        falls: list[tuple[Float, Float] | None],
        depth_mm: float,
        width_mm: float,
        doubtful: bool,
    ) -> None:
        """Put into depth and gap what faces may do that are not seen; doubtful: as `measure`."""
        unlit = [root for root in roots if root.unlit_depth]
        for root in unlit:
            self._hidden("depth_mm", 0.5 * root.unlit_depth)  # the mean of two
            self._hidden("gap_mm", root.unlit_run)
        gap = typical(self.sizes["gap_mm"].value)
        if doubtful and self.hides_bevels:
            reach = min(depth_mm * (math.tan(self.hidden_deg * DEG) + SHADOW_FAN), width_mm)  # inwards
            self._hidden("gap_mm", reach)
            if "depth_mm" in self.sizes and not gap > reach:  # it may hide the root that is seen
                self._untold("depth_mm")
            if any(one.kind == "bevel" for one in self.lines) and not gap > UNTOLD * reach:
                self._untold("gap_mm")
        elif doubtful and not unlit:
            beneath = self._beneath()
            if any(beneath):
                self._hidden("depth_mm", beneath[0])
                self._hidden("gap_mm", beneath[1])
        if gap > 0.0 and None not in falls and any(self._joined(one) is not None for one in self.lines):
            # A thin weld between the ends: without it the bevels go on until they meet.
            self._hidden("gap_mm", gap)
            self._hidden("depth_mm", gap / sum(1.0 / math.tan(typical(fall[0])) for fall in falls if fall))

    def _hidden(self, name: str, reach_mm: float) -> None:
        """Put into a size's u that a face which is not seen may reach so far."""
        size = self.sizes[name]
        hidden = Term(HIDDEN, kind_of(HIDDEN), reach_mm / math.sqrt(3.0))
        self.sizes[name] = replace(size, terms=(*size.terms, hidden))

    def _untold(self, name: str) -> None:
        self.sizes[name] = replace(self.sizes[name], value=np.full(self.at.size, np.nan))

    def _beneath(self) -> tuple[float, float]:
        """How far a face that is not seen below the upper one of two uneven roots may change depth and gap, mm.

        It may be the lower one of two bevels, down to the level of the other root; steeper, so that the view hides it.
        """
        if not self.uneven > EVEN:
            return 0.0, 0.0
        upper = 1 if self.high > 0.0 else 0
        high, one = abs(self.high), self.lines[upper]
        hidden = math.atan(max(self.leans[upper], 0.0)) + min(math.atan(one.missing / high), GRAZING_DEG * DEG)
        seen = bool(np.isfinite(one.root_a).mean() > SHOWS) or hidden < STEEP_DEG * DEG
        return (0.0, 0.0) if seen else (0.5 * high, high * math.tan(hidden))

    def level_share(self) -> float:
        """How much higher one plate stands than the other, over the groove's depth."""
        return typical(np.abs(self.misalignment)) / max(self.depth, 1e-3)

    def _turned(self, name: str, one: Lines) -> Lines:
        """The lines with their directions in the section plane.

        A profile that stands obliquely goes along the groove as it crosses a face. Where the face comes nearer along
        the groove, as it does where plates drift, its line is turned: by the face's slope along the groove times how
        far the profile goes along it. The slope is that of the upper corner's course.
        """
        a, b = (self._course(one.corner[:, k], one.corner_variance[:, k]) for k in (0, 1))
        self.upper[name] = a, b
        da, db = (np.where(np.isfinite(self.s), each.smooth.slope(np.nan_to_num(self.s)), np.nan) for each in (a, b))
        plate, face = (
            angle - way * (np.cos(angle) * db - np.sin(angle) * da)
            for angle, way in ((one.plate, one.plate_way), (one.face, one.face_way))
        )
        ways = [typical(np.abs(way)) for way in (one.plate_way, one.face_way) if np.isfinite(way).any()]
        self.slope_u[name] = math.hypot(*ways) * np.hypot(a.smooth.slope_u(self.at), b.smooth.slope_u(self.at))
        return replace(one, plate=plate, face=face)

    def _course(self, value: Float, variance: Float, s: Float | None = None) -> _Course:
        """The course of single profiles' values, at s (n,) each; NaN where none that agrees with it is near."""
        s = self.s if s is None else s
        good = np.isfinite(value) & np.isfinite(self.s) & np.isfinite(s) & np.isfinite(variance)
        if good.sum() < LEAST_ENDS:
            raise InputError(
                self.source,
                f"groove: expected at least {LEAST_ENDS} profiles that show all its faces, found {good.sum()}",
            )
        spread = np.abs(value - np.median(value[good]))
        good = self._smooth(
            value, good, float(np.median(spread[good])) + 3.0 * math.sqrt(float(np.median(variance[good])))
        )
        if good.sum() < LEAST_ENDS:
            raise InputError(self.source, "groove: its faces lie at another place in every profile: no groove?")
        course = fit_course(s[good], value[good], variance[good], self.group[good])
        hidden = ~covered(np.where(good, self.s, np.nan), self.group, self.at)
        unordered = (
            0.0 if self.ordered else scatter((value - course.value(np.where(good, s, 0.0)))[good], variance[good])
        )
        return _Course(np.where(hidden, np.nan, course.value(self.at)), np.hypot(course.u(self.at), unordered), course)

    def _smooth(self, value: Float, good: Bool, step: float) -> Bool:
        """Profiles (n,) of `good` whose values lie within TOGETHER_STEPS of one smooth course."""
        wave = 3 + round(min(6.0, float(np.ptp(self.s[good])) / WAVE_MM))
        off = value - np.median(value[good])
        for degree, wide in ((0, 12.0), (1, 8.0), (3, 6.0), (wave, 4.0), (wave, 3.0)):
            near = good & (np.abs(off) < wide * max(step, 0.02))
            if near.sum() < max(LEAST_ENDS, 2 * degree):
                break
            off = value - np.polynomial.Polynomial.fit(self.s[near], value[near], degree)(self.s)
        return np.asarray(good & (np.abs(off) < TOGETHER_STEPS * step))

    def _shared(self, *variances: Float) -> float:
        """What the columns' fixed pattern leaves of the sum of single profiles' variances: standard deviation."""
        pattern = max(one.pattern for one in self.lines)
        return math.sqrt(pattern * sum(typical(v) for v in variances))

    @property
    def walk(self) -> float:
        """mm^2 a mm across, by which an error that every profile repeats grows.

        As the worse plate shows it by itself, or all faces do together, with what their noise leaves open.
        """
        worst = max(float(WALKS[np.argmax(np.exp(one.walk - one.walk.max()).sum(axis=1))]) for one in self.lines)
        return max(worst, likely_walk([one for line in self.lines for one in (line.walk, line.face_walk)]))

    def _walked(self, width_mm: float) -> float:
        """How far a line of this width lies off at its ends by such an error, mm: as (11) has it."""
        return WALK_OFFSET * math.sqrt(self.walk * width_mm / 15.0)

    def _turned_by_walk(self, width_mm: float) -> float:
        """How far it is turned, rad."""
        return WALK_TURN * math.sqrt(self.walk / (15.0 * width_mm))

    def _chosen(self, one: Lines) -> float:
        """How far a face is turned, rad, as its last returns, one at either end, are chosen by their own errors.

        A flank goes over into its fillet: its lower end is none.
        """
        if not math.isfinite(one.face_mm):
            return 0.0
        return (
            math.sqrt(1.0 if one.kind == "round" else 2.0)
            * CHOSEN
            * 0.5
            * one.face_mm
            * typical(one.face_variance)
            / one.sigma
        )

    def _corner_walk(self, one: Lines) -> float:
        """How far an upper corner lies off across the groove by such an error, mm."""
        if not math.isfinite(one.face_mm):
            return 0.0
        fall = abs(math.sin(typical(one.plate - one.face)))
        ends = 2.0 / 3.0 * one.face_mm * self._chosen(one)
        return math.hypot(self._walked(one.plate_mm), one.form_mm, self._walked(one.face_mm), ends) / max(fall, 0.3)

    def _face_walk(self, one: Lines) -> float:
        """How far a face's end lies off across the groove by such an error, mm."""
        if not math.isfinite(one.face_mm):
            return 0.0
        ends = 2.0 / 3.0 * one.face_mm * self._chosen(one)
        return math.hypot(self._walked(one.face_mm), ends) / max(abs(math.sin(typical(one.face))), 0.3)

    def _mm(self, name: str, value: Float, faces: Float, returns: float, pattern: float, form: float = 0.0) -> None:
        self.sizes[name] = Quantity.of(
            name,
            value,
            {
                FACES: np.hypot(faces, math.hypot(LEAST_U_MM, form)),
                PATTERN: np.full(value.size, pattern),
                RETURNS: np.full(value.size, returns),
                DIRECTION: np.abs(value) * self.scale_u,
            },
        )

    def _deg(self, name: str, value: Float, u: Float, pattern: float, sides: tuple[str, ...]) -> None:
        self.sizes[name] = Quantity.of(
            name,
            value / DEG,
            {
                FACES: np.hypot(u / DEG, LEAST_U_DEG),
                PATTERN: np.full(value.size, pattern / DEG),
                DIRECTION: np.hypot(len(sides) * self.turn_u, np.hypot.reduce([self.slope_u[k] for k in sides])) / DEG,
            },
        )

    def _fall(self, name: str, one: Lines) -> tuple[Float, Float] | None:
        """Angle of a bevel or flank below its plate, and u (k,), rad; None: it has none."""
        if one.kind not in ("bevel", "round"):
            return None
        fall = self._course(one.plate - one.face, one.plate_variance + one.face_variance, one.face_s)
        turns = [self._turned_by_walk(width) for width in (one.plate_mm, one.face_mm)]
        pattern = self._shared(one.plate_variance, one.face_variance)
        self._bevel_shared = math.hypot(pattern, one.form_turn, self._chosen(one), *turns)
        self._deg(f"bevel_{name}_deg", math.pi / 2 - fall.value, fall.u, self._bevel_shared, (name,))
        return fall.value, fall.u

    def _root(self, one: Lines, fall: tuple[Float, Float] | None) -> _Root:
        """The root's upper edge, from the upper corner: how far below and how far inwards."""
        zero = np.zeros(self.at.size)
        if one.kind not in PREPARED:
            return _Root(zero, zero, 0.0, zero, zero, 0.0, zero)
        off, joined = one.last - one.corner, self._joined(one)
        if one.kind != "bevel":
            low = one.corner[:, 1] - one.fillets.bottom
            depth = self._course(low, one.corner_variance[:, 1] + one.fillets.variances()[1])
            run, run_u, step = self._end(off[:, 0], one)
            end = STEP_SHARE * step if joined is None else math.hypot(JOINED_SHARE * step, joined)
            depth_u = np.hypot(depth.u, one.fillets.form_u()[1])
            return _Root(depth.value, depth_u, 0.0, run, run_u, end, depth.value)
        if fall is None:
            raise AssertionError("a bevel has an angle")
        way = np.stack([np.cos(one.face), np.sin(one.face)], axis=1)
        low = (off * way).sum(axis=1)
        shown = np.isfinite(one.root_a)
        if shown.mean() > SHOWS:  # a root face is seen: the bevel ends where it meets that
            low = np.where(shown, (one.root_a - one.corner[:, 0]) / way[:, 0], np.nan)
            step = typical(one.step)
            near = self._together(low, shown & np.isfinite(self.s), step)
            far = far_u = np.full(self.at.size, np.nan)
            if near.any():
                course = self._course(np.where(near, low, np.nan), (one.sigma / way[:, 0]) ** 2)
                hidden = ~covered(np.where(near, self.s, np.nan), self.group, self.at)
                far, far_u = np.where(hidden, np.nan, course.value), course.u
            share = STEP_SHARE
        else:
            far, far_u, step = self._end(low, one)
            beyond, share = self._seen_in_part(one, off)
            far = far - (beyond if joined is None else 0.0) * step
        angle, angle_u = fall
        end = share * step if joined is None else math.hypot(JOINED_SHARE * step, joined)
        # The run in the section plane: where the plates do not stand level with each other, no plate's own is that.
        in_plane = -self._course(one.face, one.face_variance, one.face_s).value
        c, d, mean = np.cos(in_plane), np.sin(in_plane), typical(angle)
        return _Root(
            far * np.sin(angle),
            np.hypot(np.sin(angle) * far_u, np.cos(angle) * far * angle_u),
            end * math.sin(mean),
            far * c,
            np.hypot(c * far_u, d * far * angle_u),
            end * math.cos(mean),
            far * d,
        )

    def _seen_in_part(self, one: Lines, off: Float) -> tuple[float, float]:
        """How far columns still see a face beyond its end, in columns, and u; off (n, 2): last returns from its corner.

        A column of half width h that sees the end y short of its middle returns the middle of what it sees, (h - y) / 2
        beside its own: a return above the line of a falling face. With ends anywhere in a column these are off by
        L^2 / 4 columns in the mean, over L columns from the first that is not seen whole to the first that is lost.
        A face beside one that may be too dark to be seen may need a column that sees it whole: nothing is told then.
        """
        if self.hides_bevels:
            return 0.0, STEP_SHARE
        ray = np.array([self.leans[1] if one is self.lines[0] else self.leans[0], 1.0])
        ray /= np.linalg.norm(ray)
        along, up = np.cos(one.face), np.sin(one.face)
        above = along * off[:, 1] - up * off[:, 0]
        sine, cosine = np.abs(along * ray[0] + up * ray[1]), np.abs(along * ray[1] - up * ray[0])
        column = one.step * sine * cosine
        mixed = above / column
        told = mixed[np.abs(mixed) < MOST_MIXED]
        if told.size < LEAST_ENDS:
            return 0.0, STEP_SHARE
        doubt = math.hypot(float(told.std()) / math.sqrt(told.size), self._walked(one.face_mm) / typical(column))
        least, most = (2.0 * math.sqrt(max(float(told.mean()) + by, 0.0)) for by in (-doubt, doubt))
        return CUT_OFF * least, math.hypot(SEEN_SHARE, CUT_OFF_U * most)

    def _joined(self, one: Lines) -> float | None:
        """By how much (mm, u) the levels leave open where a root ends that the other plate's last return joins.

        None: they do not lie side by side in the view.
        """
        rise = self._next_up(one)
        return abs(rise) / math.sqrt(3.0) if abs(rise) <= self._joins_mm() else None

    def _next_up(self, one: Lines) -> float:
        """How far above a plate's last return the other plate's is that joins it; NaN: in most profiles none does."""
        beside = np.isfinite(one.next_up)
        return typical(one.next_up) if beside.mean() > SHOWS else math.nan

    def _joins_mm(self) -> float:
        """Levels of last returns that differ by less may be those of neighbouring columns on one surface."""
        return JOINED_STEPS * max(typical(one.step) for one in self.lines)

    def _lit(self, roots: list[_Root], width_mm: float, step_mm: float) -> list[_Root]:
        """The roots, less a lower one that the other plate may hide: its returns end beside a higher one of that.

        Or the upper root at (b, h) from the lower one lies on the line of sight that ends there, or beyond, or above
        it; (lean, 1) is the view's.
        """
        left, right = roots
        self.high = high = step_mm + typical(left.down) - typical(right.down)
        if all(one.kind in PREPARED for one in self.lines):
            self.uneven = abs(high) / max(typical(left.down), typical(right.down), 1e-3)
        apart = width_mm - typical(left.run) - typical(right.run)
        columns = SHADOW_COLUMNS * max(typical(one.edge_step) for one in self.lines)
        beyond = abs(high) > SHADOW_MM and apart - max(self.lean * high, 0.0) < columns + SHADOW_FAN * abs(high)
        for k, one in enumerate(self.lines):
            if one.kind in PREPARED and (
                self._next_up(one) > self._joins_mm() or (beyond and k == (0 if high > 0.0 else 1))
            ):
                unknown = np.full(self.at.size, np.nan)
                roots[k] = _Root(unknown, unknown, 0.0, unknown, unknown, 0.0, unknown)
                self.shadowed = True
        return roots

    def _unlit(self, roots: list[_Root]) -> list[_Root]:
        """The roots; of two bevels the shorter one ends where it is seen to, or in a shadow as deep as the other.

        Both are alike likely where no column returns as far as it would go on.
        """
        depths = [typical(root.depth) for root in roots]
        k = int(np.argmin(depths))
        short, one, lower = roots[k], self.lines[k], abs(depths[0] - depths[1])
        known = math.hypot(*(typical(root.depth_u) + root.depth_end for root in roots))
        inwards = lower * typical(short.run) / max(depths[k], 1e-3)
        if (
            any(each.kind != "bevel" or self._joined(each) is not None for each in self.lines)
            or np.isfinite(one.root_a).mean() > SHOWS
            or not SURE * known < lower
            or not inwards < one.missing
        ):
            return roots
        out = list(roots)
        out[k] = replace(
            short,
            depth=short.depth + 0.5 * lower,
            down=short.down + 0.5 * lower,
            run=short.run + 0.5 * inwards,
            unlit_depth=0.5 * lower,
            unlit_run=0.5 * inwards,
        )
        return out

    def _end(self, low: Float, one: Lines) -> tuple[Float, Float, float]:
        """Where returns end: value and u (k,), NaN where a tack weld or lost returns hide it, and the columns' step."""
        good = np.isfinite(low) & np.isfinite(self.s) & np.isfinite(one.step)
        good = self._together(low, good, typical(one.step))
        if not good.any():
            return np.full(self.at.size, np.nan), np.full(self.at.size, np.nan), typical(one.step)
        return self._silhouette(low, one.step, one.lost[:, 0], one.sigma, good)

    def _together(self, low: Float, good: Bool, step: float, column: float | None = None) -> Bool:
        """Profiles (n,) whose ends follow one smooth course: a tack weld, or lost returns, end a face earlier.

        Single ends lie about it by a step, those of many profiles by a column (mm; None: as much). None where too few
        agree: the end is then not measured.
        """
        if good.sum() < LEAST_ENDS:
            return np.zeros(good.size, bool)
        near = self._smooth(low, good & ~self._cut_off(low, good, TOGETHER_STEPS * (column or step)), step)
        order = np.flatnonzero(good)[np.argsort(self.s[good], kind="stable")]
        lost = ~near[order]
        run = np.convolve(lost, np.ones(LOST_RUN), "same") >= LOST_RUN  # its flanks hide the end in part
        for place in self.s[order][run]:
            near &= np.abs(self.s - place) > LOST_BESIDE_MM
        enough = near.sum() >= max(LEAST_ENDS, LEAST_TOGETHER * good.sum())
        return np.asarray(near & enough)

    def _cut_off(self, low: Float, good: Bool, jump: float) -> Bool:
        """Profiles (n,) of stretches that begin or end where a face suddenly ends earlier, by more than `jump` mm.

        Plates end in smooth curves; returns that are lost over a block of profiles and columns do not. The larger part
        of a pass stays: beside spatter that makes a face longer it is what ends earlier.
        """
        found = np.zeros(good.size, bool)
        for one in np.unique(self.group[good]):
            mine = np.flatnonzero(good & (self.group == one))
            mine = mine[np.argsort(self.s[mine], kind="stable")]
            if mine.size < 2 * JUMP_PROFILES:
                continue
            even = scipy.ndimage.median_filter(low[mine], JUMP_PROFILES, mode="nearest")
            change = even[JUMP_PROFILES:] - even[:-JUMP_PROFILES]  # between places on both sides of a profile
            way = self.s[mine][JUMP_PROFILES:] - self.s[mine][:-JUMP_PROFILES]
            apart = float(np.median(change / np.maximum(way, 1e-6)))  # of plates that run together or apart
            change -= apart * way
            even -= apart * self.s[mine]
            steep = np.abs(change) > jump
            first = np.flatnonzero(steep & ~np.r_[False, steep[:-1]])
            last = np.flatnonzero(steep & ~np.r_[steep[1:], False])
            cuts = [
                a + int(np.argmax(np.abs(change[a : b + 1]))) + JUMP_PROFILES // 2
                for a, b in zip(first, last, strict=True)
            ]
            pieces = np.split(np.arange(mine.size), [cut + 1 for cut in cuts])
            level = [float(np.median(even[piece])) for piece in pieces]
            for k, piece in enumerate(pieces):
                beside = max(level[max(k - 1, 0) : k + 2])
                if level[k] < beside - jump and piece.size <= mine.size / 2:
                    found[mine[piece]] = True
        return found

    def _silhouette(self, low: Float, step: Float, lost: Float, sigma: float, good: Bool) -> tuple[Float, Float, float]:
        order = np.flatnonzero(good)[np.argsort(self.s[good], kind="stable")]
        s, low, step = self.s[order], low[order], step[order]
        missing = _nearby(lost[order])
        short = missing / (1.0 - missing)  # columns without return before the end, in the mean
        rough = fit_course(s, low + (0.5 + short) * step, (1.0 / 12.0 + short) * step**2 + sigma**2, self.group[order])
        ends = Ends(
            s,
            low,
            step,
            np.full(s.size, sigma),
            missing,
            np.ones(s.size),
            np.full(s.size, np.nan),
            np.full(s.size, np.nan),
            np.zeros(s.size),
            np.full(s.size, np.nan),
        )
        found = find_end(ends, rough)
        near = np.full(self.s.size, np.nan)
        near[order] = s
        hidden = ~covered(near, self.group, self.at)
        for place in found.s[found.contradicted]:
            hidden |= np.abs(self.at - place) < CELL_MM
        value = np.where(hidden, np.nan, found.course.value(self.at))
        said = readings(found.s, found.middle, found.middle_u, found.course, self.at)
        u = np.sqrt(found.course.u(self.at) ** 2 + said.u_mm**2)
        return value + said.shift_mm, u, float(np.median(step))

    def _corners(self, roots: list[_Root]) -> None:
        """Upper corners from their own courses; roots from these."""
        for name, one, root, mirror in zip(("left", "right"), self.lines, roots, (1.0, -1.0), strict=True):
            a, b = self.upper[name]
            place = np.stack([a.value, b.value], axis=1)
            end = _edge_u(one)
            u = np.stack([np.hypot(a.u, math.hypot(end, LEAST_U_MM)), np.hypot(b.u, LEAST_U_MM)], axis=1)
            self.corners[f"{name}_upper"] = Corner(place * [mirror, 1.0], u)
            if one.kind in PREPARED:
                low = place + np.stack([root.run, -root.down], axis=1)
                low_u = np.stack(
                    [
                        np.sqrt(u[:, 0] ** 2 + root.run_u**2 + root.run_end**2 + root.unlit_run**2 / 3.0),
                        np.sqrt(u[:, 1] ** 2 + root.depth_u**2 + root.depth_end**2 + root.unlit_depth**2 / 3.0),
                    ],
                    axis=1,
                )
                self.corners[f"{name}_root"] = Corner(low * [mirror, 1.0], low_u)

    def _root_faces(self, roots: list[_Root]) -> None:
        """Root faces that the sensor sees down to their lower edge past the other plate."""
        if self.shadowed:
            return  # what is seen below the upper root may be the other plate
        gap = typical(self.sizes["gap_mm"].value)
        for k, (name, one, root) in enumerate(zip(("left", "right"), self.lines, roots, strict=True)):
            if one.kind not in ("bevel", "round"):
                continue
            towards = self.lean if k == 0 else -self.lean  # > 0: the sensor looks at this root face
            column = typical(one.step) * abs(math.cos(typical(one.face)))
            shown = np.isfinite(one.root_a) & np.isfinite(self.s)
            if (
                one.kind == "bevel"
                and not one.is_covered
                and towards > SURE_LEAN
                and SURE_FACE_MM * towards > SURE_STEPS * column
                and shown.mean() < 0.05
            ):
                self.root_face_excluded = True
            if shown.sum() < 3 or shown.mean() < SHOWS:
                continue
            # Square to the plate's own upper surface, as the depth is: plates need not stand level.
            drop = ((one.corner - one.lowest) * np.stack([-np.sin(one.plate), np.cos(one.plate)], axis=1)).sum(axis=1)
            if gap < 2.0 * BELOW_MM and typical(drop) - typical(root.depth) < abs(self.high) + 2.0 * BELOW_MM:
                continue  # without a gap, what is seen below the upper root is the other plate
            self.root_face_seen = True
            if one.is_covered:
                continue
            good = shown & (
                np.abs(drop - np.nanmedian(drop)) < 0.15 * np.nanmedian(drop) + 4.0 * np.nanmedian(one.spacing)
            )
            if good.sum() < 3 or towards <= 0.0:
                continue
            far, far_u, step = self._silhouette(drop, one.spacing, one.lost[:, 1], one.sigma, good)
            face = far - root.depth
            clear = gap / towards - typical(np.abs(self.misalignment))
            if typical(face) < 2.0 * BELOW_MM or typical(face) + CLEAR_MM > clear:
                continue
            size = f"root_face_{name}_mm"
            self._mm(size, face, np.hypot(far_u, root.depth_u), math.hypot(STEP_SHARE * step, root.depth_end), 0.0)
            upper = self.corners[f"{name}_root"]
            u = np.stack([upper.u_mm[:, 0], np.hypot(upper.u_mm[:, 1], self.sizes[size].u)], axis=1)
            self.corners[f"{name}_lower"] = Corner(upper.section_mm - np.stack([0.0 * face, face], axis=1), u)


class _Course:
    """Values along the groove and their u (k,), at its stations."""

    def __init__(self, value: Float, u: Float, smooth: Course) -> None:
        self.value, self.u, self.smooth = value, u, smooth


@dataclass(frozen=True, slots=True, eq=False)
class _Root:
    """A root's upper edge below and inwards of the upper corner (k,), mm: value, u, and u of where the returns end.

    depth: square to the plate's own upper surface; run, down: in the section plane.
    """

    depth: Float
    depth_u: Float
    depth_end: float
    run: Float
    run_u: Float
    run_end: float
    down: Float
    unlit_depth: float = 0.0  # mm, by which it may lie deeper or less deep: it ends in the shadow, or does not
    unlit_run: float = 0.0


def _nearby(lost: Float) -> Float:
    """Probability (m,) that a column has no return, from the share of single profiles, in the order of the groove."""
    told = np.isfinite(lost)
    total, count = (np.convolve(of, np.ones(LOST_PROFILES), "same") for of in (np.where(told, lost, 0.0), told))
    return np.clip(np.where(count > 0, total / np.maximum(count, 1), LEAST_LOST), LEAST_LOST, MOST_LOST)


def _edge_u(one: Lines) -> float:
    """u of an upper corner, mm, where nothing is seen below it: the last return's column, and a rounding.

    Of a rounding the returns end where it turns away from the rays; the corner of its faces lies before that or behind,
    by less than it is seen to go on.
    """
    if one.kind not in UNSEEN:
        return 0.0
    return math.hypot(END_SHARE * typical(one.edge_step), ROUNDED_U_MM, one.rounded / math.sqrt(3.0))


def typical(value: Float) -> float:
    """Median of the finite values; NaN where there is none."""
    finite = value[np.isfinite(value)]
    return float(np.median(finite)) if finite.size else math.nan
