"""Exported rows: what stands beside the values, which test_laws.py reads back."""

from __future__ import annotations

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
