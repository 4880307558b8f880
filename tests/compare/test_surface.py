"""`compare.surface`, `compare.mesh`, `compare.plan`: what is taken, and what is refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from workbench.artefacts import PointSet
from workbench.cloud import denoise
from workbench.cloud import read as read_points
from workbench.compare import deviation, mesh, plan, surface
from workbench.errors import InputError
from workbench.path import read
from workbench.scan import fuse
from workbench.scan import read as read_recording

ROOT = Path(__file__).parents[2]
DATA = ROOT / "data" / "synthetic"
WEDGE = Path(__file__).parent / "data" / "wedge.obj"


def test_cloud_points_are_the_clouds() -> None:
    """Points of an organised cloud in the base, with their frames: as its poses say, in float64."""
    cloud = denoise(fuse(read_recording(recording=DATA / "milled_two_pass.h5")))
    found = surface(cloud)
    assert len(found.points_mm) == cloud.keep.sum()
    row, column = np.argwhere(cloud.keep)[1234]
    local = np.array([cloud.x_mm[row, column], 0.0, cloud.z_mm[row, column], 1.0])
    np.testing.assert_allclose(found.points_mm[1234], (cloud.base_from_profiler[row] @ local)[:3], atol=1e-3)
    assert found.frame[1234] == row


def test_large_clouds_are_thinned() -> None:
    cloud = fuse(read_recording(recording=DATA / "milled_edge.h5"))
    found = surface(cloud, most_points=20_000)
    assert 10_000 < len(found.points_mm) <= 20_000


def test_point_sets_and_refusals() -> None:
    points = PointSet(np.random.default_rng(1).normal(size=(5000, 3)), source="a.ply")
    assert len(surface(None, points, most_points=1000).points_mm) == 1000
    with pytest.raises(InputError, match="either an organised cloud or a set of points"):
        surface()
    with pytest.raises(InputError, match="100 points"):
        surface(None, PointSet(points.points_mm[:50]))


def test_points_that_were_read_are_compared(tmp_path: Path) -> None:
    """Points of a file cannot be written to: comparing works on its own."""
    x, y = np.meshgrid(np.arange(0.0, 30.0, 0.3), np.arange(0.0, 20.0, 0.3))
    for name, z in (("a", 0.0), ("b", 0.1)):
        np.savetxt(tmp_path / f"{name}.xyz", np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1))
    one, two = (surface(points=read_points(file=tmp_path / f"{name}.xyz", unit="mm")) for name in "ab")
    found = deviation(one, two, position_u_mm=0.0)[0]
    assert np.nanmedian(np.abs(found.distance_mm)) == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("m", 1000.0), ("inch", 25.4)])
def test_mesh_units_and_pose(unit: str, factor: float) -> None:
    shifted = np.eye(4)
    shifted[:3, 3] = 1.0, 2.0, 3.0
    found = mesh(mesh=WEDGE, unit=unit, base_from_mesh=shifted.tolist())
    assert len(found.triangles) == 6
    np.testing.assert_allclose(np.ptp(found.points_mm, axis=0), factor * np.array([60.0, 24.195, 8.0]))
    np.testing.assert_allclose(found.points_mm.min(axis=0), factor * np.array([0.0, -20.0, -8.0]) + [1, 2, 3])


REFUSED = {
    "none.stl": (None, "cannot be read"),
    "empty.stl": (b"", "1 to"),
    "text.ply": (b"hello\n", "triangles"),
    "cut.stl": (b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0", "triangles"),
    "points.obj": (b"v 0 0 0\nv 1 0 0\n", "triangles"),
    "far.obj": (b"v 0 0 0\nv 1e30 0 0\nv 0 1 0\nf 1 2 3\n", "finite coordinates within 1e+07"),
    "index.ply": (
        b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 99\n",
        "expected",
    ),
    "flat.obj": (b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "triangles with an area"),
    "a.iges": (b"ISO-10303", "expected a mesh as .stl"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_unusable_meshes_are_refused_in_one_line(name: str, tmp_path: Path) -> None:
    content, words = REFUSED[name]
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as caught:
        mesh(mesh=tmp_path / name)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_plan_is_the_bevel() -> None:
    """The strip lies where the part of that plan has its bevel: through its own points, 40 deg to the root face."""
    path = read(toolpath=DATA / "paths" / "raw_arc.json")
    strip, layer = plan(path), path.layers[-1]
    assert strip.triangles is not None
    corners = strip.points_mm[strip.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(normal, axis=1).sum()
    width = layer.width_mm[layer.cutting & (layer.width_mm > 0)]
    assert area == pytest.approx(width.mean() * path.edge_length_mm, rel=0.02)
    near = np.linalg.norm(corners.mean(axis=1) - layer.position_mm[len(layer.position_mm) // 2], axis=1) < 15
    flat = corners[near].reshape(-1, 3)
    off = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(flat))
    assert off < 0.2


def test_a_worn_cutter_leaves_material() -> None:
    """The scan of a part milled by a cutter whose radius is 0.032 to 0.04 mm too small in the last layer."""
    scan = surface(denoise(fuse(read_recording(recording=DATA / "paths" / "raw_arc_milled.h5"))))
    found = deviation(scan, plan(read(toolpath=DATA / "paths" / "raw_arc.json")), position_u_mm=0.0)[0]
    seen = np.isfinite(found.distance_mm)
    slope, start = np.polyfit(found.arc_length_mm[seen], found.distance_mm[seen], 1)
    length = 145.8
    assert start + slope * length == pytest.approx(0.04, abs=0.003)
    assert start == pytest.approx(0.032, abs=0.003)
    assert math.isfinite(slope)


def test_a_plan_of_another_part_is_asked_for() -> None:
    scan = surface(denoise(fuse(read_recording(recording=DATA / "milled_edge.h5"))))
    told = deviation(scan, plan(read(toolpath=DATA / "paths" / "raw_arc.json")))[0].warnings
    assert any("places lie further off than depth_mm, 1 mm: a plan of another part" in one for one in told)
