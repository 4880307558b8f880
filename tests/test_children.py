"""Readers in processes of their own: what ends them is told apart."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

TETRAHEDRON = "v 0 0 0\nv 100 0 0\nv 0 100 0\nv 0 0 100\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


MISSING = (
    "OSError('libusb-1.0.so.0: cannot open shared object file: No such file or directory')",
    "the shared library libusb-1.0.so.0 is missing",
)
OTHER = "ImportError('built for another Python')", "built for another Python"


@pytest.mark.parametrize(
    ("name", "fails", "says"), [("part.obj", *MISSING), ("part.pcd", *OTHER), ("part.ply", *MISSING)]
)
def test_a_library_that_cannot_be_loaded_is_blamed_and_not_the_file(name, fails, says, tmp_path, command, monkeypatch):
    (tmp_path / "open3d.py").write_text(f"raise {fails}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    file = tmp_path / name
    file.write_text(TETRAHEDRON)
    got = command("look", file)
    assert got.status == 2
    assert got.err == f"error: open3d: cannot be loaded: {says}; scripts/setup.sh installs it\n"


def test_a_mesh_reader_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from workbench.compare import mesh
    from workbench.errors import InputError

    (tmp_path / "open3d.py").write_text("raise OSError('libGL.so.1: cannot open shared object file: No such file')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    file = tmp_path / "part.obj"
    file.write_text(TETRAHEDRON)
    with pytest.raises(InputError, match=r"^open3d: cannot be loaded: the shared library libGL\.so\.1 is missing; "):
        mesh(mesh=file)
