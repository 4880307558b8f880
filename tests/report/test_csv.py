"""The sections as CSV: every value back as it was, nothing where nothing was measured."""

from __future__ import annotations

import csv as comma_separated
import dataclasses
import io

import pytest

from workbench.errors import one_line
from workbench.report import csv


def test_values_come_back(part):
    inspection = part(frames=20, columns=20).inspection
    awkward = dataclasses.replace(inspection.sections[0], reason='a "quoted", reason\nof two lines')
    document = csv(dataclasses.replace(inspection, sections=(awkward, *inspection.sections[1:])))
    rows = list(comma_separated.DictReader(io.StringIO(document.content.decode(), newline="")))
    assert document.name == "sections.csv"
    assert len(rows) == 9
    for row, section in zip(rows, (awkward, *inspection.sections[1:]), strict=True):
        reason = one_line(section.reason)
        assert (int(row["section"]), row["verdict"], row["reason"]) == (section.index, section.verdict, reason)
        assert float(row["x_mm"]) == pytest.approx(section.origin_mm[0], abs=1e-6)
        for name in ("root_mm", "root_u_mm", "bevel_deg", "bevel_u_deg"):
            value = getattr(section, name)
            assert row[name] == "" if value is None else float(row[name]) == pytest.approx(value, abs=1e-6)
    assert rows[4]["root_mm"] == ""
