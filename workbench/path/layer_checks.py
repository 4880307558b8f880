"""Checks of a path's layers: heights, spacing, what is cut where."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from workbench.artefacts import Edge, Layer, RawEdge, Toolpath
from workbench.path.course import edge_course, lower_course
from workbench.path.plan import KEY_POINT_MM
from workbench.path.poses import poses_of
from workbench.path.remaining import from_edge
from workbench.path.section import LEAST_DEPTH_MM, finished
from workbench.units import Bool

HEIGHT_MM = 0.002  # a layer's place along the bevel's normal
ALONG_MM = 0.01  # a point's place along the edge
SPACING_SHARE = 0.05


def layer_faults(toolpath: Toolpath, edge: Edge) -> Iterator[str]:
    """What is wrong with the layers, in words."""
    if not toolpath.layers:
        yield "no layer"
        return
    yield from cutter_faults(toolpath)
    bevel, cutter, above = finished(toolpath), toolpath.cutter, None
    for layer in toolpath.layers:
        course = lower_course(edge, layer.arc_length_mm)
        section = from_edge(toolpath, layer, course)
        height = bevel.height_mm(section)
        along = ((poses_of(toolpath, layer).origin_mm - course.position_mm) * course.tangent).sum(axis=1)
        yield from _fault(layer, height < -HEIGHT_MM, "lies below the finished bevel")
        yield from _fault(layer, layer.cutting & (np.abs(height - layer.height_mm) > HEIGHT_MM), "is not at its height")
        yield from _fault(layer, np.abs(along) > ALONG_MM, "is not in the section of its arc length")
        yield from _fault(layer, layer.cutting & ~course.seen, "cuts where nothing was measured")
        yield from _fault(layer, layer.cutting & ~layer.measured, "cuts where nothing was measured")
        flute = cutter.flute_length_mm - (cutter.radius_mm if cutter.ball_end else 0.0)
        yield from _fault(layer, layer.cutting & (layer.width_mm > flute), "is wider than the flute")
        if bevel.fillet_mm:
            off = np.abs((section - bevel.middle(course, layer.height_mm)) @ bevel.up)
            yield from _fault(layer, off > HEIGHT_MM, "does not stand where its ball end makes the fillet")
        yield from _spacing(layer, toolpath.edge_length_mm)
        if not layer.cutting.any():
            yield f"layer {layer.index} cuts nothing but air"
        if above is not None and above - layer.height_mm > toolpath.depth_of_cut_mm + HEIGHT_MM:
            yield f"layer {layer.index} is deeper than the depth of cut"
        above = layer.height_mm
    if [layer.index for layer in toolpath.layers] != list(range(1, len(toolpath.layers) + 1)):
        yield "layers are not counted from 1 in cutting order"
    first = toolpath.layers[0]
    if isinstance(edge, RawEdge):
        top = bevel.height_mm(edge_course(edge, first.arc_length_mm, 0.0).upper_mm)
        if (top - first.height_mm)[first.cutting].max(initial=0.0) < LEAST_DEPTH_MM / 2.0:
            yield "layer 1 cuts nothing but air"
    if abs(toolpath.layers[-1].height_mm) > HEIGHT_MM:
        yield "the last layer is not the final one"
    if (np.diff([layer.height_mm for layer in toolpath.layers]) >= 0).any():
        yield "layers do not go down"


def cutter_faults(toolpath: Toolpath) -> Iterator[str]:
    """What is wrong with the cutter's end, in words: the fillet of a J preparation is the ball's."""
    radius, cutter = toolpath.root_radius_mm, toolpath.cutter
    if radius and not (cutter.ball_end and abs(cutter.radius_mm - radius) <= HEIGHT_MM):
        yield f"the cutter has no ball end of the fillet's radius, {radius:g} mm"


def _fault(layer: Layer, wrong: Bool, words: str) -> Iterator[str]:
    """One line for the points that are wrong, with the place of the first."""
    if wrong.any():
        at = layer.arc_length_mm[np.flatnonzero(wrong)[0]]
        yield f"layer {layer.index} {words} at arc length {at:.1f} mm"


def _spacing(layer: Layer, length_mm: float) -> Iterator[str]:
    """Key points every mm from 0 to the end of the edge; the last interval may be shorter."""
    s = layer.arc_length_mm
    inside = s[(s >= -1e-6) & (s <= length_mm + 1e-6)]
    if inside.size < 2 or abs(inside[0]) > 1e-6 or abs(inside[-1] - length_mm) > 1e-6:
        yield f"layer {layer.index} does not reach from one end of the edge to the other"
        return
    step = np.diff(inside)
    wrong = np.abs(step / KEY_POINT_MM - 1.0) > SPACING_SHARE
    wrong[-1] = step[-1] > KEY_POINT_MM * (1.0 + SPACING_SHARE) or step[-1] <= 0.0
    if wrong.any():
        yield f"layer {layer.index} has no point every mm at arc length {inside[np.flatnonzero(wrong)[0]]:.1f} mm"
