"""What every frame says about the edge, against the truth of simulated parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from bench.drawn.plates import random_recipe
from bench.odd_plates import odd_plate
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.errors import InputError
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic import Truth, simulate_recording
from workbench.units import Float

Scans = Callable[..., Any]
WAVES = {"length_mm": 60.0, "root_mm": {"start": 1.3, "end": 1.6}, "bevel_deg": {"start": 39.0, "end": 41.0}}


def truth_at(scan: Any, s: Float) -> tuple[Truth, Float]:
    """The truth, and base positions of the measured lower edge at arc lengths s."""
    return scan.truth, scan.measured.curve.position(s)


@pytest.mark.parametrize("oblique_deg", [0.0, 12.0])
@pytest.mark.parametrize("elevation_deg", [40.0, -25.0])
def test_frames_bracket_the_root_size(scanned: Scans, elevation_deg: float, oblique_deg: float) -> None:
    """It lies between the last return on the root face and the next column, or, from below, at the measured corner."""
    scan = scanned(
        part=WAVES,
        passes=[
            {
                "from_mm": 5.0,
                "to_mm": 55.0,
                "elevation_deg": elevation_deg,
                "oblique_deg": oblique_deg,
                "skew_mm": [-1.0, 1.0],
            }
        ],
    )
    f = scan.measured.ends
    assert np.isfinite(f.low).mean() > 0.95
    seen = np.flatnonzero(np.isfinite(f.low))
    truth, position = truth_at(scan, scan.measured.upper_s[seen])
    size = truth.root_mm_at(position)
    low, high = f.low[seen], f.low[seen] + f.step[seen]
    room = 3 * f.sigma[seen] + 0.002
    assert ((low - room < size) & (size < high + room)).mean() > 0.97
    if elevation_deg < 0:
        assert (f.step[seen] == 0).all()
        assert np.std((low - size) / f.sigma[seen]) == pytest.approx(1, abs=0.35)
    else:
        assert (f.step[seen] > 0.05).all()
        assert np.ptp(low - size) > 0.7 * 0.05  # all phases of the columns' step


@pytest.mark.parametrize("oblique_deg", [15.0, -15.0])
def test_drift_of_the_faces_does_not_bend_what_oblique_frames_see(scanned: Scans, oblique_deg: float) -> None:
    """Root face and angle drift against each other: an oblique frame's bevel would turn by 0.1 deg."""
    scan = scanned(
        part={"length_mm": 60.0, "root_mm": {"start": 1.2, "end": 1.8}, "bevel_deg": {"start": 42.0, "end": 38.0}},
        scanner={"columns": 500, "noise": {"sd_mm": 0.002}},
        passes=[{"from_mm": 5.0, "to_mm": 55.0, "oblique_deg": oblique_deg, "skew_mm": [-1, 1]}],
    )
    edge = scan.edge
    error = edge.bevel.value - scan.truth.bevel_deg_at(edge.position_mm)
    assert abs(np.nanmean(error[edge.seen])) < 0.03


@pytest.mark.parametrize(
    "curve",
    [
        {"shape": "straight"},
        {"shape": "arc", "radius_mm": 300.0},
        {"shape": "arc", "radius_mm": 300.0, "sense": "concave"},
    ],
)
def test_the_lower_edge_is_where_it_was_built(scanned: Scans, curve: dict[str, Any]) -> None:
    """Poses are exact here: the measured curve lies within some hundredths of a mm of the true edge."""
    scan = scanned(part={"length_mm": 60.0, "curve": curve})
    at = np.linspace(1, np.nanmax(scan.measured.s_low) - 1, 40)
    curve, along = scan.measured.curve, at + scan.measured.shift
    position, tangent = curve.position(along), curve.tangent(along)
    s = scan.truth.arc_length_mm_at(position)
    true = np.stack([np.interp(s, scan.truth.arc_length_mm, scan.truth.position_mm[:, k]) for k in range(3)], axis=1)
    assert np.linalg.norm(position - true, axis=1).max() < 0.02
    straight = np.stack([np.interp(s, scan.truth.arc_length_mm, scan.truth.tangent[:, k]) for k in range(3)], axis=1)
    assert np.linalg.norm(tangent - straight, axis=1).max() < 0.005
    np.testing.assert_allclose(np.diff(s), np.diff(at), rtol=0.01)


def test_arc_length_counts_from_the_first_point_of_the_lower_edge(scanned: Scans) -> None:
    for ends in ((5.0, 55.0), (55.0, 5.0)):
        scan = scanned(passes=[{"from_mm": ends[0], "to_mm": ends[1]}])
        s = scan.measured.s_low
        assert np.nanmin(s) == 0
        assert np.nanmax(s) == pytest.approx(50, abs=0.2)
        assert (np.sign(np.nanmedian(np.diff(s))) > 0) == (ends[0] < ends[1])  # t is the part's, not the robot's
        first = scan.measured.curve.position(np.array([scan.measured.shift]))
        assert scan.truth.arc_length_mm_at(first)[0] == pytest.approx(5, abs=0.1)


def test_vibration_moves_no_size(scanned: Scans) -> None:
    """Each frame measures from its own corner."""
    quiet, shaken = (scanned(part=WAVES, robot={"vibration_mm": v}).edge for v in (0.0, 0.05))
    assert np.abs(np.nanmean(shaken.root.value - scanned(part=WAVES).truth.root_mm_at(shaken.position_mm))) < 0.02
    assert np.nanmean(shaken.bevel.value) == pytest.approx(np.nanmean(quiet.bevel.value), abs=0.05)


def test_frames_that_do_not_advance_are_refused(scanned: Scans) -> None:
    cloud = scanned().cloud
    still = replace(cloud, base_from_profiler=np.tile(cloud.base_from_profiler[100], (len(cloud.keep), 1, 1)))
    with pytest.raises(InputError, match=r"expected at least 3 frames that see the edge along at least 1 mm of it"):
        segment(still)


def test_a_bevel_above_a_ledge_is_no_root_face() -> None:
    """Upper surface and bevel were taken for bevel and root face, and the ledge beyond for a burr."""
    part = odd_plate("ledge of 0.05 to 0.5 mm", 1618, False)
    up = tuple(part.base_from_section[:3, 1])
    for given, told in ({}, "no edge in view"), ({"upper_side": up}, r"complement_nearer_deg: 1\d.*, limit 5"):
        with pytest.raises(InputError, match=told):
            segment(denoise(fuse(part.recording)), root_nominal_mm=3.0, bevel_nominal_deg=40.0, **given)


@pytest.mark.parametrize("seed", [2, 4])
def test_a_filter_of_the_sensor_bends_no_face(seed: int) -> None:
    """A Gaussian over one column mixes both faces beside their corner: the bevel was 0.2 deg off at three u."""
    recording, truth = simulate_recording(random_recipe("straight", seed))
    seen = np.isfinite(recording.z_mm)
    total, weight = (
        gaussian_filter1d(of.astype(float), 1.0, axis=1) for of in (np.where(seen, recording.z_mm, 0.0), seen)
    )
    smooth = np.where(seen, total / np.maximum(weight, 1e-3), np.nan).astype(np.float32)
    root, bevel = (round(float(of.mean()), 1) for of in (truth.root_mm, truth.bevel_deg))
    cloud = denoise(fuse(replace(recording, z_mm=smooth)))
    told = sections(segment(cloud, root_nominal_mm=root, bevel_nominal_deg=bevel)).sections
    off = [one.bevel_deg - float(truth.bevel_deg_at(one.origin_mm[None])[0]) for one in told if one.bevel_deg]
    assert len(off) > 5
    assert abs(np.median(off)) < 0.08
