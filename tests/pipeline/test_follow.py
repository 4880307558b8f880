"""A recording that grows: measured on the way, and in the end as if it had always been there."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "bench/fuzz/corpus/inspecting/small.h5"
PIPELINE = ROOT / "pipelines/inspect_bevel.json"
WRITER = """
import os, sys, time, h5py
source, target, swmr = sys.argv[1:4]
last, pause_s, alive = int(sys.argv[4]), float(sys.argv[5]), sys.argv[6]
with h5py.File(source) as old, h5py.File(target, "w", libver="latest") as new:
    new.attrs.update(old.attrs)
    old.copy("hand_eye", new)
    made = {}
    for group in ("robot", "profiles"):
        new.create_group(group).attrs.update(old[group].attrs)
        for name, values in old[group].items():
            shape = (0, *values.shape[1:])
            made[group, name] = new.create_dataset(f"{group}/{name}", shape, values.dtype, maxshape=(None, *shape[1:]))
    if swmr:
        new.swmr_mode = True
    frames = len(old["profiles/time"])
    for (group, name), values in made.items():
        if group == "robot":
            values.resize(len(old[group][name]), 0)
            values[:] = old[group][name][()]
            values.flush()
    for first in range(0, frames, 12):
        for (group, name), values in made.items():
            if group == "profiles":
                values.resize(min(first + 12, frames), 0)
                values[first : first + 12] = old[group][name][first : first + 12]
                values.flush()
        print(first, flush=True)
        while first + 12 >= last and not os.path.exists(target + ".go"):
            time.sleep(0.02)
            if alive:
                os.utime(target)
        time.sleep(pause_s)
"""


@contextmanager
def writing(
    target: Path, swmr: bool = True, last: int = 10**6, pause_s: float = 0.05, alive: bool = False
) -> Iterator[Any]:
    """A process that writes a recording; at frame `last` it waits for a file, `alive` without a stall however long."""
    given = [SOURCE, target, "swmr" if swmr else "", last, pause_s, "alive" if alive else ""]
    command = [sys.executable, "-c", WRITER, *given]
    with subprocess.Popen([str(each) for each in command], stdout=subprocess.PIPE, text=True) as process:
        process.stdout.readline()  # a frame is there
        try:
            yield process
        finally:
            process.kill()


def test_the_results_are_those_of_the_complete_file(command: Callable[..., Any], tmp_path: Path) -> None:
    grown, drawing = tmp_path / "grown.h5", tmp_path / "so_far.svg"

    def let_go() -> None:
        """Once it was measured on the way."""
        while "frames so far: " not in sys.stderr.getvalue():  # type: ignore[attr-defined] # pytest's
            time.sleep(0.02)
        grown.with_suffix(".h5.go").touch()

    with writing(grown, last=48):
        threading.Thread(target=let_go, daemon=True).start()
        done = command(
            "run",
            PIPELINE,
            "--follow",
            grown,
            "--no-report",
            "--out",
            tmp_path / "a",
            "--stall-s",
            "300",
            "--drawing",
            drawing,
        )
    assert done.status == 0, done.err
    assert "<svg" in drawing.read_text()
    assert "frames so far: pass" in done.err
    expanded = [float(told) for told in re.findall(r" ± ([\d.]+) (?:mm|°)", done.err)]
    assert expanded
    assert max(expanded) < 1.0
    again = command("run", PIPELINE, "--input", f"recording={grown}", "--no-report", "--out", tmp_path / "b")
    assert again.status == 0
    for name in ("inspection.json", "inspection.qif"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    inputs = [json.loads((tmp_path / each / "run.json").read_text())["inputs"] for each in "ab"]
    assert inputs[0] == inputs[1]


def test_a_complete_recording_is_run_at_once(command: Callable[..., Any], tmp_path: Path) -> None:
    done = command("run", PIPELINE, "--follow", SOURCE, "--no-report", "--out", tmp_path / "a")
    assert done.status == 0
    assert "so far" not in done.err


@pytest.mark.parametrize("kill", [True, False])
def test_a_writer_that_stalls_or_was_killed(command: Callable[..., Any], tmp_path: Path, kill: bool) -> None:
    grown = tmp_path / "grown.h5"
    with writing(grown, last=24) as process:
        process.stdout.readline()
        if kill:
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
        done = command("run", PIPELINE, "--follow", grown, "--stall-s", "1", "--out", tmp_path / "a")
    assert done.status == 2
    errors = [line for line in done.err.splitlines() if line.startswith("error:")]
    assert errors == [
        f"error: {grown}: has not grown for 1 s (--stall-s) and was not closed: its writer stalls or was killed; "
        "after `h5clear -s` it can be run as it is, without --follow"
    ]
    assert not (tmp_path / "a").exists()


def test_without_swmr_its_end_is_waited_for(command: Callable[..., Any], tmp_path: Path) -> None:
    grown = tmp_path / "grown.h5"
    with writing(grown, swmr=False):
        done = command("run", PIPELINE, "--follow", grown, "--no-report", "--out", tmp_path / "a", "--stall-s", "300")
    assert done.status == 0
    assert "so far" not in done.err
    with writing(tmp_path / "killed.h5", swmr=False) as process:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        done = command("run", PIPELINE, "--follow", tmp_path / "killed.h5", "--out", tmp_path / "b")
    assert done.status == 2
    assert "its writer was killed" in done.err or "expected a complete HDF5 file" in done.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--follow", "none.h5", "--stall-s", "0.1"], "error: none.h5: no such file for 0.1 s (--stall-s)"),
        (["--follow", "a.h5", "--input", "recording=b.h5"], "error: --follow: names the recording; leave out"),
        (["--stall-s", "-1", "--follow", "a.h5"], "expected a time in s above 0, got '-1'"),
    ],
)
def test_what_cannot_be_followed(command: Callable[..., Any], arguments: list[str], message: str) -> None:
    done = command("run", PIPELINE, *arguments, "--out", "out")
    assert done.status == 2
    assert message in done.err
