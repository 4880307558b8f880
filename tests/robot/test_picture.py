"""`workbench view-cell`: what it tells against numbers by hand, and a picture that shows it."""

import io
from pathlib import Path
from typing import Any

import matplotlib.image
import pytest

COLLIDING = "0,40,20,0,30,0"  # the forearm in the turntable


def test_picture_and_lines(cell_file: Any, command: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("workbench.robot.picture.VIEW_PX", (400, 300))
    out = tmp_path / "cell.png"
    told = command("view-cell", cell_file(), "--posture", COLLIDING, "--out", out)
    assert told.status == 0
    assert "collision: tool with turntable\n" in told.out
    assert "clearance" not in told.out
    assert told.out.endswith(f"picture: {out}\n")
    picture = matplotlib.image.imread(io.BytesIO(out.read_bytes()))[..., :3]
    assert picture.shape == (600, 800, 3)
    red = (picture[..., 0] > 0.4) & (picture[..., 1:].max(axis=-1) < 0.3 * picture[..., 0])
    for quarter in (red[:300, :400], red[:300, 400:], red[300:, :400], red[300:, 400:]):
        assert quarter.mean() > 0.005
    assert sorted(path.name for path in tmp_path.glob("*png*")) == ["cell.png"]


@pytest.mark.parametrize(
    ("posture", "turntable_deg", "out", "message"),
    [
        ("0,90,0,0,0,0", 0.0, "x.png", "joint_2: expected -65 to 85 deg, got 90 deg"),
        ("0,0,0,0,0,0", 181.0, "x.png", "turntable: expected -180 to 180 deg, got 181 deg"),
        ("0,0,0,0,0,0", float("nan"), "x.png", "turntable: expected -180 to 180 deg"),
        ("0,0,0,0,0", 0.0, "x.png", "expected six joint angles"),
        ("0,0,0,0,0,nan", 0.0, "x.png", "expected six joint angles"),
        ("0,0,0,0,0,0", 0.0, "x.jpg", "ends in .png"),
    ],
)
def test_unusable_arguments(cell_file, command, tmp_path, posture, turntable_deg, out, message):
    asked = ("--posture", posture, "--turntable-deg", turntable_deg, "--out", tmp_path / out)
    told = command("view-cell", cell_file(), *asked)
    assert (told.status, told.err.count("\n")) == (2, 1)
    assert message in told.err
    assert not (tmp_path / out).exists()


def test_negative_angles(cell_file: Any, command: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("workbench.robot.picture.cell_picture", lambda cell, joints, turntable: b"picture")
    asked = ("view-cell", cell_file(), "--posture", "-10,20,-30,40,50,60", "--turntable-deg", "-20")
    told = command(*asked, "--out", tmp_path / "x.png")
    assert "posture, deg: -10, 20, -30, 40, 50, 60; turntable -20\n" in told.out
    assert (tmp_path / "x.png").read_bytes() == b"picture"


def test_cell_without_turntable_takes_no_angle(cell_file: Any, command: Any, tmp_path: Path) -> None:
    path = cell_file(lambda tree: tree.update(turntable=None))
    told = command("view-cell", path, "--turntable-deg", 10, "--out", tmp_path / "x.png")
    assert (told.status, "the cell has no turntable" in told.err) == (2, True)
