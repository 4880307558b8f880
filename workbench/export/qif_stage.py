"""The stage `export.qif`: an inspection as QIF 3.0 results (ISO 23952)."""

from __future__ import annotations

import hashlib
import itertools
import uuid
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from typing import Any
from xml.etree.ElementTree import fromstring, indent, tostring

from workbench.artefacts import Characteristic, Document, JointInspection, Part, Provenance, u_name
from workbench.errors import one_line
from workbench.stage import stage
from workbench.strict_json import content_digest
from workbench.templates import environment

NAMESPACE = "http://qifstandards.org/xsd/qif3"
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

    Limits, nominal and measured value, combined standard uncertainty, status (undecided: INDETERMINATE, hidden:
    NOT_ANALYZED, nothing required: UNDEFINED), instruments, traceability, budget, decision rule.

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
    values = _values(inspection, provenance)
    root = fromstring(_filled(values))
    for name, value in {"xmlns": NAMESPACE, "versionQIF": "3.0.0", "idMax": str(values["last_id"])}.items():
        root.set(name, value)
    indent(root)
    return Document("inspection.qif", b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, "utf-8") + b"\n")


def _filled(values: Mapping[str, Any]) -> str:
    """The template filled in: every value is text, escaped and on one line."""
    from markupsafe import Markup

    templates = environment(
        "workbench.export", finalize=lambda value: value if isinstance(value, Markup) else _plain(str(value))
    )
    templates.filters |= {"decimal": _decimal, "date_time": date_time}
    return templates.get_template("qif.xml.j2").render(values)


def _values(inspection: JointInspection, provenance: Provenance | None) -> dict[str, Any]:
    """What the template takes; ids in the order of the definitions."""
    ids, part = itertools.count(1), inspection.part
    version = provenance.versions.get("workbench", "") if provenance else ""
    values: dict[str, Any] = {
        "document": _unique(inspection, provenance, "document"),
        "instance": _unique(inspection, provenance, "results"),
        "program": f"workbench {version}".strip(),
        "title": provenance.title if provenance else f"inspection of a {inspection.WHAT}",
        "part": part,
        "standard": next(ids),
        "devices": list(_devices(part, ids)),
        "product": next(ids),
        "found": [_characteristic(one, inspection, ids) for one in inspection.characteristics],
        "component": next(ids),
        "results": next(ids),
        "count": len(inspection.characteristics) * len(inspection.sections),
        "context": dict(_context(inspection, provenance)),
        "procedure": _traceability(part, provenance),
        "status": STATUS[inspection.verdict],
    }
    for one in (section for each in values["found"] for section in each["sections"]):
        one["measurement"] = next(ids)
    return {**values, "last_id": next(ids) - 1}


def _devices(part: Part, ids: Iterator[int]) -> Iterator[dict[str, Any]]:
    """The sensor and the robot that carried it, each with what is known of its calibration."""
    sensor = {"calibrated at": part.sensor_calibrated_at}
    robot = {"hand-eye calibration": part.hand_eye, "hand-eye calibrated at": part.hand_eye_calibrated_at}
    for name, what, serial, facts in (
        (part.sensor, "laser profile sensor", part.sensor_serial, sensor),
        (part.robot, "robot that carries the sensor", part.robot_serial, robot),
    ):
        known = {key: text or "unknown" for key, text in facts.items()}
        yield {"id": next(ids), "name": name, "what": what, "serial": serial, "facts": known}


def _characteristic(one: Characteristic, inspection: JointInspection, ids: Iterator[int]) -> dict[str, Any]:
    """A size: its definition, its nominal value, and in each section item, value and status."""
    return {
        "kind": kind_of(one),
        "term": one.term.lower(),
        "symbol": one.symbol,
        "required": one.required,
        "definition": next(ids),
        "nominal": next(ids),
        "sections": [
            {
                "item": next(ids),
                "index": section.index,
                "arc_length_mm": section.arc_length_mm,
                "origin_mm": section.origin_mm.tolist(),
                "pair": pair,
                "status": STATUS_OF_ONE["hidden" if pair is None else verdict or "nothing required"],
            }
            for section, pair, verdict in zip(inspection.sections, one.pairs, one.verdicts, strict=True)
        ],
    }


def _traceability(part: Part, provenance: Provenance | None) -> dict[str, str]:
    """By which procedure it was measured, and what of its traceability is unknown.

    QIF's own InspectionProgram must name an author and a formal standard, which nobody states here: the procedure is
    an attribute.
    """
    facts = {"measurement procedure": "unknown"}
    if provenance:
        digest = content_digest(_procedure(provenance))
        facts = {"measurement procedure": provenance.title or "pipeline", "measurement procedure SHA-256": digest}
    return facts | ({} if part.recorded_at else {"inspection start": "unknown"})


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


def _plain(text: str) -> str:
    """Text that XML 1.0 can hold, on one line."""
    return "".join(c for c in one_line(text) if c.isprintable())


def _decimal(value: float) -> str:
    """An xs:decimal, which knows no exponent, with the digits that a float64 has."""
    text = f"{value:.12f}".rstrip("0").rstrip(".")
    return "0" if text in ("", "-0") else text
