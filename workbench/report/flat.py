"""The views in space by matplotlib, for systems without OpenGL: the same projection, far points drawn first."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from workbench.report.colours import INK
from workbench.report.scene import AXES, View, aspect, extent

POINTS = 60_000  # drawn at most
WIDTH_IN = 10.0


def flat(view: View) -> bytes:
    """PNG of a view."""
    screen, low, high = extent(view.everything_mm(), view.look, view.axes[2])
    figure = Figure(figsize=(WIDTH_IN, WIDTH_IN * aspect(low, high)), dpi=150)
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.96), aspect="equal")
    axes.set_axis_off()
    points = view.points_mm @ screen.T
    order = np.argsort(points[:, 2])[:: max(1, len(points) // POINTS)]
    dot = min(5.0, max(1.0, POINTS / max(1, len(order))))
    axes.scatter(points[order, 0], points[order, 1], s=dot, c=view.colour[order] / 255.0, linewidths=0)
    for line, colour in view.lines():
        ends = (line @ screen.T)[:, :2]
        axes.add_collection(LineCollection(list(np.stack([ends[:-1], ends[1:]], axis=1)), colors=colour[1:] / 255.0))
    dots = view.dots_mm @ screen.T
    axes.scatter(dots[:, 0], dots[:, 1], s=9.0, c=view.dot_colour / 255.0, linewidths=0, zorder=3)
    for corners, colour, name in zip(view.planes_mm @ screen.T, view.plane_colour / 255.0, view.names, strict=True):
        axes.fill(*corners[:, :2].T, facecolor=(*colour, 0.12), edgecolor=colour, linewidth=1.2)
        axes.annotate(name, corners[3, :2], (0, 3), textcoords="offset points", color=INK, fontsize=11)
    if view.axes_length_mm:
        arrow = {"arrowstyle": "-|>", "color": INK, "shrinkA": 0, "shrinkB": 0}
        for axis, name in zip(view.axes_length_mm * view.axes @ screen.T, AXES, strict=True):
            axes.annotate("", axis[:2], (0.0, 0.0), arrowprops=arrow)
            axes.annotate(name, 1.12 * axis[:2], color=INK, fontsize=11, ha="center", va="center")
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()
