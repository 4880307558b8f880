"""Burrs on a raw edge: where most frames show points standing out beside an edge. They move nothing."""

from __future__ import annotations

import numpy as np

from workbench.edge.raw_faces import RawFaces
from workbench.edge.raw_measure import RawMeasured
from workbench.units import Bool, Float, Int

NEAR_MM = 1.2  # of a station, whose frames have a say
LEAST_FRAMES, LEAST_SHARE = 2, 0.5  # of them: streaks of outliers do not last that long


def raw_burr_stations(found: RawFaces, measured: RawMeasured, at: Float) -> Int:
    """Stations (of `at`, mm) at which the lower or the upper edge carries a burr."""
    low = _most(measured.s_face, found.lower.burred, at)
    high = _most(measured.s_face, found.upper.burred, at)
    return np.flatnonzero(low | high)


def _most(s: Float, burred: Bool, at: Float) -> Bool:
    """Do most frames near each place (m,) show a burr?"""
    seen = np.isfinite(s)
    order = np.argsort(s[seen], kind="stable")
    place, count = s[seen][order], np.concatenate([[0], np.cumsum(burred[seen][order])])
    first, last = np.searchsorted(place, at - NEAR_MM), np.searchsorted(place, at + NEAR_MM)
    shown = count[last] - count[first]
    return np.asarray((shown >= LEAST_FRAMES) & (shown >= LEAST_SHARE * (last - first)))
