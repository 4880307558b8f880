"""Sizes and corners of a groove along it, from both plates' lines in every profile, each with u by source."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from workbench.artefacts import FORM, Corner, Quantity, Term, kind_of
from workbench.edge.fillet import FORM_U_MM
from workbench.edge.groove_plates import UNSEEN, Plate
from workbench.edge.groove_profile import BELOW_MM
from workbench.edge.joint_lines import RETURNS, Along, JointLines, Smooth, Values, typical
from workbench.edge.residual_image import Linearity, forms
from workbench.edge.steps import readings
from workbench.errors import InputError
from workbench.geometry.course import fit_course
from workbench.geometry.curves import covered
from workbench.geometry.silhouette import CELL_MM, Ends, find_end
from workbench.units import DEG, Bool, Float

LEAST_DEPTH_MM = 4.0  # of a groove whose faces are not seen, for judging the levels of its plates
# A source of uncertainty (GUM 4.2, 4.3), beside those of every joint.
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
# Times u of what lasts on a face, whose strength a few places tell: of Student's t with eight freedoms three of these
# hold what three of a known one do.
SURELY = 1.4
CHOSEN = 0.7  # of the noise, by which the last return of a face may be off in the mean: mixed, or let in by its error
LEAST_ENDS = 6  # profiles that show an end
TOGETHER_STEPS = 2.0  # ends further off the others are lost, or hidden by a weld
JUMP_PROFILES = 5  # that a sudden change of an end takes at most, and whose median noise does not move
WAVE_MM = 20.0  # of length, for each degree of a rough course
LOST_PROFILES, LEAST_LOST, MOST_LOST = 31, 0.05, 0.6  # that are taken together; share of their columns without return
SHOWS = 0.5  # share of the profiles that show a root face, for it to be measured
CLEAR_MM = 0.3  # by which the line of sight must clear the other plate
SELDOM = 0.01  # probability below which a difference of depths is taken for noise
SURE_STEPS, SURE_FACE_MM, SURE_LEAN = 3.0, 0.5, 0.14  # a root face of this height would return so many columns
SHADOW_MM, SHADOW_COLUMNS, SHADOW_FAN = 0.3, 3.0, math.tan(3.0 * DEG)  # lower root; how near a ray; spread of the fan
GRAZING_DEG = 18.0  # between face and ray, below which a sensor may return nothing
STEEP_DEG = 5.0  # bevels begin there (ISO 9692-1, steep-flanked V)
EVEN = 0.1  # of the depth: the levels of two roots differ by more where plates are not prepared alike
UNTOLD = 2.0  # a gap of which a face that is not seen may take half, or more, is not told
PREPARED = ("bevel", "round", "hidden")  # kinds with a root below and inwards of the upper corner
NAMES = ("left", "right")


class GrooveSizes:
    """Sizes and corners of a groove at stations, from both plates' lines in every profile."""

    def __init__(
        self,
        source: str,
        plates: tuple[Plate, Plate],
        along: Along,
        lean: float,
        sensor: Linearity,
        hidden_columns: float = 0.0,
    ) -> None:
        """Lean: how far the range axis goes right a mm upwards; hidden_columns: standard uncertainty of all ends."""
        self.hidden_columns = hidden_columns
        self.source, self.plates, self.along, self.lean = source, list(plates), along, lean
        self.s, self.group, self.at = along.s, along.group, along.at
        lines = [line for one in plates for line in one.lines]
        images = tuple(image for one in plates for image in one.images)
        face_forms = [
            replace(
                one, turn_u=SURELY * one.turn_u, lower_u_mm=SURELY * one.lower_u_mm, upper_u_mm=SURELY * one.upper_u_mm
            )
            for one in forms(images, self.at, sensor)
        ]
        self.right = len(plates[0].lines)  # number of the right plate's upper surface among all lines
        self.each = self._values([one.place for one in lines], [one.angle for one in lines])
        self._leave_false_ends()
        self.each = self._values([one.place for one in lines], [one.angle for one in lines])
        apart = max(typical(self.each["gap_mm"], typical(self.each["width_mm"], 0.0)), 0.0)
        self.joint = JointLines(lines, face_forms, along, apart)
        self.slopes = self.joint.slopes(self._values)
        self.corner = [np.stack([self.each[f"{name}_upper:{k}"] for k in "ab"], axis=1) for name in NAMES]
        self.sizes: dict[str, Quantity] = {}
        self.corners: dict[str, Corner] = {}
        self.root_face_seen = self.root_face_excluded = False
        self.shadowed = False  # whether one root lies in the other plate's shadow
        self.high = 0.0  # mm by which the right root's upper edge lies above the left one's
        self.uneven = math.nan  # that, over the greater depth; NaN: one plate is not prepared, or a root not seen

    def _leave_false_ends(self) -> None:
        """Forget the upper surfaces' ends in profiles where a tack weld, or lost returns, hide one."""
        towards = self.each["left_upper:a"] + self.each["right_upper:a"]  # the sections' origin follows half an end
        for k, one in enumerate(self.plates):
            if one.kind in UNSEEN:
                column = typical(one.edge_step)
                near = self._together(towards, np.isfinite(towards), 2.0 * column, column)
                self.plates[k] = replace(one, end=np.where(near[:, None], one.end, np.nan))

    def _values(self, places: Sequence[Float], angles: Sequence[Float]) -> Values:
        """Lengths in every profile; corners of each plate as a left one, inwards (a) and up (b)."""
        out: Values = {}
        tilt, k = 0.5 * (angles[0] - angles[self.right]), 0
        gap = np.zeros(self.s.size)
        for one, name, mirror in zip(self.plates, NAMES, (1.0, -1.0), strict=True):
            mine = slice(k, k + len(one.lines))
            corner, k = one.corner(places[mine], angles[mine]), mine.stop
            turn = np.array([[0.0, -1.0], [1.0, 0.0]]) * mirror  # of the sections' axes, with the plates
            upper = corner + tilt[:, None] * (corner @ turn)
            out |= {f"{name}_upper:a": upper[:, 0], f"{name}_upper:b": upper[:, 1]}
            gap -= upper[:, 0]
            if one.kind not in PREPARED:
                continue
            low = depth = corner[:, 1] - one.fillets.bottom
            root = np.stack([one.last[:, 0], one.fillets.bottom], axis=1)
            if one.kind == "bevel":
                way = np.stack([np.cos(angles[mine][1]), np.sin(angles[mine][1])], axis=1)
                low = ((one.last - corner) * way).sum(axis=1)
                if self._shows_root_face(one):  # the bevel ends where it meets that
                    low = (one.root_a - corner[:, 0]) / way[:, 0]
                root, depth = corner + low[:, None] * way, low * np.sin(angles[mine][0] - angles[mine][1])
            root = root + tilt[:, None] * (root @ turn)
            out |= {f"{name}:low": low, f"{name}:run": root[:, 0] - upper[:, 0], f"{name}:depth": depth}
            out |= {f"{name}_root:a": root[:, 0], f"{name}_root:b": root[:, 1]}
        out["width_mm"] = gap
        out["misalignment_mm"] = out["right_upper:b"] - out["left_upper:b"]
        out["gap_mm"] = gap - sum(out[f"{name}:run"] for name in NAMES if f"{name}:run" in out)
        depths = [out[f"{name}:depth"] for name in NAMES if f"{name}:depth" in out]
        out["depth_mm"] = np.mean(depths, axis=0) if depths else np.full(gap.size, np.nan)
        return out

    @staticmethod
    def _shows_root_face(one: Plate) -> bool:
        return bool(np.isfinite(one.root_a).mean() > SHOWS)

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
        edge_u = math.hypot(*map(self._edge_u, self.plates))
        ends = sum(one.edge_step**2 / 12.0 for one in self.plates if one.kind in UNSEEN)
        width = self._course("width_mm", ends)
        self._mm("width_mm", width.value, width.u, edge_u)
        step = self._course("misalignment_mm")
        self._mm("misalignment_mm", step.value, step.u, 0.0)
        self.misalignment = step.value
        falls = [self._fall(k) for k in (0, 1)]
        both = [fall for fall in falls if fall is not None]
        if len(both) == 2:
            angle = math.pi + np.add(*(self.joint.lines[k].direction(self.along) for k in (1, self.right + 1)))
            self.sizes["included_deg"] = Quantity.of(
                "included_deg", self._shown(width, angle / DEG), self._turns(1, self.right + 1)
            )
        elif both and "hidden" not in [one.kind for one in self.plates] and not (doubtful and self.hides_bevels):
            bevel = self.sizes[f"bevel_{NAMES[0 if falls[1] is None else 1]}_deg"]
            self.sizes["included_deg"] = replace(bevel, name="included_deg")
        roots = [self._root(k, fall) for k, fall in enumerate(falls)]
        roots = self._unlit(self._lit(roots, typical(width.value), typical(step.value)))
        depths = [root for root, one in zip(roots, self.plates, strict=True) if one.kind in PREPARED]
        if depths:
            n = len(depths)
            own = np.sqrt(sum(d.depth_u**2 for d in depths)) / n
            end = sum(d.depth_end for d in depths) / n  # by one sensor, alike at both
            self._mm("depth_mm", np.asarray(sum(d.depth for d in depths)) / n, own, end)
        square = [typical(self._down(k)) for k, one in enumerate(self.plates) if one.kind == "square"]
        told = [depth for depth in (*square, *(typical(d.depth) for d in depths)) if math.isfinite(depth)]
        self.depth = max(told, default=LEAST_DEPTH_MM)
        self._mm(
            "gap_mm",
            width.value - sum(r.run for r in roots),
            np.sqrt(width.u**2 + sum(r.run_u**2 for r in roots)),
            math.hypot(sum(r.run_end for r in roots), edge_u),
        )
        self._unseen(roots, falls, max(told, default=math.inf), typical(width.value), doubtful)
        self._radius()
        self._corners(roots)
        self._root_faces(roots)

    def _radius(self) -> None:
        """The fillets' radius: of two the mean."""
        round_ = [one for one in self.plates if one.kind in ("round", "hidden")]
        if not round_:
            return
        none = [(0.0, 0.0)] * len(self.joint.lines)
        found = [self._fitted("a fillet", one.fillets.radius, none, one.fillets.variances()[0]) for one in round_]
        n = len(round_)
        lever = max(typical(one.radius_lever) if one.kind == "hidden" else 0.0 for one in round_)
        self.sizes["root_radius_mm"] = Quantity.of(
            "root_radius_mm",
            np.asarray(sum(one.value for one in found)) / n,
            self.joint.terms(
                np.zeros(self.at.size),
                np.sqrt(sum(one.u**2 for one in found)) / n,
                none,
                math.hypot(FORM_U_MM * lever, *(one.fillets.form_u()[0] / n for one in round_)),
            ),
        )

    def _down(self, k: int) -> Float:
        """How far a plate's last return lies below its upper corner (n,), mm."""
        return np.asarray(self.corner[k][:, 1] - self.plates[k].last[:, 1])

    def level_share(self) -> float:
        """How much higher one plate stands than the other, over the groove's depth."""
        return typical(np.abs(self.misalignment)) / max(self.depth, 1e-3)

    def _course(self, name: str, variance: Float | float = 0.0) -> Smooth:
        return self._fitted(name, self.each[name], self.slopes[name], variance)

    def _fitted(self, name: str, value: Float, slopes: list[tuple[float, float]], variance: Float | float) -> Smooth:
        """The course of single profiles' values, as `JointLines.course`; NaN where none that agrees with it is near."""
        if np.isfinite(value + variance).sum() < LEAST_ENDS:
            raise InputError(
                self.source,
                f"groove: expected at least {LEAST_ENDS} profiles that show {name}, found {np.isfinite(value).sum()}",
            )
        found = self.joint.course(value, slopes, variance)
        if found.kept.sum() < LEAST_ENDS:
            raise InputError(self.source, f"groove: {name} is another one in every profile: no groove?")
        return found._replace(value=np.where(self._near(found.kept), found.value, np.nan))

    def _near(self, shown: Bool) -> Bool:
        """Stations (k,) near profiles that are `shown` (n,)."""
        return covered(np.where(shown, self.s, np.nan), self.group, self.at)

    def _shown(self, like: Smooth, value: Float) -> Float:
        return np.where(np.isfinite(like.value), value, np.nan)

    def _mm(self, name: str, value: Float, own: Float, returns: float) -> None:
        terms = self.joint.terms(value, own, self.slopes[name])
        self.sizes[name] = Quantity.of(name, value, terms | {RETURNS: np.full(value.size, returns)})

    def _fall(self, k: int) -> Float | None:
        """Angle of a plate's bevel or flank below its upper surface (m,), rad; fills in its size. None: it has none."""
        if self.plates[k].kind not in ("bevel", "round"):
            return None
        first, name = (0, self.right)[k], f"bevel_{NAMES[k]}_deg"
        upper, face = (self.joint.lines[first + i].direction(self.along) for i in (0, 1))
        near = self._near(np.isfinite(self.joint.lines[first + 1].section.angle))
        value = np.where(near, (math.pi / 2 - upper + face) / DEG, np.nan)
        self.sizes[name] = Quantity.of(name, value, self._turns(first, first + 1))
        return np.asarray(upper - face)

    def _turns(self, first: int, second: int) -> dict[str, Float]:
        """Uncertainties of an angle, deg: the joint's, and of faces whose last returns are chosen by their own errors.

        One at either end; a flank goes over into its fillet, its lower end is none.
        """
        terms = self.joint.turns(first, second)
        for k in {first, second} & {1, self.right + 1}:
            one, line = self.plates[int(k > 1)], self.joint.lines[k]
            ends = math.sqrt(1.0 if one.kind == "round" else 2.0)
            lever = 0.5 * self.joint.forms[k].width_mm / one.sigma
            terms[FORM] = np.hypot(terms[FORM], ends * CHOSEN * lever * typical(line.section.angle_variance) / DEG)
        return terms

    def _root(self, k: int, fall: Float | None) -> _Root:
        """The root's upper edge, from the upper corner: how far below and how far inwards."""
        zero, one, name = np.zeros(self.at.size), self.plates[k], NAMES[k]
        if one.kind not in PREPARED:
            return _Root(zero, zero, 0.0, zero, zero, 0.0, zero)
        joined, step = self._joined(one), typical(one.step)
        end_of = math.hypot(JOINED_SHARE * step, joined or 0.0)
        if one.kind != "bevel" or fall is None:
            depth = self._course(f"{name}:depth", one.fillets.variances()[1])
            run, run_u = self._end(self.each[f"{name}:run"], one.step, one)
            depth_u = np.hypot(depth.u, one.fillets.form_u()[1])
            end = self._column_u(STEP_SHARE) * step if joined is None else end_of
            return _Root(depth.value, depth_u, 0.0, run, run_u, end, depth.value)
        low, share = self.each[f"{name}:low"], STEP_SHARE
        if self._shows_root_face(one):
            found = self._fitted("a root face", low, self.slopes[f"{name}:low"], one.sigma**2)
            far, far_u = found.value, found.u
        else:
            far, far_u = self._end(low, one.step, one)
            beyond, share = self._seen_in_part(one, one.last - self.corner[k])
            far = far - (beyond if joined is None else 0.0) * step
        end, mean = self._column_u(share) * step if joined is None else end_of, typical(fall)
        # The run in the section plane: where the plates do not stand level with each other, no plate's own is that.
        tilt = 0.5 * (self.joint.lines[0].direction(self.along) - self.joint.lines[self.right].direction(self.along))
        face = self.joint.lines[(0, self.right)[k] + 1].direction(self.along) - (1.0, -1.0)[k] * tilt
        c, d = np.cos(face), -np.sin(face)
        return _Root(
            far * np.sin(fall),
            np.sin(fall) * far_u,
            end * math.sin(mean),
            far * c,
            c * far_u,
            end * math.cos(mean),
            far * d,
        )

    def _column_u(self, share: float) -> float:
        """Standard uncertainty of an end, in columns: how a column sees it, and what columns do not show."""
        return math.hypot(share, self.hidden_columns)

    def _edge_u(self, one: Plate) -> float:
        """u of an upper corner, mm, where nothing is seen below it: the last return's column, and a rounding.

        Of a rounding the returns end where it turns away from the rays; the corner of its faces lies before that or
        behind, by less than it is seen to go on.
        """
        if one.kind not in UNSEEN:
            return 0.0
        return math.hypot(
            self._column_u(END_SHARE) * typical(one.edge_step), ROUNDED_U_MM, one.rounded / math.sqrt(3.0)
        )

    def _unseen(
        self,
        roots: list[_Root],
        falls: list[Float | None],
        depth_mm: float,
        width_mm: float,
        doubtful: bool,
    ) -> None:
        """Put into depth and gap what faces may do that are not seen; doubtful: as `measure`."""
        told = [fall for fall in falls if fall is not None]
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
            if not gap > UNTOLD * reach:
                self._untold("gap_mm")
        elif doubtful and not unlit:
            beneath = self._beneath()
            if any(beneath):
                self._hidden("depth_mm", beneath[0])
                self._hidden("gap_mm", beneath[1])
        if gap > 0.0 and len(told) == 2 and any(self._joined(one) is not None for one in self.plates):
            # A thin weld between the ends: without it the bevels go on until they meet.
            self._hidden("gap_mm", gap)
            self._hidden("depth_mm", gap / sum(1.0 / math.tan(typical(fall)) for fall in told))

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
        high, one = abs(self.high), self.plates[upper]
        hidden = math.atan(max(self.leans[upper], 0.0)) + min(math.atan(one.missing / high), GRAZING_DEG * DEG)
        seen = bool(np.isfinite(one.root_a).mean() > SHOWS) or hidden < STEEP_DEG * DEG
        return (0.0, 0.0) if seen else (0.5 * high, high * math.tan(hidden))

    def _seen_in_part(self, one: Plate, off: Float) -> tuple[float, float]:
        """How far columns still see a face beyond its end, in columns, and u; off (n, 2): last returns from its corner.

        A column of half width h that sees the end y short of its middle returns the middle of what it sees, (h - y) / 2
        beside its own: a return above the line of a falling face. With ends anywhere in a column these are off by
        L^2 / 4 columns in the mean, over L columns from the first that is not seen whole to the first that is lost.
        A face beside one that may be too dark to be seen may need a column that sees it whole: nothing is told then.
        """
        if self.hides_bevels:
            return 0.0, STEP_SHARE
        ray = np.array([self.leans[1] if one is self.plates[0] else self.leans[0], 1.0])
        ray /= np.linalg.norm(ray)
        along, up = np.cos(one.lines[-1].angle), np.sin(one.lines[-1].angle)
        above = along * off[:, 1] - up * off[:, 0]
        sine, cosine = np.abs(along * ray[0] + up * ray[1]), np.abs(along * ray[1] - up * ray[0])
        column = one.step * sine * cosine
        mixed = above / column
        told = mixed[np.abs(mixed) < MOST_MIXED]
        if told.size < LEAST_ENDS:
            return 0.0, STEP_SHARE
        form = self.joint.forms[1 if one is self.plates[0] else -1]
        doubt = math.hypot(float(told.std()) / math.sqrt(told.size), typical(form.offset_u_mm) / typical(column))
        least, most = (2.0 * math.sqrt(max(float(told.mean()) + by, 0.0)) for by in (-doubt, doubt))
        return CUT_OFF * least, math.hypot(SEEN_SHARE, CUT_OFF_U * most)

    def _joined(self, one: Plate) -> float | None:
        """By how much (mm, u) the levels leave open where a root ends that the other plate's last return joins.

        None: they do not lie side by side in the view.
        """
        rise = self._next_up(one)
        return abs(rise) / math.sqrt(3.0) if abs(rise) <= self._joins_mm() else None

    def _next_up(self, one: Plate) -> float:
        """How far above a plate's last return the other plate's is that joins it; NaN: in most profiles none does."""
        beside = np.isfinite(one.next_up)
        return typical(one.next_up) if beside.mean() > SHOWS else math.nan

    def _joins_mm(self) -> float:
        """Levels of last returns that differ by less may be those of neighbouring columns on one surface."""
        return JOINED_STEPS * max(typical(one.step) for one in self.plates)

    def _lit(self, roots: list[_Root], width_mm: float, step_mm: float) -> list[_Root]:
        """The roots, less a lower one that the other plate may hide: its returns end beside a higher one of that.

        Or the upper root at (b, h) from the lower one lies on the line of sight that ends there, or beyond, or above
        it; (lean, 1) is the view's.
        """
        left, right = roots
        self.high = high = step_mm + typical(left.down) - typical(right.down)
        if all(one.kind in PREPARED for one in self.plates):
            self.uneven = abs(high) / max(typical(left.down), typical(right.down), 1e-3)
        apart = width_mm - typical(left.run) - typical(right.run)
        columns = SHADOW_COLUMNS * max(typical(one.edge_step) for one in self.plates)
        beyond = abs(high) > SHADOW_MM and apart - max(self.lean * high, 0.0) < columns + SHADOW_FAN * abs(high)
        for k, one in enumerate(self.plates):
            if one.kind in PREPARED and (
                self._next_up(one) > self._joins_mm() or (beyond and k == (0 if high > 0.0 else 1))
            ):
                unknown = np.full(self.at.size, np.nan)
                roots[k] = _Root(unknown, unknown, 0.0, unknown, unknown, 0.0, unknown)
                self.shadowed = True
        return roots

    def _unlit(self, roots: list[_Root]) -> list[_Root]:
        """The roots; of two bevels the shorter one ends where it is seen to, or in a shadow as deep as the other.

        Both are alike likely where no column returns as far as it would go on, and where the depths differ: that noise
        alone makes such a difference of equal ones is weighed against differences up to the depth itself.
        """
        depths = [typical(root.depth) for root in roots]
        k = int(np.argmin(depths))
        short, one, lower = roots[k], self.plates[k], abs(depths[0] - depths[1])
        known = math.hypot(*(typical(root.depth_u) + root.depth_end for root in roots))
        inwards = lower * typical(short.run) / max(depths[k], 1e-3)
        if (
            any(each.kind != "bevel" or self._joined(each) is not None for each in self.plates)
            or np.isfinite(one.root_a).mean() > SHOWS
            or not lower > 0.0
            or not inwards < one.missing
        ):
            return roots
        equal = math.exp(-0.5 * (lower / known) ** 2) / (known * math.sqrt(2.0 * math.pi)) * max(depths)
        differ = 1.0 / (1.0 + equal)
        if differ < SELDOM:
            return roots
        mean, spread = 0.5 * differ, math.sqrt(differ * (1.0 - 0.75 * differ))  # of none, or all alike likely up to 1
        out = list(roots)
        out[k] = replace(
            short,
            depth=short.depth + mean * lower,
            down=short.down + mean * lower,
            run=short.run + mean * inwards,
            unlit_depth=spread * lower,
            unlit_run=spread * inwards,
        )
        return out

    def _end(self, low: Float, steps: Float, one: Plate) -> tuple[Float, Float]:
        """Where returns end: value and u (k,), NaN where nothing tells it."""
        step = typical(steps)
        good = self._together(low, np.isfinite(low) & np.isfinite(steps), step, step)
        if good.sum() < LEAST_ENDS:
            return np.full(self.at.size, np.nan), np.full(self.at.size, np.nan)
        return self._silhouette(low, steps, one.lost[:, 0], one.sigma, good)

    def _together(self, low: Float, good: Bool, step: float, column: float) -> Bool:
        """Profiles (n,) of `good` whose ends follow one smooth course: a tack weld, or lost returns, end one earlier.

        Single ends lie about it by a step, those of many profiles by a column, mm.
        """
        if good.sum() < LEAST_ENDS:
            return good
        good = good & ~self._cut_off(low, good, TOGETHER_STEPS * column)
        wave = 3 + round(min(6.0, float(np.ptp(self.s[good])) / WAVE_MM))
        off, near = low - np.median(low[good]), good
        for degree, wide in ((0, 12.0), (1, 8.0), (3, 6.0), (wave, 4.0), (wave, 3.0), (wave, TOGETHER_STEPS)):
            near = good & (np.abs(off) < wide * max(step, 0.02))
            if near.sum() < max(LEAST_ENDS, 2 * degree):
                break
            off = low - np.polynomial.Polynomial.fit(self.s[near], low[near], degree)(self.s)
        return near

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
            steep = np.abs(change) > jump
            first = np.flatnonzero(steep & ~np.r_[False, steep[:-1]])
            last = np.flatnonzero(steep & ~np.r_[steep[1:], False])
            cuts = [a + int(np.argmax(np.abs(change[a : b + 1]))) for a, b in zip(first, last, strict=True)]
            pieces = np.split(np.arange(mine.size), [cut + JUMP_PROFILES // 2 + 1 for cut in cuts])
            level = np.append(0.0, np.cumsum(change[cuts]))
            for k, piece in enumerate(pieces):
                beside = float(level[max(k - 1, 0) : k + 2].max())
                if level[k] < beside - jump and piece.size <= mine.size / 2:
                    found[mine[piece]] = True
        return found

    def _silhouette(self, low: Float, step: Float, lost: Float, sigma: float, good: Bool) -> tuple[Float, Float]:
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
            np.zeros(s.size),
        )
        found = find_end(ends, rough)
        hidden = ~self._near(good)
        for place in found.s[found.contradicted]:
            hidden |= np.abs(self.at - place) < CELL_MM
        value = np.where(hidden, np.nan, found.course.value(self.at))
        said = readings(found.s, found.middle, found.middle_u, found.course, self.at)
        return value + said.shift_mm, np.hypot(found.course.u(self.at), said.u_mm)

    def _corners(self, roots: list[_Root]) -> None:
        """Upper corners from their own courses; roots from these."""
        for name, one, root, mirror in zip(NAMES, self.plates, roots, (1.0, -1.0), strict=True):
            ends = one.edge_step**2 / 12.0 if one.kind in UNSEEN else 0.0
            a, b = self._course(f"{name}_upper:a", ends), self._course(f"{name}_upper:b")
            place = np.stack([a.value, b.value], axis=1)
            u = np.stack([self._u(f"{name}_upper:a", a.u, self._edge_u(one)), self._u(f"{name}_upper:b", b.u)], axis=1)
            self.corners[f"{name}_upper"] = Corner(place * [mirror, 1.0], u)
            if one.kind in PREPARED:
                low = place + np.stack([root.run, -root.down], axis=1)
                inwards = self._u(f"{name}_root:a", np.hypot(a.u, root.run_u), root.run_end, root.unlit_run)
                down = self._u(f"{name}_root:b", np.hypot(b.u, root.depth_u), root.depth_end, root.unlit_depth)
                self.corners[f"{name}_root"] = Corner(low * [mirror, 1.0], np.stack([inwards, down], axis=1))

    def _u(self, name: str, own: Float, returns: float = 0.0, unlit: float = 0.0) -> Float:
        """Standard uncertainty (k,) of a corner's coordinate, mm."""
        terms = self.joint.terms(np.zeros(self.at.size), own, self.slopes[name])
        return np.asarray(np.hypot(np.hypot.reduce(list(terms.values())), math.hypot(returns, unlit / math.sqrt(3.0))))

    def _root_faces(self, roots: list[_Root]) -> None:
        """Root faces that the sensor sees down to their lower edge past the other plate."""
        if self.shadowed:
            return  # what is seen below the upper root may be the other plate
        gap = typical(self.sizes["gap_mm"].value)
        for k, (name, one, root) in enumerate(zip(("left", "right"), self.plates, roots, strict=True)):
            if one.kind not in ("bevel", "round"):
                continue
            towards = self.lean if k == 0 else -self.lean  # > 0: the sensor looks at this root face
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
                continue
            # Square to the plate's own upper surface, as the depth is: plates need not stand level.
            level = one.lines[0].angle
            drop = ((self.corner[k] - one.lowest) * np.stack([-np.sin(level), np.cos(level)], axis=1)).sum(axis=1)
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
            far, far_u = self._silhouette(drop, one.spacing, one.lost[:, 1], one.sigma, good)
            face = far - root.depth
            clear = gap / towards - typical(np.abs(self.misalignment))
            if typical(face) < 2.0 * BELOW_MM or typical(face) + CLEAR_MM > clear:
                continue
            size = f"root_face_{name}_mm"
            self.slopes[size] = self.slopes[f"{name}:depth"]
            end = STEP_SHARE * typical(one.spacing)
            self._mm(size, face, np.hypot(far_u, root.depth_u), math.hypot(end, root.depth_end))
            upper = self.corners[f"{name}_root"]
            u = np.stack([upper.u_mm[:, 0], np.hypot(upper.u_mm[:, 1], self.sizes[size].u)], axis=1)
            self.corners[f"{name}_lower"] = Corner(upper.section_mm - np.stack([0.0 * face, face], axis=1), u)


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
    near = np.ones(LOST_PROFILES)  # of which there may be more than profiles
    total, count = (
        scipy.ndimage.convolve1d(of, near, mode="constant") for of in (np.where(told, lost, 0.0), told.astype(float))
    )
    return np.clip(np.where(count > 0, total / np.maximum(count, 1), LEAST_LOST), LEAST_LOST, MOST_LOST)
