"""Q-DAS AQDEF: what stands beside the values (which test_laws.py reads back)."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.export.test_laws import parse
from workbench.artefacts import Part, u_name
from workbench.export import qdas


@pytest.fixture
def named(inspected):
    part = Part(
        part_id="A-7\x14\x0f\r\nK9999 x",
        drawing="D 1/B é",
        sensor="LPS 36",
        sensor_serial="12",
        recorded_at="2026-03-31T14:05",
        simulated=True,
    )
    return replace(inspected.inspection, part=part)


def test_what_is_written_is_read(named):
    dfd, dfx = qdas(named)
    assert (dfd.name, dfx.name) == ("inspection.dfd", "inspection.dfx")
    part, rows, (record,) = parse(dfd.content, dfx.content)
    assert part["K1041"] == "D 1/B é"
    assert "K9999" not in part
    cells = [(one, size) for one in named.sections for size in (("root_mm", "mm"), ("bevel_deg", "deg"))]
    for (section, (name, unit)), fields, (_, attribute, when) in zip(cells, rows, record, strict=True):
        value, places = section.values[name], int(fields["K2022"])
        assert (fields["K2142"], fields["K2402"], fields["K2401"]) == (unit, "LPS 36", "12")
        assert when == "31.03.2026/14:05:00"
        assert int(attribute) == (256 if value is None else 0)
        u = 2 * (section.values[u_name(name)] or 0.0)
        assert fields["K2900"] == ("not measured" if value is None else f"U = {u:.{places + 1}f} {unit} (k = 2)")
