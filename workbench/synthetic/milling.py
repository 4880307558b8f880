"""A part before the cutter: the lines on which its material is counted, and which of them a motion can reach."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from workbench.geometry.poses import inverse
from workbench.synthetic import raycast
from workbench.synthetic.dexels import Lines, Sweep, cut_lines
from workbench.synthetic.surface import build_surface, edge_frames, pose
from workbench.synthetic.workpiece import Cut, Workpiece
from workbench.units import Float, Int

U_STEP_MM, W_STEP_MM = 0.2, 0.1
STEP_MM = 0.1  # the cutter is set down this often: it leaves ridges of STEP_MM^2 / (8 radius)
_BESIDE_MM = 1.5  # lines lie so far beyond the face at its two edges
_ABOVE_MM = 2.0  # a line starts so far above the highest place that the stock can have
_CONVERGING = 1.3  # as in `surface`


class Stock:
    """The material of one workpiece while it is being milled, as heights on lines normal to the bevel plane.

    Its plane is that of the first milling: `root_mm` and `bevel` (rad) only choose it, the cutter cuts anywhere.
    """

    def __init__(self, workpiece: Workpiece, root_mm: float, bevel: float) -> None:
        part, earlier = workpiece.recipe.part, workpiece.cut
        self.surface = build_surface(part, workpiece.recipe.seed)
        self.part_from_base = inverse(pose(part.base_from_part))
        self._cut = _new_cut(self.surface, root_mm, bevel) if earlier is None else earlier
        self.lines = _lines(self.surface, self._cut)
        if earlier is None:
            self._cut = dataclasses.replace(self._cut, stock_mm=_raw_heights(self.surface, self._cut, self.lines))
        self.height_mm = self._cut.height_mm.copy()

    @property
    def cut(self) -> Cut:
        """The cut as it is now."""
        height = self.height_mm.copy()
        return dataclasses.replace(self._cut, height_mm=height, times=self._cut.times + 1)

    def u_of(self, position_mm: Float) -> Float:
        """u (k,) of base points (k, 3)."""
        return raycast.project_all(self.surface, _moved(self.part_from_base, position_mm))[:, 0]

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

    def remove(self, base_from_tool: Float, radius_mm: Float, axis_offset_mm: float, tip_mm: float,
               step_mm: float = STEP_MM) -> None:  # fmt: skip
        """Remove what the cutter sweeps through poses (k, 4, 4), k >= 2, at most a millimetre and a degree apart.

        Its axis is parallel to the pose's z and stands `axis_offset_mm` behind it, against x; it reaches `tip_mm` along
        z and has no end on the other side. `radius_mm` (k,).
        """
        poses = self.part_from_base @ base_from_tool
        first, last = self._columns(poses, float(np.max(radius_mm)), axis_offset_mm, tip_mm)
        sweep = Sweep(poses[:, :3, 3].copy(), poses[:, :3, 0].copy(), poses[:, :3, 2].copy(), radius_mm, axis_offset_mm,
                      tip_mm, first, last)  # fmt: skip
        cut_lines(self.height_mm, self.lines, sweep, step_mm)

    def _columns(self, poses: Float, radius: float, offset: float, tip: float) -> tuple[Int, Int]:
        """Columns [first, last) that each piece between two poses can reach; none where the cutter is clear of all."""
        cut, axis = self._cut, poses[:, :3, 2]
        centre = poses[:, :3, 3] - offset * poses[:, :3, 0]
        ceiling = _ceiling(self.surface, cut)
        extent = math.hypot(max(abs(cut.w_mm[0]), abs(cut.w_mm[-1])), ceiling) + cut.root_mm
        foot, away = self._foot(centre, axis, tip)
        low, high = self._section(foot - extent * axis), self._section(foot + extent * axis)
        clear = (np.minimum(low[:, 1], high[:, 1]) - radius > ceiling) | (away > extent + radius + 1.0)
        aside = _CONVERGING * radius + 1.0
        first = (np.minimum(low[:, 0], high[:, 0]) - aside) / cut.u_step_mm
        last = (np.maximum(low[:, 0], high[:, 0]) + aside) / cut.u_step_mm
        columns = np.clip([np.minimum(first[:-1], first[1:]), np.maximum(last[:-1], last[1:]) + 1], 0, len(cut.u))
        columns[1, clear[:-1] & clear[1:]] = 0
        return columns.astype(np.int64)[0], columns.astype(np.int64)[1]

    def _foot(self, centre: Float, axis: Float, tip: float) -> tuple[Float, Float]:
        """The axis's point (k, 3) nearest to the lower edge, and its distance from it."""
        foot = centre
        for _ in range(2):
            _, h, tx, ty = raycast.project_all(self.surface, foot).T
            edge = np.stack([foot[:, 0] - h * ty, foot[:, 1] + h * tx, np.zeros(len(h))], axis=1)
            foot = centre + np.minimum(np.sum((edge - centre) * axis, axis=1), tip)[:, None] * axis
        return foot, np.linalg.norm(foot - edge, axis=1)

    def _section(self, points: Float) -> Float:
        """u and height over the bevel plane (k, 2) of points (k, 3) in the part's frame."""
        s, cut = self.surface, self._cut
        u, h = raycast.project_all(s, points).T[:2]
        g, v = h * s.tilt_cos - points[:, 2] * s.tilt_sin, points[:, 2] * s.tilt_cos + h * s.tilt_sin
        return np.stack([u, math.cos(cut.bevel) * g + math.sin(cut.bevel) * (v - cut.root_mm)], axis=1)


def _new_cut(surface: raycast.Surface, root_mm: float, bevel: float) -> Cut:
    """Nothing cut yet: lines from beyond the root face's lower edge to beyond the bevel's upper edge."""
    columns, upwards = math.ceil(surface.length / U_STEP_MM) + 1, surface.tilt_cos * math.cos(bevel)
    upper_edge = (surface.top - surface.tilt_cos * root_mm) / (upwards + surface.tilt_sin * math.sin(bevel))
    first = -root_mm * math.cos(bevel) - _BESIDE_MM
    rows = max(2, math.ceil((upper_edge + _BESIDE_MM - first) / W_STEP_MM) + 1)
    uncut = np.full((columns, rows), np.inf)
    return Cut(uncut, uncut, surface.length / (columns - 1), first, W_STEP_MM, root_mm, bevel, 0)


def _lines(surface: raycast.Surface, cut: Cut) -> Lines:
    """The lines in the part's frame, and where each leaves the part through the lower surface."""
    edge, cosine, sine = edge_frames(surface, cut.u), math.cos(cut.bevel), math.sin(cut.bevel)
    outward, up = edge[:, :3, 0], edge[:, :3, 2]
    n = surface.tilt_cos * outward - surface.tilt_sin * up
    m = surface.tilt_cos * up + surface.tilt_sin * outward
    base, across, normal = edge[:, :3, 3] + cut.root_mm * m, cosine * m - sine * n, cosine * n + sine * m
    floor = np.full(len(cut.w_mm), -np.inf)
    if normal[0, 2] > 0.0:  # else the lines leave the part elsewhere
        through = cut.w_mm > -cut.root_mm * cosine  # the others pass beside it
        floor[through] = -(base[0, 2] + cut.w_mm[through] * across[0, 2]) / normal[0, 2]
    return Lines(base, across, normal, cut.w_first_mm, cut.w_step_mm, floor)


def _ceiling(surface: raycast.Surface, cut: Cut) -> float:
    """A height over the bevel plane that no material reaches."""
    corner = math.sin(cut.bevel) * (surface.top / surface.tilt_cos - cut.root_mm)
    return max(corner, 0.0) + surface.reserve + _ABOVE_MM


def _raw_heights(surface: raycast.Surface, cut: Cut, lines: Lines) -> Float:
    """Height (U, W) at which each line, from above, meets the raw part; -inf where it misses it."""
    start = _ceiling(surface, cut)
    origins = lines.base[:, None] + cut.w_mm[:, None] * lines.across[:, None] + start * lines.up[:, None]
    down = np.broadcast_to(-lines.up[:, None], origins.shape)
    found = raycast.drop(surface, origins.reshape(-1, 3), down.reshape(-1, 3), 2.0 * start + surface.width)
    return start - found.reshape(origins.shape[:2])


def _moved(a_from_b: Float, points: Float) -> Float:
    return points @ a_from_b[:3, :3].T + a_from_b[:3, 3]
