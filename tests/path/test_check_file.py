"""A path out of a file: what its check said stays said, and it is held against its own final layer."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from scipy.spatial.transform import Rotation

from tests.made import files_of
from tests.program.conftest import passed, rejected
from tests.program.paths import Shape, mill_path
from workbench.artefacts import PathGate, Toolpath
from workbench.errors import InputError
from workbench.path import check_file, read


@pytest.fixture(scope="module")
def path() -> Toolpath:
    return mill_path(Shape(bend=1 / 300, length_mm=40))


def written(path: Toolpath, gate: PathGate | None, folder: Path) -> Path:
    """The path as a run leaves it."""
    file = folder / "toolpath.json"
    file.write_bytes(files_of(*filter(None, (path, gate)))["toolpath.json"])
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
    for said, placed in (("2 mm", True), ("SHAPE ONLY: nothing shows it", False)):
        file = written(path, replace(passed(path), loosened=(said,)), tmp_path)
        assert json.loads(file.read_text())["check"]["placed"] is placed
    gate = again(written(path, None, tmp_path))
    assert gate.passed
    assert "compared with its own final layer" in gate.unchecked[0]


def test_a_refusal_counts_whatever_came_after_it(path: Toolpath, tmp_path: Path) -> None:
    file = tmp_path / "toolpath.json"
    for gates in ([passed(path), rejected(path)], [rejected(path), passed(path)]):
        file.write_bytes(files_of(path, *gates)["toolpath.json"])
        assert not again(file).passed


@pytest.mark.parametrize(
    "edit",
    [
        lambda d: d["layers"][0]["points"][20]["position_mm"].__setitem__(2, 0.0),
        lambda d: d["layers"][-1]["points"][20].__setitem__("feed_mm_s", 1.1),
        lambda d: d["cutter"].__setitem__("diameter_mm", 10.5),
        lambda d: d["travels"].pop(),
        lambda d: d["check"].__setitem__("sha256", None),
    ],
)
def test_a_path_that_was_changed_after_its_check_is_refused(path, tmp_path, edit):
    file = written(path, passed(path), tmp_path)
    document = json.loads(file.read_text())
    edit(document)
    file.write_text(json.dumps(document))
    gate = again(file)
    assert not gate.passed
    assert "changed after its check" in gate.reason


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
    low = [
        replace(
            t,
            position_mm=t.position_mm[[0, -1]],
            quaternion_wxyz=t.quaternion_wxyz[[0, -1]],
            feed_mm_s=t.feed_mm_s[[0, -1]],
        )
        for t in path.travels
    ]
    last = path.layers[-1]
    through = replace(low[1], position_mm=last.position_mm[[12, -12]], quaternion_wxyz=last.quaternion_wxyz[[12, -12]])
    gate = check_file(replace(path, travels=(path.travels[0], through, path.travels[2])))
    assert not gate.passed
    assert "in a travel move" in gate.reason


def test_a_cutter_too_thin_to_be_checked_is_refused(path: Toolpath) -> None:
    needle = replace(path, cutter=replace(path.cutter, diameter_mm=0.08))
    gate = check_file(needle)
    assert not gate.passed
    assert "thinner than what it may enter" in gate.reason


def test_a_greater_penetration_loosens_the_check(path: Toolpath) -> None:
    gate = check_file(sunk(path, 1, slice(20, 23), 0.3), penetration_mm=1.0)
    assert (gate.passed, gate.clean) == (True, False)
    assert "by 1 mm, the rule is 0.05 mm" in gate.loosened[-1]
