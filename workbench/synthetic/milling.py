"""A part before the cutter: motions remove material from it, and run into what stands around it.

One compiled kernel removes what a moving cutter sweeps from lines (dexels) normal to the bevel. The cutter stands still
at steps along its path; each line is cut exactly, where it enters the cylinder or the half sphere at its end. Between
two steps, `step` apart, a ridge of at most step^2 / (8 radius) stays: 0.25 micrometres at 0.1 mm and a radius of 5 mm.
(Dexels: T. Van Hook, Real-time shaded NC milling display, SIGGRAPH 1986, 15.)
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from workbench.geometry.poses import inverse, mapped
from workbench.kernels import kernel
from workbench.synthetic import raycast
from workbench.synthetic.workpiece import (
    CONVERGING,
    Cut,
    Workpiece,
    build_surface,
    clamp_boxes,
    course_values,
    edge_frames,
    end_face_axes,
    pose,
)
from workbench.units import Float, Int, Shaped

_ALMOST_PARALLEL = 1e-12
_ALONG = 0.1  # an axis that leans more than this out of the plane is not looked at twice
# The lines (dexels) on which a part's material is counted while it is milled: normal to a bevel plane.

U_STEP_MM, W_STEP_MM = 0.2, 0.1
_MARGIN_MM = 1.5  # lines lie so far beyond the face at its two edges
_NEAR_MM = 0.05  # a ray starts this far above the highest place that its line can have


class Lines(NamedTuple):
    """The lines: (U, W) of them start at base + w across and run along up, in the part's frame; mm."""

    base: Shaped[Float, "U 3"]
    across: Shaped[Float, "U 3"]  # unit, up the bevel's plane
    up: Shaped[Float, "U 3"]  # unit, the plane's outward normal
    w_first: float
    w_step: float
    floor: Shaped[Float, "U W"]  # height at which a line leaves the part below


class Sweep(NamedTuple):
    """A motion of the cutter through k poses, in the part's frame; between two of them it is linear."""

    tip_frame: Shaped[Float, "k 3"]  # the frame's origin
    x: Shaped[Float, "k 3"]  # unit, into the material: the axis runs `axis_offset` behind
    z: Shaped[Float, "k 3"]  # unit, along the axis, from shank to tip
    radius: Shaped[Float, " k"]
    axis_offset: float
    tip: float  # how far the cylinder reaches beyond the frame's origin, along z; the shank has no end
    ball: bool  # there a half sphere of the same radius goes on; else it is flat
    first: Int  # (k-1,) columns of lines that each piece of the motion can reach: first, and
    last: Int  # (k-1,) the one after the last


@kernel
def _cut_column(
    height: Float, lines: Lines, column: int, c: Float, a: Float, radius: float, tip: float, ball: bool
) -> None:
    """Cut one column's lines by the cylinder of axis c + s a, s <= tip, and by the ball at its end."""
    ba, aa, bq, qa, q_across, qq = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        up, across, q = lines.up[column, k], lines.across[column, k], lines.base[column, k] - c[k]
        ba += up * a[k]
        aa += across * a[k]
        bq += up * q
        qa += q * a[k]
        q_across += q * across
        qq += q * q
    bb = 1.0 - ba * ba  # squared length of the line's direction across the axis
    inner = qq - qa * qa - radius * radius
    for row in range(height.shape[1]):
        w = lines.w_first + row * lines.w_step
        along = (bq - qa * ba) - w * aa * ba
        outside = inner + 2.0 * w * (q_across - qa * aa) + w * w * (1.0 - aa * aa)
        below, above = -math.inf, math.inf
        if bb > _ALMOST_PARALLEL:
            reach = along * along - bb * outside
            if reach <= 0.0:
                continue  # nor does it meet the ball, which the cylinder's sides enclose
            root = math.sqrt(reach)
            below, above = (-along - root) / bb, (-along + root) / bb
        elif outside >= 0.0:
            continue
        beyond = qa + w * aa - tip  # of the line's foot, beyond the tip
        if abs(ba) > _ALMOST_PARALLEL:
            if ba > 0.0:
                above = min(above, -beyond / ba)
            else:
                below = max(below, -beyond / ba)
        elif beyond > 0.0:
            above = -math.inf
        if ball:  # |line - (c + tip a)| = radius
            middle = bq - tip * ba
            square = middle * middle - outside - beyond * beyond
            if square > 0.0:
                root = math.sqrt(square)
                below = min(below, -middle - root) if below < above else -middle - root
                above = max(above, -middle + root)
        if below < above and below < height[column, row] and above > lines.floor[column, row]:
            height[column, row] = max(below, lines.floor[column, row])


@kernel
def _passes_above(lines: Lines, rows: int, column: int, c: Float, a: Float, radius: float, highest: float) -> bool:
    """Whether the cylinder surely stays above `highest` on all lines of a column: then nothing is to be cut.

    Where it is `offset` from the column's plane, it reaches down sqrt(radius^2 - offset^2) from its axis at most.
    """
    up, across, forward, height, w, offset = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        n, m = (k + 1) % 3, (k + 2) % 3
        tangent = lines.up[column, n] * lines.across[column, m] - lines.up[column, m] * lines.across[column, n]
        q = c[k] - lines.base[column, k]
        up += lines.up[column, k] * a[k]
        across += lines.across[column, k] * a[k]
        forward += tangent * a[k]
        height += lines.up[column, k] * q
        w += lines.across[column, k] * q
        offset += tangent * q
    if abs(across) < _ALONG:
        return False
    low = (lines.w_first - radius - w) / across  # the stretch of the axis that can come near these lines
    high = (lines.w_first + (rows - 1) * lines.w_step + radius - w) / across
    nearest = min(abs(offset + low * forward), abs(offset + high * forward))
    if (offset + low * forward) * (offset + high * forward) < 0.0:
        nearest = 0.0
    down = math.sqrt(max(radius * radius - nearest * nearest, 0.0))
    return nearest >= radius or height + min(low * up, high * up) - down >= highest


@kernel
def _highest(heights: Float) -> float:
    best = -math.inf
    for value in heights:
        best = max(best, value)
    return best


@kernel
def cut_lines(height: Float, lines: Lines, top: Float, sweep: Sweep, step: float) -> None:
    """Lower `height` (U, W) to what the sweep leaves, in place; the cutter is set down every `step` mm or closer.

    Above `top` (U,) there is nothing to cut.
    """
    c, a, x, rows = np.empty(3), np.empty(3), np.empty(3), height.shape[1]
    highest = np.minimum(np.array([_highest(column) for column in height]), top)
    for i in range(len(sweep.first)):
        if sweep.last[i] <= sweep.first[i]:
            continue
        way, turn = 0.0, 0.0
        for k in range(3):
            way += (sweep.tip_frame[i + 1, k] - sweep.tip_frame[i, k]) ** 2
            turn += (sweep.x[i + 1, k] - sweep.x[i, k]) ** 2 + (sweep.z[i + 1, k] - sweep.z[i, k]) ** 2
        reach = sweep.axis_offset + rows * lines.w_step
        pieces = max(1, math.ceil((math.sqrt(way) + reach * math.sqrt(turn)) / step))
        for piece in range(pieces + 1):
            f = piece / pieces
            a_length, x_length = 0.0, 0.0
            for k in range(3):
                a[k] = (1.0 - f) * sweep.z[i, k] + f * sweep.z[i + 1, k]
                x[k] = (1.0 - f) * sweep.x[i, k] + f * sweep.x[i + 1, k]
                a_length += a[k] * a[k]
                x_length += x[k] * x[k]
            for k in range(3):
                origin = (1.0 - f) * sweep.tip_frame[i, k] + f * sweep.tip_frame[i + 1, k]
                a[k] /= math.sqrt(a_length)
                c[k] = origin - sweep.axis_offset * x[k] / math.sqrt(x_length)
            radius = (1.0 - f) * sweep.radius[i] + f * sweep.radius[i + 1]
            for column in range(sweep.first[i], sweep.last[i]):
                if not _passes_above(lines, rows, column, c, a, radius, highest[column]):
                    _cut_column(height, lines, column, c, a, radius, sweep.tip, sweep.ball)
                    highest[column] = min(_highest(height[column]), top[column])


def new_cut(surface: raycast.Surface, root_mm: float, bevel: float) -> Cut:
    """Nothing cut yet: lines from beyond the root face's lower edge to beyond the bevel's upper edge."""
    columns, tilt = math.ceil(surface.length / U_STEP_MM) + 1, surface.tilt + surface.twist * _ends(surface)
    upper_edge = float(np.max((surface.top - np.cos(tilt) * root_mm) / np.cos(bevel - tilt)))
    first = -root_mm * math.cos(bevel) - _MARGIN_MM
    rows = max(2, math.ceil((upper_edge + _MARGIN_MM - first) / W_STEP_MM) + 1)
    uncut = np.full((columns, rows), np.inf)
    return Cut(uncut, uncut, surface.length / (columns - 1), first, W_STEP_MM, root_mm, bevel, 0)


def lines_of(surface: raycast.Surface, cut: Cut) -> Lines:
    """The lines in the part's frame, and where each leaves the part through the lower surface."""
    edge, cosine, sine = edge_frames(surface, cut.u), math.cos(cut.bevel), math.sin(cut.bevel)
    outward, up = edge[:, :3, 0], edge[:, :3, 2]
    n, m = end_face_axes(surface, cut.u, outward, up)
    base, across, normal = edge[:, :3, 3] + cut.root_mm * m, cosine * m - sine * n, cosine * n + sine * m
    rises = normal[:, 2, None]
    down = -(base[:, 2, None] + cut.w_mm * across[:, 2, None]) / np.where(rises > 0.0, rises, 1.0)
    # Where a normal does not rise, its line leaves the part elsewhere; the first lines pass beside the part.
    floor = np.where((rises > 0.0) & (cut.w_mm > -cut.root_mm * cosine), down, -np.inf)
    return Lines(base, across, normal, cut.w_first_mm, cut.w_step_mm, floor)


def _ends(surface: raycast.Surface) -> Float:
    """u where the end face's tilt is least or greatest, and where it is nothing if that lies between."""
    upright = -surface.tilt / surface.twist if surface.twist else 0.0
    return np.array([0.0, surface.length, min(max(upright, 0.0), surface.length)])


def raw_heights_mm(surface: raycast.Surface, cut: Cut, lines: Lines) -> Float:
    """Height (U, W) at which each line, from above, meets the raw part; -inf where it misses it."""
    start = _smooth_heights(surface, cut, lines) + surface.reserve + _NEAR_MM
    origins = lines.base[:, None] + cut.w_mm[:, None] * lines.across[:, None] + start[:, :, None] * lines.up[:, None]
    down = np.broadcast_to(-lines.up[:, None], origins.shape)
    found = raycast.drop(surface, origins.reshape(-1, 3), down.reshape(-1, 3), 2.0 * (surface.reserve + _NEAR_MM))
    return np.asarray(start - found.reshape(start.shape))


def _smooth_heights(surface: raycast.Surface, cut: Cut, lines: Lines) -> Float:
    """As `raw_heights_mm`, without roughness and burrs: where each line crosses the end face or the upper surface."""
    rise = lines.up[:, 2, None]
    height = np.asarray(np.broadcast_to(cut.w_mm * math.tan(cut.bevel), (len(cut.u), len(cut.w_mm))))
    thickness = course_values(surface.thickness, cut.u)
    above = lines.base[:, 2, None] + cut.w_mm * lines.across[:, 2, None]
    to_upper = (thickness[:, None] - above) / np.where(rise > 0.0, rise, 1.0)
    return np.where(rise > 0.0, np.minimum(height, to_upper), height)  # else the end face leans further than the bevel


# Whether the cutter runs into a clamp or the table: what a real cell would not forgive.

_GRID_MM = 1.0  # clamps are looked at so finely; a cutter of radius R overlaps by 1 mm^2 / (8 R) more at most


def clamp_overlap(
    box: Float, centre: Float, axis: Float, radius_mm: Float, tip_mm: float, ball_end: bool = False
) -> Float:
    """How deep (k,) the surface of a clamp, `box` (10,) as for `raycast.enter_box`, lies inside the cutter; 0: not.

    The cutter's axis runs through `centre` (k, 3) along `axis` (k, 3), its cylinder as far as `tip_mm` beyond it.
    """
    points = _surface_points(box)
    middle, extent = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    overlap = np.zeros(len(centre))
    to_middle = middle - centre
    radial = to_middle - np.sum(to_middle * axis, axis=1)[:, None] * axis
    near = np.flatnonzero(np.linalg.norm(radial, axis=1) < extent + radius_mm)
    for k in near:
        offset = points - centre[k]
        along = offset @ axis[k]
        distance = np.sqrt(np.maximum(np.sum(offset**2, axis=1) - along**2, 0.0))
        end = radius_mm[k] - np.hypot(distance, along - tip_mm) if ball_end else 0.0
        overlap[k] = np.max(np.where(along < tip_mm, radius_mm[k] - distance, end), initial=0.0)
    return overlap


def table_overlap(
    table_z_mm: float, centre: Float, axis: Float, radius_mm: Float, tip_mm: float, ball_end: bool = False
) -> Float:
    """How deep (k,) the cutter's tip is in a table at height `table_z_mm`; 0: not."""
    tip_z = centre[:, 2] + tip_mm * axis[:, 2]
    lowest = tip_z - radius_mm * (1.0 if ball_end else np.sqrt(np.maximum(1.0 - axis[:, 2] ** 2, 0.0)))
    return np.asarray(np.maximum(table_z_mm - lowest, 0.0))


def _surface_points(box: Float) -> Float:
    """Points (p, 3) on a grid over a box's faces, its edges and corners among them."""
    low, high = box[4::2], box[5::2]
    ticks = [np.linspace(a, b, max(2, int(np.ceil((b - a) / _GRID_MM)) + 1)) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    on_face = np.any((grid == low) | (grid == high), axis=1)
    along, outward, up = grid[on_face].T
    tangent = np.array([box[2], box[3], 0.0])
    sideways = np.array([box[3], -box[2], 0.0])
    return np.asarray(
        np.array([box[0], box[1], 0.0])
        + along[:, None] * tangent
        + outward[:, None] * sideways
        + up[:, None] * np.array([0.0, 0.0, 1.0])
    )


STEP_MM = 0.1  # the cutter is set down this often: it leaves ridges of STEP_MM^2 / (8 radius)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A motion of the cutter: k >= 2 poses, at most a millimetre and a degree apart, linear between them.

    The cutter's axis is parallel to a pose's z and stands `axis_offset_mm` behind it, against x; it reaches `tip_mm`
    along z and has no end on the other side. `ball_end`: the last `axis_offset_mm` of that are a ball end's.
    """

    base_from_tool: Shaped[Float, "k 4 4"]
    radius_mm: Shaped[Float, " k"]
    axis_offset_mm: float
    tip_mm: float
    ball_end: bool = False

    @property
    def cylinder_end_mm(self) -> float:
        """How far the cylinder reaches along z: there a ball end has its centre."""
        return self.tip_mm - (self.axis_offset_mm if self.ball_end else 0.0)


class Hit(NamedTuple):
    """Something that the cutter must not meet, and how deep it went."""

    what: str
    depth_mm: float
    u: float


class Stock:
    """The material of one workpiece while it is being milled, as heights on lines normal to the bevel plane.

    Its plane is that of the first milling: `root_mm` and `bevel` (rad) only choose it, the cutter cuts anywhere.
    """

    def __init__(self, workpiece: Workpiece, root_mm: float, bevel: float) -> None:
        part, earlier = workpiece.recipe.part, workpiece.cut
        self.surface = build_surface(part, workpiece.recipe.seed)
        self.part_from_base = inverse(pose(part.base_from_part))
        self._cut = new_cut(self.surface, root_mm, bevel) if earlier is None else earlier
        self.lines = lines_of(self.surface, self._cut)
        self._boxes, self._table_gap_mm = clamp_boxes(part, self.surface), part.table_gap_mm
        if earlier is None:
            self._cut = dataclasses.replace(self._cut, stock_mm=raw_heights_mm(self.surface, self._cut, self.lines))
        self.height_mm = self._cut.height_mm.copy()

    @property
    def cut(self) -> Cut:
        """The cut as it is now."""
        height = self.height_mm.copy()
        return dataclasses.replace(self._cut, height_mm=height, times=self._cut.times + 1)

    def u_of(self, position_mm: Float) -> Float:
        """u (k,) of base points (k, 3)."""
        return raycast.project_all(self.surface, mapped(self.part_from_base, position_mm))[:, 0]

    @property
    def u(self) -> Float:
        """u (U,) of the columns of lines."""
        return self._cut.u

    @property
    def w_step_mm(self) -> float:
        """Distance of the rows of lines."""
        return self._cut.w_step_mm

    def removed_mm(self, before_mm: Float) -> Float:
        """Depth (U, W) of material removed since the heights were `before_mm`; below 0: missed by that much."""
        return np.asarray(np.minimum(before_mm, self._cut.stock_mm) - self.height_mm)

    def depth_mm(self, before_mm: Float) -> Float:
        """Greatest depth (U,) removed at each u since then."""
        return np.asarray(np.maximum(self.removed_mm(before_mm).max(axis=1), 0.0))

    def remove(self, motion: Motion) -> None:
        """Remove what the cutter sweeps, set down every `STEP_MM` or closer."""
        poses = self.part_from_base @ motion.base_from_tool
        first, last = self._columns(poses, motion)
        sweep = Sweep(
            poses[:, :3, 3].copy(),
            poses[:, :3, 0].copy(),
            poses[:, :3, 2].copy(),
            motion.radius_mm,
            motion.axis_offset_mm,
            motion.cylinder_end_mm,
            motion.ball_end,
            first,
            last,
        )
        cut_lines(self.height_mm, self.lines, self._cut.stock_mm.max(axis=1), sweep, STEP_MM)

    def hits(self, motion: Motion) -> list[Hit]:
        """Clamps and table that the cutter runs into, each with the deepest place."""
        poses = self.part_from_base @ motion.base_from_tool
        centre, axis = poses[:, :3, 3] - motion.axis_offset_mm * poses[:, :3, 0], poses[:, :3, 2]
        cutter = (motion.radius_mm, motion.cylinder_end_mm, motion.ball_end)
        overlaps = [("a clamp", clamp_overlap(box, centre, axis, *cutter)) for box in self._boxes]
        if self._table_gap_mm is not None:
            overlaps.append(("the table", table_overlap(-self._table_gap_mm, centre, axis, *cutter)))
        u = raycast.project_all(self.surface, poses[:, :3, 3])[:, 0]
        return [Hit(what, float(deep.max()), float(u[np.argmax(deep)])) for what, deep in overlaps if deep.max() > 0.0]

    def _columns(self, poses: Float, motion: Motion) -> tuple[Int, Int]:
        """Columns [first, last) that each piece between two poses can reach: about where its axis is near the edge."""
        cut, axis, radius = self._cut, poses[:, :3, 2], float(np.max(motion.radius_mm))
        centre = poses[:, :3, 3] - motion.axis_offset_mm * poses[:, :3, 0]
        top = max(float(cut.stock_mm.max()), 0.0)
        extent = math.hypot(max(abs(cut.w_mm[0]), abs(cut.w_mm[-1])), top) + abs(cut.root_mm)
        foot = centre
        for _ in range(2):  # the axis's point nearest to the lower edge
            _, h, tx, ty = raycast.project_all(self.surface, foot).T
            edge = np.stack([foot[:, 0] - h * ty, foot[:, 1] + h * tx, np.zeros(len(h))], axis=1)
            foot = centre + np.minimum(np.sum((edge - centre) * axis, axis=1), motion.tip_mm)[:, None] * axis
        ends = [raycast.project_all(self.surface, foot + far * axis)[:, 0] for far in (-extent, extent)]
        margin = CONVERGING * radius + 1.0
        first = (np.minimum(*ends) - margin) / cut.u_step_mm
        last = (np.maximum(*ends) + margin) / cut.u_step_mm
        columns = np.clip([np.minimum(first[:-1], first[1:]), np.maximum(last[:-1], last[1:]) + 1], 0, len(cut.u))
        return columns.astype(np.int64)[0], columns.astype(np.int64)[1]
