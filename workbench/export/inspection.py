"""`export.inspection`: the measured values as rows, for databases and spreadsheets."""

from __future__ import annotations

import csv
import io
from typing import Any, Literal

from workbench.artefacts import Document, Inspection, Provenance, Section
from workbench.stage import stage
from workbench.storage import as_text

FORMAT, VERSION = "bevel-inspection-rows", 1
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
COLUMNS: dict[str, str] = {
    **PART,
    "recording": "string",
    "recording_sha256": "string",
    "section": "int32",
    "arc_length_mm": "float64",
    "x_mm": "float64",
    "y_mm": "float64",
    "z_mm": "float64",
    "root_mm": "float64",
    "root_u_mm": "float64",
    "root_nominal_mm": "float64",
    "root_lower_mm": "float64",
    "root_upper_mm": "float64",
    "bevel_deg": "float64",
    "bevel_u_deg": "float64",
    "bevel_nominal_deg": "float64",
    "bevel_lower_deg": "float64",
    "bevel_upper_deg": "float64",
    "guard_factor": "float64",
    "verdict": "string",
    "reason": "string",
    "part_verdict": "string",
}  # name -> type, as pyarrow calls it


@stage("export.inspection")
def inspection(
    inspection: Inspection,
    provenance: Provenance,
    *,
    format: Literal["parquet", "csv"] = "parquet",
) -> Document:
    """Write a row a section as `inspection.parquet` or `inspection.csv`, with what it was measured on and by.

    In mm and degrees, `_u` for standard uncertainties, `lower` and `upper` for the limits as values, not deviations.
    Not measured is null (empty in CSV). A row names its part, and its recording with the SHA-256 of the file, so that
    rows of many parts can stand in one table.

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
    part = {**who, **_recording(provenance), "part_verdict": inspection.verdict}
    rows = [part | _row(inspection, section) for section in inspection.sections]
    return Document(f"inspection.{format}", _parquet(rows) if format == "parquet" else _csv(rows))


def _recording(provenance: Provenance) -> dict[str, str | None]:
    """Path as given and SHA-256 of the file that was measured: the input of such a name, else the first."""
    found = sorted(provenance.inputs, key=lambda record: record[0].rpartition(".")[2] not in (*RECORDED, "file"))
    _, path, digest = found[0] if found else ("", None, None)
    return {"recording": path, "recording_sha256": digest}


def _row(inspection: Inspection, section: Section) -> dict[str, Any]:
    required = inspection.requirements
    x, y, z = section.origin_mm.tolist()
    (root_low, root_high), (bevel_low, bevel_high) = required.root_tolerance_mm, required.bevel_tolerance_deg
    return {
        "section": section.index,
        "arc_length_mm": section.arc_length_mm,
        "x_mm": x,
        "y_mm": y,
        "z_mm": z,
        "root_mm": section.root_mm,
        "root_u_mm": section.root_u_mm,
        "root_nominal_mm": required.root_nominal_mm,
        "root_lower_mm": required.root_nominal_mm + root_low,
        "root_upper_mm": required.root_nominal_mm + root_high,
        "bevel_deg": section.bevel_deg,
        "bevel_u_deg": section.bevel_u_deg,
        "bevel_nominal_deg": required.bevel_nominal_deg,
        "bevel_lower_deg": required.bevel_nominal_deg + bevel_low,
        "bevel_upper_deg": required.bevel_nominal_deg + bevel_high,
        "guard_factor": inspection.guard_factor,
        "verdict": section.verdict,
        "reason": section.reason,
    }


def _parquet(rows: list[dict[str, Any]]) -> bytes:
    import pyarrow as pa
    from pyarrow import parquet

    fields = [pa.field(name, pa.type_for_alias(kind)) for name, kind in COLUMNS.items()]
    table = pa.Table.from_pylist(rows, pa.schema(fields, metadata={"format": FORMAT, "version": str(VERSION)}))
    out = io.BytesIO()
    parquet.write_table(table, out)
    return out.getvalue()


def _csv(rows: list[dict[str, Any]]) -> bytes:
    """UTF-8, a comma between fields, lines end in CR LF (RFC 4180); numbers as they read back exactly, texts that no
    spreadsheet takes for formulas.
    """
    out = io.StringIO(newline="")
    table = csv.DictWriter(out, COLUMNS)
    table.writeheader()
    table.writerows({name: as_text(value) for name, value in row.items()} for row in rows)
    return out.getvalue().encode()
