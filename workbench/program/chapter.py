"""The chapter of the report on a program: whether it may run, how near it came to anything, what nobody looked at."""

from __future__ import annotations

from html import escape

from workbench.artefacts import Chapter, Judgement, PathGate
from workbench.dialect import NOT_CHECKED, place
from workbench.units import DEG

TOLD = 10  # violations in the report; all are in program_check.json


def program_chapter(judgement: Judgement, gate: PathGate) -> Chapter:
    """What came of driving the written program through its cell."""
    pair = " and ".join(judgement.clearance_pair) if judgement.clearance_pair else "nothing"
    rows = [
        ("program", f"{judgement.program.name} ({judgement.program.dialect})"),
        ("may run", "yes" if judgement.passed else "no: it was not written"),
        (
            "way, time",
            f"{judgement.length_mm:.0f} mm, {judgement.time_s:.0f} s, looked at in {judgement.postures} postures",
        ),
        ("least clearance, proven", f"{judgement.clearance_mm:.1f} mm ({pair})"),
        ("least distance from a limit", f"{judgement.limit_margin / DEG:.2f} deg"),
        ("least angle of the wrist", f"{judgement.wrist / DEG:.2f} deg"),
        ("largest condition number", f"{judgement.condition:.1f}"),
        ("largest share of a joint's speed", f"{judgement.speed_share:.3f}"),
        ("largest deviation from the path", f"{judgement.deviation_mm:.3f} mm"),
    ]
    table = "".join(f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in rows)
    wrong = [place(one) for one in judgement.violations[:TOLD]]
    open_ = [*gate.loosened, *(f"{NOT_CHECKED}{text}" for text in gate.unchecked)]
    lists = "".join(
        f"<h3>{title}</h3><ul>{''.join(f'<li>{escape(text)}</li>' for text in texts)}</ul>"
        for title, texts in (("Why it may not run", wrong), ("What nobody looked at", open_))
        if texts
    )
    return Chapter(title="Program", html=f"<table>{table}</table>{lists}", summary=rows[1][1])
