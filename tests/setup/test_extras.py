"""The base alone: what comes with an extra is not loaded, and told in one line where it is needed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from workbench.extras import EXTRA_OF

ROOT = Path(__file__).resolve().parents[2]
WITHOUT = (
    f"import sys\nfor name in {[*EXTRA_OF, 'vtk', 'vtkmodules', 'hppfcl', 'coal', 'yaml']}: sys.modules[name] = None\n"
)
COMMAND = WITHOUT + "from workbench.cli import main\nsys.exit(main(sys.argv[1:]))"


def base(*arguments: object) -> subprocess.CompletedProcess[str]:
    """The command in a Python that has no extra."""
    command = [sys.executable, "-c", COMMAND, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def test_every_family_and_public_name_is_there() -> None:
    code = WITHOUT + "import workbench\nfor name in workbench.__all__:\n    if name != 'view': getattr(workbench, name)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_bevel_is_inspected(tmp_path: Path) -> None:
    done = base("run", "pipelines/inspect_bevel.json", "--out", tmp_path / "out")
    assert done.stderr.count("error:") == 0
    assert json.loads((tmp_path / "out/inspection.json").read_text())["sections"]
    assert (tmp_path / "out/report.html").is_file()


@pytest.mark.parametrize(
    ("package", "extra", "arguments"),
    [
        ("pinocchio", "robot", ("view-cell", "data/robot/cell.json", "--out", "{out}.html")),
        (
            "pinocchio",
            "robot",
            ("run", "pipelines/plan_bevel.json", "--input", "cell=data/robot/cell.json", "--out", "{out}"),
        ),
        (
            "pyarrow",
            "formats",
            ("batch", "pipelines/inspect_bevel.json", "data/synthetic/milled_edge.h5", "--out", "{out}"),
        ),
        ("starlette", "page", ("view", "{folder}", "--no-browser")),
        ("starlette", "page", ("open", "{folder}", "--no-browser")),
    ],
)
def test_a_missing_extra_is_told_in_one_line(package, extra, arguments, tmp_path):
    out = tmp_path / "made"
    done = base(*(one.format(out=out, folder=tmp_path) for one in arguments))
    assert done.returncode == 2
    *_, last = done.stderr.splitlines()
    assert last.startswith("error: ")
    assert last.endswith(f"{package}: is not installed: pip install 'bevel-workbench[{extra}]'")
    assert list(tmp_path.iterdir()) == []
