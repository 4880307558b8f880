"""The chapter of the report on a planned scan."""

from __future__ import annotations

import math

import numpy as np

from workbench import pieces
from workbench.artefacts import Chapter, Gate
from workbench.scan_plan.information import Joint, View
from workbench.scan_plan.plan import ScanPlan
from workbench.scan_plan.search import COVERAGE
from workbench.scan_plan.way import aim_mm
from workbench.units import DEG

BEHIND_MM = 6.0  # of the plate, in the drawing
RAYS = 9  # drawn of a fan


def plan_chapter(made: ScanPlan, gate: Gate) -> Chapter:
    """Passes, predicted U along the edge and by source, what binds and what would help."""
    turntable = "none" if made.scan_cell else "not looked at: nothing is placed in a cell"
    facts = [
        ("Edge", f"{made.edge.length_mm:.0f} mm, by {made.edge.source}"),
        ("Wanted", f"U of the root face {made.wanted.root_mm:g} mm, of the bevel angle {made.wanted.bevel_deg:g}°"),
        ("Duration", f"{made.seconds:.0f} s in {len(made.passes)} pass{'es' * (len(made.passes) != 1)}"),
        ("Turntable", turntable if made.turntable_deg is None else f"{made.turntable_deg:.0f}°"),
    ]
    rows = [
        (
            str(k),
            f"{one.view.elevation / DEG:.0f}",
            f"{one.view.lead / DEG:.0f}",
            f"{one.view.standoff_mm:.0f}",
            f"{one.speed_mm_s:.0f}",
            f"{one.view.frame_pitch_mm:g}",
            f"{one.drift_mm:.2f}",
            f"{100 * one.sees.mean():.0f}",
        )
        for k, one in enumerate(made.passes, 1)
    ]
    head = (
        "pass",
        "elevation, °",
        "lead, °",
        "stand-off, mm",
        "speed, mm/s",
        "frames each, mm",
        "drift, mm",
        "of the edge seen, %",
    )
    text = pieces.facts_html(facts) + pieces.table_html(head, rows)
    text += pieces.figure_html(
        _section_picture(made),
        "Section of the nominal joint with the laser plane of each pass",
        "Section with the rays of each pass; dotted: surfaces that it does not measure.",
    )
    text += pieces.figure_html(
        _along_picture(made),
        "Predicted U along the edge",
        "U = 2 u along the edge as predicted; pale: up to what nine of ten scans stay within; dashed: wanted.",
    )
    worst = int(np.nanargmax(made.root.u)) if np.isfinite(made.root.u).any() else 0
    sources = [
        (
            name,
            f"{made.root.u_by_source[name][worst]:.4f}",
            f"{made.bevel.u_by_source[name][worst]:.4f}" if name in made.bevel.u_by_source else "–",
        )
        for name in made.root.u_by_source
    ]
    text += pieces.table_html(
        ("source", "u of the root face, mm", "u of the bevel angle, °"),
        sources,
        f"Where the root face is known least, at {made.arc_length_mm[worst]:.0f} mm.",
        text=(0,),
    )
    for title, items in (("What binds", made.binds), ("What would help", made.would_help)):
        if items:
            text += pieces.heading(title) + pieces.list_html(items)
    return Chapter(
        title="Planned scan", html=text, verdict=gate.verdict, summary=gate.reason, not_checked=gate.left_open
    )


def _section_picture(made: ScanPlan) -> bytes:
    from matplotlib.figure import Figure

    joint = made.joint
    with pieces.styled():
        figure = Figure(figsize=(3.6 * max(len(made.passes), 2), 3.4), layout="constrained")
        each = np.atleast_1d(figure.subplots(1, max(len(made.passes), 1), squeeze=False)[0])
        for k, (axes, one) in enumerate(zip(each, made.passes, strict=False)):
            outline = _outline(joint)
            axes.fill(*outline.T, color=pieces.PALE, lw=0)
            colour = pieces.SERIES[k % len(pieces.SERIES)]
            _rays(axes, joint, one.view, colour)
            for a, b, normal in _faces(joint):
                sight = math.cos(one.view.elevation) * normal[0] + math.sin(one.view.elevation) * normal[1]
                style = {"lw": 2.2, "color": colour} if sight > 0.2 else {"lw": 1.2, "color": pieces.INK, "ls": ":"}
                axes.plot(*np.array([a, b]).T, **style)
            axes.set_title(f"pass {k + 1}: {one.view.elevation / DEG:.0f}°")
            axes.set_aspect("equal")
            axes.set_xlabel("along n, mm")
            axes.set_ylabel("along m, mm")
        return pieces.svg(figure)


def _outline(joint: Joint) -> np.ndarray:
    back = joint.section_mm[2, 0] - BEHIND_MM
    return np.array([*joint.section_mm[:3], [back, joint.thickness_mm], [back, 0.0]])


def _faces(joint: Joint) -> list[tuple[np.ndarray, np.ndarray, tuple[float, float]]]:
    low, corner, top = joint.section_mm[:3]
    back = top[0] - BEHIND_MM
    return [
        (low, corner, (1.0, 0.0)),
        (corner, top, (math.cos(joint.bevel), math.sin(joint.bevel))),
        (top, np.array([back, joint.thickness_mm]), (0.0, 1.0)),
        (low, np.array([back, 0.0]), (0.0, -1.0)),
    ]


def _rays(axes, joint: Joint, view: View, colour: str) -> None:  # type: ignore[no-untyped-def]
    """From the laser's side to the surface that each ray meets first."""
    towards = np.array([math.cos(view.elevation), math.sin(view.elevation)])
    across = np.array([-towards[1], towards[0]])
    outline = _outline(joint)
    middle = aim_mm(joint, view)
    reach = float(np.ptp(joint.section_mm @ across))
    for share in np.linspace(-0.55, 0.55, RAYS):
        foot = middle + share * reach * across
        hits = []
        for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            matrix = np.stack([towards, a - b], axis=1)
            if abs(np.linalg.det(matrix)) > 1e-9:
                t, u = np.linalg.solve(matrix, a - foot)
                if 0.0 <= u <= 1.0:
                    hits.append(t)
        if hits:
            start, end = foot + max(hits) * towards, foot + (max(hits) + 5.0) * towards
            axes.plot(*np.array([start, end]).T, color=colour, lw=0.7)


def _along_picture(made: ScanPlan) -> bytes:
    from matplotlib.figure import Figure

    with pieces.styled():
        figure = Figure(figsize=(9, 3.6), layout="constrained")
        rows = (
            (COVERAGE * made.root.u, made.promised_root_mm, made.wanted.root_mm, "U root, mm"),
            (COVERAGE * made.bevel.u, made.promised_bevel_deg, made.wanted.bevel_deg, "U bevel, °"),
        )
        for axes, (predicted, promised, most, name) in zip(figure.subplots(2, 1, sharex=True), rows, strict=True):
            axes.fill_between(made.arc_length_mm, predicted, promised, color=pieces.BLUE, alpha=0.2, lw=0)
            axes.plot(made.arc_length_mm, predicted, color=pieces.BLUE, lw=1.4)
            axes.axhline(most, color=pieces.PURPLE, lw=0.9, ls=(0, (6, 3)))
            axes.set_ylim(0, 1.15 * max(most, float(np.fmax.reduce(promised, initial=0.0))))
            axes.set_ylabel(name)
        axes.set_xlabel("along the lower edge, mm")
        return pieces.svg(figure)
