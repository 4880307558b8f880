"""Pictures of the plan: from the scan to the path (the paper's Fig. 8), edges, feed, engagement, layers (13, 14)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from workbench.artefacts import ROOT_FACE, Cloud, Edge, Engagement, RawEdge, Toolpath
from workbench.geometry import moves
from workbench.report.along import hatch_hidden, hidden_stretches, svg
from workbench.report.marks import (
    FACES,
    GREY,
    INK,
    LIMIT,
    LOWER_EDGE,
    MEASURED,
    PALE,
    TOOL_AXES,
    UPPER_EDGE,
    Lettering,
    rgb,
)
from workbench.report.planned import Run, feed_colours, frames_in_base, layer_colours, middle_of_cut_mm
from workbench.report.plot import Axes, Figure
from workbench.report.scene import Points, View, around, face_ends, joined, overview, towards
from workbench.units import AnyArray, Bool, Float, Int

MOST_MM = 100.0  # of edge that these views show
TOOL_FRAMES = 12  # drawn at most
TOOL_AXIS_MM, AXIS_MM = 4.0, 5.0
PANEL_PX = 1000
LOOK = (-0.5, 0.8, 0.45)
LIGHT, DARK = 225.0, 95.0  # grey of the highest and of the lowest point of the cloud


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """The stretch of edge that the views show, and where the frames (k,) in it lie."""

    from_mm: float
    to_mm: float
    frames: Int

    @property
    def middle_mm(self) -> float:
        return (self.from_mm + self.to_mm) / 2.0


def shown_stretch(edge: Edge) -> Shown:
    """The whole edge, or so much about its middle as a picture can show."""
    length = float(edge.arc_length_mm[-1])
    half = min(length, MOST_MM) / 2.0
    start, end = length / 2.0 - half, length / 2.0 + half
    with np.errstate(invalid="ignore"):
        inside = (edge.frame_arc_length_mm >= start) & (edge.frame_arc_length_mm <= end)
    return Shown(start, end, np.flatnonzero(inside))


def procedure_views(cloud: Cloud, edge: RawEdge, toolpath: Toolpath, budget: int) -> dict[str, View]:
    """Views: `a` rough cloud, `b` vertices a frame, `c` end face, `e` edges in space, `f` key points, tool frames."""
    stretch = shown_stretch(edge)
    points = around(cloud, edge, stretch.middle_mm, (stretch.to_mm - stretch.from_mm) / 2.0, budget)
    origin, axes = station_frame(edge, stretch.middle_mm)
    pale = View(points.position_mm - origin, _grey(points, axes), axes, towards(axes, LOOK), AXIS_MM, width_px=PANEL_PX)
    bare = replace(pale, axes_length_mm=0.0)
    return {
        "a": pale,
        "b": _with_vertices(bare, cloud, edge, stretch, origin),
        "c": replace(bare, colour=np.where(points.label[:, None] == ROOT_FACE, rgb(FACES[ROOT_FACE]), bare.colour)),
        "e": _with_edges(bare, edge, stretch, origin),
        "f": _with_tool_frames(bare, toolpath, stretch, origin),
    }


def station_frame(edge: Edge, at_mm: float) -> tuple[Float, Float]:
    """Position (3,) of the measured station nearest to an arc length, and t, n, m there (3, 3)."""
    distance = np.where(np.isfinite(edge.position_mm[:, 0]), np.abs(edge.arc_length_mm - at_mm), np.inf)
    k = int(np.argmin(distance))
    return edge.position_mm[k], np.array([edge.tangent[k], edge.normal[k], edge.across[k]])


def _grey(points: Points, axes: Float) -> AnyArray:
    """Lighter the higher across the edge and the further in, so that the cloud shows its shape."""
    height = points.position_mm @ (axes[2] - 0.5 * axes[1])
    low, high = np.percentile(height, (1.0, 99.0)) if len(height) else (0.0, 1.0)
    fraction = np.clip((height - low) / max(1e-9, high - low), 0.0, 1.0)
    return np.repeat((DARK + (LIGHT - DARK) * fraction)[:, None], 3, axis=1).astype(np.uint8)


def _with_vertices(view: View, cloud: Cloud, edge: Edge, stretch: Shown, origin: Float) -> View:
    """The ends of the end face in each frame, as the grid has them."""
    ends = face_ends(cloud, edge, ROOT_FACE, stretch.frames)
    dots = [each.position_mm - origin for each in ends]
    colours = [np.tile(rgb(c), (len(d), 1)) for c, d in zip((LOWER_EDGE, UPPER_EDGE), dots, strict=True)]
    return replace(view, dots_mm=np.vstack(dots), dot_colour=np.vstack(colours))


def _with_edges(view: View, edge: RawEdge, stretch: Shown, origin: Float) -> View:
    """Lower and upper edge as smooth curves, broken where hidden."""
    here = (edge.arc_length_mm >= stretch.from_mm) & (edge.arc_length_mm <= stretch.to_mm)
    lines, colours = [], []
    for position, colour in ((edge.position_mm, LOWER_EDGE), (edge.upper_position_mm, UPPER_EDGE)):
        for run in runs(position[here]):
            lines.append(run - origin)
            colours.append(np.tile(rgb(colour), (len(run), 1)))
    return joined(view, lines, colours)


def _with_tool_frames(view: View, toolpath: Toolpath, stretch: Shown, origin: Float) -> View:
    """The final layer's key points, and x, y, z at some of them."""
    final = toolpath.layers[-1]
    s = final.arc_length_mm
    keys = np.flatnonzero((s >= stretch.from_mm) & (s <= stretch.to_mm) & final.cutting)
    place = toolpath.in_base(final.position_mm)[keys] - origin
    some = slice(None, None, max(1, math.ceil(len(keys) / TOOL_FRAMES)))
    tools = frames_in_base(toolpath, final)[keys][some].transpose(0, 2, 1)
    lines = [np.array([p, p + TOOL_AXIS_MM * a]) for p, frame in zip(place[some], tools, strict=True) for a in frame]
    colours = [np.tile(rgb(TOOL_AXES[k % 3]), (2, 1)) for k in range(len(lines))]
    return joined(replace(view, dots_mm=place, dot_colour=np.tile(rgb(INK), (len(place), 1))), lines, colours)


def runs(position_mm: Float) -> list[Float]:
    """The stretches of a curve between its NaNs."""
    known = np.isfinite(position_mm).all(axis=1)
    pieces = np.split(position_mm, np.flatnonzero(np.diff(known)) + 1)
    return [piece for piece in pieces if len(piece) > 1 and np.isfinite(piece).all()]


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
        look=Lettering(LIMIT),
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
        look=Lettering(LIMIT),
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
    axes.bars_below([(float(s[first]), float(s[last])) for first, last in moves.runs(cutting)], 0.035, color=GREY)
