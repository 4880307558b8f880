"""The maps of dexterity and K_c as a chapter of the report."""

from __future__ import annotations

import numpy as np

from workbench.api import DEG, Chapter, Float, pieces
from workbench.plugins.stiffness.values import StiffnessMaps


def maps_chapter(maps: StiffnessMaps) -> Chapter:
    """Three contour maps with the marked postures, and the verdict on K_c."""
    fields = (
        ("1/ω, 1/m³ (log₁₀)", np.log10(maps.inverse_dexterity)),
        ("f_p, worst direction", maps.fp),
        ("f_r, worst direction, rad", maps.fr),
    )
    rows = [
        (f"{i}", ", ".join(f"{v:.1f}" for v in q / DEG), f"{w:.3f}", f"{fp:.4f}", f"{fr:.2e}")
        for i, (q, (w, fp, fr)) in enumerate(zip(maps.marked, maps.marked_values, strict=True), 1)
    ]
    text = (
        pieces.paragraph(f"{maps.verdict}.")
        + pieces.figure_html(
            _picture(maps, fields),
            f"Maps of 1/ω, f_p and f_r over axes {maps.axes[0]} and {maps.axes[1]}",
            "Circles: the marked postures.",
        )
        + (pieces.table_html(("Posture", "Joints, °", "1/ω, 1/m³", "f_p", "f_r, rad"), rows) if rows else "")
    )
    return Chapter("Stiffness over the workspace", text, summary=maps.verdict)


def _picture(maps: StiffnessMaps, fields: tuple[tuple[str, Float], ...]) -> bytes:
    """The maps side by side, as SVG; the same bytes each time."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import ScalarFormatter

    with pieces.styled():
        figure = Figure(figsize=(10, 3.4), layout="constrained")
        for axes, (title, values) in zip(figure.subplots(1, 3), fields, strict=True):
            shown = np.where(np.isfinite(values), values, np.nan)
            high = float(np.nanpercentile(shown, 98))
            drawn = axes.contourf(
                maps.at[0] / DEG, maps.at[1] / DEG, np.minimum(shown, high).T, levels=14, cmap="viridis"
            )
            shade = figure.colorbar(drawn, ax=axes)
            if abs(high) < 1e-3:
                shade.formatter = ScalarFormatter(useMathText=True)
                shade.formatter.set_powerlimits((0, 0))
            a, b = maps.axes[0] - 1, maps.axes[1] - 1
            axes.plot(maps.marked[:, a] / DEG, maps.marked[:, b] / DEG, "o", mfc="white", mec="black", ms=5)
            for i, q in enumerate(maps.marked, 1):
                axes.annotate(
                    str(i), (q[a] / DEG, q[b] / DEG), xytext=(4, 4), textcoords="offset points", color="white"
                )
            axes.set_title(title, pad=12)
            axes.set(xlabel=f"axis {maps.axes[0]}, °", ylabel=f"axis {maps.axes[1]}, °")
        return pieces.svg(figure)
