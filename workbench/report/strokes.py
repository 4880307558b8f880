"""The lines of a scene: edges, fitted lines, cutter axes."""

from __future__ import annotations

import math

import numpy as np

from workbench.artefacts import EdgeProfile, RawEdge, Section, Strokes, Toolpath
from workbench.report.colours import INK, LOWER_EDGE, TOOL_AXES, UPPER_EDGE, rgb
from workbench.report.planned import frames_in_base
from workbench.report.procedure import TOOL_AXIS_MM, runs
from workbench.report.sample import Points
from workbench.report.section_views import faces_extent
from workbench.units import DEG

TOOLS = 400  # cutter axes drawn at most


def fitted_lines(points: Points, sections: tuple[Section, ...]) -> Strokes:
    """The two lines of each measured section: along the root face, and up the bevel face as far as it reaches."""
    top = float(faces_extent(points, sections)[1, 1])
    lines = []
    for s in sections:
        if s.root_mm is None or s.bevel_deg is None:
            continue
        beta, up = s.bevel_deg * DEG, max(0.0, top - s.root_mm)
        corners = np.array([[0.0, 0.0], [0.0, s.root_mm], [-up * math.tan(beta), s.root_mm + up]])
        lines.append(s.origin_mm + corners @ np.array([s.normal, s.across]))
    return Strokes("fitted lines of the sections", tuple(lines), tuple(np.tile(rgb(INK), (3, 1)) for _ in lines))


def lower_edge(profile: EdgeProfile) -> Strokes:
    """The measured lower edge, broken where hidden."""
    lines = tuple(runs(profile.position_mm))
    return Strokes("lower edge", lines, tuple(np.tile(rgb(LOWER_EDGE), (len(line), 1)) for line in lines))


def both_edges(edge: RawEdge) -> Strokes:
    """Lower and upper edge of a raw part, broken where hidden."""
    curves = ((edge.position_mm, LOWER_EDGE), (edge.upper_position_mm, UPPER_EDGE))
    found = [(line, rgb(colour)) for curve, colour in curves for line in runs(curve)]
    return Strokes("edges", tuple(line for line, _ in found), tuple(np.tile(c, (len(line), 1)) for line, c in found))


def tool_axes(toolpath: Toolpath) -> Strokes:
    """x, y, z of the tool frame at some key points of the final layer."""
    final = toolpath.layers[-1]
    keys = np.flatnonzero(final.cutting)
    keys = keys[:: max(1, math.ceil(len(keys) / TOOLS))]
    place, frames = toolpath.in_base(final.position_mm)[keys], frames_in_base(toolpath, final)[keys]
    ends = place[:, None] + TOOL_AXIS_MM / 2.0 * frames.transpose(0, 2, 1)
    lines = tuple(np.array([p, end]) for p, three in zip(place, ends, strict=True) for end in three)
    colours = tuple(np.tile(rgb(TOOL_AXES[k % 3]), (2, 1)) for k in range(len(lines)))
    return Strokes("tool axes x, y, z of the final layer", lines, colours, shown=False)
