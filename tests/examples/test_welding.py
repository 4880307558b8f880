"""The example plug-in of docs/examples, installed and run as a stranger's would be."""

import ast
import csv
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "docs/examples/welding"
MILLED = ROOT / "data/synthetic/milled_edge.h5"
GROOVE = "welding/pipelines/inspect_groove.json"


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a copy of the example, beside it what pip made of it, and the sample data."""
    place = tmp_path_factory.mktemp("stranger")
    shutil.copytree(EXAMPLE, place / "welding", ignore=shutil.ignore_patterns("__pycache__"))
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    done = run(place, *pip, "--disable-pip-version-check", "--target", "installed", "./welding", path=None)
    assert done.returncode == 0, done.stderr
    return place


def run(place, *command, path="installed"):
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    if path:
        env["PYTHONPATH"] = str(place / path)
    return subprocess.run(command, cwd=place, env=env, capture_output=True, text=True, check=False)


def workbench(place, *arguments, path="installed"):
    return run(place, sys.executable, "-m", "workbench", *arguments, path=path)


def test_it_imports_the_api_and_nothing_else_of_workbench():
    for module in (EXAMPLE / "workbench_welding").glob("*.py"):
        for node in ast.walk(ast.parse(module.read_text())):
            names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) else []
            assert [name for name in names if name.split(".")[0] == "workbench" and name != "workbench.api"] == []


def test_its_stages_are_found_where_it_is_installed_and_only_there(place):
    described = " ".join(workbench(place, "stages", "weld.groove").stdout.split())
    assert re.search(r"thickness_mm \(number, mm, 0 < value <= 500", described)
    assert "tolerance_percent ([number, number], %," in described
    missing = workbench(place, "stages", "weld.groove", path=None)
    assert missing.returncode == 2
    assert "unknown stage 'weld.groove'" in missing.stderr


def test_the_groove_of_a_milled_edge_is_that_of_its_truth(place):
    """Thickness and gap taken as known: what is left is the inspection's own uncertainty."""
    from workbench.synthetic import read_truth

    known = ("--set", "weld.groove.thickness_u_mm=0", "--set", "weld.groove.gap_u_mm=0", "--out", "out")
    done = workbench(place, "run", GROOVE, "--input", f"recording={MILLED}", *known)
    assert done.returncode == 0, done.stderr
    truth = read_truth(MILLED.with_suffix(".truth.json"))
    sections = json.loads((place / "out/inspection.json").read_text())["sections"]
    rows = list(csv.DictReader((place / "out/weld_groove.csv").open()))
    assert len(rows) == len(sections) == 9
    for section, row in zip(sections, rows, strict=True):
        root_mm, bevel = truth.root_mm_at(section["origin_mm"]), np.radians(truth.bevel_deg_at(section["origin_mm"]))
        area_mm2 = 2.0 * 8.0 + (8.0 - root_mm) ** 2 * np.tan(bevel)
        assert abs(float(row["area_mm2"]) - area_mm2) < 3 * float(row["area_u_mm2"]) < 1.5
    report = (place / "out/report.html").read_text()
    assert "Weld groove" in report
    assert json.loads((place / "out/run.json").read_text())["files"].count("weld_groove.csv") == 1


@pytest.mark.slow
def test_a_groove_out_of_tolerance_rejects_the_part(place):
    arguments = ("--input", f"recording={MILLED}", "--input", "tolerance_percent=[0, 0]", "--out", "narrow")
    assert workbench(place, "run", GROOVE, *arguments, "--set", 'weld.gate.reject=["undecided"]').returncode == 1


def test_its_own_tests_pass(place):
    command = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", "welding", "welding/tests")
    done = run(place, *command)
    assert done.returncode == 0, done.stdout
    assert re.search(r"\d\d passed", done.stdout)
