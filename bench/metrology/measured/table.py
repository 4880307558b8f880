"""The figures of the measured loop as Markdown tables."""

from __future__ import annotations

from bench.metrology.figures import told
from bench.metrology.measured.summary import BEVEL_P95_DEG, MeasuredSummary
from bench.metrology.planning.table import covered, covered_head
from bench.metrology.table import markdown, study_text
from workbench.units import Float


def measured_tables(summaries: list[MeasuredSummary], command: str) -> str:
    """All tables, and what fell short."""
    parts = [
        (
            "Blind and corrected: all places of the finished parts; median, 95th percentile, worst",
            accuracy(summaries),
        ),
        ("What the uncertainties are worth", uncertainty(summaries)),
    ]
    return study_text(command, parts, causes(summaries), summaries)


def accuracy(summaries: list[MeasuredSummary]) -> list[str]:
    head = ["condition", "parts", "finished", "beyond the allowance", "refused", "blind, abs(root - 1.5), mm"]
    head += ["corrected, abs(root - 1.5), mm", "goal (95 %)", "the robot alone (95 %)"]
    head += [
        "blind, abs(bevel - 40), deg",
        f"corrected, abs(bevel - 40), deg (goal {BEVEL_P95_DEG:g})",
        "too deep: blind, corrected",
        "s a part",
    ]
    rows = []
    for s in summaries:
        row = [s.condition, f"{s.parts}", f"{s.finished}", f"{len(s.beyond)}", f"{len(s.refused)}", three(s.blind, 3)]
        row += [three(s.corrected, 3), f"{s.goal_mm:g}", f"{s.floor_mm:.3f}", three(s.blind_bevel, 3)]
        rows.append([*row, three(s.bevel, 3), f"{s.blind_too_deep}, {len(s.too_deep)}", f"{s.seconds:.1f}"])
    return markdown(head, rows)


def uncertainty(summaries: list[MeasuredSummary]) -> list[str]:
    head = ["condition"]
    for name, unit in (
        ("finished, along b", "mm"),
        ("finished, bevel", "deg"),
        ("inspected root", "mm"),
        ("inspected root, edge declared sharp", "mm"),
        ("inspected bevel", "deg"),
    ):
        head += covered_head(name, unit)
    rows = [
        [
            s.condition,
            *covered(s.predicted, 3),
            *covered(s.predicted_turn, 3),
            *covered(s.root_cover, 4),
            *covered(s.sharp_cover, 4),
            *covered(s.bevel_cover, 3),
        ]
        for s in summaries
    ]
    return markdown(head, rows)


def causes(summaries: list[MeasuredSummary]) -> list[str]:
    """Every part that was refused or crashed, with the cause; those beyond the allowance are only counted."""
    found = [
        (s.condition, word, cause, r)
        for s in summaries
        for word, cause, r in (
            *(("refused", r.refused, r) for r in s.refused),
            *(("**crashed**", r.crashed, r) for r in s.crashed),
        )
    ]
    return told(found)


def three(values: Float, digits: int) -> str:
    return ", ".join(f"{v:.{digits}f}" for v in values)
