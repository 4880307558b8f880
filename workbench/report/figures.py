"""What all charts over arc length share."""

from __future__ import annotations

from workbench.report.colours import GREY, PALE
from workbench.report.plot import Axes, Figure


def svg(figure: Figure) -> bytes:
    """The figure's bytes."""
    return figure.svg()


def mark_sections(axes: Axes, arc_length_mm: list[float], names: list[str]) -> None:
    """Numbered ticks along the top of a chart over arc length."""
    for s, name in zip(arc_length_mm, names, strict=True):
        axes.axvline(s, color=PALE, linewidth=0.7, zorder=0.5)
        axes.annotate(
            name, (s, 1.0), (0, 2), xycoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=8, color=GREY
        )


def hatch_hidden(axes: Axes, stretches_mm: list[tuple[float, float]]) -> None:
    """Stretches of the edge where nothing was measured."""
    for start, end in stretches_mm:
        axes.axvspan(start, end, facecolor="white", zorder=0.6)
        axes.axvspan(start, end, hatch="////", zorder=0.6)
        if end - start > 0.05 * (axes.get_xlim()[1] - axes.get_xlim()[0]):
            axes.annotate(
                "hidden",
                ((start + end) / 2, 0.5),
                xycoords=("data", "axes fraction"),
                ha="center",
                va="center",
                rotation=90,
                fontsize=8,
                color=GREY,
                box=True,
            )
