"""The planned bevel in the sections that were inspected, beside what was measured there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.artefacts import EdgeProfile, Inspection, Section, Toolpath
from workbench.report.along import gaps
from workbench.report.chart_parts import hatch_hidden, mark_sections, svg
from workbench.report.colours import INK, LIMIT, MEASURED, VERDICTS
from workbench.report.planned import frames_in_base
from workbench.report.plot import Axes, Figure
from workbench.report.text import COVERAGE
from workbench.units import DEG, Bool, Float

NEAR_MM = 20.0  # farther from the section's origin the path belongs to another place


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """A section: planned root face, mm, and bevel angle, deg; None where the final layer does not cut there."""

    section: Section
    root_mm: float | None
    bevel_deg: float | None


def compared(inspection: Inspection, toolpath: Toolpath) -> list[Compared]:
    """Each inspected section with what the path's final layer makes in it."""
    final = toolpath.layers[-1]
    position = toolpath.in_base(final.position_mm)
    axis = frames_in_base(toolpath, final)[:, :, 2]
    both = final.cutting[1:] & final.cutting[:-1]
    found = []
    for section in inspection.sections:
        crossing = _crossing(section, position, axis, both)
        found.append(Compared(section, None, None) if crossing is None else _planned(section, *crossing))
    return found


def loop_chart(inspection: Inspection, toolpath: Toolpath, rows: list[Compared]) -> bytes:
    """SVG of the deviations from the requirement, along the edge: measured with uncertainty, planned as crosses."""
    profile = inspection.profile
    figure = Figure(figsize=(10, 3.4))
    root, bevel = figure.subplots(2, 1, sharex=True)
    figure.subplots_adjust(0.1, 0.15, 0.985, 0.93, hspace=0.18)
    _draw_deviation(root, profile, rows, "root", "mm", toolpath.root_mm)
    _draw_deviation(bevel, profile, rows, "bevel", "deg", toolpath.bevel_deg)
    root.set_ylabel("root face\ndeviation, mm")
    bevel.set_ylabel("bevel angle\ndeviation, °")
    for axes in (root, bevel):
        axes.y_label_at = -0.062
    mark_sections(root, [r.section.arc_length_mm for r in rows], [str(r.section.index) for r in rows])
    bevel.set_xlabel("arc length along the lower edge of the milled part, mm")
    return svg(figure)


def _draw_deviation(axes: Axes, profile: EdgeProfile, rows: list[Compared], name: str, unit: str, asked: float) -> None:
    """One quantity, `root` in `mm` or `bevel` in `deg`, deviation from the requirement."""
    value_name, u_name, s = f"{name}_{unit}", f"{name}_u_{unit}", profile.arc_length_mm
    off, wide = getattr(profile, value_name) - asked, COVERAGE * getattr(profile, u_name)
    axes.set_xlim(float(s[0]), float(s[-1]))
    axes.axhline(0.0, color=LIMIT, linewidth=0.8, dashes=(8, 2, 1.5, 2))
    axes.fill_between(s, off - wide, off + wide, color=MEASURED, alpha=0.25)
    axes.plot(s, off, color=MEASURED, linewidth=1.0)
    for row in rows:
        at, value, planned = row.section.arc_length_mm, getattr(row.section, value_name), getattr(row, value_name)
        if value is not None:
            axes.errorbar(
                at,
                value - asked,
                COVERAGE * (getattr(row.section, u_name) or 0.0),
                markersize=4,
                capsize=2.5,
                linewidth=1.0,
                color=VERDICTS[row.section.verdict],
                zorder=4,
            )
        if planned is not None:
            axes.plot(at, planned - asked, "x", color=INK, markersize=6, zorder=5)
    hatch_hidden(axes, gaps(s, np.isfinite(off)))


def _crossing(section: Section, position: Float, axis: Float, cutting: Bool) -> tuple[Float, Float] | None:
    """Where the path crosses the section plane while it cuts: position (3,) and cutter axis (3,), in the base."""
    off = (position - section.origin_mm) @ section.tangent
    distance = np.linalg.norm(position[1:] - section.origin_mm, axis=1)
    crosses = cutting & (off[1:] * off[:-1] <= 0.0) & (distance < NEAR_MM)
    if not crosses.any():
        return None
    k = int(np.argmin(np.where(crosses, distance, np.inf)))
    span = off[k + 1] - off[k]
    part = -off[k] / span if span else 0.0
    return position[k] + part * (position[k + 1] - position[k]), axis[k] + part * (axis[k + 1] - axis[k])


def _planned(section: Section, position: Float, axis: Float) -> Compared:
    """Root face and bevel angle that the cutter's flank makes in the section's axes."""
    offset = position - section.origin_mm
    u, v = offset @ section.normal, offset @ section.across
    out, up = axis @ section.normal, axis @ section.across
    return Compared(section, float(v - u * up / out), float(np.arctan2(abs(out), abs(up)) / DEG))
