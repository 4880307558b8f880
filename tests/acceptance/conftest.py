"""The command and the Python API, driven from outside on recordings of our own."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import pytest

ROOT = Path(__file__).parents[2]
SHIPPED = ROOT / "pipelines" / "inspect_bevel.json"
RECORDING = ROOT / "data" / "synthetic" / "milled_edge.h5"


@dataclass
class Ended:
    """How a command ended, and what stood in its output directory."""

    status: int
    out: str
    err: str
    directory: Path

    def read(self, name: str = "inspection.json") -> dict[str, Any]:
        """A result, as strict JSON."""

        def refuse(constant: str) -> None:
            raise AssertionError(f"{name} holds {constant}")

        return json.loads((self.directory / name).read_text(), parse_constant=refuse)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("acceptance")


@pytest.fixture(scope="session")
def quick(folder: Path) -> Path:
    """The shipped inspection without its page, which takes longer than all the rest."""
    document = json.loads(SHIPPED.read_text())
    document["stages"] = [entry for entry in document["stages"] if not entry["stage"].startswith("report.")]
    path = folder / "quick.json"
    path.write_text(json.dumps(document))
    return path


@pytest.fixture(scope="session")
def easy(folder: Path) -> Path:
    """A sound recording whose part has a name that no file and no page may trust."""
    path = Path(shutil.copy(RECORDING, folder / "easy.h5"))
    with h5py.File(path, "r+") as file:
        file.attrs["part_id"] = '../../<script>alert("7")</script>&\n/etc'
    return path


@pytest.fixture(scope="session")
def installed(folder: Path) -> Callable[..., Ended]:
    """`installed(name, "run", ...)`: the command as a user has it, in a process of its own."""

    def call(name: str, *arguments: object) -> Ended:
        program = Path(sys.executable).parent / "workbench"
        directory = folder / name
        out = ["--out", str(directory)] if "run" in arguments else []
        done = subprocess.run(
            [str(program), *map(str, arguments), *out], capture_output=True, text=True, cwd=folder, timeout=600
        )
        return Ended(done.returncode, done.stdout, done.stderr, directory)

    return call


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], quick: Path, tmp_path: Path) -> Callable[..., Ended]:
    """`run(recording, "--input", ...)`: the inspection in this process, which saves the start."""
    from workbench.cli import main

    def call(recording: Path, *arguments: object, out: str = "out") -> Ended:
        capsys.readouterr()
        given = ["run", quick, "--input", f"recording={recording}", *arguments, "--out", tmp_path / out]
        status = main([str(one) for one in given])
        return Ended(status, *capsys.readouterr(), tmp_path / out)

    return call


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Callable[..., Ended]:
    """`command("validate", path)`: any command in this process."""
    from workbench.cli import main

    def call(*arguments: object) -> Ended:
        capsys.readouterr()
        out = ["--out", tmp_path / "out"] if "run" in arguments else []
        status = main([str(one) for one in [*arguments, *out]])
        return Ended(status, *capsys.readouterr(), tmp_path / "out")

    return call
