"""`export.sections`: the sections with their points, for CAD or a spreadsheet."""

from __future__ import annotations

import io
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from workbench.artefacts import (
    BEVEL_FACE,
    FACE_NAMES,
    Cloud,
    Document,
    Edge,
    JointInspection,
    Section,
)
from workbench.artefacts.edges import BEVEL_TERMS
from workbench.export.cloud_stage import PointTable, point_table
from workbench.extras import Extra
from workbench.stage import stage
from workbench.units import DEG, Float, Int, Shaped

PLACE = "%.6f,%.6f,%.6f,%.6f,%.6f"
HEADER = "section,arc_length_mm,kind,face,frame,column,normal_mm,across_mm,x_mm,y_mm,z_mm"


@stage("export.sections")
def sections(
    inspection: JointInspection,
    cloud: Cloud,
    edge: Edge | None = None,
    *,
    format: Literal["dxf", "csv"] = "dxf",
    thickness_mm: Annotated[float, Field(gt=0, le=20)] = 0.5,
    reach_mm: Annotated[float, Field(ge=1, le=200)] = 25.0,
) -> Document:
    """Write every section in its plane as `sections.dxf`, or its points as `section_points.csv`.

    Coordinates are mm from the section's origin, along `normal` and `across`. The DXF holds one block per section:
    points, fitted lines, corners, sizes with standard uncertainties. The CSV has one row per point (with face, frame
    and column) or corner, in the base too.

    Args:
        inspection: the sections.
        cloud: the points.
        edge: faces of the points; without it they have none.
        format: of the file.
        thickness_mm: of the slice whose points are written.
        reach_mm: greatest distance of points from the section's origin.

    Example:
        >>> from workbench import cloud, edge, export, inspect, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> milled = edge.segment(points)
        >>> found = inspect.sections(milled)
        >>> export.sections(found, points, milled).name
        'sections.dxf'
    """
    shapes = [
        section_shape(inspection, cloud, edge, section, thickness_mm, reach_mm) for section in inspection.sections
    ]
    if format == "dxf":
        return Document("sections.dxf", sections_dxf(shapes))
    out = io.StringIO(HEADER + "\r\n")
    out.seek(0, io.SEEK_END)
    for shape in shapes:
        _write_rows(out, shape)
    return Document("section_points.csv", out.getvalue().encode("ascii"))


def _write_rows(out: io.StringIO, shape: SectionShape) -> None:
    """One row per point, then one row per corner."""
    section, table = shape.section, shape.points
    start = f"{section.index},{section.arc_length_mm:.6f}"
    columns = (table.face, table.frame, table.column, shape.place_mm, table.position_mm)
    np.savetxt(out, np.column_stack(columns), f"{start},point,%d,%d,%d,{PLACE}", newline="\r\n")
    for name, corner in shape.corners_mm.items():
        place = section.origin_mm + corner @ np.array([section.normal, section.across])
        np.savetxt(out, [(*corner, *place)], f"{start},{name},,,,{PLACE}", newline="\r\n")


# Sections as a DXF drawing: one block per section, side by side, in millimetres.

LAYERS = {
    "unlabelled": 9,
    "root face": 1,
    "bevel face": 5,
    "upper surface": 8,
    "lower surface": 8,
    "fit": 7,
    "corners": 6,
    "dimensions": 3,
    "text": 7,
}  # name -> AutoCAD colour index
CORNER_MM, TEXT_MM, GAP_MM = 0.05, 0.35, 5.0
DIMENSION_MM = 0.8  # of the dimension line, off the root face
DIMENSIONS = {
    "dimlfac": 1.0,
    "dimtxt": 0.25,
    "dimasz": 0.15,
    "dimexe": 0.1,
    "dimexo": 0.05,
    "dimgap": 0.06,
    "dimdec": 3,
    "dimadec": 2,
}


def sections_dxf(shapes: list[SectionShape]) -> bytes:
    """The drawing (DXF R2010, ASCII). A section's x axis is its normal, y goes across, origin the lower edge."""
    options = Extra("ezdxf._options").options
    varying, out = options.write_fixed_meta_data_for_testing, io.StringIO()
    try:  # no time of writing, no random identity: the same sections give the same bytes
        options.write_fixed_meta_data_for_testing = True
        _drawing(shapes).write(out)
    finally:
        options.write_fixed_meta_data_for_testing = varying
    return out.getvalue().encode()


def _drawing(shapes: list[SectionShape]) -> Any:
    filemanagement, units = Extra("ezdxf.filemanagement"), Extra("ezdxf.units")
    drawing = filemanagement.new("R2010", setup=True, units=units.MM)
    for name, colour in LAYERS.items():
        drawing.layers.add(name, color=colour)
    right = 0.0
    for shape in shapes:
        block = drawing.blocks.new(f"section_{shape.section.index}")
        _draw(block, shape)
        left, stop = _extent(shape)
        drawing.modelspace().add_blockref(block.name, (right - left, 0.0))
        right += stop - left + GAP_MM
    for name in sorted(drawing.entitydb.dxf_types_in_use()):  # ezdxf adds them in the order of a set
        drawing.classes.add_class(name)
    return drawing


def _draw(block: Any, shape: SectionShape) -> None:
    for (u, v), face in zip(shape.place_mm.tolist(), shape.points.face.tolist(), strict=True):
        block.add_point((u, v), dxfattribs={"layer": FACE_NAMES[face]})
    for line in shape.lines_mm:
        for start, end in itertools.pairwise(line.tolist()):
            block.add_line(start, end, dxfattribs={"layer": "fit"})
    for corner in shape.corners_mm.values():
        block.add_circle(corner.tolist(), CORNER_MM, dxfattribs={"layer": "corners"})
    if shape.terms is BEVEL_TERMS and shape.lines_mm:
        _dimensions(block, *shape.lines_mm)
    for number, text in enumerate(_texts(shape)):
        block.add_text(text, height=TEXT_MM, dxfattribs={"layer": "text"}).set_placement(
            (_extent(shape)[0], -1.5 * TEXT_MM * (number + 3))
        )


def _dimensions(block: Any, root: Float, bevel: Float) -> None:
    """Root face and bevel angle; the angle between the root face, carried on upwards, and the bevel."""
    attributes = {"layer": "dimensions"}
    block.add_aligned_dim(*root.tolist(), DIMENSION_MM * -1.0, override=DIMENSIONS, dxfattribs=attributes).render()
    block.add_angular_dim_3p(
        root[1] + np.array([0.0, 2.0 * DIMENSION_MM]),
        root[1],
        root[1] + np.array([0.0, 1.0]),
        bevel[1],
        override=DIMENSIONS,
        dxfattribs=attributes,
    ).render()


def _texts(shape: SectionShape) -> list[str]:
    """Section, verdict, and each size that was measured."""
    section = shape.section
    sizes = [
        f"{shape.terms[name][0].lower()} {value:.{3 - angle}f} {unit}, u {u:.{3 - angle}f} {unit}"
        for name, one in section.sizes.items()
        for value, u, unit, angle in ((float(one.value), float(one.u), one.unit, one.unit == "deg"),)
        if np.isfinite(value) and np.isfinite(u)
    ]
    return [
        f"section {section.index} at {section.arc_length_mm:.2f} mm: {section.verdict}",
        *(sizes or [section.reason]),
    ]


def _extent(shape: SectionShape) -> tuple[float, float]:
    """Least and greatest x of a section, mm."""
    u = shape.place_mm[:, 0]
    return float(u.min(initial=-1.0)), float(u.max(initial=1.0)) + DIMENSION_MM


# What a section shows in its own plane: its points, the fitted faces, the corners.

OBLIQUE = 0.3  # a laser plane leans against the section by at most this much, in mm a mm
BEVEL_FALLBACK = 2.0  # times the root face: length of the bevel's line where none of its points is in the section


@dataclass(frozen=True, slots=True, eq=False)
class SectionShape:
    """A section in its plane: (normal, across), mm, from its origin. Without lines where it was not measured."""

    section: Section
    terms: Mapping[str, tuple[str, str]]
    points: PointTable
    place_mm: Shaped[Float, "n 2"]  # of the points
    corners_mm: Mapping[str, Float]
    lines_mm: tuple[Float, ...]  # (k, 2) each; of a bevel the root face upwards, then the bevel face


def section_shape(
    inspection: JointInspection,
    cloud: Cloud,
    edge: Edge | None,
    section: Section,
    thickness_mm: float,
    reach_mm: float,
) -> SectionShape:
    """The points within half a thickness of the section plane and `reach_mm` of its origin, and the fitted lines."""
    table = point_table(cloud, edge, _frames(cloud, edge, section, 0.5 * thickness_mm + OBLIQUE * reach_mm))
    off = table.position_mm - section.origin_mm
    place = np.stack([off @ section.normal, off @ section.across], axis=1)
    here = (np.abs(off @ section.tangent) <= 0.5 * thickness_mm) & (np.hypot(*place.T) <= reach_mm)
    table = PointTable(table.position_mm[here], table.face[here], table.frame[here], table.column[here])
    if inspection.terms is BEVEL_TERMS:
        return SectionShape(section, inspection.terms, table, place[here], *_of_bevel(section, table, place[here]))
    return SectionShape(section, inspection.terms, table, place[here], section.places, section.chains)


def _frames(cloud: Cloud, edge: Edge | None, section: Section, window_mm: float) -> Int:
    """Frames whose profiler or edge lies within `window_mm` of the section's plane."""
    if edge is not None:
        return np.flatnonzero(np.abs(edge.frame_arc_length_mm - section.arc_length_mm) <= window_mm)
    return np.asarray(section.frames)


def _of_bevel(section: Section, table: PointTable, place: Float) -> tuple[dict[str, Float], tuple[Float, ...]]:
    """The lines that the section's values say: the root face lies along `across`, the bevel leans from it."""
    if (sizes := section.root_and_bevel) is None:
        return {}, ()
    root, bevel = sizes
    lower, upper = np.zeros(2), np.array([0.0, root])
    up = np.array([-np.sin(bevel * DEG), np.cos(bevel * DEG)])
    on_bevel = (place[table.face == BEVEL_FACE] - upper) @ up
    length = float(on_bevel.max(initial=0.0)) or BEVEL_FALLBACK * root
    return {"lower_edge": lower, "upper_edge": upper}, (
        np.array([lower, upper]),
        np.array([upper, upper + length * up]),
    )
