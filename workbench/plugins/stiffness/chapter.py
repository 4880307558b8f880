"""The identified stiffness as a chapter of the report."""

from __future__ import annotations

import numpy as np

from workbench.api import Chapter, Float, pieces
from workbench.plugins.stiffness.values import JointStiffness


def stiffness_chapter(found: JointStiffness, labels: tuple[str, ...], residual: Float, used: list[bool]) -> Chapter:
    """Stiffness with its uncertainty, and how each load fits."""
    share = 2 * found.u_nm_per_rad / found.nm_per_rad
    worst = int(np.argmax(share))
    summary = (
        f"Joint stiffness from {found.loads} loads at {found.postures} postures; the least certain is joint "
        f"{worst + 1}, U = {100 * share[worst]:.1f} % of its value (k = 2)"
    )
    rows = [
        (f"{j}", f"{k / 1e6:.4f} ± {2 * u / 1e6:.4f}", f"{100 * (2 * u / k):.1f} %")
        for j, (k, u) in enumerate(zip(found.nm_per_rad, found.u_nm_per_rad, strict=True), 1)
    ]
    text = (
        pieces.table_html(("Joint", "Stiffness ± U, 10⁶ N·m/rad", "U / value"), rows)
        + pieces.note(f"U: expanded uncertainty, U = 2 u. Condition number {found.condition_number:.1f}.")
        + pieces.list_html(found.warnings)
        + pieces.figure_html(
            _picture(labels, residual, used),
            "Residual of each load over its noise",
            "Residual of each load over its standard uncertainty; ×: left out.",
        )
    )
    return Chapter("Joint stiffness", text, summary=summary)


def _picture(labels: tuple[str, ...], residual: Float, used: list[bool]) -> bytes:
    """Residual of each load over its noise, by posture; loads left out as crosses."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(labels))
    with pieces.styled():
        figure = Figure(figsize=(10, 2.8), layout="constrained")
        axes = figure.subplots()
        at, kept = np.arange(1, len(labels) + 1), np.array(used)
        for name in names:
            here = np.array([label == name for label in labels])
            (drawn,) = axes.plot(at[here & kept], residual[here & kept], "o", ms=3, label=f"posture {name}")
            axes.plot(at[here & ~kept], residual[here & ~kept], "x", color=drawn.get_color())
        axes.axhline(1.0, color=pieces.GREY, lw=0.8)
        axes.set(xlabel="load", ylabel="residual / noise")
        axes.set_ylim(bottom=0)
        if len(names) <= 8:
            axes.legend(ncols=8, loc="lower left", bbox_to_anchor=(0.0, 1.0))
        return pieces.svg(figure)
