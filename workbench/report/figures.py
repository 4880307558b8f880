"""What all charts share: type, axes, and SVG bytes that depend on the data alone."""

from __future__ import annotations

import io
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.report.colours import GREY, INK, PALE

STYLE: Any = {
    "font.size": 9.0,
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same everywhere
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "hatch.color": PALE,
    "hatch.linewidth": 0.8,
    "svg.fonttype": "path",
    "svg.hashsalt": "workbench",  # element names must not be random
}


def svg(figure: Figure) -> bytes:
    """The figure as SVG, without a date; dots in it are a picture of 200 dpi."""
    out = io.BytesIO()
    figure.savefig(out, format="svg", dpi=200, metadata={"Date": None, "Creator": None})
    return out.getvalue()


def styled() -> Any:
    """Context in which figures of the report are made and written."""
    return mpl.rc_context(STYLE)


def mark_sections(axes: Axes, arc_length_mm: list[float], names: list[str]) -> None:
    """Numbered ticks along the top of a chart over arc length."""
    for s, name in zip(arc_length_mm, names, strict=True):
        axes.axvline(s, color=PALE, linewidth=0.7, zorder=0.5)
        axes.annotate(
            name, (s, 1.0), (0, 2), xycoords=("data", "axes fraction"), textcoords="offset points",
            ha="center", va="bottom", fontsize=8, color=GREY,
        )  # fmt: skip


def hatch_hidden(axes: Axes, stretches_mm: list[tuple[float, float]]) -> None:
    """Stretches of the edge where nothing was measured."""
    for start, end in stretches_mm:
        axes.axvspan(start, end, facecolor="white", edgecolor=PALE, hatch="////", linewidth=0.0, zorder=0.6)
        if end - start > 0.05 * (axes.get_xlim()[1] - axes.get_xlim()[0]):
            axes.annotate(
                "hidden", ((start + end) / 2, 0.5), xycoords=("data", "axes fraction"), ha="center", va="center",
                rotation=90, fontsize=8, color=GREY, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
            )  # fmt: skip
