"""What a recording does not show costs what its inspection says: the recording is changed so, and measured again."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from bench.drawn.seeds import generator, nominal
from bench.outside import simulate
from bench.recordings import frames
from bench.score.outsider import milled_part, sharp
from bench.score.triangulated import sensor, way, workpiece
from bench.simulators.triangulated import STRAIGHT_MM
from bench.simulators.triangulated import simulate as triangulated
from tests.laws.dozen import Small
from tests.seldom import seldom
from workbench.artefacts import ROOT_FACE, Cloud, Inspection, MilledEdge, PointSet, RawEdge, Recording
from workbench.cloud import denoise
from workbench.edge import segment, segment_cloud, segment_preparation, segment_raw
from workbench.errors import InputError
from workbench.inspect import preparation, sections
from workbench.scan import fuse, read
from workbench.synthetic import parse_recipe, simulate_recording
from workbench.units import DEG, Float

RECORDING = "data/synthetic/milled_edge.h5"


@cache
def recording() -> Recording:
    return read(recording=RECORDING)


def measured(scan: Recording) -> tuple[MilledEdge, Inspection]:
    edge = segment(denoise(fuse(scan)), edge_condition="sharp")
    return edge, sections(edge)


@cache
def as_it_is() -> tuple[MilledEdge, Inspection]:
    return measured(recording())


def begun(name: str) -> Recording:
    """The first half of a shipped recording of a raw edge, which takes half as long; one frame in three."""
    scan = read(recording=f"data/synthetic/{name}.h5")
    return frames(scan, np.arange(0, len(scan.time_s) // 2, 3))


def scaled(scan: Recording, x: float, z: float) -> Recording:
    return replace(scan, x_mm=(scan.x_mm * x).astype(np.float32), z_mm=(scan.z_mm * z).astype(np.float32))


def turned(scan: Recording, axis: Any) -> Recording:
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec(axis, degrees=True).as_matrix()
    return replace(scan, flange_from_profiler=scan.flange_from_profiler @ turn)


CHANGES: dict[str, tuple[str, Callable[[Recording], Recording]]] = {
    "x by 0.1 %": ("scale", lambda scan: scaled(scan, 1.001, 1.0)),
    "z by 0.1 %": ("scale", lambda scan: scaled(scan, 1.0, 1.001)),
    "x mirrored": ("mirrored_axes", lambda scan: scaled(scan, -1.0, 1.0)),
    "z mirrored": ("mirrored_axes", lambda scan: scaled(scan, 1.0, -1.0)),
    "about x": ("hand_eye", lambda scan: turned(scan, np.array([1.0, 0.0, 0.0]))),
    "about y": ("hand_eye", lambda scan: turned(scan, np.array([0.0, 1.0, 0.0]))),
    "about z": ("hand_eye", lambda scan: turned(scan, np.array([0.0, 0.0, -1.0]))),
}


@pytest.mark.parametrize("change", CHANGES)
def test_it_costs_no_more_than_the_inspection_says(change: str) -> None:
    name, spoil = CHANGES[change]
    edge, before = as_it_is()
    told = next(one for one in edge.unseen if one.name == name)
    spoilt, after = measured(spoil(recording()))
    order = 1 if spoilt.tangent[0] @ edge.tangent[0] > 0.0 else -1  # mirrored, the edge runs backwards
    for key, cost in told.costs.items():
        sizes = [(a.sizes[key], b.sizes[key]) for a, b in zip(before.sections, after.sections[::order], strict=True)]
        moved = np.median([abs(b.value - a.value) for a, b in sizes])
        assert moved <= 1.1 * cost + 0.2 * max(a.u for a, _ in sizes)


def _heights(cloud: Cloud, edge: MilledEdge | RawEdge) -> Float:
    """Of each return (N, C) over the edge beside it, along `across`, mm."""
    station = np.abs(np.subtract.outer(edge.frame_arc_length_mm, edge.arc_length_mm)).argmin(axis=1)
    x, z = (np.nan_to_num(of.astype(float)) for of in (cloud.x_mm, cloud.z_mm))
    points = np.stack([x, np.zeros_like(x), z, np.ones_like(x)], axis=2) @ cloud.base_from_profiler[:, :3].mT
    return np.einsum("fcd,fd->fc", points - edge.position_mm[station, None], edge.across[station])


@pytest.mark.parametrize("to_mm", [50.0, 70.0])
def test_an_end_that_jumps_is_told_and_may_be_the_edge_that_steps(to_mm: float) -> None:
    off_mm, from_mm = 0.3, 30.0
    edge, _ = as_it_is()
    cloud = denoise(fuse(recording()))
    height = _heights(cloud, edge)
    there = (edge.frame_arc_length_mm > from_mm) & (edge.frame_arc_length_mm < to_mm)
    lost = there[:, None] & (edge.labels == ROOT_FACE) & (height < off_mm)
    found, _ = measured(replace(recording(), z_mm=np.where(lost, np.nan, recording().z_mm)))
    assert any("itself steps" in one for one in found.warnings)
    assert not any("itself steps" in one for one in edge.warnings)
    before = np.interp(found.arc_length_mm, edge.arc_length_mm, edge.root.value)
    stepped = before - np.where((found.arc_length_mm > from_mm) & (found.arc_length_mm < to_mm), off_mm, 0.0)
    away = np.abs(np.subtract.outer(found.arc_length_mm, [from_mm, to_mm])).min(axis=1) > 2.0
    for possible in (before, stepped):
        assert (np.abs(found.root.value - possible) < 3.0 * found.root.u)[away].all()


def test_an_end_that_most_frames_of_a_raw_edge_lose_is_in_u() -> None:
    scan = begun("raw_wavy")
    cloud = denoise(fuse(scan))
    edge = segment_raw(cloud, upper_side=(0.0, 0.0, 1.0))
    height = _heights(cloud, edge)
    loses = np.random.default_rng(0).random(len(height)) < 0.75
    for off_mm in (0.3, 0.8):
        lost = loses[:, None] & (edge.labels == ROOT_FACE) & (height < off_mm)
        spoilt = replace(scan, z_mm=np.where(lost, np.nan, scan.z_mm))
        found = segment_raw(denoise(fuse(spoilt)), upper_side=(0.0, 0.0, 1.0))
        places = (np.interp(found.arc_length_mm, edge.arc_length_mm, of) for of in edge.position_mm.T)
        moved = ((found.position_mm - np.stack(list(places), axis=1)) * found.across).sum(axis=1)
        assert np.nanmax(moved) > 0.5 * off_mm
        assert np.nanmax(np.abs(moved) / found.position_u_mm[:, 1]) < 3.0


def test_how_far_a_rough_face_is_lost_is_in_the_u_of_its_direction() -> None:
    scan = begun("raw_edge")
    whole = segment_raw(denoise(fuse(scan)), upper_side=(0.0, 0.0, 1.0))
    rng = np.random.default_rng(7)
    rough = gaussian_filter(rng.normal(size=scan.z_mm.shape), 3.0)
    rough = (scan.z_mm + np.where(whole.labels == ROOT_FACE, 0.1 / rough.std() * rough, 0.0)).astype(np.float32)
    cloud = denoise(fuse(replace(scan, z_mm=rough)))
    edge = segment_raw(cloud, upper_side=(0.0, 0.0, 1.0))
    loses = rng.random(len(rough)) < 0.75
    lost = loses[:, None] & (edge.labels == ROOT_FACE) & (_heights(cloud, edge) < 0.8)
    found = segment_raw(denoise(fuse(replace(scan, z_mm=np.where(lost, np.nan, rough)))), upper_side=(0.0, 0.0, 1.0))
    normal = np.stack([np.interp(found.arc_length_mm, edge.arc_length_mm, of) for of in edge.normal.T], axis=1)
    turned = ((found.normal - normal) * found.across).sum(axis=1)
    assert np.nanmax(np.abs(turned)) > 0.1 * DEG
    assert np.nanmax(np.abs(turned) / found.normal_u) < 1.5


@pytest.mark.parametrize("coarser", [5.8, 6.2, *seldom(3.5, 3.75, 5.0, 5.5)])
def test_columns_that_grow_wider_are_measured_until_they_are_too_coarse(coarser: float) -> None:
    """Five columns on a root face tell it to a few tenths of one, as u says."""
    recipe = json.loads(Path(RECORDING).with_suffix(".json").read_text())
    scanner = recipe["scanner"]
    scanner |= {"columns": int(scanner["columns"] / coarser), "pitch_mm": scanner["pitch_mm"] * coarser}
    coarse, _ = simulate_recording(parse_recipe(recipe, RECORDING))
    cloud = denoise(fuse(coarse))
    if coarser < 6.0:
        fine, found = segment(denoise(fuse(read(recording=RECORDING)))), segment(cloud)
        for one, other in ((fine.root, found.root), (fine.bevel, found.bevel)):
            value = np.interp(found.arc_length_mm, fine.arc_length_mm, one.value)
            assert np.nanmax(np.abs(other.value - value) / other.u) < 3.0, one.name
    else:
        with pytest.raises(InputError, match="too coarse"):
            segment(cloud)


def test_a_hand_eye_pose_whose_u_is_known_is_no_doubt() -> None:
    cloud = denoise(fuse(recording()))
    known = segment(replace(cloud, hand_eye_covariance=np.diag([0.01] * 3 + [1e-8] * 3)))
    assert "hand_eye" in {one.name for one in as_it_is()[0].unseen}
    assert "hand_eye" not in {one.name for one in known.unseen}


@pytest.mark.parametrize("lost", [0, 3])
def test_an_end_that_stays_in_one_column_is_a_condition(lost: int) -> None:
    """A straight way beside a straight part shows the part's own end as it shows a window that ends before it."""
    drawn = sharp(2500)
    scan = drawn.recording
    seen = np.isfinite(scan.z_mm).sum(axis=0) > 0.5 * len(scan.z_mm)
    ends = np.flatnonzero(seen)[[lost, -1 - lost]]
    columns = np.arange(seen.size)
    cut = np.where((columns >= ends[0]) & (columns <= ends[1]), scan.z_mm, np.nan).astype(np.float32)
    nominal = {name: drawn.declared[name] for name in ("root_nominal_mm", "bevel_nominal_deg")}
    edge = segment(denoise(fuse(replace(scan, z_mm=cut))), **nominal)
    wide = {"root_tolerance_mm": (-1.0, 1.0), "bevel_tolerance_deg": (-10.0, 10.0)}
    found = sections(edge, **nominal, **wide)
    assert (found.verdict, [one.name for one in found.conditions]) == ("undecided", ["window_end"])
    (told,) = (one.finding for one in found.checks if one.name == "fixed_end_share")  # a corrected path rests on it
    assert "would not show" in told
    assert sections(edge, **nominal, **wide, accept_conditions=("window_end",)).verdict == "pass"


@pytest.mark.parametrize(("seed", "behind"), [(5103, True), (5104, False)])
def test_what_returns_right_behind_an_end_shows_it_and_a_cropped_cloud_hides_that(seed: int, behind: bool) -> None:
    """A table behind the plate, or nothing; the cloud with all below 0.3 mm above the lower edge cut off."""
    part = simulate(seed, is_raw=False, cell=Small())
    drawn = milled_part(part, {}, "plain")
    nominal = {name: drawn.declared[name] for name in ("root_nominal_mm", "bevel_nominal_deg")}
    cloud = denoise(fuse(drawn.recording))
    assert ("lost_columns" in [one.name for one in segment(cloud, **nominal).unseen]) != behind
    points, up = cloud.placed(*np.nonzero(cloud.keep)), part.base_from_section
    above = (points - up[:3, 3]) @ up[:3, 1] > 0.3
    for kept, shown in ((points, behind), (points[above], False)):
        edge = segment_cloud(PointSet(kept), **nominal)[1]
        assert isinstance(edge, MilledEdge)
        found = sections(edge, **nominal, root_tolerance_mm=(-0.8, 0.8), bevel_tolerance_deg=(-10.0, 10.0))
        assert [one.name for one in found.conditions] == ([] if shown else ["window_end"])
        known = segment_cloud(PointSet(kept), **nominal, thickness_mm=part.section.thickness_mm)[1]
        assert [one.name for one in known.unseen if one.is_doubt] == ([] if kept is points else ["thickness"])


@pytest.mark.parametrize(("dark_mm", "off_mm"), [(0.0, 0.0), (0.3, 0.0), (0.0, 0.3)])
def test_a_thickness_says_whether_the_root_face_goes_on(dark_mm: float, off_mm: float) -> None:
    """A stripe along the lower end that returns nothing, and a thickness that is another plate's."""
    part = simulate(5104, is_raw=False, cell=Small())
    cloud = denoise(fuse(part.recording))
    frame, column = np.nonzero(cloud.keep)
    up = (cloud.placed(frame, column) - part.base_from_section[:3, 3]) @ part.base_from_section[:3, 1]
    z_mm = part.recording.z_mm.copy()
    z_mm[frame[up < dark_mm], column[up < dark_mm]] = np.nan
    given = nominal(part.section.root_mm, part.section.bevel / DEG)
    given = {name: given[name] for name in ("root_nominal_mm", "bevel_nominal_deg")}
    thickness_mm = part.section.thickness_mm + off_mm
    edge = segment(denoise(fuse(replace(part.recording, z_mm=z_mm))), **given, thickness_mm=thickness_mm)
    told = [one for one in edge.unseen if one.name in ("thickness", "lost_columns", "shadow", "window_end")]
    if dark_mm == off_mm:
        assert told == []
    else:
        assert [(one.name, one.is_doubt, round(one.costs["root_mm"], 1)) for one in told] == [("thickness", True, 0.3)]


def test_a_window_that_ends_the_end_face_of_a_raw_edge_is_told() -> None:
    part = simulate(7, is_raw=True, cell=Small())
    scan = part.recording
    seen = np.flatnonzero(np.isfinite(scan.z_mm).mean(axis=0) > 0.9)
    columns = np.arange(scan.z_mm.shape[1])
    cut = np.where((columns >= seen[20]) & (columns <= seen[-21]), scan.z_mm, np.nan).astype(np.float32)
    for z_mm in (scan.z_mm, cut):
        cloud = denoise(fuse(replace(scan, z_mm=z_mm)))
        edge = segment_raw(cloud, upper_side=tuple(part.base_from_section[:3, 1].tolist()))
        told = next(one for one in edge.checks if one.name == "fixed_end_share")
        assert ("would not show" in told.finding) == (z_mm is cut)


def test_a_window_that_ends_both_turned_passes_is_a_condition() -> None:
    """Each ends in a column of its own, none in most frames of both: 0.7 mm too short at 26 u, and no condition."""
    rng = generator("reread", 2661)
    part = replace(workpiece(rng, "milled", 2661), radius_mm=STRAIGHT_MM, table_mm=None)
    ways = [way(rng, part, elevation_deg) for elevation_deg in (40.0, 42.0)]
    led = [replace(one, drift_mm=0.0, sway=0.0, oblique=(0.0, 0.0, 0.0)) for one, _ in ways]
    drawn = triangulated(part, sensor(rng, max(wide for _, wide in ways)), led, 2661)
    given = nominal(part.root_mm.mean, part.bevel.mean / DEG)
    names = ("root_nominal_mm", "bevel_nominal_deg")
    whole = segment(denoise(fuse(drawn.recording)), **{name: given[name] for name in names})
    root = [np.flatnonzero((whole.labels[whole.pass_index == one] == ROOT_FACE).mean(axis=0) > 0.5) for one in (0, 1)]
    low, high = min(one[0] for one in root), max(one[-1] for one in root)
    columns = np.arange(drawn.recording.z_mm.shape[1])
    cut = np.where((columns > low + 20) & (columns < high - 20), drawn.recording.z_mm, np.nan).astype(np.float32)
    edge = segment(denoise(fuse(replace(drawn.recording, z_mm=cut))), **{name: given[name] for name in names})
    assert "window_end" in [one.name for one in edge.unseen]


def test_a_preparation_passes_on_the_same_condition() -> None:
    """The shipped plate is scanned straight along its edge: its root face ends in one column, with none beyond."""
    found = segment_preparation(denoise(fuse(read(recording="data/synthetic/milled_nose.h5"))))
    nominal = {"land_mm": 1.0, "land_tolerance_mm": [-0.5, 0.5]}
    judged = preparation(found, nominal=nominal)
    assert (judged.verdict, [one.name for one in judged.conditions]) == ("undecided", ["window_end"])
    assert preparation(found, nominal=nominal, accept_conditions=("window_end",)).verdict == "pass"
    assert preparation(found).conditions == ()
