"""Programs of others read what is written; those that are not on this machine are skipped (docs/stability.md)."""

from __future__ import annotations

import io
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tests.seldom import seldom
from workbench.cloud import read as read_cloud
from workbench.export import cloud as export_cloud
from workbench.export import inspection as export_inspection

ROOT = Path(__file__).parents[2]
RECORDING = ROOT / "data" / "synthetic" / "milled_edge.h5"


@pytest.mark.parametrize("name", ["pandas", "polars"])
def test_tables_are_read(name: str, inspected, provenance) -> None:
    library = pytest.importorskip(name, reason=f"{name} is not installed")
    made = {kind: export_inspection(inspected.inspection, provenance, format=kind) for kind in ("parquet", "csv")}
    told = [one.values["root_mm"] for one in inspected.inspection.sections]
    for kind, document in made.items():
        table = getattr(library, f"read_{kind}")(io.BytesIO(document.content))
        assert table["root_mm"].to_list() == pytest.approx(told, nan_ok=True)
        assert table["verdict"].to_list() == [one.verdict for one in inspected.inspection.sections]


@pytest.mark.skipif(shutil.which("h5dump") is None, reason="h5dump is not installed")
def test_h5dump_reads_a_recording() -> None:
    command = ["h5dump", "-H", str(RECORDING)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert 'DATASET "quaternion_wxyz"' in said


def test_a_second_reader_of_e57_reads_every_point(inspected, tmp_path: Path) -> None:
    """The crate e57, in Rust; pye57 rests on libE57, which wrote the file."""
    e57 = pytest.importorskip("e57", reason="e57 is not installed")
    file = tmp_path / "cloud.e57"
    file.write_bytes(export_cloud(inspected.cloud, inspected.edge, format="e57").content)
    found = np.asarray(e57.read_points(str(file)).points)
    told = read_cloud(file=file).points_mm
    assert len(found) == inspected.cloud.keep.sum()
    np.testing.assert_allclose(np.sort(1000.0 * found, axis=0), np.sort(told, axis=0), atol=1e-4)


@pytest.mark.parametrize("ending", ["pcd", *seldom("ply")])
@pytest.mark.skipif(shutil.which("pcl_pcd2ply") is None, reason="PCL's tools are not installed")
def test_pcl_reads_every_point(inspected, tmp_path: Path, ending: str) -> None:
    file, other = tmp_path / f"cloud.{ending}", tmp_path / ("read.ply" if ending == "pcd" else "read.pcd")
    file.write_bytes(export_cloud(inspected.cloud, inspected.edge, format=ending).content)
    subprocess.run([f"pcl_{ending}2{other.suffix[1:]}", file, other], capture_output=True, check=True)
    there = read_cloud(file=other).points_mm  # float32: PCL's points
    np.testing.assert_allclose(there, read_cloud(file=file).points_mm, atol=1e-3)
