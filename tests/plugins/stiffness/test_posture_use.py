"""What postures are for: a program that the robot can run as it stands, and a path that allows for deflection."""

import csv
import dataclasses
import io
from collections.abc import Iterator

import numpy as np
import pytest

from workbench.api import inverse, pose_from, rotation_from_quaternion
from workbench.artefacts import PathGate, Toolpath
from workbench.errors import InputError
from workbench.path import read, simplify
from workbench.plugins.stiffness import compensate, force, posture, predict
from workbench.plugins.stiffness.elastic import balance, way
from workbench.plugins.stiffness.path_points import PathPoints
from workbench.plugins.stiffness.values import JointStiffness, MillingForce
from workbench.program import write
from workbench.robot import Cell, Shape, forward_kinematics, turntable_pose
from workbench.robot.cell_file import ProbePart
from workbench.robot.cell_model import ON_BASE
from workbench.robot.process import drawn_back
from workbench.twin.mill_stage import read_deflections

from .test_posture import PATH, thinned


def free(path: Toolpath, *, reached: bool = True) -> PathGate:
    return PathGate(True, "", toolpath=path, tolerance_mm=0.05, reached=reached)


@pytest.fixture(scope="module")
def path() -> Toolpath:
    """The last two layers with their travels, one point in three."""
    whole = read(toolpath=PATH)
    layers = tuple(thinned(dataclasses.replace(whole, layers=(layer,)), 3).layers[0] for layer in whole.layers[-2:])
    return dataclasses.replace(whole, layers=layers, travels=whole.travels[-3:])


@pytest.fixture(scope="module")
def acts(path: Toolpath) -> MillingForce:
    return force(path)[0]


@pytest.fixture(scope="module", params=[0.0, 3.0], ids=["standing", "turning"])
def made(request, cell, path, acts, stiffness):
    """With a turntable that stands, and with one that goes along as a track would: by so many deg in all."""

    def ways(_: Cell, points: PathPoints, *__: object) -> Iterator[PathPoints]:
        yield dataclasses.replace(points, drift=np.radians(np.linspace(0.0, request.param, len(points.layer))))

    angles = {"cutter_rotation_deg": (70, 100), "turntable_deg": (-85, -65)}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("workbench.plugins.stiffness.posture_stage._ways", ways)
        return posture(cell, stiffness, path, acts, whole_map=False, **angles)[0]


def test_postures_of_another_path_are_refused(made, path, cell, acts, stiffness):
    other = dataclasses.replace(path)
    with pytest.raises(InputError, match="another path"):
        simplify(other, made)
    with pytest.raises(InputError, match="another path"):
        predict(cell, stiffness, other, acts, made)


def test_prediction_is_the_balance_of_springs(made, path, cell, acts, stiffness):
    """Springs and load in balance, solved by Newton, at some points; the linear prediction errs by their curvature."""
    found = predict(cell, stiffness, path, acts, made)[0]
    layer, forces = path.layers[-1], acts.layers[-1]
    here = np.flatnonzero(made.layer == layer.index)
    for i in (10, 25, 40):
        q, table = made.joints[here[i]], made.turntable[here[i]]
        turned = turntable_pose(cell, table) @ inverse(turntable_pose(cell, 0.0))
        point = turned @ pose_from(rotation_from_quaternion(layer.quaternion_wxyz[i]), layer.position_mm[i])
        local = (inverse(forward_kinematics(cell.chain, q)) @ point)[:3, 3]
        wrench = np.append(point[:3, :3] @ forces.mean_n[i], np.zeros(3))
        moved = way(cell.chain, q, balance(cell.chain, 1 / stiffness.nm_per_rad, q, local, wrench), local)[:3]
        assert np.linalg.norm(moved) > 0.05
        assert np.allclose(found.by_layer_mm[layer.index][i], point[:3, :3].T @ moved, rtol=0, atol=2e-4)


def test_compensated_path_gives_way_to_the_planned_one(made, path, cell, acts, stiffness):
    found, document = predict(cell, stiffness, path, acts, made)
    moved = compensate(path, found)
    for layer, other in zip(path.layers, moved.layers, strict=True):
        turn = rotation_from_quaternion(layer.quaternion_wxyz)
        back = other.position_mm + (turn @ found.by_layer_mm[layer.index][:, :, None])[:, :, 0]
        assert np.allclose(back, layer.position_mm, atol=1e-9)
        gave = np.linalg.norm(other.position_mm - layer.position_mm, axis=1)
        assert (gave[~layer.cutting] == 0).all()
        assert gave[layer.cutting].min() > 0.01
    rows = list(csv.reader(io.StringIO(document.content.decode())))
    assert rows[0] == ["layer", "point", "dx_mm", "dy_mm", "dz_mm"]
    assert len(rows) == 1 + sum(len(layer.cutting) for layer in path.layers)


def test_twin_reads_the_predictions_file(made, path, cell, acts, stiffness, tmp_path):
    from pathlib import Path

    found, document = predict(cell, stiffness, path, acts, made)
    file = Path(str(tmp_path)) / document.name
    file.write_bytes(document.content)
    for index, moved in read_deflections(file, path.layers).items():
        assert np.allclose(moved, found.by_layer_mm[index], atol=1e-6)


def test_a_posture_from_which_no_way_leads_home_is_not_proposed(cell: Cell, stiffness: JointStiffness) -> None:
    """A post between home and the optimum, far from the path: the judge refuses that, and another is proposed."""
    path = thinned(read(toolpath=PATH), 3)
    acts, coarse = force(path)[0], {"whole_map": False, "step_deg": 30.0}
    best = posture(cell, stiffness, path, acts, **coarse)[0]
    home, off = np.radians(cell.process.home.joints_deg), drawn_back(cell, best.joints[0], cell.process.approach_mm)
    pose = np.eye(4)
    pose[:3, 3] = (forward_kinematics(cell.chain, (home + off) / 2) @ cell.flange_from_cutter)[:3, 3]
    post = Shape("post", ON_BASE, "box", (60.0, 60.0, 60.0), pose)
    blocked = dataclasses.replace(cell, shapes=(*cell.shapes, post))
    other = posture(blocked, stiffness, path, acts, **coarse)[0]
    for postures, passes in ((best, False), (other, True)):
        assert write(simplify(path, postures), free(path), blocked, root_tolerance_mm=3)[-3].passed is passes
    assert np.linalg.norm(other.displacement_mm, axis=1).mean() >= np.linalg.norm(best.displacement_mm, axis=1).mean()


def test_a_posture_from_which_nobody_could_look_is_not_proposed(cell: Cell, stiffness: JointStiffness) -> None:
    """A post beside the place of the probe, above the first point that cuts: behind a lead of half the path."""
    whole = thinned(read(toolpath=PATH), 3)
    layer = whole.layers[0]
    cuts = len(layer.cutting) // 2
    late = dataclasses.replace(layer, cutting=layer.cutting & (np.arange(len(layer.cutting)) >= cuts))
    path, coarse = dataclasses.replace(whole, layers=(late,)), {"whole_map": False, "step_deg": 30.0}
    process = cell.process.model_copy(update={"probe": ProbePart(distance_mm=700)})
    acts, probing = force(path)[0], dataclasses.replace(cell, process=process)
    best = posture(probing, stiffness, path, acts, **coarse)[0]
    off = drawn_back(cell, best.joints[cuts], 700)
    pose = forward_kinematics(cell.chain, off) @ cell.flange_from_cutter
    pose[:3, 3] += 40 * pose[:3, 0]
    pose[:3, :3] = np.eye(3)
    blocked = dataclasses.replace(probing, shapes=(*cell.shapes, Shape("post", ON_BASE, "box", (20.0,) * 3, pose)))
    other = posture(blocked, stiffness, path, acts, **coarse)[0]
    for postures, passes in ((best, False), (other, True)):
        assert write(simplify(path, postures), free(path), blocked, root_tolerance_mm=3)[-3].passed is passes


def test_a_home_within_the_margin_of_a_limit_is_refused(cell, path, acts, stiffness):
    home = cell.process.home.model_copy(update={"joints_deg": (0.0, -20.0, 69.0, 0.0, 30.0, 0.0)})
    near = dataclasses.replace(cell, process=cell.process.model_copy(update={"home": home}))
    expected = r"joints_deg\[2\]: expected joint 3 within its limits by their margin, .* to 68.00 deg, found 69"
    with pytest.raises(InputError, match=expected):
        posture(near, stiffness, path, acts)
