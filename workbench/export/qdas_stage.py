"""The stage `export.qdas`: an inspection in Q-DAS's ASCII transfer format, description (DFD) and values (DFX)."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

from workbench.artefacts import Characteristic, Document, JointInspection
from workbench.errors import one_line
from workbench.stage import stage

FIELD, CHARACTERISTIC, END = "\x14", "\x0f", "\r\n"  # between fields of a value, between values, of a line
VALID, NOT_PROCESSED = 0, 256  # K0002
LONGEST = 80  # characters of a text
CODE_PAGE = "cp1252"


@stage("export.qdas")
def qdas(inspection: JointInspection) -> tuple[Document, Document]:
    """Write `inspection.dfd` and `inspection.dfx` (Q-DAS AQDEF): every size of the joint in each section.

    Nominal value, limits, unit, gauge and, as a remark, the expanded uncertainty; one record of values with the
    recording's date. In mm and degrees; code page 1252.

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
    head = [("K0100", str(len(inspection.characteristics) * len(inspection.sections))), *_part(inspection)]
    lines = [f"{key} {value}" for key, value in head if value] + described
    values = CHARACTERISTIC.join(_values(inspection))
    return (
        Document("inspection.dfd", _encoded(END.join(lines) + END)),
        Document("inspection.dfx", _encoded(values + END)),
    )


def _part(inspection: JointInspection) -> Iterator[tuple[str, str]]:
    part = inspection.part
    yield "K1001", _text(part.part_id or "unknown")
    yield "K1002", inspection.WHAT + (", simulated" if part.simulated else "")
    yield "K1041", _text(part.drawing or "")
    yield "K1900", _text(f"ISO 14253-1, guard band {inspection.guard_factor:g} u: {inspection.verdict}")


def _characteristics(inspection: JointInspection) -> Iterator[list[tuple[str, str]]]:
    """The fields of each characteristic, section after section."""
    part, k = inspection.part, inspection.uncertainty.coverage_factor
    gauge = [("K2402", _text(part.sensor or "unknown")), ("K2401", _text(part.sensor_serial or ""))]
    for section, one, pair in _cells(inspection):
        places, unit = (2 if one.is_angle else 3), one.quantity.unit
        asked: list[tuple[str, str]] = []
        if one.required is not None and one.limits is not None:
            asked = [
                ("K2101", _number(one.required[0])),
                ("K2110", _number(one.limits[0])),
                ("K2111", _number(one.limits[1])),
                ("K2120", "1"),
                ("K2121", "1"),
            ]
        yield [
            ("K2001", f"{one.symbol}-{section}"),
            ("K2002", f"{one.term.lower()}, section {section}"),
            ("K2004", "0"),
            ("K2022", str(places)),
            *asked,
            ("K2142", unit),
            *gauge,
            ("K2900", f"U = {k * pair[1]:.{places + 1}f} {unit} (k = {k:g})" if pair else "not measured"),
        ]


def _cells(inspection: JointInspection) -> Iterator[tuple[int, Characteristic, tuple[float, float] | None]]:
    """Section, characteristic and what was measured, section after section."""
    found = [(one, one.pairs) for one in inspection.characteristics]
    for i, section in enumerate(inspection.sections):
        yield from ((section.index, one, pairs[i]) for one, pairs in found)


def _numbered(fields: list[tuple[str, str]], k: int) -> Iterator[str]:
    yield from (f"{key}/{k} {value}" for key, value in fields if value)


def _values(inspection: JointInspection) -> Iterator[str]:
    """Value, attribute and time of each characteristic, in the order of the description."""
    recorded = inspection.part.recorded_at
    when = datetime.fromisoformat(recorded).strftime("%d.%m.%Y/%H:%M:%S") if recorded else ""
    for _, _, pair in _cells(inspection):
        value = (_number(pair[0]), str(VALID)) if pair else ("0", str(NOT_PROCESSED))
        yield FIELD.join((*value, when))


def _number(value: float) -> str:
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text in ("", "-0") else text


def _text(text: str) -> str:
    return one_line(text)[:LONGEST]


def _encoded(text: str) -> bytes:
    return text.encode(CODE_PAGE, "replace")
