"""A batch on this machine: every part gets its due, whatever one of them does; and what is done is not done again."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from workbench import Pipeline
from workbench.batch import run_batch
from workbench.errors import InputError, OutputError, PipelineError

Write = Callable[..., str]


def without_times(path: Path) -> Any:
    run = json.loads(path.read_text())
    return {**run, "stages": [one["name"] for one in run["stages"]]}


def test_no_part_stops_another_and_each_cause_is_told(pipeline: Path, record: Write, tmp_path: Path) -> None:
    made = {
        "good": ("pass", "passed", ""),
        "bad": ("reject", "rejected", "reject"),
        "odd": ("unusable", "failed", "expected something else"),
        "bug": ("defect", "failed", "ZeroDivisionError: a stage's own mistake"),
        "gone": ("exit", "crashed", "ended with status 7, 2 times"),
        "shot": ("kill", "crashed", "killed by SIGKILL, 2 times"),
        "torn": ("segfault", "crashed", "killed by SIGSEGV, 2 times"),
        "unlucky": ("kill once", "passed", ""),
        "last": ("pass", "passed", ""),
    }
    recordings = [record(name, what) for name, (what, _, _) in made.items()] + [str(tmp_path / "absent.h5")]
    batch = run_batch(pipeline, recordings, str(tmp_path / "out"), workers=2)
    assert [one.part for one in batch.records] == [*made, "absent"]  # in the order given
    for one, (_, outcome, cause) in zip(batch.records, made.values(), strict=False):
        assert (one.outcome, one.cause if not cause else cause in one.cause) == (outcome, cause and True)
        kept = json.loads((tmp_path / "out" / one.part / "part.json").read_text())
        assert (kept["outcome"], kept["cause"]) == (one.outcome, one.cause)
        assert (tmp_path / "out" / one.part / "run.json").exists() == (outcome in ("passed", "rejected"))
    assert "No such file" in batch.records[-1].cause
    assert batch.exit_status == 2
    assert not [path for path in (tmp_path / "out").rglob(".*")]  # nothing half-made lies about


def test_results_are_those_of_a_run(pipeline: Path, record: Write, tmp_path: Path) -> None:
    paths = [record("a", "pass"), record("b", "reject", "1.2 - 1.7")]
    for workers in (0, 2):
        out = tmp_path / f"out{workers}"
        assert run_batch(pipeline, paths, str(out), workers=workers, inputs={"shift_mm": 0.125}).exit_status == 1
        for path in paths:
            single = tmp_path / f"single{workers}" / Path(path).stem
            Pipeline.load(pipeline).run(single, inputs={"recording": path, "shift_mm": 0.125})
            part = out / Path(path).stem
            assert {p.name for p in part.iterdir()} - {p.name for p in single.iterdir()} == {"part.json"}
            for name in ("inspection.json", "report.html"):
                assert (part / name).read_bytes() == (single / name).read_bytes()
            assert without_times(part / "run.json") == without_times(single / "run.json")
    fleets = [(tmp_path / f"out{workers}" / "fleet.html").read_bytes() for workers in (0, 2)]
    assert fleets[0] == fleets[1]


@pytest.mark.usefixtures("plain_page")
def test_what_is_whole_is_not_made_again(pipeline: Path, breaking: Path, record: Write, tmp_path: Path) -> None:
    paths = [record(name) for name in ("a", "b", "c", "d")]
    out = tmp_path / "out"

    def again(**changed: Any) -> str:
        batch = run_batch(pipeline, paths, str(out), workers=0, **changed)
        assert batch.exit_status == 0
        return "".join(one.part for one in batch.records if not one.skipped)

    assert again() == "abcd"
    before = {path: path.stat().st_mtime_ns for path in out.glob("*/*")}
    assert again() == ""
    assert {path: path.stat().st_mtime_ns for path in out.glob("*/*")} == before
    (out / "a" / "report.html").write_bytes(b"<p>")  # cut off
    (out / "b" / "inspection.json").unlink()
    Path(paths[2]).write_text("pass\n1.5 1.5\n")  # another content
    (out / "d" / "part.json").write_text("{")
    assert again() == "abcd"
    assert again() == ""
    assert again(inputs={"shift_mm": 0.1}) == "abcd"
    assert again() == "abcd"
    from workbench.user_folder import package_digest

    breaking.write_text(breaking.read_text() + "\n# another version\n")
    package_digest.cache_clear()
    assert again() == "abcd"


@pytest.mark.usefixtures("plain_page")
def test_a_part_that_fails_now_leaves_no_earlier_result_in_place(pipeline: Path, record: Write, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for what, names in (
        ("pass", {"part.json", "inspection.json", "report.html", "run.json"}),
        ("unusable", {"part.json", "superseded"}),
        ("exit", {"part.json", "superseded"}),
    ):
        run_batch(pipeline, [record("a", what)], str(out), workers=int(what == "exit"))
        assert {path.name for path in (out / "a").iterdir()} == names


def test_what_all_parts_share_is_refused_at_once(pipeline: Path, record: Write, tmp_path: Path) -> None:
    out, one = tmp_path / "out", record("a")
    with pytest.raises(PipelineError, match=r"stages\[0\]\.shift_mm: expected a valid number"):
        run_batch(pipeline, [one], str(out), inputs={"shift_mm": "x"})
    with pytest.raises(PipelineError, match="differs from part to part"):
        run_batch(pipeline, [one], str(out), inputs={"recording": one})
    with pytest.raises(InputError, match="is given twice"):
        run_batch(pipeline, [one, one], str(out))
    assert not out.exists()
    document = json.loads(pipeline.read_text())
    document["inputs"] = {"recordings": "x", "shift_mm": 0}
    document["stages"][0]["recording"] = "${recordings}"
    pipeline.write_text(json.dumps(document))
    with pytest.raises(PipelineError, match="needs an input 'recording'; did you mean 'recordings'"):
        run_batch(pipeline, [one], str(out))


@pytest.mark.parametrize("name", ["fleet.html", "fleet.parquet"])
def test_a_file_in_the_fleet_s_place_that_no_batch_has_written_stays(pipeline, record: Write, tmp_path, name: str):
    one, out = record("a"), tmp_path / "out"
    for _ in range(2):  # its own is replaced
        run_batch(pipeline, [one], str(out), workers=0)
    (out / name).write_text("<title>Our fleet</title>")
    with pytest.raises(OutputError, match=rf"{name}: no batch has written it, and this one would; move it"):
        run_batch(pipeline, [one], str(out), workers=0)
    assert (out / name).read_text() == "<title>Our fleet</title>"
    assert (out / "a" / "run.json").exists()


def test_two_batches_do_not_share_a_folder(pipeline: Path, record: Write, tmp_path: Path) -> None:
    from workbench.pipeline.output import locked

    (tmp_path / "out").mkdir()
    with locked(tmp_path / "out"), pytest.raises(OutputError, match="another batch is writing there"):
        run_batch(pipeline, [record("a")], str(tmp_path / "out"), workers=0)


@pytest.mark.usefixtures("plain_page")
def test_interrupted_it_keeps_what_is_done_and_carries_on(pipeline: Path, record: Write, tmp_path: Path) -> None:
    paths = [record(f"part-{i}", "held" if i > 2 else "pass") for i in range(1, 5)]
    out = tmp_path / "out"
    command = [sys.executable, "-m", "workbench", "batch", str(pipeline), *paths, "--out", str(out), "--workers", "1"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not (out / "part-2" / "run.json").exists():
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=300)
    assert process.returncode == 130
    assert told.splitlines()[-1] == "interrupted"
    assert not (out / "fleet.html").exists()
    done = {path.parent.name for path in out.glob("*/run.json")}
    assert done == {"part-1", "part-2"}
    Path(paths[0]).with_name("go").touch()
    batch = run_batch(pipeline, paths, str(out), workers=2)
    assert {one.part for one in batch.records if one.skipped} == done
    assert batch.exit_status == 0


def test_workers_end_with_a_batch_that_is_killed(pipeline: Path, record: Write, tmp_path: Path) -> None:
    seen = tmp_path / "pid.h5"
    seen.write_text("slow\n1.5\n")
    stuck, out = record("stuck", "hang"), tmp_path / "out"
    command = [sys.executable, "-m", "workbench", "batch", str(pipeline), str(seen), stuck, "--out", str(out)]
    process = subprocess.Popen([*command, "--workers", "1"], stderr=subprocess.DEVNULL)
    while not (out / "pid" / "run.json").exists():
        time.sleep(0.02)
    time.sleep(0.1)
    (child,) = children(process.pid)
    process.kill()
    process.wait()
    for _ in range(5000):
        if not alive(child):
            return
        time.sleep(0.02)
    os.kill(child, signal.SIGKILL)
    pytest.fail("the worker went on without its batch")


def children(pid: int) -> list[int]:
    return [int(text) for text in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
