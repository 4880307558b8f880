"""`export.inspection`: the measured values as rows, for databases and spreadsheets."""

from __future__ import annotations

import io
from typing import Any, Literal

from workbench.artefacts import Document, JointInspection, Provenance, u_name
from workbench.artefacts.edges import named
from workbench.extras import Extra
from workbench.stage import stage
from workbench.storage import csv_bytes

VERSION = 1
RECORDED = ("recording", "cloud")  # names of the input that was measured
PART = {
    "part_id": "string",
    "drawing": "string",
    "operator": "string",
    "recorded_at": "string",
    "sensor": "string",
    "sensor_serial": "string",
    "robot": "string",
    "robot_serial": "string",
    "simulated": "bool",
}


def columns(inspection: JointInspection) -> dict[str, str]:
    """Names and types, as pyarrow calls them; those of every size that such a joint may have."""
    sizes = [
        column
        for name in inspection.terms
        for column in (name, u_name(name), *(named(name, what) for what in ("nominal", "lower", "upper")))
    ]
    return {
        **PART,
        "recording": "string",
        "recording_sha256": "string",
        "section": "int32",
        **dict.fromkeys(("arc_length_mm", "x_mm", "y_mm", "z_mm", *sizes, "guard_factor"), "float64"),
        **dict.fromkeys(("verdict", "reason", "part_verdict"), "string"),
    }


@stage("export.inspection")
def inspection(
    inspection: JointInspection,
    provenance: Provenance,
    *,
    format: Literal["parquet", "csv"] = "parquet",
) -> Document:
    """Write one row per section as `inspection.parquet` or `inspection.csv`.

    In mm and degrees, `_u` for standard uncertainties, `lower` and `upper` as values. Not measured is null (empty in
    CSV). Every row names part and recording (SHA-256).

    Args:
        inspection: the measured part.
        provenance: the run's inputs.
        format: of the file.

    Example:
        >>> from workbench import cloud, edge, export, inspect, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> milled = edge.segment(points)
        >>> found = inspect.sections(milled)
        >>> from workbench.api import Provenance
        >>> source = Provenance(title="a part", pipeline={}, versions={}, seed=0, inputs=())
        >>> export.inspection(found, source).name
        'inspection.parquet'
    """
    who = {name: getattr(inspection.part, name) for name in PART}
    asked = {
        named(one.name, what): value
        for one in inspection.characteristics
        if one.required is not None and one.limits is not None
        for what, value in zip(("nominal", "lower", "upper"), (one.required[0], *one.limits), strict=True)
    }
    part = {**who, **_recording(provenance), **asked, "part_verdict": inspection.verdict}
    rows = [part | row | {"guard_factor": inspection.guard_factor} for row in inspection.rows()]
    names = columns(inspection)
    table = csv_bytes(rows, [*names]) if format == "csv" else _parquet(rows, names, f"{inspection.FORMAT}-rows")
    return Document(f"inspection.{format}", table)


def _recording(provenance: Provenance) -> dict[str, str | None]:
    """Path as given and SHA-256 of the file that was measured: the input of such a name, else the first."""
    found = sorted(provenance.inputs, key=lambda record: record[0].rpartition(".")[2] not in (*RECORDED, "file"))
    _, path, digest = found[0] if found else ("", None, None)
    return {"recording": path, "recording_sha256": digest}


def _parquet(rows: list[dict[str, Any]], names: dict[str, str], form: str) -> bytes:
    pa, parquet = Extra("pyarrow"), Extra("pyarrow.parquet")
    fields = [pa.field(name, pa.type_for_alias(kind)) for name, kind in names.items()]
    table = pa.Table.from_pylist(rows, pa.schema(fields, metadata={"format": form, "version": str(VERSION)}))
    out = io.BytesIO()
    parquet.write_table(table, out)
    return out.getvalue()
