"""Laws of the instruments on their public surface: rigid motion, order, noise, an instrument that is simulated."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.plugins.calibration.test_tool import CENTRE, SHANK, TIP, mark_rows, touch_rows
from workbench.api import Float, quaternion_from_rotation, rotation_from_quaternion
from workbench.plugins.calibration import tcp, tracker, turntable

TARGETS = np.array([[120.0, 0.0, 80.0], [-60.0, 110.0, 150.0], [-50.0, -90.0, 260.0]])


@dataclass(frozen=True)
class Instrument:
    """A table of an instrument, its rows moved as a whole, and the answer in that frame."""

    header: str
    rows: Callable[[np.random.Generator], list[str]]
    moved: Callable[[str, Rotation, Float], str]
    found: Callable[[Path], dict[str, Any]]
    places: Callable[[dict[str, Any]], Float]  # of the frame that is moved
    same: Callable[[dict[str, Any]], list[float]]  # what no frame changes: u and misfit


def _shifted(cells: list[str], first: int, turn: Rotation, shift: Float) -> list[str]:
    place = turn.apply([float(one) for one in cells[first : first + 3]]) + shift
    return [*cells[:first], *(f"{v:.9f}" for v in place), *cells[first + 3 :]]


def _pose(row: str, first: int, turn: Rotation, shift: Float) -> str:
    cells = _shifted(row.split(","), first, turn, shift)
    rotation = rotation_from_quaternion(np.array([float(one) for one in cells[first + 3 : first + 7]]))
    cells[first + 3 : first + 7] = [f"{v:.12f}" for v in quaternion_from_rotation(turn.as_matrix() @ rotation)]
    return ",".join(cells)


def tracked_rows(rng: np.random.Generator, count: int = 8) -> list[str]:
    """Three targets at postures of a robot that errs by its repeatability; the tracker's frame is the base."""
    rows = []
    for turn in Rotation.from_rotvec(0.7 * rng.normal(size=(count, 3))):
        at = np.array([1200.0, 0.0, 900.0]) + 300.0 * rng.normal(size=3)
        told = ",".join(f"{v:.12f}" for v in (*at, *turn.as_quat(scalar_first=True)))
        really = Rotation.from_rotvec(rng.normal(size=3) * np.radians(0.005)) * turn
        off = rng.normal(size=3) * 0.05
        for k, target in enumerate(TARGETS):
            place = really.apply(target) + at + off + 0.02 * rng.normal(size=3)
            rows.append(f"t{k},{told}," + ",".join(f"{v:.9f}" for v in place))
    return rows


INSTRUMENTS = {
    "tool": Instrument(
        "reference,tool_point,x_mm,y_mm,z_mm,qw,qx,qy,qz",
        touch_rows,
        lambda row, turn, shift: _pose(row, 2, turn, shift),
        lambda path: json.loads(tcp(touches=path)[0].content),
        lambda found: np.array([one["position_mm"] for one in found["references"]]),
        lambda found: [*(one["u_mm"] for one in found["points"]), found["misfit"], *found["points"][0]["position_mm"]],
    ),
    "turntable": Instrument(
        "marker,angle_deg,x_mm,y_mm,z_mm",
        lambda rng: mark_rows(rng),
        lambda row, turn, shift: ",".join(_shifted(row.split(","), 2, turn, shift)),
        lambda path: json.loads(turntable(marks=path)[0].content),
        lambda found: np.array([found["axis_point_mm"]]),
        lambda found: [found["u_mm"], found["misfit"], found["direction_u_deg"]],
    ),
    "tracker": Instrument(
        "target,x_mm,y_mm,z_mm,qw,qx,qy,qz,tracker_x_mm,tracker_y_mm,tracker_z_mm",
        tracked_rows,
        lambda row, turn, shift: ",".join(_shifted(row.split(","), 8, turn, shift)),
        lambda path: json.loads(tracker(readings=path)[0].content),
        lambda found: np.array(found["tracker_from_base"])[None, :3, 3],
        lambda found: [
            float(np.sqrt(np.trace(np.array(found["registration_covariance"])[:3, :3]))),
            found["u_mm"],  # holds the residuals' size, which few rows show by chance
            found["misfit"],
            *found["targets"][1]["position_mm"],
        ],
    ),
}
every = pytest.mark.parametrize("name", INSTRUMENTS)


@cache
def as_it_is(name: str) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Rows of an instrument, and what it finds in them."""
    rows = INSTRUMENTS[name].rows(np.random.default_rng(3))
    with TemporaryDirectory() as folder:
        return tuple(rows), asked(Path(folder), name, rows)


def asked(folder: Path, name: str, rows: list[str]) -> dict[str, Any]:
    path = folder / "table.csv"
    path.write_text("\n".join([INSTRUMENTS[name].header, *rows]) + "\n")
    return INSTRUMENTS[name].found(path)


@every
def test_a_rigid_motion_of_the_frame_moves_the_answer_with_it(name: str, tmp_path: Path) -> None:
    one, rng = INSTRUMENTS[name], np.random.default_rng(1)
    turn, shift = Rotation.random(rng=rng), 500.0 * rng.normal(size=3)
    rows, here = as_it_is(name)
    there = asked(tmp_path, name, [one.moved(row, turn, shift) for row in rows])
    np.testing.assert_allclose(one.same(there), one.same(here), rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(one.places(there), turn.apply(one.places(here)) + shift, atol=2e-3)


@every
def test_the_order_of_rows_changes_nothing(name: str, tmp_path: Path) -> None:
    one, (rows, here) = INSTRUMENTS[name], as_it_is(name)
    first, rest = rows[:2], rows[2:]  # whose names come first is the tip
    order = np.random.default_rng(2).permutation(len(rest))
    there = asked(tmp_path, name, [*first, *(rest[k] for k in order)])
    np.testing.assert_allclose(one.same(there), one.same(here), rtol=1e-3, atol=1e-4)


@every
def test_more_rows_never_tell_less(name: str, tmp_path: Path) -> None:
    """Where the residuals are no larger than stated; a misfit makes u larger, of few rows by chance."""
    one, rng = INSTRUMENTS[name], np.random.default_rng(5)
    rows = [*one.rows(rng), *one.rows(rng)]
    few_rows = rows[: len(rows) // 2]
    if name != "tool":  # other markers, other targets: the same names would say that they are the same
        rows = [*few_rows, *("s" + row[1:] for row in rows[len(rows) // 2 :])] if name == "turntable" else rows
    less, more = asked(tmp_path, name, few_rows), asked(tmp_path, name, rows)
    assert one.same(more)[0] <= 1.1 * one.same(less)[0] * np.sqrt(max(1.0, more["misfit"]))


@every
def test_rows_that_err_more_than_stated_are_told_and_widen_u(name: str, tmp_path: Path) -> None:
    one, rng = INSTRUMENTS[name], np.random.default_rng(3)
    rows, calm = as_it_is(name)
    last = -3 if name != "tool" else 2
    worse = []
    for row in rows:
        cells = row.split(",")
        first = last % len(cells)
        worse.append(",".join(_shifted(cells, first, Rotation.identity(), 0.2 * rng.normal(size=3))))
    loud = asked(tmp_path, name, worse)
    assert loud["misfit"] > 4.0 > calm["misfit"]
    assert any("times as far apart as the stated noise says" in words for words in loud["warnings"])
    assert not any("noise" in words for words in calm["warnings"])
    assert one.same(loud)[0] > 2.0 * one.same(calm)[0]


@every
def test_a_blunder_is_left_out_and_told(name: str, tmp_path: Path) -> None:
    """One row, 3 mm off, of twice as many."""
    one, rng = INSTRUMENTS[name], np.random.default_rng(8)
    rows = [*one.rows(rng), *one.rows(rng)] if name != "turntable" else mark_rows(rng, markers=6)
    first = -3 if name != "tool" else 2
    cells = rows[6].split(",")
    rows[6] = ",".join(_shifted(cells, first % len(cells), Rotation.identity(), np.array([0.0, 3.0, 0.0])))
    assert [each["line"] for each in asked(tmp_path, name, rows)["left_out"]] == [8]


@pytest.mark.parametrize("name", ["tool", "turntable"])
def test_rows_written_down_again_count_once(name: str, tmp_path: Path) -> None:
    """Of a tracker's readings a third of their own noise is left, in test_robot.py."""
    one, (rows, found) = INSTRUMENTS[name], as_it_is(name)
    assert one.same(asked(tmp_path, name, [*rows] * 10))[0] > 0.95 * one.same(found)[0]


def test_targets_and_registration_lie_where_they_were_put(tmp_path: Path) -> None:
    """A simulated tracker, its frame the base: three of four errors within what is stated, none beyond 4.5 times."""
    z = []
    for seed in range(8):
        found = asked(tmp_path, "tracker", tracked_rows(np.random.default_rng(seed)))
        covariance = np.array(found["registration_covariance"])
        z += list(np.array(found["tracker_from_base"])[:3, 3] / np.sqrt(np.diag(covariance)[:3]))
        for one, target in zip(found["targets"], TARGETS, strict=True):
            z += list((np.array(one["position_mm"]) - target) / np.sqrt(np.diag(one["covariance_mm2"])))
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.1
    assert np.abs(z).max() < 4.5


def test_blunders_take_no_other_reading_of_their_posture_with_them(tmp_path: Path) -> None:
    """A target that is knocked, once and by 2 mm, and a posture that is 0.8 mm off."""
    rows = tracked_rows(np.random.default_rng(0), 32)
    for row, off in ((22, [1, 1, 0]), (60, [0, -2, 0]), (33, [0.8, 0, 0]), (34, [0.8, 0, 0]), (35, [0.8, 0, 0])):
        rows[row] = ",".join(_shifted(rows[row].split(","), 8, Rotation.identity(), np.array(off)))
    assert sorted(one["line"] for one in asked(tmp_path, "tracker", rows)["left_out"]) == [24, 35, 36, 37, 62]


def test_the_axis_of_two_markers_at_two_angles_is_the_one_that_fits_best(tmp_path: Path) -> None:
    """Another direction, 2 deg off, fits nearly as well: the search must not end there."""
    found = asked(tmp_path, "turntable", mark_rows(np.random.default_rng(22), markers=3, angles=(0, 90)))
    assert np.linalg.norm(np.array(found["axis_point_mm"])[:2] - CENTRE[:2]) < 5.0


def _longer(cells: list[str], first: int) -> list[str]:
    return [*cells[:first], *(f"{1.0001 * float(v):.9f}" for v in cells[first : first + 3]), *cells[first + 3 :]]


def _bent(cells: list[str], share: float) -> list[str]:
    """The flange of a touch with a tool that hangs by 0.1 mm where it lies level."""
    axis = rotation_from_quaternion(np.array([float(one) for one in cells[5:9]]))[:, 2]
    return _shifted(cells, 2, Rotation.identity(), 0.1 * (np.eye(3)[2] - axis[2] * axis))


def _drifted(cells: list[str], share: float) -> list[str]:
    return _shifted(cells, 2, Rotation.identity(), np.array([0.0, 0.0, 0.1 * (share - 0.5)]))


def _places(found: dict[str, Any]) -> dict[str, Float]:
    """What a calibration found, by the names that it has in words."""
    if "points" in found and isinstance(found["points"], list):
        return {f"tool point '{one['name']}'": np.array(one["position_mm"]) for one in found["points"]}
    if "axis_point_mm" in found:
        point, along = np.array(found["axis_point_mm"]), np.array(found["axis_direction"])
        return {"axis": np.array([point + reach * along for reach in (-200.0, 200.0)])}
    return {one["name"]: np.atleast_1d(one["value_mm"]) for one in found["parameters"] if "value_mm" in one}


@pytest.mark.parametrize(
    ("table", "word", "changed"),
    [
        ("touches", "weight", _bent),
        ("touches", "lengths", lambda cells, share: _longer(cells, 2)),
        ("marks", "drift", _drifted),
        ("tracker", "scale", lambda cells, share: _longer(cells, 7)),
    ],
)
def test_what_an_error_would_change_is_what_it_changes(
    table: str, word: str, changed: Callable[[list[str], float], list[str]], tmp_path: Path
) -> None:
    """No residual shows it, or it is too small: its size stands in the result."""
    folder = Path(__file__).parents[3] / "data"
    source = folder / "calibration" / f"{table}.csv"
    head, *rows = [line for line in source.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    errs = [",".join(changed(row.split(","), k / (len(rows) - 1))) for k, row in enumerate(rows)]
    (tmp_path / "errs.csv").write_text("\n".join([head, *errs]) + "\n", encoding="utf-8")
    stages: dict[str, Callable[[Path], Any]] = {
        "touches": lambda path: tcp(touches=str(path)),
        "marks": lambda path: turntable(marks=str(path)),
        "tracker": lambda path: tracker(readings=str(path), cell=str(folder / "robot" / "cell.json")),
    }
    before, after = (json.loads(stages[table](path)[0].content) for path in (source, tmp_path / "errs.csv"))
    said = next(one for one in before["not_included"] if word in one)
    name, size = said.split(": the ")[1].split(" mm")[0].split(" by ")
    moved = np.atleast_2d(_places(after)[name] - _places(before)[name])
    assert np.linalg.norm(moved, axis=1).max() == pytest.approx(abs(float(size)), abs=0.01)


def test_a_tool_that_hangs_by_its_weight_is_told_and_taken_out(tmp_path: Path) -> None:
    """By 0.3 mm where it lies level, in 40 touches: 5 u off, where nobody asks for it."""
    rows = [",".join(_bent(row.split(","), 0.0)) for row in touch_rows(np.random.default_rng(3), 40)]
    for _ in range(2):
        rows = [",".join(_bent(row.split(","), 0.0)) for row in rows]
    found = asked(tmp_path, "tool", rows)
    assert "gives way to its weight" in found["warnings"][0]
    assert float(found["warnings"][0].split(" by ")[1].split(" mm")[0]) == pytest.approx(0.3, abs=0.08)
    for point, truth in zip(found["points"], (TIP, SHANK), strict=True):
        off = np.array(point["position_mm"]) - truth
        assert off @ np.linalg.solve(point["covariance_mm2"], off) < 16.0
