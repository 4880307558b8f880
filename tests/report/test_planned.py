"""What the plan's tables rest on: the path as it is run, and the bevel that it makes on the scanned edge."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.program.paths import in_work_object
from workbench.artefacts import ChainU
from workbench.report.planned import LOCAL_MM, local_turn_deg, planned_bevel, planned_u, thickness_mm, whole_run


@pytest.mark.parametrize("radius_mm", [None, 300.0])
def test_the_planned_bevel_is_what_the_path_was_made_for(planned, radius_mm):
    p = planned(radius_mm=radius_mm)
    bevel = planned_bevel(p.toolpath, p.edge)
    assert len(bevel.root_mm) == 201 - 33  # not over the clamp
    np.testing.assert_allclose(bevel.root_mm, 1.5, atol=1e-3)
    np.testing.assert_allclose(bevel.bevel_deg, 40.0, atol=0.02)


def test_a_path_that_is_off_shows(planned, by_formula):
    edge = planned().edge
    bevel = planned_bevel(by_formula(bevel_deg=41.0), edge)
    np.testing.assert_allclose(bevel.bevel_deg, 41.0, atol=1e-6)
    path = planned().toolpath
    moved = dataclasses.replace(path.layers[-1], position_mm=path.layers[-1].position_mm + np.array([0.0, -0.1, 0.2]))
    bevel = planned_bevel(dataclasses.replace(path, layers=(moved,)), edge)
    # 0.1 mm outward (n is -y here) and 0.2 mm up: the plane meets the end face 0.2 + 0.1 / tan(40 deg) higher
    np.testing.assert_allclose(bevel.root_mm, 1.5 + 0.2 + 0.1 / np.tan(np.radians(40.0)), atol=1e-6)


def test_the_work_objects_frame_does_not_matter(planned):
    p = planned(radius_mm=300.0)
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.3, -0.8, 1.9]).as_matrix()
    pose[:3, 3] = [700.0, -80.0, 20.0]
    moved = in_work_object(p.toolpath, pose)
    np.testing.assert_allclose(moved.in_base(moved.layers[0].position_mm), p.toolpath.layers[0].position_mm, atol=1e-9)
    np.testing.assert_allclose(whole_run(moved).position_mm, whole_run(p.toolpath).position_mm, atol=1e-9)
    here, there = planned_bevel(p.toolpath, p.edge), planned_bevel(moved, p.edge)
    np.testing.assert_allclose(there.root_mm, here.root_mm, atol=1e-9)
    np.testing.assert_allclose(there.bevel_deg, here.bevel_deg, atol=1e-9)


def test_layers_and_travels_are_run_in_turn(planned):
    path = planned().toolpath
    run = whole_run(path)
    np.testing.assert_array_equal(run.layer[run.layer_start], [0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6, 0])
    np.testing.assert_array_equal(run.position_mm[:2], path.travels[0].position_mm)
    np.testing.assert_array_equal(run.position_mm[2], path.layers[0].position_mm[0])
    cut = run.length_mm[run.cutting_step]
    assert cut.sum() == pytest.approx(6 * (89.0 + 77.0))  # 0 to 89 and 123 to 200 mm, straight
    assert run.time_s[run.cutting_step].sum() == pytest.approx(cut.sum() / 1.0)
    step = np.linalg.norm(np.diff(run.position_mm, axis=0), axis=1)
    assert run.time_s.sum() == pytest.approx((step / run.feed_mm_s[1:]).sum())


def test_the_scans_uncertainty_moves_the_planned_bevel_so_far(planned):
    """The edge drawn at random within its uncertainty: the spread of the planned root face is the one stated."""
    p, rng = planned(), np.random.default_rng(5)
    roots = []
    for _ in range(300):
        shift = rng.normal(0, 0.006) * p.edge.normal + rng.normal(0, 0.004) * p.edge.across
        edge = dataclasses.replace(p.edge, position_mm=p.edge.position_mm + shift)
        roots.append(planned_bevel(p.toolpath, edge).root_mm[0])
    root_u, bevel_u = planned_u(p.edge, p.toolpath)
    assert np.std(roots) == pytest.approx(root_u, rel=0.15)
    assert bevel_u == pytest.approx(np.degrees(0.0005))
    chain = ChainU(0.1, 0.001, ("tool",))
    more = planned_u(p.edge, dataclasses.replace(p.toolpath, chain=chain))
    slope = 1.0 / np.tan(np.radians(p.toolpath.bevel_deg))
    assert more[0] == pytest.approx(np.hypot(root_u, 0.1 * np.hypot(1.0, slope)))
    assert more[1] == pytest.approx(np.degrees(np.hypot(0.0005, 0.001)))


def test_thickness_is_not_invented(planned):
    edge = planned().edge
    np.testing.assert_allclose(thickness_mm(edge)[edge.seen], 10.0)
    assert np.isnan(thickness_mm(edge)[~edge.seen]).all()


def test_the_end_faces_own_turn_is_told_beside_an_even_twist(planned):
    """Directions that differ by 0.05 deg from place to place, on a face that turns by 20 deg along the edge."""
    edge, rng = planned().edge, np.random.default_rng(3)
    count = len(edge.arc_length_mm)
    apart = round(LOCAL_MM / float(edge.arc_length_mm[1]))
    places = np.radians(0.05) * rng.normal(size=count) + np.radians(20.0) * np.linspace(0.0, 1.0, count)
    turned = np.cos(places)[:, None] * edge.normal + np.sin(places)[:, None] * edge.across
    across = np.cross(turned, edge.tangent)
    found = local_turn_deg(dataclasses.replace(edge, normal=turned, across=across))
    assert count > 4 * apart
    assert found == pytest.approx(0.05, rel=0.3)
    assert local_turn_deg(edge) == pytest.approx(0.0, abs=1e-6)
