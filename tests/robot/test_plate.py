"""The scan as a body, and what its hand-eye leaves open of where it stands."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from workbench.api import pose_from, rotation_from_vector
from workbench.artefacts import Cloud, PointSet
from workbench.errors import InputError
from workbench.path import read
from workbench.pipeline import Pipeline
from workbench.robot import Cell, CollisionScreen, plate, turntable_pose

ROOT = Path(__file__).parents[2]


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
