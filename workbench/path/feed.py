"""`path.feed`: slow in the material, fast in travel moves."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import Cloud, Edge, Layer, Toolpath, Travel
from workbench.errors import InputError
from workbench.geometry.feeds import limit_acceleration
from workbench.geometry.times import step_lengths_mm
from workbench.path.remaining import moves_in_order, remaining_stock, stock_distances
from workbench.stage import stage
from workbench.units import Float


@stage("path.feed")
def feed(
    toolpath: Toolpath,
    cloud: Cloud,
    edge: Edge,
    *,
    v_fast_mm_s: Annotated[float, Field(gt=0, le=5000, description="feed far from all material")] = 20.0,
    acceleration_mm_s2: Annotated[
        float, Field(gt=0, le=1e5, description="greatest change of the feed, per time")
    ] = 50.0,
) -> Toolpath:
    """Plan the feed by the distance of the cutter's axis to the stock that still stands: the paper's equation (26).

    v = (v_fast - v_slow) / (1 + exp(-0.5 (d_min - 10 - R))) + v_slow, d_min in mm, R the cutter's radius. The stock at
    a layer: the kept points of the cloud that no earlier layer took away, clamps and table included, and the face that
    the layer before left. Where it cuts, the feed is the path's v_slow. Then |v dv/ds| stays within the acceleration
    along the whole path, travels included: forwards and backwards, from the slower to the faster. The feed of a point
    is the feed towards it.

    Args:
        toolpath: the path.
        cloud: the scan that it was planned from.
        edge: the edge that it was planned for.
        v_fast_mm_s: feed far from all material.
        acceleration_mm_s2: greatest change of the feed.

    Raises:
        InputError: v_fast below the path's v_slow.

    Example:
        >>> from workbench import edge, path, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/raw_edge.h5"))
        >>> raw = edge.segment_raw(points, upper_side=[0, 0, 1])
        >>> plan = path.feed(path.layers(raw, points), points, raw)
        >>> plan.time_s < plan.time_at_v_slow_s
        True
    """
    slow = toolpath.v_slow_mm_s
    if v_fast_mm_s < slow:
        raise InputError("v_fast_mm_s", f"expected at least the path's v_slow_mm_s = {slow:g}, found {v_fast_mm_s:g}")
    remaining, moves = remaining_stock(toolpath, cloud, edge), moves_in_order(toolpath)
    radius = toolpath.cutter.diameter_mm / 2.0
    wanted = []
    for points, done in moves:
        cutting = points.cutting if isinstance(points, Layer) else np.zeros(len(points.position_mm), bool)
        distance = stock_distances(remaining, toolpath, points, done, ~cutting)
        free = feed_of_distance(distance, radius, slow, v_fast_mm_s)
        wanted.append(np.where(cutting, slow, free if isinstance(points, Layer) else _sparse(free)))
    position = np.concatenate([points.position_mm for points, _ in moves])
    limited = limit_acceleration(np.concatenate(wanted), step_lengths_mm(position), acceleration_mm_s2)
    parts = iter(np.split(limited, np.cumsum([len(points.position_mm) for points, _ in moves])[:-1]))
    fed = [replace(points, feed_mm_s=part) for (points, _), part in zip(moves, parts, strict=True)]
    return replace(
        toolpath,
        layers=tuple(p for p in fed if isinstance(p, Layer)),
        travels=tuple(p for p in fed if isinstance(p, Travel)),
    )


def feed_of_distance(distance_mm: Float, radius_mm: float, v_slow_mm_s: float, v_fast_mm_s: float) -> Float:
    """Equation (26)."""
    steep = 1.0 + np.exp(-0.5 * (distance_mm - 10.0 - radius_mm))
    return np.asarray((v_fast_mm_s - v_slow_mm_s) / steep + v_slow_mm_s, dtype=np.float64)


def _sparse(feed_mm_s: Float) -> Float:
    """Feeds towards points that lie far apart: no faster than at either end of the step."""
    return np.asarray(np.minimum(feed_mm_s, np.concatenate([feed_mm_s[:1], feed_mm_s[:-1]])))
