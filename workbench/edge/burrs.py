"""Burrs: material that stands out beyond the faces. They do not move the edges; they are reported."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Cloud
from workbench.edge.faces import TrackedFaces
from workbench.edge.measure import Measured
from workbench.units import Float, Int

REACH_MM = 1.0  # how far beyond an end of the root face burrs are looked for
STANDS_OUT_SIGMAS = 8.0
STANDS_OUT_MM = 0.08
LEAST_POINTS = 3  # in a frame
LEAST_FRAMES = 2  # that agree, near a station


def burr_stations(cloud: Cloud, tracked: TrackedFaces, measured: Measured, at: Float) -> Int:
    """Stations (of `at`, mm) near which several frames show points standing out of the root face at one of its ends."""
    frames = np.flatnonzero(tracked.seen)
    root, bevel = tracked.faces[ROOT_FACE], tracked.faces[BEVEL_FACE]
    slope = root.sxz / root.sxx
    sense = np.nanmedian(np.sign(tracked.side * (slope - bevel.sxz / bevel.sxx)))  # +1: z counts away
    found = np.zeros(len(tracked.seen), bool)
    for i in frames:
        near = np.abs(cloud.x_mm[i] - root.x_mean[i]) < np.sqrt(3.0 * root.sxx[i] / root.count[i]) + REACH_MM
        lower_half = tracked.side[i] * (cloud.x_mm[i] - root.x_mean[i]) > 0
        j = np.flatnonzero(near & lower_half & cloud.keep[i] & (tracked.labels[i] == 0))
        if j.size < LEAST_POINTS:
            continue
        out = -sense * (cloud.z_mm[i, j] - root.z_mean[i] - slope[i] * (cloud.x_mm[i, j] - root.x_mean[i]))
        out /= np.hypot(1.0, slope[i])
        limit = max(STANDS_OUT_MM, STANDS_OUT_SIGMAS * tracked.range_sigma_mm[i, 2])
        found[i] = np.count_nonzero((out > limit) & (out < REACH_MM)) >= LEAST_POINTS
    s = measured.s_low[found & np.isfinite(measured.s_low)]
    number = np.rint(np.interp(s, at, np.arange(at.size))).astype(np.int64)
    count = np.bincount(number, minlength=at.size)
    return np.flatnonzero(count >= LEAST_FRAMES)
