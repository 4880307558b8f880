"""Loading tests that are not what six springs and the cell file say: named, and right within u or refused."""

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.seldom import seldom
from workbench.errors import InputError
from workbench.plugins import stiffness
from workbench.robot import Cell, forward_kinematics, joint_axes

from .conftest import ROOT, K

Change = Callable[[Any, Cell], Any]


def lever(mm: float) -> Change:
    """The sensor stands `mm` nearer along z than the cell file says."""

    def change(tests: Any, cell: Cell) -> Any:
        wrench = tests.wrench.copy()
        wrench[:, 3:] += np.cross([0.0, 0.0, mm / 1e3], wrench[:, :3])
        return dataclasses.replace(tests, wrench=wrench)

    return change


def moved(tests: Any, by_mm: Any) -> Any:
    rows = np.tile(by_mm, tests.points) if tests.points else np.hstack([by_mm, 0 * by_mm])
    return dataclasses.replace(tests, moved=tests.moved + rows)


def giving(um_per_n: float) -> Change:
    def change(tests: Any, cell: Cell) -> Any:
        sensor = (forward_kinematics(cell.chain, tests.joints) @ cell.loading.flange_from_sensor)[:, :3, :3]
        return moved(tests, 1e-3 * um_per_n * (sensor @ tests.wrench[:, :3, None])[..., 0])

    return change


def channels(*factors: float) -> Change:
    return lambda tests, cell: dataclasses.replace(tests, wrench=tests.wrench * factors)


def forces(factor: float) -> Change:
    return channels(*[factor] * 3, 1.0, 1.0, 1.0)


def links(share: float) -> Change:
    """Links give across their joints' axes, by a share of what the joint gives: to first order, of the tool frame."""

    def change(tests: Any, cell: Cell) -> Any:
        axes, points = joint_axes(cell.chain, tests.joints)
        flange = forward_kinematics(cell.chain, tests.joints)
        sensor, tool = flange @ cell.loading.flange_from_sensor, flange @ cell.loading.flange_from_tool
        force, moment = np.swapaxes(sensor[:, None, :3, :3] @ tests.wrench.reshape(-1, 2, 3, 1), 0, 1)[..., 0]
        about = np.cross(sensor[:, None, :3, 3] - points, force[:, None]) / 1e3 + moment[:, None]
        about -= np.sum(about * axes, axis=2, keepdims=True) * axes
        turn = share / K[:, None] * about
        way = np.cross(turn, tool[:, None, :3, 3] - points).sum(axis=1)
        return dataclasses.replace(tests, moved=tests.moved + np.hstack([way, turn.sum(axis=1)]))

    return change


def offset_n(newton: float) -> Change:
    return lambda tests, cell: dataclasses.replace(tests, wrench=tests.wrench + newton * np.eye(6)[2])


def backlash(mm: float) -> Change:
    def change(tests: Any, cell: Cell) -> Any:
        return moved(tests, mm * np.sign(tests.vectors[:, : tests.points or 1].mean(axis=1)))

    return change


def turned_joint(joint: int, deg: float) -> Change:
    return lambda tests, cell: dataclasses.replace(tests, joints=tests.joints + np.radians(deg) * np.eye(6)[joint - 1])


def shifted(*by: tuple[Any, Any, float]) -> Change:
    """Rows and columns of what moved, and by how much more."""

    def change(tests: Any, cell: Cell) -> Any:
        moved = tests.moved.copy()
        for rows, columns, more in by:
            moved[rows, columns] += more
        return dataclasses.replace(tests, moved=moved)

    return change


SELDOM = dict.fromkeys(("forces 15 % too large", "offset of 25 N"), pytest.mark.slow)  # large ones: below
SMALL: list[tuple[str, Change, str]] = [
    ("sensor 60 mm nearer", lever(60.0), "the force sensor -"),
    ("base that gives", giving(0.1), "a base or links that give by +0."),
    ("forces 15 % too large", forces(1.15), "forces that need -"),
    ("offset of 25 N", offset_n(25.0), "along the sensor's z axis in every load"),
    ("joint 3 off by 3 deg", turned_joint(3, 3.0), "off its recorded angle"),
    ("backlash of 0.02 mm", backlash(0.02), "backlash: +0.0"),
]


ALONE: list[tuple[str, int, Change, str, int]] = [
    ("point off the body", 4, shifted((10, 6, 0.3)), "line 12: point p3 does not move with the others", 72),
    ("gross loads", 0, shifted((7, 2, 1.0), (31, 1, -2.0)), "line 33: this load contradicts the others", 70),
    ("drift in a posture", 0, shifted((slice(24, 48), 0, 0.05)), "mm along x in every load of posture 2 (", 72),
]


@pytest.mark.parametrize(
    ("targets", "change", "words", "loads"),
    [
        *(
            pytest.param(4 * (k % 2), *one[1:], None, id=one[0], marks=SELDOM.get(one[0], ()))
            for k, one in enumerate(SMALL)
        ),
        *(pytest.param(*one[1:], id=one[0]) for one in ALONE),
    ],
)
def test_small_faults_stand_in_u_and_are_named(identified, cell, noisy, targets, change, words, loads):
    found, _ = identified(change(noisy(61, targets), cell))
    assert (np.abs(found.nm_per_rad - K) < 4 * found.u_nm_per_rad).all()
    assert any(words in note for note in found.warnings), found.warnings
    assert loads in (None, found.loads)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (forces(2.0), "forces that need -"),
        *seldom((offset_n(300.0), "N along the sensor's z axis in every load")),
    ],
)
def test_large_faults_are_refused_with_what_would_explain_them(identified, cell, noisy, change, words):
    with pytest.raises(InputError, match="what would") as caught:
        identified(change(noisy(62, 0, 2), cell))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_scale_that_nothing_shows_stands_in_u_and_is_told_where_it_is_declared_exact(identified, noisy):
    tests = noisy(63)
    blind, notes = identified(tests, scale_relative_u=0.0)
    gain, *others = notes["not_included"]
    (times,) = re.findall(r"gain .* by 1 % \((\S+) u of joint", gain)
    high = dataclasses.replace(tests, wrench=1.05 * tests.wrench)
    off = np.abs(identified(high, scale_relative_u=0.0)[0].nm_per_rad - blind.nm_per_rad) / blind.u_nm_per_rad
    assert off.max() == pytest.approx(5 * float(times), rel=0.1)
    kinds = ["the force sensor's place", "the force sensor's axes", "the place of what is tracked"]
    kinds += ["the forces' gain against the torques'", "a channel's gain", "a joint's zero"]
    assert [one.split(":")[0] for one in others] == kinds
    told, notes = identified(tests)
    assert notes["not_included"] == others
    more = told.u_nm_per_rad**2 - blind.u_nm_per_rad**2
    assert np.sqrt(more) == pytest.approx(0.02 * told.nm_per_rad, rel=0.05)
    assert (np.abs(identified(high)[0].nm_per_rad - K) < 3 * told.u_nm_per_rad).all()


@pytest.mark.parametrize(("joint", "targets"), [(2, 0), (3, 4), *seldom((4, 0), (5, 4), (6, 0))])
def test_a_zero_that_is_2_deg_off_is_within_3_u(identified, cell, noisy, joint, targets):
    """Whether it is named or not; as built they are known to 0.3 deg."""
    found, _ = identified(turned_joint(joint, 2.0)(noisy(64, targets), cell))
    assert (np.abs(found.nm_per_rad - K) < 3 * found.u_nm_per_rad).all()


@pytest.mark.parametrize("targets", [0, 4])
def test_a_channel_that_is_5_percent_off_is_within_4_u_and_its_size_is_told(identified, cell, noisy, targets):
    tests = noisy(61, targets)
    (sound, _), (found, notes) = (identified(one) for one in (tests, channels(1, 1, 1, 1, 1, 0.95)(tests, cell)))
    assert (np.abs(found.nm_per_rad - K) < 4 * found.u_nm_per_rad).all()
    told = re.findall(
        r"1 % of the torque along the sensor's z axis changes joint 6 by (\S+) %", str(notes["not_included"])
    )
    assert 5 * float(told[0]) == pytest.approx(100 * abs(found.nm_per_rad / sound.nm_per_rad - 1)[5], rel=0.3)


def test_links_that_give_across_their_joints_are_told_with_their_size_and_stand_in_u(identified, cell, noisy):
    found, _ = identified(links(0.2)(noisy(65), cell))
    (size,) = re.findall(r"links that give across .* by some (\S+) % of what these give", " ".join(found.warnings))
    assert 10.0 < float(size) < 40.0
    assert (np.abs(found.nm_per_rad - K) < 3 * found.u_nm_per_rad).all()


# Files: what only their figures tell.


@pytest.fixture
def written(tmp_path: Path) -> Callable[[Callable[[list[str], Any], Any]], Path]:
    """The shipped tests with their table changed: `change(header, values)` gives the new values."""

    def write(change: Callable[[list[str], Any], Any]) -> Path:
        lines = (ROOT / "data" / "synthetic" / "loads.csv").read_text().splitlines()
        header = lines[1].split(",")
        values = change(header, np.array([[float(cell) for cell in line.split(",")] for line in lines[2:]]))
        path = tmp_path / "loads.csv"
        rows = [f"{row[0]:.0f}," + ",".join(f"{value:.6f}" for value in row[1:]) for row in values]
        path.write_text("\n".join([lines[1], *rows]) + "\n")
        return path

    return write


def test_loads_that_stand_twice_count_once(cell: Cell, written: Any) -> None:
    once, *_ = stiffness.identify(cell, loads=written(lambda header, values: values))
    twice, *_ = stiffness.identify(cell, loads=written(lambda header, values: np.vstack([values, values])))
    assert twice.u_nm_per_rad == pytest.approx(once.u_nm_per_rad, rel=1e-9)
    assert any("counted once" in note for note in twice.warnings)


def scaled_columns(names: str, factor: float) -> Callable[[list[str], Any], Any]:
    def change(header: list[str], values: Any) -> Any:
        values[:, [i for i, name in enumerate(header) if name[0] in names and name[1] in "xyz"]] *= factor
        return values

    return change


@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        (1 / 9.80665, r"0\.1 times .* states: is the wrench in kgf"),
        *seldom((1 / 4.44822, r"0\.2[23] times .* states: is the wrench in lbf")),
    ],
)
def test_the_unit_that_the_stated_stiffness_tells_is_named_first(cell, written, factor, cause):
    with pytest.raises(InputError, match=cause) as told:
        stiffness.identify(cell, loads=written(scaled_columns("ft", factor)))
    assert len(told.value.expected.replace(cell.source, "cell.json")) <= 200


def test_a_sensor_at_the_end_of_its_range_is_refused(cell: Cell, written: Any) -> None:
    def clipped(header: list[str], values: Any) -> Any:
        return np.column_stack([values[:, :7], np.clip(values[:, 7:10], -130.0, 130.0), values[:, 10:]])

    with pytest.raises(InputError, match=r"column f._n stands at 130 to the last figure in \d+ loads"):
        stiffness.identify(cell, loads=written(clipped))


def test_weights_that_are_written_down_are_no_clipped_readings(cell: Cell, exact: Any, tmp_path: Path) -> None:
    """200 N along three axes at four points, exact in the file: nothing is rounded, nothing at the end of a range."""
    tests, rng = exact(), np.random.default_rng(8)
    noise = rng.normal(size=(72, 6)) * ([0.01] * 3 + [0.002] * 3)
    table = np.column_stack(
        [np.degrees(tests.joints), tests.wrench, tests.moved * ([1.0] * 3 + [180 / np.pi] * 3) + noise]
    )
    header = (ROOT / "data" / "synthetic" / "loads.csv").read_text().splitlines()[1]
    rows = [f"{label}," + ",".join(f"{v:.6f}" for v in row) for label, row in zip(tests.labels, table, strict=True)]
    (tmp_path / "weights.csv").write_text("\n".join([header, *rows]) + "\n")
    found, *_ = stiffness.identify(cell, loads=tmp_path / "weights.csv")
    assert (np.abs(found.nm_per_rad - K) < 4 * found.u_nm_per_rad).all()
    assert (found.u_nm_per_rad < 0.1 * K).all()


def test_figures_rounded_coarsely_are_refused(cell: Cell, written: Any) -> None:
    with pytest.raises(InputError, match=r"rounded to 0\.1 mm, where the cell file states a noise of 0\.01"):
        stiffness.identify(
            cell, loads=written(lambda _, values: np.column_stack([values[:, :13], values[:, 13:].round(1)]))
        )


def test_a_column_of_zeros_is_named(cell: Cell, written: Any) -> None:
    def empty(header: list[str], values: Any) -> Any:
        values[:, header.index("rx_deg")] = 0.0
        return values

    with pytest.raises(InputError, match="column rx_deg is 0 in every load"):
        stiffness.identify(cell, loads=written(empty))


def test_a_sensor_far_from_its_place_is_named_beside_other_priors(identified: Any, noisy: Any, cell: Cell) -> None:
    """60 mm, where 1 mm is assumed: what else may be off explains it in part."""
    named = 0
    for seed in range(4):
        found = identified(lever(60.0)(noisy(seed), cell))[0]
        named += any("the force sensor" in words for words in found.warnings)
    assert named > 2
