"""`export.sections`: the sections with their points, for CAD or a spreadsheet."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from workbench.artefacts import BEVEL_FACE, FACE_NAMES, Cloud, Document, Edge, Inspection, Section
from workbench.export.cloud import PointTable, point_table
from workbench.stage import stage
from workbench.units import DEG, Float, Shaped

HEADER = "section,arc_length_mm,kind,face,frame,column,normal_mm,across_mm,x_mm,y_mm,z_mm"


@stage("export.sections")
def sections(
    inspection: Inspection,
    edge: Edge,
    cloud: Cloud,
    *,
    format: Literal["dxf", "csv"] = "dxf",
    thickness_mm: Annotated[float, Field(gt=0, le=20)] = 0.5,
    reach_mm: Annotated[float, Field(ge=1, le=200)] = 25.0,
) -> Document:
    """Write every section in its own plane as `sections.dxf`, or its points and corners as `section_points.csv`.

    Coordinates in a section are mm from the lower edge: `normal` outwards from the root face, `across` from the lower
    to the upper side. The DXF (in mm) holds a block a section: points, fitted lines, corners, root face and bevel angle
    as dimensions, their values with standard uncertainties as text. The CSV has a row a point (with face, frame and
    column) or corner, in the base too; CR LF (RFC 4180).

    Args:
        inspection: the sections.
        edge: faces of the points.
        cloud: the points.
        format: of the file.
        thickness_mm: of the slice whose points are written, half of it on each side of the section plane.
        reach_mm: how far from the lower edge; points further off are left out.

    Example:
        >>> from workbench import cloud, edge, export, inspect, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> milled = edge.segment(points)
        >>> found = inspect.sections(milled)
        >>> export.sections(found, milled, points).name
        'sections.dxf'
    """
    shapes = [section_shape(cloud, edge, section, thickness_mm, reach_mm) for section in inspection.sections]
    if format == "dxf":
        return Document("sections.dxf", sections_dxf(shapes))
    rows = [HEADER, *(row for shape in shapes for row in _rows(shape))]
    return Document("section_points.csv", "\r\n".join([*rows, ""]).encode("ascii"))


def _rows(shape: SectionShape) -> list[str]:
    section, table = shape.section, shape.points
    start = f"{section.index},{section.arc_length_mm:.6f}"
    values = zip(
        table.face.tolist(),
        table.frame.tolist(),
        table.column.tolist(),
        shape.place_mm.tolist(),
        table.position_mm.tolist(),
        strict=True,
    )
    rows = [
        f"{start},point,{face},{frame},{column},{u:.6f},{v:.6f},{x:.6f},{y:.6f},{z:.6f}"
        for face, frame, column, (u, v), (x, y, z) in values
    ]
    if shape.root_line_mm is None:
        return rows
    for name, (u, v) in zip(("lower_edge", "upper_edge"), shape.root_line_mm, strict=True):
        x, y, z = section.origin_mm + u * section.normal + v * section.across
        rows.append(f"{start},{name},,,,{u:.6f},{v:.6f},{x:.6f},{y:.6f},{z:.6f}")
    return rows


# Sections as a DXF drawing: a block a section, side by side, in millimetres.

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
    from ezdxf._options import options

    varying, out = options.write_fixed_meta_data_for_testing, io.StringIO()
    try:  # no time of writing, no random identity: the same sections give the same bytes
        options.write_fixed_meta_data_for_testing = True
        _drawing(shapes).write(out)
    finally:
        options.write_fixed_meta_data_for_testing = varying
    return out.getvalue().encode()


def _drawing(shapes: list[SectionShape]) -> Any:
    from ezdxf import filemanagement, units

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
    return drawing


def _draw(block: Any, shape: SectionShape) -> None:
    for (u, v), face in zip(shape.place_mm.tolist(), shape.points.face.tolist(), strict=True):
        block.add_point((u, v), dxfattribs={"layer": FACE_NAMES[face]})
    root, bevel = shape.root_line_mm, shape.bevel_line_mm
    if root is not None and bevel is not None:
        for line in (root, bevel):
            block.add_line(*line.tolist(), dxfattribs={"layer": "fit"})
        for corner in root.tolist():
            block.add_circle(corner, CORNER_MM, dxfattribs={"layer": "corners"})
        attributes = {"layer": "dimensions"}
        block.add_aligned_dim(*root.tolist(), DIMENSION_MM * -1.0, override=DIMENSIONS, dxfattribs=attributes).render()
        block.add_angular_dim_3p(  # between the root face, carried on upwards, and the bevel
            root[1] + np.array([0.0, 2.0 * DIMENSION_MM]),
            root[1],
            root[1] + np.array([0.0, 1.0]),
            bevel[1],
            override=DIMENSIONS,
            dxfattribs=attributes,
        ).render()
    for number, text in enumerate(_texts(shape.section)):
        block.add_text(text, height=TEXT_MM, dxfattribs={"layer": "text"}).set_placement(
            (_extent(shape)[0], -1.5 * TEXT_MM * (number + 3))
        )


def _texts(section: Section) -> list[str]:
    lines = [f"section {section.index} at {section.arc_length_mm:.2f} mm: {section.verdict}"]
    if section.root_mm is None or section.bevel_deg is None:
        return [*lines, section.reason]
    return [
        *lines,
        f"root face {section.root_mm:.3f} mm, u {section.root_u_mm:.3f} mm",
        f"bevel {section.bevel_deg:.2f} deg, u {section.bevel_u_deg:.2f} deg",
    ]


def _extent(shape: SectionShape) -> tuple[float, float]:
    """Least and greatest x of a section, mm."""
    u = shape.place_mm[:, 0]
    return float(u.min(initial=-1.0)), float(u.max(initial=1.0)) + DIMENSION_MM


# What a section of a milled edge shows in its own plane: its points, the fitted faces, the corners.

OBLIQUE = 0.3  # a laser plane leans against the section by at most this much, in mm a mm
BEVEL_FALLBACK = 2.0  # times the root face: length of the bevel's line where none of its points is in the section


@dataclass(frozen=True, slots=True, eq=False)
class SectionShape:
    """A section in its plane: (normal, across), mm, from the lower edge. Lines are None where it was not measured."""

    section: Section
    points: PointTable
    place_mm: Shaped[Float, "n 2"]  # of the points
    root_line_mm: Shaped[Float, "2 2"] | None  # root face, from its lower edge to its upper edge
    bevel_line_mm: Shaped[Float, "2 2"] | None  # bevel face, from the root face's upper edge upwards


def section_shape(cloud: Cloud, edge: Edge, section: Section, thickness_mm: float, reach_mm: float) -> SectionShape:
    """The points within half a thickness of the section plane and `reach_mm` of the lower edge, and the fitted lines.

    The lines are those that the section's values say: the root face lies along `across`, the bevel leans from it by the
    bevel angle.
    """
    window = 0.5 * thickness_mm + OBLIQUE * reach_mm
    frames = np.flatnonzero(np.abs(edge.frame_arc_length_mm - section.arc_length_mm) <= window)
    table = point_table(cloud, edge, frames)
    off = table.position_mm - section.origin_mm
    place = np.stack([off @ section.normal, off @ section.across], axis=1)
    here = (np.abs(off @ section.tangent) <= 0.5 * thickness_mm) & (np.hypot(*place.T) <= reach_mm)
    table = PointTable(table.position_mm[here], table.face[here], table.frame[here], table.column[here])
    return SectionShape(section, table, place[here], *_lines(section, table, place[here]))


def _lines(section: Section, table: PointTable, place: Float) -> tuple[Float | None, Float | None]:
    if section.root_mm is None or section.bevel_deg is None:
        return None, None
    corner = np.array([0.0, section.root_mm])
    up = np.array([-np.sin(section.bevel_deg * DEG), np.cos(section.bevel_deg * DEG)])
    on_bevel = (place[table.face == BEVEL_FACE] - corner) @ up
    length = float(on_bevel.max(initial=0.0)) or BEVEL_FALLBACK * section.root_mm
    return np.array([[0.0, 0.0], corner]), np.array([corner, corner + length * up])
