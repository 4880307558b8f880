"""Postures as a chapter of the report: the map with the choice on it, the robot before and after (Fig. 17)."""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.api import DEG, AnyArray, Cell, Chapter, Toolpath, pieces
from workbench.plugins.stiffness.feasible import CAUSES, COLLISION
from workbench.plugins.stiffness.law_postures import Case, Found
from workbench.plugins.stiffness.posture_pictures import robots_html


def posture_chapter(cell: Cell, found: Found, toolpath: Toolpath) -> Chapter:
    """Map, comparison, robot before and after, displacement along the path."""
    made = found.postures
    summary = (
        f"Postures for {len(found.points.layer)} points: mean displacement {found.displacement_mm.mean():.4f} mm, "
        f"{100 * found.gap:.1f} % above the best posture of each single point; least clearance "
        f"{np.nanmin(made.clearance_mm, initial=np.inf):.0f} mm"
    )
    text = (
        pieces.paragraph(pieces.minus(_how(found)))
        + pieces.list_html(made.warnings)
        + _table(found)
        + _causes(found)
        + pieces.heading("Mean displacement over cutter rotation and turntable angle")
        + pieces.figure_html(map_picture(found), "Map of the mean displacement, with the chosen postures")
        + pieces.heading("The robot at the middle of the path")
        + robots_html(cell, found, toolpath)
        + pieces.heading("Displacement and margins along the path")
        + pieces.figure_html(along_picture(cell, found), "Displacement, margins and angles along the path")
    )
    return Chapter("Postures", text, summary=summary, part=toolpath.part, warnings=made.warnings)


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


# Pictures of the posture optimiser: its map (Fig. 17a), and what comes along the path.

SHADES = {1: "#9d4edd", 2: "#8d99ae", 3: "#2b2d42", COLLISION: "#d62828"}  # by cause


def map_picture(found: Found) -> bytes:
    """Contours of the mean displacement; what is infeasible in the colour of its cause; the choice on top (SVG)."""
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure

    over = found.map
    x, y = over.rotations / DEG, over.tables / DEG
    with pieces.styled():
        figure = Figure(figsize=(10, 5), layout="constrained")
        axes = figure.subplots()
        if len(y) > 1:
            box = (x[0], x[-1], y[0], y[-1])
            causes = np.ma.masked_equal(over.cause.T, 0)
            colours = ListedColormap([SHADES[c] for c in range(1, 5)])
            axes.imshow(
                causes,
                cmap=colours,
                vmin=1,
                vmax=4,
                extent=box,
                origin="lower",
                aspect="auto",
                alpha=0.55,
                interpolation="nearest",
            )
            drawn = axes.contourf(x, y, over.mean_mm.T, levels=16, cmap="viridis")
            figure.colorbar(drawn, ax=axes, label="mean displacement, mm")
            axes.set_ylabel("turntable, °")
        else:
            axes.plot(x, over.mean_mm[:, 0])
            axes.set_ylabel("mean displacement, mm")
        for c, colour in SHADES.items():
            if (over.cause == c).any():
                axes.plot([], [], "s", color=colour, alpha=0.55, label=CAUSES[c])
        _mark(axes, found)
        axes.set_xlabel("cutter rotation, °")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=8)
        return pieces.svg(figure)


def _mark(axes: Any, found: Found) -> None:
    """The chosen law, and the constant pairs that it is compared with."""
    made, flat = found.postures, len(found.map.tables) == 1
    loaded = found.points.loaded
    height = found.displacement_mm if flat else made.turntable[loaded] / DEG
    axes.plot(made.cutter_rotation[loaded] / DEG, height, ".", color=pieces.PURPLE, ms=4, label="chosen, at each point")
    for (name, case), mark in zip(found.cases.items(), ("D", "v", "*"), strict=True):
        if case is not None:
            at = case.displacement_mm.mean() if flat else case.table / DEG
            axes.plot(case.rotation / DEG, at, mark, mfc="white", mec="black", ms=9, label=name)


def along_picture(cell: Cell, found: Found) -> bytes:
    """Displacement of the loaded points, clearance, distance from limits and the law, in the order of motion (SVG)."""
    from matplotlib.figure import Figure

    made, loaded = found.postures, found.points.loaded
    low, high = cell.chain.limits.T
    room = np.minimum(made.joints - low, high - made.joints).min(axis=1)[loaded] / DEG
    kept = [
        ("clearance,\nmm", made.clearance_mm[loaded], cell.margin_mm),
        ("to a joint\nlimit, °", room, cell.margins.limit / DEG),
    ]
    kept = [row for row in kept if np.isfinite(row[1]).any()]
    angles = {"cutter rotation": made.cutter_rotation[loaded], "turntable": made.turntable[loaded]}
    turned = {name: _from_start(angle) for name, angle in angles.items()} if found.mode != "constant" else {}
    rows = len(kept) + bool(turned)
    with pieces.styled():
        figure = Figure(figsize=(10, 3.4 + 1.2 * rows), layout="constrained")
        top, *others = np.ravel(figure.subplots(1 + rows, 1, sharex=True, height_ratios=(2, *[1] * rows)))
        for name, case in found.cases.items():
            if case is not None and not (name == "best" and found.mode == "constant"):
                top.plot(case.displacement_mm, lw=1, label=name)
        top.plot(found.displacement_mm, color=pieces.INK, lw=1.4, label="as chosen")
        top.plot(found.bound_at, found.bound_mm, color=pieces.INK, ls=":", lw=1, label="best of each single point")
        top.set_ylabel("displacement,\nmm")
        top.set_ylim(0, top.get_ylim()[1])
        top.legend(ncols=5, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        if turned:
            for name, angle in turned.items():
                others[0].plot(angle, lw=1, label=name)
            others[0].set_ylabel("from its\nstart, °")
            others[0].set_ylim(min(-1.0, others[0].get_ylim()[0]), max(1.0, others[0].get_ylim()[1]))
            others[0].legend(ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        for axes, (name, values, limit) in zip(others[bool(turned) :], kept, strict=True):
            axes.plot(values, lw=1.1)
            axes.axhline(limit, color=pieces.PURPLE, lw=0.9, ls=(0, (6, 3)), label="required")
            axes.set_ylim(0, 1.08 * max(float(np.nanmax(values)), limit))
            axes.set_ylabel(name)
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        [top, *others][-1].set_xlabel("points that cut, in the order of motion")
        figure.align_ylabels()
        return pieces.svg(figure)


def _from_start(angle: AnyArray) -> AnyArray:
    return np.asarray((np.unwrap(angle) - angle[0]) / DEG)
