"""What mypy tells a user of the package, from its own annotations."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
USER = """
from pathlib import Path
from workbench import Pipeline, read, scan, edge, inspect, calibrate

recording = read(recording=Path("part.h5"))
cloud = scan.fuse(recording, hand_eye="handeye.json")
reveal_type(cloud)
found = inspect.sections(edge.segment(cloud))
reveal_type(found)
reveal_type(found.sections[0].values["root_mm"])
scan.fuse("no recording")
calibrate.hand_eye("no profiles", recording)
"""


@pytest.mark.slow
def test_a_users_mypy_sees_the_types_of_an_installed_package(tmp_path: Path) -> None:
    """The package lies in site-packages of a Python of its own: only `py.typed` makes mypy read it there."""
    home = tmp_path / "python"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(home)], check=True)
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)],
        check=True,
        capture_output=True,
        cwd=ROOT,
    )
    (packages,) = home.glob("lib/python3*/site-packages")
    (wheel,) = tmp_path.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(packages)
    (tmp_path / "user.py").write_text(USER)
    command = [sys.executable, "-m", "mypy", "--strict", "--no-incremental", "--python-executable", home / "bin/python"]
    env = {"PATH": str(home / "bin"), "HOME": str(tmp_path)}
    done = subprocess.run([*command, "user.py"], cwd=tmp_path, env=env, capture_output=True, text=True, check=False)
    said = [line.partition(": ")[2] for line in done.stdout.splitlines() if line.startswith("user.py")]
    told = "\n".join(said)
    assert "import-untyped" not in told, done.stdout + done.stderr
    assert 'note: Revealed type is "workbench.artefacts' in told, done.stdout + done.stderr
    assert told.count("[arg-type]") == 2, told
