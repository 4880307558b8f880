"""What the report's pictures in space show: sections, the way from the scan to the path (Fig. 8), layers, feed."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from workbench.artefacts import ROOT_FACE, Cloud, Edge, Inspection, RawEdge, Scene, Shading, Strokes, Toolpath
from workbench.marks import FACES, LOWER_EDGE, UPPER_EDGE, rgb
from workbench.pieces import INK, PALE
from workbench.report.planned import Run, feed_colours, layer_colours, middle_of_cut_mm
from workbench.report.scene import Points, View, around, overview, root_ends
from workbench.report.scenes import (
    TOOL_AXIS_MM,
    both_edges,
    by_face,
    path_lines,
    section_axes,
    section_planes,
    station_frame,
    tool_axes,
)
from workbench.report.section_drawing import of_interest
from workbench.units import AnyArray, Float, Int

MOST_MM = 100.0  # of edge that the views of the procedure show
TOOL_FRAMES, AXIS_MM = 12, 5.0  # drawn at most; length of t, n, m
PANEL_PX = 1000
LOOK = (-0.5, 0.8, 0.45)
LIGHT, DARK, MARKED = 225.0, 95.0, 255  # grey of the highest and of the lowest point of the cloud; row of a face
CLOSE_UP_MM, SECTION_MM = 12.0, 14.0  # half the stretch of edge in close-ups of layers, and of a section


class Stretch(NamedTuple):
    """The stretch of edge that the views show, and where the frames (k,) in it lie."""

    from_mm: float
    to_mm: float
    frames: Int

    @property
    def middle_mm(self) -> float:
        return (self.from_mm + self.to_mm) / 2.0


def shown_stretch(edge: Edge) -> Stretch:
    """The whole edge, or so much about its middle as a picture can show."""
    length = float(edge.arc_length_mm[-1])
    half = min(length, MOST_MM) / 2.0
    start, end = length / 2.0 - half, length / 2.0 + half
    with np.errstate(invalid="ignore"):
        inside = (edge.frame_arc_length_mm >= start) & (edge.frame_arc_length_mm <= end)
    return Stretch(start, end, np.flatnonzero(inside))


def section_views(cloud: Cloud, edge: Edge, inspection: Inspection, budget: int) -> dict[str, View]:
    """`overview`: the whole edge; `close_up`: the section that matters most; each of about `budget` points."""
    section, axes = of_interest(inspection), section_axes(inspection)
    whole = overview(cloud, edge, budget)
    near = around(cloud, edge, section.arc_length_mm, SECTION_MM, budget)
    least = float(np.ptp(edge.arc_length_mm)) / 22  # a plane is to be seen on a long edge
    scenes = [
        Scene(points.position_mm, (by_face(points, []),), (), section_planes(points, sections, at_least), axes)
        for points, sections, at_least in ((whole, inspection.sections, least), (near, (section,), 0.0))
    ]
    return {
        "overview": View(scenes[0], LOOK),
        "close_up": View(scenes[1], (-0.62, 0.75, 0.42), section.origin_mm, 4.0),
    }


def procedure_views(cloud: Cloud, edge: RawEdge, toolpath: Toolpath, budget: int) -> dict[str, View]:
    """Views: `a` rough cloud, `b` vertices a frame, `c` end face, `e` edges in space, `f` key points, tool frames."""
    stretch = shown_stretch(edge)
    points = around(cloud, edge, stretch.middle_mm, (stretch.to_mm - stretch.from_mm) / 2.0, budget)
    origin, axes = station_frame(edge, stretch.middle_mm)
    grey = _grey(points, axes)
    bare = Scene(points.position_mm, (grey,), (), (), axes)
    face = replace(grey, index=np.where(points.label == ROOT_FACE, MARKED, grey.index))
    here = (edge.arc_length_mm >= stretch.from_mm) & (edge.arc_length_mm <= stretch.to_mm)
    final = toolpath.layers[-1]
    s = final.arc_length_mm
    keys = np.flatnonzero((s >= stretch.from_mm) & (s <= stretch.to_mm) & final.cutting)
    vertices = zip(root_ends(cloud, edge, stretch.frames), (LOWER_EDGE, UPPER_EDGE), strict=True)
    frames = tool_axes(toolpath, keys, TOOL_FRAMES, TOOL_AXIS_MM)
    scenes = {
        "a": bare,
        "b": replace(bare, strokes=tuple(_dots(ends.position_mm, colour) for ends, colour in vertices)),
        "c": replace(bare, shadings=(face,)),
        "e": replace(bare, strokes=(both_edges(edge, here),)),
        "f": replace(bare, strokes=(frames, _dots(toolpath.in_base(final.position_mm)[keys], INK))),
    }
    return {k: View(one, LOOK, origin, AXIS_MM if k == "a" else 0.0, PANEL_PX) for k, one in scenes.items()}


def path_views(cloud: Cloud, edge: Edge, toolpath: Toolpath, run: Run, budget: int) -> dict[str, View]:
    """Views `layers` and `feed` of the whole edge, and `layers_close` about the middle of what is cut."""
    middle = middle_of_cut_mm(toolpath) or float(edge.arc_length_mm[-1]) / 2.0
    origin, axes = station_frame(edge, middle)
    whole, near = overview(cloud, edge, budget), around(cloud, edge, middle, CLOSE_UP_MM, budget)
    by_layer, by_feed = layer_colours(run.layer, len(toolpath.layers)), feed_colours(run)
    everywhere = np.ones(len(run.layer), bool)
    close = (np.abs((run.position_mm - origin) @ axes[0]) <= CLOSE_UP_MM) & (run.layer > 0)

    def view(points: Points, colours: AnyArray, here: AnyArray, axes_length_mm: float) -> View:
        pale = Shading("cloud", np.zeros(len(points.label), np.uint8), np.array([rgb(PALE)], np.uint8), ())
        lines = path_lines("path", run, colours, here)
        return View(Scene(points.position_mm, (pale,), (lines,), (), axes), LOOK, origin, axes_length_mm)

    return {
        "layers": view(whole, by_layer, everywhere, 0.0),
        "layers_close": view(near, by_layer, close, AXIS_MM),
        "feed": view(whole, by_feed, everywhere, 0.0),
    }


def _grey(points: Points, axes: Float) -> Shading:
    """Lighter the higher across the edge and the further in, so that the cloud shows its shape."""
    height = points.position_mm @ (axes[2] - 0.5 * axes[1])
    low, high = np.percentile(height, (1.0, 99.0)) if len(height) else (0.0, 1.0)
    fraction = np.clip((height - low) / max(1e-9, high - low), 0.0, 1.0)
    palette = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    palette[MARKED] = rgb(FACES[ROOT_FACE])
    return Shading("height", (DARK + (LIGHT - DARK) * fraction).astype(np.uint8), palette, ())


def _dots(position_mm: Float, colour: str) -> Strokes:
    """Lines of one point: a picture shows each as a dot."""
    shade = np.array([rgb(colour)], np.uint8)
    return Strokes("dots", tuple(position_mm[:, None]), (shade,) * len(position_mm))
