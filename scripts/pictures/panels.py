"""Charts above each other as one picture, in the style of the reports and with room for 640 pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from workbench.marks import LIMIT, Lettering
from workbench.pieces import BLUE, GREEN, INK, ORANGE, PURPLE, SKY
from workbench.plot import PAD, SIZE, TICK, TICKS_EACH_PT, Axes, Figure, nice_ticks

WIDTH_IN, HIGH_IN, LOW_IN = 6.6, 3.2, 1.45  # of the picture; of a chart alone, and of one of several
LEFT_IN, RIGHT_IN, TOP_IN, TIGHT_IN = 0.95, 0.15, 0.32, 0.14  # beside the charts; above one with and without a key
BELOW_IN, TICKS_IN = 0.52, 0.3  # below a chart with and without a name of its x
ROW_IN, LETTER = 0.19, 0.68 * SIZE  # of a name beside a chart; points, about the widest in a number
MOST_DOTS, FEW, CROWDED, SMALL, LARGE = 3_000, 60, 4_000, 2.8, 4.5  # of all clouds in a chart; when and how small
SERIES = (BLUE, ORANGE, GREEN, PURPLE, SKY, INK)


@dataclass(frozen=True)
class Curve:
    """A line over x, dots (many), marks (few), or bars from 0; `u`: half the width of a band or of error bars."""

    x: Any
    y: Any
    name: str | None = None
    u: Any = None
    how: str = "line"
    colour: Any = None  # None: the next one of the series


@dataclass(frozen=True)
class Panel:
    """One chart. `levels`: name and value of lines across; `names`: of y = 0, 1, ...; what has `u` then lies."""

    x: str
    y: str
    curves: Sequence[Curve]
    levels: Sequence[tuple[str, float]] = ()
    names: Sequence[str] = ()
    equal: bool = False  # one scale both ways


@dataclass(frozen=True)
class Picture:
    """Charts above each other, and what they show in words."""

    words: str
    panels: Sequence[Panel]


def drawn(picture: Picture) -> bytes:
    """As SVG."""
    sizes = [_size(panel, len(picture.panels) == 1) for panel in picture.panels]
    height = top = sum(map(sum, sizes))
    figure = Figure(figsize=(WIDTH_IN, height))
    for (above, high, below), panel in zip(sizes, picture.panels, strict=True):
        left = max(LEFT_IN, *(len(name) * LETTER / 72.0 for name in (*panel.names, "")))
        top -= above + high
        _draw(figure.add_axes((left / WIDTH_IN, top / height, 1 - (left + RIGHT_IN) / WIDTH_IN, high / height)), panel)
        top -= below
    return titled(figure.svg().decode(), picture.words)


def titled(svg: str, words: str) -> bytes:
    """A picture on white, with its title, which the page shows as well."""
    start = svg.index(">", svg.index("<svg")) + 1
    title = f"<title>{escape(words)}</title>"
    return f'{svg[:start]}{title}<rect width="100%" height="100%" fill="white"/>{svg[start:]}'.encode()


def plan(words: str, *clouds: tuple[str | None, Any, Any], how: str = "") -> Picture:
    """Points (name, (n, 3) in the base, colour), looked at along the axis that the last cloud extends least in."""
    spread = np.nanmax(clouds[-1][1], axis=0) - np.nanmin(clouds[-1][1], axis=0)
    a, b = np.sort(np.argsort(-spread, kind="stable")[:2])
    curves = [
        Curve(at[:, a], at[:, b], name, how=how or ("marks" if len(at) <= FEW else "dots"), colour=colour)
        for name, at, colour in clouds
    ]
    return Picture(words, [Panel(f"{'xyz'[a]} of the base, mm", f"{'xyz'[b]}, mm", curves, equal=True)])


def _size(panel: Panel, alone: bool) -> tuple[float, float, float]:
    """Inches above a chart, of it, and below."""
    high = max(HIGH_IN if panel.equal or alone else LOW_IN, ROW_IN * len(panel.names))
    return TOP_IN if any(one.name for one in panel.curves) else TIGHT_IN, high, BELOW_IN if panel.x else TICKS_IN


def _draw(axes: Axes, panel: Panel) -> None:
    axes.set(xlabel=panel.x, ylabel=panel.y)
    clouds = [len(one.x) for one in panel.curves if one.how == "dots"]
    dots = (MOST_DOTS // max(1, len(clouds)), SMALL if sum(clouds) > CROWDED else LARGE)
    for curve, next_one in zip(panel.curves, SERIES * len(panel.curves), strict=False):
        _curve(axes, curve, next_one if curve.colour is None else curve.colour, bool(panel.names), dots)
    for name, level in panel.levels:
        axes.axhline(level, color=LIMIT, linewidth=0.9, dashes=(4, 2.5), zorder=1)
        at = {"xycoords": ("axes fraction", "data"), "ha": "right", "fontsize": 8, "look": Lettering(LIMIT, box=True)}
        axes.annotate(name, (1.0, level), (-2, 3), **at)
    if any(curve.name for curve in panel.curves):
        axes.legend()
    if panel.names:
        axes.set(yticks=(range(len(panel.names)), panel.names), ylim=(len(panel.names) - 0.4, -0.6))
    _, _, width, high = axes.box
    if panel.equal:
        limits = np.array([axes.get_xlim(), axes.get_ylim()])
        half = np.ptp(limits, axis=1).dot([[1.0 / width, 0.0], [0.0, 1.0 / high]]).max() / 2.0 * np.array([width, high])
        x, y = limits.mean(axis=1)[:, None] + half[:, None] * [-1.0, 1.0]
        axes.set(xlim=tuple(x), ylim=tuple(y), aspect="equal")
    ticks = panel.names or nice_ticks(axes.get_ylim(), max(2, int(high / TICKS_EACH_PT["y"])))[1]
    axes.y_label_at = -(LETTER * max(map(len, ticks)) + 2 * PAD + TICK) / width


def _curve(axes: Axes, curve: Curve, colour: Any, lying: bool, dots: tuple[int, float]) -> None:
    x, y = np.asarray(curve.x, float), np.asarray(curve.y, float)
    if curve.name:
        axes.plot(x[:1], y[:1], color=colour, label=curve.name)
    if curve.how == "dots":
        some = np.linspace(0, len(x) - 1, min(len(x), dots[0])).astype(int)
        axes.points(x[some], y[some], ".", color=colour, markersize=dots[1], alpha=0.7)
    elif curve.how == "line":
        axes.plot(x, y, color=colour, linewidth=1.3)
        if curve.u is not None:
            axes.fill_between(x, y - curve.u, y + curve.u, color=colour, alpha=0.22)
    else:
        for k, half in enumerate(np.broadcast_to(0.0 if curve.u is None else curve.u, x.shape)):
            if curve.how == "bars":
                axes.fill([0, x[k], x[k], 0], y[k] + np.array([-0.3, -0.3, 0.3, 0.3]), facecolor=colour)
            if lying:
                axes.plot([x[k] - half, x[k] + half], [y[k]] * 2, color=INK if curve.how == "bars" else colour)
            elif half:
                axes.errorbar(x[k], y[k], half, color=colour)
        if curve.how == "marks":
            axes.points(x, y, "o", color=colour, markersize=4.5, zorder=3)
