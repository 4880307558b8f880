"""The page around the chapters: what they say in one line each, the overall verdict, provenance."""

from __future__ import annotations

from collections.abc import Sequence

from workbench.artefacts import Chapter, Provenance, Verdict
from workbench.errors import one_line
from workbench.report.tables import one_line_a_stage
from workbench.report.template import render, source

WORST_FIRST: tuple[Verdict, ...] = ("fail", "undecided", "pass")


def page(chapters: Sequence[Chapter], provenance: Provenance | None) -> str:
    """The whole page."""
    return render(
        "page.html.j2",
        style=source("page.css"),
        part=one_line(", ".join(dict.fromkeys(chapter.part for chapter in chapters if chapter.part))),
        title=provenance.title if provenance else "",
        verdict=overall(chapters),
        chapters=chapters,
        warnings=_warnings(chapters),
        provenance=provenance,
        versions=sorted(provenance.versions.items()) if provenance else [],
        pipeline=one_line_a_stage(provenance.pipeline) if provenance else "",
    )


def overall(chapters: Sequence[Chapter]) -> str:
    """The worst verdict of the chapters that decide something; '' where none does."""
    given = {chapter.verdict for chapter in chapters}
    return next((verdict for verdict in WORST_FIRST if verdict in given), "")


def _warnings(chapters: Sequence[Chapter]) -> list[str]:
    """Each once; named by chapter where there are several, since two edges may have the same to say."""
    several = len(chapters) > 1
    return list(dict.fromkeys(f"{c.title}: {text}" if several else text for c in chapters for text in c.warnings))
