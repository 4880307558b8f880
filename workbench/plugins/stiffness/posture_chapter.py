"""Postures as a chapter of the report: the map with the choice on it, the robot before and after (Fig. 17)."""

from __future__ import annotations

import base64
import html

import numpy as np

from workbench.api import DEG, Cell, Chapter
from workbench.plugins.stiffness.feasible import CAUSES, COLLISION
from workbench.plugins.stiffness.posture_pictures import along_picture, map_picture, surface_picture
from workbench.plugins.stiffness.robot_picture import robot_picture
from workbench.plugins.stiffness.standing import Case, Found


def posture_chapter(cell: Cell, found: Found) -> Chapter:
    """Map, comparison, robot before and after, displacement along the path."""
    made = found.postures
    summary = (
        f"Postures for {len(found.points.layer)} points: mean displacement {found.displacement_mm.mean():.4f} mm, "
        f"{found.gap:.1%} above what the best posture of every single point would give; clearance from "
        f"{np.nanmin(made.clearance_mm, initial=np.inf):.0f} mm"
    )
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in made.warnings)
    text = (
        f"<p>{html.escape(_how(found))}</p>{f'<ul>{notes}</ul>' if notes else ''}"
        f"{_table(found)}{_causes(found)}<h3>Mean displacement over both angles</h3>"
        f"{_picture('svg+xml', map_picture(found), 'Map of the mean displacement, with the chosen postures')}"
        f"{_picture('png', surface_picture(found), 'The same as a surface') if len(found.map.tables) > 1 else ''}"
        f"<h3>The robot at the middle of the path</h3>{_robots(cell, found)}"
        f"<h3>Displacement along the path</h3>"
        f"{_picture('svg+xml', along_picture(found), 'Displacement and angles along the path')}"
    )
    return Chapter("Postures", text, summary=summary, warnings=made.warnings)


def _how(found: Found) -> str:
    choice, over = found.choice, found.map
    line = (
        f"Of {over.mean_mm.size} pairs of cutter rotation and turntable angle, {choice.rotation / DEG:g} and "
        f"{choice.table / DEG:g} deg give the least mean displacement; every better pair was examined and ruled out."
    )
    if found.mode == "along_path":
        gap = found.law_gap or 0.0
        line += " A law along the path was found by dynamic programming on the whole grid, in one configuration: "
        line += "proven the best of all." if gap < 1e-6 else f"at most {gap:.2%} above the best of them."
    return line


def _table(found: Found) -> str:
    """The choice beside what it is compared with."""
    rows = "".join(_row(name, case) for name, case in found.cases.items())
    solved = found.map.without_collision_mm
    at = np.unravel_index(np.nanargmin(solved), solved.shape)
    rows += (
        f"<tr><td>best, without the collision check</td><td>{found.map.rotations[at[0]] / DEG:g}</td>"
        f"<td>{found.map.tables[at[1]] / DEG:g}</td><td>{solved[at]:.4f}</td><td></td><td></td></tr>"
    )
    if found.mode == "along_path":
        made = found.postures
        spans = (f"{np.ptp(a) / DEG:.0f} deg span" for a in (made.cutter_rotation, made.turntable))
        rows += (
            f"<tr><td>law along the path</td>{''.join(f'<td>{s}</td>' for s in spans)}"
            f"<td>{found.displacement_mm.mean():.4f}</td><td>{found.displacement_mm.max():.4f}</td><td></td></tr>"
        )
    return (
        "<table><tr><th></th><th>cutter rotation, deg</th><th>turntable, deg</th><th>mean displacement, mm</th>"
        f"<th>largest, mm</th><th></th></tr>{rows}</table>"
    )


def _row(name: str, case: Case | None) -> str:
    if case is None:
        return f"<tr><td>{name}</td><td colspan=5>out of the robot's reach or limits</td></tr>"
    said = f"in collision: {case.pair[0]} with {case.pair[1]}" if case.pair else ""
    d = case.displacement_mm
    return (
        f"<tr><td>{name}</td><td>{case.rotation / DEG:g}</td><td>{case.table / DEG:g}</td><td>{d.mean():.4f}</td>"
        f"<td>{d.max():.4f}</td><td>{html.escape(said)}</td></tr>"
    )


def _causes(found: Found) -> str:
    """Why the rest of the map is infeasible."""
    cause, pair = found.map.cause, found.map.pair
    parts = [f"{CAUSES[c]} {np.mean(cause == c):.1%}" for c in (3, 2, 1, COLLISION) if (cause == c).any()]
    pairs = [f"{a} with {b} {np.mean(pair == i):.1%}" for i, (a, b) in enumerate(found.map.pairs)]
    if not parts:
        return "<p>The whole map is feasible.</p>"
    return f"<p>Infeasible: {html.escape(', '.join(parts + pairs))} of the map.</p>"


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
    text = ""
    for name, joints, table, _ in views:
        path = (found.points.turned(cell, np.array([table])) @ found.points.base_from_point)[found.points.cutting]
        png = robot_picture(cell, joints, table, path[:, :3, 3], middle, 3600.0)
        text += _picture("png", png, f"The robot {name}", width="48%")
    return f"<p>{text}</p><p>{'Left: as planned. Right: as chosen.' if len(views) == 2 else 'As chosen.'}</p>"


def _picture(kind: str, content: bytes, alt: str, width: str = "100%") -> str:
    data = base64.b64encode(content).decode()
    return f'<img alt="{html.escape(alt)}" style="max-width:{width}" src="data:image/{kind};base64,{data}">'
