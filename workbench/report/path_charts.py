"""Pictures of the plan: edges in the plane of the end face, feed, engagement, layers, feed on them (Figs. 13, 14)."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import ROOT_FACE, Cloud, Edge, Engagement, RawEdge, Toolpath
from workbench.report.along import hidden_stretches
from workbench.report.colour_scales import feed_colours, layer_colours
from workbench.report.colours import GREY, INK, LIMIT, LOWER_EDGE, MEASURED, PALE, UPPER_EDGE, rgb
from workbench.report.figures import hatch_hidden, svg
from workbench.report.planned import Run, middle_of_cut_mm
from workbench.report.plot import Axes, Figure
from workbench.report.procedure import AXIS_MM, LOOK, shown_stretch, station_frame
from workbench.report.sample import Points, around, face_ends, overview
from workbench.report.scene import View, joined, towards
from workbench.units import AnyArray, Bool, Float

CLOSE_UP_MM = 12.0  # half the stretch of edge in the close-up


def path_views(cloud: Cloud, edge: Edge, toolpath: Toolpath, run: Run, budget: int) -> dict[str, View]:
    """Views `layers` and `feed` of the whole edge, and `layers_close` about the middle of what is cut."""
    middle = middle_of_cut_mm(toolpath) or float(edge.arc_length_mm[-1]) / 2.0
    whole = _pale(overview(cloud, edge, budget), edge, middle)
    near = _pale(around(cloud, edge, middle, CLOSE_UP_MM, budget), edge, middle, AXIS_MM)
    by_layer = layer_colours(run.layer, len(toolpath.layers))
    by_feed = feed_colours(run)
    origin, axes = station_frame(edge, middle)
    inside = np.abs((run.position_mm - origin) @ axes[0]) <= CLOSE_UP_MM
    return {
        "layers": _with_run(whole, run, by_layer, origin),
        "layers_close": _with_run(near, run, by_layer, origin, inside & (run.layer > 0)),
        "feed": _with_run(whole, run, by_feed, origin),
    }


def _pale(points: Points, edge: Edge, middle_mm: float, axes_length_mm: float = 0.0) -> View:
    origin, axes = station_frame(edge, middle_mm)
    colour = np.tile(rgb(PALE), (len(points.position_mm), 1))
    return View(points.position_mm - origin, colour, axes, towards(axes, LOOK), axes_length_mm)


def _with_run(view: View, run: Run, colour: AnyArray, origin: Float, inside: Bool | None = None) -> View:
    """The path as lines, each layer and each move between layers one; only the points `inside`."""
    here = np.ones(len(run.layer), dtype=bool) if inside is None else inside
    breaks = np.union1d(run.layer_start, np.flatnonzero(np.diff(here)) + 1)[1:]
    pieces = [piece for piece in np.split(np.arange(len(here)), breaks) if here[piece].all() and len(piece) > 1]
    return joined(view, [run.position_mm[piece] - origin for piece in pieces], [colour[piece] for piece in pieces])


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
    vertices = face_ends(cloud, edge, ROOT_FACE, stretch.frames)
    figure = Figure(figsize=(5.2, 2.9))
    in_plane, off = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    figure.subplots_adjust(0.14, 0.155, 0.985, 0.975, hspace=0.14)
    for curve, points, colour, name in zip(
        curves, vertices, (LOWER_EDGE, UPPER_EDGE), ("lower edge", "upper edge"), strict=True
    ):
        along, across, out = axes @ (curve - origin).T
        dots = axes @ (points.position_mm - origin).T
        in_plane.plot(dots[0], dots[1], ".", color=colour, markersize=1.6)
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
                color=colour,
                fontsize=8,
            )
        off.plot(along, out, color=colour, linewidth=1.1)
    in_plane.margins(x=0.01, y=0.22)
    low, high = off.get_ylim()
    off.set_ylim(min(low, -LEAST_OFF_MM), max(high, LEAST_OFF_MM))
    in_plane.set_ylabel("across, mm")
    off.set_ylabel("off it, mm")
    off.set_xlabel("along the end face's plane, mm")
    for axes_of in (in_plane, off):
        axes_of.y_label_at = -0.11
    return svg(figure)


def feed_chart(edge: Edge, toolpath: Toolpath) -> bytes:
    """SVG of the feed along the final layer; where it cuts stands along the bottom."""
    final = toolpath.layers[-1]
    s, feed = final.arc_length_mm, final.feed_mm_s
    figure = Figure(figsize=(10, 2.6))
    axes = figure.add_axes((0.068, 0.19, 0.8, 0.74))
    axes.set(xlim=(float(s.min()), float(s.max())), ylim=(0.0, 1.12 * float(feed.max())))
    hatch_hidden(axes, hidden_stretches(edge))
    axes.step(s, feed, color=MEASURED, linewidth=1.2)
    _mark_cutting(axes, s, final.cutting)
    axes.axhline(toolpath.v_slow_mm_s, color=LIMIT, linewidth=0.8, dashes=(4, 2.5), zorder=0.8)
    axes.annotate(
        f"cutting feed {toolpath.v_slow_mm_s:g} mm/s",
        (1.0, toolpath.v_slow_mm_s),
        (6, 0),
        xycoords=("axes fraction", "data"),
        va="center",
        fontsize=8,
        color=LIMIT,
    )
    axes.set_xlabel(ALONG)
    axes.set_ylabel("feed, mm/s")
    return svg(figure)


def engagement_chart(edge: Edge, toolpath: Toolpath, engagement: Engagement) -> bytes:
    """SVG of radial depth, axial depth and chip area along each layer, as milled in simulation."""
    count = len(toolpath.layers)
    figure = Figure(figsize=(10, 3.9))
    rows = figure.subplots(len(ENGAGED), 1, sharex=True)
    figure.subplots_adjust(0.068, 0.125, 0.868, 0.98, hspace=0.18)
    for axes, (name, label) in zip(rows, ENGAGED, strict=True):
        for layer in engagement.layers:
            colour = layer_colours(np.array([layer.index]), count)[0] / 255.0
            axes.plot(layer.arc_length_mm, getattr(layer, name), color=colour, linewidth=1.1)
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0.0)
    rows[0].axhline(toolpath.depth_of_cut_mm, color=LIMIT, linewidth=0.8, dashes=(4, 2.5))
    rows[0].annotate(
        f"depth of cut {toolpath.depth_of_cut_mm:g} mm",
        (1.0, toolpath.depth_of_cut_mm),
        (6, 0),
        va="center",
        xycoords=("axes fraction", "data"),
        fontsize=8,
        color=LIMIT,
    )
    for axes in rows:
        hatch_hidden(axes, hidden_stretches(edge))
    rows[-1].set_xlabel(ALONG)
    return svg(figure)


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


def _mark_cutting(axes: Axes, s: Float, cutting: Bool) -> None:
    """Bars along the bottom over the stretches that are cut."""
    change = np.flatnonzero(np.diff(np.r_[False, cutting, False]))
    bars = [(float(s[a]), float(s[b - 1])) for a, b in zip(change[::2], change[1::2], strict=True)]
    axes.bars_below(bars, 0.035, color=GREY)
