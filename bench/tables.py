"""Tables of every study: Markdown for screen and page, CSV beside the page where they are large."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

FOLDER = "tables"  # beside the page
NAMED = 6  # words of a heading in the name of its table
LARGEST = 300  # characters of a table that stays in the page
TABLE = re.compile(r"(?:^\|.*\n?)+", re.MULTILINE)
HEADING = re.compile(r"^#+ (.*)", re.MULTILINE)


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table."""
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]


def put_into(page: Path, text: str, marks: str = "tables") -> None:
    """Replace what stands between the page's marks of that name.

    Raises:
        ValueError: the page has no such place.
    """
    begin, end = f"<!-- {marks}: begin -->", f"<!-- {marks}: end -->"
    before, _, rest = page.read_text(encoding="utf-8").partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise ValueError(f"{page} has no place for '{marks}'")
    page.write_text(f"{before}{begin}\n{text}\n{end}{after}", encoding="utf-8")


def folded(page: Path, text: str, largest: int = LARGEST) -> str:
    """`text` for `page`: in the place of each large table that of its CSV, which is called after the heading above."""

    def kept(table: re.Match[str]) -> str:
        head, _, *rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table[0].splitlines()]
        if len(table[0]) <= largest:
            return table[0]
        return f"[All rows]({written(page, HEADING.findall(text[: table.start()])[-1], head, rows)}).\n"

    return TABLE.sub(kept, text)


def written(page: Path, heading: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Rows as CSV beside the page, called after the page and the heading: its place relative to the page."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerows([head, *([cell.replace("**", "") for cell in row] for row in rows)])
    words = re.findall(r"\w+", re.split(r"[:,;(]", heading.lower())[0])
    name = f"{page.stem}_{'_'.join(words[:NAMED])}.csv"
    (page.parent / FOLDER).mkdir(exist_ok=True)
    (page.parent / FOLDER / name).write_text(out.getvalue(), encoding="utf-8")
    return f"{FOLDER}/{name}"


def shortened(page: Path, text: str, heading: str, shown: Sequence[str], some: Callable[[list[str]], bool]) -> str:
    """`text` with some rows and the shown columns of its table; all of it as CSV beside the page, linked at the end."""
    head, _, *rows = ([cell.strip() for cell in line.split("|")[1:-1]] for line in TABLE.findall(text)[0].splitlines())
    short = markdown(shown, ([row[head.index(name)] for name in shown] for row in rows if some(row)))
    left = TABLE.sub(lambda _: "\n".join([*short, ""]), text).rstrip()
    return f"{left}\n\n[The whole table]({written(page, heading, head, rows)})."
