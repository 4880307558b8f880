"""Pictures of the posture optimiser: its map (Fig. 17a), and what comes along the path."""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.api import DEG, AnyArray, Cell, pieces
from workbench.plugins.stiffness.feasible import CAUSES, COLLISION
from workbench.plugins.stiffness.law_postures import Found

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
    with pieces.styled():
        figure = Figure(figsize=(10, 4.6 + 1.2 * len(kept)), layout="constrained")
        top, below, *others = figure.subplots(2 + len(kept), 1, sharex=True, height_ratios=(2, 1, *[1] * len(kept)))
        for name, case in found.cases.items():
            if case is not None and not (name == "best" and found.mode == "constant"):
                top.plot(case.displacement_mm, lw=1, label=name)
        top.plot(found.displacement_mm, color=pieces.INK, lw=1.4, label="as chosen")
        top.plot(found.bound_at, found.bound_mm, color=pieces.INK, ls=":", lw=1, label="best of each single point")
        top.set_ylabel("displacement,\nmm")
        top.set_ylim(0, top.get_ylim()[1])
        top.legend(ncols=5, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        for angle, name in ((made.cutter_rotation, "cutter rotation"), (made.turntable, "turntable")):
            below.plot(_from_start(angle[loaded]), lw=1, label=name)
        below.set_ylabel("from its\nstart, °")
        below.set_ylim(min(-1.0, below.get_ylim()[0]), max(1.0, below.get_ylim()[1]))  # a constant angle is a line
        below.legend(ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        for axes, (name, values, limit) in zip(others, kept, strict=True):
            axes.plot(values, lw=1.1)
            axes.axhline(limit, color=pieces.PURPLE, lw=0.9, ls=(0, (6, 3)), label="required")
            axes.set_ylim(0, 1.08 * max(float(np.nanmax(values)), limit))
            axes.set_ylabel(name)
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        (others or [below])[-1].set_xlabel("points that cut, in the order of motion")
        figure.align_ylabels()
        return pieces.svg(figure)


def _from_start(angle: AnyArray) -> AnyArray:
    return np.asarray((np.unwrap(angle) - angle[0]) / DEG)
