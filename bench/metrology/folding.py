"""Large tables of a page: the page has the extremes, a CSV beside it all rows."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path

FOLDER = "tables"  # beside the page
NAMED = 6  # words of a heading in the name of its table
LARGEST = 64  # cells of a command's first table that stays
LATER = 30  # of those after it
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
THOUSANDS = re.compile(r",(?=\d)")
NUMBERS = re.compile(r"[-+\d., ]+|\d+ of \d+")
INTERVAL = re.compile(r" \((?:95 % interval|[-\d.]+ to [-\d.]+)\)")
ASIDE = re.compile(r" \(.*\)| ±.*|\*\*")  # intervals, uncertainties, what is bold
HEAD = 2  # lines of a table above its rows
ALL = "all"  # the row of all together
Rows = list[list[str]]


def fold(page: Path, text: str) -> str:
    """`text` as the page has it: tables of more cells than `LARGEST` or `LATER` go beside `page` as CSV."""
    largest, kept, heading = LARGEST, [], ""
    for block in _blocks(text.split("\n")):
        line = block[0]
        largest = LARGEST if line.startswith("`python ") else largest
        heading = line.removeprefix("### ") if line.startswith("### ") else heading
        if not line.startswith("|"):
            kept += block
            continue
        head, rows = _split(_cells(block[0]), [_cells(row) for row in block[HEAD:]])
        found = [] if len(head) * len(rows) <= largest else extremes(head, rows)
        kept += [*found, "", f"[All rows]({written(page, heading, head, rows)})."] if found else block
        largest = LATER
    return "\n".join(kept)


def extremes(head: list[str], rows: Rows) -> list[str]:
    """A table of the smallest and the largest value of each column of numbers with its row; empty where there is none.

    Of several numbers in a cell (median, 95th percentile, worst; mean and RMS error) the last one decides. Intervals
    are left to the CSV. A last row named `all` has a column of its own.
    """
    keys = 1 if len({row[0] for row in rows}) == len(rows) else 2
    whole = rows[-1] if rows[-1][0] == ALL else None
    lines = ["| | smallest | largest |" + f" {ALL} |" * bool(whole), "| --- | --- | --- |" + " --- |" * bool(whole)]
    for k, name in enumerate(head[keys:], keys):
        known = [(value, row) for row in rows if row is not whole and (value := _value(row[k]))]
        if not known:
            continue
        ends = (min(known, key=lambda one: one[0])[1], max(known, key=lambda one: one[0])[1])
        told = [f"{row[k]} ({', '.join(row[:keys])})" for row in ends] + ([whole[k]] if whole else [])
        lines.append(f"| {' | '.join(INTERVAL.sub('', one) for one in (name, *told))} |")
    return lines if len(lines) > HEAD else []


def _split(head: list[str], rows: Rows) -> tuple[list[str], Rows]:
    """Columns of several values, "a; b", as so many columns."""
    names = [(f"{name.split(': ')[0]}: " if ": " in name else "", name.split(": ")[-1].split("; ")) for name in head]
    wide = [f"{start}{name}" for start, parts in names for name in parts]
    cells = [
        [one for cell, (_, parts) in zip(row, names, strict=True) for one in _parts(cell, len(parts))] for row in rows
    ]
    return wide, cells


def _parts(cell: str, count: int) -> list[str]:
    parts = cell.split("; ") if count > 1 else [cell]
    return parts if len(parts) == count else [cell, *[""] * (count - 1)]


def _value(cell: str) -> tuple[float, ...]:
    """Sizes of its numbers, the last one first; empty where it has none."""
    plain = THOUSANDS.sub("", ASIDE.sub("", cell))
    found = NUMBER.findall(plain) if NUMBERS.fullmatch(plain) else []
    return tuple(abs(float(one)) for one in reversed(found))


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
    words = re.findall(r"\w+", re.split(r"[:,;(]", heading.lower())[0])
    name = f"{page.stem}_{'_'.join(words[:NAMED])}.csv"
    (page.parent / FOLDER).mkdir(exist_ok=True)
    (page.parent / FOLDER / name).write_text(out.getvalue(), encoding="utf-8")
    return f"{FOLDER}/{name}"
