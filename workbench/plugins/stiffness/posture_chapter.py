"""Postures as a chapter of the report: the map with the choice on it, the robot before and after (Fig. 17)."""

from __future__ import annotations

import numpy as np

from workbench.api import DEG, Cell, Chapter, pieces
from workbench.plugins.stiffness.feasible import CAUSES, COLLISION
from workbench.plugins.stiffness.law_postures import Case, Found
from workbench.plugins.stiffness.posture_pictures import along_picture, map_picture
from workbench.plugins.stiffness.robot_picture import key_of, robot_picture

CELL_MM, CLOSE_UP_MM = 3600.0, 500.0  # what the pictures of the robot show


def posture_chapter(cell: Cell, found: Found) -> Chapter:
    """Map, comparison, robot before and after, displacement along the path."""
    made = found.postures
    summary = (
        f"Postures for {len(found.points.layer)} points: mean displacement {found.displacement_mm.mean():.4f} mm, "
        f"{100 * found.gap:.1f} % above the best posture of each single point; least clearance "
        f"{np.nanmin(made.clearance_mm, initial=np.inf):.0f} mm"
    )
    text = (
        pieces.paragraph(_how(found))
        + pieces.list_html(made.warnings)
        + _table(found)
        + _causes(found)
        + pieces.heading("Mean displacement over cutter rotation and turntable angle")
        + pieces.figure_html(map_picture(found), "Map of the mean displacement, with the chosen postures")
        + pieces.heading("The robot at the middle of the path")
        + _robots(cell, found)
        + pieces.heading("Displacement and margins along the path")
        + pieces.figure_html(along_picture(cell, found), "Displacement, margins and angles along the path")
    )
    return Chapter("Postures", text, summary=summary, warnings=made.warnings)


def _how(found: Found) -> str:
    choice, over = found.choice, found.map
    line = (
        f"Of {choice.of} pairs of cutter rotation and turntable angle, {choice.rotation / DEG:g}° and "
        f"{choice.table / DEG:g}° give the least mean displacement; every better pair was examined and excluded. "
        f"The map shows {over.mean_mm.size} of them."
    )
    if found.mode == "along_path":
        gap = found.law_gap or 0.0
        line += " A law along the path was found by dynamic programming on the whole grid, in one configuration: "
        line += "proven the best of all." if gap < 1e-6 else f"at most {100 * gap:.2f} % above the best of them."
    return line


def _table(found: Found) -> str:
    """The choice beside what it is compared with."""
    rows = [_row(name, case) for name, case in found.cases.items()]
    solved = found.map.without_collision_mm
    at = np.unravel_index(np.nanargmin(solved), solved.shape)
    angles = (f"{angle / DEG:g}" for angle in (found.map.rotations[at[0]], found.map.tables[at[1]]))
    rows.append(("best, without the collision check", *angles, f"{solved[at]:.4f}", "–", ""))
    if found.mode == "along_path":
        made, moved = found.postures, found.displacement_mm
        spans = (f"span {np.ptp(a) / DEG:.0f}" for a in (made.cutter_rotation, made.turntable))
        rows.append(("law along the path", *spans, f"{moved.mean():.4f}", f"{moved.max():.4f}", ""))
    head = ("Posture", "Cutter rotation, °", "Turntable, °", "Mean displacement, mm", "Largest, mm", "Remark")
    return pieces.table_html(head, rows, text=(5,))


def _row(name: str, case: Case | None) -> tuple[str, ...]:
    if case is None:
        return name, "–", "–", "–", "–", "out of the robot's reach or limits"
    said = f"collision of {case.pair[0]} with {case.pair[1]}" if case.pair else ""
    d = case.displacement_mm
    return name, f"{case.rotation / DEG:g}", f"{case.table / DEG:g}", f"{d.mean():.4f}", f"{d.max():.4f}", said


def _causes(found: Found) -> str:
    """Why the rest of the map is infeasible."""
    cause, pair = found.map.cause, found.map.pair
    parts = [f"{CAUSES[c]} {100 * np.mean(cause == c):.1f} %" for c in (3, 2, 1, COLLISION) if (cause == c).any()]
    pairs = [f"{a} with {b} {100 * np.mean(pair == i):.1f} %" for i, (a, b) in enumerate(found.map.pairs)]
    if not parts:
        return pieces.paragraph("The whole map is feasible.")
    return pieces.paragraph(f"Infeasible share of the map: {', '.join(parts + pairs)}.")


def _robots(cell: Cell, found: Found) -> str:
    """Before and after, from the same point of view."""
    made, n = found.postures, len(found.points.layer)
    at = found.points.loaded[len(found.points.loaded) // 2]
    before = found.cases["as planned"]
    views = [] if before is None else [("as planned", before.joints[at], before.table, np.full(n, before.table))]
    views.append(("as chosen", made.joints[at], float(made.turntable[at]), made.turntable))
    middle = (
        np.array([1000.0, 0.0, 900.0])
        if cell.turntable is None
        else np.append(cell.turntable.base_from_turntable[:2, 3] / 2, 1000.0)
    )
    drawn = []
    for name, joints, table, _ in views:
        path = (found.points.turned(cell, np.array([table])) @ found.points.base_from_point)[found.points.cutting]
        way = path[:, :3, 3]
        near = (way.min(axis=0) + way.max(axis=0)) / 2
        close_up = max(CLOSE_UP_MM, 1.6 * float(np.ptp(way, axis=0).max()))
        drawn.append((robot_picture(cell, joints, table, way, middle, CELL_MM), name.capitalize()))
        drawn.append(
            (robot_picture(cell, joints, table, way, near, close_up), f"{name.capitalize()}, close to the path")
        )
    return pieces.panels_html(drawn) + pieces.key_html(key_of(cell))
