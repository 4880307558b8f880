"""The bevel in the section plane: what stands above the finished face, and where a layer meets the stock.

A J preparation is a bevel whose face ends in a fillet of the cutter's own radius, tangent to the face and square to the
end face where the root face ends. A ball end makes it whose centre stands above that place (docs/planning.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from workbench.artefacts import Toolpath
from workbench.errors import InputError
from workbench.path.course import Course
from workbench.units import DEG, Float

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

    def root_u_mm(self, u_mm: Float) -> Float:
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
