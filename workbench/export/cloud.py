"""`export.cloud`: the fused cloud for other people's viewers."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from workbench.artefacts import Cloud, Document, Edge
from workbench.errors import InputError
from workbench.export.cloud_formats import WRITERS, organised_pcd
from workbench.export.points import point_table
from workbench.stage import stage


@stage("export.cloud")
def cloud(
    cloud: Cloud,
    edge: Edge | None = None,
    *,
    format: Annotated[Literal["ply", "pcd", "las", "laz", "e57"], Field(description="of the file")] = "ply",
    organised: Annotated[
        bool, Field(description="pcd: the scanner's grid with NaN, a row a frame, float32, as PCL takes it")
    ] = False,
) -> Document:
    """Write the fused cloud as `cloud.ply` (or pcd, las, laz, e57), each point with its face, frame and column.

    Coordinates are in the robot's base. PLY and PCD keep float64 and mm; LAS and LAZ hold multiples of 1e-5 mm, more
    only for clouds beyond 40 m; E57 is in metres, as its standard (ASTM E2807) prescribes, one scan a face, float32
    about the scan's own origin: 1e-5 mm on a part of 300 mm. Faces: 0 unlabelled, 1 root face (end face), 2 bevel face,
    3 upper surface, 4 lower surface; all 0 without an edge. Points rejected as stray are left out. The same cloud gives
    the same bytes, but for E57, whose scans get new identities each time.

    Args:
        cloud: the cloud.
        edge: its faces, if they are known.
        format: of the file.
        organised: whether a PCD keeps the grid.

    Raises:
        InputError: `organised` with another format than pcd; nothing to write.

    Example:
        >>> from workbench import cloud, export, scan
        >>> made = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> export.cloud(made, format="ply").content[:3]
        b'ply'
    """
    if organised:
        if format != "pcd":
            raise InputError("export.cloud.organised", f"expected format 'pcd' with it, found '{format}'")
        return Document("cloud.pcd", organised_pcd(cloud, edge))
    return Document(f"cloud.{format}", WRITERS[format](point_table(cloud, edge)))
