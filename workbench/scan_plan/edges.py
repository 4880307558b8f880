"""Where the edge is, roughly: a coarse recording, a planned toolpath, taught points, a polyline, a model."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from scipy.spatial import KDTree

from workbench import cad
from workbench.artefacts import ROOT_FACE, Cloud, Edge, HandEye, Toolpath
from workbench.cad import NominalEdge
from workbench.compare.surface_stage import rigid
from workbench.errors import InputError
from workbench.geometry.grids import fuse
from workbench.geometry.poses import rotation_from_quaternion
from workbench.path.course import components
from workbench.plugins.csv_table import Table
from workbench.result_files.contract import ResultFile, Vector
from workbench.scan_plan.information import Joint
from workbench.scan_plan.way import STATION_MM, EdgeLine
from workbench.storage import read_text
from workbench.strict_json import MAX_BYTES, read_json
from workbench.units import DEG, TO_SD, Float, Shaped

OFF_PLATE_MM, NEAR_MM = 3.0, 80.0  # off the nominal plate, and at most from the edge: what stands there is no plate
SAMPLED = 40_000  # points of a coarse recording that are looked at
SAMPLED_FRAMES = 200  # likewise, for its noise
SECOND_DIFFERENCE = TO_SD / math.sqrt(6.0)  # standard deviation by the median of |z1 - 2 z2 + z3|
LEFT, SURE = 0.5, 0.06  # of roughness, by a frame's line; of the noise's variance, that is no chance
RECORDINGS, DRAWINGS = (".h5", ".hdf5"), (".dxf",)
POINT = ("x_mm", "y_mm", "z_mm")  # columns of a polyline in the base


class EdgeLineFile(ResultFile):
    """`edge-line.json`: taught points of the lower edge."""

    NAME: ClassVar[str] = "edge-line.json"
    format: Literal["edge-line"]
    version: Literal[1]
    points_mm: list[Vector] = Field(min_length=2, description="in the base, in order of t = m x n")
    upper_side: Vector | None = Field(default=None, description="roughly m; null: as the stage has it")


def read_edge(path: Path, upper_side: Float, joint: Joint, hand_eye: HandEye | None) -> EdgeLine:
    """The edge that a file tells of, by its kind.

    Raises:
        InputError: it is none of these, or holds no edge.
    """
    suffix = path.suffix.lower()
    if suffix in RECORDINGS:
        return _recorded(path, upper_side, joint, hand_eye)
    if suffix in DRAWINGS:
        return EdgeLine.through(_in_order(_dxf_points(path), path), upper_side, path, by_order=True)
    if suffix == ".csv":
        points = Table(path, POINT, 2).numbers(POINT)
        return EdgeLine.through(_in_order(points, path), upper_side, path, by_order=True)
    if read_json(path).get("format") == "bevel-toolpath":
        from workbench.path import read

        return _planned(read(toolpath=path), path)
    file = EdgeLineFile.read(path)
    upper = upper_side if file.upper_side is None else np.array(file.upper_side)
    return EdgeLine.through(_in_order(np.array(file.points_mm), path), upper, path, by_order=True)


BACK = -0.75  # cosine: a ring of three points turns by 120 deg at each


def _in_order(points_mm: Float, path: Path) -> Float:
    """Points (p, 3) of an edge as given; points nearer than a station to the one before tell no direction.

    Raises:
        InputError: all are the same; at one of them the way turns back.
    """
    kept = [0]
    for k in range(1, len(points_mm)):
        if np.linalg.norm(points_mm[k] - points_mm[kept[-1]]) > STATION_MM:
            kept.append(k)
    if not np.ptp(points_mm, axis=0).any():
        raise InputError(str(path), "expected different points along the edge, found one place alone")
    step = np.diff(points_mm[kept], axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    back = np.flatnonzero((step[:-1] * step[1:]).sum(axis=1) < BACK)
    if len(back):
        k = kept[back[0] + 1]
        at = ", ".join(f"{value:g}" for value in points_mm[k])
        why = f"expected points in order along the edge, found that it turns back at point {k + 1} ({at} mm)"
        raise InputError(str(path), f"{why}: out of order, or a place twice?")
    return points_mm


def modelled(path: Path | None, number: int | None, base_from_cad: list[list[float]] | None) -> NominalEdge | None:
    """The edge of a STEP model, in the base; None: the file is none.

    Raises:
        InputError: as `nominal_edge`; no rigid motion; a number or a motion, but no model.
    """
    if path is None or path.suffix.lower() not in cad.SUFFIXES:
        if number is not None or base_from_cad is not None:
            raise InputError("scan.plan", "expected a STEP model as edge, with edge_number or base_from_cad")
        return None
    edge = cad.nominal_edge(path, number)
    if base_from_cad is None:
        return edge
    pose = rigid(base_from_cad, "scan.plan.base_from_cad")
    turn = pose[:3, :3].T
    return replace(edge, points_mm=edge.points_mm @ turn + pose[:3, 3], upper_side=edge.upper_side @ turn)


def _planned(path: Toolpath, file: Path) -> EdgeLine:
    """The lower edge under a toolpath's last layer: its frames stand at mid-width of the bevel face."""
    layer = path.layers[-1]
    frames, half = rotation_from_quaternion(layer.quaternion_wxyz), 0.5 * layer.width_mm
    x, z, beta = frames[:, :, 0], frames[:, :, 2], path.bevel_deg * DEG
    across = -np.sin(beta) * x - np.cos(beta) * z
    lower = path.face_middle_mm(layer) + half[:, None] * z - path.root_mm * across
    on = layer.measured & (layer.arc_length_mm >= 0.0) & (layer.arc_length_mm <= path.edge_length_mm) & (half > 0.0)
    if on.sum() < 2:
        raise InputError(str(file), "expected a last layer that cuts at two points and more")
    pose = np.eye(4) if path.base_from_workobject is None else path.base_from_workobject
    return EdgeLine.through(path.in_base(lower[on]), across[on] @ pose[:3, :3].T, file)


def _recorded(path: Path, upper_side: Float, joint: Joint, hand_eye: HandEye | None) -> EdgeLine:
    """Of a coarse recording of the raw edge, or of the milled one; and what it shows beside the plate."""
    from workbench import cloud, edge, scan

    points = cloud.denoise(
        scan.fuse(scan.read(recording=path), hand_eye=None if hand_eye is None else Path(hand_eye.source))
    )
    found: Edge
    try:
        found = edge.segment_raw(points, upper_side=tuple(upper_side.tolist()))
    except InputError as raw:
        try:
            found = edge.segment(points, root_nominal_mm=joint.root_mm, bevel_nominal_deg=joint.bevel / DEG)
        except InputError:
            raise raw from None
    seen = np.isfinite(found.position_mm).all(axis=1)
    line = EdgeLine.through(found.position_mm[seen], found.across[seen], path)
    return replace(line, surroundings_mm=_surroundings(points, line, joint), roughness_mm=roughness_mm(points, found))


def roughness_mm(cloud: Cloud, found: Edge) -> float:
    """Three standard deviations of the end face's own form across it, range noise taken off; 0: no more is seen.

    Noise is what neighbouring columns differ by, which texture of 0.7 mm and longer does not. Each frame's line leaves
    half of texture up to 20 mm long (0.010 to 0.1 mm on simulated faces of 8 mm).
    """
    face = found.faces[ROOT_FACE]
    some = slice(None, None, max(1, face.count.size // SAMPLED_FRAMES))
    z = np.where((found.labels[some] == ROOT_FACE) & cloud.keep[some], cloud.z_mm[some], np.nan)
    noise = noise_mm(z)
    square = face.noise_mm**2 - noise**2
    return 3.0 * math.sqrt(square) / LEFT if square > SURE * noise**2 else 0.0


def noise_mm(z: Shaped[Float, "f c"]) -> float:
    """Standard deviation of the ranges in frames, by what neighbouring columns differ by."""
    return SECOND_DIFFERENCE * float(np.nanmedian(np.abs(z[:, :-2] - 2.0 * z[:, 1:-1] + z[:, 2:])))


def _surroundings(cloud: Cloud, line: EdgeLine, joint: Joint) -> Float:
    """Points (b, 3) near the edge that lie off the nominal plate: clamps, stops, a table."""
    origin = line.position_mm[0]
    points = fuse(cloud.x_mm, cloud.z_mm, cloud.base_from_profiler, origin)[cloud.keep] + origin
    points = points[:: max(1, len(points) // SAMPLED)]
    nearest = KDTree(line.position_mm).query(points)[1]
    n, m = components(points - line.position_mm[nearest], line.normal[nearest], line.across[nearest]).T
    outside = (n > OFF_PLATE_MM) | (m > joint.thickness_mm + OFF_PLATE_MM) | (m < -OFF_PLATE_MM)
    return np.asarray(points[outside & (np.hypot(n, m) < NEAR_MM)])


def _dxf_points(path: Path) -> Float:
    """Points (p, 3) of the polyline, or of the chain of lines, of a DXF drawing in mm.

    Group codes 10, 20, 30 (11, 21, 31: a line's end); of a light polyline 38 is the height. Arcs (bulges) are refused:
    export them as points. Source: Autodesk, DXF Reference.
    """
    text = [line.strip() for line in read_text(path, MAX_BYTES).splitlines()]
    codes = list(zip(text[::2], text[1::2], strict=False))
    entities: list[tuple[str, list[tuple[str, str]]]] = []
    for code, value in codes:
        if code == "0":
            entities.append((value, []))
        elif entities:
            entities[-1][1].append((code, value))
    try:
        chains = list(_chains(entities, path))
    except ValueError as error:
        raise InputError(str(path), f"expected a DXF file in text form: {error}") from None
    lines = [chain for chain in chains if len(chain) > 1]
    if not lines:
        raise InputError(str(path), "expected a POLYLINE, LWPOLYLINE or LINE along the lower edge, found none")
    if len(lines) > 1:
        raise InputError(str(path), f"expected one polyline along the lower edge, found {len(lines)}: which is it?")
    return np.array(lines[0])


def _chains(entities: list[tuple[str, list[tuple[str, str]]]], path: Path):  # type: ignore[no-untyped-def]
    """Polylines, and lines that go on from one another, as lists of points."""
    vertices: list[tuple[float, float, float]] = []
    loose: list[list[tuple[float, float, float]]] = []
    for name, groups in entities:
        if any(code == "42" and float(value) != 0.0 for code, value in groups):
            raise InputError(str(path), "expected straight pieces, found an arc: export the edge as points")
        known = {code: float(value) for code, value in groups if code in ("10", "20", "30", "11", "21", "31", "38")}
        if name == "VERTEX":
            vertices.append((known["10"], known["20"], known.get("30", 0.0)))
        elif name == "SEQEND":
            yield vertices
            vertices = []
        elif name == "LWPOLYLINE":
            x, y = ([float(value) for code, value in groups if code == which] for which in ("10", "20"))
            yield [(a, b, known.get("38", 0.0)) for a, b in zip(x, y, strict=True)]
        elif name == "LINE":
            ends = [(known[a], known[b], known.get(c, 0.0)) for a, b, c in (("10", "20", "30"), ("11", "21", "31"))]
            if loose and np.allclose(loose[-1][-1], ends[0], atol=1e-3):
                loose[-1].append(ends[1])
            else:
                loose.append(ends)
    yield from loose
