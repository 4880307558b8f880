"""`workbench view-cell`: what it tells against numbers by hand, and a picture that shows it."""

import io
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from workbench.cli import main
from workbench.errors import InputError
from workbench.robot import Cell, CollisionModel, cell_triangles, read_cell
from workbench.robot.picture import cell_picture, described, reach_mm, view_cell
from workbench.units import DEG

COLLIDING = "0,40,20,0,30,0"  # the forearm in the turntable


def test_reach_is_that_of_the_stretched_arm(cell: Cell, arms: Any) -> None:
    """320 mm to axis 2, the upper arm at its limit of 85 deg, the forearm's 200 and 1592.5 mm level and outwards."""
    reach, what = reach_mm(cell.chain)
    assert what == "wrist centre"
    assert abs(reach - (320 + 1280 * np.sin(85 * DEG) + np.hypot(200, 1592.5))) < 1.0
    assert abs(reach_mm(arms("puma"))[0] - np.hypot(0.4318 + np.hypot(0.0203, 0.4331), 0.2435 - 0.0934) * 1e3) < 0.5


def test_lines_on_the_shipped_cell(cell: Cell) -> None:
    lines = described(cell, np.zeros(6), 0.0)
    assert lines[2] == "reach: 3200 mm from axis 1 (wrist centre)"
    assert "joint_2 -65 to 85, joint_3 -180 to 70" in lines[1]
    assert "tool: tip at (260, 0, 140) mm in the flange, cutter's axis 90 deg to the flange's z" in lines
    assert "singular: axes 4, 5 and 6 lie in a plane, the wrist cannot turn in every direction" in lines
    nearest = CollisionModel(cell).clearance(np.zeros(6))
    assert nearest is not None
    assert f"clearance: {nearest.distance_mm:.1f} mm, {' to '.join(nearest.pair)}" in lines


def test_coaxial_spindle_is_told(cell_file: Any) -> None:
    straight = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 200], [0, 0, 0, 1]]
    lines = described(read_cell(cell_file(lambda t: t["tool"].update(flange_from_cutter=straight))), np.zeros(6), 0.0)
    assert any(line.startswith("warning: the spindle is coaxial with the flange") for line in lines)


def test_gaps_are_those_of_the_clearance_with_points_on_the_bodies(cell: Cell) -> None:
    q = np.radians([20.0, 10, 10, 30, 60, 10])
    model = CollisionModel(cell)
    gaps = model.gaps(q, 0.3)
    clearance = model.clearance(q, 0.3)
    assert clearance is not None
    assert (gaps[0].distance_mm, gaps[0].pair) == (clearance.distance_mm, clearance.pair)
    assert [gap.distance_mm for gap in gaps] == sorted(gap.distance_mm for gap in gaps)
    assert len({gap.pair for gap in gaps}) == len(gaps)
    corners = {}
    for body, triangles in cell_triangles(cell, q, 0.3, 64):
        corners.setdefault(body, []).append(triangles.reshape(-1, 3))
    for gap in gaps[:3]:
        assert gap.points_mm is not None
        for point, body in zip(gap.points_mm, gap.pair, strict=True):
            low, high = np.vstack(corners[body]).min(axis=0), np.vstack(corners[body]).max(axis=0)
            assert ((low - 1 < point) & (point < high + 1)).all()


def test_picture_and_lines(cell_file: Any, tmp_path: Path) -> None:
    out = tmp_path / "cell.png"
    lines = view_cell(str(cell_file()), COLLIDING, 0.0, str(out))
    assert "collision: tool with turntable" in lines
    assert not any(line.startswith("clearance") for line in lines)
    assert lines[-1] == f"picture: {out}"
    picture = matplotlib.image.imread(io.BytesIO(out.read_bytes()))[..., :3]
    assert picture.shape == (1500, 2000, 3)
    red = (picture[..., 0] > 0.4) & (picture[..., 1:].max(axis=-1) < 0.3 * picture[..., 0])
    for quarter in (red[:750, :1000], red[:750, 1000:], red[750:, :1000], red[750:, 1000:]):
        assert quarter.mean() > 0.005
    free = matplotlib.image.imread(
        io.BytesIO(cell_picture(read_cell(cell_file()), np.radians([0, 38, -5, 20, 55, -10]), 0.3))
    )
    assert (
        (free[..., 0] > 0.4) & (free[..., 1:3].max(axis=-1) < 0.3 * free[..., 0])
    ).mean() < 0.002  # gaps and their sizes
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
