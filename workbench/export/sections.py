"""`export.sections`: the sections with their points, for CAD or a spreadsheet."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from workbench.artefacts import Cloud, Document, Edge, Inspection
from workbench.export.section_dxf import sections_dxf
from workbench.export.section_shapes import SectionShape, section_shape
from workbench.stage import stage

HEADER = "section,arc_length_mm,kind,face,frame,column,normal_mm,across_mm,x_mm,y_mm,z_mm"


@stage("export.sections")
def sections(
    inspection: Inspection,
    edge: Edge,
    cloud: Cloud,
    *,
    format: Annotated[Literal["dxf", "csv"], Field(description="of the file")] = "dxf",
    thickness_mm: Annotated[
        float, Field(gt=0, le=20, description="of the slice whose points are written, across the section plane")
    ] = 0.5,
    reach_mm: Annotated[float, Field(ge=1, le=200, description="how far from the lower edge")] = 25.0,
) -> Document:
    """Write every section in its own plane as `sections.dxf`, or its points and corners as `section_points.csv`.

    Coordinates in a section are mm from the lower edge: `normal` outwards from the root face, `across` from the lower
    to the upper side. The DXF declares millimetres and holds a block a section: points, fitted lines of root face and
    bevel, corners, root face and bevel angle as dimensions, and their values with standard uncertainties as text. The
    CSV has a row a point (with face, frame and column) or corner, in the base too; lines end in CR LF (RFC 4180).

    Args:
        inspection: the sections.
        edge: faces of the points.
        cloud: the points.
        format: of the file.
        thickness_mm: points within half of it on each side of the section plane are the section's.
        reach_mm: points further from the lower edge are left out.
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
