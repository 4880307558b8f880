"""The search against brute force; how rough an end face is, by its scan."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.scan_plan.test_information import JOINT, LENGTH_MM, SENSOR
from workbench import cloud, edge, scan
from workbench.scan_plan.edges import roughness_mm
from workbench.scan_plan.information import MOST_INCIDENCE, Knowledge, View, incidences
from workbench.scan_plan.plan_stage import Task
from workbench.scan_plan.search import Candidate, Search, Wanted
from workbench.scan_plan.way import EdgeLine
from workbench.units import DEG

KNOWN = Knowledge(edge_condition="sharp")


def candidates(rng: np.random.Generator) -> list[Candidate]:
    out = []
    for elevation in (-30.0, 0.0, 30.0, 55.0):
        for pitch in (0.2, 0.8):
            view = View(elevation * DEG, 150.0, pitch)
            sees, seconds = rng.random(6) < 0.75, 15.0 + 100.0 / pitch * rng.uniform(0.8, 1.2)
            out.append(Candidate(view, False, sees, seconds))
    return out


@pytest.mark.parametrize("seed", range(8))
def test_no_set_is_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wanted = Wanted(float(rng.choice([0.003, 0.006, 0.02])), float(rng.choice([0.06, 0.1])))
    search = Search(JOINT, SENSOR, KNOWN, LENGTH_MM, wanted, candidates(rng))
    chosen, reach = search.best(3)
    sets = [s for size in (1, 2, 3) for s in itertools.combinations(range(len(search.candidates)), size)]
    best = min(search.reach(s) for s in sets)
    assert reach.short == best.short
    assert reach == search.reach(chosen)
    if best.short == 0:
        assert reach.seconds <= 1.1 * best.seconds
    else:
        assert reach.excess <= 1.1 * best.excess


def test_of_passes_that_take_as_long_the_one_that_tells_more_is_taken() -> None:
    views = [View(elevation * DEG, 150.0, 0.4) for elevation in (50.0, 10.0, -30.0)]
    several = [Candidate(view, False, np.ones(6, bool), 30.0) for view in views]
    known, easy = Knowledge(edge_condition="unknown"), Wanted(1.0, 0.12)
    search = Search(JOINT, SENSOR, known, LENGTH_MM, easy, several)
    assert search.best(2)[0] == (2,)
    assert search.best(5)[0] == (2,)


@pytest.mark.parametrize("bevel_deg", [20.0, 40.0, 48.0, 60.0])
def test_the_joint_gives_the_elevations(bevel_deg: float) -> None:
    """Both faces are seen from all of them, and from one the lower surface too, where there is such a view.

    From none is it met at 70 to 90 deg, where nobody knows whether it returns: elsewhere they are 10 deg apart.
    """
    joint = JOINT._replace(bevel=bevel_deg * DEG)
    line = EdgeLine.through(np.array([[0.0, 0.0, 0.0], [LENGTH_MM, 0.0, 0.0]]), np.array([0.0, 0.0, 1.0]), "line")
    task = Task(joint, SENSOR, KNOWN, line, Wanted(0.02, 0.1), 2, 200.0, 100.0)
    at = np.array(task.elevations)
    seen = np.array([incidences(joint, View(one, 150.0, 0.2)) for one in at])
    assert (np.diff(at) > 0.0).all()
    assert np.diff(at[at >= 0.0]).max() < 10.01 * DEG
    assert np.diff(at[at < 0.0]).max(initial=0.0) < 10.01 * DEG
    doubtful = (seen[:, 2] > MOST_INCIDENCE) & (seen[:, 2] < 0.5 * np.pi - 1e-9)
    assert not doubtful.any()
    assert seen[:, :2].max() < MOST_INCIDENCE
    assert (seen[:, 2] < MOST_INCIDENCE).any() == (bevel_deg < 50.0)


def test_a_way_keeps_to_the_points_between_them_too() -> None:
    """Long straight pieces are told by their ends alone; a smooth curve through few points bulged by 90 mm."""
    for points in ([[0, 0, 0], [900, 0, 0], [1000, 50, 0]], [[0, 0, 0], [300, 0, 0], [350, 50, 0], [350, 350, 0]]):
        told = np.array(points, float)
        line = EdgeLine.through(told, np.array([0.0, 0.0, 1.0]), "line")
        first, piece = told[:-1], np.diff(told, axis=0)
        away = line.position_mm[:, None] - first
        share = np.clip((away * piece).sum(axis=-1) / (piece**2).sum(axis=-1), 0.0, 1.0)
        off = np.linalg.norm(away - share[..., None] * piece, axis=-1).min(axis=1)
        assert off.max() < 2.5


def test_a_coarse_recording_tells_how_rough_the_end_face_is() -> None:
    points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/raw_edge.h5")))
    assert 0.06 < roughness_mm(points, edge.segment_raw(points, upper_side=(0.0, 0.0, 1.0))) < 0.2  # its recipe: 0.1
    points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
    assert roughness_mm(points, edge.segment(points)) == 0.0
