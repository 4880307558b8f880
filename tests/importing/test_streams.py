"""Large tables are read in stretches: the same grid whatever their size, and little more memory than the result."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.importing import text as texts
from workbench.importing.mapping import Mapping
from workbench.importing.tables import read
from workbench.importing.text import stretches

COLUMNS = {"frame": "n", "time": "t", "x": "x", "z": "z", "intensity": "i"}
PART = {"length_unit": "mm", "time_unit": "s", "frames": "column", "columns": COLUMNS}
MAPPING = Mapping.model_validate_json(json.dumps({"format": "import-mapping", "version": 1, "profiles": PART}))


def ragged(path: Path, frames: int = 30) -> Path:
    rng = np.random.default_rng(5)
    rows = ["n,t,x,z,i"]
    for frame in range(frames):
        for column in np.flatnonzero(rng.random(40) < 0.9):
            rows.append(f"{frame},{frame * 0.5},{column * 0.25 - 5:.2f},{80 + rng.normal():.4f},{column + 1}")
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("slab_bytes", [1, 100, 1009])
def test_stretches_change_nothing(slab_bytes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = ragged(tmp_path / "a.csv")
    whole = read(path, MAPPING).profiles
    monkeypatch.setattr(texts, "SLAB_BYTES", slab_bytes)
    monkeypatch.setattr(texts, "HEAD_BYTES", 64)
    pieces = read(path, MAPPING).profiles
    assert whole is not None
    assert pieces is not None
    for name in ("x_mm", "z_mm", "time_s", "intensity"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(pieces, name))
    column = np.round((whole.x_mm + 5) / 0.25)
    assert (np.diff(np.nanmin(column - np.arange(column.shape[1]), axis=1)) == 0).all()  # a column stays a column
    seen = whole.intensity > 0
    assert (np.isfinite(whole.z_mm) == seen).all()


@pytest.mark.parametrize("slab_bytes", [1, 50])
def test_a_time_that_changes_within_a_frame_names_its_line(
    slab_bytes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("n,t,x,z,i\n" + "1,0.5,1,1,1\n" * 20 + "1,0.6,1,1,1\n")
    monkeypatch.setattr(texts, "SLAB_BYTES", slab_bytes)
    monkeypatch.setattr(texts, "HEAD_BYTES", 64)
    with pytest.raises(InputError, match=r"line 22: column 't': expected one value per frame, found 0.6"):
        read(path, MAPPING)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends(end: str, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(end.join(["a", "", "b", "cc", "", ""]).encode())
    for size in (1, 2, 3, 100):
        text = "".join(stretches(tmp_path / "a.txt", size, 1))
        assert text.rstrip("\n") == "a\n\nb\ncc"
