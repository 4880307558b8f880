"""The scan as a body, and what its hand-eye leaves open of where it stands."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tests.made import files_of
from workbench.api import pose_from, rotation_from_vector
from workbench.artefacts import ChainU, Cloud, MeasuredAxis, PointSet, Toolpath
from workbench.errors import InputError
from workbench.path import read
from workbench.pipeline import Pipeline
from workbench.robot import Cell, CollisionScreen, plate, read_cell, turntable_pose

ROOT = Path(__file__).parents[2]
Vector = tuple[float, float, float]


def cloud_of(covariance: np.ndarray | None) -> Cloud:
    """A flat plate, 200 mm long, seen from 300 mm."""
    frames, columns = 40, 50
    pose = np.tile(np.eye(4), (frames, 1, 1))
    pose[:, 0, 3], pose[:, 1, 3], pose[:, 2, 3] = 1700.0, np.linspace(-100, 100, frames), 900.0
    pose[:, :3, :3] = np.diag([1.0, -1.0, -1.0])
    hand = pose_from(rotation_from_vector(np.array([0.3, -0.4, 0.2])), np.array([50.0, 0, 120]))
    x = np.tile(np.linspace(-40, 40, columns), (frames, 1)).astype(np.float32)
    return Cloud(
        x,
        np.full_like(x, 300.0),
        np.ones(x.shape, bool),
        pose,
        np.arange(frames, dtype=float),
        np.zeros(frames, int),
        covariance,
        hand,
    )


def test_the_hand_eyes_uncertainty_is_that_of_its_points(cell: Cell) -> None:
    """Against random hand-eyes drawn from the covariance: the worst point's worst direction."""
    rng = np.random.default_rng(4)
    root = rng.normal(size=(6, 6)) * np.array([0.05] * 3 + [2e-4] * 3)[:, None]
    covariance = root @ root.T
    cloud = cloud_of(covariance)
    known = dataclasses.replace(cell.margins, part_mm=0.0, part_rad=0.0)
    margins = plate(dataclasses.replace(cell, margins=known), cloud).margins
    drawn = rng.multivariate_normal(np.zeros(6), covariance, 40_000)
    worst = 0.0
    for x in np.linspace(-40, 40, 9):
        arm = cloud.flange_from_profiler[:3, :3] @ np.array([x, 0, 300.0])
        off = drawn[:, :3] + np.cross(drawn[:, 3:], arm)
        worst = max(worst, float(np.sqrt(np.linalg.eigvalsh(np.cov(off.T)).max())))
    assert margins.part_mm == pytest.approx(worst, rel=0.02)
    assert margins.part_rad == pytest.approx(np.sqrt(np.linalg.eigvalsh(np.cov(drawn[:, 3:].T)).max()), rel=0.02)


def test_it_widens_what_bodies_must_keep(cell: Cell) -> None:
    sure, unsure = (plate(cell, cloud_of(np.diag([u, u, u, 1e-8, 1e-8, 1e-8]))) for u in (1e-12, 0.25))
    near = [np.array(CollisionScreen(one).least_mm) for one in (sure, unsure)]
    part = [
        i
        for i, (a, b) in enumerate(CollisionScreen(sure).model.pairs)
        if "workpiece" in (sure.shapes[a].body, sure.shapes[b].body)
    ]
    assert part
    assert (near[1][part] > near[0][part] + 0.5).all()  # coverage 2 of 0.5 mm, with what else is uncertain


def test_a_hand_eye_without_covariance_is_told(cell: Cell) -> None:
    blind = dataclasses.replace(cell, margins=dataclasses.replace(cell.margins, part_mm=0.0))
    told = plate(blind, cloud_of(None))
    assert any("neither the calibration states it" in text for text in told.unchecked)
    stated = dataclasses.replace(cell, margins=dataclasses.replace(cell.margins, part_mm=0.1))
    told = plate(stated, cloud_of(None))
    assert told.unchecked == tuple(text for text in cell.unchecked if not text.startswith("collision with the work"))
    assert any("the calibration states no covariance" in text for text in told.unseen)
    sure = plate(stated, cloud_of(np.eye(6) * 1e-6))
    assert not any("hand-eye" in text for text in (*sure.unchecked, *sure.unseen))


def test_the_mesh_of_the_cell_file_stays_beside_the_scan(cell: Cell) -> None:
    """What was not scanned can be run into all the same; without a mesh the program says so."""
    base = next(shape for shape in cell.shapes if shape.body == "workpiece" or shape.link < 0)
    rib = dataclasses.replace(base, body="workpiece", kind="box", size_mm=(20.0, 40.0, 300.0))
    meshed = plate(dataclasses.replace(cell, shapes=(*cell.shapes, rib)), cloud_of(None))
    assert any(one is rib for one in meshed.shapes)
    assert sum(one.body == "workpiece" for one in meshed.shapes) > 1
    assert not any("beyond its scan" in text for text in meshed.unseen)
    assert any("beyond its scan, which is 80 by 200 by 0 mm" in text for text in plate(cell, cloud_of(None)).unseen)


def test_another_cutter_than_the_paths_is_refused() -> None:
    cell = read_cell(ROOT / "data" / "robot" / "cell.json")
    path = read(toolpath=ROOT / "data/synthetic/paths/raw_arc.json")
    assert plate(cell, cloud_of(None), toolpath=path)
    thick = dataclasses.replace(path, cutter=dataclasses.replace(path.cutter, diameter_mm=16.0))
    with pytest.raises(InputError, match="expected a cutter of 16 mm diameter, as the path has, found 10 mm"):
        plate(cell, cloud_of(None), toolpath=thick)


def test_a_scan_as_a_file_is_the_same_body(cell: Cell, tmp_path: Path) -> None:
    """Of a pipeline that begins with a path, and sees no recording; its hand-eye is not known."""
    points = np.array([[1700.0, 0, 750], [1703.0, 2, 752], [1712.0, 20, 753]])
    np.savetxt(tmp_path / "plate.xyz", points)
    file, upstream = plate(cell, scan=tmp_path / "plate.xyz"), plate(cell, cloud_of(None), PointSet(points))
    assert [one.pose.tolist() for one in file.shapes] == [one.pose.tolist() for one in upstream.shapes]
    assert (file.may_touch, file.unchecked, file.unseen) == (upstream.may_touch, upstream.unchecked, upstream.unseen)
    alone = plate(cell)
    assert (alone.shapes, alone.may_touch) == (cell.shapes, cell.may_touch)
    np.savetxt(tmp_path / "plate.xyz", points / 1e3)
    with pytest.raises(InputError, match=r"plate.xyz.*metres"):
        plate(cell, scan=tmp_path / "plate.xyz")


def test_a_path_alone_says_how_well_its_hand_eye_was_known(cell: Cell) -> None:
    path = read(toolpath=ROOT / "data/synthetic/paths/raw_arc.json")
    known = dataclasses.replace(path, part=dataclasses.replace(path.part, hand_eye_u_mm=0.3))
    sure, unsure = (plate(cell, toolpath=one) for one in (path, known))
    assert sure.margins == cell.margins
    assert any("hand-eye" in text for text in (*sure.unchecked, *sure.unseen))
    assert not any("hand-eye" in text for text in (*unsure.unchecked, *unsure.unseen))
    assert unsure.margins.part_mm == pytest.approx(np.hypot(cell.margins.part_mm, 0.3))


CUTTER, TABLE = ((260.0, 0.0, 140.0), (1.0, 0.0, 0.0)), ((2000.0, 0.0, 500.0), (0.0, 0.0, 1.0))  # of the cell


def measured(link: str, point_mm: Vector, direction: Vector | None) -> Toolpath:
    """A path that rests on an axis so measured, as its file holds it."""
    path = read(toolpath=ROOT / "data/synthetic/paths/raw_arc.json")
    axis = MeasuredAxis(point_mm, direction, u_mm=0.03, u_deg=0.04)
    return dataclasses.replace(path, chain=ChainU(0.03, 7e-4, (link,), {link: axis}))


@pytest.mark.parametrize(
    ("link", "point_mm", "direction", "said"),
    [
        ("tool", (80, -20, 250), (0, 0, 1), r"flange_from_cutter: lies 112 mm beside .* turned by 90 deg"),
        ("tool", (260, 0.6, 140), None, "lies 0.6 mm beside the measured axis"),
        ("tool", (260, 0, 140), (-1, 0, 0), "turned by 1.8e[+]02 deg"),
        ("turntable", (1500, 200, 465), (0, 0, 1), "base_from_turntable: lies 539 mm beside"),
        ("turntable", (2000, 0, 100), (0.004, 0, 1), "turned by 0.23 deg"),
    ],
)
def test_a_tool_or_turntable_measured_elsewhere_is_refused(
    cell: Cell, link: str, point_mm: Vector, direction: Vector | None, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        plate(cell, toolpath=measured(link, point_mm, direction))


def test_what_lies_nearly_as_measured_is_told(cell: Cell, tmp_path: Path) -> None:
    def told(link: str, point_mm: Vector, direction: Vector | None, cell: Cell = cell) -> list[str]:
        (tmp_path / "toolpath.json").write_bytes(files_of(measured(link, point_mm, direction))["toolpath.json"])
        found = plate(cell, toolpath=read(toolpath=tmp_path / "toolpath.json"))
        return [text for text in found.unchecked if text not in plate(cell).unchecked]

    assert told("tool", *CUTTER) == told("turntable", *TABLE) == told("tool", (260, 0.05, 140), (1, 0.001, 0)) == []
    assert told("turntable", (2000, 0, -70), (0, 0, 1)) == []  # where on the axis it was measured is all the same
    assert (
        "lies 0.2 mm beside the measured axis through (260.00, 0.20, 140.00) mm"
        in told("tool", (260, 0.2, 140), None)[0]
    )
    assert told("tool", (300, 0, 140), None) == [
        "the tool's length: its tip was measured +40 mm beyond the cell's, along its axis"
    ]
    named = dataclasses.replace(cell, controller_tools={"tMill": cell.flange_from_cutter})
    assert "lies 3 mm beside" in told("tool", (260, 3, 140), None, named)[0]  # the controller's own tool may be so
    with pytest.raises(InputError, match="lies 30 mm beside"):
        told("tool", (260, 30, 140), None, named)


def test_a_cloud_without_a_grid_is_a_body_whole(cell: Cell) -> None:
    """Slices leave points out: a clamp above the plate, say."""
    clamp = np.array([[1700.0, 0, 750], [1703.0, 2, 752]])
    body = [plate(cell, cloud_of(None), points) for points in (None, PointSet(clamp))]
    for found, held in zip(body, (False, True), strict=True):
        shapes = [one for one in found.shapes if one.body == "workpiece"]
        table = turntable_pose(found, 0.0)
        near = [np.linalg.norm((table @ one.pose)[:3, 3] - clamp[0]) < 10 for one in shapes]
        assert any(near) == held
    steps = {step.id: step for step in Pipeline.load(ROOT / "pipelines/plan_cloud.json").plan().steps}
    assert steps["robot.plate"].sources["points"] == ("cloud.read",)
