"""The stage `export.qdas`: an inspection in Q-DAS's ASCII transfer format, description (DFD) and values (DFX)."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

from workbench.artefacts import Document, Inspection
from workbench.errors import one_line
from workbench.stage import stage

FIELD, CHARACTERISTIC, END = "\x14", "\x0f", "\r\n"  # between fields of a value, between values, of a line
VALID, NOT_PROCESSED = 0, 256  # K0002
LONGEST = 80  # characters of a text
CODE_PAGE = "cp1252"


@stage("export.qdas")
def qdas(inspection: Inspection) -> tuple[Document, Document]:
    """Write `inspection.dfd` and `inspection.dfx` (Q-DAS AQDEF): root face and bevel angle of each section.

    With part, drawing and, for each characteristic, nominal value, limits, unit, gauge and, as a remark, the expanded
    uncertainty. The values are one record with the date of the recording; one that was not measured is marked as not
    processed. In mm and degrees; code page 1252, characters beyond it become question marks.

    Args:
        inspection: the judged part.

    Example:
        >>> from workbench import cloud, edge, export, inspect, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> milled = edge.segment(points)
        >>> found = inspect.sections(milled)
        >>> [file.name for file in export.qdas(found)]
        ['inspection.dfd', 'inspection.dfx']
    """
    described = [line for k, rows in enumerate(_characteristics(inspection), 1) for line in _numbered(rows, k)]
    head = [("K0100", str(2 * len(inspection.sections))), *_part(inspection)]
    lines = [f"{key} {value}" for key, value in head if value] + described
    values = CHARACTERISTIC.join(_values(inspection))
    return (
        Document("inspection.dfd", _encoded(END.join(lines) + END)),
        Document("inspection.dfx", _encoded(values + END)),
    )


def _part(inspection: Inspection) -> Iterator[tuple[str, str]]:
    part = inspection.part
    yield "K1001", _text(part.part_id or "unknown")
    yield "K1002", "milled bevel" + (", simulated" if part.simulated else "")
    yield "K1041", _text(part.drawing or "")
    yield "K1900", _text(f"ISO 14253-1, guard band {inspection.guard_factor:g} u: {inspection.verdict}")


def _characteristics(inspection: Inspection) -> Iterator[list[tuple[str, str]]]:
    """The fields of each characteristic: root face and bevel angle, section after section."""
    needs, part = inspection.requirements, inspection.part
    gauge = [("K2402", _text(part.sensor or "unknown")), ("K2401", _text(part.sensor_serial or ""))]
    for section in inspection.sections:
        for name, symbol, unit, places, nominal, (lower, upper), u in (
            ("root face", "c", "mm", 3, needs.root_nominal_mm, needs.root_tolerance_mm, section.root_u_mm),
            ("bevel angle", "beta", "deg", 2, needs.bevel_nominal_deg, needs.bevel_tolerance_deg, section.bevel_u_deg),
        ):
            k = inspection.uncertainty.coverage_factor
            told = f"U = {k * u:.{places + 1}f} {unit} (k = {k:g})" if u is not None else "not measured"
            yield [
                ("K2001", f"{symbol}-{section.index}"),
                ("K2002", f"{name}, section {section.index}"),
                ("K2004", "0"),
                ("K2022", str(places)),
                ("K2101", _number(nominal)),
                ("K2110", _number(nominal + lower)),
                ("K2111", _number(nominal + upper)),
                ("K2120", "1"),
                ("K2121", "1"),
                ("K2142", unit),
                *gauge,
                ("K2900", told),
            ]


def _numbered(fields: list[tuple[str, str]], k: int) -> Iterator[str]:
    yield from (f"{key}/{k} {value}" for key, value in fields if value)


def _values(inspection: Inspection) -> Iterator[str]:
    """Value, attribute and time of each characteristic, in the order of the description."""
    recorded = inspection.part.recorded_at
    when = datetime.fromisoformat(recorded).strftime("%d.%m.%Y/%H:%M:%S") if recorded else ""
    for section in inspection.sections:
        for value in (section.root_mm, section.bevel_deg):
            if value is None:
                yield FIELD.join(("0", str(NOT_PROCESSED), when))
            else:
                yield FIELD.join((_number(value), str(VALID), when))


def _number(value: float) -> str:
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text in ("", "-0") else text


def _text(text: str) -> str:
    return one_line(text)[:LONGEST]


def _encoded(text: str) -> bytes:
    return text.encode(CODE_PAGE, "replace")
