"""Views of the path on the part: all layers (the paper's Fig. 13) and the feed on the path (its Fig. 14)."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Cloud, Edge, Toolpath
from workbench.report.colour_scales import feed_colours, layer_colours
from workbench.report.colours import PALE, rgb
from workbench.report.planned import Run, middle_of_cut_mm
from workbench.report.procedure import AXIS_MM, LOOK, station_frame
from workbench.report.sample import Points, around, overview
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
