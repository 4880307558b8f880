"""`workbench view-cell`: what it tells against numbers by hand, and a picture that shows it."""

import io
from pathlib import Path
from typing import Any

import matplotlib.image
import pytest

from workbench.cli import main
from workbench.errors import InputError
from workbench.robot.picture import view_cell

COLLIDING = "0,40,20,0,30,0"  # the forearm in the turntable


def test_picture_and_lines(cell_file: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("workbench.robot.picture.VIEW_PX", (400, 300))
    out = tmp_path / "cell.png"
    lines = view_cell(str(cell_file()), COLLIDING, 0.0, str(out))
    assert "collision: tool with turntable" in lines
    assert not any(line.startswith("clearance") for line in lines)
    assert lines[-1] == f"picture: {out}"
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
def test_unusable_arguments(
    cell_file: Any, tmp_path: Path, posture: str, turntable_deg: float, out: str, message: str
) -> None:
    with pytest.raises(Exception, match="expected") as caught:
        view_cell(str(cell_file()), posture, turntable_deg, str(tmp_path / out))
    assert message in str(caught.value)
    assert not (tmp_path / out).exists()


def test_command_takes_negative_angles(cell_file: Any, tmp_path: Path, monkeypatch: Any, capsys: Any) -> None:
    monkeypatch.setattr("workbench.robot.picture.cell_picture", lambda cell, joints, turntable: b"picture")
    out = str(tmp_path / "x.png")
    arguments = ["view-cell", str(cell_file()), "--posture", "-10,20,-30,40,50,60", "--turntable-deg", "-20"]
    assert main([*arguments, "--out", out]) == 0
    assert "posture, deg: -10, 20, -30, 40, 50, 60; turntable -20\n" in capsys.readouterr().out
    assert (tmp_path / "x.png").read_bytes() == b"picture"
    assert main([*arguments, "--postur", "0", "--out", out]) == 2
    assert capsys.readouterr().err == "error: workbench: unknown option '--postur'; did you mean '--posture'?\n"


def test_cell_without_turntable_takes_no_angle(cell_file: Any, tmp_path: Path) -> None:
    path = cell_file(lambda tree: tree.update(turntable=None))
    with pytest.raises(InputError, match="the cell has no turntable"):
        view_cell(str(path), "0,0,0,0,0,0", 10.0, str(tmp_path / "x.png"))
