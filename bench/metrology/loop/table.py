"""The figures of the closed loop as Markdown tables."""

from __future__ import annotations

from bench.metrology.figures import told
from bench.metrology.loop.summary import BEVEL_GOAL_DEG, ROOT_GOAL_MM, LoopSummary
from bench.metrology.planning.table import covered, covered_head, three
from bench.metrology.table import markdown, study_text


def loop_tables(summaries: list[LoopSummary], command: str) -> str:
    """All tables, and what fell short."""
    parts = [
        (
            "Perfect mechanics: the worst section of each part; median, 95th percentile and worst of the parts",
            perfect(summaries),
        ),
        ("Hand-eye error of 0.4 mm and robot noise of 0.1 mm: inspected beside injected", injected(summaries)),
        ("Inspected less milled, beside its uncertainty", uncertainty(summaries)),
    ]
    return study_text(command, parts, causes(summaries), summaries)


def perfect(summaries: list[LoopSummary]) -> list[str]:
    """How far root face and bevel angle lie from their nominal values, as inspected and as milled."""
    head = ["condition", "parts", f"inspected root - 1.5, mm (goal {ROOT_GOAL_MM:g})"]
    head += [f"inspected bevel - 40, deg (goal {BEVEL_GOAL_DEG:g})", "milled root - 1.5, mm", "milled bevel - 40, deg"]
    head += ["sections measured", "beside what is not cut", "refused", "s a part", "met"]
    rows = []
    for s in summaries:
        if "perfect" in s.cases:
            c = s.cases["perfect"]
            row = [s.condition, f"{s.parts}", three(c.root, 4), three(c.bevel, 3), three(c.milled_root, 4)]
            row += [
                three(c.milled_bevel, 3),
                f"{c.measured} of {c.sections}",
                f"{c.left_out}",
                f"{len(s.refused)}",
                f"{s.seconds:.1f}",
            ]
            rows.append([*row, "yes" if c.root.met and c.bevel.met else "**no**"])
    return markdown(head, rows)


def injected(summaries: list[LoopSummary]) -> list[str]:
    """The hand-eye error moves the whole bevel, the robot's noise comes on top, differently at each section."""
    head = ["condition", "inspected root - 1.5, mm", "milled root - 1.5, mm"]
    head += ["its mean over the part less what the hand-eye error implies, mm", "inspected bevel - 40, deg"]
    rows = [
        [s.condition, three(c.root, 3), three(c.milled_root, 3), three(c.mean_off, 3), three(c.bevel, 2)]
        for s in summaries
        for name, c in s.cases.items()
        if name == "errors"
    ]
    return markdown(head, rows)


def uncertainty(summaries: list[LoopSummary]) -> list[str]:
    head = ["condition", "mechanics"]
    for name, unit in (("root", "mm"), ("bevel", "deg")):
        head += covered_head(name, unit)
    rows = [
        [s.condition, name, *covered(c.root_cover, 4), *covered(c.bevel_cover, 3)]
        for s in summaries
        for name, c in s.cases.items()
    ]
    return markdown(head, rows)


def causes(summaries: list[LoopSummary]) -> list[str]:
    """Every part that was refused or crashed, or of which the mill warned, with the cause."""
    return told(
        (s.condition, word, cause, r)
        for s in summaries
        for word, cause, r in (
            *(("refused", r.refused, r) for r in s.refused),
            *(("**crashed**", r.crashed, r) for r in s.crashed),
            *(("the mill warns", "; ".join(r.warnings["perfect"]), r) for r in s.warned),
        )
    )
