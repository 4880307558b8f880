"""The installed command, held to INTERFACES: statuses, files, streams and words."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tests.printing import sheets

from .conftest import ROOT, SHIPPED, Ended

CHECKER = next((p for p in (ROOT.parent / "shared/tools/check_contract.py",) if p.is_file()), None)
SECTION = {
    "index",
    "arc_length_mm",
    "origin_mm",
    "tangent",
    "root_mm",
    "root_u_mm",
    "bevel_deg",
    "bevel_u_deg",
    "verdict",
}
PART_KEYS = (
    *("part_id", "drawing", "operator", "recorded_at"),
    *("sensor", "sensor_serial", "sensor_calibrated_at", "robot", "robot_serial"),
)
PROFILE = {"arc_length_mm", "position_mm", "root_mm", "root_u_mm", "bevel_deg"}
Run = Callable[..., Ended]


@pytest.fixture(scope="module")
def full(installed: Run, easy: Path, folder: Path) -> Ended:
    """The whole inspection with its page, into a directory that holds somebody's own file."""
    directory = folder / "full"
    directory.mkdir()
    (directory / "notes.txt").write_text("mine")
    return installed("full", "run", SHIPPED, "--input", f"recording={easy.name}", "--input", "sections=5")


def test_status_streams_and_files(full: Ended) -> None:
    assert full.status == 0, full.err
    assert "error" not in full.err
    assert "scan.read" in full.err  # progress
    assert "scan.read" not in full.out
    assert "report.html" in full.out
    assert {one.name for one in full.directory.iterdir()} == {
        "notes.txt",
        "inspection.json",
        "inspection.qif",
        "report.html",
        "run.json",
    }
    assert (full.directory / "notes.txt").read_text() == "mine"


def test_inspection_has_every_key(full: Ended) -> None:
    found = full.read()
    assert (found["format"], found["version"], found["frame"]) == ("bevel-inspection", 1, "base")
    assert set(found["profile"]) >= PROFILE
    assert [one["index"] for one in found["sections"]] == [1, 2, 3, 4, 5]
    assert all(set(one) >= SECTION for one in found["sections"])
    assert found["guard_factor"] == 1.645
    assert found["requirements"] == {
        "root_nominal_mm": 1.5,
        "root_tolerance_mm": [-0.5, 0.5],
        "bevel_nominal_deg": 40.0,
        "bevel_tolerance_deg": [-1.0, 1.0],
    }
    assert found["verdict"] == "pass"
    count = {len(found["profile"][key]) for key in PROFILE}
    assert len(count) == 1
    assert found["profile"]["arc_length_mm"][0] == 0


def test_run_record(full: Ended, easy: Path) -> None:
    found = full.read("run.json")
    assert set(found) >= {"pipeline", "versions", "seed", "inputs", "stages", "warnings"}
    digest = subprocess.run(["sha256sum", easy], capture_output=True, text=True, check=True).stdout.split()[0]
    assert found["inputs"] == [{"name": "recording", "path": "easy.h5", "sha256": digest}]
    assert [one["name"] for one in found["stages"]] == [
        entry["stage"] for entry in json.loads(SHIPPED.read_text())["stages"]
    ]
    assert all(one["seconds"] >= 0 for one in found["stages"])


def test_page_needs_no_network_and_escapes_names(full: Ended) -> None:
    page = (full.directory / "report.html").read_text()
    outside = re.findall(r"""(?:src|href|url|action)\s*[=(]\s*["']?\s*(?:https?:)?//[^"')\s]+""", page)
    assert not outside
    assert "@import" not in page
    assert '<script>alert("7")' not in page
    assert "&lt;script&gt;alert(" in page
    for section in full.read()["sections"]:
        assert any(f"{section['root_mm']:.{digits}f}" in page for digits in (2, 3, 4))


def test_page_prints_on_few_sheets(full: Ended, browser: Any) -> None:
    """Pictures and provenance included."""
    assert 1 < sheets(browser, full.directory / "report.html") <= 4


@pytest.mark.skipif(CHECKER is None, reason="check_contract.py is not beside this checkout")
def test_the_checker_agrees(full: Ended) -> None:
    done = subprocess.run([sys.executable, CHECKER, full.directory], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_out_of_tolerance_is_one_and_so_is_undecided_unless_accepted(run: Run, easy: Path) -> None:
    failed = run(easy, "--input", "bevel_nominal_deg=43", out="failed")
    assert (failed.status, failed.read()["verdict"]) == (1, "fail")
    assert {one["verdict"] for one in failed.read()["sections"]} == {"fail"}
    root = failed.read()["sections"][4]["root_mm"]  # put a limit on it
    at_limit = run(easy, "--input", f"root_nominal_mm={root - 0.5:.4f}", out="limit")
    assert (at_limit.status, at_limit.read()["sections"][4]["verdict"]) == (1, "undecided")
    wide = ["--input", "root_tolerance_mm=[-0.9, 0.5]", "--set", "inspect.sections.sections=1"]
    alone = run(easy, "--input", f"root_nominal_mm={root - 0.5:.4f}", *wide, out="alone")
    assert (alone.status, alone.read()["verdict"]) == (1, "undecided")
    accepted = [*wide, "--set", 'inspect.gate.reject=["fail"]']
    taken = run(easy, "--input", f"root_nominal_mm={root - 0.5:.4f}", *accepted, out="accepted")
    assert (taken.status, taken.read()["verdict"]) == (0, "undecided")
    assert "the pipeline lets a part through that is undecided" in taken.read("run.json")["warnings"]


def test_every_input_of_the_contract_is_there(command: Run) -> None:
    document = json.loads(SHIPPED.read_text())
    assert document["inputs"] | {"recording": 0} == {
        "recording": 0,
        "hand_eye": None,
        "upper_side": None,
        "thickness_mm": None,
        "root_nominal_mm": 1.5,
        "root_tolerance_mm": [-0.5, 0.5],
        "bevel_nominal_deg": 40,
        "bevel_tolerance_deg": [-1, 1],
        "sections": 9,
        "accept_conditions": [],
        "edge_condition": "unknown",
        "robot_noise_mm": 0.07,
        "robot_noise_length_mm": None,
        "scan_plan": None,
        **dict.fromkeys(("sensor_dcc", "thermometer_dcc", "sensor_name")),
        **dict.fromkeys(PART_KEYS),
        **dict.fromkeys(("report_number", "issued_at", "customer", "order", "sensor_certificate", "temperature_c")),
    }
    assert command("validate", SHIPPED).status == 0
    schema = json.loads(command("schema").out)
    assert schema["$schema"].startswith("http")
    listed = command("stages").out
    assert all(entry["stage"] in listed for entry in document["stages"])


def test_a_path_in_a_document_is_relative_to_it(command: Run, easy: Path, folder: Path, quick: Path) -> None:
    away = folder / "away" / "deep"
    away.mkdir(parents=True)
    document = json.loads(quick.read_text())
    document["inputs"]["recording"] = "../part.h5"
    (away / "mine.json").write_text(json.dumps(document))
    shutil.copy(easy, away.parent / "part.h5")
    assert command("run", away / "mine.json").status == 0
    assert command("run", away / "mine.json", "--input", "recording=../part.h5").status == 2


def test_hand_eye_of_a_file_takes_the_recording_s_place(run: Run, easy: Path, folder: Path) -> None:
    whole = run(easy, out="with").read()
    bare, told = Path(shutil.copy(easy, folder / "bare.h5")), folder / "handeye.json"
    with h5py.File(bare, "r+") as file:
        told.write_text(json.dumps({"flange_from_profiler": file["hand_eye/flange_from_profiler"][()].tolist()}))
        del file["hand_eye"]
    assert run(bare, out="none").status == 2
    given = run(bare, "--input", f"hand_eye={told}", out="given")
    for one, other in zip(whole["sections"], given.read()["sections"], strict=True):
        assert np.allclose(one["origin_mm"], other["origin_mm"], atol=1e-6)


PLANNING = {"hand_eye", "upper_side", "root_mm", "bevel_deg", "depth_of_cut_mm", "cutter_diameter_mm"}
PLANNING |= {"v_slow_mm_s", "v_fast_mm_s", "cell", "controller"}
INSPECTION = {"hand_eye", "root_nominal_mm", "root_tolerance_mm", "bevel_nominal_deg", "bevel_tolerance_deg"}
INSPECTION |= {"sections"}
BESIDES = {"sensor", "edge_condition", "robot_noise_mm", "robot_noise_length_mm"}
INPUTS = {
    "plan_bevel": {"recording"} | PLANNING | BESIDES,
    "inspect_groove": {"recording", "hand_eye", "groove", "nominal", "sections"} | BESIDES,
    "plan_scan": {"edge", "sensor", "cell", "thickness_mm", "root_mm", "bevel_deg", "root_U_mm", "bevel_U_deg"}
    | {"passes", "controller"},
    "closed_loop": {"recipe"} | PLANNING | INSPECTION | BESIDES,
    "measured_loop": {"recipe", "finish_allowance_mm", "tool_error_mm", "robot_noise_mm", "cell"},
    "calibrate_handeye": {"recording"},
    "identify_stiffness": {"loads", "cell"},
    "optimise_posture": {"toolpath", "stiffness", "cell", "mode", "controller"},
}


@pytest.mark.parametrize("name", INPUTS)
def test_a_pipeline_takes_the_inputs_that_were_promised(name: str) -> None:
    inputs = json.loads(SHIPPED.with_name(f"{name}.json").read_text())["inputs"]
    assert INPUTS[name] - inputs.keys() == set()
