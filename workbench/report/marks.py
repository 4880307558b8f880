"""What can be chosen in a scene: the sections of an inspection, the layers of a path."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Mark, Section, Toolpath
from workbench.report.colours import SIGNS, VERDICTS
from workbench.report.loop import Compared
from workbench.report.plan_tables import layer_rows
from workbench.report.planned import Run
from workbench.report.ramp import layer_colours
from workbench.report.sample import Points
from workbench.report.section_views import plane_corners
from workbench.report.values import decimals, measured

LAYER_FACTS = ("Layer", "Height", "Width of its face", "Length cut", "Points", "Feed", "Time")
LAYER_UNITS = ("", " mm", " mm", " mm", "", " mm/s", "")


def section_marks(
    points: Points, sections: tuple[Section, ...], planned: list[Compared] | None = None
) -> tuple[Mark, ...]:
    """A section each: its plane outlined in the colour of its verdict, its values; with what was planned, if given."""
    corners = plane_corners(points, sections)
    places = (decimals(s.root_u_mm for s in sections), decimals(s.bevel_u_deg for s in sections))
    marks = []
    for k, s in enumerate(sections):
        facts = section_facts(s, places)
        if planned is not None:
            root, bevel = measured(planned[k].root_mm, None, 3), measured(planned[k].bevel_deg, None, 2)
            facts = (*facts, ("Root planned", f"{root} mm"), ("Bevel planned", f"{bevel}°"))
        outline = corners[k][[0, 1, 2, 3, 0]]
        marks.append(Mark(f"{s.index}", corners[k][[2, 3]].mean(axis=0), outline, VERDICTS[s.verdict], facts))
    return tuple(marks)


def section_facts(s: Section, places: tuple[int, int]) -> tuple[tuple[str, str], ...]:
    """What is known of a section, as text: values with U = 2 u, and u itself."""
    root_u = "–" if s.root_u_mm is None else f"{s.root_u_mm:.4f} mm"
    bevel_u = "–" if s.bevel_u_deg is None else f"{s.bevel_u_deg:.4f}°"
    return (
        ("Section", f"{s.index}"),
        ("Arc length", f"{s.arc_length_mm:.2f} mm"),
        ("Root face ± U", f"{measured(s.root_mm, s.root_u_mm, places[0])} mm"),
        ("u of root face", root_u),
        ("Bevel angle ± U", f"({measured(s.bevel_deg, s.bevel_u_deg, places[1])})°"),
        ("u of bevel angle", bevel_u),
        ("Verdict", f"{SIGNS[s.verdict]} {s.verdict}"),
        *([("Reason", s.reason)] if s.reason else []),
    )


def layer_marks(toolpath: Toolpath, run: Run) -> tuple[Mark, ...]:
    """A layer each, its label at a place of its own along it; facts as in the table of layers."""
    count, marks = len(toolpath.layers), []
    for k, (layer, row) in enumerate(zip(toolpath.layers, layer_rows(toolpath, run), strict=False)):
        line = toolpath.in_base(layer.position_mm)
        colour = "#{:02x}{:02x}{:02x}".format(*layer_colours(np.array([layer.index]), count)[0])
        facts = tuple((name, value + unit) for name, value, unit in zip(LAYER_FACTS, row, LAYER_UNITS, strict=True))
        marks.append(Mark(f"{layer.index}", line[int((k + 0.5) / count * len(line))], line, colour, facts))
    return tuple(marks)
