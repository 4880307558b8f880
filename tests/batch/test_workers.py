"""A dask cluster on loopback: the same results; a worker that is killed loses nothing and does nothing twice."""

import contextlib
import json
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
        wait_for(lambda: len([*out.glob("*/run.json")]) >= 2)
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


@contextlib.contextmanager
def scheduler(folder: Path) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """A scheduler's address and process, with a worker."""
    told = folder / "scheduler.json"
    told.unlink(missing_ok=True)
    where = ["--scheduler-file", str(told), "--no-dashboard"]
    alone = ["--nthreads", "1", "--no-nanny", "--local-directory", str(folder)]
    parts = {"scheduler": ["--host", "127.0.0.1", "--port", "0"], "worker": alone}
    commands = ([sys.executable, "-m", f"distributed.cli.dask_{what}", *where, *more] for what, more in parts.items())
    made = [subprocess.Popen(one, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) for one in commands]
    try:
        wait_for(told.exists)
        yield json.loads(told.read_text())["address"], made[0]
    finally:
        for one in made:
            one.kill()
            one.wait()


def wait_for(done: Callable[[], bool]) -> None:
    until = time.monotonic() + 300
    while not done() and time.monotonic() < until:
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.usefixtures("breaking")
def test_a_batch_whose_scheduler_was_killed_is_told_in_one_line_and_carried_on(
    pipeline: Path, record: Write, tmp_path: Path
) -> None:
    """The same command does what is left, each part once."""
    paths, out = [record(f"part-{i}", "slow") for i in range(8)], tmp_path / "out"

    def kill() -> None:
        wait_for(lambda: len([*out.glob("*/run.json")]) >= 2)
        process.kill()

    with scheduler(tmp_path) as (address, process):
        killer = threading.Thread(target=kill, daemon=True)
        killer.start()
        with pytest.raises(InputError, match="the scheduler is gone; the same command carries on"):
            run_batch(pipeline, paths, str(out), scheduler=address)
        killer.join()
    done = {path: path.stat().st_mtime_ns for path in out.glob("*/run.json")}
    assert 2 <= len(done) < len(paths)
    with scheduler(tmp_path) as (address, _):
        made = run_batch(pipeline, paths, str(out), scheduler=address)
    assert [one.outcome for one in made.records] == ["passed"] * len(paths)
    assert all(path.stat().st_mtime_ns == at for path, at in done.items())
    assert not [*out.rglob(".*")]


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
