"""`workbench view-cell`: what it tells, and a page with the view."""

import base64
import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.robot import Cell, Shape, cell_strokes

COLLIDING = "0,40,20,0,30,0"  # the forearm in the turntable


def test_page_and_lines(cell_file: Any, command: Any, tmp_path: Path) -> None:
    out = tmp_path / "cell.html"
    told = command("view-cell", cell_file(), "--posture", COLLIDING, "--out", out)
    assert told.status == 0
    assert "collision: tool with turntable\n" in told.out
    assert "clearance" not in told.out
    assert told.out.endswith(f"page: {out}\n")
    page = out.read_text(encoding="utf-8")
    assert '<li class="fail">collision: tool with turntable' in page
    assert 'class="scene"' in page
    assert sorted(path.name for path in tmp_path.glob("*html*")) == ["cell.html"]


def test_the_view_shows_what_the_words_say(cell_file: Any, command: Any, tmp_path: Path) -> None:
    """Frames and bodies by name, and each clearance that is told as a line of that length."""
    out = tmp_path / "cell.html"
    told = command("view-cell", cell_file(), "--out", out).out
    assert "Nothing speaks against it: 1 check passed." in out.read_text(encoding="utf-8")
    view = json.loads(re.search(r'class="scene">(.*?)</script>', out.read_text(encoding="utf-8"))[1])
    drawn = {one["name"]: np.frombuffer(base64.b64decode(one["points"]), "<f4") for one in view["strokes"]}
    assert {"robot", "tool", "turntable"} <= drawn.keys()
    assert {"base", "flange", "cutter"} <= {name.split()[0] for name in drawn}
    clearances = [line.split()[1] for line in told.splitlines() if line.startswith("clearance: ")]
    assert clearances
    for mm in clearances:
        first, second = drawn[f"{mm} mm"].reshape(2, 3)
        assert np.linalg.norm(second - first) == pytest.approx(float(mm), abs=0.06)


@pytest.mark.parametrize(("kind", "size"), [("box", (3, 4, 5)), ("cylinder", (3, 5)), ("capsule", (3, 5))])
def test_what_is_drawn_of_a_shape_lies_on_it(cell: Cell, kind: str, size: Any) -> None:
    """Of a box its edges, of a cylinder those of a prism with eight sides."""
    (drawn,) = cell_strokes(dataclasses.replace(cell, shapes=(Shape("it", -1, kind, size, np.eye(4)),)), np.zeros(6), 0)
    ends = np.array([line[[0, -1]] for line in drawn.lines_mm])
    around, high = np.hypot(ends[..., 0], ends[..., 1]), np.abs(ends[..., 2])
    if kind == "capsule":
        assert np.hypot(around, np.maximum(high - 2.5, 0)) == pytest.approx(3.0, abs=0.01)
    else:
        assert np.hypot(around, high) == pytest.approx(np.hypot(2.5, 2.5 if kind == "box" else 3.0), abs=0.01)
        lengths = [*(3, 4, 5) * 4] if kind == "box" else [*[5] * 8, *[6 * np.sin(np.pi / 8)] * 16]
        assert sorted(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)) == pytest.approx(sorted(lengths), abs=0.02)


@pytest.mark.parametrize(
    ("posture", "turntable_deg", "out", "message"),
    [
        ("0,90,0,0,0,0", 0.0, "x.html", "joint_2: expected -65 to 85 deg, got 90 deg"),
        ("0,0,0,0,0,0", 181.0, "x.html", "turntable: expected -180 to 180 deg, got 181 deg"),
        ("0,0,0,0,0,0", float("nan"), "x.html", "turntable: expected -180 to 180 deg"),
        ("0,0,0,0,0", 0.0, "x.html", "expected six joint angles"),
        ("0,0,0,0,0,nan", 0.0, "x.html", "expected six joint angles"),
        ("0,0,0,0,0,0", 0.0, "x.png", "ending in .html"),
    ],
)
def test_unusable_arguments(cell_file, command, tmp_path, posture, turntable_deg, out, message):
    asked = ("--posture", posture, "--turntable-deg", turntable_deg, "--out", tmp_path / out)
    told = command("view-cell", cell_file(), *asked)
    assert (told.status, told.err.count("\n")) == (2, 1)
    assert message in told.err
    assert not (tmp_path / out).exists()


def test_negative_angles(cell_file: Any, command: Any, tmp_path: Path) -> None:
    asked = ("view-cell", cell_file(), "--posture", "-10,20,-30,40,50,60", "--turntable-deg", "-20")
    told = command(*asked, "--out", tmp_path / "x.html")
    assert "posture, deg: -10, 20, -30, 40, 50, 60; turntable -20\n" in told.out


def test_cell_without_turntable_takes_no_angle(cell_file: Any, command: Any, tmp_path: Path) -> None:
    path = cell_file(lambda tree: tree.update(turntable=None))
    told = command("view-cell", path, "--turntable-deg", 10, "--out", tmp_path / "x.html")
    assert (told.status, "the cell has no turntable" in told.err) == (2, True)
