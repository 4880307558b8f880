"""Sizes and corners of a groove along it, from both plates' lines in every profile, each with u by source."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Corner, Quantity
from workbench.edge.column_errors import Linearity
from workbench.edge.end_templates import EdgeCondition
from workbench.edge.fillet import FORM_U_MM
from workbench.edge.groove_plates import SHOWS, UNSEEN, Plate
from workbench.edge.groove_profile import BELOW_MM
from workbench.edge.groove_root_end import RootView, beyond
from workbench.edge.joint_lines import (
    LEAST_FRAMES,
    Along,
    JointLines,
    Place,
    Values,
    advance,
    corners,
    hidden,
    moved_by_tangent,
    typical,
)
from workbench.edge.residual_image import forms
from workbench.edge.steps import LEAST_SHARE, own_places, readings
from workbench.geometry.along import in_order
from workbench.geometry.course import fit_course
from workbench.geometry.silhouette import Ends, find_end
from workbench.units import DEG, Bool, Float

LEAST_DEPTH_MM = 4.0  # of a groove whose faces are not seen, for judging the levels of its plates
# Of a column's step: where in it a return is lost depends on the sensor and on what lies behind; less where the last
# returns tell how a column sees an end.
STEP_SHARE, SEEN_SHARE = 0.3, 0.12
MOST_MIXED = 2.0  # columns by which a last return that sees an end in part is off its face's line
JOINED_STEPS = 3.0  # by which last returns of two plates differ in level where these meet
END_SHARE, ROUNDED_U_MM = 0.6, 0.03  # of an upper surface that ends above a face that is not seen: its rounding too
# Times u of what lasts on a face, whose strength a few places tell: of Student's t with eight freedoms three of these
# hold what three of a known one do.
SURELY = 1.4
TOGETHER_STEPS = 2.0  # ends further off the others are lost, or hidden by a weld
BESIDE_COLUMNS = 1.5  # by which two ends may lie off their own places, as each is known to a column
WAVE_MM = 20.0  # of length, for each degree of a rough course
LEAST_LOST, MOST_LOST = 0.05, 0.6  # share of a face's columns without return
CLEAR_MM = 0.3  # by which the line of sight must clear the other plate
STEADY = 0.9  # share of the profiles in which two roots keep their distance: what is dark ends raggedly
SURE_STEPS, SURE_FACE_MM, SURE_LEAN = 3.0, 0.5, 0.14  # a root face of this height would return so many columns
SHADOW_MM, SHADOW_COLUMNS, SHADOW_FAN = 0.3, 3.0, math.tan(3.0 * DEG)  # lower root; how near a ray; spread of the fan
GRAZING_DEG = 18.0  # between face and ray, below which a sensor may return nothing
STEEP_DEG = 5.0  # bevels begin there (ISO 9692-1, steep-flanked V)
EVEN = 0.1  # of the depth: the levels of two roots differ by more where plates are not prepared alike
LEAST_GAP = 2.0  # times what a face that is not seen may take of it; a smaller gap is withheld
PREPARED, ROUND = ("bevel", "round", "hidden"), ("round", "hidden")  # kinds with a root, with a fillet
NAMES = ("left", "right")
EMPTY: Mapping[str, Float | float] = {}


class Section(NamedTuple):
    """The corners of a groove in n profiles."""

    at: dict[str, Float]  # (n, 2) right and up
    down: dict[str, Float]  # (n, 2) by plate: square to its upper surface
    reach: dict[str, Float]  # (n,) by plate that has a root: see `Plate.reach`
    radius: dict[str, Float]  # (n,) of fillets

    def apart(self, corner: str) -> Float:
        """From the left plate's corner to the right one's (n, 2); of a plate without a root its upper one."""
        left, right = (self.at.get(f"{one}_{corner}", self.at[f"{one}_upper"]) for one in NAMES)
        return np.asarray(right - left)

    def below(self, plate: str, corner: str, first: str = "upper") -> Float:
        """How far a corner lies below the first one, square to the plate's upper surface (n,)."""
        off = self.at[f"{plate}_{corner}"] - self.at[f"{plate}_{first}"]
        return np.asarray((off * self.down[plate]).sum(axis=1))


# Every length is this function of the corners; those that it needs must have been seen.
LENGTHS: Mapping[str, tuple[Callable[[Section], Float], tuple[str, ...]]] = {
    "width_mm": (lambda of: of.apart("upper")[:, 0], ()),
    "misalignment_mm": (lambda of: of.apart("upper")[:, 1], ()),
    "gap_mm": (lambda of: of.apart("root")[:, 0], ()),
    "depth_mm": (lambda of: np.mean([of.below(plate, "root") for plate in of.reach], axis=0), ("root",)),
    "root_radius_mm": (lambda of: np.mean([*of.radius.values()], axis=0), ("radius",)),
    "root_face_left_mm": (lambda of: of.below("left", "lower", "root"), ("left_lower",)),
    "root_face_right_mm": (lambda of: of.below("right", "lower", "root"), ("right_lower",)),
}


class GrooveSizes:
    """Sizes and corners of a groove at stations, from both plates' lines in every profile."""

    def __init__(
        self,
        source: str,
        plates: tuple[Plate, Plate],
        along: Along,
        view: tuple[float, float],
        sensor: Linearity,
        hidden_columns: float = 0.0,
        edge_condition: EdgeCondition = "unknown",
        knife: float = 0.5,
    ) -> None:
        """View: how far the range axis goes right a mm upwards, and a camera beside the sheet, as far as it is high.

        hidden_columns: standard uncertainty of all ends.

        edge_condition: of the roots; knife: probability that a bevel whose root face is not seen has none.
        """
        self.hidden_columns, self.sensor_mm = hidden_columns, sensor.rms_mm
        self.edge_condition, self.knife = edge_condition, knife
        self.plates, self.along, (self.lean, self.beside) = list(plates), along, view
        self.s, self.group, self.at = along.s, along.group, along.at
        lines = [line for one in plates for line in one.lines]
        images = tuple(image for one in plates for image in one.images)
        face_forms = [
            replace(
                one, turn_u=SURELY * one.turn_u, lower_u_mm=SURELY * one.lower_u_mm, upper_u_mm=SURELY * one.upper_u_mm
            )
            for one in (form.uncorrected for form in forms(images, self.at, sensor))
        ]
        self.right = len(plates[0].lines)  # number of the right plate's upper surface among all lines
        self.places, self.angles = [one.place for one in lines], [one.angle for one in lines]
        self.feet: dict[str, Float] = {}  # root faces that are measured: how deep they reach in each profile (n,)
        self._leave_false_ends()
        self.seen = self._section(self.places, self.angles)  # as each profile shows it, then with the ends' courses
        self.corner = [
            one.corner(self.places[mine], self.angles[mine]) for one, mine in zip(self.plates, self._mine, strict=True)
        ]
        width, gap = (typical(self.seen.apart(corner)[:, 0]) for corner in ("upper", "root"))
        apart = max(width if math.isnan(gap) else gap, 0.0)
        self.joint = JointLines(source, lines, face_forms, along, apart)
        self.misalignment = typical(self.seen.apart("upper")[:, 1])
        self.sizes: dict[str, Quantity] = {}
        self.corners: dict[str, Corner] = {}
        self.root_face_seen = self.root_face_excluded = False
        self.hides_beneath = False  # whether a steeper face below the upper root may be hidden, which is in u
        self.shadowed = False  # whether one root lies in the other plate's shadow
        self.high = 0.0  # mm by which the right root's upper edge lies above the left one's
        self.uneven = math.nan  # that, over the greater depth; NaN: one plate is not prepared, or a root not seen
        self.unlike = math.nan  # by how much the plates are prepared to different depths, over the greater one

    @property
    def _mine(self) -> tuple[slice, slice]:
        """The lines of either plate."""
        return slice(0, self.right), slice(self.right, None)

    def _leave_false_ends(self) -> None:
        """Forget the upper surfaces' ends in profiles where a tack weld, or lost returns, hide one."""
        # the sections' origin follows half an end
        towards = -self._section(self.places, self.angles).apart("upper")[:, 0]
        for k, one in enumerate(self.plates):
            if one.kind in UNSEEN:
                column = typical(one.edge_step)
                near = self._together(towards, np.isfinite(towards), 2.0 * column, column)
                own = own_places(self.s, np.where(near, towards, np.nan), one.edge_step**2 / 6.0)
                kept = np.flatnonzero(near & (own > 0.5))
                kept = kept[np.argsort(self.s[kept])]
                if kept.size:  # a column's width more or less is in u
                    off = towards - np.interp(self.s, self.s[kept], towards[kept])
                    near &= np.abs(off) < BESIDE_COLUMNS * column
                self.plates[k] = replace(one, end=np.where(near[:, None], one.end, np.nan))

    def _section(
        self, places: Sequence[Float], angles: Sequence[Float], ends: Mapping[str, Float | float] = EMPTY
    ) -> Section:
        """The corners by the lines, and by the `ends` of each plate.

        That is how far an upper surface ends beyond its edge and a fillet lies above its level (0 where nothing
        shows it), how far the face below reaches and how deep the root face does (as each profile shows it).
        """
        found = Section({}, {}, {}, {})
        tilt = 0.5 * (angles[0] - angles[self.right])
        cosine, sine = np.cos(tilt)[:, None], np.sin(tilt)[:, None]
        for one, name, mirror, mine in zip(self.plates, NAMES, (1.0, -1.0), self._mine, strict=True):
            level, face = angles[mine][0], angles[mine][-1]
            down = np.stack([np.sin(level), -np.cos(level)], axis=1)
            upper = one.corner(places[mine], angles[mine], ends.get(f"{name}:edge", 0.0))
            corners = {"upper": upper}
            if one.kind in PREPARED:
                reach = found.reach[name] = np.asarray(ends.get(f"{name}:reach", one.reach(upper, face)))
                root = corners["root"] = one.root(upper, face, reach, ends.get(f"{name}:level", 0.0))
                foot = ends.get(f"{name}:foot", self.feet.get(name))
                if foot is not None:
                    corners["lower"] = root + (foot - ((root - upper) * down).sum(axis=1))[:, None] * down
            if one.kind in ROUND:
                found.radius[name] = one.fillets.radius + ends.get(f"{name}:radius", 0.0)
            turn = np.array([[0.0, -1.0], [1.0, 0.0]]) * mirror  # of the sections' axes, with the plates
            found.at.update(
                {f"{name}_{k}": (place * cosine + place @ turn * sine) * [mirror, 1.0] for k, place in corners.items()}
            )
            found.down[name] = (down * cosine + down @ turn * sine) * [mirror, 1.0]
        return found

    def _values(self, section: Section) -> Values:
        """Every length, and right (a) and up (b) of every corner, in each profile."""
        there = {*section.at, *(["root"] if section.reach else []), *(["radius"] if section.radius else [])}
        out = {name: of(section) for name, (of, needs) in LENGTHS.items() if there.issuperset(needs)}
        return out | {
            f"{name}:{axis}": place[:, k] for name, place in section.at.items() for k, axis in enumerate("ab")
        }

    def _followed(self, places: Sequence[Float], angles: Sequence[Float]) -> Values:
        """With the ends where each profile's returns are, however its lines lie."""
        section = self._section(places, angles)
        return self._values(section) | {f"{name}:reach": reach for name, reach in section.reach.items()}

    @property
    def hidden_deg(self) -> float:
        """The greatest angle at which a face may fall inwards, below an upper surface's end, without returns.

        One that leans away from the rays; or one that they graze, or that is as dark as the other plate's bevel may be
        bright, as far as columns beyond the end return nothing.
        """
        leans = zip(self.leans, self.plates, strict=True)
        dark = max(
            (90.0 - typical(one.fall) / DEG for one in self.plates if one.kind == "bevel"),
            default=0.0,
        )
        shown = [typical(self._down(k)) for k, one in enumerate(self.plates) if one.kind not in UNSEEN]
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
        ends = self._ends()
        self.seen = self._section(self.places, self.angles, self.joint.in_frames(ends))
        ends = self._unlit(self._lit(ends))
        self.seen = self._section(self.places, self.angles, self.joint.in_frames(ends))
        deep = {name: typical(self.seen.below(name, "root")) for name in self.seen.reach}
        ends |= {f"{name}:foot": foot for k, name in enumerate(NAMES) if (foot := self._foot(k, deep)) is not None}
        self._lengths(ends)
        self._bevels(doubtful)
        square = [typical(self._down(k)) for k, one in enumerate(self.plates) if one.kind == "square"]
        depths = [depth for depth in (*square, *deep.values()) if math.isfinite(depth)]
        self.depth = max(depths, default=LEAST_DEPTH_MM)
        self._unseen(ends, max(depths, default=math.inf), doubtful)

    def _ends(self) -> dict[str, Place]:
        """What returns tell of each plate, and its fillet: as `_section` takes it, less the root faces."""
        ends, none = {}, np.zeros(self.at.size)
        for k, (name, one) in enumerate(zip(NAMES, self.plates, strict=True)):
            if one.kind in UNSEEN:
                ends[f"{name}:edge"] = Place(
                    none,
                    none,
                    one.edge_step**2 / 12.0,
                    returns_u=self._edge_u(one),
                    column=typical(one.edge_step),
                )
            if one.kind in PREPARED:
                ends[f"{name}:reach"] = self._end_of(k)
            if one.kind in ROUND:
                by_noise, (radius, level) = one.fillets.variances(), one.fillets.form_u(self.sensor_mm)
                radius = math.hypot(radius, FORM_U_MM * typical(one.radius_lever) if one.kind == "hidden" else 0.0)
                ends[f"{name}:radius"] = Place(none, none, by_noise[0], radius)
                ends[f"{name}:level"] = Place(none, none, by_noise[1], level)
        return ends

    def _lengths(self, ends: Mapping[str, Place]) -> None:
        """All lengths and corners: what the lines leave open, and what moves with the ends."""

        def values(at: Mapping[str, Float]) -> Values:
            return self._values(self._section(self.places, self.angles, at))

        by_frame = {key: np.nan_to_num(place) for key, place in self.joint.in_frames(ends).items()}
        own = self.joint.slopes(lambda places, angles: self._values(self._section(places, angles, by_frame)))
        by_tangent = self._by_tangent(self._section(self.places, self.angles, by_frame))
        self.sizes |= self.joint.lengths(values, own, self.joint.slopes(self._followed), ends, by_tangent)
        self.corners = corners(self.sizes)

    def _by_tangent(self, section: Section) -> Values:
        """By how much a radian of the edge's direction moves each length in every frame (N,), mm."""
        left, right = (self.joint.lines[mine] for mine in self._mine)
        way = advance(left) if len(left) >= len(right) else advance(right) * [-1.0, 1.0]
        wide, aside = moved_by_tangent(way, section.apart("upper"))
        lengths = {"width_mm": wide, "misalignment_mm": aside}
        lengths["gap_mm"] = moved_by_tangent(way, section.apart("root"))[0]
        for plate in section.reach:
            upper, root = (section.at[f"{plate}_{corner}"] for corner in ("upper", "root"))
            flank, lengths["depth_mm"] = moved_by_tangent(way, root - upper)
            lengths["root_radius_mm"] = np.hypot(flank, lengths["depth_mm"])
            lower = section.at.get(f"{plate}_lower", root)
            lengths[f"root_face_{plate}_mm"] = moved_by_tangent(way, lower - root)[1]
        for name, place in section.at.items():
            lengths |= dict(zip((f"{name}:a", f"{name}:b"), moved_by_tangent(way, place), strict=True))
        return lengths

    def _down(self, k: int) -> Float:
        """How far a plate's last return lies below its upper corner (n,), mm."""
        return np.asarray(self.corner[k][:, 1] - self.plates[k].last[:, 1])

    def level_share(self) -> float:
        """How much higher one plate stands than the other, over the groove's depth."""
        return abs(self.misalignment) / max(self.depth, 1e-3)

    def _bevels(self, doubtful: bool) -> None:
        """Angles of bevels and flanks: with the plates' own upper surfaces, and between both."""
        inclined = {name: k for k, name in enumerate(NAMES) if self.plates[k].kind in ("bevel", "round")}
        for name, k in inclined.items():
            self._angle(f"bevel_{name}_deg", -math.pi / 2, (0, self.right)[k], -1.0, (0, self.right)[k] + 1)
        if len(inclined) == 2:
            self._angle("included_deg", -math.pi, 1, 1.0, self.right + 1)
        elif inclined and "hidden" not in [one.kind for one in self.plates] and not (doubtful and self.hides_bevels):
            self.sizes["included_deg"] = replace(self.sizes[f"bevel_{next(iter(inclined))}_deg"], name="included_deg")

    def _angle(self, name: str, zero: float, first: int, sign: float, second: int) -> None:
        """An angle between two of the lines, from `zero` on."""
        one, other = (self.joint.lines[k] for k in (first, second))
        near = self.joint.near(np.isfinite(one.section.angle + other.section.angle))
        value = (other.direction(self.along) + sign * one.direction(self.along) - zero) / DEG
        self.sizes[name] = Quantity.of(name, np.where(near, value, np.nan), self.joint.turns(first, second))

    def _end_of(self, k: int) -> Place:
        """How far a plate's face reaches, from its upper corner."""
        one, name = self.plates[k], NAMES[k]
        reach, step, share, off, off_u = self.seen.reach[name], typical(one.step), STEP_SHARE, 0.0, 0.0
        if one.kind == "bevel" and one.shows_root_face:
            slopes = self.joint.slopes(self._followed)[f"{name}:reach"]
            found = self.joint.course("a root face", reach, slopes, one.sigma**2)
            value, u = found.value, found.u
        else:
            value, u = self._end(reach, one.step, one.lost[:, 0], one.fade, one.sigma)
            if one.kind == "bevel":
                share, (off, off_u) = SEEN_SHARE, self._beyond(k)
        joined = self._joined(one)
        if joined is not None:
            # The other plate's returns follow at once: the last one or two may be of either.
            return Place(value, u, one.sigma**2, alike_u=math.hypot(step, joined))
        return Place(value + off, u, one.sigma**2, alike_u=math.hypot(self._column_u(share) * step, off_u))

    def _column_u(self, share: float) -> float:
        """Standard uncertainty of an end, in columns: how a column sees it, and what columns do not show."""
        return math.hypot(share, self.hidden_columns)

    def _edge_u(self, one: Plate) -> Float | float:
        """u of an upper corner, mm, where nothing is seen below it: the last return's column, and a rounding.

        Of a rounding the returns end where it turns away from the rays, and of a bevel where it is too steep for
        them; the corner of the faces lies before that or behind, by less than it is seen to go on.
        """
        if one.kind not in UNSEEN:
            return 0.0
        by_column = math.hypot(self._column_u(END_SHARE) * typical(one.edge_step), ROUNDED_U_MM)
        return np.hypot(by_column, self.along.near(one.rounded) / math.sqrt(3.0))

    def _unseen(self, ends: Mapping[str, Place], depth_mm: float, doubtful: bool) -> None:
        """Put into depth and gap what faces may do that are not seen; doubtful: as `measure`."""
        gap, width = (typical(self.sizes[name].value) for name in ("gap_mm", "width_mm"))
        if doubtful and self.hides_bevels:
            reach = min(depth_mm * (math.tan(self.hidden_deg * DEG) + SHADOW_FAN), width)  # inwards
            self._hidden("gap_mm", reach)
            if "depth_mm" in self.sizes and not gap > reach:  # it may hide the root that is seen
                self._withhold("depth_mm")
            if not gap > LEAST_GAP * reach:
                self._withhold("gap_mm")
        elif doubtful and not any(end.unlit for end in ends.values()):
            beneath = self._beneath()
            self.hides_beneath = any(beneath)
            if self.hides_beneath:
                self._hidden("depth_mm", beneath[0])
                self._hidden("gap_mm", beneath[1])
        falls = [typical(one.fall) for one in self.plates if one.kind in ("bevel", "round")]
        if gap > 0.0 and len(falls) == 2 and any(self._joined(one) is not None for one in self.plates):
            # A thin weld between the ends: without it the bevels go on until they meet.
            self._hidden("gap_mm", gap)
            self._hidden("depth_mm", gap / sum(1.0 / math.tan(fall) for fall in falls))

    def _hidden(self, name: str, reach_mm: float) -> None:
        self.sizes[name] = hidden(self.sizes[name], reach_mm)

    def _withhold(self, name: str) -> None:
        self.sizes[name] = replace(self.sizes[name], value=np.full(self.at.size, np.nan))

    def _beneath(self) -> tuple[float, float]:
        """How far a face that is not seen below the upper one of two uneven roots may change depth and gap, mm.

        It may be the lower one of two bevels, down to the level of the other root; steeper, so that the view hides it.
        """
        if not self.uneven > EVEN:
            return 0.0, 0.0
        upper = 1 if self.high > 0.0 else 0
        high, one = abs(self.high), self.plates[upper]
        hidden = math.atan(max(self.leans[upper], 0.0)) + min(math.atan(one.missing / high), GRAZING_DEG * DEG)
        seen = one.shows_root_face or hidden < STEEP_DEG * DEG
        return (0.0, 0.0) if seen else (0.5 * high, high * math.tan(hidden))

    def _beyond(self, k: int) -> tuple[float, float]:
        """How far a bevel's virtual edge lies beyond where columns end, and u, mm; of a blunted one farther.

        A face beside one that may be too dark to be seen may need a column that sees it whole.
        """
        one, lean = self.plates[k], self.leans[1 - k]
        ray = np.array([lean, 1.0]) / math.hypot(lean, 1.0)
        along, up = np.cos(one.lines[-1].angle), np.sin(one.lines[-1].angle)
        off = one.last - self.corner[k]
        above = along * off[:, 1] - up * off[:, 0]
        sine, cosine = np.abs(along * ray[0] + up * ray[1]), np.abs(along * ray[1] - up * ray[0])
        column = one.step * sine * cosine
        mixed = above / column
        usable = mixed[np.abs(mixed) < MOST_MIXED]
        mean, doubt, fall = math.nan, math.nan, typical(one.fall)
        if usable.size >= LEAST_FRAMES:
            form = self.joint.forms[1 if k == 0 else -1]
            mean = float(usable.mean()) * typical(column)
            doubt = math.hypot(
                float(usable.std()) / math.sqrt(usable.size) * typical(column), typical(form.offset_u_mm)
            )
        view = RootView(
            fall,
            0.5 * math.pi - fall + math.atan(lean),
            typical(one.step),
            typical(column),
            mean,
            doubt,
            not self.hides_bevels,
        )
        return beyond(view, self.edge_condition, self.knife)

    def _joined(self, one: Plate) -> float | None:
        """By how much (mm, u) the levels leave open where a root ends that the other plate's last return joins.

        None: they do not lie side by side in the view.
        """
        rise = self._next_up(one)
        return abs(rise) / math.sqrt(3.0) if abs(rise) <= self._joins_mm() else None

    def _next_up(self, one: Plate) -> float:
        """How far above a plate's last return the other plate's is that joins it; NaN: in most profiles none does."""
        is_adjacent = np.isfinite(one.next_up)
        return typical(one.next_up) if is_adjacent.mean() > SHOWS else math.nan

    def _joins_mm(self) -> float:
        """Levels of last returns that differ by less may be those of neighbouring columns on one surface."""
        return JOINED_STEPS * max(typical(one.step) for one in self.plates)

    def _lit(self, ends: dict[str, Place]) -> dict[str, Place]:
        """The ends, less a lower one that the other plate may hide: its returns end beside a higher one of that.

        Or the upper root at (b, h) from the lower one lies on the line of sight that ends there, or beyond, or above
        it; (lean, 1) is the view's.
        """
        apart, high = (typical(of) for of in self.seen.apart("root").T)
        self.high = high
        if len(self.seen.reach) == 2:
            down = [typical(self.seen.at[f"{name}_upper"][:, 1] - self.seen.at[f"{name}_root"][:, 1]) for name in NAMES]
            self.uneven, self.unlike = (abs(off) / max(*down, 1e-3) for off in (high, down[0] - down[1]))
        columns = SHADOW_COLUMNS * max(typical(one.edge_step) for one in self.plates)
        beyond = abs(high) > SHADOW_MM and apart - max(self.lean * high, 0.0) < columns + SHADOW_FAN * abs(high)
        for k, (one, name) in enumerate(zip(self.plates, NAMES, strict=True)):
            if name in self.seen.reach and (
                self._next_up(one) > self._joins_mm() or (beyond and k == int(high <= 0.0))
            ):
                unknown = Place(np.full(self.at.size, np.nan), np.zeros(self.at.size))
                ends |= dict.fromkeys({f"{name}:reach", f"{name}:level"} & ends.keys(), unknown)
                self.shadowed = True
        return ends

    def _unlit(self, ends: dict[str, Place]) -> dict[str, Place]:
        """The ends; of two bevels the shorter one ends where it is seen to, or in a shadow as deep as the other.

        Both are alike likely where no column returns as far as it would go on; unless both ends keep their distance,
        as cut edges do, and no line of sight to there, of a camera at up to 45 deg, meets the other plate.
        """
        if self.shadowed or any(each.kind != "bevel" or self._joined(each) is not None for each in self.plates):
            return ends
        depths = [typical(self.seen.below(name, "root")) for name in NAMES]
        k = int(np.argmin(depths))
        one, lower, fall = self.plates[k], abs(depths[0] - depths[1]), typical(self.plates[k].fall)
        if one.shows_root_face or not lower > 0.0 or not lower / math.tan(fall) < one.missing:
            return ends
        level = self.plates[0].last[:, 1] - self.plates[1].last[:, 1]
        column = max(typical(each.step * np.sin(each.fall)) for each in self.plates)
        steady = self._together(level, np.isfinite(level), column, column).mean() > STEADY
        aside, up = np.abs(self.seen.at[f"{NAMES[1 - k]}_upper"] - self.seen.at[f"{NAMES[k]}_root"]).T
        if steady and typical(aside / up) > self.leans[1 - k] + self.beside + SHADOW_FAN:
            return ends
        half = 0.5 * lower / math.sin(fall)
        name = f"{NAMES[k]}:reach"
        return ends | {name: ends[name]._replace(value=ends[name].value + half, unlit=half)}

    def _together(self, low: Float, good: Bool, step: float, column: float) -> Bool:
        """Profiles (n,) of `good` whose ends follow one smooth course: a tack weld, or lost returns, end one earlier.

        Single ends lie about it by a step, those of many profiles by a column, mm. None, where too few do.
        """
        if good.sum() < LEAST_FRAMES:
            return good
        wave = 3 + round(min(6.0, float(np.ptp(self.s[good])) / WAVE_MM))
        off, near = low - np.median(low[good]), good
        for degree, wide in ((0, 12.0), (1, 8.0), (3, 6.0), (wave, 4.0), (wave, 3.0), (wave, TOGETHER_STEPS)):
            near = good & (np.abs(off) < wide * max(step, 0.02))
            if near.sum() < max(LEAST_FRAMES, 2 * degree):
                break
            off = low - np.polynomial.Polynomial.fit(self.s[near], low[near], degree)(self.s)
        return np.asarray(near & (near.sum() >= LEAST_SHARE * good.sum()))

    def _end(self, low: Float, step: Float, lost: Float, fade: Float, sigma: float) -> tuple[Float, Float]:
        """Where returns end: value and u (k,), NaN where nothing tells it."""
        good = self._together(low, np.isfinite(low + step + self.s), typical(step), typical(step))
        if good.sum() < LEAST_FRAMES:
            return np.full(self.at.size, np.nan), np.full(self.at.size, np.nan)
        order = in_order(np.where(good, self.s, np.nan))
        s, low, step, one = self.s[order], low[order], step[order], np.ones(order.size)
        known = lost[order][np.isfinite(lost[order])]
        share = min(max(float(known.mean()) if known.size else 0.0, LEAST_LOST), MOST_LOST)
        rough = fit_course(s, low + 0.5 * step, step**2 / 12.0 + sigma**2, self.group[order])
        found = find_end(Ends(s, low, step, sigma * one, share * one, fade[order], one, 0.0 * one), rough)
        said = readings(found.s, found.middle, found.middle_u, self.at, found.course)
        value = np.where(self.joint.near(good), found.course.value(self.at) + said.shift_mm, np.nan)
        return value, np.hypot(found.course.u(self.at), said.u_mm)

    def _foot(self, k: int, deep: Mapping[str, float]) -> Place | None:
        """How deep a root face reaches that the sensor sees down to its lower edge past the other plate; else None."""
        one, name = self.plates[k], NAMES[k]
        if self.shadowed or one.kind not in ("bevel", "round"):
            return None  # what is seen below the upper root may be the other plate
        gap = typical(self.seen.apart("root")[:, 0])
        towards = self.leans[1 - k]  # > 0: the sensor looks at this root face
        column = typical(one.step) * abs(math.cos(typical(one.lines[-1].angle)))
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
            return None
        # Square to the plate's own upper surface, as the depth is: plates need not stand level.
        level = one.lines[0].angle
        drop = ((self.corner[k] - one.lowest) * np.stack([-np.sin(level), np.cos(level)], axis=1)).sum(axis=1)
        if gap < 2.0 * BELOW_MM and typical(drop) - deep[name] < abs(self.high) + 2.0 * BELOW_MM:
            return None  # without a gap, what is seen below the upper root is the other plate
        self.root_face_seen = True
        if one.is_covered or towards <= 0.0:
            return None
        far, far_u = self._end(np.where(shown, drop, np.nan), one.spacing, one.lost[:, 1], 0.0 * one.fade, one.sigma)
        face, clear = typical(far) - deep[name], gap / towards - abs(self.misalignment)
        if not 2.0 * BELOW_MM <= face <= clear - CLEAR_MM:
            return None
        self.feet[name] = drop
        return Place(far, far_u, one.sigma**2, returns_u=STEP_SHARE * typical(one.spacing))
