"""Where a bevel ends at its root: what its last returns tell of the columns' footprint and of a blunted root.

Footprint, fill, incidence and the prior of the break are those of a milled edge's end (`end_templates`, eq. (12)).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Unseen
from workbench.edge.end_templates import (
    FILLS,
    FOOTPRINTS,
    INCIDENCE_PRIOR,
    INCIDENCES,
    OFFSET,
    OFFSET_MM,
    PRIORS,
    QUARTER,
    EdgeCondition,
    EdgePrior,
    end_templates,
)
from workbench.geometry.course import shares

# An edge of less than a right angle that nothing was said of: as likely sharp as blunted, in handling.
KNIFE = EdgePrior(0.5, 0.5, 0.0, 0.005, 0.05)
BLUNTED = Unseen(
    "knife_edge",
    "A rounding of the knife edges by 0.1 mm: the view from above hides it. `edge_condition`: `deburred` has it in u.",
    {"gap_mm": 0.15, "depth_mm": 0.15},
)


class RootView(NamedTuple):
    """How a pass sees the end of a face."""

    fall: float  # of the face below the plate's upper surface, rad
    graze: float  # by how much more a face would fall along the rays, rad
    step_mm: float  # of the columns, along the face
    column_mm: float  # across the face, as much as a return is off that belongs one column further
    above_mm: float  # of the last returns over the face's line, on average; NaN: not told
    above_u_mm: float
    alone: bool  # whether nothing that is seen behind the end may take a column


def beyond(view: RootView, condition: EdgeCondition, knife: float) -> tuple[float, float]:
    """How far the virtual edge lies beyond where columns end, and its standard uncertainty, mm along the face.

    A column of footprint w returns the face if that fills more than a share f of it: up to (1/2 - f) w beyond the end.
    Of what it sees in part it returns the middle, above the line of a falling face, over L = w (1 - f) columns: last
    returns are off by L^2 / 4 columns in the mean (by L / 2 - 1 / 4 above one column). A blunted edge is seen up to the
    turn t at which the rays no longer return; there its returns lie r (1 - cos t) below the line, and the virtual edge
    r (tan(d / 2) - sin t) beyond, d being by how much the face behind turns away: that of the plate's lower surface
    with the probability `knife`, otherwise a root face square to the upper one. In a few views last returns are offset
    without such a cause.
    """
    templates = end_templates(KNIFE if condition == "unknown" else PRIORS[condition])
    rounded = (templates.turn == 0.0) & np.isfinite(templates.log_prior)
    radius, log_prior = templates.size_mm[rounded], templates.log_prior[rounded]
    r, w, f, i, behind = np.meshgrid(
        radius, FOOTPRINTS, FILLS, INCIDENCES, (math.pi - view.fall, 0.5 * math.pi - view.fall), indexing="ij"
    )
    turn = np.clip(view.graze - 0.5 * math.pi + i, 0.0, behind)
    with np.errstate(divide="ignore"):
        log = (
            log_prior[:, None, None, None, None]
            + np.log(INCIDENCE_PRIOR)[:, None]
            + np.log([knife, 1.0 - knife])
            + np.where(view.alone & (f > 0.6), -np.inf, 0.0)
            + np.where(i < min(0.5 * math.pi - view.graze, INCIDENCES[-1]), -np.inf, 0.0)
        )
    if math.isfinite(view.above_mm) and view.above_u_mm > 0.0:
        seen = w * (1.0 - f)
        mixed = view.column_mm * np.where(seen < 1.0, 0.25 * seen**2, 0.5 * seen - 0.25)
        last = np.clip(r * np.sin(turn) - 0.5 * view.step_mm, 0.0, None)  # half a column before its end on average
        deep = r - np.sqrt(r**2 - last**2)
        off, square = view.above_mm - mixed + deep, view.above_u_mm**2 + (QUARTER * deep) ** 2
        plain, offset = (-0.5 * (off**2 / each + np.log(each)) for each in (square, square + OFFSET_MM**2))
        log = log + np.logaddexp(math.log1p(-OFFSET) + plain, math.log(OFFSET) + offset)
    share = shares(log)
    off = r * (np.tan(0.5 * behind) - np.sin(turn)) - (0.5 - f) * w * view.step_mm
    mean = float((share * off).sum())
    return mean, math.sqrt(max(float((share * (off - mean) ** 2).sum()), 0.0))
