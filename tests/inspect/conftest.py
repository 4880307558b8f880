"""Edges as `edge.segment` hands them on, with known root faces, angles and noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from workbench.artefacts import Edge, EdgeFrames
from workbench.units import DEG, Float

Course = Callable[[Float], Float]


@dataclass(frozen=True)
class EdgeMaker:
    """A straight edge along x from x = 100, seen in frames every 0.2 mm; root faces in mm, angles in rad."""

    length_mm: float = 90.0
    root: Course = lambda s: 1.5 + 0 * s
    bevel: Course = lambda s: 40 * DEG + 0 * s
    tilt: Course = lambda s: 0.3 + 0 * s  # true direction of the root face
    bevel_noise: float = 0.002
    root_noise: float = 0.02
    stated: float = 1.0  # noise as the frames' variances state it, over what it is
    passes: int = 1
    hidden_mm: tuple[float, float] | None = None
    stray_share: float = 0.0
    tangent_leverage: float = 0.0
    tangent_u: float = 0.0

    def __call__(self, seed: int = 0, **changes: object) -> Edge:
        return replace(self, **changes)._edge(np.random.default_rng(seed))  # type: ignore[arg-type]

    def _edge(self, rng: np.random.Generator) -> Edge:
        once = np.arange(0, self.length_mm + 1e-9, 0.2)
        s = np.concatenate([once if p % 2 == 0 else once[::-1] for p in range(self.passes)])
        number = np.repeat(np.arange(self.passes), once.size)
        here = np.ones(s.size, bool)
        if self.hidden_mm:
            here = (s <= self.hidden_mm[0]) | (s >= self.hidden_mm[1])
        frames = self._frames(s, number, here, rng)
        at = np.arange(0.0, self.length_mm + 0.5)
        seen = np.ones(at.size, bool)
        if self.hidden_mm:
            seen = (at <= self.hidden_mm[0]) | (at >= self.hidden_mm[1])
        position = np.outer(at, [1.0, 0, 0]) + np.array([100, 20, 30])
        position[~seen] = np.nan
        same = [np.tile(axis, (at.size, 1)) for axis in np.eye(3)]
        return Edge(
            kind="milled", faces={}, labels=np.zeros((s.size, 1), np.uint8), pass_index=number,
            frame_arc_length_mm=frames.lower_arc_length_mm, frame_tangent=np.tile([1.0, 0, 0], (s.size, 1)),
            frames=frames, tangent_u=self.tangent_u, arc_length_mm=at, position_mm=position, tangent=same[0],
            normal=-same[1], across=same[2], seen=seen, burr_stations=np.empty(0, np.int64),
        )  # fmt: skip

    def _frames(self, s: Float, number: Float, here: Float, rng: np.random.Generator) -> EdgeFrames:
        n, step = s.size, 0.05
        root_angle = self.tilt(s) + rng.normal(0, self.root_noise, n)
        tilt = np.empty(n)
        for p in range(self.passes):
            tilt[number == p] = root_angle[(number == p) & here].mean()
        bevel_angle = self.tilt(s).mean() - self.bevel(s) + rng.normal(0, self.bevel_noise, n)
        stray = rng.random(n) < self.stray_share
        bevel_angle[stray] += rng.uniform(0.05, 0.5, stray.sum())
        phase = rng.uniform(0, step, n)
        low = phase + step * np.floor((self.root(s) - phase) / step) + rng.normal(0, 0.004, n)

        def where(value: Float | float) -> Float:
            return np.where(here, value, np.nan)

        return EdgeFrames(
            arc_length_mm=where(s), lower_arc_length_mm=where(s), reference=np.tile([0.0, 1.0, 0.0], (n, 1)),
            tilt=where(tilt), root_angle=where(root_angle),
            root_angle_variance=where((self.stated * self.root_noise) ** 2), bevel_arc_length_mm=where(s),
            bevel_angle=where(bevel_angle), bevel_angle_variance=where((self.stated * self.bevel_noise) ** 2),
            bevel_lever_mm=where(4.0),
            root_low_mm=where(low), root_step_mm=where(step), root_sigma_mm=where(0.004), root_weight=where(1.0),
            missing=where(0.02), tangent_leverage=where(self.tangent_leverage),
        )  # fmt: skip


@pytest.fixture
def edge() -> EdgeMaker:
    """`edge(seed, root=..., ...)` makes an edge."""
    return EdgeMaker()
