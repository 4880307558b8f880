"""`workbench look`: the summary as text, and the view as one page."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.edge.groove_rows import COLUMNS
from workbench.errors import InputError, OutputError, one_line
from workbench.look.read import seen
from workbench.look.seen import Seen
from workbench.look.tell import told


def look(
    file: str | Path,
    out: str | Path | None = None,
    mapping: str | Path | None = None,
    corners: str | Path | None = None,
) -> tuple[str, ...]:
    """What a file holds, as lines; and as a page in `out` if that is named.

    Args:
        file: a recording, a cloud, or anything that `workbench import` reads.
        out: the page to write, `.html`, complete in itself.
        mapping: MAP.json, where the file does not explain itself.
        corners: a table to write, `.csv`: the corners of a groove in every row of ranges.

    Raises:
        InputError: the file cannot be read.
        OutputError: the page cannot be written.
    """
    found = seen(Path(file), None if mapping is None else Path(mapping))
    if out is not None:
        write_page(found, Path(out))
    if corners is not None:
        write_corners(found, Path(corners))
    return summary(found)


def write_corners(found: Seen, target: Path) -> None:
    """Row, then column and range of each corner, as the file counts them; empty where a row shows no groove."""
    if found.corners is None:
        raise InputError(found.source, "expected rows of ranges across a groove, for --corners")
    if target.suffix.lower() != ".csv":
        raise InputError(str(target), "expected the name of a table to write, ending in .csv")
    names = [f"{name}_{what}" for what in ("column", "range") for name in COLUMNS]
    table = np.concatenate([found.corners.column, found.corners.z], axis=1)
    lines = [",".join(["row", *names])]
    for number, row in enumerate(table):
        lines.append(",".join([str(number), *("" if np.isnan(v) else f"{v:.2f}" for v in row)]))
    _written(target, "\r\n".join([*lines, ""]).encode())


def summary(found: Seen) -> tuple[str, ...]:
    """The file in lines: what it is, what is in it, what the checks say, what to try."""
    lines = [f"{found.source}: {found.kind}, shown in {found.frame}", *found.lines]
    if found.checks:
        bad = sum(not check.passed for check in found.checks)
        lines += [f"checks: {len(found.checks) - bad} passed, {bad} failed", *told(found.checks)]
    if found.suggestions:
        lines += ["conventions that would make this consistent:", *(f"  {one}" for one in found.suggestions)]
    return tuple(one_line(line) for line in [*lines, *(f"note: {hint}" for hint in found.hints)])


def write_page(found: Seen, target: Path) -> None:
    """The page, whole or not at all."""
    from workbench.look.page import page

    if target.suffix.lower() not in (".html", ".htm"):
        raise InputError(str(target), "expected the name of a page to write, ending in .html")
    _written(target, page(found).encode())


def _written(target: Path, content: bytes) -> None:
    """Whole or not at all."""
    part = target.with_name(f".{target.name}.part")
    try:
        part.write_bytes(content)
        part.replace(target)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise OutputError(str(target), f"cannot be written: {error.strerror}") from None
