"""Whatever is thrown at the command, it ends with 0, 1 or 2, says at most one `error:` line and never a traceback."""

import contextlib
import io
import json
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bench.fuzz.mutate import mutated
from bench.fuzz.recordings import malformed_recording, mutated_recording
from workbench.artefacts import Recording
from workbench.cli import main
from workbench.errors import WorkbenchError
from workbench.scan import fuse

PIPELINE = Path(__file__).parents[2] / "pipelines" / "inspect_bevel.json"
DOCUMENT = json.loads(PIPELINE.read_text())
DOCUMENT["stages"] = [entry for entry in DOCUMENT["stages"] if not entry["stage"].startswith("report.")]
WORDS = ("run", "validate", "stages", "--input", "--set", "--out", "a=1", "x.y=2", "-x", "=", "", "\x00", "ß", "--")


def check(*arguments: object) -> tuple[int, str]:
    """Run the command in this process and check how it ends; returns the exit status and the error line."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main([str(argument) for argument in arguments])
    lines = [line for line in err.getvalue().splitlines() if not line.startswith(("[", "compiling", "note:"))]
    assert status in (0, 1, 2)
    assert len(lines) == (1 if status == 2 else 0), lines
    assert all(line.startswith("error: ") and "internal" not in line for line in lines), lines
    return status, "".join(lines)


def test_mutated_pipelines(recording_file: Path, tmp_path: Path) -> None:
    rng, content, path = random.Random(1), PIPELINE.read_bytes(), tmp_path / "p.json"
    for _ in range(120):
        path.write_bytes(mutated(content, ".json", rng))
        check("validate", path, "--input", f"recording={recording_file}")


def test_mutated_arguments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rng = random.Random(2)
    for _ in range(60):
        check(*rng.choices(WORDS, k=rng.randint(0, 5)))


@pytest.mark.parametrize(("mutate", "count"), [(mutated, 8), (malformed_recording, 8), (mutated_recording, 6)])
def test_mutated_recordings(recording_file: Path, tmp_path: Path, mutate: Any, count: int) -> None:
    """A run each; `make fuzz` tries thousands."""
    rng, content = random.Random(3), recording_file.read_bytes()
    path, pipeline = tmp_path / "part.h5", tmp_path / "p.json"
    pipeline.write_text(json.dumps(DOCUMENT))
    for number in range(count):
        path.write_bytes(mutate(content, ".h5", rng))
        status, _ = check("run", pipeline, "--input", f"recording={path}", "--out", tmp_path / f"out{number}")
        assert (tmp_path / f"out{number}").exists() == (status != 2)


@pytest.mark.parametrize("columns", range(1, 9))
def test_few_columns(recording: Recording, columns: int) -> None:
    x_mm, z_mm = (grid[:, :: 400 // columns].copy() for grid in (recording.x_mm, recording.z_mm))
    with contextlib.suppress(WorkbenchError):
        fuse(replace(recording, x_mm=x_mm, z_mm=z_mm))


def test_check_can_fail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tests above rest on it."""
    monkeypatch.setattr("workbench.pipeline.run.plan", lambda *_: 1 / 0)
    with pytest.raises(AssertionError, match="internal"):
        check("validate", PIPELINE)
