"""The stage `export.qif`: an inspection as QIF 3.0 results (ISO 23952)."""

from __future__ import annotations

import hashlib
import itertools
import uuid
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from workbench.artefacts import Characteristic, Document, JointInspection, Part, Provenance, u_name
from workbench.errors import one_line
from workbench.stage import stage
from workbench.strict_json import content_digest
from workbench.units import DEG

NAMESPACE = "http://qifstandards.org/xsd/qif3"
STANDARD = {
    "Designator": "9692-1",
    "Year": "2013",
    "Title": "Types of joint preparation",
}
STATUS = {"pass": "PASS", "fail": "FAIL", "undecided": "UNKNOWN"}  # of the part
STATUS_OF_ONE = {
    "pass": "PASS",
    "fail": "FAIL",
    "undecided": "INDETERMINATE",
    "hidden": "NOT_ANALYZED",
    "nothing required": "UNDEFINED",
}


QIF_KINDS = {"root_radius_mm": "Radius", "depth_mm": "Depth"}  # others: a width or an angle


def kind_of(one: Characteristic) -> str:
    """QIF's name for it."""
    return QIF_KINDS.get(one.name, "Angle" if one.is_angle else "Width")


@stage("export.qif")
def qif(inspection: JointInspection, provenance: Provenance | None = None) -> Document:
    """Write `inspection.qif`: QIF 3.0 results, every size of the joint in each section, in mm and degrees.

    Limits, nominal value, measured value with combined standard uncertainty, status (undecided: INDETERMINATE, hidden:
    NOT_ANALYZED, nothing required: UNDEFINED), instruments, traceability; budget, decision rule and inputs as
    attributes.

    Args:
        inspection: the judged part.
        provenance: the run's inputs and pipeline; without it the file names none.

    Example:
        >>> from workbench import cloud, edge, export, inspect, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> milled = edge.segment(points)
        >>> found = inspect.sections(milled)
        >>> export.qif(found).name
        'inspection.qif'
    """
    root = _document(inspection, provenance)
    indent(root)
    return Document("inspection.qif", b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, "utf-8") + b"\n")


def _document(inspection: JointInspection, provenance: Provenance | None) -> Element:
    """The QIFDocument, its children in the order of the schema."""
    ids = itertools.count(1)
    root = Element("QIFDocument", {"xmlns": NAMESPACE, "versionQIF": "3.0.0"})
    _text(root, "QPId", _unique(inspection, provenance, "document"))
    header = SubElement(root, "Header")
    application = SubElement(header, "Application")
    version = provenance.versions.get("workbench", "") if provenance else ""
    _text(application, "Name", f"workbench {version}".strip())
    _text(header, "Description", one_line(provenance.title) if provenance else f"inspection of a {inspection.WHAT}")
    _text(header, "Scope", "Results")
    standard = _standard(root, ids)
    _units(root)
    devices = _devices(root, inspection.part, ids)
    _product(root, inspection.part, ids)
    found = inspection.characteristics
    holder = SubElement(root, "Characteristics")
    _text(holder, "FormalStandardId", str(standard))
    items = _characteristics(holder, found, devices, inspection, ids)
    _results(root, inspection, provenance, found, items, devices, ids)
    root.set("idMax", str(next(ids) - 1))
    return root


def _standard(root: Element, ids: Iterator[int]) -> int:
    """The standard whose terms the characteristics are: its id."""
    made = next(ids)
    standard = SubElement(SubElement(root, "StandardsDefinitions", n="1"), "Standard", id=str(made))
    _text(SubElement(standard, "Organization"), "StandardsOrganizationEnum", "ISO")
    for name, text in STANDARD.items():
        _text(standard, name, text)
    return made


def _units(root: Element) -> None:
    primary = SubElement(SubElement(root, "FileUnits"), "PrimaryUnits")
    for kind, si, name, factor in (("Angular", "radian", "degree", DEG), ("Linear", "meter", "mm", 0.001)):
        unit = SubElement(primary, f"{kind}Unit")
        _text(unit, "SIUnitName", si)
        _text(unit, "UnitName", name)
        _text(SubElement(unit, "UnitConversion"), "Factor", _decimal(factor))


def _devices(root: Element, part: Part, ids: Iterator[int]) -> list[int]:
    """The sensor and the robot that carried it, each with what is known of its calibration."""
    listed = SubElement(SubElement(root, "MeasurementResources"), "MeasurementDevices", n="2")
    made = []
    for name, what, serial, facts in (
        (
            part.sensor or "unknown",
            "laser profile sensor",
            part.sensor_serial,
            {"calibrated at": part.sensor_calibrated_at},
        ),
        (
            part.robot or "unknown",
            "robot that carries the sensor",
            part.robot_serial,
            {"hand-eye calibration": part.hand_eye, "hand-eye calibrated at": part.hand_eye_calibrated_at},
        ),
    ):
        made.append(next(ids))
        device = SubElement(listed, "MeasurementDevice", id=str(made[-1]))
        _text(device, "Name", name)
        _text(device, "Description", what)
        if serial:
            _text(device, "SerialNumber", serial)
        _attributes(device, {key: text or "unknown" for key, text in facts.items()})
    return made


def _product(root: Element, part: Part, ids: Iterator[int]) -> None:
    """The part by its drawing."""
    made = SubElement(SubElement(SubElement(root, "Product"), "PartSet", n="1"), "Part", id=str(next(ids)))
    _text(made, "ModelNumber", part.drawing or "unknown")


def _characteristics(
    holder: Element,
    found: tuple[Characteristic, ...],
    devices: list[int],
    inspection: JointInspection,
    ids: Iterator[int],
) -> list[list[int]]:
    """Definitions, nominals and items; the ids of the items, a list a characteristic."""
    definitions = SubElement(holder, "CharacteristicDefinitions", n=str(len(found)))
    nominals = SubElement(holder, "CharacteristicNominals", n=str(len(found)))
    items = SubElement(holder, "CharacteristicItems", n=str(len(found) * len(inspection.sections)))
    made: list[list[int]] = []
    for one in found:
        definition, nominal = next(ids), next(ids)
        kind, term = kind_of(one), one.term.lower()
        element = SubElement(definitions, f"{kind}CharacteristicDefinition", id=str(definition))
        _text(element, "Name", term)
        if one.required is None:
            _text(element, "NonTolerance", "MEASURED")
        else:
            limits = SubElement(element, "Tolerance")
            _text(limits, "MaxValue", _decimal(one.required[1][1]))
            _text(limits, "MinValue", _decimal(one.required[1][0]))
            _text(limits, "DefinedAsLimit", "false")
        element = SubElement(nominals, f"{kind}CharacteristicNominal", id=str(nominal))
        _text(element, "CharacteristicDefinitionId", str(definition))
        _text(element, "Name", term)
        if one.required is not None:
            _text(element, "TargetValue", _decimal(one.required[0]))
        made.append([])
        for section in inspection.sections:
            made[-1].append(next(ids))
            element = SubElement(items, f"{kind}CharacteristicItem", id=str(made[-1][-1]))
            place = " ".join(_decimal(float(x)) for x in section.origin_mm)
            _attributes(element, {"arc length mm": _decimal(section.arc_length_mm), "origin in the base mm": place})
            _text(element, "Name", f"{term} {one.symbol}, section {section.index}")
            designator = SubElement(element, "CharacteristicDesignator")
            _text(designator, "Designator", f"{one.symbol}-{section.index}")
            _ids(element, "MeasurementDeviceIds", devices)
            _text(element, "CharacteristicNominalId", str(nominal))
    return made


def _results(
    root: Element,
    inspection: JointInspection,
    provenance: Provenance | None,
    found: tuple[Characteristic, ...],
    items: list[list[int]],
    devices: list[int],
    ids: Iterator[int],
) -> None:
    results = SubElement(root, "Results")
    component, part = next(ids), inspection.part
    made = SubElement(SubElement(results, "MeasurementResultsSet", n="1"), "MeasurementResults", id=str(next(ids)))
    _attributes(made, dict(_context(inspection, provenance)))
    _traceability(made, part, provenance)
    _text(made, "ThisResultsInstanceQPId", _unique(inspection, provenance, "results"))
    measured = SubElement(
        SubElement(made, "MeasuredCharacteristics"), "CharacteristicMeasurements", n=str(sum(map(len, items)))
    )
    for one, mine in zip(found, items, strict=True):
        for item, pair, verdict in zip(mine, one.pairs, one.verdicts, strict=True):
            element = SubElement(measured, f"{kind_of(one)}CharacteristicMeasurement", id=str(next(ids)))
            status = SubElement(element, "Status")
            _text(element, "CharacteristicItemId", str(item))
            _text(element, "ActualComponentId", str(component))
            _ids(element, "MeasurementDeviceIds", devices)
            told = "hidden" if pair is None else verdict or "nothing required"
            _text(status, "CharacteristicStatusEnum", STATUS_OF_ONE[told])
            if pair is not None:
                _text(element, "Value", _decimal(pair[0])).set("combinedUncertainty", _decimal(pair[1]))
    _text(SubElement(made, "InspectionStatus"), "InspectionStatusEnum", STATUS[inspection.verdict])
    _ids(made, "ActualComponentIds", [component])
    whole = SubElement(SubElement(results, "ActualComponentSets", n="1"), "ActualComponentSet", n="1")
    actual = SubElement(whole, "ActualComponent", id=str(component))
    if part.part_id:
        _text(actual, "SerialNumber", part.part_id)
    _text(SubElement(actual, "Status"), "InspectionStatusEnum", STATUS[inspection.verdict])


def _traceability(parent: Element, part: Part, provenance: Provenance | None) -> None:
    """When, by whom and by which procedure it was measured; unknown is said, but for the start, which must be a time.

    QIF's own InspectionProgram must name an author and a formal standard, which nobody states here: the procedure is
    an attribute.
    """
    trace = SubElement(parent, "InspectionTraceability")
    if part.recorded_at:
        _text(trace, "InspectionStart", date_time(part.recorded_at))
    _text(SubElement(trace, "InspectionOperator"), "Name", part.operator or "unknown")
    told = {"measurement procedure": "unknown"}
    if provenance:
        digest = content_digest(_procedure(provenance))
        told = {"measurement procedure": provenance.title or "pipeline", "measurement procedure SHA-256": digest}
    _attributes(trace, told | ({} if part.recorded_at else {"inspection start": "unknown"}))


def _procedure(provenance: Provenance) -> dict[str, Any]:
    """The pipeline, its inputs put in, without what differs from part to part: files that were read, and `part`."""
    files = {path for _, path, _ in provenance.inputs}
    stages = [
        {name: value for name, value in stage.items() if name != "part" and str(value) not in files}
        for stage in provenance.pipeline.get("stages", ())
    ]
    return {name: value for name, value in provenance.pipeline.items() if name != "inputs"} | {"stages": stages}


def _context(inspection: JointInspection, provenance: Provenance | None) -> Iterator[tuple[str, str]]:
    """What the results rest on."""
    yield "decision rule", f"ISO 14253-1, guard band {inspection.guard_factor:g} u"
    yield "reason", inspection.reason
    yield "simulated", {None: "unknown", True: "true", False: "false"}[inspection.part.simulated]
    yield "coverage factor of expanded uncertainties", f"{inspection.uncertainty.coverage_factor:g}"
    units = [(u_name(one.name), one) for one in inspection.characteristics]
    for k, source in enumerate(inspection.sources, 1):
        shares = [
            f"u({one.symbol}) {source.get(name, 0.0):.6f} {'degree' if one.is_angle else 'mm'}" for name, one in units
        ]
        yield f"uncertainty source {k}", "; ".join([source["name"], f"type {source['kind']}", *shares])
    for k, one in enumerate(inspection.uncertainty.not_included, 1):
        yield f"not included in the uncertainty {k}", one.told
    for name, path, digest in provenance.inputs if provenance else ():
        yield f"input {name}", f"{path}; SHA-256 {digest}"


def date_time(text: str) -> str:
    """An ISO 8601 date or time as xs:dateTime, in UTC where its zone is known.

    >>> date_time("2026-03-31T14:05+02:00"), date_time("2026-03-31")
    ('2026-03-31T12:05:00Z', '2026-03-31T00:00:00')
    """
    moment = datetime.fromisoformat(text).replace(microsecond=0)
    if moment.tzinfo is None:
        return moment.isoformat()
    return moment.astimezone(UTC).replace(tzinfo=None).isoformat() + "Z"


def _unique(inspection: JointInspection, provenance: Provenance | None, role: str) -> str:
    """A UUID that depends on what was measured alone."""
    known = hashlib.sha256(role.encode())
    for one in inspection.characteristics:
        known.update(repr((one.name, one.pairs, one.required)).encode())
    known.update(repr(inspection.part).encode())
    known.update(repr(provenance.inputs if provenance else ()).encode())
    return str(uuid.UUID(bytes=known.digest()[:16], version=4))


def _attributes(parent: Element, values: dict[str, str]) -> None:
    holder = SubElement(parent, "Attributes", n=str(len(values)))
    for name, value in values.items():
        SubElement(holder, "AttributeStr", name=name, value=_plain(value))


def _ids(parent: Element, name: str, values: list[int]) -> None:
    holder = SubElement(parent, name, n=str(len(values)))
    for value in values:
        _text(holder, "Id", str(value))


def _text(parent: Element, name: str, text: str) -> Element:
    made = SubElement(parent, name)
    made.text = _plain(text)
    return made


def _plain(text: str) -> str:
    """Text that XML 1.0 can hold, on one line."""
    return "".join(c for c in one_line(text) if c.isprintable())


def _decimal(value: float) -> str:
    """An xs:decimal, which knows no exponent, with the digits that a float64 has."""
    text = f"{value:.12f}".rstrip("0").rstrip(".")
    return "0" if text in ("", "-0") else text
