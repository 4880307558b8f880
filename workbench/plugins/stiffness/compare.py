"""`stiffness.compare`: what the compensation of deflection has changed in the milled part."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from workbench.api import (
    Chapter,
    Document,
    Inspection,
    PathDeflection,
    pieces,
    plot,
    stage,
    strict_json,
)


@stage("stiffness.compare")
def compare(without: Inspection, compensated: Inspection, bending: PathDeflection) -> tuple[Document, Chapter]:
    """Root and bevel angle as inspected, of a part milled as planned and of one milled along the corrected path.

    Args:
        without: the part that was milled along the path as planned.
        compensated: the part that was milled along the corrected one.
        bending: how far the cutter gave way while both were milled.

    Example:
        >>> from workbench import edge, inspect, path, robot, scan
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> springs = stiffness.read(cell)
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> force, file = stiffness.force(plan, None, cell)
        >>> at = {"cutter_rotation_deg": (0, 0), "turntable_deg": (0, 0), "whole_map": False}
        >>> postures, *_ = stiffness.posture(cell, springs, plan, force, **at)
        >>> bending, file = stiffness.predict(cell, springs, plan, force, postures)
        >>> points = scan.fuse(scan.read(recording="data/synthetic/paths/raw_arc_milled.h5"))
        >>> found = inspect.sections(edge.segment(points))
        >>> document, chapter = stiffness.compare(found, found, bending)  # one part twice: no difference
        >>> chapter.title
        'Deflection, without and with compensation'
    """
    errors = {name: _errors(one) for name, one in (("without", without), ("compensated", compensated))}
    gave = np.concatenate([np.linalg.norm(moved, axis=1) for moved in bending.by_layer_mm.values()])
    root = {name: found["mean_root_error_mm"] for name, found in errors.items()}
    summary = (
        f"Mean error of the root face {root['without']:+.3f} mm without compensation, {root['compensated']:+.3f} mm "
        f"with it; the cutter is deflected by up to {gave.max():.3f} mm"
    )
    head = ("Path", "Root face error, mean, mm", "largest, mm", "Bevel angle error, mean, °", "largest, °")
    rows = [(name, *(f"{value:+.4f}" for value in found.values())) for name, found in errors.items()]
    text = pieces.table_html(head, rows) + pieces.figure_html(
        _picture(without, compensated),
        "Root face and bevel angle along the edge, both parts",
        "Dotted: nominal values.",
    )
    document = strict_json(
        {
            "format": "compensation",
            "version": 1,
            "part": asdict(compensated.part),
            "largest_deflection_mm": gave.max(),
            **errors,
        }
    )
    return Document("compensation.json", document), Chapter(
        "Deflection, without and with compensation", text, summary=summary, part=compensated.part
    )


def _errors(inspection: Inspection) -> dict[str, float]:
    """Mean and largest deviation from nominal of the sections' root and angle."""
    wanted, found = inspection.requirements, {}
    for name, unit, nominal in (("root", "mm", wanted.root_nominal_mm), ("bevel", "deg", wanted.bevel_nominal_deg)):
        off = np.array([getattr(section, f"{name}_{unit}") for section in inspection.sections]) - nominal
        found[f"mean_{name}_error_{unit}"] = float(np.nanmean(off))
        found[f"largest_{name}_error_{unit}"] = float(off[np.nanargmax(np.abs(off))])
    return found


def _picture(without: Inspection, compensated: Inspection) -> bytes:
    """Root and bevel angle along the edge, of both parts (SVG)."""
    wanted, figure = without.requirements, plot.Figure((10.0, 4.2))
    top, below = figure.subplots(2, 1, sharex=True)
    figure.subplots_adjust(0.07, 0.13, 0.98, 0.92)
    for (name, one), colour in zip((("without", without), ("compensated", compensated)), pieces.SERIES, strict=False):
        top.plot(one.profile.arc_length_mm, one.profile.root_mm, color=colour, linewidth=1.0, label=name)
        below.plot(one.profile.arc_length_mm, one.profile.bevel_deg, color=colour, linewidth=1.0)
    for axes, nominal in ((top, wanted.root_nominal_mm), (below, wanted.bevel_nominal_deg)):
        axes.axhline(nominal, color=pieces.GREY, linewidth=0.8, dashes=(1.0, 2.0))
    top.set(ylabel="root face, mm")
    below.set(xlabel="arc length, mm", ylabel="bevel angle, °")
    top.legend()
    return figure.svg()
