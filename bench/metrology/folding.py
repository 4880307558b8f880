"""Long tables of a page: the first of a study stays, of the others the page has the extremes and a CSV all rows."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path

FOLDER = "tables"  # beside the page
LONGEST = 7  # rows of a later table that stay
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
THOUSANDS = re.compile(r",(?=\d)")
NUMBERS = re.compile(r"[-+\d., ]+|\d+ of \d+")
ASIDE = re.compile(r" \(.*\)| ±.*|\*\*")  # intervals, uncertainties, what is bold
Rows = list[list[str]]


def fold(page: Path, text: str) -> str:
    """`text` as the page has it; the tables that it leaves out are written beside `page`, by their headings."""
    first, kept, heading = True, [], ""
    for block in _blocks(text.split("\n")):
        line = block[0]
        first = first or line.startswith("`python ")  # another command: another study
        heading = line.removeprefix("### ") if line.startswith("### ") else heading
        if not line.startswith("|"):
            kept += block
            continue
        head, rows = _cells(block[0]), [_cells(row) for row in block[2:]]
        found = [] if first or len(rows) <= LONGEST else extremes(head, rows)
        kept += block if not found else [*found, "", f"[All rows]({written(page, heading, head, rows)})."]
        first = False
    return "\n".join(kept)


def extremes(head: list[str], rows: Rows) -> list[str]:
    """A table of the smallest and the largest value of each column with its row; empty where a column has no number.

    Of several numbers in a cell (median, 95th percentile, worst; mean and RMS error) the last one decides.
    """
    keys = 1 if len({row[0] for row in rows}) == len(rows) else 2
    lines = ["| | smallest | largest |", "| --- | --- | --- |"]
    for k, name in enumerate(head[keys:], keys):
        known = [(abs(value), row) for row in rows if (value := _value(row[k])) is not None]
        if not known:
            return []
        ends = (min(known, key=lambda one: one[0])[1], max(known, key=lambda one: one[0])[1])
        low, high = (f"{row[k]} ({', '.join(row[:keys])})" for row in ends)
        lines.append(f"| {name} | {low} | {high} |")
    return lines


def _value(cell: str) -> float | None:
    plain = THOUSANDS.sub("", ASIDE.sub("", cell))
    found = NUMBER.findall(plain) if NUMBERS.fullmatch(plain) else []
    return float(found[-1]) if found else None


def _blocks(lines: list[str]) -> Iterator[list[str]]:
    """Lines one by one, those of a table together."""
    table: list[str] = []
    for line in lines:
        if line.startswith("|"):
            table.append(line)
            continue
        if table:
            yield table
            table = []
        yield [line]
    if table:
        yield table


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.split("|")[1:-1]]


def written(page: Path, heading: str, head: list[str], rows: Rows) -> str:
    """Rows as CSV beside the page, called after the page and the heading: its place relative to the page."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerows([head, *([cell.replace("**", "") for cell in row] for row in rows)])
    words = re.sub(r"\W+", "_", heading.lower()).split("_")
    name = f"{page.stem}_{'_'.join(words[:4]).strip('_')}.csv"
    (page.parent / FOLDER).mkdir(exist_ok=True)
    (page.parent / FOLDER / name).write_text(out.getvalue(), encoding="utf-8")
    return f"{FOLDER}/{name}"
