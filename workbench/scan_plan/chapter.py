"""The chapter of the report on a planned scan."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from workbench import pieces, plot
from workbench.artefacts import Chapter, Gate
from workbench.scan_plan.information import MOST_INCIDENCE, Joint, View
from workbench.scan_plan.plan_stage import ScanPlan
from workbench.scan_plan.rehearsal import WAVE_MM
from workbench.scan_plan.way import aim_mm
from workbench.units import COVERAGE, DEG

BEHIND_MM = 6.0  # of the plate, in the drawing
RAYS = 11  # drawn of the laser's


def plan_chapter(made: ScanPlan, gate: Gate) -> Chapter:
    """Passes, predicted U along the edge and by source, what binds and what would help."""
    turntable = "none" if made.scan_cell else "not looked at: nothing is placed in a cell"
    facts = [
        ("Edge", f"{made.edge.length_mm:.0f} mm, by {Path(made.edge.source).name}"),
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
        "frame pitch, mm",
        "of the edge seen, %",
    )
    text = pieces.facts_html(facts) + pieces.table_html(head, rows)
    sections = [(_section_picture(made, one.view), _section_words(k, one.view)) for k, one in enumerate(made.passes, 1)]
    text += pieces.panels_html(sections, pairs=True)
    text += pieces.figure_html(
        _along_picture(made),
        "Predicted U along the edge",
        "U = 2 u along the edge. Promised: nine of ten places stay within it, with a rounding that few edges exceed "
        f"and a root face in waves of {WAVE_MM:g} mm.",
        ((pieces.BLUE, "predicted"), (pieces.SKY, "up to what is promised"), (pieces.PURPLE, "wanted")),
    )
    worst = int(np.nanargmax(made.root.u)) if np.isfinite(made.root.u).any() else 0
    sources = [
        (
            name,
            f"{made.root.u_by_source[name][worst]:.4f}",
            f"{made.bevel.u_by_source[name][worst]:.4f}" if name in made.bevel.u_by_source else "–",
        )
        for name, u in made.root.u_by_source.items()
        if u[worst] > 0.0
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


def _section_words(number: int, view: View) -> str:
    lead = f", led by {view.lead / DEG:.0f}°" if view.lead else ""
    return (
        f"Pass {number}: the laser's rays in the section, {view.elevation / DEG:.0f}° above the normal of the root "
        f"face (dash-dotted){lead}. Coloured: faces that it measures; dotted: those that it does not"
    )


def _section_picture(made: ScanPlan, view: View) -> bytes:
    joint = made.joint
    towards = np.array([math.cos(view.elevation), math.sin(view.elevation)])
    across = np.array([-towards[1], towards[0]])
    reach = float(np.ptp(joint.section_mm @ across))
    front = 0.5 * (float(np.ptp(joint.section_mm @ towards)) + reach)
    figure = plot.Figure((4.4, 3.1))
    (axes,) = figure.subplots()
    axes.fill(*np.array([one[0] for one in _faces(joint)]).T, facecolor=pieces.PALE)
    feet = aim_mm(joint, view) + np.linspace(-0.6, 0.6, RAYS)[:, None] * reach * across
    for start in feet + front * towards:
        end, lit = _met(joint, start, towards)
        axes.plot(*np.array([start, end]).T, color=pieces.BLUE if lit else pieces.PALE, linewidth=0.7)
    laser = feet[[0, -1]] + front * towards
    axes.plot(*laser.T, linewidth=3.0)
    label_at = laser.mean(axis=0) + 0.1 * reach * towards
    axes.annotate(f"scanner,\n{view.standoff_mm:.0f} mm away", label_at, va="center")
    axes.plot([0.0, reach], [0.5 * joint.root_mm] * 2, color=pieces.GREY, linewidth=0.8, dashes=(6.0, 2.0, 1.0, 2.0))
    for a, b, normal, name in _faces(joint):
        if name:
            lit = _is_lit(normal, towards)
            look: Any = {"color": pieces.BLUE} if lit else {"dashes": (1.0, 2.0)}
            axes.plot(*np.array([a, b]).T, linewidth=2.2, **look)
            if normal[0] > 0.5:
                axes.annotate(name, 0.6 * a + 0.4 * b - 0.07 * reach * normal, ha="right", va="center")
            else:  # at the far end of a surface, where no other name is
                axes.annotate(name, (min(a[0], b[0]), a[1]), (4.0, -7.0 * normal[1]), va="center")
    low, high = axes.get_xlim()
    axes.set(xlim=(low, max(high, label_at[0] + (high - low) / 3.0)))  # with room for the words
    axes.set(xticks=plot.nice_ticks(axes.get_xlim(), 6))
    axes.set(aspect="equal", xlabel="out of the root face (n), mm", ylabel="up from the lower surface (m), mm")
    return figure.svg()


def _faces(joint: Joint) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, str]]:
    """The section's sides in order: ends, outward normal, name; '' where the drawing ends."""
    low, corner, top = joint.section_mm[:3]
    back = np.array([[top[0] - BEHIND_MM, joint.thickness_mm], [top[0] - BEHIND_MM, 0.0]])
    slope = np.array([math.cos(joint.bevel), math.sin(joint.bevel)])
    return [
        (low, corner, np.array([1.0, 0.0]), "root face"),
        (corner, top, slope, "bevel"),
        (top, back[0], np.array([0.0, 1.0]), "upper surface"),
        (*back, np.array([-1.0, 0.0]), ""),
        (back[1], low, np.array([0.0, -1.0]), "lower surface"),
    ]


def _is_lit(normal: np.ndarray, towards: np.ndarray) -> bool:
    """Whether a side is measured that the scanner looks at from there."""
    return bool(normal @ towards > math.cos(MOST_INCIDENCE))


def _met(joint: Joint, start: np.ndarray, towards: np.ndarray) -> tuple[np.ndarray, bool]:
    """Where a ray from the scanner meets the section first, and whether that side is measured; past it, where none."""
    far = [(2.0 * float(np.ptp(joint.section_mm @ towards)), False)]
    for a, b, normal, _ in _faces(joint):
        matrix = np.stack([-towards, a - b], axis=1)
        if abs(np.linalg.det(matrix)) > 1e-9:
            t, u = np.linalg.solve(matrix, a - start)
            if 0.0 <= u <= 1.0:
                far.append((t, _is_lit(normal, towards)))
    way, lit = min(far)
    return start - way * towards, lit


def _along_picture(made: ScanPlan) -> bytes:
    figure = plot.Figure((9.0, 3.6))
    every = figure.subplots(2, 1, sharex=True)
    rows = (
        (COVERAGE * made.root.u, made.promised_root_mm, made.wanted.root_mm, "U root, mm"),
        (COVERAGE * made.bevel.u, made.promised_bevel_deg, made.wanted.bevel_deg, "U bevel, °"),
    )
    for axes, (predicted, promised, most, name) in zip(every, rows, strict=True):
        axes.fill_between(made.arc_length_mm, predicted, promised, color=pieces.SKY)
        axes.plot(made.arc_length_mm, predicted, color=pieces.BLUE, linewidth=1.4)
        axes.axhline(most, color=pieces.PURPLE, linewidth=0.9, dashes=(6.0, 3.0))
        axes.set(ylim=(0.0, 1.15 * max(most, float(np.fmax.reduce(promised, initial=0.0)))), ylabel=name)
    every[-1].set(xlabel="along the lower edge, mm")
    return figure.svg()
