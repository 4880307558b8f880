"""A part before the cutter: motions remove material from it, and run into what stands around it."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from workbench.geometry.poses import inverse
from workbench.synthetic import raycast
from workbench.synthetic.collisions import clamp_overlap, table_overlap
from workbench.synthetic.dexels import Sweep, cut_lines
from workbench.synthetic.stock_lines import ceiling_mm, lines_of, new_cut, raw_heights_mm
from workbench.synthetic.surface import build_surface, clamp_boxes, pose
from workbench.synthetic.workpiece import CONVERGING, Cut, Workpiece
from workbench.units import Float, Int

STEP_MM = 0.1  # the cutter is set down this often: it leaves ridges of STEP_MM^2 / (8 radius)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A motion of the cutter: k >= 2 poses, at most a millimetre and a degree apart, linear between them.

    The cutter's axis is parallel to a pose's z and stands `axis_offset_mm` behind it, against x; it reaches `tip_mm`
    along z and has no end on the other side.
    """

    base_from_tool: Float  # (k, 4, 4)
    radius_mm: Float  # (k,)
    axis_offset_mm: float
    tip_mm: float


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

    def remove(self, motion: Motion, step_mm: float = STEP_MM) -> None:
        """Remove what the cutter sweeps, set down every `step_mm` or closer."""
        poses = self.part_from_base @ motion.base_from_tool
        first, last = self._columns(poses, motion)
        sweep = Sweep(
            poses[:, :3, 3].copy(),
            poses[:, :3, 0].copy(),
            poses[:, :3, 2].copy(),
            motion.radius_mm,
            motion.axis_offset_mm,
            motion.tip_mm,
            first,
            last,
        )
        cut_lines(self.height_mm, self.lines, sweep, step_mm)

    def hits(self, motion: Motion) -> list[Hit]:
        """Clamps and table that the cutter runs into, each with the deepest place."""
        poses = self.part_from_base @ motion.base_from_tool
        centre, axis = poses[:, :3, 3] - motion.axis_offset_mm * poses[:, :3, 0], poses[:, :3, 2]
        overlaps = [("a clamp", clamp_overlap(b, centre, axis, motion.radius_mm, motion.tip_mm)) for b in self._boxes]
        if self._table_gap_mm is not None:
            overlaps.append(
                ("the table", table_overlap(-self._table_gap_mm, centre, axis, motion.radius_mm, motion.tip_mm))
            )
        u = raycast.project_all(self.surface, poses[:, :3, 3])[:, 0]
        return [Hit(what, float(deep.max()), float(u[np.argmax(deep)])) for what, deep in overlaps if deep.max() > 0.0]

    def _columns(self, poses: Float, motion: Motion) -> tuple[Int, Int]:
        """Columns [first, last) that each piece between two poses can reach; none where the cutter is clear of all."""
        cut, axis, radius = self._cut, poses[:, :3, 2], float(np.max(motion.radius_mm))
        centre = poses[:, :3, 3] - motion.axis_offset_mm * poses[:, :3, 0]
        ceiling = ceiling_mm(self.surface, cut)
        extent = math.hypot(max(abs(cut.w_mm[0]), abs(cut.w_mm[-1])), ceiling) + cut.root_mm
        foot, away = self._foot(centre, axis, motion.tip_mm)
        low, high = self._section(foot - extent * axis), self._section(foot + extent * axis)
        clear = (np.minimum(low[:, 1], high[:, 1]) - radius > ceiling) | (away > extent + radius + 1.0)
        aside = CONVERGING * radius + 1.0
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


def _moved(a_from_b: Float, points: Float) -> Float:
    return points @ a_from_b[:3, :3].T + a_from_b[:3, 3]
