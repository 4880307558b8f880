"""Colours for values: from dark to light, even the lightest seen on white; and their scales."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.artefacts import Toolpath
from workbench.report.colours import AIR, rgb
from workbench.report.figures import svg
from workbench.report.planned import Run
from workbench.report.plot import Figure
from workbench.report.values import alike
from workbench.units import AnyArray, Float

# viridis up to 0.86: it keeps its order with any colour vision, and in grey.
ANCHORS = ("#440154", "#482677", "#3f4889", "#32658e", "#27808e", "#1f998a", "#2eb37c", "#5ec962", "#a2da37")
SHADES = 64  # of a continuous scale
MOST_NAMES = 12  # layers that a scale names


def ramp(fraction: Float) -> AnyArray:
    """(n, 3) uint8 for values (n,) from 0 (dark) to 1 (light)."""
    known = np.array([rgb(anchor) for anchor in ANCHORS], float)
    at = np.clip(np.nan_to_num(np.asarray(fraction, float)), 0.0, 1.0) * (len(known) - 1)
    return np.stack([np.interp(at, np.arange(len(known)), known[:, k]) for k in range(3)], axis=-1).astype(np.uint8)


def layer_colours(layer: AnyArray, count: int) -> AnyArray:
    """(k, 3): light for the first layer, dark for the final one, grey for travel moves between layers."""
    colour = ramp((count - np.asarray(layer)) / max(1, count - 1))
    return np.where((np.asarray(layer) == 0)[:, None], rgb(AIR), colour)


def feed_colours(run: Run) -> AnyArray:
    """(k, 3): the darker the slower."""
    low, high = feed_range(run)
    return ramp((run.feed_mm_s - low) / (high - low))


def feed_range(run: Run) -> tuple[float, float]:
    """Slowest and fastest feed of a path, mm/s; from 0 where they are one."""
    low, high = float(run.feed_mm_s.min()), float(run.feed_mm_s.max())
    return (low, high) if high - low > 1e-3 * high else (0.0, high)


def feed_scale(run: Run) -> bytes:
    """SVG of the colour bar of feeds."""
    return _scale(ramp(np.linspace(0.0, 1.0, SHADES)), feed_range(run), "feed, mm/s")


def layer_scale(toolpath: Toolpath) -> bytes:
    """SVG of the colour bar of layers, with their heights above the finished bevel."""
    count = len(toolpath.layers)
    shades = layer_colours(np.arange(1, count + 1), count)
    heights = alike(*(round(layer.height_mm, 6) for layer in toolpath.layers))
    named = np.unique(np.linspace(1, count, min(count, MOST_NAMES)).round().astype(int))
    names = [f"{k} ({heights[k - 1]} mm)" for k in named]
    label = "layer (its height above the finished bevel)"
    return _scale(shades, (0.5, count + 0.5), label, named.tolist(), names)


def _scale(
    shades: AnyArray, limits: tuple[float, float], label: str, at: Sequence[float] = (), names: Sequence[str] = ()
) -> bytes:
    figure = Figure(figsize=(10, 0.62))
    axes = figure.add_axes((0.2, 0.72, 0.6, 0.22))
    axes.set(xlim=limits, ylim=(0.0, 1.0))
    axes.shades(list(shades / 255.0))
    axes.set_yticks([], [])
    if at:
        axes.set_xticks(at, names)
    axes.tick_params(length=2.5, pad=2)
    axes.set_xlabel(label)
    return svg(figure)
