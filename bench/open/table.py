"""Cards of rivals as one table, best first, and as pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.harness import ROOT
from bench.tables import markdown, shortened
from workbench.score.page import picture
from workbench.score.scorer import scale

HEAD = ("track", "method", "score", "refused", "coverage, %", "beyond 4u, %", "worst error/u")
HEAD += ("sharpness, U/T", "by value", "s")
SHOWN = ("track", "method", "score", "refused", "coverage, %", "beyond 4u, %", "sharpness, U/T")  # on the page


def table(cards: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """A row a track and method. Coverage and what lies beyond 4u over all values, sharpness the median's mean."""
    return "\n".join(markdown(HEAD, (row(one) for some in cards.values() for one in some)))


def row(card: Mapping[str, Any]) -> list[str]:
    """Of one method in one track."""
    known = {name: one for name, one in card["quantities"].items() if one["values"]}
    values = sum(one["values"] for one in known.values())

    def mean(key: str) -> str:
        return f"{100.0 * sum(one[key] * one['values'] for one in known.values()) / values:.1f}" if values else ""

    refused = max((one["refused"] for one in card["quantities"].values()), default=0)
    worst = max((one["worst_error_over_u"] for one in known.values()), default=float("nan"))
    sharp = [one["sharpness"] / scale(name)[1] for name, one in known.items()]
    by = ", ".join(f"`{name}` {one['score']:.3f}" for name, one in card["quantities"].items())
    cells = [
        card["track"],
        card["method"],
        f"{card['score']:.3f}",
        f"{refused} of {card['recordings']}",
        mean("coverage"),
    ]
    cells += [mean("beyond_4u"), f"{worst:.1f}" if known else "", f"{sum(sharp) / len(sharp):.2f}" if sharp else "", by]
    seconds = card["seconds_median"]
    return [*cells, "" if seconds is None else f"{seconds:.2f}"]


def summary(page: Path, text: str) -> str:
    """Without the results of earlier commits."""
    return shortened(page, text, "Methods", SHOWN, lambda row: "of commit" not in row[1])


def pictured(cards: Mapping[str, Sequence[Mapping[str, Any]]]) -> None:
    """A picture a track, beside the page."""
    for track, some in cards.items():
        (ROOT / "docs" / "pictures" / f"benchmark_{track}.svg").write_bytes(picture(some))
