"""The recipes of AGENTS.md, as they stand there."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.importing.test_draft import write
from workbench.scan import read

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "data" / "synthetic" / "milled_edge.h5"


@pytest.mark.slow
def test_every_recipe_runs(tmp_path: Path) -> None:
    shutil.copy(SAMPLE, tmp_path / "part.h5")
    write(tmp_path, read(recording=SAMPLE), "kuka_abc", ";", ",", 1.0)
    recipes = [line[4:] for line in (ROOT / "AGENTS.md").read_text().splitlines() if line.startswith("    ")]
    assert len(recipes) == 5
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    told = ""
    for recipe in recipes:
        done = subprocess.run(
            recipe, shell=True, cwd=tmp_path, env={**os.environ, "PATH": path}, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        told = done.stdout
    assert told.strip() == json.loads((tmp_path / "result" / "inspection.json").read_text())["verdict"] == "pass"
