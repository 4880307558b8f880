"""What a report is made of: chapters, views in space, files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from workbench.artefacts.edges import Verdict
from workbench.artefacts.evidence import Part
from workbench.artefacts.showing import brief
from workbench.errors import PipelineError
from workbench.units import AnyArray, Float, Shaped


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
