"""The figures as Markdown tables, for the pages and the screen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Protocol

from bench.metrology.folding import fold

INTERVAL = "95 % interval"
LEAST_ALIKE = 4  # rows, from which on a column that says the same in all of them is said once
FEW, NAMED = 4, 3  # one row in so many may differ from that, and so many in all


class Told(Protocol):
    """What a study says of a condition as a whole."""

    condition: str

    @property
    def shortcomings(self) -> list[str]: ...


def study_text(
    command: str, parts: Iterable[tuple[str, Iterable[str]]], causes: Iterable[str], summaries: Sequence[Told]
) -> str:
    """Command, tables under their headings (none where there are no rows), what was refused, what fell short."""
    lines = [f"`{command}`", ""]
    for heading, table in parts:
        rows = list(table)
        lines += [f"### {heading}", "", *rows, ""] if rows else []
    short = [words for s in summaries for words in s.shortcomings]
    return "\n".join([*lines, *causes, not_met(short, [s.condition for s in summaries])])


def not_met(short: Iterable[str], conditions: Sequence[str] = ()) -> str:
    """The goals that were not reached, each "condition: goal", in one sentence by goal."""
    missed: dict[str, list[str]] = {}
    for one in short:
        condition, _, goal = one.partition(": ")
        missed.setdefault(goal, []).append(condition)
    told = "; ".join(
        f"{goal} ({_named(where, conditions)})" if goal else ", ".join(where) for goal, where in missed.items()
    )
    return f"Not met: {told or 'nothing'}."


def _named(where: list[str], conditions: Sequence[str]) -> str:
    """These conditions, by the fewer names."""
    others = [one for one in conditions if one not in where]
    if len(conditions) < LEAST_ALIKE or len(others) >= len(where):
        return ", ".join(where)
    return f"all but {', '.join(others)}" if others else "all"


def markdown(head: list[str], rows: list[list[str]]) -> list[str]:
    """Lines of a Markdown table: intervals in brackets behind their values, below it what is alike in most rows."""
    while INTERVAL in head:
        k = head.index(INTERVAL)
        rows = [[*row[: k - 1], _with_interval(row[k - 1], row[k]), *row[k + 1 :]] for row in rows]
        head = [*head[: k - 1], f"{head[k - 1]} ({INTERVAL})", *head[k + 1 :]]
    keys = 1 if len({row[0] for row in rows}) == len(rows) else 2
    alike = {k: found for k in range(keys, len(head)) if (found := _mostly(head[k], rows, k, keys)) is not None}
    told = "; ".join(filter(None, alike.values()))
    kept = [[text for k, text in enumerate(row) if k not in alike] for row in (head, ["---"] * len(head), *rows)]
    return [f"| {' | '.join(row)} |" for row in kept] + (["", f"In all rows: {told}."] if told else [])


def _mostly(name: str, rows: list[list[str]], column: int, keys: int) -> str | None:
    """What a column says in all rows, with those few that differ; None where they are more than few."""
    [(usual, count)] = Counter(row[column] for row in rows).most_common(1) or [("", 0)]
    if len(rows) < LEAST_ALIKE or len(rows) - count > min(len(rows) / FEW, NAMED):
        return None
    others = ", ".join(f"{' '.join(row[:keys])} {row[column] or 'none'}" for row in rows if row[column] != usual)
    said = f"{name} {usual or 'none'}"
    return f"{said} (but {others})" if others else said if usual else ""


def _with_interval(value: str, interval: str) -> str:
    low, _, high = interval.partition(" to ")
    return value if low == high else f"{value} ({interval})"


def put_into(page: Path, text: str, marks: str = "tables") -> None:
    """Replace what stands between the page's marks of that name; large tables go beside the page (`fold`)."""
    begin, end = f"<!-- {marks}: begin -->", f"<!-- {marks}: end -->"
    before, _, rest = page.read_text(encoding="utf-8").partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise ValueError(f"{page} has no place for '{marks}'")
    page.write_text(f"{before}{begin}\n{fold(page, text)}\n{end}{after}", encoding="utf-8")
