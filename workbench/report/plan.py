"""Plan view along the edge of what was set aside: rejected points, hidden stretches, burrs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from workbench.artefacts import Cloud, Edge, Inspection
from workbench.report.along import hidden_stretches
from workbench.report.colours import FACES, INK, REJECTED
from workbench.report.develop import developed
from workbench.report.figures import hatch_hidden, mark_sections, styled, svg
from workbench.report.sample import Points, frame_arc_length_mm, overview, rejected
from workbench.units import Float

SEARCHED, DRAWN = 4_000_000, 30_000  # grid points searched for rejected ones; points drawn of each sort
MARGIN_MM = 3.0  # shown beyond the faces


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The picture and what it leaves out."""

    svg: bytes
    every_frame: int  # one frame in so many was searched for rejected points
    outside: int  # rejected points found there that lie outside the picture


def plan_view(cloud: Cloud, edge: Edge, inspection: Inspection) -> Plan:
    """Arc length to the right, the way from the lower to the upper side upwards."""
    points, kept = _laid_out(overview(cloud, edge, DRAWN), cloud, edge)
    found, step = rejected(cloud, edge, SEARCHED)
    _, out = _laid_out(found, cloud, edge)
    faces = kept if len(kept) else np.zeros((1, 3))
    low, high = faces[:, 2].min() - MARGIN_MM, faces[:, 2].max() + MARGIN_MM
    s = edge.arc_length_mm
    shown = (out[:, 2] > low) & (out[:, 2] < high) & (out[:, 0] >= s[0]) & (out[:, 0] <= s[-1])
    with styled():
        figure = Figure(figsize=(10, 2.7))
        axes = figure.add_axes((0.068, 0.18, 0.8, 0.71))
        axes.set(xlim=(0.0, s[-1]), ylim=(low, high))
        for label in np.unique(points.label):
            s_mm, _, v_mm = kept[points.label == label].T
            axes.plot(s_mm, v_mm, ".", color=FACES[int(label)], alpha=0.25, markersize=3, mew=0, rasterized=True)
        mark_sections(axes, [x.arc_length_mm for x in inspection.sections], [str(x.index) for x in inspection.sections])
        hatch_hidden(axes, hidden_stretches(edge))
        few = out[shown][:: max(1, int(shown.sum()) // DRAWN)]
        axes.plot(few[:, 0], few[:, 2], ".", color=REJECTED, markersize=2.2, markeredgewidth=0, rasterized=True)
        if len(edge.burr_stations):
            axes.plot(s[edge.burr_stations], np.full(len(edge.burr_stations), low), "^", color=INK, clip_on=False)
        axes.set_xlabel("arc length along the lower edge, mm")
        axes.set_ylabel("v across the edge, mm")
        return Plan(svg(figure), step, int((~shown).sum()))


def _laid_out(points: Points, cloud: Cloud, edge: Edge) -> tuple[Points, Float]:
    """The points and their (n, 3) s, u, v; those of passes that never saw the edge are left out."""
    start = frame_arc_length_mm(cloud, edge)[points.frame]
    known = np.isfinite(start)
    points = points.where(known)
    return points, developed(points.position_mm, start[known], edge)
