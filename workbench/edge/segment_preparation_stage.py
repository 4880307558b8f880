"""`edge.segment_preparation`: the prepared edge of one plate, from an organised cloud."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from workbench.artefacts import (
    ROOT_FACE,
    Check,
    Cloud,
    Corner,
    MilledEdge,
    Preparation,
    Quantity,
)
from workbench.checks.end_face import edge_break_check
from workbench.checks.faces import bows_check, corners_checks, plates_check, require_columns
from workbench.checks.judge import refuse_failed
from workbench.checks.limits import Bound, check, judged_by
from workbench.checks.profiles import in_order
from workbench.edge.broken_end import NOT_SHARP, broken_end
from workbench.edge.column_errors import declared_linearity, without_column_errors
from workbench.edge.directions import near_slope, wrapped
from workbench.edge.end_templates import EdgeCondition
from workbench.edge.extrapolated import name_extrapolated
from workbench.edge.faces import TrackedFaces
from workbench.edge.fillet import Fillet, fit_on_land, misfit_mm
from workbench.edge.groove_frames import two_plates_share
from workbench.edge.joint_lines import (
    Along,
    FaceLine,
    JointLines,
    Place,
    Values,
    advance,
    corners,
    joined,
    meeting,
    moved_by_tangent,
    typical,
)
from workbench.edge.last_returns import is_free_end, root_rim
from workbench.edge.measure import UNDETERMINED, Measured, measure_edge
from workbench.edge.other_passes import with_other_passes
from workbench.edge.parameters import (
    USUAL_NOISE_MM,
    Direction,
    EndU,
    Limits,
    RobotNoiseLength,
    RobotNoiseOrUsual,
    usual_noise_mm,
)
from workbench.edge.prepared_frames import (
    FILLET,
    FILLETED,
    FLANK,
    WHOLE,
    PreparedFrames,
    bare,
    convex_corners,
    frames_of,
    read_plates,
    straight_corners,
)
from workbench.edge.residual_image import FaceForm, face_image, forms
from workbench.edge.segment_stage import Declared, milled_edge, u_of_both_pieces
from workbench.edge.unseen import by_window, root_end_check
from workbench.errors import InputError
from workbench.geometry.blocks import evenly
from workbench.geometry.sections import crossing, in_section, section_lines
from workbench.stage import InputFile, stage
from workbench.units import DEG, Float

Given = Literal["auto", "bevel", "compound", "nose", "J"]
FILLETS, FEW = 400, 12  # frames, evenly, whose fillets are fitted; from which it is told what moves them
FILLET_U_MM = 3e-3  # of a radius: by the study fillets that nothing moves are off by so much
WORDS = {
    "bevel": "one bevel",
    "compound": "two bevels",
    "nose": "a bevel above a land",
    "J": "a flank above a fillet",
}


@stage("edge.segment_preparation")
def segment_preparation(
    cloud: Cloud,
    *,
    preparation: Given = "auto",
    root_nominal_mm: Annotated[float, Field(gt=0, le=50)] = 1.5,
    upper_side: Direction | None = None,
    robot_noise_mm: RobotNoiseOrUsual = USUAL_NOISE_MM,
    robot_noise_length_mm: RobotNoiseLength = None,
    end_u_mm: EndU = 0.0,
    edge_condition: EdgeCondition = "unknown",
    sensor: InputFile | None = None,
    limits: Annotated[Limits, judged_by("edge.segment_preparation")] = {},  # noqa: B006  (never changed)
) -> Preparation:
    """Find the prepared edge of one plate: a bevel, a compound bevel, a bevel with a land (nose), a J preparation.

    How the profiles are read: docs/grooves.md, "One plate".

    Args:
        cloud: the organised cloud of one edge, in one or more passes that show its upper surface too; others, from
            below, measure the root face alone.
        preparation: what the edge is prepared as, or `auto`; another one than the profiles show is refused.
        root_nominal_mm: expected root face; distinguishes it from the upper surface.
        edge_condition: as in `edge.segment`.
        sensor: as in `edge.segment`.
        upper_side: direction to the plate's upper side, in the base; null: by the expected root face.

    Raises:
        InputError: no such plate, or not its upper surface, is in view; or another preparation.

    Example:
        >>> from workbench import cloud, edge, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_nose.h5")))
        >>> edge.segment_preparation(points).type
        'nose'
    """
    columns = require_columns(cloud, root_nominal_mm, limits)
    side = None if upper_side is None else np.array(upper_side)
    plates = read_plates(cloud, root_nominal_mm, side)
    cloud, layers = bare(cloud, plates)
    if layers:
        plates = read_plates(cloud, root_nominal_mm, side)
    frames = frames_of(cloud, plates)
    linearity, tracked = declared_linearity(sensor), frames.tracked
    better, errors = without_column_errors(cloud, tracked.labels, tracked.faces, linearity)
    if better is not cloud:
        cloud, plates = better, read_plates(better, root_nominal_mm, side)
        frames = frames_of(cloud, plates)
    if preparation not in ("auto", frames.kind):
        raise InputError(
            f"{cloud.source}: preparation '{preparation}'",
            f"between upper surface and root face the profiles show {WORDS[frames.kind]}: expected {frames.kind}",
        )
    checks = [columns, *_checks(cloud, frames, root_nominal_mm, limits)]
    refuse_failed(checks, *_refused(cloud, frames))
    tracked = _of_all_passes(cloud, frames, root_nominal_mm)
    rounding = broken_end(cloud, root_rim(tracked), is_free_end(tracked), edge_condition)
    rim, notes = rounding.rim_mm, (NOT_SHARP,) if rounding.contradicts else ()
    condition: EdgeCondition = "unknown" if rounding.contradicts else edge_condition
    if rim > 0.0:
        frames = frames_of(cloud, plates, rim)
        tracked = _of_all_passes(cloud, frames, root_nominal_mm, rim)
        rounding = broken_end(cloud, root_rim(tracked, rim), is_free_end(tracked), condition)
    checks.append(edge_break_check(rounding.size_mm, limits))
    refuse_failed(checks, *_refused(cloud, frames))
    try:
        measured = measure_edge(cloud, tracked, rounding)
        declared = Declared(linearity, errors, usual_noise_mm(robot_noise_mm), robot_noise_length_mm, end_u_mm)
        edge = milled_edge(cloud, tracked, measured, rounding, declared, checks)
        chain = _Chain(cloud, frames, measured, edge, declared)
        if frames.kind == "J":  # the flank's line may have leant on its fillet, before that was known
            chain = _Chain(cloud, frames_of(cloud, plates, rim, chain.flank_mm()), measured, edge, declared)
            checks.extend(chain.fillet_checks(limits))
            refuse_failed(checks, *_refused(cloud, frames))
        sizes, corners = chain.sizes(), chain.corners
        checks.append(_extent_check(sizes["root_face_mm"], frames, limits))
        refuse_failed(checks, *_refused(cloud, frames))
    except np.linalg.LinAlgError:
        raise InputError(cloud.source, UNDETERMINED) from None
    ends = root_end_check(cloud, tracked)
    found = Preparation(
        type=frames.kind,
        declared=preparation != "auto",
        arc_length_mm=edge.arc_length_mm,
        origin_mm=measured.curve.position(edge.arc_length_mm + measured.shift),
        tangent=edge.tangent,
        normal=edge.normal,
        across=edge.across,
        seen=edge.seen,
        sizes=sizes,
        corners=corners,
        frame_arc_length_mm=edge.frame_arc_length_mm,
        x_mm=cloud.x_mm,
        base_from_profiler=cloud.base_from_profiler,
        pass_index=cloud.pass_index,
        part=cloud.part,
        warnings=(*layers, *notes, *edge.warnings),
        checks=(*cloud.checks, *checks, ends),
        unseen=by_window(ends),
    )
    return name_extrapolated(found, cloud, max(frames.sigma_mm.values()))


def _of_all_passes(cloud: Cloud, frames: PreparedFrames, root_nominal_mm: float, rim_mm: float = 0.0) -> TrackedFaces:
    """The faces, with what passes without the upper surface show of root face and bevel."""
    if frames.kind in FILLETED:
        return frames.tracked
    return with_other_passes(cloud, frames.tracked, root_nominal_mm, rim_mm)


def _refused(cloud: Cloud, frames: PreparedFrames) -> tuple[str, str]:
    """What is refused, and the parameter that sets limits."""
    return f"{cloud.source}: no {frames.kind} preparation", "edge.segment_preparation.limits"


def _checks(
    cloud: Cloud, frames: PreparedFrames, root_nominal_mm: float, given: Mapping[str, Bound]
) -> tuple[Check, ...]:
    """That the profiles agree, that the root face's end is seen, that faces are straight, corners those of two."""
    tracked = frames.tracked
    found = f"the faces of a prepared plate were found in {100 * frames.share:.0f} % of the profiles: no such plate?"
    agree = f"{100 * frames.agreement:.0f} % of the profiles show {WORDS[frames.kind]}: is it one preparation?"
    seen = 1.0 - float(tracked.end_is_cut[tracked.seen].mean()) if tracked.seen.any() else 0.0
    ends = f"the root face's lower end is in view in {100 * seen:.0f} % of the profiles only"
    wide = tracked.faces[ROOT_FACE].width_mm / root_nominal_mm
    finding = (
        f"what would be the root face is {wide:.2g} times as wide as its nominal size: another face, or another size?"
    )
    return (
        plates_check(two_plates_share(cloud), given),
        check("found_share", frames.share, found, given=given),
        check("agreement", frames.agreement, agree, given=given),
        check("root_seen_share", seen, ends, given=given),
        check("root_over_nominal", wide, finding, given=given),
        *bows_check(cloud, tracked.labels, frames.order[1:], straight_corners(frames), given),
        *corners_checks(cloud, tracked.labels, convex_corners(frames), given),
    )


def _extent_check(root: Quantity, frames: PreparedFrames, given: Mapping[str, Bound]) -> Check:
    """The check that the root face by its corners is as wide as its returns lie."""
    width, seen = typical(root.value), frames.tracked.faces[ROOT_FACE].width_mm
    finding = (
        f"by its corners the root face is {width:.2f} mm wide, and its returns take up {seen:.2f} mm: another face "
    )
    return check("root_extent_mm", width - seen, f"{finding}than those that were measured meets it?", given=given)


class _Chain:
    """Sizes and corners at the stations of an edge, from the faces' lines in every frame."""

    def __init__(
        self, cloud: Cloud, frames: PreparedFrames, measured: Measured, edge: MilledEdge, declared: Declared
    ) -> None:
        self.cloud, self.frames, self.measured, self.edge = cloud, frames, measured, edge
        self.kind = frames.kind
        self.s = measured.upper_s
        self.at = edge.arc_length_mm + measured.shift
        self.group = cloud.pass_index
        faces = [frames.tracked.faces[label] for label in frames.order]
        along = Along(self.s, self.group, self.at, edge.tangent_u, in_order(cloud.checks))
        sections = [
            section_lines(
                face,
                near_slope(face, self.s, self.group),
                cloud.base_from_profiler,
                frames.tracked.side,
                np.full(self.s.size, frames.sigma_mm[label]),
                measured.curve,
                self.s,
            )
            for face, label in zip(faces, frames.order, strict=True)
        ]
        # the root face hangs on the lower edge, which the curve follows
        lines = joined(sections, self.s, self.group, np.zeros((self.s.size, 2)))
        self.joint = JointLines(cloud.source, lines, self._forms(declared, lines), along)
        self.lines = self.joint.lines
        self.corners: dict[str, Corner] = {}

    def sizes(self) -> dict[str, Quantity]:
        """Every size along the edge; fills `corners`."""
        places, angles = self._places(), self._angles()
        fillets = self.fillets if self.kind == "J" else None
        slopes = self.joint.slopes(self._few_values)
        values = partial(self._values, places, angles, fillets)
        by_tangent = self._by_tangent(self._corners(places, angles, fillets, {})[0])
        found = self.joint.lengths(values, slopes, slopes, self._fillet_places(values({})["width_mm"]), by_tangent)
        found = {name: one.where(self.edge.seen) for name, one in found.items()}
        self.corners = corners(found)
        sizes = found | self._bevels()
        sizes["root_face_mm"] = self._root_face(sizes["depth_mm"])
        low_u = np.stack([self.corners["root"].u_mm[:, 0], sizes["root_face_mm"].u], axis=1)
        self.corners["lower"] = Corner(np.where(self.edge.seen[:, None], np.zeros((self.at.size, 2)), np.nan), low_u)
        return {name: sizes[name] for name in Preparation.terms if name in sizes}

    @cached_property
    def fillets(self) -> list[Fillet | None]:
        """The fillets of a J, in some frames."""
        return self._fillets(self._places(), self._angles(), FILLETS)

    def fillet_checks(self, given: Mapping[str, Bound]) -> tuple[Check, Check]:
        """The checks that what is measured as a fillet is round, and ends level."""
        seen = [one for one in self.fillets if one is not None]
        if not seen:
            raise InputError(self.cloud.source, "no profile shows a whole fillet between flank and root face: no J?")
        off, tilt = misfit_mm(seen), abs(typical(np.array([one.tilt for one in seen]))) / DEG
        finding = f"between flank and root face the returns stand off a fillet by {off:.3f} mm, rms: straight faces, "
        falls = f"below the fillet the land falls by {tilt:.0f} deg: a bevel below a rounded corner?"
        return (
            check("fillet_misfit_mm", off, f"{finding}or a flank that is not?", given=given),
            check("land_tilt_deg", tilt, falls, given=given),
        )

    def _fillet_places(self, width_mm: Float) -> dict[str, Place]:
        """What fillets leave open of radius, level and land; width (N,) of the preparation.

        Their form is alike in all frames. Where no land is seen, nothing tells its tilt, which moves the place where
        the fillet ends along the circle.
        """
        if self.kind != "J":
            return {}
        seen = [one for one in self.fillets if one is not None]
        middle, none = seen[len(seen) // 2], np.zeros(self.at.size)
        radius, level, tilt = (misfit_mm(seen) * u for u in middle.form_u(typical(width_mm)))
        unseen = typical(np.array([one.radius_mm * math.sqrt(one.covariance[2, 2]) for one in seen]))
        by_noise = np.array([[math.nan] * 2 if one is None else np.diag(one.covariance)[:2] for one in self.fillets]).T
        return {
            "radius": Place(none, none, by_noise[0], math.hypot(FILLET_U_MM, radius)),
            "level": Place(none, none, by_noise[1], level),
            "land": Place(none, none, form_u=math.hypot(unseen, middle.radius_mm * tilt)),
        }

    def flank_mm(self) -> float:
        """Length of a J's flank, from the upper corner to where the fillet begins: the median of some frames."""
        fillets = self._fillets(self._places(), self._angles(), FEW)
        falls = _fall(*(self.lines[k].angle for k in (0, 1, -1)))
        found = [one.flank_mm(float(falls[i])) for i, one in enumerate(fillets) if one is not None]
        return float(np.median(found)) if found else math.inf

    def _forms(self, declared: Declared, lines: Sequence[FaceLine]) -> list[FaceForm]:
        """What the straight line of each face leaves; and where checks found a corner in a face, either piece's."""
        tracked, pieces_u = self.frames.tracked, u_of_both_pieces(self.edge.checks)
        s = np.nan_to_num(self.s)
        bows = [one.section.bow_in_range(one.course.slope(s)) for one in lines]
        images = tuple(
            face_image(
                self.cloud,
                tracked.labels,
                tracked.faces[label],
                label,
                tracked.side,
                self.s,
                bow,
                declared.errors.get(label),
            )
            for label, bow in zip(self.frames.order, bows, strict=True)
        )
        known = (one.uncorrected for one in forms(images, self.at, declared.sensor))
        return [replace(one, turn_u=np.hypot(one.turn_u, pieces_u)) for one in known]

    def _few_values(self, places: list[Float], angles: list[Float]) -> Values:
        """With the fillets of few frames: they take long."""
        return self._values(places, angles, self._fillets(places, angles, FEW) if self.kind == "J" else None, {})

    def _places(self) -> list[Float]:
        return [one.place for one in self.lines]

    def _angles(self) -> list[Float]:
        return [one.angle for one in self.lines]

    def _corners(
        self,
        places: list[Float],
        angles: list[Float],
        fillets: list[Fillet | None] | None,
        shifts: Mapping[str, Float],
    ) -> tuple[dict[str, Float], Values]:
        """Corners (N, 2) in every frame, and lengths of the fillets.

        shifts: by how much more than its fillet says the radius is, the level lies higher, the land is longer.
        """
        out, _, _ = _ways(angles)
        meets = [meeting(places[k], angles[k], places[k + 1], angles[k + 1]) for k in range(len(places) - 1)]
        found_at = {"upper": meets[0]}
        found: Values = {}
        if fillets is not None:
            found_at["root"], found = self._below_fillets(fillets, meets[0], places, angles)
            found_at["root"] = found_at["root"] + np.asarray(shifts.get("level", 0.0))[..., None] * out
            found["root_radius_mm"] = found["root_radius_mm"] + shifts.get("radius", 0.0)
            found["land_mm"] = found["land_mm"] + shifts.get("land", 0.0)
        else:
            if len(meets) > 2:
                found_at["middle"] = meets[1]
            found_at["root"] = meets[-1]
        return found_at, found

    def _by_tangent(self, corner: Mapping[str, Float]) -> Values:
        """By how much a radian of the edge's direction moves each length in every frame (N,), mm."""
        out, upper, _ = _ways(self._angles())

        def on_plate(of: Float) -> Float:
            return np.stack([(of * upper).sum(axis=1), (of * out).sum(axis=1)], axis=1)

        way = advance(self.lines)
        flat = on_plate(way)
        whole, land = corner["root"] - corner["upper"], corner["root"] - corner.get("middle", corner["root"])
        wide, deep = moved_by_tangent(flat, on_plate(whole))
        lengths = {"width_mm": wide, "depth_mm": deep, "root_radius_mm": np.hypot(wide, deep)}
        lengths |= {"lower_bevel_mm": moved_by_tangent(flat, on_plate(land))[1], "land_mm": (way * land).sum(axis=1)}
        for name, place in corner.items():
            lengths |= dict.fromkeys((f"{name}:a", f"{name}:b"), (way * place).sum(axis=1))
        return lengths

    def _values(
        self,
        places: list[Float],
        angles: list[Float],
        fillets: list[Fillet | None] | None,
        shifts: Mapping[str, Float],
    ) -> Values:
        """Lengths in every frame; and corners along normal (a) and across (b) of the section's axes."""
        out, upper, root = _ways(angles)
        found_at, found = self._corners(places, angles, fillets, shifts)
        off = found_at["root"] - found_at["upper"]
        found["depth_mm"] = -(off * out).sum(axis=1)
        found["width_mm"] = -(off * upper).sum(axis=1)
        if self.kind == "compound":
            found["lower_bevel_mm"] = ((found_at["middle"] - found_at["root"]) * out).sum(axis=1)
        if self.kind == "nose":
            found["land_mm"] = np.hypot(*(found_at["middle"] - found_at["root"]).T)
        for name, place in found_at.items():
            found[f"{name}:a"] = -place[:, 0] * root[:, 1] + place[:, 1] * root[:, 0]
            found[f"{name}:b"] = (place * root).sum(axis=1)
        return found

    def _below_fillets(
        self, fillets: list[Fillet | None], top: Float, places: list[Float], angles: list[Float]
    ) -> tuple[Float, Values]:
        """Where land and root face meet (N, 2), root radius and land; top (N, 2): the upper corners."""
        corner, radius, land = np.full((len(fillets), 2), np.nan), *np.full((2, len(fillets)), np.nan)
        fall = _fall(angles[0], angles[1], angles[-1])
        for i, one in enumerate(fillets):
            if one is None:
                continue
            axes = _upper_axes(angles[0][i], angles[-1][i])
            start = top[i] + one.tangent(float(fall[i])) @ axes
            way = np.array([math.cos(one.tilt), math.sin(one.tilt)]) @ axes
            direction = np.array([math.atan2(way[1], way[0])])
            far = crossing(start[None], direction, places[-1][i : i + 1], angles[-1][i : i + 1])[0]
            corner[i], radius[i], land[i] = start + far * way, one.radius_mm, far
        return corner, {"root_radius_mm": radius, "land_mm": land}

    def _fillets(self, places: list[Float], angles: list[Float], count: int) -> list[Fillet | None]:
        """The fillet of `count` frames at the most, evenly."""
        tracked, curve = self.frames.tracked, self.measured.curve
        on = np.isin(tracked.labels, (FILLET, FLANK)) & self.cloud.keep
        number = on.sum(axis=1)
        shown = np.flatnonzero(tracked.seen & np.isfinite(self.s))
        shown = shown[number[shown] > WHOLE * np.median(number[shown])]  # a part that is lost moves the rest of the fit
        chosen = shown[evenly(shown.size, count)]
        falls = _fall(angles[0], angles[1], angles[-1])
        top = meeting(places[0], angles[0], places[1], angles[1])
        out: list[Fillet | None] = [None] * len(tracked.seen)
        start = None
        for i in chosen:
            column = np.flatnonzero(on[i])
            points = self.cloud.placed(np.full(column.size, i), column)
            _, place = in_section(points, curve, np.full(column.size, self.s[i]))
            local = (place - top[i]) @ _upper_axes(angles[0][i], angles[-1][i]).T
            found = fit_on_land(local, float(falls[i]), self.frames.sigma_mm[FLANK], start)
            out[int(i)] = found
            start = start if found is None else found
        return out

    def _bevels(self) -> dict[str, Quantity]:
        """Bevel angles, from the normal of the upper surface."""
        names = {"compound": {1: "upper_bevel_deg", 2: "bevel_deg"}}.get(self.kind, {1: "bevel_deg"})
        upper, root = (self.lines[k].direction(self.joint.along) for k in (0, -1))
        hidden = np.where(self.edge.seen, 0.0, np.nan)
        return {
            name: Quantity.of(
                name,
                (math.pi / 2 - _fall(upper, self.lines[k].direction(self.joint.along), root)) / DEG + hidden,
                self.joint.turns(0, k),
            )
            for k, name in names.items()
        }

    def _root_face(self, depth: Quantity) -> Quantity:
        """As that of a milled edge; above a fillet it is the thickness at the edge less the depth."""
        root = self.edge.root
        hidden = np.where(self.edge.seen, 0.0, np.nan)
        if self.kind != "J":
            return replace(root, name="root_face_mm", value=root.value + hidden)
        return Quantity("root_face_mm", root.value - depth.value + hidden, (*root.terms, *depth.terms))


def _ways(angles: Sequence[Float]) -> tuple[Float, Float, Float]:
    """Out of the plate, into it along its upper surface, and up its root face (N, 2), by the faces' directions."""
    upper, root = (np.stack([np.cos(angles[k]), np.sin(angles[k])], axis=1) for k in (0, -1))
    out = np.stack([upper[:, 1], -upper[:, 0]], axis=1)
    return out * np.sign((out * root).sum(axis=1))[:, None], upper, root


def _upper_axes(upper: float, root: float) -> Float:
    """Axes (2, 2) of the upper surface in a section: out of its edge, and up; from the directions of both, rad."""
    out = np.array([-math.cos(upper), -math.sin(upper)])
    up = np.array([-out[1], out[0]])
    return np.stack([out, up * math.copysign(1.0, float(up @ [math.cos(root), math.sin(root)]))])


def _fall(upper: Float, face: Float, root: Float) -> Float:
    """Angle of a face below the upper surface, rad: towards the root face, which stands upright on it."""
    return np.asarray(np.sign(np.sin(root - upper)) * wrapped(face - upper))
