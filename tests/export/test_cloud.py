"""Exported clouds, read back by the formats' own libraries."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import open3d as o3d
import pye57
import pytest

from workbench.artefacts import FACE_NAMES
from workbench.errors import InputError
from workbench.export import cloud as export_cloud


def expected(inspected):
    """Positions (float64), faces, frames and columns straight from the grid."""
    frame, column = np.nonzero(inspected.cloud.keep)
    x, z = (a[frame, column].astype(np.float64) for a in (inspected.cloud.x_mm, inspected.cloud.z_mm))
    homogeneous = np.stack([x, 0 * x, z, np.ones_like(x)], axis=1)
    position = np.einsum("nij,nj->ni", inspected.cloud.base_from_profiler[frame], homogeneous)[:, :3]
    return position, inspected.edge.labels[frame, column], frame, column


@pytest.mark.parametrize("ending", ["ply", "pcd"])
def test_open3d_reads_every_value(inspected, tmp_path: Path, ending: str):
    document = export_cloud(inspected.cloud, inspected.edge, format=ending)
    assert document.name == f"cloud.{ending}"
    (tmp_path / document.name).write_bytes(document.content)
    found = o3d.t.io.read_point_cloud(tmp_path / document.name).point
    position, face, frame, column = expected(inspected)
    np.testing.assert_allclose(found.positions.numpy(), position, atol=1e-9)
    for name, values in (("face", face), ("frame", frame), ("column", column)):
        np.testing.assert_array_equal(found[name].numpy().ravel(), values)
    assert b"unit mm" in document.content[:500]
    assert len(np.unique(face)) >= 3, "faces to tell apart"


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_laspy_reads_every_value(inspected, ending: str):
    las = laspy.read(io.BytesIO(export_cloud(inspected.cloud, inspected.edge, format=ending).content))
    position, face, frame, column = expected(inspected)
    np.testing.assert_allclose(las.xyz, position, atol=0.51e-5)
    for name, values in (("face", face), ("frame", frame), ("column", column)):
        np.testing.assert_array_equal(np.asarray(las[name]), values)
    assert las.header.system_identifier == "unit: mm"
    assert las.header.are_points_compressed == (ending == "laz")


def test_pye57_reads_every_value(inspected, tmp_path: Path):
    (tmp_path / "cloud.e57").write_bytes(export_cloud(inspected.cloud, inspected.edge, format="e57").content)
    file = pye57.E57(str(tmp_path / "cloud.e57"))
    position, face, frame, column = expected(inspected)
    names = [file.get_header(i)["name"].value() for i in range(file.scan_count)]
    assert names == [FACE_NAMES[label] for label in np.unique(face)]
    for i, label in enumerate(np.unique(face)):
        assert file.get_header(i).rotation.tolist() == [1.0, 0.0, 0.0, 0.0]
        scan, mine = file.read_scan(i, row_column=True, ignore_missing_fields=True), face == label
        found = np.stack([scan[f"cartesian{k}"] for k in "XYZ"], axis=1)
        np.testing.assert_allclose(found, position[mine] / 1000, atol=1e-8)  # m: 1e-5 mm
        np.testing.assert_array_equal(scan["rowIndex"], frame[mine])
        np.testing.assert_array_equal(scan["columnIndex"], column[mine])


def test_what_cannot_be_written_is_refused(inspected):
    empty = replace(inspected.cloud, keep=np.zeros_like(inspected.cloud.keep))
    with pytest.raises(InputError, match="none left"):
        export_cloud(empty)
    with pytest.raises(InputError, match="expected labels of the cloud's"):
        export_cloud(inspected.cloud, replace(inspected.edge, labels=inspected.edge.labels[:-1]))
