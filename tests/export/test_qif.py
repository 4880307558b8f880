"""QIF 3.0 results: valid, complete, the same every time; names out of files stay text."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from lxml import etree

from tests.export.test_laws import CASES, JOINTS, RUN
from workbench.artefacts import Part, u_name
from workbench.export import qif

OFFICIAL = Path(__file__).parents[3] / "shared" / "data" / "real" / "qif30" / "QIFDocument.xsd"
Q = {"q": "http://qifstandards.org/xsd/qif3"}
STATUS = {"undecided": "INDETERMINATE", "hidden": "NOT_ANALYZED", "nothing required": "UNDEFINED"}


@pytest.fixture(scope="module")
def schema():
    if not OFFICIAL.is_file():
        pytest.skip("the official schema of QIF 3.0 is not here: ../shared/data/real/qif30")
    return etree.XMLSchema(file=OFFICIAL)


@pytest.fixture
def named():
    part = Part(
        part_id="A-7 <b>&",
        drawing="D 1/B",
        operator="A. Smith",
        recorded_at="2026-03-31T14:05+02:00",
        sensor="LPS 36",
        sensor_serial="12",
        robot="IRB 6700",
        simulated=False,
    )
    return replace(JOINTS["bevel"]("pass"), part=part)


def read(document):
    return ElementTree.fromstring(document.content)


@pytest.mark.parametrize(("what", "kind"), CASES)
def test_every_joint_and_verdict_is_valid_by_the_official_schema(what, kind, schema):
    statuses = set()
    for document in (qif(JOINTS[what](kind), RUN), qif(JOINTS[what](kind))):
        schema.assertValid(etree.fromstring(document.content))
        statuses |= {one.text for one in read(document).iterfind(".//q:CharacteristicStatusEnum", Q)}
    assert statuses == {STATUS.get(kind, kind.upper())}


def test_names_out_of_files_are_valid_too(named, provenance, schema):
    for part in (named.part, Part()):
        schema.assertValid(etree.fromstring(qif(replace(named, part=part), provenance).content))


def test_every_reference_leads_somewhere_and_every_count_is_right(named, provenance):
    for inspection in (named, replace(named, part=Part()), *(JOINTS["bevel"](kind) for kind in ("fail", "hidden"))):
        found = read(qif(inspection, provenance))
        ids = [one.get("id") for one in found.iter() if one.get("id")]
        assert len(ids) == len(set(ids)), "an id stands twice"
        referred = [one.text for one in found.iter() if one.tag.endswith("Id") and not one.tag.endswith("QPId")]
        assert set(referred) <= set(ids)
        assert [len(one) for one in found.iter() if one.get("n")] == [
            int(one.get("n")) for one in found.iter() if one.get("n")
        ]
        standard = found.findtext("q:Characteristics/q:FormalStandardId", namespaces=Q)
        named = found.find(f"q:StandardsDefinitions/q:Standard[@id='{standard}']", Q)
        assert named.findtext("q:Organization/q:StandardsOrganizationEnum", namespaces=Q) == "ISO"
        assert named.findtext("q:Designator", namespaces=Q) == "9692-1"


def test_it_names_part_instruments_and_uncertainty(named, provenance):
    found = read(qif(named, provenance))
    assert found.findtext(".//q:ActualComponent/q:SerialNumber", namespaces=Q) == "A-7 <b>&"
    devices = found.findall(".//q:MeasurementDevice", Q)
    assert [one.findtext("q:Name", namespaces=Q) for one in devices] == ["LPS 36", "IRB 6700"]
    assert devices[0].findtext("q:SerialNumber", namespaces=Q) == "12"
    assert found.findtext(".//q:InspectionStart", namespaces=Q) == "2026-03-31T12:05:00Z"
    assert max(int(one.get("id")) for one in found.iter() if one.get("id")) == int(found.get("idMax"))


@pytest.mark.parametrize("what", JOINTS)
def test_what_results_rest_on_is_told_with_its_numbers_and_units(what):
    inspection = replace(JOINTS[what]("pass"), part=Part(simulated=False))
    found = read(qif(inspection, replace(RUN, versions={"workbench": "1.2.3"})))
    assert found.findtext(".//q:Application/q:Name", namespaces=Q) == "workbench 1.2.3"
    told = {one.get("name"): one.get("value") for one in found.findall(".//q:MeasurementResults/q:Attributes/*", Q)}
    for k, source in enumerate(inspection.sources, 1):
        name, kind, *shares = told.pop(f"uncertainty source {k}").split("; ")
        assert (name, kind) == (source["name"], f"type {source['kind']}")
        for share, one in zip(shares, inspection.characteristics, strict=True):
            symbol, value, unit = share.split()
            assert (symbol, unit) == (f"u({one.symbol})", "degree" if one.name.endswith("_deg") else "mm")
            assert float(value) == pytest.approx(source.get(u_name(one.name), 0.0), abs=1e-6)
    unseen = [one.told for one in inspection.uncertainty.not_included]
    assert [told.pop(f"not included in the uncertainty {k + 1}") for k in range(len(unseen))] == unseen
    assert told == {
        "decision rule": "ISO 14253-1, guard band 1.645 u",
        "reason": inspection.reason,
        "simulated": "false",
        "coverage factor of expanded uncertainties": "2",
        **{f"input {name}": f"{path}; SHA-256 {digest}" for name, path, digest in RUN.inputs},
    }


def test_its_traceability_is_told_or_said_to_be_unknown(named, provenance):
    def trace(document):
        found = read(document).find(".//q:InspectionTraceability", Q)
        told = {one.get("name"): one.get("value") for one in found.findall("q:Attributes/*", Q)}
        return found.findtext("q:InspectionOperator/q:Name", namespaces=Q), told

    operator, told = trace(qif(named, provenance))
    assert (operator, told["measurement procedure"]) == ("A. Smith", provenance.title)
    other = replace(provenance, pipeline={**provenance.pipeline, "seed": 8})
    assert trace(qif(named, other))[1]["measurement procedure SHA-256"] != told["measurement procedure SHA-256"]
    one, two = (
        replace(provenance, pipeline={"stages": [{"recording": n, "part": {"part_id": n}}]}, inputs=(("r", n, "0"),))
        for n in ("A7.h5", "B8.h5")
    )
    assert trace(qif(named, one)) == trace(qif(named, two)), "another part, measured alike"
    unknown = trace(qif(replace(named, part=Part())))
    assert unknown == ("unknown", {"measurement procedure": "unknown", "inspection start": "unknown"})
    assert "meanError" not in qif(named).content.decode()  # nobody has estimated it


def test_a_day_is_a_time_of_xml(named, provenance):
    dated = replace(named, part=replace(named.part, recorded_at="2026-03-31"))
    assert read(qif(dated, provenance)).findtext(".//q:InspectionStart", namespaces=Q) == "2026-03-31T00:00:00"
