"""`compare.deviation`: known steps, no change, coverage, meshes, plans."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.compare.bodies import AT, LENGTH, Surface, box, scanned
from workbench.artefacts import PointSet
from workbench.compare import deviation, register, surface
from workbench.errors import InputError
from workbench.units import Float

PROJECTION_MM = 2.0  # diameter of the cylinder in which points are averaged, the stage's default


def places(found: object) -> tuple[Float, Float]:
    """x from the body's start and distance, of the places on the front face that were compared."""
    distance = found.distance_mm  # type: ignore[attr-defined]
    front = np.isfinite(distance) & (found.normal[:, 1] > 0.9)  # type: ignore[attr-defined]
    return found.position_mm[front, 0] - AT[0], distance[front]  # type: ignore[attr-defined]


@pytest.mark.parametrize("step_mm", [0.05, -0.08])
def test_a_known_step_is_found(step_mm: float) -> None:
    """The middle of the front face lies out (or in) by a known step: size, sign and place, and what is significant."""
    found, document, chapter = deviation(scanned(1, step_mm=step_mm), scanned(2), position_u_mm=0.0)
    x, distance = places(found)
    inside, outside = np.abs(x - LENGTH / 2) < LENGTH / 6 - 1.5, np.abs(x - LENGTH / 2) > LENGTH / 6 + 1.5
    assert distance[inside].mean() == pytest.approx(step_mm, abs=1e-3)
    assert distance[outside].mean() == pytest.approx(0.0, abs=1e-3)
    content = json.loads(document.content)
    assert content["changed"]
    flags = np.array(content["places"]["changed"])[np.isfinite(found.distance_mm) & (found.normal[:, 1] > 0.9)]
    assert flags[inside].all()
    assert flags[outside].mean() < 0.1
    assert "Significant change" in chapter.summary


def test_material_on_the_back_of_a_part_stands_out() -> None:
    """A block seen from all sides, without a scanner's axis: a bump below, and end faces, have their own outside."""
    rng = np.random.default_rng(4)

    def block(bump_mm: float) -> Surface:
        size, count = np.array([40.0, 20.0, 8.0]), 30_000
        face, at = rng.integers(0, 6, count), rng.uniform(-0.5, 0.5, (count, 3))
        axis, side = face // 2, face % 2 - 0.5
        at[np.arange(count), axis] = side
        points = at * size + rng.normal(0.0, 0.005, (count, 3)) * np.eye(3)[axis]
        below = (face == 4) & (np.hypot(points[:, 0], points[:, 1]) < 4.0)
        points[below, 2] -= bump_mm
        return Surface(points + AT, source="block")

    found, _, _ = deviation(block(0.1), block(0.0), position_u_mm=0.0)
    here = found.position_mm - AT
    bump = np.isfinite(found.distance_mm) & (here[:, 2] < -3.5) & (np.hypot(here[:, 0], here[:, 1]) < 2.5)
    assert found.distance_mm[bump].mean() == pytest.approx(0.1, abs=0.01)
    outwards = (found.normal * here / np.array([20.0, 10.0, 4.0])).sum(axis=1)
    assert (outwards[np.isfinite(found.distance_mm)] > 0.5).all()


def test_both_sides_of_a_sheet_whose_end_faces_nobody_saw_stand_out() -> None:
    rng = np.random.default_rng(5)

    def sheet(more_mm: float) -> Surface:
        side, points = rng.integers(0, 2, 12_000) * 2.0 - 1.0, rng.uniform(-0.5, 0.5, (12_000, 3)) * [30.0, 20.0, 0.0]
        points[:, 2] = side * (4.0 + more_mm) + rng.normal(0.0, 0.005, side.size)
        return Surface(points + AT, source="sheet")

    found, _, _ = deviation(sheet(0.05), sheet(0.0), position_u_mm=0.0)
    on = np.isfinite(found.distance_mm)
    assert found.distance_mm[on] == pytest.approx(0.05, abs=0.02)
    assert (found.normal * (found.position_mm - AT))[on, 2].min() > 0.0


@pytest.mark.slow
def test_level_of_detection_covers() -> None:
    """Over 10 parts on which nothing changed about 5 % of the places lie beyond their level, frames' noise or not."""
    shares = []
    for seed in range(10):
        mine, other = (scanned(2 * seed + k, frame_noise_mm=0.02) for k in (0, 1))
        found = deviation(mine, other, position_u_mm=0.0)[0]
        shares.append(found.significant[np.isfinite(found.distance_mm)].mean())
    assert 0.03 < np.mean(shares) < 0.08


def test_registration_enters_the_level() -> None:
    """The uncertainty of the registered place is added: J cov J^T along the normal."""
    pivot = AT + np.array([20.0, -4.0, -3.0])
    covariance = np.diag([0.0, 0.03, 0.04, 0.0, 0.0, 0.0]) ** 2
    corner = register(scanned(1, "corner"), scanned(2, "corner"))[0]
    pose = replace(corner, reference_from_scan=np.eye(4), covariance=covariance, pivot_mm=pivot)
    found = deviation(scanned(1), scanned(2), pose, position_u_mm=0.0)[0]
    for axis, u in ((1, 0.03), (2, 0.04)):
        assert np.nanmedian(found.u_mm[found.normal[:, axis] > 0.99]) == pytest.approx(u, rel=0.03)


def test_registered_scans(tmp_path: object) -> None:
    """A part laid down anew: what the registration takes away is no change, what it leaves is within its level."""
    scan, reference = scanned(5, "corner"), scanned(6, "corner")
    place, told = scan.points_mm + np.array([0.2, -0.1, 0.15]), ("taken as mm",)
    moved = replace(scan, points_mm=place, warnings=told)
    found, _, chapter = deviation(moved, reference, register(moved, reference)[0], position_u_mm=0.0)
    assert chapter.warnings.count(*told) == 1
    assert found.significant[np.isfinite(found.distance_mm)].mean() < 0.1


def test_mesh_and_its_outside() -> None:
    """Against a mesh the sign is that of its own outside; a scan without view or frames will do."""
    scan = scanned(4, step_mm=0.06)
    of_file = surface(None, PointSet(scan.points_mm, warnings=("taken as mm",)))
    found, document, chapter = deviation(of_file, box(), position_u_mm=0.0)
    x, distance = places(found)
    assert distance[np.abs(x - LENGTH / 2) < 4].mean() == pytest.approx(0.06, abs=1e-3)
    assert json.loads(document.content)["reference_kind"] == "mesh"
    assert any("frames are not known" in words for words in chapter.warnings)
    assert "taken as mm" in chapter.warnings


@pytest.mark.parametrize("outside", [1, -1])
def test_places_look_out_of_the_mesh(outside: int) -> None:
    """Turned inside out, its triangles turn all normals and distances; the scan does not know an outside."""
    mesh, scan = box(), scanned(4, step_mm=0.06)
    assert mesh.triangles is not None
    turned = replace(mesh, triangles=mesh.triangles[:, ::outside])
    found, _, chapter = deviation(surface(None, PointSet(scan.points_mm)), turned, position_u_mm=0.0)
    assert any("clockwise" in words for words in chapter.warnings) == (outside < 0)
    assert ((outside * found.normal).max(axis=1) > 0.9).all()
    middle = (np.abs(found.position_mm[:, 0] - AT[0] - LENGTH / 2) < 4) & (np.abs(found.normal[:, 1]) > 0.9)
    assert np.nanmean(found.distance_mm[middle]) == pytest.approx(outside * 0.06, abs=1e-3)


@pytest.mark.parametrize("reference", [scanned(2), box()], ids=["scan", "mesh"])
@pytest.mark.parametrize("step_mm", [0.0, -1.7])
def test_a_step_beyond_the_search_is_told(reference: Any, step_mm: float) -> None:
    """A stretch further off than `depth_mm` is not measured, and is no "no deviation"."""
    document, chapter = deviation(scanned(1, step_mm=step_mm), reference)[1:]
    content = json.loads(document.content)
    assert content["changed"] == (step_mm != 0.0)
    assert (content["beyond_depth"] > 20) == content["changed"]
    assert ("further off than depth_mm" in chapter.summary) == content["changed"]


def test_surfaces_apart_are_refused() -> None:
    far = replace(scanned(1), points_mm=scanned(1).points_mm + np.array([0.0, 0.0, 30.0]))
    with pytest.raises(InputError, match=r"only \d+ of \d+ places find the reference"):
        deviation(far, scanned(2))


def test_a_changed_stretch_is_one_region_of_its_size() -> None:
    """A step over the middle third of the front face: one region there, and nothing else of any size."""
    found, document, chapter = deviation(scanned(1, step_mm=0.08), scanned(2), position_u_mm=0.0)
    regions = json.loads(document.content)["regions"]
    front = np.isfinite(found.distance_mm) & (found.normal[:, 1] > 0.9)
    reach = LENGTH / 6 + 0.5 * PROJECTION_MM  # a cylinder on the step's end holds some of both
    stands_out = front & (np.abs(found.position_mm[:, 0] - AT[0] - LENGTH / 2) < reach)
    assert regions[0]["area_mm2"] == pytest.approx(stands_out.sum(), rel=0.15)
    assert regions[0]["extreme_mm"] == pytest.approx(0.08, abs=0.01)
    assert 0.06 < regions[0]["mean_mm"] < 0.08  # at its ends the step is averaged with what lies beside it
    assert regions[0]["to_mm"] - regions[0]["from_mm"] == pytest.approx(LENGTH / 3, abs=3.0)
    assert sum(region["area_mm2"] for region in regions[1:]) < 0.1 * regions[0]["area_mm2"]
    assert "Connected regions" in chapter.html
