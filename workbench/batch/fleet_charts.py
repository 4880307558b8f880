"""Pictures of the fleet: control charts by section, the trend of the parts, how often which section is the worst."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from workbench.batch.control import ControlChart, capability
from workbench.batch.fleet_table import Characteristic
from workbench.pieces import styled, svg
from workbench.report.colours import GREY, INK, LIMIT, MEASURED, REJECTED, TOLERANCE
from workbench.units import Float, Int

COLUMNS = 3  # of small charts side by side
WITH_DOTS = 60  # parts up to which each value has a dot
COLOURS = (MEASURED, "#d55e00")  # of the characteristics


def control_charts(what: Characteristic, charts: Sequence[ControlChart]) -> bytes:
    """SVG: for each section the values over the moving ranges, with limits; signals stand out."""
    rows = math.ceil(len(charts) / COLUMNS)
    with styled():
        height = 2.6 * rows + 0.4
        figure = Figure(figsize=(10.4, height))  # margins in inches: a layout engine takes as long as the drawing
        outer = {"left": 0.07, "right": 0.99, "bottom": 0.4 / height, "top": 1 - 0.25 / height}
        grid = figure.add_gridspec(rows, COLUMNS, hspace=0.28, wspace=0.2, **outer)
        for k, chart in enumerate(charts):
            row, column = divmod(k, COLUMNS)
            inner = grid[row, column].subgridspec(2, 1, height_ratios=[3, 1], hspace=0.1)
            values = figure.add_subplot(inner[0])
            ranges = figure.add_subplot(inner[1], sharex=values)
            _draw_values(values, chart, what, f"section {k + 1}")
            _draw_ranges(ranges, chart)
            if column == 0:
                values.set_ylabel(f"{what.name}, {what.unit}")
                ranges.set_ylabel("range")
            if row == rows - 1 or k + COLUMNS >= len(charts):
                ranges.set_xlabel("part")
            ranges.xaxis.set_major_locator(MaxNLocator(integer=True))
        return svg(figure)


def _draw_values(axes: Axes, chart: ControlChart, what: Characteristic, title: str) -> None:
    axes.set_title(title, fontsize=9, loc="left", color=INK)
    axes.tick_params(labelbottom=False)
    part = chart.order + 1
    _draw_line(axes, part, chart.value)
    low, high = _span([*chart.value, *chart.limits])
    axes.set_ylim(low, high)
    axes.axhspan(what.lower, what.upper, color=TOLERANCE, linewidth=0, zorder=0)
    for limit in (what.lower, what.upper):
        axes.axhline(limit, color=LIMIT, linewidth=1.0)
    if math.isfinite(chart.sigma):
        axes.axhline(chart.centre, color=GREY, linewidth=0.8)
        for limit in chart.limits:
            axes.axhline(limit, color=REJECTED, linewidth=0.8, dashes=(4, 2.5))
    at = sorted({k for k, rule in chart.signals if rule})
    axes.plot(part[at], chart.value[at], "o", color=REJECTED, markersize=4, zorder=4)


def _draw_ranges(axes: Axes, chart: ControlChart) -> None:
    part = chart.order[1:] + 1
    _draw_line(axes, part, chart.moving_range)
    axes.set_ylim(0, _span([0.0, *chart.moving_range, chart.range_limit])[1])
    if math.isfinite(chart.range_limit):
        axes.axhline(chart.range_limit, color=REJECTED, linewidth=0.8, dashes=(4, 2.5))
    at = [k - 1 for k, rule in chart.signals if rule == 0]
    axes.plot(part[at], chart.moving_range[at], "o", color=REJECTED, markersize=4, zorder=4)


def _draw_line(axes: Axes, part: Int, value: Float) -> None:
    few = len(part) <= WITH_DOTS
    axes.plot(part, value, "-o" if few else "-", color=MEASURED, linewidth=0.8, markersize=2.2, zorder=3)


def _span(values: Sequence[float]) -> tuple[float, float]:
    """Room for all of the finite values."""
    known = [v for v in values if math.isfinite(v)] or [0.0, 1.0]
    room = 0.12 * (max(known) - min(known)) or 0.5
    return min(known) - room, max(known) + room


def trend_chart(found: Sequence[Characteristic]) -> bytes:
    """SVG: the mean over each part's sections, the lowest and the highest, and the straight line through the means."""
    with styled():
        figure = Figure(figsize=(10.4, 2.4 * len(found)))
        figure.subplots_adjust(left=0.07, right=0.99, bottom=0.1, top=0.98, hspace=0.08)
        for axes, what in zip(figure.subplots(len(found), 1, sharex=True, squeeze=False)[:, 0], found, strict=True):
            known = np.flatnonzero(np.isfinite(what.value).any(axis=1))
            inside = what.value[known]
            mean = np.nanmean(inside, axis=1)
            axes.fill_between(
                known + 1, np.nanmin(inside, axis=1), np.nanmax(inside, axis=1), color=MEASURED, alpha=0.2, linewidth=0
            )
            _draw_line(axes, known + 1, mean)
            fit = capability(part_means(what), np.zeros(len(what.value)), what.lower, what.upper)
            if math.isfinite(fit.slope):
                axes.plot(known + 1, mean.mean() + fit.slope * (known - known.mean()), color=INK, linewidth=1.2)
            low, high = axes.get_ylim()
            axes.axhspan(what.lower, what.upper, color=TOLERANCE, linewidth=0, zorder=0)
            axes.set_ylim(low, high)
            axes.set_ylabel(f"{what.name}, {what.unit}")
        axes.set_xlabel("part, in the order given")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        return svg(figure)


def part_means(what: Characteristic) -> Float:
    """(P,) mean over the sections measured; NaN where there are none."""
    known = np.isfinite(what.value)
    count = known.sum(axis=1)
    total = np.where(known, what.value, 0.0).sum(axis=1)
    return np.where(count, total / np.maximum(count, 1), np.nan)


def worst_chart(found: Sequence[Characteristic], counts: Int) -> bytes:
    """SVG: in how many parts each section has the smallest margin; counts (characteristics, sections)."""
    with styled():
        figure = Figure(figsize=(10.4, 2.3))
        axes = figure.add_axes((0.07, 0.2, 0.78, 0.75))
        sections, base = np.arange(1, counts.shape[1] + 1), np.zeros(counts.shape[1])
        for what, colour, count in zip(found, COLOURS, counts, strict=True):
            axes.bar(sections, count, bottom=base, color=colour, width=0.7, label=what.name)
            base = base + count
        axes.axhline(counts.sum() / counts.shape[1], color=INK, linewidth=1.0, dashes=(4, 2.5))
        axes.set_xticks(sections)
        axes.set_xlabel("section")
        axes.set_ylabel("parts in which it is the worst")
        axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
        return svg(figure)
