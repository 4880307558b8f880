"""Lines of text to columns of numbers: quickly when all is well, slowly to name what is wrong."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from typing import Any, NoReturn

from workbench.errors import InputError
from workbench.importing.mapping_tables import TextPart
from workbench.importing.text import decoded, is_number
from workbench.units import Float

EMPTY = ["", "nan", "NaN", "NAN"]


def parsed(
    body: bytes, part: TextPart, places: Mapping[str, int], count: int, where: str, skipped: int
) -> dict[str, Float]:
    """Columns of numbers (role -> values) out of lines of text, by pyarrow's reader.

    Args:
        body: whole lines of a table, the first of them after line `skipped` of the file.
        part: delimiter and decimal mark.
        places: role -> column, from 0.
        count: cells a row.
        where: the file, for messages.
        skipped: lines of the file before `body`.

    Raises:
        InputError: a row of another length, a cell that is no number, with the line.
    """
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    names = [str(i) for i in range(count)]
    used = sorted(set(places.values()))
    try:
        table = arrow_csv.read_csv(
            pa.BufferReader(body),
            read_options=arrow_csv.ReadOptions(column_names=names, block_size=2**24, use_threads=False),
            parse_options=arrow_csv.ParseOptions(delimiter=part.delimiter),
            convert_options=arrow_csv.ConvertOptions(
                column_types={str(i): pa.float64() for i in used},
                include_columns=[str(i) for i in used],
                null_values=EMPTY,
                decimal_point=part.decimal,
            ),
        )
    except (pa.ArrowException, ValueError) as error:
        _refuse(body, part, used, count, where, skipped, error)
    return {role: table.column(str(at)).to_numpy() for role, at in places.items()}


def _refuse(body: bytes, part: TextPart, used: list[int], count: int, where: str, skipped: int, error: Any) -> NoReturn:
    """The first row that is wrong, looked for slowly."""
    for number, line in enumerate(decoded(body).split("\n"), skipped + 1):
        if not line.strip():
            continue
        row = next(csv.reader(io.StringIO(line), delimiter=part.delimiter), [])
        if len(row) != count:
            raise InputError(f"{where}: line {number}", f"expected {count} cells, found {len(row)}")
        for i in used:
            text = row[i].strip()
            if text not in EMPTY and not _reads(text, part.decimal):
                shown = repr(text if len(text) <= 30 else text[:27] + "...")
                raise InputError(
                    f"{where}: line {number}, cell {i + 1}",
                    f"expected a number with decimal mark '{part.decimal}', found {shown}",
                )
    raise InputError(where, f"expected a table of numbers: {str(error)[:120]}")


def _reads(text: str, decimal: str) -> bool:
    return (
        is_number(text.replace(",", ".")) if decimal == "," and "." not in text else decimal == "." and is_number(text)
    )
