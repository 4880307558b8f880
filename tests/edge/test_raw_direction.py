"""Where the end face runs in each frame, and which way z counts, from nothing but a rough direction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from workbench.edge.raw_direction import face_directions, fan_sense
from workbench.units import DEG

Scans = Callable[..., Any]
RAW = {"kind": "raw", "length_mm": 60.0, "roughness_mm": 0.2, "end_face_tilt_deg": 3.0}


@pytest.mark.parametrize("off_deg", [-25.0, -10.0, 0.0, 10.0, 25.0])
def test_a_rough_direction_is_enough(scanned: Scans, off_deg: float) -> None:
    """Up to 25 deg off in the section: the face's own direction is found as its roughness turns it, within 2.5 deg."""
    scan = scanned(part=RAW)
    truth = scan.truth
    told = np.cos(off_deg * DEG) * truth.across[0] + np.sin(off_deg * DEG) * truth.normal[0]
    along, sense, _ = face_directions(scan.cloud, tuple(told), None)
    pose = scan.cloud.base_from_profiler
    line = along[:, :1] * pose[:, :3, 0] + along[:, 1:] * pose[:, :3, 2]
    assert sense == 1.0
    assert (line @ truth.across[0]).min() > 0.99
    assert np.abs(np.arcsin(line @ truth.normal[0])).max() < 2.5 * DEG


@pytest.mark.parametrize("z_away", [True, False])
@pytest.mark.parametrize("x_rises", [True, False])
def test_axes_of_the_sensor_are_found_out(scanned: Scans, z_away: bool, x_rises: bool) -> None:
    scan = scanned(part=RAW, scanner={"columns": 500, "z_away": z_away, "x_rises": x_rises})
    along, sense, _ = face_directions(scan.cloud, (0.0, 0.0, 1.0), None)
    assert sense == (1.0 if z_away else -1.0)
    assert np.isfinite(along).all()


@pytest.mark.parametrize("z_away", [True, False])
@pytest.mark.parametrize("x_rises", [True, False])
@pytest.mark.parametrize("sampling", ["angular", "lateral"])
def test_rays_that_fan_out_tell_the_sense_of_z(scanned: Scans, z_away: bool, x_rises: bool, sampling: str) -> None:
    """Not where the sensor resamples its columns: x is the same in every frame then."""
    scanner = {"columns": 500, "z_away": z_away, "x_rises": x_rises, "sampling": sampling}
    scan = scanned(part={"kind": "raw", "length_mm": 40.0}, scanner=scanner)
    assert fan_sense(scan.cloud) == ((1.0 if z_away else -1.0) if sampling == "angular" else 0.0)


def test_returns_put_into_a_grid_tell_no_sense_of_z(scanned: Scans) -> None:
    """In a column of a grid lies what fell into it: x changes with z there by the surface's slope, not by a ray's."""
    cloud = scanned(part={"kind": "raw", "length_mm": 40.0}, scanner={"columns": 500}).cloud
    rng = np.random.default_rng(4)
    frames, columns, pitch_mm = *cloud.x_mm.shape, 0.05
    x_mm = pitch_mm * (np.arange(columns) - columns / 2 + rng.uniform(-0.5, 0.5, (frames, columns)))
    hollow_mm = x_mm**2 / 25.0 + rng.normal(0.0, 0.02, (frames, 1))
    gridded = replace(cloud, x_mm=x_mm.astype(np.float32), z_mm=(200.0 + hollow_mm).astype(np.float32))
    assert fan_sense(gridded) == 0.0


def test_a_table_before_the_face_does_not_turn_the_sense_round(scanned: Scans) -> None:
    scan = scanned(part=RAW | {"table_gap_mm": 1.0})
    assert face_directions(scan.cloud, (0.0, 0.0, 1.0), None).sense == 1.0
