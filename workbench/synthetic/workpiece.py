"""A part as the milling twin passes it on: its recipe, and what a cutter has left of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.synthetic.raycast import CUT_REACH_MM, CutTerms
from workbench.synthetic.recipe import Recipe
from workbench.units import DEG, Bool, Float, Shaped

CONVERGING = 1.3  # a unit of u is at least 1/1.3 mm long wherever a cutter is
_CLEAR_MM = 0.5  # a height this far above the stock says the same as any greater one
_CUT_MM = 1e-3  # less than this below the raw surface is not cut
_STRAIGHT_MM = 0.05  # a profile that leaves its line by more is no bevel's
_LEAST_FACE_MM = 0.5  # a narrower face tells no angle


@dataclass(frozen=True, slots=True, eq=False)
class Cut:
    """What milling has left of a raw part, as heights over the plane of a bevel (dexels).

    In the section plane at u the plane starts on the end face, `root_mm` from the lower edge, at `bevel` to it; w
    counts up the plane from there, heights along its outward normal. One height is the lowest that the cutter's surface
    has reached on that line; where it lies above `stock_mm` nothing was cut. Material above a cutter that went *into*
    the part counts as removed: such a slot is deeper than it is, never shallower.
    """

    height_mm: Shaped[Float, "U W"]
    stock_mm: Shaped[Float, "U W"]  # of the raw part; -inf where the line misses it
    u_step_mm: float  # column i of lines lies at u = i u_step_mm
    w_first_mm: float
    w_step_mm: float
    root_mm: float
    bevel: float  # rad
    times: int  # how often the part was milled: every scan after it draws other random numbers

    @property
    def u(self) -> Float:
        """u (U,) of the columns."""
        return np.asarray(np.arange(self.height_mm.shape[0]) * self.u_step_mm)

    @property
    def w_mm(self) -> Float:
        """w (W,) of the rows."""
        return np.asarray(self.w_first_mm + np.arange(self.height_mm.shape[1]) * self.w_step_mm)

    def terms(self, twist: float) -> CutTerms:
        """The cut as the ray kernels see it, on an end face that turns by `twist` rad/mm."""
        height = self._even_height()
        return CutTerms(
            height,
            self.u_step_mm,
            self.w_first_mm,
            self.w_step_mm,
            self.root_mm,
            math.cos(self.bevel),
            math.sin(self.bevel),
            self._safe_share(height, abs(twist) * float(np.ptp(self.w_mm) + np.abs(self.root_mm))),
        )

    def _even_height(self) -> Float:
        """The heights, lowered in the air beside the cut face: walls there cost the rays many small steps."""
        on_face: Bool = self.height_mm < self.stock_mm
        rows, columns = np.arange(on_face.shape[1]), np.arange(len(on_face))
        first, last = np.argmax(on_face, axis=1), rows[-1] - np.argmax(np.flip(on_face, axis=1), axis=1)
        nearest = self.height_mm[columns[:, None], np.clip(rows, first[:, None], last[:, None])]
        above = np.max(self.stock_mm, axis=1, keepdims=True) + _CLEAR_MM
        beside = np.where(np.any(on_face, axis=1, keepdims=True), nearest, above)
        return np.minimum(self.height_mm, np.maximum(self.stock_mm + _CLEAR_MM, beside))

    def _safe_share(self, height: Float, turning: float) -> Float:
        """Per column 1 / (a bound on the gradient of the height over the cut face), as far as a step may go."""
        along, up = np.zeros(len(height)), np.max(np.abs(np.diff(height, axis=1)), axis=1) / self.w_step_mm
        along[:-1] = np.max(np.abs(np.diff(height, axis=0)), axis=1) / self.u_step_mm
        near = 2 * math.ceil(CONVERGING * CUT_REACH_MM / self.u_step_mm) + 3
        steepest = np.hypot(
            CONVERGING * (scipy.ndimage.maximum_filter1d(along, near) + turning),
            scipy.ndimage.maximum_filter1d(up, near),
        )
        return np.asarray(1.0 / (1.05 * np.hypot(1.0, steepest)))


@dataclass(frozen=True, slots=True, eq=False)
class Workpiece:
    """A part on its table, in its clamps, before the scanner and the robot that its recipe describes."""

    recipe: Recipe
    cut: Cut | None = None  # None: as the recipe made it


def profile_sizes(cut: Cut, u: Float) -> tuple[Float, Float]:
    """Root face (mm) and bevel angle (deg) at u, as cut; NaN where there is no face to speak of.

    In each section a straight line, p = p0 + slope w, is fitted to the cut profile between the root edge and the upper
    edge; the root ends where that line meets the end face, p = w tan(bevel). Where the profile is no straight line, a
    compound bevel's or a J preparation's, there is no such face.
    """
    on_face = cut.stock_mm - cut.height_mm > _CUT_MM
    count, height = on_face.sum(axis=1), np.where(on_face, cut.height_mm, 0.0)
    made = (count - 1) * cut.w_step_mm >= _LEAST_FACE_MM
    some = np.where(made, count, 1)
    mean_w, mean_p = on_face @ cut.w_mm / some, height.sum(axis=1) / some
    aside = np.where(on_face, cut.w_mm - mean_w[:, None], 0.0)
    slope = np.sum(aside * height, axis=1) / np.where(made, np.sum(aside**2, axis=1), 1.0)
    foot = (mean_p - slope * mean_w) / (math.tan(cut.bevel) - slope)
    root, bevel_deg = cut.root_mm + foot / math.cos(cut.bevel), (cut.bevel - np.arctan(slope)) / DEG
    off = np.where(on_face, height - mean_p[:, None] - slope[:, None] * aside, 0.0)
    made &= np.max(np.abs(off), axis=1) < _STRAIGHT_MM
    root[~made] = bevel_deg[~made] = np.nan
    return np.interp(u, cut.u, root), np.interp(u, cut.u, bevel_deg)
