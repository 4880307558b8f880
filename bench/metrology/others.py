"""The other methods on the same parts: what each is given, and its errors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench.metrology.bound import WINDOW_MM
from bench.metrology.information import ALONG, COUNT, Frames, Rays
from bench.metrology.part_result import Numbers, numbers
from bench.metrology.places import clear_of_boundaries, parameter_at
from bench.peers import open3d_planes, per_profile
from workbench.artefacts import Recording
from workbench.geometry import grids
from workbench.scan import fuse
from workbench.synthetic import Truth, raycast
from workbench.units import Float, Int

SECTIONS = 9
Errors = dict[str, Numbers]  # "root_mm", "bevel_deg": measured less true


def with_per_profile(recording: Recording, truth: Truth, rays: Rays, frames: Frames) -> Errors:
    """The simple method, profile by profile, over the frames whose sections count for ours too."""
    stations = true_sections(truth)
    at = parameter_at(truth, truth.position_mm[stations])
    off = np.where(frames.root[:, COUNT] > 0, frames.root[:, ALONG], np.inf) - at[:, None]
    near = [np.flatnonzero(np.abs(row) <= WINDOW_MM) for row in off]
    found = per_profile.inspect(recording, rays.faces == raycast.ROOT, rays.faces == raycast.BEVEL, near)
    return errors(*found, truth, stations)


def with_open3d(recording: Recording, truth: Truth, rays: Rays, frames: Frames) -> Errors:
    """Open3D's statistical outlier removal and RANSAC planes."""
    stations, middle = true_sections(truth), len(truth.arc_length_mm) // 2
    cloud, origin = fuse(recording), truth.position_mm[middle]
    points = grids.fuse(cloud.x_mm, cloud.z_mm, cloud.base_from_profiler, origin)
    chosen = points[np.isin(rays.faces, (raycast.ROOT, raycast.BEVEL)) & cloud.keep].astype(float)
    found = open3d_planes.inspect(
        chosen,
        truth.normal[middle],
        truth.position_mm[stations] - origin,
        truth.tangent[stations],
        truth.recipe.seed,
    )
    return errors(*found, truth, stations)


PEERS: dict[str, Callable[[Recording, Truth, Rays, Frames], Errors]] = {
    "per_profile": with_per_profile,
    "open3d": with_open3d,
}


def true_sections(truth: Truth) -> Int:
    """Stations of nine sections, equidistant over the stretch of edge that was seen; those in hidden parts left out."""
    seen = np.flatnonzero(truth.seen)
    at = seen[0] + (np.arange(SECTIONS) + 0.5) / SECTIONS * (seen[-1] - seen[0])
    stations = np.rint(at).astype(int)
    return np.asarray(stations[clear_of_boundaries(truth, truth.position_mm[stations])[0]])


def errors(root_mm: Float, bevel_deg: Float, truth: Truth, stations: Int) -> Errors:
    """Measured less true."""
    return {
        "root_mm": numbers(root_mm - truth.root_mm[stations]),
        "bevel_deg": numbers(bevel_deg - truth.bevel_deg[stations]),
    }
