"""Edges as `edge.segment` hands them on, with known root faces, angles and uncertainties."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from workbench.artefacts import DIRECTIONS, END, TANGENT, MilledEdge, Quantity
from workbench.units import Float

Course = Callable[[Float], Float]


@dataclass(frozen=True)
class EdgeMaker:
    """A straight edge along x from x = 100, seen in frames every 0.2 mm; root faces in mm, angles in degrees."""

    length_mm: float = 90.0
    root: Course = lambda s: 1.5 + 0 * s
    bevel: Course = lambda s: 40 + 0 * s
    root_u_mm: tuple[float, float] = (0.003, 0.004)  # of the end and of the directions
    bevel_u_deg: tuple[float, float] = (0.03, 0.04)  # of the directions and of the tangent
    hidden_mm: tuple[float, float] | None = None

    def __call__(self, **changes: object) -> MilledEdge:
        return replace(self, **changes)._edge()  # type: ignore[arg-type]

    def _edge(self) -> MilledEdge:
        frames = np.arange(0, self.length_mm + 1e-9, 0.2)
        at = np.arange(0.0, self.length_mm + 0.5)
        seen = np.ones(at.size, bool)
        if self.hidden_mm:
            frames[(frames > self.hidden_mm[0]) & (frames < self.hidden_mm[1])] = np.nan
            seen = (at <= self.hidden_mm[0]) | (at >= self.hidden_mm[1])
        position = np.outer(at, [1.0, 0, 0]) + np.array([100, 20, 30])
        position[~seen] = np.nan
        same = [np.tile(axis, (at.size, 1)) for axis in np.eye(3)]
        whole = np.ones(at.size)
        return MilledEdge(
            faces={},
            labels=np.zeros((frames.size, 1), np.uint8),
            pass_index=np.zeros(frames.size, np.int64),
            frame_arc_length_mm=frames,
            tangent_u=0.0 * whole,
            arc_length_mm=at,
            position_mm=position,
            tangent=same[0],
            normal=-same[1],
            across=same[2],
            seen=seen,
            burr_stations=np.empty(0, np.int64),
            root=Quantity.of(
                "root_mm", self.root(at), {END: self.root_u_mm[0] * whole, DIRECTIONS: self.root_u_mm[1] * whole}
            ),
            bevel=Quantity.of(
                "bevel_deg",
                self.bevel(at),
                {DIRECTIONS: self.bevel_u_deg[0] * whole, TANGENT: self.bevel_u_deg[1] * whole},
            ),
        )


@pytest.fixture
def edge() -> EdgeMaker:
    """`edge(root=..., ...)` makes an edge."""
    return EdgeMaker()
