"""The scenes of the chapters: part, sections, path and deviations, as a browser shows them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from workbench.artefacts import (
    BEVEL_FACE,
    ROOT_FACE,
    UNLABELLED,
    Cloud,
    Edge,
    EdgeProfile,
    Inspection,
    Mark,
    MilledEdge,
    RawEdge,
    Scene,
    Section,
    Shading,
    Strokes,
    Toolpath,
    u_name,
)
from workbench.artefacts.edges import BEVEL_TERMS
from workbench.geometry import moves
from workbench.marks import LOWER_EDGE, SIGNS, TOOL_AXES, UPPER_EDGE, VERDICTS, code, face_shades, ramp, rgb
from workbench.pieces import GREY, INK
from workbench.report.along import laid_out
from workbench.report.planned import (
    Compared,
    Run,
    feed_colours,
    frames_in_base,
    layer_colours,
    layer_ink,
    layer_rows,
    middle_of_cut_mm,
    planned_bevel,
)
from workbench.report.scene import Points, at_places, ends_of, overview
from workbench.report.section_drawing import of_interest, outside_mm, round_limit
from workbench.report.tables import faces_seen
from workbench.report.text import decimals, measured
from workbench.units import DEG, AnyArray, Bool, Float, Int

LOOP_POINTS = 150_000


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
) -> Scene:
    """The milled part by its deviation from the plan, the sections, the final layer; without a scan no points."""
    final = toolpath.layers[-1]
    path = toolpath.in_base(final.position_mm)
    strokes = (lower_edge(inspection.profile), lines_of("final layer of the path", [(path, INK)]))
    sections, axes = tuple(row.section for row in rows), section_axes(inspection)
    if cloud is None or not isinstance(edge, MilledEdge):
        nothing = Points(np.zeros((0, 3)), np.zeros(0, np.uint8), np.zeros(0, np.int64), np.zeros(0, np.int64))
        return Scene(nothing.position_mm, (), strokes, section_marks(nothing, sections, rows), axes)
    points, planned = telling(cloud, edge, LOOP_POINTS), planned_bevel(toolpath, edge)
    root, bevel = along(planned.arc_length_mm, planned.root_mm), along(planned.arc_length_mm, planned.bevel_deg)
    off = by_deviation("deviation from the planned faces", points, laid_out_faces(points, cloud, edge), root, bevel)
    marks = section_marks(points, sections, rows)
    return Scene(points.position_mm, (off, by_face(points, faces_seen(edge))), strokes, marks, axes)


def plan_scene(cloud: Cloud, edge: RawEdge, toolpath: Toolpath, run: Run, budget: int) -> Scene:
    """The raw part by face, all layers by number and by feed, cutter axes, travel moves, both edges."""
    points = telling(cloud, edge, budget)
    middle = middle_of_cut_mm(toolpath) or float(edge.arc_length_mm[-1]) / 2.0
    final, cuts = toolpath.layers[-1], run.layer > 0
    strokes = (
        path_lines("feed, the darker the slower", run, feed_colours(run), cuts, shown=False),
        path_lines("travel moves", run, layer_colours(run.layer, len(toolpath.layers)), ~cuts),
        tool_axes(toolpath, np.flatnonzero(final.cutting), TOOLS, TOOL_AXIS_MM / 2.0),
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


# What can be chosen in a scene: the sections of an inspection, the layers of a path.

LAYER_FACTS = ("Layer", "Height", "Width of its face", "Length cut", "Points", "Feed", "Time")
LAYER_UNITS = ("", " mm", " mm", " mm", "", " mm/s", "")


def section_marks(
    points: Points, sections: tuple[Section, ...], planned: list[Compared] | None = None
) -> tuple[Mark, ...]:
    """A section each: its plane outlined in the colour of its verdict, its values; with what was planned, if given."""
    places = {name: decimals(s.values[u_name(name)] for s in sections) for name in BEVEL_TERMS}
    marks = []
    for k, (s, plane) in enumerate(zip(sections, section_planes(points, sections), strict=True)):
        facts = section_facts(s, places)
        if planned is not None:
            root, bevel = measured(planned[k].root_mm, None, 3), measured(planned[k].bevel_deg, None, 2)
            facts = (*facts, ("Root face planned", f"{root} mm"), ("Bevel angle planned", f"{bevel}°"))
        marks.append(replace(plane, facts=facts))
    return tuple(marks)


def section_planes(points: Points, sections: tuple[Section, ...], least_mm: float = 0.0) -> tuple[Mark, ...]:
    """A section each: its plane outlined, a little larger than the faces, at least `least_mm`."""
    low, high = faces_extent(points, sections)
    half = np.maximum((high - low) / 2 * PLANE_MARGIN, least_mm / 2)
    corners = (low + high) / 2 + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    outlines = [s.origin_mm + corners @ np.array([s.normal, s.across]) for s in sections]
    return tuple(
        Mark(f"{s.index}", outline[[2, 3]].mean(axis=0), outline, VERDICTS[s.verdict], ())
        for s, outline in zip(sections, outlines, strict=True)
    )


def faces_extent(points: Points, sections: tuple[Section, ...]) -> Float:
    """(2, 2) lowest and highest (u, v) of root and bevel face, as most sections have them."""
    faces = points.position_mm[np.isin(points.label, (ROOT_FACE, BEVEL_FACE))]
    sizes = [size for size in (_faces_about(faces, section) for section in sections) if size is not None]
    return np.median(sizes, axis=0) if sizes else np.array([[-5.0, 0.0], [0.0, 5.0]])


def _faces_about(faces_mm: Float, section: Section) -> Float | None:
    """(2, 2) lowest and highest (u, v) of root and bevel face near a section plane; None where there are none."""
    at = faces_mm @ section.tangent - section.origin_mm @ section.tangent
    near = np.flatnonzero(np.abs(at) < SLAB_MM)
    if not len(near):
        return None
    uv = (faces_mm[near] - section.origin_mm) @ np.column_stack([section.normal, section.across])
    return np.array([uv.min(axis=0), uv.max(axis=0)])


def section_facts(s: Section, places: Mapping[str, int]) -> tuple[tuple[str, str], ...]:
    """What is known of a section, as text: values with U = 2 u, and u itself."""
    values, sizes = s.values, []
    for name, (term, _) in BEVEL_TERMS.items():
        u, text = values[u_name(name)], measured(values[name], values[u_name(name)], places[name])
        unit = "°" if name.endswith("_deg") else " mm"
        sizes.append((f"{term} ± U", f"({text})°" if unit == "°" else f"{text} mm"))
        sizes.append((f"u of {term.lower()}", "–" if u is None else f"{u:.4f}{unit}"))
    return (
        ("Section", f"{s.index}"),
        ("Arc length", f"{s.arc_length_mm:.2f} mm"),
        *sizes,
        ("Verdict", f"{SIGNS[s.verdict]} {s.verdict}"),
        *([("Reason", s.reason)] if s.reason else []),
    )


def layer_marks(toolpath: Toolpath, run: Run) -> tuple[Mark, ...]:
    """A layer each, its label at a place of its own along it; facts as in the table of layers."""
    count, marks = len(toolpath.layers), []
    for k, (layer, row) in enumerate(zip(toolpath.layers, layer_rows(toolpath, run), strict=False)):
        line = toolpath.in_base(layer.position_mm)
        facts = tuple((name, value + unit) for name, value, unit in zip(LAYER_FACTS, row, LAYER_UNITS, strict=True))
        ink = layer_ink(layer.index, count)
        marks.append(Mark(f"{layer.index}", line[int((k + 0.5) / count * len(line))], line, ink, facts))
    return tuple(marks)


# The lines of a scene: edges, fitted lines, cutter axes.

TOOLS, TOOL_AXIS_MM = 400, 4.0  # cutter axes drawn at most
SLAB_MM = 5.0  # a section plane is made as large as the faces are within this distance of it
PLANE_MARGIN = 1.4  # of its size over the root and the bevel face


def fitted_lines(points: Points, sections: tuple[Section, ...]) -> Strokes:
    """The two lines of each measured section: along the root face, and up the bevel face as far as it reaches."""
    top = float(faces_extent(points, sections)[1, 1])
    lines = []
    for s in sections:
        if (sizes := s.root_and_bevel) is None:
            continue
        root, bevel = sizes
        up = max(0.0, top - root)
        corners = np.array([[0.0, 0.0], [0.0, root], [-up * math.tan(bevel * DEG), root + up]])
        lines.append(s.origin_mm + corners @ np.array([s.normal, s.across]))
    return lines_of("fitted lines of the sections", [(line, INK) for line in lines])


def lower_edge(profile: EdgeProfile) -> Strokes:
    """The measured lower edge, broken where hidden."""
    return lines_of("lower edge", [(line, LOWER_EDGE) for line in runs(profile.position_mm)])


def lines_of(name: str, found: Sequence[tuple[Float, str]], *, shown: bool = True) -> Strokes:
    """Lines (k, 3), each of one colour ('#rrggbb')."""
    colours = tuple(np.tile(rgb(colour), (len(line), 1)) for line, colour in found)
    return Strokes(name, tuple(line for line, _ in found), colours, shown)


def both_edges(edge: RawEdge, here: Bool | slice = slice(None)) -> Strokes:
    """Lower and upper edge of a raw part at the stations `here`, broken where hidden."""
    curves = ((edge.position_mm[here], LOWER_EDGE), (edge.upper_position_mm[here], UPPER_EDGE))
    return lines_of("edges", [(line, colour) for curve, colour in curves for line in runs(curve)])


def path_lines(name: str, run: Run, colours: AnyArray, here: Bool, *, shown: bool = True) -> Strokes:
    """The path where `here` (k,) holds: each layer and each move between layers a line."""
    breaks = np.union1d(run.layer_start, np.flatnonzero(np.diff(here)) + 1)[1:]
    pieces = [piece for piece in np.split(np.arange(len(here)), breaks) if here[piece].all() and len(piece) > 1]
    return Strokes(name, tuple(run.position_mm[k] for k in pieces), tuple(colours[k] for k in pieces), shown)


def tool_axes(toolpath: Toolpath, keys: Int, most: int, length_mm: float) -> Strokes:
    """x, y, z of the tool frame at `most` of the final layer's points `keys`, spread evenly."""
    final, keys = toolpath.layers[-1], keys[:: max(1, math.ceil(len(keys) / most))]
    place, frames = toolpath.in_base(final.position_mm)[keys], frames_in_base(toolpath, final)[keys]
    ends = place[:, None] + length_mm * frames.transpose(0, 2, 1)
    axes = [
        (np.array([p, end]), colour)
        for p, three in zip(place, ends, strict=True)
        for end, colour in zip(three, TOOL_AXES, strict=True)
    ]
    return lines_of("tool axes x, y, z of the final layer", axes, shown=False)


def runs(position_mm: Float) -> list[Float]:
    """The stretches of a curve between its NaNs."""
    known: Bool = np.all(np.isfinite(position_mm), axis=1)
    return [position_mm[first : last + 1] for first, last in moves.runs(known) if last > first]


def station_frame(edge: Edge, at_mm: float) -> tuple[Float, Float]:
    """Position (3,) of the measured station nearest to an arc length, and t, n, m there (3, 3)."""
    distance = np.where(np.isfinite(edge.position_mm[:, 0]), np.abs(edge.arc_length_mm - at_mm), np.inf)
    k = int(np.argmin(distance))
    return edge.position_mm[k], np.array([edge.tangent[k], edge.normal[k], edge.across[k]])


# Which points of a cloud a scene holds: many about the ends of faces, where corners are, the rest evenly.

CORNER_SHARE = 0.4  # of the points that lie near ends of faces, at most
CORNER_COLUMNS = np.arange(-3, 4)  # about each end of a face


def telling(cloud: Cloud, edge: Edge, budget: int) -> Points:
    """At most `budget` kept points, in an order of which any first part shows the whole."""
    order = np.random.default_rng(0)  # the same every time
    corners = near_ends(cloud, edge, int(CORNER_SHARE * budget))
    rest = overview(cloud, edge, budget)
    others = np.flatnonzero(~np.isin(_place(rest, cloud), _place(corners, cloud)))
    rest = rest.where(order.permutation(others)[: budget - len(corners.label)])
    both = Points(*map(np.concatenate, zip(corners, rest, strict=True)))
    return both.where(order.permutation(len(both.label)))


def _place(points: Points, cloud: Cloud) -> Int:
    """(n,) where in the grid each point is, as one number."""
    place: Int = points.frame * cloud.x_mm.shape[1] + points.column
    return place


def near_ends(cloud: Cloud, edge: Edge, budget: int) -> Points:
    """At most `budget` kept points of the columns about the first and the last one of each face in a frame."""
    frames, columns = cloud.x_mm.shape
    faces = [label for label in edge.faces or np.unique(edge.labels[:: max(1, frames // 300)]) if label != UNLABELLED]
    a_frame = 2 * len(faces) * len(CORNER_COLUMNS)
    some = np.arange(0, frames, max(1, math.ceil(frames * a_frame / max(1, budget))))
    found = [_ends(cloud, edge, some, int(face)) for face in faces]
    place = np.unique(np.concatenate([np.zeros(0, np.int64), *found]))
    frame, column = place // columns, place % columns
    there = cloud.keep[frame, column] & np.isfinite(cloud.x_mm[frame, column]) & np.isfinite(cloud.z_mm[frame, column])
    return at_places(cloud, edge, frame[there], column[there])


def _ends(cloud: Cloud, edge: Edge, frames: Int, face: int) -> Int:
    """Places frame x M + column about both ends of a face in each of `frames`."""
    frames, ends = ends_of(cloud, edge, face, frames)
    columns = edge.labels.shape[1]
    column = np.clip(ends.T[:, :, None] + CORNER_COLUMNS, 0, columns - 1)
    return np.asarray((frames[:, None, None] * columns + column).ravel(), dtype=np.int64)


# How the points of a scene are coloured: by face, and by how far they lie outside the faces that they belong to.

BELOW, NONE, ABOVE = "#1f5fa8", "#e4e1d6", "#b3261e"  # too little material, as it should be, too much
UNKNOWN = 255  # the palette's last row: no deviation known here
STEPS = 127  # colours on each side of zero
GAP_MM = 3.0  # values along the edge are interpolated between places that are so close
Along = Callable[[Float], Float]  # a value by arc length, NaN where it is not known


def by_face(points: Points, names: list[tuple[str, str]]) -> Shading:
    """Each face in its colour; `names` and colours of the faces that are there."""
    return Shading("face", points.label.astype(np.uint8), face_shades(), tuple(names))


def by_deviation(name: str, points: Points, laid: Float, root_mm: Along, bevel_deg: Along) -> Shading:
    """How far root and bevel face lie outside faces of that root face and bevel angle, which go with the arc length."""
    off = deviation_mm(points, laid, root_mm, bevel_deg)
    known = np.isfinite(off)
    limit = round_limit(np.abs(off[known])) if known.any() else 0.05
    index = np.full(len(off), UNKNOWN, np.uint8)
    index[known] = np.round((np.clip(off[known] / limit, -1.0, 1.0) + 1.0) * STEPS)
    palette = np.vstack([ramp(np.linspace(0.0, 1.0, 2 * STEPS + 1), (BELOW, NONE, ABOVE)), [rgb(GREY)]])
    return Shading(name, index, palette.astype(np.uint8), _legend(limit, palette))


def laid_out_faces(points: Points, cloud: Cloud, edge: Edge) -> Float:
    """(n, 3) arc length, u and v of the points of root and bevel face; NaN for all others."""
    face = np.isin(points.label, (ROOT_FACE, BEVEL_FACE))
    laid = np.full((len(face), 3), np.nan)
    laid[face] = laid_out(points.where(face), cloud, edge)
    return laid


def deviation_mm(points: Points, laid: Float, root_mm: Along, bevel_deg: Along) -> Float:
    """(n,) distance outwards from the faces; NaN off root and bevel face, and where root or angle are not known.

    laid: from `laid_out_faces`.
    """
    off = np.full(len(points.label), np.nan)
    face = np.flatnonzero(np.isfinite(laid[:, 0]))
    s, uv = laid[face, 0], laid[face, 1:]
    off[face] = outside_mm(uv, points.label[face] == BEVEL_FACE, root_mm(s), bevel_deg(s) * DEG)
    return off


def along(arc_length_mm: Float, value: Float) -> Along:
    """Values (k,) interpolated between places near to each other; NaN in gaps and beyond the ends."""
    known = np.isfinite(arc_length_mm) & np.isfinite(value)
    order = np.argsort(arc_length_mm[known])
    s, values = arc_length_mm[known][order], value[known][order]
    gaps = np.flatnonzero(np.diff(s) > GAP_MM) + 1
    s_all, all_values = np.insert(s, gaps, s[gaps] - 1e-6), np.insert(values, gaps, np.nan)

    def at(where_mm: Float) -> Float:
        if not len(s):
            return np.full(len(where_mm), np.nan)
        near = np.clip(where_mm, s[0] - 1.0, s[-1] + 1.0) == where_mm  # the ends are not cut off to a hair
        found: Float = np.interp(where_mm, s_all, all_values)
        return np.where(near, found, np.nan)

    return at


def always(value: float) -> Along:
    """One value all along the edge."""
    return lambda where_mm: np.full(len(where_mm), value)


def _legend(limit_mm: float, palette: AnyArray) -> tuple[tuple[str, str], ...]:
    texts = (f"−{limit_mm:g} mm or less", f"−{limit_mm / 2:g}", "0", f"+{limit_mm / 2:g}", f"+{limit_mm:g} mm or more")
    rows = np.linspace(0, 2 * STEPS, len(texts)).round().astype(int)
    return (
        *((text, code(palette[row] / 255.0)) for text, row in zip(texts, rows, strict=True)),
        ("not assessed", GREY),
    )
