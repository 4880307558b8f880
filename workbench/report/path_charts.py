"""Charts of the plan: the edges in the end face's plane (the paper's Fig. 8 d), feed, engagement."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Cloud, Edge, Engagement, RawEdge, Toolpath
from workbench.geometry import moves
from workbench.marks import LIMIT, LOWER_EDGE, MEASURED, UPPER_EDGE, Lettering
from workbench.pieces import GREY, INK
from workbench.plot import Figure
from workbench.report.along import hatch_hidden, hidden_stretches, label_level
from workbench.report.planned import layer_ink
from workbench.report.scene import root_ends
from workbench.report.views import shown_stretch
from workbench.units import Float

ALONG = "arc length along the lower edge, mm"
LEAST_OFF_MM = 0.05  # a scale shows so much at least, that a straight edge looks straight
ENGAGED = (
    ("radial_depth_mm", "radial depth,\nmm"),
    ("axial_depth_mm", "axial depth,\nmm"),
    ("chip_area_mm2", "chip area,\nmm²"),
)


def edges_in_plane(cloud: Cloud, edge: RawEdge) -> bytes:
    """SVG of the paper's Fig. 8 (d): both edges in the plane of the end face, and how far they lie off that plane."""
    stretch = shown_stretch(edge)
    here = (edge.arc_length_mm >= stretch.from_mm) & (edge.arc_length_mm <= stretch.to_mm)
    curves = (edge.position_mm[here], edge.upper_position_mm[here])
    origin, axes = _plane(np.vstack(curves), edge.tangent[here], edge.normal[here])
    vertices = root_ends(cloud, edge, stretch.frames)
    figure = Figure(figsize=(5.2, 2.9))
    in_plane, off = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    figure.subplots_adjust(0.14, 0.155, 0.985, 0.975, hspace=0.14)
    for curve, points, colour, name in zip(
        curves, vertices, (LOWER_EDGE, UPPER_EDGE), ("lower edge", "upper edge"), strict=True
    ):
        along, across, out = axes @ (curve - origin).T
        dots = axes @ (points.position_mm - origin).T
        in_plane.points(dots[0], dots[1], ".", color=colour, markersize=1.6)
        in_plane.plot(along, across, color=INK, linewidth=0.7)
        if np.isfinite(along).any():
            middle = float(np.nanmedian(across))
            in_plane.annotate(
                name,
                (0.5, middle),
                (0, -9),
                xycoords=("axes fraction", "data"),
                ha="center",
                va="center",
                look=Lettering(colour),
                fontsize=8,
            )
        off.plot(along, out, color=colour, linewidth=1.1)
    in_plane.shared["x"].margin, in_plane.shared["y"].margin = 0.01, 0.22
    low, high = off.get_ylim()
    off.set(ylim=(min(low, -LEAST_OFF_MM), max(high, LEAST_OFF_MM)))
    in_plane.set(ylabel="across, mm")
    off.set(ylabel="off it, mm", xlabel="along the end face's plane, mm")
    for axes_of in (in_plane, off):
        axes_of.y_label_at = -0.11
    return figure.svg()


def feed_chart(edge: Edge, toolpath: Toolpath) -> bytes:
    """SVG of the feed along the final layer; where it cuts stands along the bottom."""
    final = toolpath.layers[-1]
    s, feed = final.arc_length_mm, final.feed_mm_s
    figure = Figure(figsize=(10, 2.6))
    axes = figure.add_axes((0.068, 0.19, 0.8, 0.74))
    axes.set(xlim=(float(s.min()), float(s.max())), ylim=(0.0, 1.12 * float(feed.max())))
    hatch_hidden(axes, hidden_stretches(edge))
    axes.step(s, feed, color=MEASURED, linewidth=1.2)
    axes.bars_below([(float(s[first]), float(s[last])) for first, last in moves.runs(final.cutting)], 0.035, color=GREY)
    axes.axhline(toolpath.v_slow_mm_s, color=LIMIT, linewidth=0.8, dashes=(4, 2.5), zorder=0.8)
    label_level(axes, toolpath.v_slow_mm_s, f"cutting feed {toolpath.v_slow_mm_s:g} mm/s")
    axes.set(xlabel=ALONG, ylabel="feed, mm/s")
    return figure.svg()


def engagement_chart(edge: Edge, toolpath: Toolpath, engagement: Engagement) -> bytes:
    """SVG of radial depth, axial depth and chip area along each layer, as milled in simulation."""
    count = len(toolpath.layers)
    figure = Figure(figsize=(10, 3.9))
    rows = figure.subplots(len(ENGAGED), 1, sharex=True)
    figure.subplots_adjust(0.068, 0.125, 0.868, 0.98, hspace=0.18)
    rows[0].axhline(toolpath.depth_of_cut_mm, color=LIMIT, linewidth=0.8, dashes=(4, 2.5))
    label_level(rows[0], toolpath.depth_of_cut_mm, f"depth of cut {toolpath.depth_of_cut_mm:g} mm")
    for axes, (name, label) in zip(rows, ENGAGED, strict=True):
        for layer in engagement.layers:
            axes.plot(layer.arc_length_mm, getattr(layer, name), color=layer_ink(layer.index, count), linewidth=1.1)
        axes.set(ylabel=label, ylim=(0.0, None))
        hatch_hidden(axes, hidden_stretches(edge))
    rows[-1].set(xlabel=ALONG)
    return figure.svg()


def _plane(points_mm: Float, tangent: Float, normal: Float) -> tuple[Float, Float]:
    """Centroid (3,) and rows along, across, off (3, 3) of the plane that fits points (n, 3) best."""
    known = points_mm[np.isfinite(points_mm).all(axis=1)]
    origin = known.mean(axis=0)
    off = np.linalg.svd(known - origin, full_matrices=False)[2][2]
    off *= np.sign(off @ normal.mean(axis=0)) or 1.0
    along = tangent.mean(axis=0)
    along = along - (along @ off) * off
    along /= np.linalg.norm(along)
    return origin, np.array([along, np.cross(off, along), off])
