"""The HTML of the chapter on the chain's links."""

from __future__ import annotations

from collections.abc import Sequence

from workbench.report.error_chain import Link, Need
from workbench.report.template import render


def sensitivity_html(links: Sequence[Link], blind: Sequence[Need], corrected: Sequence[Need]) -> tuple[str, str]:
    """The chapter, and the loop in one line."""
    ways = [("Milled without correction", blind), ("Corrected by a measured cut", corrected)]
    tables = [
        {
            "title": f"{title}: {need.name}",
            "unit": "mm" if need.unit == "mm" else "°",
            "verdict": _verdict(need, links),
            "rows": [_row(links[k], need, k) for k in sorted(range(len(need.u)), key=lambda k: -need.u[k])],
        }
        for title, needs in ways
        for need in needs
    ]
    left = [(link.name, link.source, f"{link.left:.2f}", link.why_left) for link in links]
    root = f"root face: U = {2 * blind[0].total:.2f} mm without correction, {2 * corrected[0].total:.2f} mm with it"
    first = (
        f"largest contribution: {links[blind[0].worst].name} without, {links[corrected[0].worst].name} with correction"
    )
    return render("sensitivity.html.j2", tables=tables, left=left), f"{root}; {first}"


def _verdict(need: Need, links: Sequence[Link]) -> str:
    holds = "is within" if need.holds else "exceeds"
    said = f"U = 2 u = {2 * need.total:.3f} {need.unit} {holds} the tolerance of ± {need.half_width:g} {need.unit}"
    first, allowed = links[need.worst].name, need.allowed(need.worst)
    if need.holds:
        return f"{said}. Largest contribution: {first}."
    if allowed is None:
        return f"{said}. Largest contribution: {first}; reducing it alone is not enough."
    return f"{said}. Largest contribution: {first}; within the tolerance at u = {allowed:.3f} {need.unit}."


def _row(link: Link, need: Need, k: int) -> tuple[str, ...]:
    allowed = need.allowed(k)
    return (
        link.name,
        f"{need.u[k]:.4f}",
        f"{100 * need.share(k):.0f} %",
        f"{2 * need.without(k):.3f}",
        "–" if allowed is None else f"{allowed:.3f}",
    )
