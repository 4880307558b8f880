"""Charts as SVG, written directly: the few words of matplotlib that the report needs, in a hundredth of the time.

`Figure` and `Axes` take what matplotlib's classes of these names take for the same arguments; what is not here is
refused as an unknown argument. Lengths on paper are in points (1/72 inch), places in a figure in shares of it, from the
lower left corner. The bytes depend on the data alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from workbench.marks import (
    ANCHORS,
    PLAIN,
    UPRIGHT,
    Colour,
    Lettering,
    arrow_head,
    cells,
    code,
    dots,
    filled,
    markers,
    path_data,
    pt,
    ramp,
    rgb,
    stroke,
    text_element,
    text_width,
)
from workbench.pieces import GREY, INK, PALE
from workbench.units import AnyArray, Float

FONT = "DejaVu Sans, Verdana, Arial, sans-serif"
SIZE = 9.0  # of text
CAP = 2.5  # half the width of an uncertainty's ends
TICK, PAD = 3.5, 3.5  # length of ticks, distance of their labels
MARGIN = 0.05  # of the data's span, free on both sides of it
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # between ticks, times a power of ten
ON_WHITE = Lettering(box=True)
FAINT = 140  # of 255, opacity of a colour behind cells
LEFT, RIGHT, ABOVE, BELOW = 45.0, 14.0, 20.0, 34.0  # beside subplots: for ticks and labels, and a line above
GAPS = (56.0, 26.0)  # between them, and where they share that axis
SCALE = (8.0, 10.0, 40.0)  # of a chart's width, for a scale: gap, colours, their values
TICKS_EACH_PT = {"x": 62.0, "y": 20.0}  # room that a tick's label needs

Limits: TypeAlias = tuple[float, float]
Ends: TypeAlias = tuple[float | None, float | None]
Ticks: TypeAlias = tuple[Sequence[float], Sequence[str]]


class Line(NamedTuple):
    """A line or markers, as drawn."""

    xy: Float
    marker: str


class Text(NamedTuple):
    """A text, as drawn."""

    text: str
    place: Callable[[], tuple[float, float, float, float]]  # left, top, right, bottom on paper, about: fonts differ


class Figure:
    """A sheet of `figsize` inches with axes on it."""

    def __init__(self, figsize: tuple[float, float]) -> None:
        self.width, self.height = 72.0 * figsize[0], 72.0 * figsize[1]
        self.axes: list[Axes] = []
        self._grid: list[tuple[list[list[Axes]], Sequence[float]]] = []

    def add_axes(self, rect: tuple[float, float, float, float]) -> Axes:
        """Axes at (left, bottom, width, height)."""
        self.axes.append(Axes(self, rect))
        return self.axes[-1]

    def subplots(
        self,
        rows: int = 1,
        columns: int = 1,
        *,
        squeeze: bool = True,
        sharex: bool = False,
        sharey: bool = False,
        height_ratios: Sequence[float] | None = None,
    ) -> Any:
        """Axes in rows and columns, with room for labels and a line above each; inner ones of shared axes have none."""
        grid = [[self.add_axes((0, 0, 1, 1)) for _ in range(columns)] for _ in range(rows)]
        first = grid[0][0]
        for i, row in enumerate(grid):
            for j, one in enumerate(row):
                if sharex:
                    one.shared["x"], one.labelled["x"] = first.shared["x"], i == rows - 1
                if sharey:
                    one.shared["y"], one.labelled["y"] = first.shared["y"], j == 0
        self._grid.append((grid, height_ratios or [1.0] * rows))
        across, under = columns * GAPS[sharey], rows * GAPS[sharex]
        self.subplots_adjust(
            LEFT / self.width,
            BELOW / self.height,
            1.0 - RIGHT / self.width,
            1.0 - ABOVE / self.height,
            wspace=across / (self.width - LEFT - RIGHT + GAPS[sharey] - across),
            hspace=under / (self.height - ABOVE - BELOW + GAPS[sharex] - under),
        )
        return np.array(grid, dtype=object) if not squeeze else [one for row in grid for one in row]

    def subplots_adjust(
        self, left: float, bottom: float, right: float, top: float, *, wspace: float = 0.2, hspace: float = 0.2
    ) -> None:
        """Where the subplots lie; `wspace`, `hspace`: between them, in shares of their mean size."""
        for grid, ratios in self._grid:
            rows, columns = len(grid), len(grid[0])
            width = (right - left) / (columns + wspace * (columns - 1))
            height = (top - bottom) / (rows + hspace * (rows - 1))
            up = top
            for row, ratio in zip(grid, ratios, strict=True):
                high = height * rows * ratio / sum(ratios)
                for j, one in enumerate(row):
                    one.rect = (left + j * width * (1.0 + wspace), up - high, width, high)
                up -= high + hspace * height

    def svg(self) -> bytes:
        """The file."""
        hatch = (
            f'<pattern id="h" width="6" height="6" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
            f'<path d="M0 0V6" stroke="{PALE}" stroke-width="1.6"/></pattern>'
        )
        for begin in {one.rect[0] for one in self.axes}:  # room for what the ticks' names push off the sheet
            column = [one for one in self.axes if one.rect[0] == begin]
            lack = max(0.0, *(one.beyond_the_sheet() for one in column)) / self.width
            for one in column:
                one.rect = (begin + lack, one.rect[1], one.rect[2] - lack, one.rect[3])
        clips, parts = [hatch], []
        for k, one in enumerate(self.axes):
            if one.visible:
                left, top, width, height = map(pt, one.box)
                clips.append(
                    f'<clipPath id="c{k}"><rect x="{left}" y="{top}" width="{width}" height="{height}"/></clipPath>'
                )
                parts.append(one.drawn(f"c{k}"))
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{pt(self.width)}pt" height="{pt(self.height)}pt" '
            f'viewBox="0 0 {pt(self.width)} {pt(self.height)}" font-family="{FONT}">\n'
            f"<defs>{''.join(clips)}</defs>\n" + "\n".join(parts) + "\n</svg>\n"
        ).encode()


@dataclass(slots=True, eq=False)
class _Extent:
    """What an axis shows: limits as set, or those of the data."""

    given: Limits | None = None
    low: float = math.inf
    high: float = -math.inf
    margin: float = MARGIN

    def take(self, values: AnyArray) -> None:
        """Let the axis show these."""
        known = np.asarray(values, float)
        known = known[np.isfinite(known)]
        if known.size:
            self.low, self.high = min(self.low, float(known.min())), max(self.high, float(known.max()))

    def limits(self) -> Limits:
        """As set, or of the data with a margin."""
        if self.given:
            return self.given
        if self.low > self.high:
            return 0.0, 1.0
        room = self.margin * round(self.high - self.low, 10) or 0.05 * abs(self.high) or 0.05
        return self.low - room, self.high + room


@dataclass(slots=True, eq=False)
class Axes:
    """A chart: data in the axes' units, drawn from the lowest `zorder` to the highest."""

    figure: Figure
    rect: tuple[float, float, float, float]
    visible: bool = True
    shared: dict[str, _Extent] = field(default_factory=lambda: {"x": _Extent(), "y": _Extent()})
    labelled: dict[str, bool] = field(default_factory=lambda: {"x": True, "y": True})
    texts: list[Text] = field(default_factory=list)
    bars: list[Limits] = field(default_factory=list)
    labels: dict[str, str] = field(default_factory=lambda: {"x": "", "y": ""})
    equal: bool = False
    integer: str = ""  # axes whose ticks are whole numbers
    spine_hidden: bool = False
    ticks_right: bool = False
    y_label_at: float | None = None
    tick_size: float = SIZE
    tick_length: float = TICK
    tick_pad: float = PAD
    ticks: dict[str, Ticks] = field(default_factory=dict)
    lines: list[Line] = field(default_factory=list)
    _legend: list[tuple[str, str]] = field(default_factory=list)
    _later: list[tuple[float, bool, Any]] = field(default_factory=list)  # zorder, whether clipped, what draws it
    _insets: list[Axes] = field(default_factory=list)

    # Settings.

    def set(
        self,
        *,
        xlim: Ends | None = None,
        ylim: Ends | None = None,
        xlabel: str | None = None,
        ylabel: str | None = None,
        xticks: Ticks | None = None,
        yticks: Ticks | None = None,
        aspect: str = "",
        title: str = "",
    ) -> None:
        """Limits (None: that end as it is), labels, ticks (values and names); `aspect` "equal": one scale both ways.

        The `title` stands above, at the left.
        """
        if title:
            self.annotate(title, (0.0, 1.0), (0.0, 6.0), xycoords="axes fraction")
        for axis, limits, label, ticks in (("x", xlim, xlabel, xticks), ("y", ylim, ylabel, yticks)):
            extent = self.shared[axis]
            if limits is not None:
                low, high = (now if one is None else one for one, now in zip(limits, extent.limits(), strict=True))
                extent.given = (float(low), float(high))
            if label is not None:
                self.labels[axis] = label
            if ticks is not None:
                self.ticks[axis] = ticks
        self.equal = self.equal or aspect == "equal"

    def get_xlim(self) -> Limits:
        """What the axes show."""
        return self.shared["x"].limits()

    def get_ylim(self) -> Limits:
        """What the axes show."""
        return self.shared["y"].limits()

    def tick_params(self, *, labelsize: float = SIZE, length: float = TICK, pad: float = PAD) -> None:
        """How ticks look."""
        self.tick_size, self.tick_length, self.tick_pad = labelsize, length, pad

    def inset_axes(self, rect: tuple[float, float, float, float]) -> Axes:
        """Axes at shares of these axes."""
        left, bottom, width, height = self.rect
        x, y, w, h = rect
        made = Axes(self.figure, (left + x * width, bottom + y * height, w * width, h * height))
        self._insets.append(made)
        return made

    # What is drawn.

    def plot(
        self,
        x: Any,
        y: Any,
        *,
        color: Colour = INK,
        linewidth: float = 1.5,
        dashes: Sequence[float] = (),
        label: str | None = None,
        zorder: float = 2.0,
    ) -> None:
        """A line, broken where a point is not finite."""
        xy, ink = self._taken(x, y, ""), code(color)
        if label is not None:
            self._legend.append((label, ink))

        def drawn() -> str:
            return f'<path d="{path_data(self._place(xy))}" fill="none" {stroke(ink, linewidth, dashes)}/>'

        self._later.append((zorder, True, drawn))

    def points(
        self,
        x: Any,
        y: Any,
        marker: str,
        *,
        color: Colour = INK,
        markersize: float = 6.0,
        alpha: float = 1.0,
        zorder: float = 2.0,
        clip_on: bool = True,
    ) -> None:
        """A marker at each point that is finite: '.' (one picture of all), o, ^, x."""
        xy, ink = self._taken(x, y, marker), code(color)

        def drawn() -> str:
            at = self._place(xy)
            if marker == ".":
                return dots(at, self.box, ink, markersize / 4.0, alpha)  # matplotlib's "." is half as wide as its "o"
            return markers(at[np.isfinite(at).all(axis=1)], marker, ink, markersize)

        self._later.append((zorder, clip_on, drawn))

    def _taken(self, x: Any, y: Any, marker: str) -> Float:
        """Points (n, 2) that the axes' limits hold from now on."""
        xy = np.column_stack([np.asarray(x, float).ravel(), np.asarray(y, float).ravel()])
        self.lines.append(Line(xy, marker))
        self._take(xy[:, 0], xy[:, 1])
        return xy

    def step(self, x: Float, y: Float, *, color: Colour = INK, linewidth: float = 1.5) -> None:
        """A staircase: each value holds from the place before it to its own."""
        xs, ys = np.repeat(x, 2)[:-1], np.repeat(y, 2)[1:]
        self.plot(xs, ys, color=color, linewidth=linewidth)
        self.lines[-1] = Line(np.column_stack([x, y]), "")

    def fill(self, x: Any, y: Any, *, facecolor: Colour = "none", hatch: str = "", zorder: float = 1.0) -> None:
        """A polygon, filled or hatched."""
        xy = np.column_stack([x, y])
        self._take(xy[:, 0], xy[:, 1])
        self._later.append(
            (zorder, True, lambda: f'<path d="{path_data(self._place(xy))}Z" {filled(facecolor, hatch)}/>')
        )

    def fill_between(
        self, x: Any, low: Any, high: Any, *, color: Colour, alpha: float = 1.0, zorder: float = 1.0
    ) -> None:
        """The area between two curves, broken where one is not finite."""
        both = np.column_stack([np.asarray(x, float), np.asarray(low, float), np.asarray(high, float)])
        self._take(both[:, 0], both[:, 1])
        self._take(both[:, 0], both[:, 2])
        pieces = [p for p in np.split(both, np.flatnonzero(~np.isfinite(both).all(axis=1)))]
        whole = [p[np.isfinite(p).all(axis=1)] for p in pieces]

        def drawn() -> str:
            rings = (np.vstack([p[:, [0, 1]], p[::-1, [0, 2]]]) for p in whole if len(p) > 1)
            d = "".join(f"{path_data(self._place(ring))}Z" for ring in rings)
            return f'<path d="{d}" fill="{code(color)}" fill-opacity="{pt(alpha)}"/>'

        self._later.append((zorder, True, drawn))

    def axhspan(self, low: float, high: float, *, color: Colour, zorder: float = 1.0) -> None:
        """A band across the axes."""
        self.shared["y"].take(np.array([low, high]))
        self._later.append((zorder, True, lambda: self._rect(None, (low, high), filled(color))))

    def axvspan(
        self, low: float, high: float, *, facecolor: Colour = "none", hatch: str = "", zorder: float = 1.0
    ) -> None:
        """A band up the axes."""
        self.shared["x"].take(np.array([low, high]))
        self._later.append((zorder, True, lambda: self._rect((low, high), None, filled(facecolor, hatch))))

    def axhline(
        self,
        at: float,
        *,
        color: Colour = INK,
        linewidth: float = 1.5,
        dashes: Sequence[float] = (),
        zorder: float = 2.0,
    ) -> None:
        """A line across the axes."""
        self.shared["y"].take(np.array([at]))

        def drawn() -> str:
            left, _, width, _ = self.box
            y = pt(self._y(at))
            return f'<path d="M{pt(left)} {y}H{pt(left + width)}" {stroke(code(color), linewidth, dashes)}/>'

        self._later.append((zorder, True, drawn))

    def axvline(self, at: float, *, color: Colour = INK, linewidth: float = 1.5, zorder: float = 2.0) -> None:
        """A line up the axes."""

        def drawn() -> str:
            _, top, _, height = self.box
            return f'<path d="M{pt(self._x(at))} {pt(top)}V{pt(top + height)}" {stroke(code(color), linewidth)}/>'

        self._later.append((zorder, True, drawn))

    def bars_below(self, spans: Iterable[Limits], share: float, *, color: Colour) -> None:
        """Bars along the bottom, so high in shares of the axes."""
        self.bars = list(spans)

        def drawn() -> str:
            low, high = self.get_ylim()
            up = (low, low + share * (high - low))
            return "".join(self._rect(span, up, filled(color)) for span in self.bars)

        self._later.append((2.0, True, drawn))

    def heat(self, values: Float, x: Float, y: Float, behind: Sequence[Sequence[str]] = ()) -> None:
        """Cells (rows, columns) about x (columns,) and y (rows,), rising evenly, by colour; their scale at the right.

        Where a value is not finite the colour `behind` it is seen, faint.
        """
        known = np.isfinite(values)
        low, high = float(values[known].min()), float(values[known].max())
        shades = np.zeros((*values.shape, 4), np.uint8)
        if behind:
            shades[...] = [[(*rgb(one), FAINT) for one in row] for row in behind]
        shades[known, :3], shades[known, 3] = ramp((values[known] - low) / (high - low or 1.0)), 255
        (left, right), (bottom, top) = (
            (at[0] - half, at[-1] + half)
            for at, half in ((at, np.ptp(at) / max(len(at) - 1, 1) / 2.0 or 0.5) for at in (x, y))
        )
        self.set(xlim=(left, right), ylim=(bottom, top))
        self._later.append((1.0, True, lambda: cells(shades, self.box)))
        self.scale((low, high if high > low else low + 1.0))

    def scale(self, limits: Limits, anchors: Sequence[str] = ANCHORS) -> None:
        """What the colours between these mean, at the right, where the chart becomes narrower."""
        left, bottom, width, height = self.rect
        gap, wide, names = (one / self.figure.width for one in SCALE)
        self.rect = (left, bottom, width - gap - wide - names, height)
        scale = Axes(self.figure, (left + width - wide - names, bottom, wide, height))
        self._insets.append(scale)
        scale.ticks_right = True
        scale.set(xlim=(0.0, 1.0), ylim=limits, xticks=((), ()))
        bar = np.insert(ramp(np.linspace(0.0, 1.0, 64), anchors)[:, None], 3, 255, axis=2)
        scale._later.append((1.0, False, lambda: cells(bar, scale.box)))

    def errorbar(
        self,
        x: float,
        y: float,
        half: float,
        *,
        color: Colour,
        zorder: float = 2.0,
    ) -> None:
        """A value with its uncertainty."""
        self._take([x, x], [y - half, y + half])

        def drawn() -> str:
            at, low, high = self._x(x), self._y(y - half), self._y(y + half)
            caps = "".join(f"M{pt(at - CAP)} {pt(v)}H{pt(at + CAP)}" for v in (low, high))
            ink = code(color)
            return f'<path d="M{pt(at)} {pt(low)}V{pt(high)}{caps}" fill="none" {stroke(ink, 1.0)}/>' + markers(
                np.array([[at, self._y(y)]]), "o", ink, 4.0
            )

        self._later.append((zorder, True, drawn))

    def annotate(
        self,
        text: str,
        at: Any,
        offset: tuple[float, float] = (0.0, 0.0),
        *,
        xycoords: str | tuple[str, str] = "data",
        ha: str = "left",
        va: str = "baseline",
        fontsize: float = SIZE,
        look: Lettering = PLAIN,
    ) -> None:
        """A text beside a place, `offset` points away: in the axes' units, or in "axes fraction"."""

        def place() -> tuple[float, float, float, float]:
            x, y = self._anchor(at, xycoords)
            wide, high = text_width(text, fontsize), 1.2 * fontsize * (text.count("\n") + 1)
            left = x + offset[0] - {"left": 0.0, "center": 0.5, "right": 1.0}[ha] * wide
            top = y - offset[1] - {"top": 0.0, "center": 0.5}.get(va, 1.0) * high
            return left, top, left + wide, top + high

        self.texts.append(Text(text, place))

        def drawn() -> str:
            x, y = self._anchor(at, xycoords)
            return text_element(
                text,
                x + offset[0],
                y - offset[1],
                fontsize,
                ha,
                va,
                look,
            )

        self._later.append((3.0, False, drawn))

    def arrow(
        self,
        tip: Sequence[float] | Float,
        tail: Sequence[float] | Float,
        *,
        both: bool = False,
        linewidth: float = 0.6,
    ) -> None:
        """An arrow in the axes' units, with a head at its tip or both ends."""
        ends = np.array([tail, tip], float)
        self._take(ends[:, 0], ends[:, 1])

        def drawn() -> str:
            (x0, y0), (x1, y1) = self._place(ends)
            ink = code(INK)
            heads = arrow_head(x1, y1, x1 - x0, y1 - y0) + (arrow_head(x0, y0, x0 - x1, y0 - y1) if both else "")
            line = f'<path d="M{pt(x0)} {pt(y0)}L{pt(x1)} {pt(y1)}" {stroke(ink, linewidth)}/>' if linewidth else ""
            return f'{line}<path d="{heads}" fill="{ink}"/>'

        self._later.append((3.0, False, drawn))

    def legend(self) -> None:
        """Names of the labelled lines above the axes, at the right."""
        self._later.append((5.0, False, self._drawn_legend))

    # How it is drawn.

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, width, height on paper; smaller where one scale is asked for both ways."""
        left, bottom, width, height = self.rect
        w, h = width * self.figure.width, height * self.figure.height
        x, y = left * self.figure.width, self.figure.height * (1.0 - bottom - height)
        if self.equal:
            (x0, x1), (y0, y1) = self.get_xlim(), self.get_ylim()
            scale = min(w / (x1 - x0), h / (y1 - y0))
            shown = scale * (x1 - x0), scale * (y1 - y0)
            x, y, (w, h) = x + (w - shown[0]) / 2, y + (h - shown[1]) / 2, shown
        return x, y, w, h

    def drawn(self, clip: str) -> str:
        """The axes as SVG elements."""
        parts = [
            ("" if inside else "</g>", draw(), "" if inside else f'<g clip-path="url(#{clip})">')
            for _, inside, draw in sorted(self._later, key=lambda one: one[0])
        ]
        inside = "".join(text for part in parts for text in part)
        body = f'<g clip-path="url(#{clip})">{inside}</g>'.replace(f'<g clip-path="url(#{clip})"></g>', "")
        return f"<g>{body}{self._frame()}{''.join(one.drawn(clip) for one in self._insets)}</g>"

    def _take(self, x: Any, y: Any) -> None:
        self.shared["x"].take(x)
        self.shared["y"].take(y)

    def _x(self, value: float) -> float:
        (low, high), (left, _, width, _) = self.get_xlim(), self.box
        return left + width * (value - low) / (high - low)

    def _y(self, value: float) -> float:
        (low, high), (_, top, _, height) = self.get_ylim(), self.box
        return top + height * (high - value) / (high - low)

    def _place(self, xy: Float) -> Float:
        """(n, 2) on paper."""
        (x0, x1), (y0, y1), (left, top, width, height) = self.get_xlim(), self.get_ylim(), self.box
        with np.errstate(over="ignore", invalid="ignore"):
            x, y = left + width / (x1 - x0) * (xy[:, 0] - x0), top + height / (y1 - y0) * (y1 - xy[:, 1])
        return np.column_stack([x, y])

    def _anchor(self, at: Any, coordinates: str | tuple[str, str]) -> tuple[float, float]:
        of_x, of_y = (coordinates, coordinates) if isinstance(coordinates, str) else coordinates
        left, top, width, height = self.box
        x = left + width * float(at[0]) if of_x == "axes fraction" else self._x(float(at[0]))
        y = top + height * (1.0 - float(at[1])) if of_y == "axes fraction" else self._y(float(at[1]))
        return x, y

    def _rect(self, across: Limits | None, up: Limits | None, filled: str) -> str:
        left, top, width, height = self.box
        x0, x1 = (self._x(v) for v in across) if across else (left, left + width)
        y0, y1 = (self._y(v) for v in up[::-1]) if up else (top, top + height)
        return f'<rect x="{pt(x0)}" y="{pt(y0)}" width="{pt(x1 - x0)}" height="{pt(y1 - y0)}" {filled}/>'

    def _ticks(self, axis: str) -> Ticks:
        if axis in self.ticks:
            return self.ticks[axis]
        room = self.box[2 if axis == "x" else 3]
        return nice_ticks(
            self.shared[axis].limits(), max(2, int(room / TICKS_EACH_PT[axis])), integer=axis in self.integer
        )

    def _frame(self) -> str:
        """Left and lower border, ticks, their labels, and what the axes show."""
        left, top, width, height = self.box
        bottom = top + height
        border = f"M{pt(left)} {pt(top)}V{pt(bottom)}" + ("" if self.spine_hidden else f"H{pt(left + width)}")
        marks, names = "", ""
        at, texts = self._ticks("x")
        for value, text in zip(at, texts, strict=True):
            x = self._x(value)
            marks += f"M{pt(x)} {pt(bottom)}v{pt(self.tick_length)}"
            if self.labelled["x"]:
                names += text_element(
                    text, x, bottom + self.tick_length + self.tick_pad, self.tick_size, "center", "top"
                )
        at, texts = self._ticks("y")
        side, out, ha = (left + width, 1.0, "left") if self.ticks_right else (left, -1.0, "right")
        for value, text in zip(at, texts, strict=True):
            y = self._y(value)
            marks += f"M{pt(side)} {pt(y)}h{pt(out * self.tick_length)}"
            if self.labelled["y"]:
                names += text_element(
                    text, side + out * (self.tick_length + self.tick_pad), y, self.tick_size, ha, "center"
                )
        below = self.tick_length + self.tick_pad + self.tick_size + 4.0
        if self.labels["x"] and self.labelled["x"]:
            names += text_element(self.labels["x"], left + width / 2, bottom + below, SIZE, "center", "top")
        if self.labels["y"]:
            names += text_element(
                self.labels["y"], self._y_label_x(), top + height / 2, SIZE, "center", "bottom", UPRIGHT
            )
        return f'<path d="{border}{marks}" fill="none" stroke="{GREY}" stroke-width="0.7"/>{names}'

    def _y_label_x(self) -> float:
        """The baseline of the last row of the label left of the axes."""
        left, _, width, _ = self.box
        if self.y_label_at is not None:
            return left + self.y_label_at * width
        texts = self._ticks("y")[1] if self.labelled["y"] else []
        widest = max((text_width(text, self.tick_size) for text in texts), default=0.0)
        return left - self.tick_length - self.tick_pad - widest - 4.0

    def beyond_the_sheet(self) -> float:
        """How far the label left of the axes lies beyond the sheet, pt; below 0: within."""
        rows = self.labels["y"].count("\n") + 1
        return 1.2 * rows * SIZE - self._y_label_x() if self.labels["y"] else 0.0

    def _drawn_legend(self) -> str:
        left, top, width, _ = self.box
        x, out = left + width, ""
        for name, ink in reversed(self._legend):
            x -= text_width(name, SIZE)
            out += text_element(name, x, top - 7, SIZE, "left", "center")
            out += f'<path d="M{pt(x - 24)} {pt(top - 7)}h18" {stroke(ink, 1.5)}/>'
            x -= 36
        return out


def nice_ticks(limits: Limits, most: int, *, integer: bool = False) -> tuple[list[float], list[str]]:
    """Round values within the limits, at most so many, and their names with as many decimals as they need.

    >>> nice_ticks((0.0, 77.0), 5)
    ([0.0, 20.0, 40.0, 60.0], ['0', '20', '40', '60'])
    """
    low, high = limits
    raw = (high - low) / most
    decade = 10.0 ** math.floor(math.log10(raw))
    steps = [s * decade for s in STEPS if s * decade >= raw * (1 - 1e-9) and (not integer or (s * decade) % 1 == 0)]
    step = steps[0] if steps else 1.0
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    at = [k * step for k in range(first, last + 1)]
    places = next((p for p in range(12) if abs(round(step, p) - step) < 1e-9 * step), 12)
    return at, [f"{value:.{places}f}".replace("-", "−") if value else f"{0:.{places}f}" for value in at]
