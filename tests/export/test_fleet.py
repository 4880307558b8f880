"""A fleet takes the records of every joint."""

from __future__ import annotations

import io

import pyarrow.parquet as pq
import pytest

from tests.export.test_laws import JOINTS, named
from workbench.batch.fleet import characteristics, fleet_files
from workbench.batch.part import Record


@pytest.mark.parametrize("what", JOINTS)
def test_a_fleet_takes_every_joint(what: str) -> None:
    inspection = JOINTS[what]("pass")
    sections = tuple({"index": one.index, **one.values, "verdict": one.verdict} for one in inspection.sections)
    needs = inspection.requirements_in_file
    fleet = [Record(f"p{k}", "r.h5", "passed", verdict="pass", requirements=needs, sections=sections) for k in range(4)]
    assert [one.name for one in characteristics(fleet)] == [one.term.lower() for one in inspection.characteristics]
    files = fleet_files(fleet, "Fleet")
    table = pq.read_table(io.BytesIO(files["fleet.parquet"])).to_pydict()
    for one in inspection.characteristics:
        assert table[one.name] == [pair and pair[0] for pair in one.pairs] * 4
        assert table[named(one.name, "upper")] == [pytest.approx(one.limits[1])] * 12  # type: ignore[index]
        assert one.term.lower() in files["fleet.html"].decode()
