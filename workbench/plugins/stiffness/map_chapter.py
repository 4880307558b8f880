"""The maps of dexterity and K_c as a chapter of the report."""

from __future__ import annotations

import base64
import html
import io

import numpy as np

from workbench.api import DEG, Chapter, Float
from workbench.plugins.stiffness.values import StiffnessMaps


def maps_chapter(maps: StiffnessMaps) -> Chapter:
    """Three contour maps with the marked postures, and the verdict on K_c."""
    fields = (
        ("1/omega, 1/m^3 (log scale)", np.log10(maps.inverse_dexterity), maps.marked_values[:, 0]),
        ("f_p, worst direction", maps.fp, maps.marked_values[:, 1]),
        ("f_r, worst direction, rad", maps.fr, maps.marked_values[:, 2]),
    )
    rows = "".join(
        f"<tr><td>{i}</td><td>{', '.join(f'{v:.1f}' for v in q / DEG)}</td>"
        f"<td>{w:.3f}</td><td>{fp:.4f}</td><td>{fr:.2e}</td></tr>"
        for i, (q, (w, fp, fr)) in enumerate(zip(maps.marked, maps.marked_values, strict=True), 1)
    )
    table = (
        "<table><tr><th>posture</th><th>joints, deg</th><th>1/omega, 1/m<sup>3</sup></th><th>f_p</th><th>f_r, rad</th>"
        f"</tr>{rows}</table>"
        if rows
        else ""
    )
    picture = base64.b64encode(_picture(maps, fields)).decode()
    text = (
        f"<p>{html.escape(maps.verdict)}.</p>"
        f'<p><img alt="Maps of 1/omega, f_p and f_r over axes {maps.axes[0]} and {maps.axes[1]}" '
        f'style="max-width:100%" src="data:image/svg+xml;base64,{picture}"></p>{table}'
    )
    return Chapter("Stiffness: where the robot should stand", text, summary=maps.verdict)


def _picture(maps: StiffnessMaps, fields: tuple[tuple[str, Float, Float], ...]) -> bytes:
    """The maps side by side, as SVG; the same bytes each time."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context({"svg.hashsalt": "maps", "svg.fonttype": "none", "font.size": 8}):
        figure = Figure(figsize=(10.5, 3.4), layout="constrained")
        for axes, (title, values, _) in zip(figure.subplots(1, 3), fields, strict=True):
            shown = np.where(np.isfinite(values), values, np.nan)
            high = float(np.nanpercentile(shown, 98))
            drawn = axes.contourf(
                maps.at[0] / DEG, maps.at[1] / DEG, np.minimum(shown, high).T, levels=14, cmap="viridis"
            )
            figure.colorbar(drawn, ax=axes)
            a, b = maps.axes[0] - 1, maps.axes[1] - 1
            axes.plot(maps.marked[:, a] / DEG, maps.marked[:, b] / DEG, "o", mfc="white", mec="black", ms=5)
            for i, q in enumerate(maps.marked, 1):
                axes.annotate(
                    str(i), (q[a] / DEG, q[b] / DEG), xytext=(4, 4), textcoords="offset points", color="white"
                )
            axes.set_title(title)
            axes.set_xlabel(f"axis {maps.axes[0]}, deg")
            axes.set_ylabel(f"axis {maps.axes[1]}, deg")
        drawing = io.BytesIO()
        figure.savefig(drawing, format="svg", metadata={"Date": None, "Creator": None})
    return drawing.getvalue()
