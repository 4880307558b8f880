"""The report's look in matplotlib, for charts that need more than `report.plot`; bytes depend on data alone."""

from __future__ import annotations

import io
from typing import Any

import matplotlib as mpl
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
