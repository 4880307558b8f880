"""Q-DAS AQDEF, read back by a parser that knows nothing of the writer: what stands beside the values (test_laws.py)."""

from __future__ import annotations

from dataclasses import replace

import pytest

from workbench.artefacts import Part
from workbench.export import qdas


def parse(dfd: bytes, dfx: bytes):
    """Fields of the part, of each characteristic, and each characteristic's (value, attribute, time) a record."""
    part: dict[str, str] = {}
    characteristics: dict[int, dict[str, str]] = {}
    for line in dfd.decode("cp1252").split("\r\n"):
        if not line:
            continue
        key, _, value = line.partition(" ")
        assert len(key.partition("/")[0]) == 5
        assert key[0] == "K"
        field, slash, number = key.partition("/")
        (characteristics.setdefault(int(number), {}) if slash else part)[field] = value
    assert int(part["K0100"]) == len(characteristics) == max(characteristics)
    records = []
    for line in filter(None, dfx.decode("cp1252").split("\r\n")):
        cells = [cell.split(chr(20)) for cell in line.split(chr(15))]
        assert len(cells) == len(characteristics)
        records.append([(float(cell[0]), int(cell[1]), cell[2]) for cell in cells])
    return part, characteristics, records


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
    part, characteristics, (record,) = parse(dfd.content, dfx.content)
    assert part["K1041"] == "D 1/B é"
    assert "K9999" not in part
    for k, section in enumerate(named.sections):
        for j, (value, unit) in enumerate(((section.root_mm, "mm"), (section.bevel_deg, "deg"))):
            fields, (_, attribute, when) = characteristics[2 * k + j + 1], record[2 * k + j]
            assert (fields["K2142"], fields["K2402"], fields["K2401"]) == (unit, "LPS 36", "12")
            assert when == "31.03.2026/14:05:00"
            assert attribute == (256 if value is None else 0)
            assert ("not measured" if value is None else "(k = 2)") in fields["K2900"]
