"""Where results go wrong: a disk that fills up, two runs at once, a clock that jumps."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from .conftest import ROOT, SHIPPED


def tree(directory: Path) -> dict[str, bytes]:
    return {str(p.relative_to(directory)): p.read_bytes() for p in sorted(directory.rglob("*")) if p.is_file()}


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 400 kB: less than a report needs."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", str(place)]
    try:
        mounted = subprocess.run(mount, capture_output=True, check=False).returncode == 0
    except OSError:
        mounted = False
    if not mounted:
        pytest.skip("no file system may be mounted here; tests/fuzz/test_faults.py lets one be full")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def refused(done: subprocess.CompletedProcess[str], place: Path) -> None:
    lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert done.returncode == 2
    assert len(lines) == 1
    assert str(place) in lines[0]
    assert "Traceback" not in done.stderr


def whole(out: Path, easy: Path) -> subprocess.CompletedProcess[str]:
    """The shipped inspection, its page included, in a process of its own."""
    command = [sys.executable, "-m", "workbench", "run", SHIPPED, "--input", f"recording={easy}", "--out", out]
    return subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, timeout=600)


def test_a_disk_that_fills_up(small_disk: Path, easy: Path) -> None:
    (small_disk / "notes.txt").write_text("mine")
    refused(whole(small_disk / "out", easy), small_disk)
    assert tree(small_disk) == {"notes.txt": b"mine"}


def test_two_runs_at_once_do_not_mix(tmp_path: Path, easy: Path, quick: Path) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-m", "workbench", "run", quick, "--input", f"recording={easy}", "--out", out]
    runs = [subprocess.Popen([*map(str, command)], stderr=subprocess.PIPE, text=True) for _ in range(2)]
    ended = [(run.communicate(timeout=600)[1], run.returncode) for run in runs]
    assert {status for _, status in ended} <= {0, 2}
    assert 0 in {status for _, status in ended}
    assert all("another run is writing there" in err for err, status in ended if status == 2)
    assert {path.name for path in out.iterdir()} == {"inspection.json", "inspection.qif", "run.json"}
    assert os.listdir(tmp_path) == ["out"]


def test_no_result_depends_on_the_clock_of_the_day() -> None:
    """It may jump; durations are taken from clocks that do not. The age of a kept file costs time only.

    The page's history says when a run was asked for (`page/store.py`); what was measured does not rest on it.
    """
    wall = re.compile(r"\btime\.time\((?!\) - days)|\bdatetime\b.*\bnow\(|\butcnow\(|\btime\.localtime\(")
    used = [path for path in (ROOT / "workbench").rglob("*.py") if wall.search(path.read_text())]
    assert used == [ROOT / "workbench/page/store.py"]


READ_ONLY = """
set -e
mount --make-rprivate /
mount -t tmpfs none /mnt
mkdir "/mnt/größe 7"
mount -o remount,ro,bind /
for place in /tmp /var/tmp /dev/shm; do mount -t tmpfs -o ro none $place 2>/dev/null || true; done
cd "/mnt/größe 7"
env -i PATH="$PATH" HOME=/nonexistent PYTHONPATH="$ROOT" "$PYTHON" -m workbench run \
    "$ROOT/pipelines/plan_loads.json" --no-report --out "ä b"
ls -A . "ä b"
"""


def test_nothing_but_the_place_of_the_results_may_be_written() -> None:
    """A service on a read-only root, without home, temporary folder and shared memory; a path with blanks, umlauts.

    The pipeline with the fewest kernels: they are compiled here, and kept nowhere.
    """
    command = ["unshare", "-m", "sh", "-c", READ_ONLY]
    known = {**os.environ, "ROOT": str(ROOT), "PYTHON": sys.executable}
    try:
        tried = (
            READ_ONLY.split("cd ")[0] + '"$PYTHON" "$ROOT/scripts/ratchet.py"'
        )  # it is not there where this folder lies below /tmp
        probe = subprocess.run(["unshare", "-m", "sh", "-c", tried], capture_output=True, env=known)
    except OSError:
        pytest.skip("no unshare here")
    if probe.returncode:
        pytest.skip("mounts may not be changed here")
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=known, timeout=600)
    assert done.returncode == 0, done.stderr
    notes = [line for line in done.stderr.splitlines() if "cannot be used" in line]
    assert len(notes) == 1
    assert notes[0].startswith("compiling kernels for this machine: not kept: /nonexistent/.cache/workbench/kept")
    left = done.stdout[done.stdout.index("\n.:\n") :].split()
    assert {"load_plan.csv", "run.json"} <= set(left)
    assert not [name for name in left if name.startswith("workbench")]
