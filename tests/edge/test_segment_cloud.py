"""Edges in clouds without a grid, beside the same scan with its grid, and beside the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.seldom import seldom
from workbench.artefacts import PASSES, Cloud, Inspection, PointSet
from workbench.cloud import read as read_cloud
from workbench.edge import segment_cloud, segment_raw
from workbench.errors import InputError
from workbench.export import cloud as export_cloud
from workbench.inspect import sections
from workbench.units import Float

STRAIGHT = {"from_mm": 5.0, "to_mm": 35.0, "elevation_deg": 40.0}
TWO_PASSES = [STRAIGHT, STRAIGHT | {"oblique_deg": 5.0}]  # the second runs aslant: its lines cross those of the first


def points_of(cloud: Cloud) -> Float:
    """Kept points in the order of frames and columns."""
    frame, column = np.nonzero(cloud.keep)
    pose, x, z = cloud.base_from_profiler[frame], cloud.x_mm[frame, column, None], cloud.z_mm[frame, column, None]
    return pose[:, :3, 3] + x.astype(float) * pose[:, :3, 0] + z.astype(float) * pose[:, :3, 2]


def values(inspection: Inspection, name: str) -> Float:
    return np.array([s.values[name] for s in inspection.sections], dtype=float)


@pytest.mark.parametrize(("condition", "seed"), [("two_pass", 9), *seldom(("paper", 7), ("arc", 8), ("outliers_5", 8))])
def test_scan_lines_give_what_the_grid_gives(drawn, condition: str, seed: int):
    scan = drawn(condition, seed)
    nominal = {
        "root_nominal_mm": round(float(scan.truth.root_mm.mean()), 1),
        "bevel_nominal_deg": float(scan.truth.bevel_deg.mean().round()),
    }
    cloud, edge = segment_cloud(PointSet(points_of(scan.cloud), "a.ply", warnings=("in mm?",)), **nominal)
    found, gridded = sections(edge), sections(scan.edge)
    assert (np.bincount(cloud.pass_index) > 5).sum() == len(np.unique(scan.cloud.pass_index))
    frame, column = np.nonzero(np.isfinite(cloud.x_mm))
    its_frame, its_column = np.nonzero(scan.cloud.keep)
    np.testing.assert_array_equal(*(np.unique(one, return_inverse=True)[1] for one in (frame, its_frame)))
    near = (np.diff(its_frame) == 0) & (np.diff(its_column) < 50)  # how wide a gap in the returns is, nothing shows
    others = [np.mean(np.diff(column + sense * its_column)[near] != 0) for sense in (-1, 1)]
    assert min(others) < 1e-4, "but for a shift"
    assert np.abs(values(found, "root_mm") - values(gridded, "root_mm")).max() < 0.01
    assert np.abs(values(found, "bevel_deg") - values(gridded, "bevel_deg")).max() < 0.05
    assert edge.warnings == ("in mm?",)


def test_an_organised_pcd_keeps_its_grid(scanned, tmp_path: Path):
    """Rows and columns are the exported ones, so what is measured is nearer than by the order of the points."""
    scan = scanned(passes=TWO_PASSES)
    (tmp_path / "o.pcd").write_bytes(export_cloud(scan.cloud, format="pcd", organised=True).content)
    points = read_cloud(file=tmp_path / "o.pcd")
    frame, column = np.nonzero(scan.cloud.keep)
    np.testing.assert_array_equal(points.row, frame)
    np.testing.assert_array_equal(points.column, column)
    cloud, edge = segment_cloud(points)
    seen = np.isfinite(cloud.x_mm)
    seen = seen[:, seen.any(axis=0)]  # without the margin
    np.testing.assert_array_equal(seen, scan.cloud.keep[np.unique(frame)][:, column.min() : column.max() + 1])
    assert (np.bincount(cloud.pass_index) > 5).sum() == len(np.unique(scan.cloud.pass_index))
    found, gridded = sections(edge), sections(scan.edge)
    assert np.abs(values(found, "root_mm") - values(gridded, "root_mm")).max() < 0.003
    assert np.abs(values(found, "bevel_deg") - values(gridded, "bevel_deg")).max() < 0.02


def test_rows_of_a_file_may_lie_along_the_edge(scanned, tmp_path: Path):
    scan = scanned()
    (tmp_path / "o.pcd").write_bytes(export_cloud(scan.cloud, format="pcd", organised=True).content)
    points = read_cloud(file=tmp_path / "o.pcd")
    order = np.argsort(points.column, kind="stable")
    turned = replace(points, points_mm=points.points_mm[order], row=points.column[order], column=points.row[order])
    found, again = (sections(segment_cloud(one)[1]) for one in (points, turned))
    np.testing.assert_allclose(values(again, "root_mm"), values(found, "root_mm"), rtol=0, atol=1e-6)


def test_a_shuffled_cloud_is_sliced_and_says_so(drawn):
    scan = drawn("paper", 7)
    points = np.random.default_rng(5).permutation(points_of(scan.cloud))
    cloud, edge = segment_cloud(PointSet(points, "a.ply"))
    assert any("shows no scan lines" in words for words in edge.warnings)
    assert cloud.keep.shape == edge.labels.shape
    assert edge.checks[0].finding.startswith("not judged")
    assert edge.root.u_by_source[PASSES].max() < 0.01
    found = sections(edge)
    assert any("other software" in one.sentence for one in found.uncertainty.not_included)
    origins = np.array([s.origin_mm for s in found.sections])
    root = np.abs(values(found, "root_mm") - scan.truth.root_mm_at(origins))
    bevel = np.abs(values(found, "bevel_deg") - scan.truth.bevel_deg_at(origins))
    assert root.max() < 0.03
    assert bevel.max() < 0.15
    assert (root < 3 * values(found, "root_u_mm")).all()
    assert (bevel < 3 * values(found, "bevel_u_deg")).all()


def test_shuffled_lines_far_apart_are_measured_as_near_as_is_stated(scanned):
    """20 times as far as their points: slices are as thick, and as wide as the points of a line lie apart."""
    scan = scanned(robot={"frame_pitch_mm": 1.0})
    points = np.random.default_rng(5).permutation(points_of(scan.cloud))
    found = sections(segment_cloud(PointSet(points, "a.ply"))[1])
    origins = np.array([s.origin_mm for s in found.sections])
    root = np.abs(values(found, "root_mm") - scan.truth.root_mm_at(origins))
    bevel = np.abs(values(found, "bevel_deg") - scan.truth.bevel_deg_at(origins))
    assert (root < 3 * values(found, "root_u_mm")).all()
    assert (bevel < 3 * values(found, "bevel_u_deg")).all()


def test_points_as_far_apart_as_columns_do_not_turn_a_face():
    """A drawn edge of 1.5 mm and 40 deg, points 0.05 mm apart on lines 0.26 mm apart; 35 deg aside of their noise."""
    rng = np.random.default_rng(4)
    along, on = np.meshgrid(np.arange(0.0, 60.0, 0.26), np.arange(0.0, 8.0, 0.05))
    up = np.maximum(on - 1.5, 0.0)
    points = np.stack([along, -up * np.sin(np.radians(40)), np.minimum(on, 1.5) + up * np.cos(np.radians(40))], axis=-1)
    aside = np.array([0.0, np.cos(np.radians(35)), np.sin(np.radians(35))])
    points = (points + rng.normal(0.0, 0.012, (*on.shape, 1)) * aside).reshape(-1, 3)
    edge = segment_cloud(PointSet(points[np.argsort(points @ [0.6, 0.64, 0.48])], "a.ply"))[1]  # no order of lines
    assert any("shows no scan lines" in words for words in edge.warnings)
    assert abs(np.median(edge.bevel.value) - 40.0) < 0.05
    assert np.median(edge.bevel.u) < 0.1


def test_shuffled_passes_that_disagree_are_refused(drawn):
    scan = drawn("two_pass", 9)
    rng = np.random.default_rng(5)
    with pytest.raises(InputError, match=r"a\.ply: .* two sheets .* mm apart .* scan order or each pass alone"):
        segment_cloud(PointSet(rng.permutation(points_of(scan.cloud)), "a.ply"))


def test_a_pass_scanned_twice_with_a_shift_is_refused(scanned):
    scan = scanned()
    points = points_of(scan.cloud)
    other = np.random.default_rng(3).permutation(points[::2]) + 0.04 * scan.edge.normal[0]
    with pytest.raises(InputError, match="two sheets"):
        segment_cloud(PointSet(np.concatenate([points[1::2], other]), "a.ply"), use_order=False)


@pytest.mark.parametrize("again", [True, False])
def test_a_cloud_that_is_refused_as_it_is_rounded_says_so(scanned, again: bool):
    points = np.round(points_of(scanned().cloud) / 0.5) * 0.5
    points = points if again else np.unique(points, axis=0)
    with pytest.raises(InputError, match=r"a\.ply: coordinates are rounded to 0\.5 mm"):
        segment_cloud(PointSet(points, "a.ply"))


def test_passes_that_agree_are_measured_if_they_are_said_to(scanned):
    """Poses without noise."""
    scan = scanned(passes=TWO_PASSES)
    points = PointSet(np.random.default_rng(5).permutation(points_of(scan.cloud)), "a.ply")
    with pytest.raises(InputError, match=r"a\.ply: points stand on lines of several .* each pass alone"):
        segment_cloud(points)
    _, edge = segment_cloud(points, robot_noise_mm=0.02)
    assert (edge.root.u_by_source[PASSES] >= 2**0.5 * 0.02).all()
    assert any("lines of several scanning passes" in words for words in edge.warnings)
    found = sections(edge)
    origins = np.array([s.origin_mm for s in found.sections])
    error = np.abs(values(found, "root_mm") - scan.truth.root_mm_at(origins))
    assert (values(found, "root_u_mm") > 2**0.5 * 0.02).all()
    assert (error < 2 * values(found, "root_u_mm")).all()


def test_a_raw_edge_in_scan_order_is_that_of_its_grid(scanned):
    raw = scanned(part={"kind": "raw", "length_mm": 40.0})
    up = (
        tuple(raw.recipe.part.base_from_part.matrix[:3, 2])
        if hasattr(raw.recipe.part.base_from_part, "matrix")
        else (0, 0, 1)
    )
    gridded = segment_raw(raw.cloud, upper_side=up)
    points = PointSet(points_of(raw.cloud), "raw.ply")
    _, edge = segment_cloud(points, upper_side=up)
    off = np.linalg.norm(edge.position_mm - gridded.position_mm, axis=1)
    assert (off < 0.1 * np.linalg.norm(gridded.position_u_mm, axis=1)).all()  # columns stand elsewhere by a digit
    names = [
        "recording_judged",
        "two_plates_share",
        "end_face_lean_deg",
        "face_bow",
        "face_bend_deg",
        "step_share",
        "goes_on_share",
        "face_behind_share",
        "edge_break_mm",
        "end_step_columns",
        "late_turn_deg",
        "fixed_end_share",
    ]
    assert [check.name for check in edge.checks] == names
    with pytest.raises(InputError, match="order of scan lines"):
        segment_cloud(points, upper_side=up, use_order=False)


def test_a_strip_of_the_upper_surface_is_no_root_face():
    """Of a plate cut off behind its bevel; read as the root face: 0.53 mm and 50 deg, 35 u off, `fail`."""
    rng = np.random.default_rng(4)
    along, on = np.meshgrid(np.arange(0.0, 60.0, 0.26), np.arange(0.0, 5.05, 0.05))
    lean, up = np.radians(40.0), np.clip(on - 1.5, 0.0, 3.0)
    flat = np.maximum(on - 4.5, 0.0)
    points = np.stack([along, up * np.sin(lean) + flat, np.minimum(on, 1.5) + up * np.cos(lean)], axis=-1)
    points = points + rng.normal(0.0, 0.008, points.shape)
    edge = segment_cloud(PointSet(points.reshape(-1, 3), "a.ply"))[1]
    found = sections(edge)
    assert (np.abs(values(found, "root_mm") - 1.5) < 3 * values(found, "root_u_mm")).all()
    assert (np.abs(values(found, "bevel_deg") - 40.0) < 3 * values(found, "bevel_u_deg")).all()
    assert any(one.name == "told_by_nominal" for one in edge.unseen)


@pytest.mark.parametrize("how", ["again", "reversed", "rounded", "half"])
def test_points_that_stand_twice_in_a_cloud_are_no_further_returns(scanned, how: str):
    """Each counted twice: u fell by the root of two, to a bevel 4 u off, with a plain pass."""
    points = points_of(scanned().cloud)
    more = {"again": points, "reversed": points[::-1], "rounded": points.round(3), "half": points[: len(points) // 2]}
    with pytest.raises(InputError, match="stand in the cloud more than once"):
        segment_cloud(PointSet(np.concatenate([points, more[how]]), "a.ply"))
