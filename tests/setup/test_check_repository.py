"""The repository check finds what it is for, and only that."""

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
spec = importlib.util.spec_from_file_location("check_repository", ROOT / "scripts/check_repository.py")
check = importlib.util.module_from_spec(spec)
spec.loader.exec_module(check)


@pytest.fixture
def findings(tmp_path, monkeypatch):
    monkeypatch.setattr(check, "ROOT", tmp_path)

    def write(text):
        path = tmp_path / "file.txt"
        path.write_text(text)
        return check.findings(path)

    return write


@pytest.mark.parametrize("host", ["pypi" + ".org", "files.python" + "hosted.org", "deb.deb" + "ian.org"])
def test_a_registry_host_is_found_with_its_line(findings, host):
    assert findings(f"first\nsee {host}/simple\n") == ["file.txt:2: host of a package registry"]


@pytest.mark.parametrize("folder", ["home", "root", "work"])
def test_a_path_of_one_machine_is_found(findings, folder):
    assert findings(f'open("/{folder}/someone/data")') == ["file.txt:1: path of one machine"]


@pytest.mark.parametrize("text", ["docs/work/page.md", "profiles/root/x", "a root/bevel ratio", "/robot/time", "PyPI"])
def test_ordinary_text_passes(findings, text):
    assert findings(text) == []


TAKES = ", ".join(f"p{k}" for k in range(8))


def test_a_function_of_many_parameters_is_found_unless_it_is_a_stage():
    assert check.many_parameters(f"def f({TAKES}): ...", "a.py") == []
    assert check.many_parameters(f"class A:\n    def f(self, {TAKES}): ...", "a.py") == []
    assert check.many_parameters(f"def f({TAKES}, *, more=0): ...", "a.py") == ["1: f takes 9 parameters, at most 8"]
    assert check.many_parameters(f"@cache\ndef f({TAKES}, p8): ...", "a.py") == ["2: f takes 9 parameters, at most 8"]
    assert check.many_parameters(f"@stage('a.b')\ndef f({TAKES}, p8): ...", "a.py") == []
    for kernel in ("kernel", "kernel(fastmath=True)"):
        assert len(check.many_parameters(f"@{kernel}\ndef f({TAKES}, p8): ...", "a.py")) == 1


def test_a_large_file_is_found(findings, monkeypatch):
    monkeypatch.setattr(check, "LARGEST_BYTES", 10)
    assert findings("eleven byte") == ["file.txt: 11 bytes, at most 10"]


def test_a_link_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr(check, "ROOT", tmp_path)
    link = tmp_path / ".venv"
    link.symlink_to(tmp_path)
    assert check.findings(link) == [".venv: a symbolic link"]


def test_a_rise_is_found_and_written_with_its_reason_only(tmp_path, monkeypatch):
    ratchet = check.ratchet
    monkeypatch.setattr(ratchet, "RECORD", tmp_path / "ratchet.txt")
    now = {"edge": {"nodes": 12, "numbers": 1}}
    ratchet.RECORD.write_text("edge nodes 10\nedge numbers 3\n")
    assert len(ratchet.findings(now)) == 1
    ratchet.write(now)
    assert ratchet.record()[0] == {"edge": {"nodes": 10, "numbers": 1}}
    ratchet.write(now, "a groove")
    assert ratchet.findings(now) == []
    assert ratchet.record() == ({"edge": {"nodes": 12, "numbers": 1}}, ["edge nodes +2: a groove"])


@pytest.mark.parametrize(
    "text",
    [
        "and ".join(["a "] * 13),
        "[b for b in a for c in b]" + " or a" * 11,
        "(1 if a else 2)" + " + (1 if a else 2)" * 12,
    ],
)
def test_operands_and_comprehensions_count_as_paths(text):
    assert check.ratchet.size_of(f"def f(a):\n    return {text}")["complex"] == 1
    assert check.ratchet.size_of("def f(a):\n    return a and a")["complex"] == 0


def test_a_test_of_inner_names_is_counted():
    body = "\ndef test_a(): ...\n\ndef test_b(): ..."
    for inner in (
        "from workbench.edge.measure import corners",
        "import workbench.robot.judge",
        "from workbench.units import _x",
    ):
        assert check.ratchet.inner_tests(inner + body) == 2
    for public in ("from workbench.edge import segment", "from workbench import errors", "import numpy as np"):
        assert check.ratchet.inner_tests(public + body) == 0


def test_a_verdict_and_a_program_load_no_more_than_they_did():
    """`make lint` measures all the rest."""
    assert check.ratchet.findings(check.ratchet.loaded()) == []
