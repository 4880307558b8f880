"""A turntable on an axis that tilts it: planned along a path, written, read back, and driven by an outsider."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench import path, program
from workbench.artefacts import (
    Gate,
    Judgement,
    Moves,
    PathGate,
    Postures,
    ProgramMoves,
    Toolpath,
)
from workbench.errors import InputError
from workbench.plugins import stiffness
from workbench.robot import Cell, read_cell
from workbench.units import Float

from .paths import Shape, mill_path, moved, thinned, to_polyline
from .postured import DATA, URDFS, by_an_outsider

TILT_AT, TABLE_ABOVE = np.array([0.0, 0.0, -180.0]), np.array([0.0, 0.0, 120.0])
ROBOTS = {  # URDF, base frame, home, and where the table is, mm
    "abb": (DATA / "irb6700_150_320.urdf", "base_link", (0, -20, 20, 0, 30, 0), (1800, 100, 800)),
    "kuka": (URDFS / "kr210.urdf", "base_link", (0, -100, 110, 0, 60, 0), (1800, 100, 800)),
    "fanuc": (URDFS / "m20ia.urdf", "base", (0, 0, 0, 0, -60, 0), (1050, 50, 100)),
}
TILT_AXIS = np.array([0.0, 1.0, 0.0])
TURN_FIRST = [float(np.sqrt(0.5)), -float(np.sqrt(0.5)), 0.0, 0.0]  # z of the tilt's frame along the base's y


def positioner(folder: Path, dialect: str, change: Callable[[dict[str, Any]], Any] = lambda tree: None) -> Cell:
    """A cell whose table of 300 mm stands on a cradle, which tilts about the base's y below it."""
    tree = json.loads((DATA / "cell.json").read_text())
    urdf, base, home, table = ROBOTS[dialect]
    for key in ("envelope", "fixtures"):
        del tree[key]
    tree["robot"] |= {"urdf": str(urdf), "base_frame": base}
    tree["controller"] = {"dialect": dialect}
    tree["turntable"] = {
        "base_from_turntable": {"position_mm": list(map(float, table))},
        "speed_deg_s": 30,
        "acceleration_deg_s2": 60,
        "shapes": [{"pose": {"position_mm": [0, 0, -20]}, "cylinder_mm": [150, 40]}],
        "tilt": {
            "base_from_tilt": {"position_mm": (np.array(table) + TILT_AT).tolist(), "quaternion_wxyz": TURN_FIRST},
            "limits_deg": [-70, 70],
            "speed_deg_s": 20,
            "acceleration_deg_s2": 40,
            "shapes": [{"box_mm": [120, 120, 300]}],
        },
    }
    below = [table[0], table[1], table[2] - 600.0]
    tree["fixtures"] = [{"name": "stand", "pose": {"position_mm": below}, "box_mm": [400, 400, 200]}]
    tree["process"] = {"home": {"joints_deg": home}, "probe": {"distance_mm": 60}}
    change(tree)
    file = folder / f"{dialect}.json"
    file.write_text(json.dumps(tree))
    return read_cell(file)


def edge(cell: Cell, lean: float = 0.0, bend: float = 0.0, every: int = 3) -> Toolpath:
    """An edge of 120 mm above the table's middle, on an arc in an upright plane; `lean`: turned about the base's y."""
    plan = mill_path(Shape(length_mm=120, layers=1, turn=(np.pi / 2, 0, 0) if bend else (0, 0, 0.5), bend=bend))
    some = np.r_[0:11, 10 + every : 130 : every, 130:141]
    plan = thinned(plan, some)
    place = np.eye(4)
    place[:3, :3] = Rotation.from_rotvec([0, lean, 0]).as_matrix()
    middle = plan.layers[0].position_mm.mean(axis=0)
    place[:3, 3] = cell.turntable.base_from_turntable[:3, 3] + TABLE_ABOVE - place[:3, :3] @ middle
    return moved(plan, place)


def planned(cell: Cell, plan: Toolpath, springs: Any = None, **more: Any) -> tuple[Postures, PathGate, dict[str, Any]]:
    force, _ = stiffness.force(plan, None, cell)
    at = {"cutter_rotation_deg": (-180, 180), "turntable_deg": (-90, 90), "tilt_deg": (-30, 30), "step_deg": 20.0}
    at |= {"whole_map": False, "sampled_points": 10} | more
    postures, gate, document, page = stiffness.posture(cell, springs, plan, force, path.check_file(plan), **at)
    return postures, gate, json.loads(document.content) | {"page": page.html}


def written(cell: Cell, plan: Toolpath, postures: Postures, gate: PathGate) -> tuple[Moves, ProgramMoves, str]:
    """The moves, the program as read back from its files, and their text."""
    moves = path.simplify(plan, postures)
    made = program.write(moves, gate, cell)
    (judged,) = (one for one in made if isinstance(one, Judgement))
    assert next(one for one in made if isinstance(one, Gate)).passed
    written = (one for one in made if getattr(one, "name", "").endswith(("mod", "src", "dat", "ls")))
    return moves, judged.program, "".join(one.content.decode() for one in written)


def on_part(cell: Cell, external_deg: Float) -> Float:
    """Motions (n, 4, 4) of the part, by turns about lines in the base: the turntable's, then the tilt's."""
    found = np.tile(np.eye(4), (len(external_deg), 1, 1))
    table = cell.turntable.base_from_turntable[:3, 3]
    for axis, at, values in (
        (TILT_AXIS, table + TILT_AT, external_deg[:, 0]),
        (np.array([0, 0, 1]), table, external_deg[:, 1]),
    ):
        turn = np.tile(np.eye(4), (len(values), 1, 1))
        turn[:, :3, :3] = Rotation.from_rotvec(np.radians(values)[:, None] * axis).as_matrix()
        turn[:, :3, 3] = at - turn[:, :3, :3] @ at
        found = found @ turn
    return found


@pytest.fixture(scope="module")
def law(tmp_path_factory: Any) -> Any:
    """Postures with both axes turning along the path."""
    cell = positioner(tmp_path_factory.mktemp("law"), "abb")
    plan = edge(cell, 1.2, 1 / 100)

    def ways(_: Cell, points: Any, *__: object) -> Iterator[Any]:
        turning = np.radians(np.linspace((25.0, 0.0), (40.0, 4.0), len(points.layer)))
        yield replace(points, drift=turning)

    grid = {"cutter_rotation_deg": (-90, -50), "turntable_deg": (-100, -70), "step_deg": 2.0}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("workbench.plugins.stiffness.posture_stage._ways", ways)
        return cell, plan, *planned(cell, plan, stiffness.read(joint_stiffness_nm_per_rad=(4e6,) * 6), **grid)


@pytest.fixture(scope="module")
def milled(law: Any) -> tuple[Moves, ProgramMoves, str]:
    cell, plan, postures, gate, _ = law
    return written(cell, plan, postures, gate)


def test_both_axes_turn_along_the_path(law: Any) -> None:
    cell, _, postures, gate, document = law
    assert gate.passed
    span = np.degrees(np.ptp(postures.turntable, axis=0))
    assert span[0] > 10
    assert span[1] > 0
    for axis, values in zip(cell.axes, postures.turntable.T, strict=True):
        assert axis.limits[0] < values.min() <= values.max() < axis.limits[1]
    rows = [[row["tilt_deg"], row["turntable_deg"]] for row in document["points"]]
    assert np.array(rows) == pytest.approx(np.degrees(postures.turntable[postures.layer > 0]), abs=1e-5)


def test_the_outsider_finds_the_law_on_the_edge_and_clear_of_everything(law: Any, milled: Any) -> None:
    """Driven in fine steps by other formulas: the tool as the part sees it, and the bodies."""
    cell, plan, _, gate, _ = law
    moves, read, _ = milled
    on_path, outsider, joints, tables = by_an_outsider(cell, read)
    assert np.degrees([move.turntable for move in on_path]) == pytest.approx(moves.turntable_deg, abs=1e-3)
    flange = outsider.links(joints)[:, 6] @ outsider.tip
    seen = np.linalg.inv(on_part(cell, tables)) @ flange
    axis = seen[:, :3, 3] - plan.cutter.diameter_mm / 2 * seen[:, :3, 0]
    layer = plan.layers[0]
    x = Rotation.from_quat(layer.quaternion_wxyz, scalar_first=True).as_matrix()[:, :, 0]
    wanted = layer.position_mm - plan.cutter.diameter_mm / 2 * x
    off, share = to_polyline(axis, wanted)
    cutting = (share > 0) & (share < 1) & (off < 5)  # else it comes or goes
    assert cutting.sum() > 200
    assert off[cutting].max() < gate.tolerance_mm
    assert to_polyline(wanted, axis)[0].max() < gate.tolerance_mm


@pytest.fixture(scope="module")
def plain(tmp_path_factory: Any) -> Any:
    """An edge, and postures for it, where the cell asks for no process."""
    cell = positioner(tmp_path_factory.mktemp("plain"), "abb", lambda tree: tree.update(process=None))
    plan = edge(cell)
    return cell, plan, *planned(cell, plan)


@pytest.mark.parametrize("dialect", ["abb", "kuka", "fanuc"])
def test_every_language_says_both_axes(tmp_path: Path, dialect: str) -> None:
    cell = positioner(tmp_path, dialect, lambda tree: tree["process"]["home"].update(tilt_deg=5.0))
    plan = edge(cell)
    postures, gate, document = planned(cell, plan)
    tilt, table = np.degrees(postures.turntable[0])
    assert (document["constant"]["tilt_deg"], document["constant"]["turntable_deg"]) == pytest.approx((tilt, table))
    assert f"The turntable is tilted by {tilt:g}°." in document["page"]
    moves, read, text = written(cell, plan, postures, gate)
    said = {
        "abb": f"[{tilt:.4f},{table:.4f},9E+09,",
        "kuka": f",E1 {tilt:.4f},E2 {table:.4f}}}",
        "fanuc": f"J1= {tilt:.3f} deg,\tJ2= {table:.3f} deg",
    }
    assert text.replace("\r", "").count(said[dialect]) >= len(moves.layer)
    assert "External axes: 1 the tilt, 2" in text
    values = np.degrees([move.turntable for move in read.moves])
    assert values[0] == pytest.approx([5.0, table], abs=1e-3)  # home
    assert values[2:-1] == pytest.approx(np.tile([tilt, table], (len(values) - 3, 1)), abs=1e-3)


def test_the_tilt_is_the_best_of_all_that_were_asked_for(plain: Any) -> None:
    """Each tilt alone, by a cell whose table stands as tilted by it: none is better, one is equal."""
    cell, plan, *_ = plain
    found = planned(cell, plan, tilt_step_deg=60.0, step_deg=30.0)[2]["constant"]
    each = {tilt: planned(cell, plan, tilt_deg=(tilt, tilt), step_deg=30.0)[2]["constant"] for tilt in (-30, 30)}
    alone = {tilt: one["mean_awkwardness"] for tilt, one in each.items()}
    assert found["mean_awkwardness"] == pytest.approx(min(alone.values()))
    assert alone[round(found["tilt_deg"])] == min(alone.values())


def test_what_the_tilt_cannot_do_is_refused_by_its_name(law: Any, milled: Any) -> None:
    cell, _, postures, gate, _ = law
    moves, read, _ = milled
    tilt, least = cell.turntable.on, float(postures.turntable[:, 0].min())
    for kind, change in (
        ("limit", {"limits": np.array([least + np.radians(1), 2.0])}),
        ("speed", {"speed": np.radians(0.05)}),
        ("acceleration", {"acceleration": 1e-4}),
    ):
        less = replace(cell, turntable=replace(cell.turntable, on=replace(tilt, **change)))
        found = less.judge(read, moves, gate.tolerance_mm, lambda *_: None)
        assert {one.kind for one in found.violations} == {kind}
        assert all(one.finding.startswith("the tilt") for one in found.violations)


def test_a_program_for_another_number_of_axes_is_not_driven(law: Any, milled: Any) -> None:
    cell, _, _, gate, _ = law
    moves, read, _ = milled
    alone = replace(cell, turntable=replace(cell.turntable, on=None))
    (found,) = alone.judge(read, moves, gate.tolerance_mm, lambda *_: None).violations
    assert found.finding == "the program drives 2 external axes, the cell has 1"


@pytest.mark.parametrize("controller", ["ur", "yaskawa", "trajectory"])
def test_languages_that_drive_one_axis_refuse_two_in_one_line(plain: Any, controller: Any) -> None:
    cell, plan, postures, gate, _ = plain
    with pytest.raises(InputError, match=f"turntable.tilt: expected none for {controller}") as told:
        program.write(path.simplify(plan, postures), gate, cell, controller=controller)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t["turntable"]["tilt"].update(limits_deg=[-1.570796, 1.570796]), r"tilt.limits_deg.*radians"),
        (lambda t: t["turntable"]["tilt"].update(acceleration_deg_s2=0.5), r"tilt.acceleration_deg_s2.*rad/s"),
        (lambda t: t["turntable"]["tilt"]["base_from_tilt"].update(position_mm=[1.8, 0.1, 0.6]), "base_from_tilt"),
        (lambda t: t["turntable"].pop("tilt") and t["process"]["home"].update(tilt_deg=5), "has no tilt"),
        (lambda t: t["turntable"].pop("tilt") and t["fixtures"][0].update(on="tilt"), "the cell has no tilt"),
    ],
)
def test_a_tilt_that_cannot_be_is_refused(tmp_path: Path, change: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        positioner(tmp_path, "abb", change)


def test_the_part_may_have_been_scanned_tilted(plain: Any) -> None:
    """The same part, planned where a tilt of 10 deg had it, is milled in the same postures."""
    cell, plan, first, *_ = plain
    tilted = moved(plan, on_part(cell, np.array([[10.0, 0.0]]))[0])
    again = planned(cell, tilted, planned_tilt_deg=10.0)[0]
    assert again.joints == pytest.approx(first.joints, abs=1e-6)
    with pytest.raises(InputError, match="planned_tilt_deg: expected a tilt of 0"):
        planned(replace(cell, turntable=replace(cell.turntable, on=None)), plan, planned_tilt_deg=10.0)
