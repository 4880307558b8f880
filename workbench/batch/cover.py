"""The first page of the fleet's report, for a customer: every part with its verdict and uncertainty on one A4 side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from workbench.batch.record import Record
from workbench.errors import one_line

COVERAGE = 2.0
MOST_PARTS = 80  # two columns of rows of 5 mm under the head
VERDICTS = ("fail", "undecided", "pass")  # least favourable first
CONFORMITY = {"pass": "conform", "fail": "do not conform", "undecided": "undecided"}
KEYS = (("root", "mm", 3), ("bevel", "deg", 2))


def cover(records: Sequence[Record]) -> dict[str, Any]:
    """What the template `cover` takes."""
    measured = [one for one in records if one.sections]
    needs = measured[0].requirements if measured else {}
    alike = all(one.requirements == needs for one in measured)
    ranked = sorted(measured, key=lambda one: VERDICTS.index(one.verdict) if one.verdict in VERDICTS else 0)
    shown = measured if len(measured) <= MOST_PARTS else ranked[:MOST_PARTS]
    drawings = {str(one.identity["drawing"]) for one in measured if one.identity.get("drawing")}
    return {
        "measured": len(measured),
        "unmeasured": [(one.part, one.outcome) for one in records if not one.sections],
        "verdicts": [
            (CONFORMITY[name], name, sum(one.verdict == name for one in measured))
            for name in ("pass", "fail", "undecided")
        ],
        "limits": [_limits(needs, key, unit) for key, unit, _ in KEYS] if needs and alike else [],
        "drawings": one_line(", ".join(sorted(drawings))) or "unknown",
        "rows": [_row(one) for one in shown],
        "not_shown": len(measured) - len(shown),
        "simulated": any(one.identity.get("simulated") for one in records),
    }


def _row(record: Record) -> dict[str, Any]:
    """One part: name, verdict, and the range of each characteristic with the largest expanded uncertainty."""
    cells = {}
    for key, unit, places in KEYS:
        rows = [one for one in record.sections if one.get(f"{key}_{unit}") is not None]
        values = [float(one[f"{key}_{unit}"]) for one in rows]
        u = max((float(one[f"{key}_u_{unit}"]) for one in rows), default=0.0)
        ends = f"{min(values):.{places}f} to {max(values):.{places}f}" if values else "–"
        cells[key] = f"{ends} ± {COVERAGE * u:.{places}f}" if values else "–"
    return {"name": one_line(record.part_id or record.part)[:40], "verdict": record.verdict or "", **cells}


def _limits(needs: Mapping[str, Any], key: str, unit: str) -> str:
    nominal, (lower, upper) = needs[f"{key}_nominal_{unit}"], needs[f"{key}_tolerance_{unit}"]
    name = "root face c" if key == "root" else "bevel angle β"
    return f"{name} {nominal + lower:g} to {nominal + upper:g}{' mm' if unit == 'mm' else '°'}"
