"""What a file holds, ready to be told and shown. Lengths in mm."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.artefacts import Strokes
from workbench.artefacts.checks import Check
from workbench.artefacts.showing import shown
from workbench.edge.groove_rows import Rows
from workbench.look.single import Profile
from workbench.units import Float, Shaped


@shown
@dataclass(frozen=True, slots=True, eq=False)
class Shade:
    """A value a point, by which the view may be coloured."""

    name: str  # with its unit
    values: Shaped[Float, " n"]


@shown
@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A file as it was understood."""

    source: str
    kind: str  # what it is, for people
    frame: str  # in what frame the points are shown, in words
    lines: tuple[str, ...]  # the summary
    points_mm: Shaped[Float, "n 3"]  # a sample of the points; any first part of it shows the whole
    shades: tuple[Shade, ...]
    strokes: tuple[Strokes, ...] = ()
    checks: tuple[Check, ...] = ()
    suggestions: tuple[str, ...] = ()  # what would make it consistent
    profile: Profile | None = None  # where there is a single one
    corners: Rows | None = None  # of a groove, in rows of ranges
    hints: tuple[str, ...] = ()  # what to do next
