"""Two runs of a shipped pipeline, on one thread and on two, give the same bytes; pages, pictures and times excepted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from .conftest import ROOT

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
PIPELINES = [
    pytest.param(path, marks=() if path.stem == "inspect_bevel" else pytest.mark.slow, id=path.stem)
    for path in sorted((ROOT / "pipelines").glob("*.json"))
]


def results(pipeline: Path, out: Path, threads: int) -> dict[str, bytes]:
    """Every result file; of run.json what does not tell the time; pages are not made."""
    environment = {**os.environ, **dict.fromkeys(THREADS, str(threads))}
    command = [sys.executable, "-m", "workbench", "run", str(pipeline), "--no-report", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=600)
    assert done.returncode in (0, 1), done.stderr
    files = {path.name: path.read_bytes() for path in out.iterdir() if path.suffix != ".png"}
    run = json.loads(files["run.json"])
    for stage in run["stages"]:
        del stage["seconds"]
    files["run.json"] = json.dumps(run).encode()
    return files


@pytest.mark.parametrize("pipeline", PIPELINES)
def test_the_same_bytes(pipeline: Path, tmp_path: Path) -> None:
    one, two = (results(pipeline, tmp_path / str(threads), threads) for threads in (1, 2))
    assert one.keys() == two.keys()
    assert [name for name in one if one[name] != two[name]] == []
