"""Exported values, read back as rows."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import pyarrow as pa
from pyarrow import parquet

from workbench.artefacts import Part
from workbench.export import inspection as export_inspection


def test_parquet_holds_a_row_a_section(inspected, provenance):
    named = replace(inspected.inspection, part=Part(part_id="plate 7"))
    document = export_inspection(named, provenance)
    table = parquet.read_table(io.BytesIO(document.content))
    assert document.name == "inspection.parquet"
    assert table.schema.metadata[b"format"] == b"bevel-inspection-rows"
    assert table.schema.field("root_u_mm").type == pa.float64()
    for row, section in zip(table.to_pylist(), inspected.inspection.sections, strict=True):
        for name in ("arc_length_mm", "root_mm", "root_u_mm", "bevel_deg", "bevel_u_deg", "verdict", "reason"):
            assert row[name] == getattr(section, name)
        assert [row["x_mm"], row["y_mm"], row["z_mm"]] == section.origin_mm.tolist()
        assert (row["part_id"], row["recording"], row["recording_sha256"]) == ("plate 7", "part 7.h5", "ab12")
        assert (row["root_lower_mm"], row["root_upper_mm"], row["bevel_upper_deg"]) == (1.0, 2.0, 41.0)


def test_what_was_not_measured_is_null(inspected, provenance):
    hidden = replace(inspected.inspection.sections[0], root_mm=None, root_u_mm=None, bevel_deg=None, bevel_u_deg=None)
    inspection = replace(inspected.inspection, sections=(hidden,))
    row = parquet.read_table(io.BytesIO(export_inspection(inspection, provenance).content)).to_pylist()[0]
    assert row["root_mm"] is row["bevel_u_deg"] is row["part_id"] is None
    text = export_inspection(inspection, provenance, format="csv").content.decode()
    assert next(csv.DictReader(io.StringIO(text, newline="")))["root_mm"] == ""


def test_csv_reads_back_exactly(inspected, provenance):
    text = export_inspection(inspected.inspection, provenance, format="csv").content.decode()
    rows = list(csv.DictReader(io.StringIO(text, newline="")))
    assert [float(r["root_mm"]) for r in rows if r["root_mm"]] == [
        s.root_mm for s in inspected.inspection.sections if s.root_mm is not None
    ]
    assert {r["recording_sha256"] for r in rows} == {"ab12"}
