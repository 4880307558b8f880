"""Plan view along the edge of rejected points, hidden stretches, burrs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from workbench.artefacts import UNLABELLED, Cloud, Edge, Inspection
from workbench.report.along import hidden_stretches
from workbench.report.colours import FACES, INK, REJECTED
from workbench.report.figures import hatch_hidden, mark_sections, svg
from workbench.report.plot import Figure
from workbench.report.sample import Points, frame_arc_length_mm, overview, rejected
from workbench.report.unrolled_edge import developed
from workbench.units import Float, Int

SEARCHED, KEPT, REJECTS = 4_000_000, 100_000, 20_000  # grid points searched for rejects; points drawn of each sort
MARGIN_MM = 3.0  # shown beyond the faces


@dataclass(frozen=True, slots=True, eq=False)
class PlanView:
    """The picture and what it leaves out."""

    svg: bytes
    every_frame: int  # one frame in so many was searched for rejected points
    outside: int  # rejected points found there that lie outside the picture


def plan_view(cloud: Cloud, edge: Edge, inspection: Inspection) -> PlanView:
    """Arc length to the right, the way from the lower to the upper side upwards."""
    points, kept = _laid_out(overview(cloud, edge, KEPT), cloud, edge)
    found, step = rejected(cloud, edge, SEARCHED)
    _, out = _laid_out(found, cloud, edge)
    faces = kept if len(kept) else np.zeros((1, 3))
    low, high = faces[:, 2].min() - MARGIN_MM, faces[:, 2].max() + MARGIN_MM
    s = edge.arc_length_mm
    shown = (out[:, 2] > low) & (out[:, 2] < high) & (out[:, 0] >= s[0]) & (out[:, 0] <= s[-1])
    figure = Figure(figsize=(10, 2.7))
    axes = figure.add_axes((0.068, 0.18, 0.8, 0.71))
    axes.set(xlim=(0.0, s[-1]), ylim=(low, high))
    pass_index = cloud.pass_index[points.frame]
    for label, each in product(np.setdiff1d(points.label, [UNLABELLED]), np.unique(pass_index)):
        face = (points.label == label) & (pass_index == each)
        if face.any():
            band = _band(points.frame[face], kept[face])
            axes.fill_between(*band, color=FACES[int(label)], alpha=0.3)
    mark_sections(axes, [x.arc_length_mm for x in inspection.sections], [str(x.index) for x in inspection.sections])
    hatch_hidden(axes, hidden_stretches(edge))
    few = out[shown][:: max(1, int(shown.sum()) // REJECTS)]
    axes.plot(few[:, 0], few[:, 2], ".", color=REJECTED, markersize=2.2)
    if len(edge.burr_stations):
        axes.plot(s[edge.burr_stations], np.full(len(edge.burr_stations), low), "^", color=INK, clip_on=False)
    axes.set_xlabel("arc length along the lower edge, mm")
    axes.set_ylabel("v across the edge, mm")
    return PlanView(svg(figure), step, int((~shown).sum()))


def _band(frame: Int, laid_out_mm: Float) -> tuple[Float, Float, Float]:
    """Arc length, lowest and highest v of a face in one pass, a value a frame; NaN where frames leave a gap."""
    first = np.flatnonzero(np.diff(frame, prepend=-1))
    s, low, high = (
        reduce.reduceat(laid_out_mm[:, k], first) for reduce, k in ((np.minimum, 0), (np.minimum, 2), (np.maximum, 2))
    )
    step = np.abs(np.diff(s))
    gaps = np.flatnonzero(step > 4.0 * np.median(step)) + 1 if len(step) else np.arange(0)
    return np.insert(s, gaps, np.nan), np.insert(low, gaps, np.nan), np.insert(high, gaps, np.nan)


def _laid_out(points: Points, cloud: Cloud, edge: Edge) -> tuple[Points, Float]:
    """The points and their (n, 3) s, u, v; those of passes that never saw the edge are left out."""
    start = frame_arc_length_mm(cloud, edge)[points.frame]
    laid_out = developed(points.position_mm, start, edge)
    known = np.isfinite(laid_out[:, 0])  # an unknown start makes all three unknown
    return points.where(known), laid_out[known]
