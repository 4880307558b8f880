"""Checks of a path's feeds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from workbench.artefacts import Layer, Toolpath
from workbench.geometry.times import step_lengths_mm

SHARE = 1e-6  # rounding


def feed_faults(toolpath: Toolpath, v_fast_mm_s: float | None, acceleration_mm_s2: float) -> Iterator[str]:
    """What is wrong with the feeds, in words."""
    moves = toolpath.in_order
    position = np.concatenate([points.position_mm for points in moves])
    feed = np.concatenate([points.feed_mm_s for points in moves])
    slow, fast = toolpath.v_slow_mm_s, np.inf if v_fast_mm_s is None else v_fast_mm_s
    if not (np.isfinite(feed).all() and (feed > 0).all()):
        yield "a feed is not positive"
        return
    if feed.min() < slow * (1.0 - SHARE) or feed.max() > fast * (1.0 + SHARE):
        yield f"feeds from {feed.min():.3g} to {feed.max():.3g} mm/s, expected {slow:g} to {fast:g}"
    change = np.abs(np.diff(feed**2)) / 2.0
    if (change > acceleration_mm_s2 * step_lengths_mm(position)[1:] * (1.0 + SHARE) + 1e-9).any():
        yield f"the feed changes by more than {acceleration_mm_s2:g} mm/s^2"
    for layer in moves:
        if isinstance(layer, Layer) and (layer.feed_mm_s[layer.cutting] > slow * (1.0 + SHARE)).any():
            at = layer.arc_length_mm[layer.cutting & (layer.feed_mm_s > slow * (1.0 + SHARE))][0]
            yield f"layer {layer.index} cuts faster than {slow:g} mm/s at arc length {at:.1f} mm"
