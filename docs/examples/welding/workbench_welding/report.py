"""`weld.report`: the groove as a chapter of the report, and as a table for other programs."""

from __future__ import annotations

import base64
import io
from html import escape
from typing import Annotated, Any

from pydantic import Field

from workbench.api import Chapter, Document, stage
from workbench_welding.groove import Groove, GrooveSection

STYLE: Any = {
    "svg.hashsalt": "workbench-welding",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
}  # the same data give the same bytes
HEAD = ("Section", "Arc length, mm", "Area ± U, mm²", "Weld metal, g/mm", "Verdict")


@stage("weld.report")
def report(
    groove: Groove,
    *,
    density_g_cm3: Annotated[float, Field(gt=0, le=25, description="of the weld metal, in g/cm³")] = 7.85,
) -> tuple[Chapter, Document]:
    """Tell the groove: area a section, weld metal along the edge; and `weld_groove.csv`, one row per section.

    Areas in mm2 and their standard uncertainties, empty where the edge is hidden. In the chapter U = 2u.
    """
    gram = density_g_cm3 / 1000  # of a mm3
    facts = [
        ("Joint", f"{('single bevel', 'single-V')[groove.joint.bevelled_plates - 1]} groove"),
        ("Plate, gap", f"{groove.joint.thickness_mm:g} mm, {groove.joint.gap_mm:g} mm"),
        ("Area, nominal", f"{groove.nominal_mm2:.1f} mm² ({' to '.join(f'{one:.1f}' for one in groove.limits_mm2)})"),
        ("Volume", f"{groove.volume_mm3:.0f} ± {2 * groove.volume_u_mm3:.0f} mm³ over {groove.measured_mm:.1f} mm"),
        ("Weld metal", f"{gram * groove.volume_mm3:.1f} ± {2 * gram * groove.volume_u_mm3:.1f} g, without excess"),
    ]
    html = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in facts)
    html = f'<dl class="facts">{html}</dl>{_table(groove.sections, gram)}<h3>Along the edge</h3>{_figure(groove)}'
    return Chapter("Weld groove", html, groove.verdict, groove.reason), Document("weld_groove.csv", _csv(groove))


def _table(sections: tuple[GrooveSection, ...], gram: float) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in HEAD)
    body = ""
    for s in sections:
        area = mass = "–"
        if s.area_mm2 is not None and s.area_u_mm2 is not None:
            area, mass = f"{s.area_mm2:.1f} ± {2 * s.area_u_mm2:.1f}", f"{gram * s.area_mm2:.3f}"
        body += (
            f"<tr><th>{s.index}</th><td>{s.arc_length_mm:.1f}</td><td>{area}</td>"
            f'<td>{mass}</td><td class="{s.verdict}">{s.verdict}</td></tr>'
        )
    return f'<table class="results"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'


def _csv(groove: Groove) -> bytes:
    rows = ["section,arc_length_mm,area_mm2,area_u_mm2,verdict"]
    for s in groove.sections:
        values = ["" if value is None else f"{value:.4f}" for value in (s.area_mm2, s.area_u_mm2)]
        rows.append(f"{s.index},{s.arc_length_mm:.4f},{','.join(values)},{s.verdict}")
    return "\r\n".join([*rows, ""]).encode("ascii")


def _figure(groove: Groove) -> str:
    from matplotlib import rc_context  # costs time to import: only where a report is made
    from matplotlib.figure import Figure

    s, area, u = groove.arc_length_mm, groove.area_mm2, groove.area_u_mm2
    out = io.BytesIO()
    with rc_context(STYLE):
        figure = Figure(figsize=(8.0, 2.6), layout="constrained")
        axes = figure.add_subplot()
        axes.axhspan(*groove.limits_mm2, color="#009e73", alpha=0.12, linewidth=0, label="tolerance")
        axes.fill_between(s, area - 2 * u, area + 2 * u, color="#0072b2", alpha=0.3, linewidth=0, label="± U")
        axes.plot(s, area, color="#0072b2", label="groove area")
        axes.set(xlabel="arc length of the lower edge, mm", ylabel="area, mm²")
        axes.legend(loc="upper right", ncols=3, frameon=False)
        axes.margins(y=0.25)
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    address = f"data:image/svg+xml;base64,{base64.b64encode(out.getvalue()).decode()}"
    return (
        f'<figure><img src="{address}" alt="Area of the groove over arc length, with its tolerance"/>'
        "<figcaption>Line: area between the plates; blue band: ± U, thickness and gap included.</figcaption>"
        "</figure>"
    )
