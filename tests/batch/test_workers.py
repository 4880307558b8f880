"""A dask cluster on loopback: the same results; a worker that is killed loses nothing and does nothing twice."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from bench.harness import ROOT
from workbench.batch import run_batch
from workbench.errors import InputError

Write = Callable[..., str]
pytest.importorskip("distributed", reason="needs the extra [cluster]")
pytestmark = pytest.mark.usefixtures("plain_page")


@pytest.fixture
def cluster(breaking: Path) -> Iterator[Any]:
    """Two workers, each a process with one thread."""
    from distributed import LocalCluster

    with LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address=None,
        host="127.0.0.1",
        silence_logs=50,
    ) as running:
        yield running


def test_parts_survive_the_death_of_a_worker(cluster: Any, pipeline: Path, record: Write, tmp_path: Path) -> None:
    sound = [f"part-{i}" for i in range(1, 9)]
    paths = [record(name, "slow") for name in sound]
    paths += [record("bad", "reject"), record("torn", "segfault")]
    out = tmp_path / "out"

    def kill_one() -> None:
        until = time.monotonic() + 300
        while len([*out.glob("*/run.json")]) < 2 and time.monotonic() < until:
            time.sleep(0.05)
        victim = next(iter(cluster.workers.values()))
        os.kill(victim.pid, signal.SIGKILL)

    killer = threading.Thread(target=kill_one, daemon=True)
    killer.start()
    made = run_batch(pipeline, paths, str(out), scheduler=cluster.scheduler_address)
    killer.join()
    outcomes = {one.part: one.outcome for one in made.records}
    assert outcomes == dict.fromkeys(sound, "passed") | {"bad": "rejected", "torn": "crashed"}
    limited = {"scheduler": cluster.scheduler_address, "time_limit_s": 2.0}  # alone: others might take as long
    (stuck,) = run_batch(pipeline, [record("stuck", "hang")], str(tmp_path / "limited"), **limited).records
    assert stuck.outcome == "hung"
    assert len(made.records) == len(paths)
    single = tmp_path / "single"
    run_batch(pipeline, [paths[0], paths[8]], str(single), workers=0)
    for name in (sound[0], "bad"):
        assert {path.name for path in (out / name).iterdir()} == {path.name for path in (single / name).iterdir()}
        for file in ("inspection.json", "report.html"):
            assert (out / name / file).read_bytes() == (single / name / file).read_bytes()
    assert not [*out.rglob(".*")]


@pytest.mark.slow
def test_a_batch_whose_scheduler_was_killed_is_told_in_one_line_and_carried_on() -> None:
    """A worker is killed, then the scheduler: the batch ends; the same command does what is left, each part once."""
    command = [sys.executable, "-m", "bench.kills.cluster", "--parts", "6"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "Traceback" not in done.stderr


def test_no_scheduler_is_one_line(pipeline: Path, record: Write, tmp_path: Path, monkeypatch: Any) -> None:
    """Nor does it make a folder, or take an earlier batch's page away."""
    monkeypatch.setattr("workbench.batch.workers.CONNECT_S", 0.5)
    run_batch(pipeline, [record("a")], str(tmp_path / "done"), workers=0)
    for name in ("out", "done"):
        with pytest.raises(InputError, match=r"tcp://127\.0\.0\.1:1: no scheduler answers there"):
            run_batch(pipeline, [record("a")], str(tmp_path / name), scheduler="tcp://127.0.0.1:1")
    assert not (tmp_path / "out").exists()
    assert (tmp_path / "done/fleet.html").exists()


def test_a_missing_extra_is_one_line(pipeline: Path, record: Write, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"install 'bevel-workbench\[cluster\]"):
        run_batch(pipeline, [record("a")], str(tmp_path / "out"), scheduler="tcp://127.0.0.1:1")
