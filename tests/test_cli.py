"""The command line: exit status, one error line, results on standard output, progress on standard error."""

import json
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

Doc = dict[str, Any]


@pytest.fixture
def pipeline(demo_document: Doc, tmp_path: Path) -> Path:
    path = tmp_path / "p.json"
    path.write_text(json.dumps(demo_document))
    return path


def test_run_prints_the_inspection_and_writes_the_results(command: Any, pipeline: Path, tmp_path: Path) -> None:
    got = command("run", pipeline, "--out", tmp_path / "out")
    assert got.status == 0
    rows = [line for line in got.out.splitlines() if "undecided" in line or "pass" in line]
    assert re.search(r"1\D+2\.50\D+1\.500 ± 0\.008\D+40\.100 ± 0\.040.*pass", rows[0])
    assert re.search(r"2\D+7\.50.*not measured.*not measured.*undecided", rows[1])
    assert "part: undecided (section 2 is hidden)" in got.out
    assert f"report: {tmp_path / 'out' / 'report.html'}" in got.out
    assert [line.split()[0] for line in got.err.splitlines()] == [f"[{i}/5]" for i in range(1, 6)]


def test_gate_decides_the_exit_status(command: Any, pipeline: Path, tmp_path: Path) -> None:
    got = command("run", pipeline, "--out", tmp_path / "out", "--input", "fail=true")
    assert got.status == 1
    assert "gate: rejected" in got.out
    assert json.loads((tmp_path / "out" / "inspection.json").read_text())["verdict"] == "fail"
    assert "error" not in got.err


def test_values_are_json_or_text(command: Any, pipeline: Path, tmp_path: Path) -> None:
    (tmp_path / "a=b.txt").write_text("equals\n")
    texts = ["--input", f"recording={tmp_path / 'a=b.txt'}", "--input", "angle_deg=7", "--set", "demo.turn.steps=3"]
    assert command("run", pipeline, "--out", tmp_path / "out", *texts).status == 0
    stages = json.loads((tmp_path / "out" / "run.json").read_text())["pipeline"]["stages"]
    assert (stages[0]["recording"], stages[1]["angle_deg"], stages[1]["steps"]) == (str(tmp_path / "a=b.txt"), 7, 3)


CELL = Path(__file__).parents[1] / "data" / "robot" / "cell.json"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "expected a command: run, validate"),
        (["rnu"], "unknown command 'rnu'; did you mean 'run'?"),
        (["run"], "the following arguments are required: PIPELINE.json"),
        (["run", "P", "--otu", "D"], "did you mean '--out'?"),
        (["run", "P", "--out", "D", "--inptu", "a=1"], "unknown option '--inptu'; did you mean '--input'?"),
        (["run", "P", "Q", "--out", "D"], "one argument too many: 'Q'; a name or a value with blanks is quoted"),
        (["run", "P", "--out", "D", "--input", "recording"], "--input 'recording': expected NAME=VALUE"),
        (["run", "P", "--out", "D", "--input", "=3"], "expected NAME=VALUE"),
        (["run", "P", "--out", "D", "--input", "angle_deg=3", "--input", "angle_deg=4"], "'angle_deg' is given twice"),
        (["run", "P", "--out", "D", "--input", "angel_deg=3"], "did you mean 'angle_deg'?"),
        (["run", "P", "--out", "D", "--input", "angle_deg=NaN"], "expected a valid number, got 'NaN'"),
        (["run", "P", "--out", "D", "--input", "angle_deg=1,5"], "got '1,5': a decimal comma for a point?"),
        (["run", "P", "--out", "D", "--input", "angle_deg=[1 2]"], "is it JSON, as [0, 1.5], and quoted"),
        (
            ["run", "P", "--out", "D", "--set", "demo.turn.steps=0"],
            "stages[1].steps: expected greater than or equal to 1",
        ),
        (["run", "missing.json", "--out", "D"], "missing.json: cannot be read: No such file or directory"),
        (
            ["run", "inspect_bevl", "--out", "D"],
            "inspect_bevl: cannot be read: No such file or directory; did you mean",
        ),
        (["run", str(CELL), "--out", "D"], "format: expected a pipeline, this is a file of another kind: 'robot-cell'"),
        (["run", "P", "--out", "P"], "p.json: is not a directory"),
        (["run", "P", "--out", ""], "expected the name of a directory"),
        (["validate", "missing.json"], "missing.json: cannot be read"),
        (["stages", "demo.trun"], "did you mean 'demo.turn'?"),
        (["simulate", "missing.json", "--out", "D/x.h5"], "missing.json"),
    ],
)
def test_bad_arguments(command: Any, pipeline: Path, tmp_path: Path, arguments: list[str], message: str) -> None:
    places = {"P": str(pipeline), "D": str(tmp_path / "out"), "D/x.h5": str(tmp_path / "x.h5")}
    got = command(*(places.get(argument, argument) for argument in arguments))
    assert got.status == 2
    assert got.err.count("\n") == 1
    assert got.err.startswith("error: ")
    assert message in got.err
    assert got.out == ""
    assert sorted(os.listdir(tmp_path)) == ["p.json", "part.txt"]


@pytest.mark.parametrize(
    ("shipped", "given", "found"),
    [
        ("inspect_bevel", "bevel_nominal_deg=0.698", "greater than or equal to 15, got 0.698: in radians?"),
        ("inspect_bevel", "bevel_nominal_deg=14", "greater than or equal to 15, got 14"),
        ("inspect_bevel", "temperature_c=293.15", "got 293.15: in kelvin?"),
        ("inspect_bevel", "root_tolerance_mm=[-0,3, 0,3]", "got [0, 3, 0, 3]: a decimal comma for a point?"),
        ("inspect_bevel", "sections=0", "expected greater than or equal to 1, got 0"),
        ("inspect_groove", 'nominal={"gap": 2}', "nominal: gap: no size of such a joint; did you mean 'gap_mm'?"),
        ("inspect_groove", 'nominal={"gap_mm": -2}', "nominal: gap_mm: expected 0 or more, found -2"),
        ("inspect_groove", 'nominal={"gap_mm": 2}', "lower <= 0 <= upper"),
        ("plan_bevel", "upper_side=[0, 0, 0]", "expected a direction, of any length but 0, got [0, 0, 0]"),
        ("plan_bevel", 'scan.fuse.limits={"step_shar": 1}', "no such check; did you mean 'step_share'?"),
        (
            "inspect_bevel",
            'edge.segment.limits={"range_mm": 1}',
            "judged by this stage, but by scan.fuse: set it there",
        ),
        ("plan_bevel", "v_slow_mm_s=30", "the v_slow_mm_s of path.layers, 30, got 20: are the two swapped?"),
        ("measured_loop", "v_slow_mm_s=30", "the v_slow_mm_s of first_layers, 30, got 20: are the two swapped?"),
    ],
)
def test_a_value_is_judged_and_its_likeliest_slip_asked_for_before_anything_runs(command, shipped, given, found):
    option = "--set" if ".limits" in given else "--input"
    got = command("validate", Path(__file__).parents[1] / "pipelines" / f"{shipped}.json", option, given)
    assert (got.status, got.out) == (2, "")
    assert "stages[" in got.err
    assert got.err.endswith(f"{found}\n")


def test_failed_run_leaves_no_earlier_result_in_its_place(command: Any, pipeline: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for bad in (["--input", "angle_deg=999"], [f"--out={out}", "--input", "angle_deg=999"]):
        assert command("run", pipeline, "--out", out).status == 0
        (out / "notes.txt").write_text("mine")
        got = command("run", pipeline, "--out", out, *bad)
        assert got.status == 2
        error, note = got.err.splitlines()
        assert error.startswith("error: ")
        assert note.startswith(f"note: the results of an earlier run were moved to {out / 'superseded'}")
        assert sorted(os.listdir(out)) == ["notes.txt", "superseded"]
    assert sorted(os.listdir(out / "superseded")) == ["1", "2"]
    assert sorted(os.listdir(out / "superseded" / "2")) == ["inspection.json", "report.html", "run.json"]


@pytest.mark.parametrize(
    "slip",
    [["--inptu", "x=1"], ["--set", "x"], ["--input", "angel_deg=3"], ["--set", "demo.trun.angle_deg=3"], ["more"]],
)
def test_a_slip_in_the_arguments_moves_nothing(command: Any, pipeline: Path, tmp_path: Path, slip: list[str]) -> None:
    out = tmp_path / "out"
    assert command("run", pipeline, "--out", out).status == 0
    got = command("run", pipeline, "--out", out, *slip)
    assert (got.status, got.err.count("\n")) == (2, 1)
    assert sorted(os.listdir(out)) == ["inspection.json", "report.html", "run.json"]


def test_failure_half_way_shows_the_stage_and_one_error_line(command: Any, pipeline: Path, tmp_path: Path) -> None:
    (tmp_path / "part.txt").write_text("")
    got = command("run", pipeline, "--out", tmp_path / "out")
    stage, error = got.err.splitlines()
    assert (got.status, stage) == (2, "[1/5] demo.read")
    assert error == f"error: {tmp_path / 'part.txt'}: expected at least one line"
    assert not (tmp_path / "out").exists()


def test_simulate_writes_recording_and_truth(command: Any, tmp_path: Path) -> None:
    (tmp_path / "r.json").write_text(
        '{"version": 1, "passes": [{"from_mm": 5, "to_mm": 6}], "part": {"length_mm": 40}, "scanner": {"columns": 50}}'
    )
    got = command("simulate", tmp_path / "r.json", "--out", tmp_path / "part.h5")
    assert (got.status, got.out) == (0, f"recording: {tmp_path / 'part.h5'}\ntruth: {tmp_path / 'part.truth.json'}\n")
    assert {"part.h5", "part.truth.json"} <= set(os.listdir(tmp_path))


def test_unexpected_exception_is_one_line_and_traceback_on_demand(command, pipeline, monkeypatch):
    monkeypatch.setattr("workbench.pipeline.run.plan", lambda *_, **__: 1 / 0)
    got = command("validate", pipeline)
    assert (got.status, got.err.count("\n")) == (2, 1)
    assert "internal: ZeroDivisionError" in got.err
    assert "--traceback" in got.err
    assert "Traceback (most recent call last)" in command("validate", pipeline, "--traceback").err


def test_validate_runs_nothing(command: Any, pipeline: Path, tmp_path: Path) -> None:
    got = command("validate", pipeline, "--input", "angle_deg=7")
    assert (got.status, got.out) == (0, f"{pipeline}: valid, 5 stages\n")
    assert sorted(os.listdir(tmp_path)) == ["p.json", "part.txt"]


def test_stages_shows_parameters_with_units(command: Any, demo: object) -> None:
    got = command("stages", "demo.turn")
    assert "angle_deg  (number, deg, -90 <= value <= 90, default 10.0)" in got.out
    assert "turn about z" in got.out
    assert "takes pose: HandEye" in got.out
    assert "demo.merge" in command("stages").out
    assert max(map(len, command("stages").out.splitlines())) <= 80


def test_schema_is_json(command: Any, demo: object) -> None:
    assert (
        "demo.turn" in json.loads(command("schema").out)["properties"]["stages"]["items"]["properties"]["stage"]["enum"]
    )


def test_help_shows_units_and_examples(command: Any) -> None:
    assert "examples:" in command("--help").out
    assert "_mm" in command("run", "--help").out
    assert command("--version").out.startswith("workbench 0.")


def python(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=300, check=False, **options
    )


def test_help_imports_nothing_heavy() -> None:
    code = "import sys; from workbench.cli import main; main(['--help']); print(sorted(sys.modules), file=sys.stderr)"
    loaded = set(re.findall(r"'(\w+)", python("-c", code).stderr))
    assert "argparse" in loaded
    heavy = {"numpy", "pydantic", "numba", "open3d", "h5py", "rich", "scipy", "importlib.metadata", "json", "fcl"}
    assert not loaded & {*heavy, "matplotlib", "pinocchio", "pyvista", "skimage", "vtkmodules"}


def test_module_runs_and_closed_pipe_is_no_error(tmp_path: Path) -> None:
    assert python("-m", "workbench", "--version").stdout.startswith("workbench")
    command = f"{sys.executable} -m workbench schema | true; echo ${{PIPESTATUS[0]}}"
    got = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=300, check=False)
    assert (got.stdout, got.stderr) == ("0\n", "")


@pytest.mark.parametrize(
    ("redirect", "status"),
    [
        ("2>/dev/full", 0),
        (">&- 2>&-", 0),
        ("--input x=1 2>/dev/full", 2),
        ("--input x=1 >&- 2>&-", 2),
        (">/dev/full", 2),
    ],
)
def test_streams_that_cannot_be_written(tmp_path: Path, redirect: str, status: int) -> None:
    """1 would mean that a gate has rejected the part."""
    (tmp_path / "p.json").write_text('{"version": 1, "stages": [{"stage": "demo.quick"}]}')
    code = SLEEPER.replace("demo.sleep", "demo.quick").replace("600", "0").replace("1:-1", "1:")
    (tmp_path / "quick.py").write_text(code.replace("sys.argv[-1]", '"flag"'))
    command = f"{sys.executable} quick.py run p.json --out out {redirect}"
    got = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, timeout=300, check=False, cwd=tmp_path
    )
    assert got.returncode == status
    assert "Traceback" not in got.stderr
    if redirect == ">/dev/full":
        assert got.stderr.splitlines()[-1] == "error: standard output: cannot be written: No space left on device"
    assert (tmp_path / "out").exists() == ("x=1" not in redirect)
    if "x=1" not in redirect:  # the run itself was good
        assert {*os.listdir(tmp_path / "out")} == {"a.txt", "run.json"}


SLEEPER = """
import sys, time
from pathlib import Path
from workbench.api import Document, stage
@stage("demo.sleep")
def sleep() -> Document:
    Path(sys.argv[-1]).write_text("")
    for _ in range(600):  # in pieces: a signal that comes right before a call of sleep does not end it
        time.sleep(1.0)
    return Document("a.txt", b"")
from workbench.cli import main
sys.exit(main(sys.argv[1:-1]))
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_stopped_run_leaves_the_old_results_whole_and_nothing_else(tmp_path: Path, number: signal.Signals) -> None:
    out, flag, pipeline = tmp_path / "out", tmp_path / "flag", tmp_path / "p.json"
    pipeline.write_text('{"version": 1, "stages": [{"stage": "demo.sleep"}]}')
    out.mkdir()
    (out / "run.json").write_text('{"files": []}')
    command = [sys.executable, "-c", SLEEPER, "run", str(pipeline), "--out", str(out), str(flag)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 300
    while not flag.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(number)
    _, err = process.communicate(timeout=300)
    assert process.returncode == (-9 if number is signal.SIGKILL else 128 + number)
    assert "Traceback" not in err
    assert os.listdir(out) == ["run.json"]
    assert (out / "run.json").read_text() == '{"files": []}'


def test_a_shell_completes_commands_options_and_pipelines(command: Any) -> None:
    """As bash itself runs the script that is printed."""
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash")
    script = command("completion", "bash").out
    asked = "".join(
        f"COMP_WORDS=(workbench {words}); COMP_CWORD={len(words.split())}; _workbench; echo ${{COMPREPLY[@]}}\n"
        for words in ("vie", "run inspect_bev", "batch --sto")
    )
    told = subprocess.run([bash, "-c", f"{script}\n{asked}"], capture_output=True, text=True, check=True)
    assert told.stdout.splitlines() == ["view view-cell", "inspect_bevel", "--store"]


def test_a_run_without_out_writes_beside_the_command_and_is_set_aside_where_it_fails(
    command: Any, pipeline: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert command("run", pipeline, "--store", "none").status == 2  # refused before anything is measured
    assert not (tmp_path / "results").exists()
    assert command("run", pipeline, "--store", tmp_path).status == 0
    assert (tmp_path / "results" / "p" / "run.json").is_file()
    (kept,) = tmp_path.glob(".workbench/*.sqlite")
    with closing(sqlite3.connect(kept)) as store:
        assert store.execute("SELECT kind, state, status FROM runs").fetchall() == [("p", "done", 0)]
    assert command("run", pipeline, "--input", "angle_deg=999").status == 2
    assert not (tmp_path / "results" / "p" / "run.json").exists()
