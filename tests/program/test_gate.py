"""No program without a decision on its very path: what was tried to get around that, and what is said then."""

import dataclasses
import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.artefacts import Gate, Moves, PathGate, RobotCell, Toolpath
from workbench.errors import InputError
from workbench.path import check_file, read, simplify
from workbench.pipeline.results import result_files
from workbench.program import csv, write
from workbench.program.rapid_parser import parse_rapid

from .conftest import passed, rejected
from .paths import Shape, mill_path, run_move

WRITERS: list[Callable[..., Any]] = [write, partial(write, controller="kuka")]


@pytest.fixture(scope="module")
def path() -> Toolpath:
    return mill_path(Shape(bend=1 / 300, length_mm=40))


@pytest.mark.parametrize("write", WRITERS)
def test_another_paths_gate_releases_nothing(write: Callable[..., Any], path: Toolpath) -> None:
    """Even a copy is another path: whatever changed it since was not looked at."""
    with pytest.raises(InputError, match="the gate is not this path's"):
        write(simplify(path), passed(dataclasses.replace(path)))
    with pytest.raises(InputError, match="the gate is not this path's"):
        csv(path, passed(dataclasses.replace(path)))


@pytest.mark.parametrize("write", WRITERS)
def test_where_the_robot_is_known_moves_need_postures(write: Callable[..., Any], path: Toolpath) -> None:
    moves, cell = simplify(path), RobotCell()
    for gate in (passed(path), replace(passed(path), reached=True)):
        with pytest.raises(InputError, match="postures"):
            write(moves, gate, cell)
    with pytest.raises(InputError, match="postures"):  # postures were found, the moves do without them
        write(moves, replace(passed(path), reached=True))
    with pytest.raises(InputError, match="postures"):
        csv(path, passed(path), cell)
    assert csv(path, replace(passed(path), reached=True), cell) is not None
    assert write(moves, rejected(path), cell) == ()


@pytest.mark.parametrize(
    ("loose", "off"), [({"chord_tolerance_mm": 0.2}, "0.2"), ({"angle_tolerance_deg": 1.0}, "0.27")]
)
def test_moves_may_not_leave_the_path_farther_than_it_was_checked_for(
    path: Toolpath, loose: dict[str, float], off: str
) -> None:
    with pytest.raises(InputError, match=rf"leave the path by up to {off}\d* mm, and it was checked for 0.05 mm"):
        write(simplify(path, **loose), passed(path))


def test_what_was_not_checked_stands_in_the_program(path: Toolpath) -> None:
    gate = replace(passed(path), loosened=("the rule\nENDPROC is\r; 2 mm " * 6,), unchecked=("the plate!",))
    (document,) = write(simplify(path), gate)
    lines = document.content.decode().splitlines()
    said = [line.strip() for line in lines if "CHECK LOOSENED" in line or "Not checked" in line]
    assert said[0].startswith("! CHECK LOOSENED: the rule?ENDPROC is??")
    assert "! Not checked: the plate?" in said
    assert any("reach, joint limits and collisions" in line for line in said)
    assert not any(line.strip().startswith("ENDPROC is") for line in lines)
    assert max(map(len, lines)) < 250
    assert csv(path, gate) is None  # a table cannot say so


def test_a_loosened_check_is_not_clean() -> None:
    assert Gate(True, "").clean
    assert not Gate(False, "no").clean
    gate = Gate(True, "fine", ("twice the depth",))
    assert (gate.clean, gate.cause) == (False, "twice the depth")


def written(path: Toolpath, gate: PathGate | None, folder: Path) -> Path:
    """The path as a run leaves it."""
    file = folder / "toolpath.json"
    file.write_bytes(result_files([path], [gate] if gate else [])["toolpath.json"])
    return file


def again(file: Path) -> PathGate:
    return check_file(read(toolpath=file))


def test_a_path_out_of_a_file_keeps_its_verdict(path: Toolpath, tmp_path: Path) -> None:
    """Refused stays refused, loosened stays loosened, and a sound file needs no remark."""
    assert (again(written(path, passed(path), tmp_path)).clean, again(tmp_path / "toolpath.json").unchecked) == (
        True,
        (),
    )
    gate = again(written(path, rejected(path), tmp_path))
    assert not gate.passed
    assert "its file says: layer 1 cuts below the finished bevel" in gate.reason
    gate = again(written(path, replace(passed(path), loosened=("2 mm",), unchecked=("the plate",)), tmp_path))
    assert (gate.passed, gate.clean, gate.loosened, gate.unchecked) == (True, False, ("2 mm",), ("the plate",))
    gate = again(written(path, None, tmp_path))
    assert gate.passed
    assert "held against its own final layer" in gate.unchecked[0]


def test_a_refusal_counts_whatever_came_after_it(path: Toolpath, tmp_path: Path) -> None:
    file = tmp_path / "toolpath.json"
    for gates in ([passed(path), rejected(path)], [rejected(path), passed(path)]):
        file.write_bytes(result_files([path], gates)["toolpath.json"])
        assert not again(file).passed


@pytest.mark.parametrize("edit", [
    lambda d: d["layers"][0]["points"][20]["position_mm"].__setitem__(2, 0.0),
    lambda d: d["layers"][-1]["points"][20].__setitem__("feed_mm_s", 1.1),
    lambda d: d["cutter"].__setitem__("diameter_mm", 10.5),
    lambda d: d["travels"].pop(),
    lambda d: d["check"].__setitem__("sha256", None),
])  # fmt: skip
def test_a_path_that_was_changed_after_its_check_is_refused(
    path: Toolpath, tmp_path: Path, edit: Callable[[Any], Any]
) -> None:
    file = written(path, passed(path), tmp_path)
    document = json.loads(file.read_text())
    edit(document)
    file.write_text(json.dumps(document))
    gate = again(file)
    assert not gate.passed
    assert "changed after its check" in gate.reason


def test_a_file_laid_out_anew_is_still_the_same_path(path: Toolpath, tmp_path: Path) -> None:
    file = written(path, passed(path), tmp_path)
    file.write_text(json.dumps(json.loads(file.read_text()), indent=1, sort_keys=True))
    assert again(file).clean


SAID: dict[str, Any] = {"passed": True, "reason": "", "loosened": [], "unchecked": []}


@pytest.mark.parametrize(
    "check",
    [1, {}, {"passed": 1}, {**SAID, "reason": None}, {**SAID, "loosened": "x"}, {**SAID, "loosened": ["x"] * 99}],
)
def test_a_verdict_that_is_none_is_refused(path: Toolpath, tmp_path: Path, check: object) -> None:
    file = written(path, None, tmp_path)
    file.write_text(json.dumps({**json.loads(file.read_text()), "check": check}))
    with pytest.raises(InputError, match=r"\$\.check"):
        read(toolpath=file)


def sunk(path: Toolpath, layer: int, points: slice, depth_mm: float) -> Toolpath:
    """The path with points of a layer pushed into the part, along the bevel's normal."""
    parts = list(path.layers)
    x = Rotation.from_quat(parts[layer].quaternion_wxyz, scalar_first=True).as_matrix()[:, :, 0]
    position = parts[layer].position_mm.copy()
    position[points] += depth_mm * x[points]
    parts[layer] = replace(parts[layer], position_mm=position)
    return replace(path, layers=tuple(parts))


def test_a_path_that_cuts_below_its_own_final_layer_is_refused(path: Toolpath) -> None:
    assert check_file(path).passed
    assert check_file(sunk(path, 0, slice(20, 23), 0.9)).passed  # the first layer has a millimetre left
    for layer, depth in ((0, 1.2), (1, 0.3)):
        gate = check_file(sunk(path, layer, slice(20, 23), depth))
        assert not gate.passed
        assert f"in layer {layer + 1}" in gate.reason


def test_a_travel_through_the_finished_part_is_refused(path: Toolpath) -> None:
    """Straight back at the height of the final layer's ends, on an edge that bends outwards."""
    low = [replace(t, position_mm=t.position_mm[[0, -1]], quaternion_wxyz=t.quaternion_wxyz[[0, -1]],
                   feed_mm_s=t.feed_mm_s[[0, -1]]) for t in path.travels]  # fmt: skip
    last = path.layers[-1]
    through = replace(low[1], position_mm=last.position_mm[[12, -12]], quaternion_wxyz=last.quaternion_wxyz[[12, -12]])
    gate = check_file(replace(path, travels=(path.travels[0], through, path.travels[2])))
    assert not gate.passed
    assert "in the air" in gate.reason


def test_a_cutter_too_thin_to_be_checked_is_refused(path: Toolpath) -> None:
    needle = replace(path, cutter=replace(path.cutter, diameter_mm=0.08))
    gate = check_file(needle)
    assert not gate.passed
    assert "thinner than what it may enter" in gate.reason


def test_a_greater_penetration_loosens_the_check(path: Toolpath) -> None:
    gate = check_file(sunk(path, 1, slice(20, 23), 0.3), penetration_mm=1.0)
    assert (gate.passed, gate.clean) == (True, False)
    assert "by 1 mm, the rule is 0.05 mm" in gate.loosened[0]


def test_the_moves_of_a_checked_path_are_released(moves: Moves) -> None:
    assert len(write(moves, passed(moves.toolpath))) == 1


def parabola(corner: Any, before: Any, after: Any, zone_mm: float) -> Any:
    """The rounded corner, as controllers do it (a quadratic Bezier curve)."""
    u, v = (p - corner for p in (before, after))
    a, b = (w * min(zone_mm / np.linalg.norm(w), 0.5) for w in (u, v))
    f = np.linspace(0, 1, 101)[:, None]
    return corner + (1 - f) ** 2 * a + f**2 * b


def test_blending_does_not_leave_the_path_farther_than_it_was_checked_for(path: Toolpath) -> None:
    """Wide zones would cut corners; sharp ones are driven to their point, and all others stay near it."""
    (document,) = write(simplify(path, arcs=False), passed(path), zone_mm=5)
    moves = parse_rapid(document.content.decode()).moves
    at = np.array([move.target.position_mm for move in moves])
    blended = [i for i in range(1, len(moves) - 1) if moves[i].zone_mm > 0]
    sharp = [i for i in range(1, len(moves) - 1) if not moves[i].zone_mm]
    assert len(blended) > 10
    assert len(sharp) >= 4
    for i in range(1, len(moves) - 1):
        rounded = parabola(at[i], at[i - 1], at[i + 1], 5)
        lines = np.vstack([run_move(at[i - 1], None, at[i], 2000), run_move(at[i], None, at[i + 1], 2000)])
        off = np.linalg.norm(rounded[::10, None] - lines, axis=2).min(axis=1).max()
        assert off < 0.055 or i in sharp
