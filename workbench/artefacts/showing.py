"""How artefacts show themselves in a notebook: a line instead of arrays, a small table, charts.

`shown` gives a dataclass a short `repr` and `_repr_html_`; `rows_table` and the charts serve `.table()` and `.plot()`.

Below it stands what a report is made of: chapters, views in space, files.
"""

from __future__ import annotations

import base64
import html
import importlib
import importlib.util
import io
import itertools
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Literal, TypeVar

import numpy as np

from workbench.artefacts.evidence import Part, Verdict
from workbench.errors import PipelineError
from workbench.pieces import BLUE, GREEN, ORANGE
from workbench.units import AnyArray, Float, Shaped

LONGEST, MOST_KEYS = 60, 4  # characters of a value, keys of a mapping
SCENE_PX, MOST_POINTS = [960, 600], 200_000
CHART_INCHES = (8.0, 3.2)
CELL = "style='text-align:left'"
T = TypeVar("T", bound=type)


def shown(cls: T) -> T:
    """Give a dataclass a short `repr` and `_repr_html_`."""
    setattr(cls, "__repr__", _line)  # noqa: B010 (mypy)
    setattr(cls, "_repr_html_", _page)  # noqa: B010
    return cls


def shown_all(*values: Any) -> None:
    """`shown` for every dataclass among the values, such as those of a module."""
    for one in values:
        if isinstance(one, type) and is_dataclass(one):
            shown(one)


def brief(value: Any) -> str:
    """A value in a few words: an array by its shape, a sequence by its length, an artefact by its name."""
    if isinstance(value, np.ndarray):
        return f"array {'x'.join(map(str, value.shape))} {value.dtype}"
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if isinstance(value, float | np.floating):
        return f"{value:.6g}"
    if is_dataclass(value):
        return f"{type(value).__name__}(...)"
    if isinstance(value, Mapping):
        items = [f"{key}: {brief(one)}" for key, one in list(value.items())[:MOST_KEYS]]
        return "{" + ", ".join([*items, *(["..."] if len(value) > MOST_KEYS else [])]) + "}"
    if isinstance(value, tuple | list) and any(is_dataclass(one) or isinstance(one, np.ndarray) for one in value):
        return f"{len(value)} x {type(value[0]).__name__}"
    if callable(value) or repr(value) == object.__repr__(value):
        return str(getattr(value, "__name__", type(value).__name__))
    text = repr(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


def _rows(self: Any) -> list[tuple[str, str]]:
    """Fields with something in them, briefly."""
    values = ((one.name, getattr(self, one.name)) for one in fields(self))
    return [(name, brief(value)) for name, value in values if not _empty(value)]


def _empty(value: Any) -> bool:
    return value is None or (isinstance(value, Sequence | Mapping) and not len(value))


def _line(self: Any) -> str:
    return f"{type(self).__name__}({', '.join(f'{name}={text}' for name, text in _rows(self))})"


def _page(self: Any) -> str:
    """Fields; of what has `more_html`, that first."""
    rows = (f"<tr><th {CELL}>{name}</th><td {CELL}>{html.escape(text)}</td></tr>" for name, text in _rows(self))
    more = getattr(self, "more_html", str)()
    return f"{more}<table><caption>{type(self).__name__}</caption>{''.join(rows)}</table>"


def picture_html(figure: Any) -> str:
    """What has a picture of itself, as an image of a page."""
    return f"<img alt='' src='data:image/png;base64,{base64.b64encode(figure._repr_png_()).decode()}'>"


def rows_table(rows: list[dict[str, Any]]) -> Any:
    """A pandas DataFrame where pandas is installed, else the rows as they are."""
    if importlib.util.find_spec("pandas") is None:
        return rows
    return importlib.import_module("pandas").DataFrame(rows)


def columns_table(**columns: AnyArray) -> Any:
    """As `rows_table`, of arrays of one length by name."""
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    return rows_table([dict(zip(columns, row, strict=True)) for row in rows])


def along_chart(arc_length_mm: Float, *series: tuple[str, Float, Float | None]) -> Any:
    """A matplotlib Figure: values (label, (n,), (n,) standard uncertainty or None) along the edge, U = 2 u a band."""
    figure = chart(len(series))
    for k, (label, values, u) in enumerate(series, 1):
        axes = figure.add_subplot(len(series), 1, k)
        axes.plot(arc_length_mm, values, color=BLUE, linewidth=1.2)
        if u is not None:
            axes.fill_between(arc_length_mm, values - 2 * u, values + 2 * u, color=BLUE, alpha=0.25, linewidth=0)
        axes.set(xlabel="arc length, mm" if k == len(series) else "", ylabel=label)
    return figure


def space_scene(*lines: tuple[str, Float], points_mm: Float | None = None) -> Any:
    """A PyVista plotter: curves (label, (n, 3)) and points (n, 3), coloured by height, in the base.

    A notebook shows its picture; `.show()` turns it in a window; more can be added to it.
    """
    import pyvista as pv

    class NotebookScene(pv.Plotter):
        def _repr_png_(self) -> bytes:
            from PIL import Image

            out = io.BytesIO()
            Image.fromarray(np.asarray(self.screenshot(return_img=True))).save(out, format="png")
            return out.getvalue()

    screen = sys.platform in ("darwin", "win32") or bool({"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys())
    scene: Any = NotebookScene(off_screen=not screen, window_size=SCENE_PX)
    if points_mm is not None:
        some = points_mm[:: max(1, len(points_mm) // MOST_POINTS)]
        scene.add_points(some, scalars=some[:, 2], scalar_bar_args={"title": "z, mm"}, point_size=3.0)
    for (label, way), colour in zip(lines, itertools.cycle((BLUE, ORANGE, GREEN)), strict=False):
        known = way[np.isfinite(way).all(axis=1)]
        if len(known) > 1:
            scene.add_mesh(pv.lines_from_points(known), color=colour, line_width=3, label=label)
    if lines:
        scene.add_legend(bcolor=None, face="line")
    scene.show_bounds(location="outer", xtitle="x, mm", ytitle="y, mm", ztitle="z, mm", font_size=9, fmt="%.0f")
    return scene


def chart(rows: float = 1.0) -> Any:
    """An empty matplotlib Figure, `rows` charts high, that a notebook shows without any set-up."""
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        def _repr_png_(self) -> bytes:
            out = io.BytesIO()
            self.savefig(out, format="png", dpi=100)
            return out.getvalue()

    return NotebookFigure(figsize=(CHART_INCHES[0], CHART_INCHES[1] * rows), layout="constrained")


class AlongTheEdge:
    """`.table()` and `.plot()` of what is measured at stations along an edge."""

    __slots__ = ()

    def table(self) -> Any:
        """One row per station: a pandas DataFrame where pandas is installed, else a list of dicts."""
        one: Any = self
        named = _xyz("position_mm", one.position_mm) | _xyz("normal", one.normal)
        return columns_table(arc_length_mm=one.arc_length_mm, seen=one.seen, **named)

    def plot(self) -> Any:
        """A PyVista plotter with the edges in the base."""
        one: Any = self
        upper = getattr(one, "upper_position_mm", None)
        return space_scene(("lower edge", one.position_mm), *([] if upper is None else [("upper edge", upper)]))


def _xyz(name: str, values: Float) -> dict[str, Float]:
    base, unit, _ = name.partition("_mm")
    return {f"{base}_{axis}{unit}": values[:, k] for k, axis in enumerate("xyz")}


@dataclass(frozen=True, slots=True, eq=False)
class Shading:
    """One way to colour the n points of a scene, and what the colours mean."""

    name: str
    index: Shaped[AnyArray, " n"]  # uint8, row of the palette
    palette: Shaped[AnyArray, "p 3"]  # uint8 red, green, blue
    legend: tuple[tuple[str, str], ...]  # text, '#rrggbb'


@dataclass(frozen=True, slots=True, eq=False)
class Strokes:
    """Lines of a scene that are shown and hidden together."""

    name: str
    lines_mm: tuple[Float, ...]  # each (k, 3) in the base, finite
    colours: tuple[AnyArray, ...]  # each (k, 3) uint8, one a point
    shown: bool = True  # at first
    moved: Shaped[Float, "f 4 4"] | None = None  # motion of the lines in each frame of the scene; None: they stand


@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """What can be chosen in a scene, such as a section.

    A row of the chapter's tables with the attribute `data-mark` equal to `key` is chosen with it.
    """

    key: str
    place_mm: Shaped[Float, " 3"]  # in the base: where its label stands
    outline_mm: Shaped[Float, "k 3"]  # in the base: drawn, and closed where it can be clicked
    colour: str  # '#rrggbb'
    facts: tuple[tuple[str, str], ...]  # name and value, shown while it is chosen


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What a chapter shows in space, to rotate in a browser. Any first part of the points shows the whole."""

    points_mm: Shaped[Float, "n 3"]  # in the base
    shadings: tuple[Shading, ...]  # at least one where there are points
    strokes: tuple[Strokes, ...]
    marks: tuple[Mark, ...]
    axes: Shaped[Float, "3 3"]  # rows t, n, m: the first look is along them, m stays upright
    marks_are: str = "sections"
    axes_names: tuple[str, str, str] = ("t", "n", "m")  # of the rows of `axes`, for the buttons
    frames: tuple[str, ...] = ()  # f moments that are played one after the other, each with what is said of it


@dataclass(frozen=True, slots=True, eq=False)
class Chapter:
    """A part of the report: a title and HTML that is complete in itself (pictures as data addresses).

    Its own headings are <h3>; the page numbers them. Text out of files must be escaped in it. Where it has a scene,
    its HTML says with an empty `<figure class="space"></figure>` where that is to stand.
    """

    title: str
    html: str
    verdict: Verdict | Literal[""] = ""  # '': the chapter decides nothing
    summary: str = ""  # one line for the top of the page, plain text
    part: Part | str | None = None  # that it is about, or its name alone
    warnings: tuple[str, ...] = ()
    scene: Scene | None = None
    certificate: str = ""  # HTML of the first page, above the signature: one A4 side with the part's identity
    about: Literal["part", "instruments"] = "part"  # instruments: of `part` only they, when and by whom count
    not_checked: tuple[str, ...] = ()  # what the run left open: on the first page, before the signature


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """A file that a run writes: `name` inside the output directory and its bytes."""

    name: str
    content: bytes

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not isinstance(self.content, bytes):
            found = f"{type(self.name).__name__}, {type(self.content).__name__}"
            raise PipelineError(
                f"Document {brief(self.name)}", f"expected name as str and content as bytes, got {found}"
            )
