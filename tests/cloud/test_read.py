"""Clouds of other programs, written by their own libraries; and what is refused of them."""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import open3d as o3d
import pye57
import pytest

from workbench.cloud import read
from workbench.errors import InputError
from workbench.units import Float


@pytest.fixture
def points() -> Float:
    """Far from the origin, with more digits than float32 has."""
    return np.random.default_rng(1).uniform(0, 80, (400, 3)) + np.array([2_000.123456789, -1_500.0, 700.0])


def write_ply(path: Path, points: Float) -> None:
    o3d.io.write_point_cloud(str(path), o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)))


def write_pcd(path: Path, points: Float) -> None:
    """Doubles beside other fields, which Open3D's older reader takes for zeros."""
    cloud = o3d.t.geometry.PointCloud()
    cloud.point["positions"] = o3d.core.Tensor(points)
    cloud.point["ring"] = o3d.core.Tensor(np.ones((len(points), 1), np.int32))
    o3d.t.io.write_point_cloud(str(path), cloud)


def write_las(path: Path, points: Float) -> None:
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, header.offsets = np.full(3, 1e-4), points.mean(axis=0)
    las = laspy.LasData(header)
    las.xyz = points
    las.write(str(path))


def write_e57(path: Path, points: Float) -> None:
    """Two scans with poses of their own: the second one turned a quarter about z."""
    file = pye57.E57(str(path), mode="w")
    half = len(points) // 2
    quarter = np.array([np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)])
    for part, rotation in ((points[:half], np.array([1.0, 0, 0, 0])), (points[half:], quarter)):
        origin = part.mean(axis=0) / 1000
        off = part / 1000 - origin
        if rotation is quarter:
            off = np.stack([off[:, 1], -off[:, 0], off[:, 2]], axis=1)  # turned back
        file.write_scan_raw(
            {f"cartesian{k}": off[:, i] for i, k in enumerate("XYZ")}, rotation=rotation, translation=origin
        )
    file.close()


WRITERS: dict[str, tuple[Callable[[Path, Float], Any], float]] = {  # ending -> writer, resolution in mm
    "ply": (write_ply, 0.0),
    "pcd": (write_pcd, 0.0),
    "xyz": (lambda path, points: np.savetxt(path, points, fmt="%.9f", header="a cloud"), 1e-9),
    "csv": (lambda path, points: np.savetxt(path, points, fmt="%.17g", delimiter=";"), 1e-9),
    "las": (write_las, 0.51e-4),
    "laz": (write_las, 0.51e-4),
    "e57": (write_e57, 1e-5),
}


@pytest.mark.parametrize("ending", WRITERS)
def test_formats_keep_their_digits_and_their_order(tmp_path: Path, points: Float, ending: str) -> None:
    path = tmp_path / f"cloud.{ending}"
    writer, resolution = WRITERS[ending]
    writer(path, points)
    np.testing.assert_allclose(read(file=path).points_mm, points, rtol=0, atol=resolution)


@pytest.mark.parametrize("mark", [";", " ", "\t"])
def test_decimal_commas_and_the_unit_in_a_title_are_read(tmp_path: Path, points: Float, mark: str) -> None:
    path = tmp_path / "cloud.csv"
    rows = [mark.join(f"{v / 1000:.9f}" for v in point).replace(".", ",") for point in points.tolist()]
    path.write_text("\n".join([mark.join(f"{axis}[m]" for axis in "XYZ"), *rows]))
    found = read(file=path)
    np.testing.assert_allclose(found.points_mm, points, rtol=0, atol=1e-6)
    assert not found.warnings


@pytest.mark.parametrize("ending", ["stl", "obj"])
def test_vertices_of_a_mesh(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"part.{ending}"
    ball = o3d.geometry.TriangleMesh.create_sphere(20.0, 12)
    ball.compute_triangle_normals()
    o3d.io.write_triangle_mesh(str(path), ball)
    found = read(file=path).points_mm
    assert len(found) == len(ball.vertices), "each vertex once"
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 20.0, atol=1e-4)


def test_units(tmp_path: Path, points: Float) -> None:
    path = tmp_path / "metres.xyz"
    np.savetxt(path, points / 1000, fmt="%.12f")
    np.testing.assert_allclose(read(file=path, unit="m").points_mm, points, atol=1e-8)
    with pytest.raises(InputError, match=r"found one of 0\.0\d+ mm with coordinates in mm; are its coordinates in m"):
        read(file=path)
    np.savetxt(path, points, fmt="%.6f")
    with pytest.raises(InputError, match="beyond 1 km: is the unit another"):
        read(file=path, unit="m")
    np.savetxt(path, points - points.mean(axis=0), fmt="%.6f")
    with pytest.raises(InputError, match="are its coordinates in mm or inch"):
        read(file=path, unit="m")


def test_a_part_in_inches_is_no_small_part(tmp_path: Path, points: Float) -> None:
    """Of 130 mm: 5.1 inch, which was measured as a plate of 5 mm."""
    path, size = tmp_path / "inches.xyz", float(np.ptp(points, axis=0).max())
    np.savetxt(path, points * (130.0 / size) / 25.4, fmt="%.6f")
    with pytest.raises(InputError, match=r"expected a part of 12 mm .* in m or inch"):
        read(file=path)


WKT1 = 'PROJCS["x",GEOGCS["g",DATUM["d",SPHEROID["s",6378137,298.257]],UNIT["degree",0.0174532925199433]],UNIT[{}]]'
DEGREES_AND_METRES = (  # as GDAL writes them
    'COMPD_CS["c",GEOGCS["g",DATUM["d",SPHEROID["s",6378137,298.257]],UNIT["degree",0.0174532925199433]],'
    'VERT_CS["h",VERT_DATUM["v",2005,EXTENSION["PROJ4_GRIDS","egm96_15.gtx"]],UNIT["metre",1]]]'
)
WKT2 = (
    'PROJCRS["x",BASEGEOGCRS["g",DATUM["d",ELLIPSOID["s",6378137,298.257,LENGTHUNIT["metre",1]]]],'
    'CS[Cartesian,2],AXIS["(E)",east],LENGTHUNIT[{}]]'
)


def las_of_a_map(path: Path, *records: Any, points: Float, scale: float) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 1e-6)
    header.vlrs.append(laspy.VLR("someone", 7, "first", b"x" * 5000))
    header.vlrs.extend(records)
    las = laspy.LasData(header)
    las.xyz = (points - points.mean(axis=0)) * scale
    las.write(str(path))
    return path


def geo_keys(*pairs: tuple[int, int]) -> laspy.VLR:
    rows = [(1, 1, 0, len(pairs)), *((key, 0, 1, value) for key, value in pairs)]
    return laspy.VLR("LASF_Projection", 34735, "", np.array(rows, "<u2").tobytes())


def wkt(text: str) -> laspy.VLR:
    return laspy.VLR("LASF_Projection", 2112, "", text.encode() + b"\0")


@pytest.mark.parametrize(
    ("record", "mm"),
    [
        (wkt(WKT1.format('"metre",1')), 1000.0),
        (wkt(WKT2.format('"metre",1.0')), 1000.0),
        (wkt(WKT1.format('"millimetre",0.001')), 1.0),
        (geo_keys((1024, 1), (3076, 9001), (4099, 9001)), 1000.0),
    ],
)
def test_a_map_has_the_unit_of_its_record(tmp_path: Path, points: Float, record: laspy.VLR, mm: float) -> None:
    found = read(file=las_of_a_map(tmp_path / "map.las", record, points=points, scale=1.0 / mm))
    np.testing.assert_allclose(np.ptp(found.points_mm, axis=0), np.ptp(points, axis=0), atol=0.01)
    assert not found.warnings


@pytest.mark.parametrize(
    ("records", "told"),
    [
        ([wkt(WKT1.format('"US survey foot",0.304800609601219'))], "found US survey foot"),
        ([wkt(WKT2.format('"foot",0.3048'))], "found foot"),
        ([wkt('GEOGCS["g",UNIT["degree",0.0174532925199433]]')], "found no unit"),
        ([geo_keys((3076, 9003))], "found US survey foot"),
        ([geo_keys((3072, 25832))], "found no unit"),
        ([geo_keys((3072, 2225), (4099, 9001))], "found no unit"),  # a plane in feet by its number
        ([wkt(DEGREES_AND_METRES)], "found no unit"),
        ([geo_keys((3076, 9001)), wkt(WKT1.format('"foot",0.3048'))], "found foot and metre"),
    ],
)
def test_a_map_in_another_unit_or_none_is_refused_until_one_is_stated(tmp_path, points, records, told):
    file = las_of_a_map(tmp_path / "map.las", *records, points=points, scale=1.0)
    with pytest.raises(InputError, match=f"{told}: state the .unit."):
        read(file=file)
    assert np.ptp(read(file=file, unit="mm").points_mm, axis=0) == pytest.approx(np.ptp(points, axis=0), abs=1e-3)


def test_a_map_told_behind_the_points(tmp_path: Path, points: Float) -> None:
    file = las_of_a_map(tmp_path / "map.las", points=points, scale=1e-3)
    las = laspy.read(file)
    las.evlrs = laspy.vlrs.vlrlist.VLRList([wkt(WKT1.format('"metre",1'))])
    las.write(str(file))
    assert np.ptp(read(file=file).points_mm, axis=0) == pytest.approx(np.ptp(points, axis=0), abs=0.01)
    damaged = bytearray(file.read_bytes())
    (record,) = struct.unpack_from("<Q", damaged, 235)
    struct.pack_into("<Q", damaged, record + 20, 2**63)  # its length
    file.write_bytes(damaged)
    with pytest.raises(InputError):
        read(file=file)


def test_what_was_taken_for_granted_is_told(tmp_path: Path, points: Float) -> None:
    path = tmp_path / "c.xyz"
    np.savetxt(path, 250.0 * (points - points.mean(axis=0)))  # of 20 m, if in mm: or of 20 km
    assert "taken as mm, a part of 1.98e+04 mm (state" in read(file=path).warnings[0]
    np.savetxt(path, points - points.mean(axis=0))
    assert "taken as mm, a part of 79.1 mm; in inch it would be" in read(file=path).warnings[0]
    assert not read(file=path, unit="mm").warnings


def test_points_without_coordinates_are_left_out(tmp_path: Path, points: Float) -> None:
    path = tmp_path / "cloud.xyz"
    points[7] = np.nan
    np.savetxt(path, points)
    assert len(read(file=path).points_mm) == len(points) - 1
    points[7:9] = 0.0  # a corner of a mesh may lie there
    np.savetxt(path, points)
    assert len(read(file=path, unit="mm").points_mm) == len(points)
    np.savetxt(path, np.vstack([points, np.zeros((300, 3))]))
    made = read(file=path, unit="mm")
    assert len(made.points_mm) == len(points) - 2
    assert "302 points at 0, 0, 0" in made.warnings[0]
    points[7] = np.inf
    np.savetxt(path, points)
    with pytest.raises(InputError, match=r"point 8: expected coordinates in mm"):
        read(file=path)


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("a.dwg", b"x", "expected a cloud as PLY, PCD.*found the ending '.dwg'"),
        ("a.ply", b"ply\nformat ascii 1.0\n", "expected a complete PLY file: .*"),
        (
            "b.ply",
            b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nend_header\n1\n",
            "expected a complete PLY file: Read PLY failed: unable to read file$",
        ),
        ("a.pcd", b"VERSION 0.7\nFIELDS x\n", "no DATA line"),
        ("a.pcd", b"FIELDS x\nSIZE 8\nCOUNT 1\nPOINTS 99999999999\nDATA binary\n1", "too many for the 1 bytes"),
        ("a.xyz", b"1 2 3\n4 5\n", "row 2"),
        ("a.xyz", b"1 2 3\n4 five 6\n", "'five'"),
        ("a.xyz", b"1 2 3\n4 5 6\n", "at least 100 points, found 2"),
        ("a.las", b"LASF" + bytes(500), "expected a complete LAS file"),
        ("a.e57", b"ASTM-E57" + bytes(2000), "expected a complete E57 file"),
        ("a.stl", b"solid x\nfacet normal 0 0", "a whole STL file|at least 100 points, found 0"),
    ],
)
def test_unusable_files_end_in_one_line(tmp_path: Path, name: str, content: bytes, expected: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=expected) as refused:
        read(file=path)
    assert "\n" not in str(refused.value)
    assert str(path) in str(refused.value)
