"""The raw edge and the bevel as planning needs them: section axes and upper edge along it, layers and tool across it.

A J preparation is a bevel whose face ends in a fillet of the cutter's own radius, tangent to the face and square to the
end face where the root face ends. A ball end of radius r makes it, its centre at (0, c + r) + h b for the layer at
height h above the finished one (b: the bevel's normal in the section, c: the root face). Fillet and face meet at
(-r cos(beta), c + r (1 - sin(beta))); the face's plane meets the end face at c + r (1 - 1 / sin(beta)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from workbench.artefacts import Edge, Layer, PathDeflection, RawEdge, Toolpath, Travel
from workbench.errors import InputError
from workbench.geometry.course import fit_course
from workbench.geometry.poses import (
    mapped,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
    unit,
)
from workbench.geometry.processes import Shared
from workbench.geometry.splines import hermite, through
from workbench.units import DEG, Bool, Float, Shaped

BEND_MM = 2.0  # curvature is the turn of the tangent over this length on each side
LEAST_STATIONS = 4  # of the upper edge: a line that bends once, and one to judge it by


def components(vectors: Float, *axes: Float) -> Float:
    """Components (k, a) of vectors (k, 3) along each of the axes (k, 3)."""
    return np.stack([(vectors * axis).sum(axis=1) for axis in axes], axis=1)


def bevel_normal(normal: Float, across: Float, bevel: float) -> Float:
    """Outward normals b (k, 3) of a bevel face at the angle `bevel` (rad) to the end face: n cos + m sin."""
    return np.asarray(math.cos(bevel) * normal + math.sin(bevel) * across)


def cutter_axis(normal: Float, across: Float, bevel: float) -> Float:
    """Axes z (k, 3) of a cutter that lies in that bevel face, from shank to tip: down from the upper side.

    The tilt is about the feed t: z = n sin - m cos. (The paper's section 4.3 prints a turn about z, which changes
    nothing.)
    """
    return np.asarray(math.sin(bevel) * normal - math.cos(bevel) * across)


def same_sign(quaternion_wxyz: Float) -> Float:
    """The same orientations (k, 4) with no jump from q to -q: interpolation never takes the long way round."""
    flips = np.sum(quaternion_wxyz[1:] * quaternion_wxyz[:-1], axis=1) < 0
    sign = np.where(np.cumsum(np.concatenate([[False], flips])) % 2 == 1, -1.0, 1.0)
    return np.asarray(quaternion_wxyz * sign[:, None])


def smoothstep(x: Float) -> Float:
    """0 up to x = 0, 1 from x = 1 on, with a slope of 0 at both: 3 x^2 - 2 x^3."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))


class Poses(NamedTuple):
    """Frames of the tool at k points: origin and axes (k, 3) in the base."""

    origin_mm: Float
    x: Float  # into the material
    y: Float  # along the feed
    z: Float  # the cutter's axis, from shank to tip


def poses_of(toolpath: Toolpath, points: Layer | Travel) -> Poses:
    """The frames of a layer or travel in the base, whatever frame the path is in."""
    axes, origin = rotation_from_quaternion(points.quaternion_wxyz), points.position_mm
    work = toolpath.base_from_workobject
    if work is not None:
        axes, origin = work[:3, :3] @ axes, mapped(work, origin)
    return Poses(origin, axes[:, :, 0], axes[:, :, 1], axes[:, :, 2])


def cutter_ends(toolpath: Toolpath, poses: Poses) -> tuple[Float, Float]:
    """Ends (k, 3) of the cutter's axis, tip and shank end of the flute, a radius off the origin at x = -R."""
    cutter = toolpath.cutter
    centre, half = poses.origin_mm - cutter.diameter_mm / 2.0 * poses.x, cutter.flute_length_mm / 2.0 * poses.z
    return np.asarray(centre + half), np.asarray(centre - half)


def loaded(toolpath: Toolpath, predicted: PathDeflection) -> Toolpath:
    """The path displaced by the prediction, point by point; InputError where that is of another path."""
    return replace(toolpath, layers=tuple(_displaced(layer, predicted) for layer in toolpath.layers))


def greatest_mm(predicted: PathDeflection) -> float:
    """The largest displacement anywhere."""
    return max((float(np.linalg.norm(d, axis=1).max(initial=0.0)) for d in predicted.by_layer_mm.values()), default=0.0)


def _displaced(layer: Layer, predicted: PathDeflection) -> Layer:
    away = (rotation_from_quaternion(layer.quaternion_wxyz) @ predicted.at(layer)[:, :, None])[:, :, 0]
    turn = predicted.turn_by_layer.get(layer.index)
    quaternion = layer.quaternion_wxyz if turn is None else rotated_about_feed(layer.quaternion_wxyz, turn)
    return replace(layer, position_mm=layer.position_mm + away, quaternion_wxyz=quaternion)


def rotated_about_feed(quaternion_wxyz: Float, angle: Float) -> Float:
    """Tool frames (k, 4) turned by angles (k,) rad about their own y."""
    turn = rotation_from_vector(np.asarray(angle)[:, None] * np.array([0.0, 1.0, 0.0]))
    return same_sign(quaternion_from_rotation(rotation_from_quaternion(quaternion_wxyz) @ turn))


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """The lower edge at k arc lengths. Before its beginning and beyond its end it goes straight on.

    Sizes in the section plane have two components, along n and along m, counted from the lower edge.
    """

    arc_length_mm: Shaped[Float, " k"]
    position_mm: Shaped[Float, "k 3"]  # lower edge in the base; bridged smoothly where hidden
    tangent: Shaped[Float, "k 3"]
    normal: Shaped[Float, "k 3"]
    across: Shaped[Float, "k 3"]
    upper_mm: Shaped[Float, "k 2"]  # the stock's upper edge
    inward: Shaped[Float, "k 2"]  # unit, along the upper surface into the plate
    curvature: Shaped[Float, "k 2"]  # of the lower edge, 1/mm; 0 beyond the ends
    seen: Shaped[Bool, " k"]  # measured here

    def in_base(self, section: Float) -> Float:
        """Vectors (k, 2) of the section plane in the base (k, 3)."""
        return np.asarray(section[:, :1] * self.normal + section[:, 1:] * self.across)


def lower_course(edge: Edge, s: Float) -> Course:
    """The lower edge of any `edge` at arc lengths s (k,) mm, ascending; the stock above it is left open (0).

    Raises:
        InputError: fewer than two stations were seen.
    """
    stations, length = edge.arc_length_mm, float(edge.arc_length_mm[-1])
    seen = edge.seen & np.isfinite(edge.position_mm).all(axis=1)
    if seen.sum() < 2:
        raise InputError("edge", "expected an edge of 1 mm or more to plan for")
    at = np.clip(s, 0.0, length)
    tangent, normal, across = _axes(edge, at)
    lower = hermite(stations[seen], edge.position_mm[seen], unit(edge.tangent[seen]))
    inside = (s > -1e-9) & (s < length + 1e-9)
    known = np.clip(at, *stations[seen][[0, -1]])  # straight on before the first and beyond the last seen
    return Course(
        arc_length_mm=s,
        position_mm=lower(known) + (s - known)[:, None] * tangent,
        tangent=tangent,
        normal=normal,
        across=across,
        upper_mm=np.zeros((s.size, 2)),
        inward=np.tile([-1.0, 0.0], (s.size, 1)),
        curvature=np.where(inside[:, None], _curvature(edge, at, normal, across), 0.0),
        seen=_seen(stations, seen, at),
    )


def edge_course(edge: RawEdge, s: Float, smoothing_mm: float) -> Course:
    """The course of a raw `edge` at arc lengths s (k,) mm, ascending, with the stock above it.

    The upper edge is smoothed along the edge over `smoothing_mm` on each side (its roughness would shake the path).

    Raises:
        InputError: its upper edge was seen at fewer stations than tell a course.
    """
    course = lower_course(edge, s)
    stations, at = edge.arc_length_mm, np.clip(s, 0.0, edge.arc_length_mm[-1])
    upper, inward = _upper(edge, smoothing_mm)
    return replace(
        course,
        upper_mm=through(stations, upper)(at),
        inward=unit(through(stations, inward)(at)),
    )


def stocked_course(edge: Edge, s: Float, toolpath: Toolpath) -> Course:
    """The course at s (k,) with the stock: a raw edge's own, or, of a milled edge, what stood there before the cut."""
    if isinstance(edge, RawEdge):
        return edge_course(edge, s, 0.0)
    return with_thickness(lower_course(edge, s), *thickness_before(edge, toolpath))


def thickness_before(edge: Edge, toolpath: Toolpath) -> tuple[Float, Float]:
    """Arc lengths (g,) of a milled edge and the stock's thickness there before: where the plan's bevel met its top.

    Of a path that cuts nothing the root face: no stock is known.
    """
    final = toolpath.layers[-1]
    if not final.cutting.any():
        return np.zeros(1), np.full(1, toolpath.root_mm)
    up = -poses_of(toolpath, final).z
    top = toolpath.in_base(toolpath.face_middle_mm(final)) + 0.5 * final.width_mm[:, None] * up
    arc, height = along_edge(edge, top[final.cutting])
    order = np.argsort(arc)
    return arc[order], height[order]


def along_edge(edge: Edge, points_mm: Float) -> tuple[Float, Float]:
    """Arc length (p,) and height (p,) over the lower edge, in its nearest station's section, of points (p, 3) mm."""
    course = lower_course(edge, edge.arc_length_mm)
    at = scipy.spatial.cKDTree(course.position_mm).query(points_mm)[1]
    arc, height = components(points_mm - course.position_mm[at], course.tangent[at], course.across[at]).T
    return course.arc_length_mm[at] + arc, height


def with_thickness(course: Course, arc_length_mm: Float, thickness_mm: Float) -> Course:
    """The course under a plate of a thickness (g,) at arc lengths (g,): square to the end face."""
    thick = np.interp(course.arc_length_mm, arc_length_mm, thickness_mm)
    return replace(course, upper_mm=np.stack([np.zeros(thick.size), thick], axis=1))


def _axes(edge: Edge, at: Float) -> tuple[Float, Float, Float]:
    """t, n, m (k, 3), orthonormal with t = m x n."""
    spline = through(edge.arc_length_mm, np.concatenate([edge.tangent, edge.normal], axis=1))
    both = spline(at)
    t = unit(both[:, :3])
    n = unit(both[:, 3:] - (both[:, 3:] * t).sum(axis=1, keepdims=True) * t)
    return t, n, np.cross(n, t)


def _curvature(edge: Edge, at: Float, normal: Float, across: Float) -> Float:
    """Components (k, 2) of dt/ds along n and m."""
    low, high = np.maximum(at - BEND_MM, 0.0), np.minimum(at + BEND_MM, edge.arc_length_mm[-1])
    turn = _axes(edge, high)[0] - _axes(edge, low)[0]
    return components(turn / np.maximum(high - low, 1e-9)[:, None], normal, across)


def _upper(edge: RawEdge, smoothing_mm: float) -> tuple[Float, Float]:
    """The upper edge and the upper surface's direction (n, 2) at the stations, bridged where hidden."""
    off = edge.upper_position_mm - edge.position_mm
    pairs = np.hstack([components(v, edge.normal, edge.across) for v in (off, edge.upper_inward)]).T
    good = edge.seen & np.isfinite(pairs).all(axis=0)
    if good.sum() < LEAST_STATIONS:
        view = f"seen at {good.sum()} of {good.size} stations" if good.any() else "seen nowhere"
        raise InputError("edge", f"the stock's upper edge was {view}: its thickness is not known")
    s = edge.arc_length_mm
    smooth = [_smoothed(s[good], pair[good], s, smoothing_mm) for pair in pairs]
    return np.stack(smooth[:2], axis=1), unit(np.stack(smooth[2:], axis=1))


def _smoothed(s: Float, values: Float, at: Float, half_width: float) -> Float:
    """Values (g,) at s (g,), smoothed, at the stations `at` (n,); linear where none is near."""
    if half_width > 0:  # straight but for bends: a wedge has its slope at its ends too
        values = fit_course(s, values, orders=(2, 3), shared=Shared(half_width)).value(s)
    return np.interp(at, s, values)


def _seen(stations: Float, seen: Bool, at: Float) -> Bool:
    """Whether both stations about each place (k,) were seen."""
    after = np.clip(np.searchsorted(stations, at - 1e-9), 1, stations.size - 1)
    before = after - 1
    on_after, on_before = stations[after] - at < 1e-6, at - stations[before] < 1e-6
    return np.asarray((seen[before] | on_after) & (seen[after] | on_before))


LEAST_DEPTH_MM = 0.05  # less than this is no layer of its own: the upper edge is not known better


@dataclass(frozen=True, slots=True, eq=False)
class Bevel:
    """The finished bevel face: through `plane_mm` above the lower edge, normal b = n cos(angle) + m sin(angle)."""

    root_mm: float
    angle: float  # rad
    fillet_mm: float = 0.0  # radius of a J preparation; 0: none
    to_ball_mm: float = 0.0  # of a J preparation: from the tool frame's origin down the cutter to its ball's centre

    @property
    def plane_mm(self) -> float:
        """Where the face's plane meets the end face: c + r (1 - 1 / sin(beta)), which may be below the lower edge."""
        return self.root_mm + self.fillet_mm * (1.0 - 1.0 / math.sin(self.angle))

    @property
    def normal(self) -> Float:
        """b (2,) along n and m."""
        return np.array([math.cos(self.angle), math.sin(self.angle)])

    @property
    def up(self) -> Float:
        """Up the face (2,), along n and m."""
        return np.array([-math.sin(self.angle), math.cos(self.angle)])

    def height_mm(self, section: Float) -> Float:
        """Height (k,) of points (k, 2) above the finished face, along b."""
        return np.asarray(section @ self.normal - self.plane_mm * math.sin(self.angle))

    def fillet_end(self, height_mm: float | Float) -> Float:
        """Where fillet and face meet (k, 2), at heights: h - r along b from the ball's place, (0, c + r)."""
        ball = np.array([0.0, self.root_mm + self.fillet_mm])
        return np.asarray(ball + np.outer(height_mm - self.fillet_mm, self.normal))

    def u_of_root(self, u_mm: Float) -> Float:
        """u (k,) of the root face that u (k, 2) of the edge along n and m make: the plane's, or the fillet's end."""
        if self.fillet_mm:
            return u_mm[:, 1]
        return np.asarray(np.hypot(*(u_mm * self.normal).T) / math.sin(self.angle))

    def face(self, course: Course, height_mm: float | Float) -> tuple[Float, Float]:
        """Lower and upper end (k, 2) of the face at a height: on the end face or the fillet, and on the upper surface.

        Where the stock does not reach that high the two have changed places: the upper one lies below the lower one.
        """
        lower = np.zeros_like(course.upper_mm)
        lower[:, 1] = self.plane_mm + height_mm / math.sin(self.angle)
        if self.fillet_mm:
            end = self.fillet_end(height_mm)
            lower = np.where(end[:, :1] < 0.0, end, lower)
        above = height_mm - self.height_mm(course.upper_mm)
        upper = course.upper_mm + (above / (course.inward @ self.normal))[:, None] * course.inward
        return lower, upper

    def width_mm(self, course: Course, height_mm: float | Float) -> Float:
        """Width (k,) of the face at a height, up the bevel; 0 where the stock does not reach that high."""
        lower, upper = self.face(course, height_mm)
        return np.asarray(np.maximum((upper - lower) @ self.up, 0.0))

    def middle(self, course: Course, height_mm: float | Float) -> Float:
        """Middle (k, 2) of the face at a height, or the middle of a ball-ended cutter: origin of the tool's frame."""
        if self.fillet_mm:
            return np.broadcast_to(self.fillet_end(height_mm) + self.to_ball_mm * self.up, course.upper_mm.shape)
        return np.asarray(sum(self.face(course, height_mm)) / 2.0)


def bevel_of(root_mm: float, bevel_deg: float, root_radius_mm: float = 0.0) -> Bevel:
    """The bevel that is required."""
    return Bevel(root_mm, bevel_deg * DEG, root_radius_mm)


def finished(toolpath: Toolpath) -> Bevel:
    """The bevel that a path is for, milled with its cutter."""
    return replace(
        bevel_of(toolpath.root_mm, toolpath.bevel_deg, toolpath.root_radius_mm),
        to_ball_mm=toolpath.cutter.cylinder_end_mm,
    )


def upper_bevel(lower: Bevel, upper_deg: float | None, lower_mm: float | None) -> Bevel | None:
    """The upper bevel of a compound one, as far down as its plane meets the end face; None: there is none.

    Its plane runs through the place `lower_mm` above the root face on the lower bevel, (-h tan beta, c + h).

    Raises:
        InputError: only one of both is given, or the upper bevel is no flatter than the lower one.
    """
    if upper_deg is None and lower_mm is None:
        return None
    if upper_deg is None or lower_mm is None:
        given, other = (
            ("lower_bevel_mm", "upper_bevel_deg") if upper_deg is None else ("upper_bevel_deg", "lower_bevel_mm")
        )
        raise InputError(given, f"expected {other} beside it: a compound bevel has both")
    if upper_deg * DEG <= lower.angle:
        raise InputError(
            "upper_bevel_deg",
            f"expected more than the lower bevel's {lower.angle / DEG:g} deg, found {upper_deg:g}: a steeper upper "
            "bevel is hollow, a cylindrical cutter would cut into the lower one",
        )
    return Bevel(lower.root_mm + lower_mm * (1.0 - math.tan(lower.angle) / math.tan(upper_deg * DEG)), upper_deg * DEG)


def under(course: Course, bevel: Bevel) -> Course:
    """The course under a bevel that was milled before: its face stands for the stock's upper surface."""
    upper = np.tile([0.0, bevel.root_mm], (len(course.upper_mm), 1))
    inward = np.tile([-math.sin(bevel.angle), math.cos(bevel.angle)], (len(course.upper_mm), 1))
    return replace(course, upper_mm=upper, inward=inward)


def raised(bevel: Bevel, by_mm: float) -> Bevel:
    """The bevel whose face lies `by_mm` above, along the normal."""
    return Bevel(bevel.root_mm + by_mm / math.sin(bevel.angle), bevel.angle)


def layer_heights(stock_mm: Float, depth_of_cut_mm: float, last_mm: float | None = None) -> Float:
    """Heights of the layers above the finished face in cutting order, the last one 0; none above all of the stock.

    The stock (k,) is what stands above the finished face. The first layer takes the rest, the others a full depth, but
    the last `last_mm`, where that is given.
    """
    last = depth_of_cut_mm if last_mm is None else last_mm
    above = float(np.max(stock_mm)) - LEAST_DEPTH_MM
    if above <= 0.0:
        return np.empty(0)
    if above <= last:
        return np.zeros(1)
    full = np.arange(math.ceil((above - last) / depth_of_cut_mm) - 1, -1, -1) * depth_of_cut_mm
    return np.append(last + full, 0.0)
