"""Pictures of a gauge study: components of variation, values by section and operator, ranges, bias."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.compare.agreement import COVERAGE
from workbench.compare.gauge_values import Characteristic
from workbench.compare.values import Study
from workbench.pieces import GREY, ORANGE, PALE, SERIES, styled, svg

MOST_OPERATORS = len(SERIES)  # beyond, colours would repeat: operators share one


def gauge_picture(study: Study, one: Characteristic) -> bytes:
    """Four charts about one characteristic, as SVG."""
    with styled():
        figure = Figure(figsize=(10, 6.6), layout="constrained")
        (components, values), (ranges, bias) = figure.subplots(2, 2)
        _components(components, study, one)
        _values(values, study, one)
        _ranges(ranges, study, one)
        _bias(bias, study, one)
        return svg(figure)


def _components(axes: Axes, study: Study, one: Characteristic) -> None:
    """Standard deviations with their intervals."""
    shown = [part for part in one.gauge.components if part.sd is not None and part.interval is not None]
    for row, part in enumerate(shown):
        low, high = part.interval or (0.0, 0.0)
        axes.barh(row, part.sd or 0.0, color=SERIES[0] if part.name != "GRR" else ORANGE, height=0.55)
        axes.plot([low, high], [row, row], color=GREY, linewidth=1.4, marker="|", markersize=7)
    axes.set_yticks(range(len(shown)), [part.name for part in shown])
    axes.invert_yaxis()
    limit = 3.0 * max(part.sd or 0.0 for part in shown)
    axes.set_xlim(0.0, max(min(limit, 1.05 * max((part.interval or (0, 0))[1] for part in shown)), 1e-9))
    end = axes.get_xlim()[1]
    for row, part in enumerate(shown):
        high = (part.interval or (0.0, 0.0))[1]
        if high > end:  # said, not cut off without a word
            axes.annotate(
                f"to {high:.3g} \u25b6",
                (end, row),
                (-2, 7),
                textcoords="offset points",
                ha="right",
                va="bottom",
                fontsize=7.5,
                color=GREY,
            )
    axes.set(title="Components of variation, standard deviation with 95 % interval", xlabel=study.unit_of(one.name))


def _values(axes: Axes, study: Study, one: Characteristic) -> None:
    """Every measurement by section; operators side by side."""
    values, count = study.measured[one.name], len(study.operators)
    for j in range(count):
        at = np.arange(len(study.section)) + 0.5 * ((j + 0.5) / count - 0.5)
        spread = np.broadcast_to(at, values[:, j].shape)
        axes.plot(
            spread.ravel(),
            values[:, j].ravel(),
            ".",
            color=SERIES[j % MOST_OPERATORS],
            markersize=3.5,
            label=study.operators[j] if count <= MOST_OPERATORS else None,
        )
    reference = study.reference[one.name]
    for row in reference[np.isfinite(reference).any(axis=1)]:
        axes.plot(np.arange(len(row)), row, "_", color=GREY, markersize=16, zorder=0.5)
    low, high = axes.get_ylim()
    for limit in one.limits or ():
        if low - 0.5 * (high - low) < limit < high + 0.5 * (high - low):
            axes.axhline(limit, color="#00664b", linewidth=0.9, linestyle="--")
    _by_section(axes, study)
    axes.set(title="Measurements by section and operator", ylabel=study.unit_of(one.name))
    if 1 < count <= MOST_OPERATORS:
        axes.legend(ncols=count, fontsize=8, loc="best", handletextpad=0.1, columnspacing=0.8)


def _ranges(axes: Axes, study: Study, one: Characteristic) -> None:
    """Range of the trials of each part, operator and section (R chart)."""
    values, count = study.measured[one.name], len(study.operators)
    spread = np.ptp(values, axis=2)
    for j in range(count):
        at = np.arange(len(study.section)) + 0.5 * ((j + 0.5) / count - 0.5)
        axes.plot(
            np.broadcast_to(at, spread[:, j].shape).ravel(),
            spread[:, j].ravel(),
            ".",
            color=SERIES[j % MOST_OPERATORS],
            markersize=5,
        )
    axes.axhline(float(np.nanmean(spread)), color=GREY, linewidth=0.9)
    axes.set_ylim(bottom=0.0)
    _by_section(axes, study)
    axes.set(title="Range of the trials; line: its mean", ylabel=study.unit_of(one.name))


def _bias(axes: Axes, study: Study, one: Characteristic) -> None:
    """Mean less reference, with its expanded uncertainty."""
    found = one.agreement
    axes.set_title("Bias against the reference, with expanded uncertainty (k = 2)")
    if not found.has_reference:
        axes.text(0.5, 0.5, "no reference measurements in the study", transform=axes.transAxes, ha="center", color=GREY)
        axes.set_axis_off()
        return
    count = len(study.parts)
    axes.axhline(0.0, color=PALE, linewidth=0.8)
    for i in range(count):
        at = np.arange(len(study.section)) + 0.5 * ((i + 0.5) / count - 0.5)
        axes.errorbar(
            at,
            found.bias[i],
            COVERAGE * found.bias_u[i],
            fmt=".",
            color=SERIES[i % MOST_OPERATORS],
            linewidth=1.0,
            markersize=5,
            label=study.parts[i],
        )
    _by_section(axes, study)
    axes.set(ylabel=study.unit_of(one.name))
    if 1 < count <= MOST_OPERATORS:
        axes.legend(ncols=min(count, 3), fontsize=8, loc="best", title="part", title_fontsize=8)


def _by_section(axes: Axes, study: Study) -> None:
    axes.set_xticks(range(len(study.section)), [str(index) for index in study.section])
    axes.set_xlabel("section")
