"""The chapter of the report on a program: whether it is released, its least margins, what was not checked."""

from __future__ import annotations

import numpy as np

from workbench import pieces
from workbench.artefacts import Chapter, Judgement, PathGate
from workbench.dialect import place
from workbench.robot.cell import Cell
from workbench.units import DEG, Float

TOLD = 10  # violations in the report; all are in program_check.json
STRETCHES = 600  # of the charts, each with its worst place


def program_chapter(judgement: Judgement, gate: PathGate, cell: Cell) -> Chapter:
    """What came of driving the written program through its cell."""
    pair = " and ".join(judgement.clearance_pair) if judgement.clearance_pair else "nothing"
    name = f"{judgement.program.name} ({judgement.program.dialect})"
    released = "released" if judgement.passed else "not released: it was not written"
    facts = [
        ("Program", name),
        ("Release", released),
        ("Length of the way", f"{judgement.length_mm:.0f} mm in {judgement.time_s:.0f} s"),
        ("Postures examined", f"{judgement.postures}"),
        ("Least clearance, proven", f"{judgement.clearance_mm:.1f} mm ({pair})"),
        ("Least distance from a joint limit", f"{judgement.limit_margin / DEG:.2f}°"),
        ("Least wrist angle", f"{judgement.wrist / DEG:.2f}°"),
        ("Largest condition number, where examined", f"{judgement.condition:.1f}"),
        ("Largest share of a joint's speed", f"{judgement.speed_share:.3f}"),
        ("Largest deviation from the path", f"{judgement.deviation_mm:.3f} mm"),
    ]
    wrong = [place(one) for one in judgement.violations[:TOLD]]
    lists = (("Reasons against release", wrong), ("Not checked", [*gate.loosened, *gate.unchecked]))
    text = pieces.facts_html(facts) + "".join(
        pieces.heading(title) + pieces.list_html(texts) for title, texts in lists if texts
    )
    if (chart := margins_chart(judgement, cell)) is not None:
        text += pieces.heading("Margins along the way") + pieces.figure_html(
            chart,
            "Clearance, distance from joint limits, wrist angle and condition number along the way",
            "Each place shows the worst of its stretch; dashed: what the cell file requires.",
        )
    return Chapter(title="Program", html=text, summary=f"{name}: {released}")


def margins_chart(judgement: Judgement, cell: Cell) -> bytes | None:
    """SVG of what a program keeps along its way, against what it must keep; None: it was not driven."""
    from matplotlib.figure import Figure

    arc = judgement.along.get("arc_length_mm")
    if arc is None or len(arc) < 2 or not arc[-1] > 0:
        return None
    which = np.minimum((arc / float(arc[-1]) * STRETCHES).astype(int), STRETCHES - 1)
    kept, first = np.unique(which, return_index=True)

    def worst(name: str, sign: float = 1.0) -> Float:
        found = np.full(STRETCHES, np.inf)
        np.minimum.at(found, which, sign * np.nan_to_num(judgement.along[name], nan=sign * np.inf))
        return np.asarray(np.where(np.isfinite(found), sign * found, np.nan)[kept])

    margins = cell.margins
    rows = (
        ("clearance, mm", worst("clearance_mm"), cell.margin_mm),
        ("to a joint\nlimit, °", worst("limit_margin") / DEG, margins.limit / DEG),
        ("wrist\nangle, °", worst("wrist") / DEG, margins.wrist / DEG),
        ("condition\nnumber", worst("condition", -1.0), margins.condition),
    )
    shown = [row for row in rows if np.isfinite(row[1]).any()]
    with pieces.styled():
        figure = Figure(figsize=(10, 0.5 + 1.3 * len(shown)), layout="constrained")
        for axes, (name, values, limit) in zip(figure.subplots(len(shown), 1, sharex=True), shown, strict=True):
            axes.plot(arc[first], values, lw=1.1, color=pieces.BLUE)
            axes.axhline(limit, color=pieces.PURPLE, lw=0.9, ls=(0, (6, 3)))
            axes.set_ylim(0, 1.08 * max(float(np.nanmax(values)), limit))
            axes.set_ylabel(name)
            axes.set_xlim(0, float(arc[-1]))
        axes.set_xlabel("way of the tool, mm")
        figure.align_ylabels()
        return pieces.svg(figure)
