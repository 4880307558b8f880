"""`scripts/setup.sh` refuses in one line what it cannot set up, before it makes anything."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
needs_sh = pytest.mark.skipif(shutil.which("sh") is None, reason="a POSIX shell is needed")


@pytest.fixture
def checkout(tmp_path):
    """A copy of what the script reads, and a folder `bin` that comes first in PATH."""
    (tmp_path / "bin").mkdir()
    shutil.copytree(ROOT / "scripts", tmp_path / "scripts")
    for name in ("requirements.lock", "requirements-dev.lock", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    return tmp_path


def command(folder, name, body):
    path = folder / "bin" / name
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)


def set_up(checkout, **extra):
    env = {"PATH": f"{checkout / 'bin'}:{os.environ['PATH']}", "HOME": str(checkout), **extra}
    return subprocess.run(
        ["sh", "scripts/setup.sh"], cwd=checkout, env=env, capture_output=True, text=True, check=False
    )


def refusal(done):
    """The one line that a refused set-up prints."""
    assert done.returncode == 1
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    return lines[0]


@needs_sh
@pytest.mark.parametrize("version", ["3.9", "3.10", "3.15", "4.0", "2.7"])
def test_a_python_out_of_range_is_named(checkout, version):
    command(checkout, "other", f"echo {version}")
    line = refusal(set_up(checkout, PYTHON=str(checkout / "bin/other")))
    assert version in line
    assert "3.11 to 3.14" in line
    assert not (checkout / ".venv").exists()


@needs_sh
def test_a_user_who_may_not_install_is_told_the_command(checkout):
    command(checkout, "id", "echo 1000")
    command(checkout, "sudo", "exit 1")
    (checkout / "scripts/system_libraries.py").write_text("print('libexample1')\nprint('libother-2')\n")
    line = refusal(set_up(checkout, PYTHON=sys.executable))
    assert "apt-get install libexample1 libother-2" in line
    assert not (checkout / ".venv").exists()


@needs_sh
def test_sudo_is_used_with_yes_only(checkout):
    command(checkout, "id", "echo 1000")
    command(checkout, "apt-get", "exit 0")
    command(checkout, "sudo", f'echo "$@" >>"{checkout}/asked"')
    (checkout / "scripts/system_libraries.py").write_text("print('libexample1')\n")
    assert "apt-get install libexample1" in refusal(set_up(checkout, PYTHON=sys.executable))
    assert not (checkout / "asked").exists()
    done = set_up(checkout, PYTHON=sys.executable, YES="1")
    assert "still missing after installing" in done.stderr
    assert "apt-get" in (checkout / "asked").read_text()


@needs_sh
def test_nothing_is_done_twice(checkout):
    command(checkout, "id", "echo 1000")
    (checkout / "scripts/system_libraries.py").write_text("")
    (checkout / ".venv/bin").mkdir(parents=True)
    for name in ("python", "workbench"):
        (checkout / ".venv/bin" / name).symlink_to(sys.executable)
    complete = checkout / ".venv/complete"
    complete.write_text(f"{checkout}\n")
    future = complete.stat().st_mtime + 60
    os.utime(complete, (future, future))
    done = set_up(checkout, PYTHON=sys.executable)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@needs_sh
def test_a_package_whose_installation_was_interrupted_is_installed_again(checkout):
    (checkout / "scripts/system_libraries.py").write_text("")
    (checkout / ".venv/bin").mkdir(parents=True)
    (checkout / ".venv/bin/python").symlink_to(sys.executable)
    (checkout / ".venv/bin/pip").symlink_to(sys.executable)
    packages = checkout / ".venv/lib/python3.11/site-packages"
    for name in ("begun", "whole"):
        (packages / f"{name}-1.dist-info").mkdir(parents=True)
        (packages / f"{name}-1.dist-info/METADATA").write_text(f"Name: {name}\nVersion: 1\n")
    (packages / "whole-1.dist-info/RECORD").write_text("whole.py,,\n")
    for lock in checkout.glob("*.lock"):
        lock.write_text("no-such-package-to-install==1 --hash=sha256:" + 64 * "0" + "\n")
    done = set_up(checkout, PYTHON=sys.executable, PIP_NO_INDEX="1")
    assert done.returncode == 1
    assert [one.name for one in packages.iterdir()] == ["whole-1.dist-info"]


def test_a_missing_library_is_listed_by_its_package():
    sys.path.insert(0, str(ROOT / "scripts"))
    try:
        import system_libraries
    finally:
        sys.path.pop(0)
    assert system_libraries.loads("libc.so.6")
    assert not system_libraries.loads("libnosuchthing.so.7")


@needs_sh
def test_a_browser_is_asked_for_once_and_never_needed(checkout):
    (checkout / ".venv").mkdir()
    command(checkout, "apt-get", f'echo "$@" >>"{checkout}/asked"; exit 100')
    command(checkout, "id", "echo 0")
    for tool in ("sh", "dirname", "env", "mktemp", "tail", "rm"):
        (checkout / "bin" / tool).symlink_to(shutil.which(tool))
    run = [str(checkout / "bin" / "sh"), "scripts/browser.sh"]
    for said in ("apt-get install chromium", ""):
        done = subprocess.run(
            run, cwd=checkout, env={"PATH": str(checkout / "bin")}, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0
        assert said in done.stderr
        assert bool(said) == bool(done.stderr)
    asked = (checkout / "asked").read_text().splitlines()
    assert [line.rpartition("Retries=1 ")[2] for line in asked] == [
        "update",
        "install -y --no-install-recommends chromium",
    ]
