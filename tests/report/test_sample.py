"""What is drawn: thin enough, in the right place, and with the root face still there."""

from __future__ import annotations

import dataclasses
import tracemalloc

import numpy as np
import pytest

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Cloud
from workbench.report.scene import around, frame_arc_length_mm, of_section, overview, rejected


@pytest.mark.parametrize("budget", [3_000, 20_000, 10**7])
def test_overview_keeps_to_its_budget_and_keeps_the_root_face(part, budget):
    p = part()
    points = overview(p.cloud, p.edge, budget)
    assert 0 < len(points.frame) < 1.5 * budget
    for frame in np.unique(points.frame[points.label == BEVEL_FACE]):
        assert np.count_nonzero(points.label[points.frame == frame] == ROOT_FACE) >= 4


def test_positions_are_those_of_the_grid(part):
    p = part(frames=60, columns=80)
    points = overview(p.cloud, p.edge, 10**7)
    i, j = points.frame, points.column
    x, z = p.cloud.x_mm[i, j].astype(float), p.cloud.z_mm[i, j].astype(float)
    profiler = np.column_stack([x, 0 * x, z, 0 * x + 1])
    expected = np.einsum("nij,nj->ni", p.cloud.base_from_profiler[i], profiler)[:, :3]
    np.testing.assert_allclose(points.position_mm, expected, atol=1e-9)
    assert p.cloud.keep[i, j].all()


def test_rejected_points_are_all_found_when_no_frame_is_skipped(part):
    p = part(frames=100, columns=100)
    points, step = rejected(p.cloud, p.edge, 10**6)
    assert step == 1
    assert len(points.frame) == sum(p.cloud.rejected.values())
    _, step = rejected(p.cloud, p.edge, 1_000)
    assert step == 10


def test_around_and_of_section_stay_near_their_section(part):
    p = part()
    section = p.inspection.sections[1]
    arc_length = frame_arc_length_mm(p.cloud, p.edge)
    near = around(p.cloud, p.edge, section.arc_length_mm, 5.0, 10**6)
    assert np.abs(arc_length[near.frame] - section.arc_length_mm).max() <= 5.0
    assert set(of_section(p.cloud, p.edge, section, 10**6).frame) <= set(section.frames)


def test_a_large_cloud_is_not_copied(part):
    p = part(frames=50, columns=50)
    frames, columns = 200_000, 400  # 0.3 GB an array, were it materialised
    big = Cloud(
        np.broadcast_to(np.linspace(0, 20, columns, dtype=np.float32), (frames, columns)),
        np.broadcast_to(np.float32(200.0), (frames, columns)),
        np.broadcast_to(True, (frames, columns)),
        np.broadcast_to(np.eye(4), (frames, 4, 4)),
        np.broadcast_to(0.0, frames),
        np.broadcast_to(np.int64(0), frames),
    )
    labels = np.broadcast_to(np.uint8(BEVEL_FACE), (frames, columns))
    edge = dataclasses.replace(p.edge, labels=labels)
    tracemalloc.start()
    points = overview(big, edge, 100_000)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0 < len(points.frame) < 150_000
    assert peak < 100e6
