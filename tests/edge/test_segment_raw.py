"""Raw edges under clamps, rough, with burrs and from odd views; and what is refused. Where they lie: tests/laws."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.drawn.plates import random_recipe
from bench.drawn.swept import random_swept_recipe
from bench.recordings import frames, with_values
from bench.score.face import rough_upper_side
from bench.simulators.swept import simulate_swept
from tests.seldom import seldom
from workbench.artefacts import Edge
from workbench.cloud import denoise
from workbench.edge import segment, segment_raw
from workbench.errors import InputError
from workbench.scan import fuse
from workbench.synthetic import simulate_recording
from workbench.units import DEG, Float

Scans = Callable[..., Any]
RAW = {"kind": "raw", "length_mm": 40.0, "thickness_mm": 8.0}
ABOVE = {"from_mm": 5.0, "to_mm": 35.0, "skew_mm": [-0.4, 0.4]}
UP = (0.05, -0.1, 1.0)  # as a user says it: roughly


@functools.cache
def found(scan: Any) -> Edge:
    """The edge of a drawn part, its upper side told 14 deg wrong."""
    across, along = scan.truth.across[0], scan.truth.tangent[0]
    return segment_raw(scan.cloud, upper_side=tuple(across + 0.25 * along))


def at_stations(scan: Any, edge: Edge, name: str) -> Float:
    """The truth's vectors at the stations that were seen."""
    s = scan.truth.arc_length_mm_at(edge.position_mm[edge.seen])
    return np.stack([np.interp(s, scan.truth.arc_length_mm, getattr(scan.truth, name)[:, k]) for k in range(3)], axis=1)


def off_true(scan: Any, edge: Edge) -> tuple[Float, Float, Float]:
    """How far the lower edge lies off along n and m (mm), and how far n is turned about t (deg), station by station."""
    n, m = at_stations(scan, edge, "normal"), at_stations(scan, edge, "across")
    off = edge.position_mm[edge.seen] - at_stations(scan, edge, "position_mm")
    normal = edge.normal[edge.seen]
    turn = np.arctan2((normal * m).sum(axis=1), (normal * n).sum(axis=1)) / DEG
    return (off * n).sum(axis=1), (off * m).sum(axis=1), turn


def test_nothing_is_invented_under_clamps(drawn: Scans) -> None:
    scan = drawn("raw_clamps", 1)
    edge = found(scan)
    assert edge.hand_eye_u_mm is None  # nobody said how uncertain the hand-eye pose is
    really = scan.truth.seen_at(edge.position_mm[edge.seen])
    assert (~really).sum() <= 3  # next to the clamps, within the spacing of stations
    assert abs(scan.truth.seen.sum() * 0.5 - edge.seen.sum()) < 6


@pytest.mark.parametrize("seed", [17840010, *seldom(17840002)])  # a quarter of its frames are by far smoother
def test_a_rough_face_is_its_plane_over_20_mm(seed: int) -> None:
    recording, truth = simulate_swept(random_swept_recipe("swept_raw_rough", seed))
    edge = segment_raw(denoise(fuse(recording)), upper_side=rough_upper_side(truth))
    part = SimpleNamespace(truth=truth)
    along_n, along_m, turn = off_true(part, edge)
    u_n, u_m = edge.position_u_mm[edge.seen].T
    assert (np.abs(along_n) < 3 * u_n).all()
    assert (np.abs(along_m) < 3 * u_m).all()
    assert (np.abs(turn) < 3 * edge.normal_u[edge.seen] / DEG).all()
    heading = np.linalg.norm(np.cross(edge.tangent[edge.seen], at_stations(part, edge, "tangent")), axis=1)
    assert np.mean(heading < 2 * edge.tangent_u[edge.seen]) > 0.8


@pytest.mark.slow
def test_depths_of_a_rough_face_are_no_chamfer_of_its_end() -> None:
    """They passed for one of 1.8 mm, and a sound recording was refused."""
    recording, truth = simulate_recording(random_recipe("raw_rough", 17940001))
    edge = segment_raw(denoise(fuse(recording)), upper_side=rough_upper_side(truth))
    off = edge.position_mm[edge.seen] - at_stations(SimpleNamespace(truth=truth), edge, "position_mm")
    assert np.abs((off * edge.across[edge.seen]).sum(axis=1)).max() < 0.05


@pytest.mark.parametrize(
    ("parts", "seed", "most_deg"), [("lost_blocks", 17860000, 0.1), *seldom(("mixed", 17910003, 1))]
)
def test_frames_that_lose_the_lower_part_of_the_face_bend_no_edge(parts: str, seed: int, most_deg: float) -> None:
    """The last returns of 12 mm of it lie 5 mm higher, of the mixed part half of all, which a first look follows."""
    recording, truth = simulate_swept(random_swept_recipe(f"swept_raw_{parts}", seed))
    edge = segment_raw(denoise(fuse(recording)), upper_side=rough_upper_side(truth))
    tangent = at_stations(SimpleNamespace(truth=truth), edge, "tangent")
    assert np.linalg.norm(np.cross(edge.tangent[edge.seen], tangent), axis=1).max() < most_deg * DEG
    assert parts == "mixed" or "short of its course" in " ".join(edge.warnings)


@pytest.mark.slow
def test_a_ring_is_known_to_its_ends() -> None:
    """A course that may be straight but for waves is straight at its ends: 0.24 deg there, at 8 u."""
    recording, truth = simulate_swept(random_swept_recipe("swept_raw_ring", 17910003))
    edge = segment_raw(denoise(fuse(recording)), upper_side=rough_upper_side(truth))
    tangent = at_stations(SimpleNamespace(truth=truth), edge, "tangent")
    off = np.linalg.norm(np.cross(edge.tangent[edge.seen], tangent), axis=1)
    assert (off < 2.0 * edge.tangent_u[edge.seen]).all()


@pytest.mark.parametrize(
    ("parts", "seed", "noise_mm"),
    [("plain", 17971000, None), *seldom(("plain", 17971000, 0.03), ("arc", 17971000, 0.03))],
)
def test_passes_that_disagree_are_averaged(parts: str, seed: int, noise_mm: float | None) -> None:
    """The second lies 0.2 mm off: the edge is half way, as its u says, and has no wave from one pass to the other."""
    recipe = random_swept_recipe(f"swept_raw_{parts}", seed)
    recording, truth = simulate_swept(recipe.model_copy(update={"passes": (*recipe.passes, *recipe.passes)}))
    second = recording.robot_pass > recording.robot_pass[0]
    place = recording.robot_position_mm + np.outer(second, [0.1, -0.12, 0.12])
    cloud = denoise(fuse(with_values(recording, robot_position_mm=place)))
    length_mm = None if noise_mm is None else 20.0
    declared = {"robot_noise_mm": noise_mm, "robot_noise_length_mm": length_mm}
    edge = segment_raw(cloud, upper_side=rough_upper_side(truth), **declared)
    scan = SimpleNamespace(truth=truth)
    for off, u_mm in zip(off_true(scan, edge)[:2], edge.position_u_mm[edge.seen].T, strict=True):
        assert np.abs(off).max() < 0.13
        assert (np.abs(off) < 2.0 * u_mm).all()
    turned = np.linalg.norm(np.cross(edge.tangent[edge.seen], at_stations(scan, edge, "tangent")), axis=1)
    assert turned.max() < 0.2 * DEG


def in_parts(kind: str, order: tuple[int, ...]) -> tuple[Any, Any]:
    """A ring that passes scan a part each, in this order, with a gap of 2 % of the ring between."""
    recipe = random_swept_recipe(kind, 17986000)
    recording, truth = simulate_swept(recipe.model_copy(update={"passes": (*recipe.passes,) * len(order)}))
    share = np.empty(len(recording.time_s))
    for number, part in zip(np.unique(recording.pass_index), order, strict=True):
        mine = recording.pass_index == number
        share[mine] = np.linspace(0.0, len(order), mine.sum()) - part
    return denoise(fuse(frames(recording, (share > 0.03) & (share < 0.97)))), truth


@pytest.mark.parametrize("order", [(0, 2, 1), *seldom(((1, 0),))])
def test_a_raw_ring_is_measured_in_parts(order: tuple[int, ...]) -> None:
    """Parts that do not overlap were placed by their middles, and a curve that began before the longest was lost."""
    cloud, truth = in_parts("swept_raw_ring", order)
    edge = segment_raw(cloud, upper_side=rough_upper_side(truth))
    assert edge.seen.mean() > 0.95
    for off, u_mm in zip(
        off_true(SimpleNamespace(truth=truth), edge)[:2], edge.position_u_mm[edge.seen].T, strict=True
    ):
        assert (np.abs(off) < 2.0 * u_mm).all()


def test_a_milled_ring_is_measured_in_parts() -> None:
    cloud, truth = in_parts("swept_ring", (1, 0))
    edge = segment(cloud)
    root_mm = truth.at(edge.position_mm[edge.seen], truth.root_mm)
    assert edge.seen.mean() > 0.95
    assert (np.abs(edge.root.value[edge.seen] - root_mm) < 2.5 * edge.root.u[edge.seen]).all()


@pytest.mark.parametrize("side", ["lower", *seldom("upper")])
def test_burrs_are_reported_and_move_no_edge(scanned: Scans, side: str) -> None:
    burr = {"edge": side, "from_mm": 14.0, "to_mm": 24.0, "height_mm": 0.4, "width_mm": 0.4}
    plain, burred = (
        segment_raw(scanned(part=RAW | {"burrs": ridge}, passes=[ABOVE]).cloud, upper_side=UP) for ridge in ([], [burr])
    )
    assert plain.burr_stations.size == 0
    at = burred.arc_length_mm[burred.burr_stations] + 5.0
    assert at.size >= 5
    assert at.min() > 13
    assert at.max() < 25
    at = np.linspace(1.0, 28.0, 28)
    for name in ("position_mm", "upper_position_mm"):
        for k in (1, 2):  # along x arc length may start a column's step apart
            one, other = (np.interp(at, e.arc_length_mm, getattr(e, name)[:, k]) for e in (plain, burred))
            assert np.abs(one - other).max() < 0.03


def test_square_on_the_sense_of_z_must_be_told(scanned: Scans) -> None:
    """Only the end face returns: nothing tells front from back but z_away, which then decides n."""
    scan = scanned(
        part=RAW,
        scanner={"columns": 400, "beam": "parallel", "max_incidence_deg": 75.0},
        passes=[ABOVE | {"elevation_deg": 1.0, "aim_mm": [0.0, 4.0]}],
    )
    with pytest.raises(InputError, match="z_away"):
        segment_raw(scan.cloud, upper_side=UP)
    edge = segment_raw(scan.cloud, upper_side=UP, z_away=True)
    along_n, along_m, turn = off_true(scan, edge)
    assert np.abs(along_n).max() < 0.01
    assert np.abs(along_m[1:-1]).max() < 0.04
    assert np.abs(turn).max() < 0.05


def test_upper_side_turned_round_turns_the_edge_round(scanned: Scans) -> None:
    """Lower and upper edge change places, and t changes its sense: that is what `upper_side` is for."""
    scan = scanned(part=RAW, passes=[ABOVE])
    one, other = (segment_raw(scan.cloud, upper_side=(0.0, 0.0, way)) for way in (1.0, -1.0))
    np.testing.assert_allclose(other.tangent[10], -one.tangent[10], atol=2e-3)
    np.testing.assert_allclose(other.normal[10], one.normal[10], atol=2e-3)
    assert one.upper_position_mm is not None
    assert abs(float((other.position_mm[10] - one.upper_position_mm[10])[2])) < 0.05


def test_poses_of_a_pass_s_ends_only_are_as_uncertain_as_declared(scanned: Scans) -> None:
    cloud = scanned(part=RAW, passes=[ABOVE]).cloud
    ends, many = (
        segment_raw(replace(cloud, only_end_poses=only), upper_side=(0.0, 0.0, 1.0), robot_noise_mm=0.05).position_u_mm
        for only in (True, False)
    )
    np.testing.assert_allclose(ends**2 - many**2, 0.05**2, rtol=1e-9)


@pytest.mark.parametrize(
    ("upper_side", "message"),
    [
        ((1.0, 0.1, 0.2), "runs along the edge"),
        ((0.0, 1.0, 0.0), r"edge not in view|no raw edge"),
    ],
)
def test_unusable_upper_sides_are_refused(scanned: Scans, upper_side: tuple[float, float, float], message: str) -> None:
    cloud = scanned(part=RAW, passes=[ABOVE]).cloud
    with pytest.raises(InputError, match=message) as refusal:
        segment_raw(cloud, upper_side=upper_side)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("aim_mm", "name"), [((-2.0, 17.5), "lower"), ((-2.0, -12.0), "upper")])
def test_an_edge_seen_only_in_part_is_refused(scanned: Scans, aim_mm: tuple[float, float], name: str) -> None:
    scan = scanned(part=RAW, passes=[ABOVE | {"aim_mm": list(aim_mm), "skew_mm": [0.0, 0.0]}])
    with pytest.raises(InputError, match=f"{name} edge not in view"):
        segment_raw(scan.cloud, upper_side=UP, z_away=True)


def test_a_milled_edge_is_no_raw_edge(scanned: Scans) -> None:
    with pytest.raises(InputError, match=r"not in view|no raw edge"):
        segment_raw(scanned(part={"length_mm": 60.0, "root_mm": 3.0}).cloud, upper_side=UP)


def test_too_few_frames_and_an_empty_view_are_refused(scanned: Scans) -> None:
    cloud = scanned(part=RAW, passes=[ABOVE]).cloud
    few = replace(
        cloud,
        **{
            name: getattr(cloud, name)[:2]
            for name in ("x_mm", "z_mm", "keep", "base_from_profiler", "time_s", "pass_index")
        },
    )
    with pytest.raises(InputError, match="at least 3 frames"):
        segment_raw(few, upper_side=UP)
    with pytest.raises(InputError):
        segment_raw(replace(cloud, keep=np.zeros_like(cloud.keep)), upper_side=UP)


@pytest.mark.parametrize("sampling", ["lateral", "angular"])
def test_what_only_the_lower_end_tells_is_said(scanned: Scans, sampling: str) -> None:
    """Seen from below, by columns that are parallel: a table in front would look alike."""
    passes = [{"from_mm": 5.0, "to_mm": 35.0, "elevation_deg": -25.0}]
    scan = scanned(part=RAW, passes=passes, scanner={"sampling": sampling})
    edge = segment_raw(scan.cloud, upper_side=UP)
    told = [words for words in edge.warnings if "told only by what joins the lower end" in words]
    assert len(told) == (sampling == "lateral")


def test_thin_sheet_is_measured(scanned: Scans) -> None:
    """Refused below 2 mm."""
    scan = scanned(part=RAW | {"thickness_mm": 1.2}, passes=[ABOVE])
    edge = found(scan)
    assert edge.seen.mean() > 0.9
    off = np.stack(off_true(scan, edge), axis=1)
    u = np.column_stack([edge.position_u_mm, edge.normal_u / DEG])[edge.seen]
    assert (np.abs(off) < 3.0 * u).all()
    assert (np.median(u, axis=0) < [0.1, 0.1, 0.5]).all()
