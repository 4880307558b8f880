"""Pictures of deviations: maps as seen from outside, along the part, histogram."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure

from workbench.compare.statistics import Summary
from workbench.compare.surface_values import Deviations
from workbench.pieces import BLUE, GREY, ORANGE, PALE, styled, svg

COLOURS = "RdBu_r"  # red: outside the reference, too much material; blue: inside


def map_picture(found: Deviations, summary: Summary) -> bytes:
    """Distances over arc length and across the part; below, what of them is significant."""
    seen = np.isfinite(found.distance_mm)
    reach = max(float(np.percentile(np.abs(found.distance_mm[seen]), 99)), 1e-4)
    arc, aside, distance = found.arc_length_mm[seen], found.across_mm[seen], found.distance_mm[seen]
    with styled():
        figure = Figure(figsize=(10, 5.2), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, sharey=True)
        size = float(np.clip(5e4 / len(arc), 1.5, 22.0))
        dots = above.scatter(
            arc,
            aside,
            c=distance,
            s=size,
            cmap=COLOURS,
            norm=TwoSlopeNorm(0.0, -reach, reach),
            linewidths=0.0,
            rasterized=True,
        )
        figure.colorbar(dots, ax=above, label="distance, mm", pad=0.01)
        above.set(
            title="Signed distance along the normal (red: outside the reference, blue: inside)", ylabel="across, mm"
        )
        _significance(below, found, summary)
        figure.colorbar(dots, ax=below, label="distance, mm", pad=0.01)
        return svg(figure)


def _significance(axes: Axes, found: Deviations, summary: Summary) -> None:
    seen = np.isfinite(found.distance_mm)
    reach = max(float(np.percentile(np.abs(found.distance_mm[seen]), 99)), 1e-4)
    size = float(np.clip(5e4 / max(int(seen.sum()), 1), 1.5, 22.0))
    for mask, colour in ((~seen, "#f0e0c0"), (seen & ~summary.changed, PALE)):
        axes.scatter(
            found.arc_length_mm[mask], found.across_mm[mask], c=colour, s=size, linewidths=0.0, rasterized=True
        )
    mine = summary.changed
    axes.scatter(
        found.arc_length_mm[mine],
        found.across_mm[mine],
        c=found.distance_mm[mine],
        s=size,
        cmap=COLOURS,
        norm=TwoSlopeNorm(0.0, -reach, reach),
        linewidths=0.0,
        rasterized=True,
    )
    axes.set(title=f"Significant {summary.what}s alone", xlabel="arc length, mm", ylabel="across, mm")


def course_picture(found: Deviations, summary: Summary) -> bytes:
    """Left: median, middle 90 % and level of detection along the part; right: the histogram."""
    with styled():
        figure = Figure(figsize=(10, 3.0), layout="constrained")
        along, histogram = figure.subplots(1, 2, width_ratios=(2.2, 1))
        _along(along, found)
        width = np.diff(summary.edges_mm)
        histogram.bar(summary.edges_mm[:-1], summary.counts, width, align="edge", color=BLUE, linewidth=0)
        histogram.axvline(0.0, color=GREY, linewidth=0.8)
        for sign in (-1, 1):
            histogram.axvline(sign * summary.detectable_mm, color=ORANGE, linewidth=0.9, linestyle="--")
        histogram.set(title="Histogram; dashed: level of detection", xlabel="mm", ylabel="places")
        return svg(figure)


def _along(axes: Axes, found: Deviations) -> None:
    seen = np.isfinite(found.distance_mm)
    arc, distance, limit = found.arc_length_mm[seen], found.distance_mm[seen], found.detectable_mm[seen]
    edges = np.linspace(arc.min(), arc.max() + 1e-9, int(np.clip(np.ptp(arc) / 2.0, 5, 200)))
    bin_of = np.digitize(arc, edges) - 1
    rows = [
        (
            0.5 * (edges[k] + edges[k + 1]),
            *np.percentile(distance[bin_of == k], [5, 50, 95]),
            np.median(limit[bin_of == k]),
        )
        for k in range(len(edges) - 1)
        if (bin_of == k).any()
    ]
    s, low, middle, high, detectable = np.array(rows).T
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.fill_between(s, low, high, color=BLUE, alpha=0.2, linewidth=0, label="5 % to 95 % of the places")
    axes.plot(s, middle, color=BLUE, linewidth=1.3, label="median")
    axes.plot(s, detectable, color=ORANGE, linewidth=0.9, linestyle="--", label="level of detection of a place, 95 %")
    axes.plot(s, -detectable, color=ORANGE, linewidth=0.9, linestyle="--")
    axes.set(xlabel="arc length, mm", ylabel="distance, mm")
    axes.legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
