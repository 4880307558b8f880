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


def test_without_git_the_files_made_by_tools_are_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(check, "ROOT", tmp_path)
    monkeypatch.setenv("PATH", "")
    for name in ("kept.txt", ".venv/a.txt", "out/b.txt", "workbench/__pycache__/c.pyc"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    assert [path.name for path in check.files() if path.is_file()] == ["kept.txt"]


def test_the_repository_itself_passes():
    assert check.main() == 0
