"""The identified stiffness as a chapter of the report."""

from __future__ import annotations

import base64
import html
import io

import numpy as np

from workbench.api import Chapter, Float
from workbench.plugins.stiffness.values import JointStiffness


def stiffness_chapter(found: JointStiffness, labels: tuple[str, ...], residual: Float, used: list[bool]) -> Chapter:
    """Stiffness with its uncertainty, and how each load fits."""
    worst = int(np.argmax(found.u_nm_per_rad / found.nm_per_rad))
    share = found.u_nm_per_rad / found.nm_per_rad
    summary = (
        f"Joint stiffness from {found.loads} loads at {found.postures} postures; the least certain is joint "
        f"{worst + 1}, known to {2 * share[worst]:.1%} (95 %)"
    )
    rows = "".join(
        f"<tr><td>{j}</td><td>{k / 1e6:.4f} &plusmn; {2 * u / 1e6:.4f}</td><td>{2 * u / k:.1%}</td></tr>"
        for j, (k, u) in enumerate(zip(found.nm_per_rad, found.u_nm_per_rad, strict=True), 1)
    )
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in found.warnings)
    picture = base64.b64encode(_picture(labels, residual, used)).decode()
    text = (
        "<table><tr><th>joint</th><th>stiffness, 10<sup>6</sup> Nm/rad</th><th>U / value</th></tr>"
        f"{rows}</table><p>&plusmn; U: expanded uncertainty, U = 2u. Condition number {found.condition_number:.1f}.</p>"
        f"{f'<ul>{notes}</ul>' if notes else ''}"
        f'<p><img alt="Residual of each load over its noise" style="max-width:100%" '
        f'src="data:image/svg+xml;base64,{picture}"></p>'
    )
    return Chapter("Joint stiffness", text, summary=summary)


def _picture(labels: tuple[str, ...], residual: Float, used: list[bool]) -> bytes:
    """Residual of each load over its noise, by posture; loads left out as crosses."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(labels))
    with rc_context({"svg.hashsalt": "loads", "font.size": 8}):
        figure = Figure(figsize=(7.5, 2.4), layout="constrained")
        axes = figure.subplots()
        at, kept = np.arange(1, len(labels) + 1), np.array(used)
        for name in names:
            here = np.array([label == name for label in labels])
            (drawn,) = axes.plot(at[here & kept], residual[here & kept], "o", ms=3, label=f"posture {name}")
            axes.plot(at[here & ~kept], residual[here & ~kept], "x", color=drawn.get_color())
        axes.axhline(1.0, color="0.6", lw=0.8)
        axes.set_xlabel("load")
        axes.set_ylabel("residual / noise")
        axes.set_ylim(bottom=0)
        if len(names) <= 8:
            axes.legend(frameon=False, ncols=4)
        drawing = io.BytesIO()
        figure.savefig(drawing, format="svg", metadata={"Date": None, "Creator": None})
    return drawing.getvalue()
