"""The fleet as numbers: one row a part and section, and from these the characteristics as tables of part x section."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.batch.part import OUTCOMES, Record
from workbench.errors import one_line
from workbench.units import Float, Int, Shaped

VERDICTS = ("fail", "undecided", "pass")  # worst first
PART_COLUMNS = ("part", "part_id", "recording", "outcome", "cause", "verdict", "seconds")
IDENTITY_COLUMNS = ("drawing", "operator", "recorded_at", "sensor", "sensor_serial", "robot", "robot_serial")
SECTION_COLUMNS = ("arc_length_mm", "root_mm", "root_u_mm", "bevel_deg", "bevel_u_deg")


@dataclass(frozen=True, slots=True, eq=False)
class Characteristic:
    """One measured quantity: P parts in the order given, S sections; NaN where it was not measured."""

    name: str
    unit: str
    value: Shaped[Float, "P S"]
    u: Shaped[Float, "P S"]  # standard uncertainty
    lower: float  # limits of tolerance
    upper: float

    @property
    def margin(self) -> Float:
        """(P, S) distance to the nearer limit in shares of half the tolerance: 1 in the middle, below 0 outside."""
        return np.minimum(self.value - self.lower, self.upper - self.value) / ((self.upper - self.lower) / 2)


def characteristics(records: Sequence[Record]) -> tuple[Characteristic, ...]:
    """Root face and bevel angle of all parts; none where nothing was inspected, or not all to the same requirements."""
    inspected = [record for record in records if record.sections]
    if not inspected or any(one.requirements != inspected[0].requirements for one in inspected):
        return ()
    needs = inspected[0].requirements
    return tuple(
        Characteristic(
            name,
            unit,
            _table(records, f"{key}_{suffix}"),
            _table(records, f"{key}_u_{suffix}"),
            *(needs[f"{key}_nominal_{suffix}"] + deviation for deviation in needs[f"{key}_tolerance_{suffix}"]),
        )
        for name, unit, key, suffix in (("root face", "mm", "root", "mm"), ("bevel angle", "°", "bevel", "deg"))
    )


def _table(records: Sequence[Record], key: str) -> Float:
    sections = max(one["index"] for record in records for one in record.sections)
    table = np.full((len(records), sections), math.nan)
    for i, record in enumerate(records):
        for one in record.sections:
            if one[key] is not None:
                table[i, one["index"] - 1] = one[key]
    return table


def least_margin(found: Sequence[Characteristic]) -> tuple[Float, Int]:
    """(P,) smallest margin of each part over sections and characteristics, and its section from 0; NaN and -1: none."""
    margin = np.min([np.where(np.isnan(one.margin), np.inf, one.margin) for one in found], axis=0)
    section = np.argmin(margin, axis=1)
    least = margin[np.arange(len(margin)), section]
    measured = np.isfinite(least)
    return np.where(measured, least, np.nan), np.where(measured, section, -1)


def worst_first(records: Sequence[Record]) -> list[Record]:
    """By outcome, then verdict, then the smallest margin."""
    found = characteristics(records)
    margin = least_margin(found)[0] if found else np.full(len(records), np.nan)

    def badness(i: int) -> tuple[int, int, float, int]:
        one = records[i]
        verdict = VERDICTS.index(one.verdict) if one.verdict in VERDICTS else len(VERDICTS)
        return OUTCOMES.index(one.outcome), verdict, float(np.nan_to_num(margin[i], nan=np.inf)), i

    return [records[i] for i in sorted(range(len(records)), key=badness)]


def parquet(records: Sequence[Record]) -> bytes:
    """`fleet.parquet`: one row a part and section; one row without a section for a part that has none."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = [(order, record, one) for order, record in enumerate(records, 1) for one in (record.sections or ({},))]
    columns: dict[str, Any] = {"order": pa.array([order for order, _, _ in rows], pa.int32())}
    for name in PART_COLUMNS:
        values = [getattr(record, name) for _, record, _ in rows]
        if name == "seconds":
            columns[name] = pa.array(values, pa.float64())
        else:  # a file's name need not be text that can be encoded
            columns[name] = pa.array([value and one_line(value) for value in values], pa.string())
    for name in IDENTITY_COLUMNS:
        texts = [record.identity.get(name) for _, record, _ in rows]
        columns[name] = pa.array([text and one_line(str(text)) for text in texts], pa.string())
    columns["simulated"] = pa.array([record.identity.get("simulated") for _, record, _ in rows], pa.bool_())
    for side in ("lower", "upper"):
        for key, suffix in (("root", "mm"), ("bevel", "deg")):
            limits = [_limit(record, key, suffix, side == "upper") for _, record, _ in rows]
            columns[f"{key}_{side}_{suffix}"] = pa.array(limits, pa.float64())
    columns["section"] = pa.array([one.get("index") for _, _, one in rows], pa.int32())
    for name in SECTION_COLUMNS:
        columns[name] = pa.array([one.get(name) for _, _, one in rows], pa.float64())
    columns["section_verdict"] = pa.array([one.get("verdict") for _, _, one in rows], pa.string())
    out = io.BytesIO()
    pq.write_table(pa.table(columns), out, compression="zstd")
    return out.getvalue()


def _limit(record: Record, key: str, suffix: str, upper: bool) -> float | None:
    needs = record.requirements
    return needs[f"{key}_nominal_{suffix}"] + needs[f"{key}_tolerance_{suffix}"][upper] if needs else None
