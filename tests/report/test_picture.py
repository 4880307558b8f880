"""A view of a large cloud takes little memory."""

from __future__ import annotations

import dataclasses
import tracemalloc

import numpy as np

from workbench.artefacts import BEVEL_FACE, Cloud
from workbench.report.scene import overview


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
