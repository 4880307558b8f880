"""Colours for values: from dark to light, even the lightest seen on white; and their scales."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize
from matplotlib.figure import Figure

from workbench.artefacts import Toolpath
from workbench.report.colours import AIR, rgb
from workbench.report.figures import styled, svg
from workbench.report.planned import Run
from workbench.report.values import alike
from workbench.units import AnyArray, Float

RAMP = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.86, 256)), name="dark to light")
MOST_NAMES = 12  # layers that a scale names


def ramp(fraction: Float) -> AnyArray:
    """(n, 3) uint8 for values (n,) from 0 (dark) to 1 (light)."""
    return np.asarray(RAMP(np.clip(fraction, 0.0, 1.0))[..., :3] * 255.0).astype(np.uint8)


def layer_colours(layer: AnyArray, count: int) -> AnyArray:
    """(k, 3): light for the first layer, dark for the final one, grey for moves through the air between layers."""
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
    low, high = feed_range(run)
    return _scale(ScalarMappable(Normalize(low, high), RAMP), "feed, mm/s")


def layer_scale(toolpath: Toolpath) -> bytes:
    """SVG of the colour bar of layers, with their heights above the finished bevel."""
    count = len(toolpath.layers)
    shades = ListedColormap(layer_colours(np.arange(1, count + 1), count) / 255.0)
    bar = ScalarMappable(BoundaryNorm(np.arange(0.5, count + 1.0), count), shades)
    heights = alike(*(round(layer.height_mm, 6) for layer in toolpath.layers))
    named = np.unique(np.linspace(1, count, min(count, MOST_NAMES)).round().astype(int))
    names = [f"{k} ({heights[k - 1]} mm)" for k in named]
    return _scale(bar, "layer (its height above the finished bevel)", named, names)


def _scale(bar: ScalarMappable, label: str, at: AnyArray | None = None, names: list[str] | None = None) -> bytes:
    with styled():
        figure = Figure(figsize=(10, 0.62))
        axes = figure.add_axes((0.2, 0.72, 0.6, 0.22))
        drawn = figure.colorbar(bar, cax=axes, orientation="horizontal", label=label)
        drawn.outline.set_linewidth(0.5)
        if at is not None:
            drawn.set_ticks(at.tolist(), labels=names)
            drawn.minorticks_off()
        axes.tick_params(length=2.5, pad=2)
        return svg(figure)
