"""Raw edges as truth has them, with clouds of the simulated scanner: nothing here rests on `edge.segment_raw`."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from workbench.artefacts import LOWER_SURFACE, ROOT_FACE, UNLABELLED, UPPER_SURFACE, Cloud, RawEdge, Toolpath
from workbench.cloud import denoise
from workbench.path import feed, layers
from workbench.scan import fuse
from workbench.synthetic import Truth, parse_recipe, simulate_recording
from workbench.units import AnyArray, Float


@dataclass(frozen=True)
class Raw:
    """A scanned raw part: its truth, its cloud, and its edge as a perfect measurement gives it."""

    truth: Truth
    cloud: Cloud
    edge: RawEdge
    start_mm: float  # arc length of the truth at which the edge's own begins

    @functools.cached_property
    def plan(self) -> Toolpath:
        """The shipped path with its feed: planned once, since every check of a path begins with it."""
        return feed(layers(self.edge, self.cloud), self.cloud, self.edge)


def true_edge(truth: Truth, cloud: Cloud) -> tuple[RawEdge, float]:
    """The edge that a measurement without error would give: stations 1 mm apart over what was seen."""
    s = truth.arc_length_mm
    seen = np.flatnonzero(truth.seen)
    low, high = s[seen[0]], s[seen[-1]]
    at = np.linspace(low, high, round(high - low) + 1)

    def along(values: Float) -> Float:
        return np.stack([np.interp(at, s, values[:, k]) for k in range(3)], axis=1)

    position, t, n, m = (along(v) for v in (truth.position_mm, truth.tangent, truth.normal, truth.across))
    here = np.interp(at, s, truth.seen.astype(float)) > 0.999
    upper = position + np.interp(at, s, truth.thickness_mm)[:, None] * m
    position[~here], upper[~here] = np.nan, np.nan
    edge = RawEdge(
        faces={},
        labels=_labels(truth, cloud),
        pass_index=cloud.pass_index,
        frame_arc_length_mm=_crossings(truth, cloud) - low,
        tangent_u=np.zeros(at.size),
        arc_length_mm=at - low,
        position_mm=position,
        tangent=t,
        normal=n,
        across=m,
        seen=here,
        burr_stations=np.empty(0, np.int64),
        upper_position_mm=upper,
        upper_inward=-n,
        position_u_mm=np.zeros((at.size, 2)),
        normal_u=np.zeros(at.size),
    )
    return edge, float(low)


def _labels(truth: Truth, cloud: Cloud) -> AnyArray:
    """Faces of the plate, by the distance of each point from the true ones."""
    profile = np.stack([cloud.x_mm, 0 * cloud.x_mm, cloud.z_mm], axis=-1).astype(float)
    pose = cloud.base_from_profiler
    points = np.einsum("nij,nmj->nmi", pose[:, :3, :3], profile) + pose[:, None, :3, 3]
    known = cloud.keep & np.isfinite(points).all(axis=2)
    nearest = cKDTree(truth.position_mm).query(points[known])[1]
    off = points[known] - truth.position_mm[nearest]
    n, m = ((off * getattr(truth, name)[nearest]).sum(axis=1) for name in ("normal", "across"))
    thick = truth.thickness_mm[nearest]
    on_end, inside = (np.abs(n) < 0.4) & (m > -0.4) & (m < thick + 0.4), n < 0.4
    faces = np.select(
        [on_end, inside & (np.abs(m - thick) < 0.4), inside & (np.abs(m) < 0.4)],
        [ROOT_FACE, UPPER_SURFACE, LOWER_SURFACE],
        UNLABELLED,
    )
    labels = np.zeros(cloud.keep.shape, np.uint8)
    labels[known] = faces
    return labels


def _crossings(truth: Truth, cloud: Cloud) -> Float:
    """Arc length of the truth at which each frame's laser plane crosses the lower edge; NaN off the edge."""
    origin, across = cloud.base_from_profiler[:, :3, 3], cloud.base_from_profiler[:, :3, 1]
    side = truth.position_mm @ across.T - (origin * across).sum(axis=1)  # (n, N)
    nearest = np.abs(side).min(axis=0)
    return np.where(
        nearest < np.diff(truth.arc_length_mm).max(), truth.arc_length_mm[np.abs(side).argmin(axis=0)], np.nan
    )


@pytest.fixture(scope="session")
def raw() -> Callable[..., Raw]:
    """`raw(part=..., scanner=..., ...)`: 60 mm of a straight raw edge, 8 mm thick, unless told otherwise."""

    @functools.cache
    def make(changes: str) -> Raw:
        document: dict[str, Any] = {
            "format": "bevel-recipe",
            "version": 1,
            "seed": 5,
            "scanner": {"columns": 500},
            "robot": {"frame_pitch_mm": 0.4},
            "part": {"kind": "raw", "length_mm": 64.0},
            "passes": [{"from_mm": 2.0, "to_mm": 62.0}],
        }
        for key, value in json.loads(changes).items():
            document[key] = {**document.get(key, {}), **value} if isinstance(value, dict) else value
        recording, truth = simulate_recording(parse_recipe(document))
        cloud = denoise(fuse(recording))
        return Raw(truth, cloud, *true_edge(truth, cloud))

    return lambda **changes: make(json.dumps(changes))
