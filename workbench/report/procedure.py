"""How the path comes from the scan, step by step, as the paper's Fig. 8: its views in space (a, b, c, e, f)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from workbench.artefacts import ROOT_FACE, Cloud, Edge, RawEdge, Toolpath
from workbench.report.colours import FACES, INK, LOWER_EDGE, TOOL_AXES, UPPER_EDGE, rgb
from workbench.report.planned import frames_in_base
from workbench.report.sample import Points, around, face_ends
from workbench.report.scene import View, joined, towards
from workbench.units import AnyArray, Float, Int

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
        "f": _with_tool_frames(bare, edge, toolpath, stretch, origin),
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


def _with_tool_frames(view: View, edge: Edge, toolpath: Toolpath, stretch: Shown, origin: Float) -> View:
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
