"""The tutorial works as written: every shell and Python block runs, in order, and says what the page says it says."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(sh|python|text)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture
def project(tmp_path):
    """A folder laid out as the tutorial finds the project, `.venv` being the environment that runs this test."""
    for name in ("pipelines", "data"):
        shutil.copytree(ROOT / name, tmp_path / name)
    (tmp_path / ".venv").symlink_to(sys.prefix)
    return tmp_path


def run(language, block, folder):
    command = ["sh", "-e", "-c", block] if language == "sh" else [sys.executable, "-c", block]
    env = {**os.environ, "COLUMNS": "100", "NO_COLOR": "1"}
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{block}\n{done.stdout}\n{done.stderr}"
    return done.stdout


NUMBER = re.compile(r"-?\d+\.\d+")


def lines(text):
    """Each line as its words and its decimal numbers, spacing left out."""
    rows = [" ".join(line.split()) for line in text.splitlines() if line.strip()]
    return [(NUMBER.sub("#", row), [float(number) for number in NUMBER.findall(row)]) for row in rows]


def said(line, printed):
    """Whether a line was printed, its numbers to within 0.02 (compilers differ in the last digits)."""
    return any(line[0] == other[0] and line[1] == pytest.approx(other[1], abs=0.02) for other in lines(printed))


def test_every_block_of_the_tutorial_runs_and_prints_what_it_says(project):
    printed = ""
    blocks = BLOCK.findall((ROOT / "docs/tutorial.md").read_text())
    assert len([language for language, _ in blocks if language != "text"]) >= 6
    for language, block in blocks:
        if language == "text":
            missing = [line for line in lines(block) if line[0] != "..." and not said(line, printed)]
            assert missing == [], printed
        else:
            printed = run(language, block, project)
