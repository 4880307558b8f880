"""`export.cloud`: the fused cloud for other people's viewers."""

from __future__ import annotations

import datetime
import io
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from workbench.artefacts import FACE_NAMES, Cloud, Document, Edge
from workbench.artefacts.scans import Labelled, tensor_cloud
from workbench.errors import InputError
from workbench.extras import Extra
from workbench.stage import stage
from workbench.units import AnyArray, Float, Int, Shaped


@dataclass(frozen=True, slots=True, eq=False)
class PointTable:
    """n points, frame by frame."""

    position_mm: Shaped[Float, "n 3"]  # in the base
    face: Shaped[AnyArray, " n"]  # uint8, label as in artefacts.FACE_NAMES
    frame: Shaped[Int, " n"]
    column: Shaped[Int, " n"]


def point_table(cloud: Cloud, edge: Edge | None, frames: Int | None = None) -> PointTable:
    """The kept points of the cloud, of all frames or of some; all unlabelled without an edge.

    Raises InputError where nothing is left, or where the edge is not that cloud's.
    """
    keep = cloud.keep if frames is None else cloud.keep[frames]
    if edge is not None and edge.labels.shape != cloud.keep.shape:
        raise InputError("edge", f"expected labels of the cloud's {cloud.keep.shape} grid, found {edge.labels.shape}")
    row, column = np.nonzero(keep)
    frame = row if frames is None else frames[row]
    if frames is None and not frame.size:
        raise InputError(cloud.source, "expected points to write, the cloud has none left")
    position = cloud.placed(frame, column)
    face = np.zeros(frame.size, np.uint8) if edge is None else edge.labels[frame, column]
    return PointTable(position, face, frame, column)


@stage("export.cloud")
def cloud(
    cloud: Cloud,
    edge: Edge | None = None,
    *,
    format: Literal["ply", "pcd", "las", "laz", "e57"] = "ply",
    organised: bool = False,
) -> Document:
    """Write the fused cloud as `cloud.ply` (or pcd, las, laz, e57), each point with its face, frame and column.

    In the robot's base. PLY and PCD keep float64 and mm; LAS and LAZ multiples of 1e-5 mm; E57 is in metres (ASTM
    E2807), one scan per face, float32 about its own origin. Faces: 0 unlabelled, 1 root face (end face), 2 bevel
    face, 3 upper surface, 4 lower surface.

    Args:
        cloud: the cloud.
        edge: its faces, if they are known.
        format: of the file.
        organised: pcd: the scanner's grid with NaN, one row per frame, float32 (PCL).

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


# A table of points as PLY, PCD (Open3D), LAS, LAZ (laspy) or E57 (pye57).

FINEST_LAS_MM = 1e-5
MOST_E57_ROWS = 65_535  # pye57 reads and writes row and column as uint16
M = 1e-3  # m per mm
NO_DATE = datetime.date(1970, 1, 1)
NOTE = b"unit mm; face: 0 unlabelled, 1 root face, 2 bevel face, 3 upper surface, 4 lower surface"


def _open3d(ending: str, note_after: bytes, note: bytes, table: PointTable) -> bytes:
    """PLY or PCD with float64 coordinates and integer attributes; the unit stands in a comment of the header."""
    import open3d as o3d

    points = tensor_cloud(table.position_mm, face=table.face, frame=table.frame, column=table.column)
    points.point["face"] = points.point["face"].to(o3d.core.uint8)
    with tempfile.TemporaryDirectory(prefix="workbench-export-") as folder:
        path = Path(folder) / f"cloud.{ending}"
        if not o3d.t.io.write_point_cloud(path, points):
            raise InputError(f"cloud.{ending}", "Open3D could not write it")
        written = path.read_bytes()
    return written.replace(note_after, note_after + note + NOTE + b"\n", 1)


def _las(compressed: bool, table: PointTable) -> bytes:
    """LAS 1.4 with face, frame and column as extra bytes; the unit stands in the header's system identifier."""
    laspy = Extra("laspy")
    header = laspy.LasHeader(point_format=6, version="1.4")
    low, high = table.position_mm.min(axis=0), table.position_mm.max(axis=0)
    header.offsets = np.round((low + high) / 2.0)
    reach = float(np.abs(np.concatenate([low, high]) - np.tile(header.offsets, 2)).max())
    header.scales = np.full(3, max(FINEST_LAS_MM, 10.0 ** math.ceil(math.log10(max(reach, 1.0) / 2**31))))
    header.system_identifier = "unit: mm"
    header.generating_software = "workbench"
    header.creation_date = NO_DATE  # the same cloud gives the same bytes
    for name, kind in (("face", "u1"), ("frame", "u4"), ("column", "u4")):
        header.add_extra_dim(laspy.ExtraBytesParams(name=name, type=kind))
    las = laspy.LasData(header)
    las.xyz = table.position_mm
    las.face, las.frame, las.column = table.face, table.frame.astype(np.uint32), table.column.astype(np.uint32)
    out = io.BytesIO()
    las.write(out, do_compress=compressed)
    return out.getvalue()


def _e57(table: PointTable) -> bytes:
    """One scan per face, named after it, in metres about its own origin; frame and column are row and column."""
    pye57 = Extra("pye57")
    if max(int(table.frame.max()), int(table.column.max())) > MOST_E57_ROWS:
        raise InputError(
            "cloud.e57",
            f"expected at most {MOST_E57_ROWS} frames and columns, found "
            f"{table.frame.max() + 1} x {table.column.max() + 1}: write another format",
        )
    with tempfile.TemporaryDirectory(prefix="workbench-export-") as folder:
        path = Path(folder) / "cloud.e57"
        file = pye57.E57(str(path), mode="w")
        for face, name in enumerate(FACE_NAMES):
            mine = table.face == face
            if not mine.any():
                continue
            position = table.position_mm[mine] * M
            origin = (position.min(axis=0) + position.max(axis=0)) / 2.0
            data = {f"cartesian{axis}": position[:, k] - origin[k] for k, axis in enumerate("XYZ")}
            data |= {"rowIndex": table.frame[mine], "columnIndex": table.column[mine]}
            file.write_scan_raw(data, name=name, rotation=np.array([1.0, 0.0, 0.0, 0.0]), translation=origin)
        file.close()
        return path.read_bytes()


def organised_pcd(cloud: Cloud, edge: Labelled | None) -> bytes:
    """PCD with the scanner's grid: HEIGHT frames of WIDTH columns, x, y, z as float32 in mm in the base, label uint32.

    As PCL's PointXYZL reads it; NaN where nothing came back or a filter rejected it. float32 errs by 0.0001 mm at 1 m.
    """
    frames, columns = cloud.keep.shape
    grid = np.zeros((frames, columns), [("xyz", "<f4", 3), ("label", "<u4")])
    grid["xyz"] = np.nan
    row, column = np.nonzero(cloud.keep)
    grid["xyz"][row, column] = cloud.placed(row, column)
    if edge is not None:
        grid["label"][row, column] = edge.labels[row, column]
    head = (
        "# .PCD v0.7 - Point Cloud Data file format\n"
        f"# {NOTE.decode()}\nVERSION 0.7\nFIELDS x y z label\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
        f"WIDTH {columns}\nHEIGHT {frames}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {frames * columns}\nDATA binary\n"
    )
    return head.encode() + grid.tobytes()


WRITERS: dict[str, Callable[[PointTable], bytes]] = {
    "ply": partial(_open3d, "ply", b"comment Created by Open3D\n", b"comment "),
    "pcd": partial(_open3d, "pcd", b"# .PCD v0.7 - Point Cloud Data file format\n", b"# "),
    "las": partial(_las, False),
    "laz": partial(_las, True),
    "e57": _e57,
}
