"""The chapter of the report on a program: whether it is released, its least margins, what was not checked."""

from __future__ import annotations

from workbench import pieces
from workbench.artefacts import Chapter, Judgement, PathGate
from workbench.dialect import place
from workbench.units import DEG

TOLD = 10  # violations in the report; all are in program_check.json


def program_chapter(judgement: Judgement, gate: PathGate) -> Chapter:
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
        ("Largest condition number", f"{judgement.condition:.1f}"),
        ("Largest share of a joint's speed", f"{judgement.speed_share:.3f}"),
        ("Largest deviation from the path", f"{judgement.deviation_mm:.3f} mm"),
    ]
    wrong = [place(one) for one in judgement.violations[:TOLD]]
    lists = (("Reasons against release", wrong), ("Not checked", [*gate.loosened, *gate.unchecked]))
    text = pieces.facts_html(facts) + "".join(
        pieces.heading(title) + pieces.list_html(texts) for title, texts in lists if texts
    )
    return Chapter(title="Program", html=text, summary=f"{name}: {released}")
