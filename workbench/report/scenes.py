"""The scenes of the chapters: part, sections, path and deviations, as a browser shows them."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Cloud, Edge, Inspection, MilledEdge, RawEdge, Scene, Strokes, Toolpath
from workbench.report.choose import telling
from workbench.report.colours import INK, rgb
from workbench.report.inspection_text import faces_seen
from workbench.report.loop import Compared
from workbench.report.marks import layer_marks, section_marks
from workbench.report.planned import Run, middle_of_cut_mm, planned_bevel
from workbench.report.procedure import station_frame
from workbench.report.ramp import feed_colours, layer_colours
from workbench.report.sample import Points
from workbench.report.section_views import of_interest
from workbench.report.shadings import Along, along, always, by_deviation, by_face, laid_out_faces
from workbench.report.strokes import both_edges, fitted_lines, lower_edge, tool_axes
from workbench.units import AnyArray, Float


def inspection_scene(cloud: Cloud, edge: Edge, inspection: Inspection, budget: int) -> Scene:
    """Points by face and by deviation, the sections with their fitted lines, the lower edge."""
    points, profile, asked = telling(cloud, edge, budget), inspection.profile, inspection.requirements
    s = profile.arc_length_mm
    faces: tuple[tuple[str, Along, Along], ...] = (
        ("deviation from the measured faces", along(s, profile.root_mm), along(s, profile.bevel_deg)),
        ("deviation from the nominal faces", always(asked.root_nominal_mm), always(asked.bevel_nominal_deg)),
    )
    laid = laid_out_faces(points, cloud, edge)
    shadings = [by_deviation(name, points, laid, root, bevel) for name, root, bevel in faces]
    strokes = (fitted_lines(points, inspection.sections), lower_edge(profile))
    marks = section_marks(points, inspection.sections)
    return Scene(
        points.position_mm, (by_face(points, faces_seen(edge)), *shadings), strokes, marks, section_axes(inspection)
    )


def loop_scene(
    inspection: Inspection,
    toolpath: Toolpath,
    rows: list[Compared],
    cloud: Cloud | None,
    edge: Edge | None,
    budget: int,
) -> Scene:
    """The milled part by its deviation from the plan, the sections, the final layer; without a scan no points."""
    final = toolpath.layers[-1]
    path = toolpath.in_base(final.position_mm)
    colour = np.tile(rgb(INK), (len(path), 1))
    strokes = (lower_edge(inspection.profile), Strokes("final layer of the path", (path,), (colour,)))
    sections, axes = tuple(row.section for row in rows), section_axes(inspection)
    if cloud is None or not isinstance(edge, MilledEdge):
        nothing = Points(np.zeros((0, 3)), np.zeros(0, np.uint8), np.zeros(0, np.int64), np.zeros(0, np.int64))
        return Scene(nothing.position_mm, (), strokes, section_marks(nothing, sections, rows), axes)
    points, planned = telling(cloud, edge, budget), planned_bevel(toolpath, edge)
    root, bevel = along(planned.arc_length_mm, planned.root_mm), along(planned.arc_length_mm, planned.bevel_deg)
    off = by_deviation("deviation from the planned faces", points, laid_out_faces(points, cloud, edge), root, bevel)
    marks = section_marks(points, sections, rows)
    return Scene(points.position_mm, (off, by_face(points, faces_seen(edge))), strokes, marks, axes)


def plan_scene(cloud: Cloud, edge: RawEdge, toolpath: Toolpath, run: Run, budget: int) -> Scene:
    """The raw part by face, all layers by number and by feed, cutter axes, travel moves, both edges."""
    points = telling(cloud, edge, budget)
    middle = middle_of_cut_mm(toolpath) or float(edge.arc_length_mm[-1]) / 2.0
    by_layer, by_feed = layer_colours(run.layer, len(toolpath.layers)), feed_colours(run)
    pieces = np.split(np.arange(len(run.layer)), run.layer_start[1:])
    cuts = [piece for piece in pieces if run.layer[piece[0]] > 0]
    air = [piece for piece in pieces if run.layer[piece[0]] == 0 and len(piece) > 1]

    def path(name: str, lines: list[AnyArray], colours: AnyArray, *, shown: bool = True) -> Strokes:
        return Strokes(name, tuple(run.position_mm[k] for k in lines), tuple(colours[k] for k in lines), shown)

    strokes = (
        path("feed, the darker the slower", cuts, by_feed, shown=False),
        path("travel moves", air, by_layer),
        tool_axes(toolpath),
        both_edges(edge),
    )
    shading = by_face(points, faces_seen(edge))
    return Scene(
        points.position_mm, (shading,), strokes, layer_marks(toolpath, run), station_frame(edge, middle)[1], "layers"
    )


def section_axes(inspection: Inspection) -> Float:
    """t, n, m of the section that matters most."""
    section = of_interest(inspection)
    return np.array([section.tangent, section.normal, section.across])
