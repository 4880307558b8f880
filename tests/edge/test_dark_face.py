"""A face whose light hardly suffices ends before its edge does: the brightness of its returns tells by how much."""

from dataclasses import replace

import numpy as np
import pytest

from bench.simulators.triangulated import STRAIGHT_MM, Sensor, Way, Workpiece, simulate
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.scan import fuse

PART = Workpiece("milled", length_mm=60.0, radius_mm=STRAIGHT_MM, thickness_mm=6.0)
LED = Way(step_mm=0.5, elevation=0.8, aim_mm=(-1.5, 3.0), drift_mm=2.0)


def root_errors(recording, truth):
    edge = segment(denoise(fuse(recording)), edge_condition="sharp", root_nominal_mm=1.5, bevel_nominal_deg=40.0)
    nearest = [np.linalg.norm(truth["position_mm"] - place, axis=1).argmin() for place in edge.position_mm]
    return edge.root.value - truth["root_mm"][nearest], edge.root.u


@pytest.mark.parametrize("threshold", [0.1, 0.98])  # of the median light, which is that of the root face
def test_brightness_of_the_last_returns(threshold):
    seen = simulate(PART, Sensor(width_mm=20.0, shine=0.3, threshold=threshold), [LED], 5)
    error, u = root_errors(seen.recording, seen.truth)
    assert np.abs(error / u).max() < 2.0
    assert np.median(u) < 0.015


def test_one_brightness_everywhere_tells_nothing():
    seen = simulate(PART, Sensor(width_mm=20.0), [LED], 5)
    flat = replace(seen.recording, intensity=np.full_like(seen.recording.intensity, 7))
    without = replace(seen.recording, intensity=None)
    np.testing.assert_array_equal(root_errors(flat, seen.truth), root_errors(without, seen.truth))
