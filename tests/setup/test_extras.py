"""The base alone: what comes with an extra is not loaded, and told in one line where it is needed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from workbench.extras import EXTRA_OF

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = {  # by the package that each misses, and the extra that brings it
    "cell": ("pinocchio", "robot", "view-cell data/robot/cell.json --out {folder}/cell.html"),
    "plan": ("pinocchio", "robot", "run pipelines/plan_bevel.json --input cell=data/robot/cell.json --out {folder}/p"),
    "batch": ("pyarrow", "formats", "batch pipelines/inspect_bevel.json data/synthetic/milled_arc.h5 --out {folder}"),
    "view": ("starlette", "page", "view {folder} --no-browser"),
    "open": ("starlette", "page", "open {folder} --no-browser"),
}
BASE = f"""
import contextlib, io, json, sys
for name in {[*EXTRA_OF, "vtk", "vtkmodules", "hppfcl", "coal", "yaml"]}: sys.modules[name] = None
import workbench
for name in workbench.__all__:
    if name != "view": getattr(workbench, name)
from workbench.cli import main
for command in json.loads(sys.argv[1]):
    with contextlib.redirect_stderr(io.StringIO()) as said, contextlib.redirect_stdout(io.StringIO()):
        status = main(command.split())
    print(json.dumps([status, said.getvalue()]))
"""


def base(*commands: str) -> list[tuple[int, str]]:
    """Status and errors of commands in a Python that has no extra, but every family and public name."""
    called = [sys.executable, "-c", BASE, json.dumps(commands)]
    done = subprocess.run(called, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return [tuple(json.loads(line)) for line in done.stdout.splitlines()]


def test_a_bevel_is_inspected(tmp_path: Path) -> None:
    ((status, errors),) = base(f"run pipelines/inspect_bevel.json --out {tmp_path}/out")
    assert (status, errors.count("error:")) == (0, 0)
    assert json.loads((tmp_path / "out/inspection.json").read_text())["sections"]
    assert (tmp_path / "out/report.html").is_file()


@pytest.fixture(scope="module")
def missed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, tuple[int, str]]]:
    """A folder, and how each command ends that is to make something there."""
    folder = tmp_path_factory.mktemp("missed")
    told = base(*(command.format(folder=folder) for _, _, command in COMMANDS.values()))
    return folder, dict(zip(COMMANDS, told, strict=True))


@pytest.mark.parametrize("name", COMMANDS)
def test_a_missing_extra_is_told_in_one_line(name, missed):
    package, extra, _ = COMMANDS[name]
    folder, ended = missed
    status, errors = ended[name]
    *_, last = errors.splitlines()
    assert status == 2
    assert last.startswith("error: ")
    assert last.endswith(f"{package}: is not installed: pip install 'bevel-workbench[{extra}]'")
    assert list(folder.iterdir()) == []
