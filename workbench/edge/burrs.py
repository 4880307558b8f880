"""Burrs: material that stands out beyond the faces. They do not move the edges; they are reported."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Cloud
from workbench.edge.faces import TrackedFaces
from workbench.edge.measure import Measured
from workbench.geometry.blocks import as_input, over_blocks
from workbench.kernels import kernel
from workbench.units import AnyArray, Bool, Float, Float32, Int

REACH_MM = 1.0  # how far beyond an end of the root face burrs are looked for
STANDS_OUT_SIGMAS = 8.0
STANDS_OUT_MM = 0.08
LEAST_POINTS = 3  # in a frame
LEAST_FRAMES = 2  # that agree, near a station


def burr_stations(cloud: Cloud, tracked: TrackedFaces, measured: Measured, at: Float) -> Int:
    """Stations (of `at`, mm) near which several frames show points standing out of the root face at one of its ends."""
    root, bevel = tracked.faces[ROOT_FACE], tracked.faces[BEVEL_FACE]
    slope = root.sxz / root.sxx
    sense = float(np.nanmedian(np.sign(tracked.side * (slope - bevel.sxz / bevel.sxx))))  # +1: z counts away
    line = np.stack([root.x_mean, root.z_mean, slope, -sense / np.hypot(1.0, slope)], axis=1)
    reach = np.sqrt(3.0 * root.sxx / root.count) + REACH_MM
    limit = np.maximum(STANDS_OUT_MM, STANDS_OUT_SIGMAS * tracked.range_sigma_mm[:, 2])
    grid = as_input(cloud.x_mm), as_input(cloud.z_mm), as_input(cloud.keep), as_input(tracked.labels)
    known = as_input(line), as_input(tracked.side), as_input(reach), as_input(limit)
    counts = over_blocks(lambda i, j: _standing_out(*grid, *known, i, j), cloud.x_mm.shape)
    found = tracked.seen & (np.concatenate(counts) >= LEAST_POINTS)
    s = measured.s_low[found & np.isfinite(measured.s_low)]
    number = np.rint(np.interp(s, at, np.arange(at.size))).astype(np.int64)
    count = np.bincount(number, minlength=at.size)
    return np.flatnonzero(count >= LEAST_FRAMES)


@kernel
def _standing_out(
    x: Float32,
    z: Float32,
    keep: Bool,
    labels: AnyArray,
    line: Float,
    side: Float,
    reach: Float,
    limit: Float,
    first: int,
    last: int,
) -> Int:
    """How many points of each frame first to last - 1 stand out of the root face about its lower half.

    line (N, 4): x and z of the root face's middle, its slope, and distance out of it per mm of range. Points of a face
    do not count; frames without a root face (NaN) have none.
    """
    out = np.zeros(last - first, np.int64)
    for i in range(first, last):
        for j in range(x.shape[1]):
            dx = x[i, j] - line[i, 0]
            if keep[i, j] and side[i] * dx > 0.0 and abs(dx) < reach[i] and labels[i, j] == 0:
                off = (z[i, j] - line[i, 1] - line[i, 2] * dx) * line[i, 3]
                out[i - first] += limit[i] < off < REACH_MM
    return out
