"""Every joint, of every verdict, through every export: values, u, tolerance and verdict come back as they were."""

from __future__ import annotations

import csv as comma_separated
import io
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import ezdxf
import numpy as np
import pytest
from pyarrow import parquet

from tests.made import files_of
from workbench.artefacts import (
    Cloud,
    Document,
    EdgeProfile,
    GrooveInspection,
    Inspection,
    JointInspection,
    Part,
    PreparationInspection,
    Provenance,
    Quantity,
    Requirements,
    Section,
    Uncertainty,
    Unseen,
    conformity,
    u_name,
)
from workbench.compare import study
from workbench.errors import one_line
from workbench.export import inspection as export_inspection
from workbench.export import qdas, qif, sections

Q = {"q": "http://qifstandards.org/xsd/qif3"}
RUN = Provenance(
    "t", (("hand_eye", "h.json", "00"), ("recording", "part 7.h5", "ab12"), ("cell", "c.json", "01")), {}, {}, 0
)
U, TOLERANCE = 0.01, (-0.25, 0.5)
OFF = {"pass": 0.1, "fail": 1.0, "undecided": 0.5, "hidden": np.nan, "nothing required": 0.1}  # from nominal
AXES = np.eye(3)


@dataclass(frozen=True)
class Row:
    """A size in a section, as far as a file tells it."""

    value: float | None
    u: float | None
    limits: tuple[float, float] | None = None
    verdict: str | None = None


REASON = 'a "quoted", reason\nof two lines'  # that must stay in its cell


def named(size: str, what: str) -> str:
    """`gap_tolerance_mm` of `gap_mm` and `tolerance`."""
    return f"{size.rpartition('_')[0]}_{what}_{size.rpartition('_')[2]}"


def nominal(terms: Any, name: str) -> float:
    return 3.0 + 5.0 * list(terms).index(name)


def sizes(terms: Any, kind: str, k: int) -> dict[str, Quantity]:
    return {
        name: Quantity.of(
            name,
            nominal(terms, name) + OFF[kind] + 1e-4 * k,
            {"faces": 0.6 * U * (1 + 0 * OFF[kind]), "hand-eye": 0.8 * U * (1 + 0 * OFF[kind])},
        )
        for name in terms
    }


def bevel(kind: str) -> Inspection:
    nothing = np.empty(0)
    places = []
    for k in range(3):
        verdict = kind if kind in ("pass", "fail") else "undecided"
        told = sizes(Inspection.terms, kind, k)
        places.append(
            Section(k + 1, 5.0 * k, 10.0 * k * AXES[0], *AXES, told, verdict, REASON, np.arange(2))  # type: ignore[arg-type]
        )
    wanted = Requirements(
        nominal(Inspection.terms, "root_mm"), TOLERANCE, nominal(Inspection.terms, "bevel_deg"), TOLERANCE
    )
    profile = EdgeProfile(nothing, np.empty((0, 3)), nothing, nothing, nothing, nothing)
    return Inspection(tuple(places), profile, wanted, 1.645, places[0].verdict, kind, "per section", Part(part_id="A"))


def joint(made: type[GrooveInspection | PreparationInspection], shape: str, kind: str) -> JointInspection:
    verdict = kind if kind in ("pass", "fail") else "undecided"
    plates = ("left_", "right_") if made is GrooveInspection else ("",)
    corners = tuple(
        {"name": plate + which, "section_mm": [x, y], "position_mm": [0.0] * 3, "u_mm": [0.1, 0.1], "column": None}
        for x, plate in enumerate(plates)
        for y, which in enumerate(("lower", "root", "upper"))
    )
    wanted: dict[str, Any] = {}
    for name in made.terms if kind != "nothing required" else ():
        wanted |= {name: nominal(made.terms, name), named(name, "tolerance"): list(TOLERANCE)}
    places = tuple(
        Section(
            k + 1,
            5.0 * k,
            10.0 * k * AXES[0],
            *AXES,
            sizes(made.terms, kind, k),
            verdict,  # type: ignore[arg-type]
            kind,
            np.arange(2),
            corners,
        )
        for k in range(3)
    )
    return made(
        type=shape,
        alternatives=(),
        declared=True,
        sections=places,
        requirements=wanted,
        guard_factor=1.645,
        verdict=verdict,  # type: ignore[arg-type]
        reason=kind,
        uncertainty=Uncertainty(not_included=(Unseen("one", "One thing."), Unseen("two", "Another.", {"gap_mm": 0.1}))),
        part=Part(part_id="A", recorded_at="2026-03-31"),
    )


JOINTS: dict[str, Callable[[str], JointInspection]] = {
    "bevel": bevel,
    "groove": lambda kind: joint(GrooveInspection, "Y", kind),
    "preparation": lambda kind: joint(PreparationInspection, "nose", kind),
}
CASES = [(what, kind) for what in JOINTS for kind in OFF if (what, kind) != ("bevel", "nothing required")]
Found = Iterator[tuple[str, int, Row]]


def from_qif(inspection: JointInspection) -> Found:
    root = ElementTree.fromstring(qif(inspection, RUN).content)
    by_id = {one.get("id"): one for one in root.iter() if one.get("id")}
    names = {one.symbol: one.name for one in inspection.characteristics}
    status = {"PASS": "pass", "FAIL": "fail", "INDETERMINATE": "undecided"}
    for row in root.iterfind(".//q:CharacteristicMeasurements/*", Q):
        item = by_id[row.findtext("q:CharacteristicItemId", namespaces=Q)]
        wanted = by_id[item.findtext("q:CharacteristicNominalId", namespaces=Q)]
        defined = by_id[wanted.findtext("q:CharacteristicDefinitionId", namespaces=Q)]
        symbol, _, section = item.findtext("q:CharacteristicDesignator/q:Designator", "", Q).rpartition("-")
        limits = None
        if defined.find("q:Tolerance", Q) is not None:
            target = float(wanted.findtext("q:TargetValue", "", Q))
            low, high = (float(defined.findtext(f"q:Tolerance/q:{end}Value", "", Q)) for end in ("Min", "Max"))
            limits = target + low, target + high
        number = row.find("q:Value", Q)
        pair = (
            (None, None) if number is None else (float(number.text or ""), float(number.get("combinedUncertainty", "")))
        )
        told = row.findtext("q:Status/q:CharacteristicStatusEnum", "", Q)
        yield names[symbol], int(section), Row(*pair, limits, status.get(told))


def parse(dfd: bytes, dfx: bytes) -> tuple[dict[str, str], list[dict[str, str]], list[list[list[str]]]]:
    """Q-DAS AQDEF: fields of the part, of each characteristic, and each one's value, attribute, time a record."""
    part: dict[str, str] = {}
    rows: dict[int, dict[str, str]] = {}
    for line in filter(None, dfd.decode("cp1252").split("\r\n")):
        key, _, text = line.partition(" ")
        field, slash, number = key.partition("/")
        assert (len(field), field[0]) == (5, "K")
        (rows.setdefault(int(number), {}) if slash else part)[field] = text
    assert [*rows] == [*range(1, int(part["K0100"]) + 1)]
    lines = filter(None, dfx.decode("cp1252").split("\r\n"))
    return part, [*rows.values()], [[one.split(chr(20)) for one in line.split(chr(15))] for line in lines]


def from_qdas(inspection: JointInspection) -> Found:
    _, rows, (record,) = parse(*(one.content for one in qdas(inspection)))
    names = {one.symbol: one.name for one in inspection.characteristics}
    for row, (value, flag, _) in zip(rows, record, strict=True):
        symbol, _, section = row["K2001"].rpartition("-")
        limits = (float(row["K2110"]), float(row["K2111"])) if "K2110" in row else None
        told = flag == "0"
        u = float(row["K2900"].split()[2]) / 2 if told else None
        yield names[symbol], int(section), Row(float(value) if told else None, u, limits)


def table_rows(inspection: JointInspection, rows: list[dict[str, Any]]) -> Found:
    def number(row: dict[str, Any], name: str) -> float | None:
        return float(row[name]) if row.get(name) not in (None, "") else None

    for row in rows:
        for name in inspection.terms:
            low, high = (number(row, named(name, end)) for end in ("lower", "upper"))
            limits = None if low is None or high is None else (low, high)
            yield name, int(row["section"]), Row(number(row, name), number(row, u_name(name)), limits)


def from_parquet(inspection: JointInspection) -> Found:
    table = parquet.read_table(io.BytesIO(export_inspection(inspection, RUN).content))
    assert table.schema.metadata[b"format"].decode() == f"{inspection.FORMAT}-rows"
    rows = table.to_pylist()
    for row, section in zip(rows, inspection.sections, strict=True):
        assert (row["part_id"], row["recording"], row["recording_sha256"]) == ("A", "part 7.h5", "ab12")
        assert [row["x_mm"], row["y_mm"], row["z_mm"]] == section.origin_mm.tolist()
        assert (row["arc_length_mm"], row["verdict"]) == (section.arc_length_mm, section.verdict)
        assert row["reason"] == section.reason
    yield from table_rows(inspection, rows)


def rows_of(document: Document) -> list[dict[str, Any]]:
    return list(comma_separated.DictReader(io.StringIO(document.content.decode(), newline="")))


def from_csv(inspection: JointInspection) -> Found:
    rows = rows_of(export_inspection(inspection, RUN, format="csv"))
    assert [row["reason"] for row in rows] == [one_line(section.reason) for section in inspection.sections]
    yield from table_rows(inspection, rows)


def from_file(inspection: JointInspection) -> Found:
    ((_, content),) = files_of(inspection).items()
    for section in json.loads(content)["sections"]:
        for one in section["quantities"]:
            assert section[one["name"]] == one["value"]
            assert section[u_name(one["name"])] == one["u"]
            yield one["name"], section["index"], Row(one["value"], one["u"], None, one["verdict"])


def from_dxf(inspection: JointInspection) -> Found:
    """A block a section, each size a text."""
    frames = np.zeros((2, 3))
    cloud = Cloud(frames, frames, frames > 1, np.tile(np.eye(4), (2, 1, 1)), np.arange(2.0), np.zeros(2, np.int64))
    drawing = ezdxf.read(io.StringIO(sections(inspection, cloud).content.decode()))
    assert not drawing.audit().errors
    names = {words[0].lower(): name for name, words in inspection.terms.items()}
    for section in inspection.sections:
        block = drawing.blocks.get(f"section_{section.index}")
        known = bool(section.corners) or section.root_and_bevel is not None
        assert bool(block.query('LINE[layer=="fit"]')) is bool(block.query("CIRCLE")) is known
        told = {}
        for text in [one.dxf.text for one in block.query("TEXT")][1:]:
            if ", u " in text:
                size, u = text.split(", u ")
                term, value, _ = size.rsplit(" ", 2)
                told[names[term]] = Row(float(value), float(u.split()[0]))
        yield from ((name, section.index, told.get(name, Row(None, None))) for name in inspection.terms)


EXPORTS = {  # how exactly values and u come back
    from_qif: (1e-9, 1e-9),
    from_qdas: (1e-8, 0.003),
    from_parquet: (0.0, 0.0),
    from_csv: (0.0, 0.0),
    from_file: (0.0, 0.0),
    from_dxf: (0.006, 0.006),
}
TELLS_LIMITS, TELLS_VERDICTS = (from_qif, from_qdas, from_parquet, from_csv), (from_qif, from_file)


@pytest.mark.parametrize("export", EXPORTS, ids=lambda one: one.__name__)
@pytest.mark.parametrize(("what", "kind"), CASES)
def test_what_is_written_comes_back(export: Callable[[JointInspection], Found], what: str, kind: str) -> None:
    inspection = JOINTS[what](kind)
    value_off, u_off = EXPORTS[export]
    seen = set()
    for name, index, row in export(inspection):
        seen.add((name, index))
        section = inspection.sections[index - 1]
        asked = None if kind == "nothing required" else nominal(inspection.terms, name)
        for found, wanted, off in (
            (row.value, section.values[name], value_off),
            (row.u, section.values[u_name(name)], u_off),
        ):
            assert (found is None) is (wanted is None)
            assert wanted is None or found == pytest.approx(wanted, abs=off, rel=0 if off else None)
        if export in TELLS_LIMITS:
            assert row.limits == (
                None if asked is None else pytest.approx((asked + TOLERANCE[0], asked + TOLERANCE[1]))
            )
        if export in TELLS_VERDICTS:
            known = asked is not None and row.value is not None
            hidden = None if asked is None or export is from_qif else "undecided"
            assert row.verdict == (conformity(row.value, row.u, asked, TOLERANCE, 1.645) if known else hidden)  # type: ignore[arg-type]
            assert not known or row.verdict == kind
    assert seen == {(name, section.index) for name in inspection.terms for section in inspection.sections}


@pytest.mark.parametrize("what", JOINTS)
def test_the_budget_adds_up_to_the_largest_section_of_each_size(what: str) -> None:
    inspection = JOINTS[what]("pass")
    for name in inspection.terms:
        whole = max(section.values[u_name(name)] or 0.0 for section in inspection.sections)
        assert np.sqrt(sum(row[u_name(name)] ** 2 for row in inspection.sources)) == pytest.approx(whole)


@pytest.mark.parametrize("what", JOINTS)
def test_a_gauge_study_takes_the_files_of_every_joint(what: str, tmp_path: Path) -> None:
    trials = []
    for k in range(3):
        made = JOINTS[what]("pass")
        moved = tuple(
            replace(one, sizes={n: replace(q, value=q.value + 0.01 * k) for n, q in one.sizes.items()})
            for one in made.sections
        )
        ((name, content),) = files_of(replace(made, sections=moved)).items()  # type: ignore[type-var]
        (tmp_path / str(k)).mkdir()
        (tmp_path / str(k) / name).write_bytes(content)
        trials.append(tmp_path / str(k))
    found = study(inspections=[path / name for path in trials])
    terms = JOINTS[what]("pass").terms
    assert set(found.measured) == set(terms)
    assert found.limits == {
        one: pytest.approx((nominal(terms, one) + TOLERANCE[0], nominal(terms, one) + TOLERANCE[1])) for one in terms
    }
    first = next(iter(terms))
    assert found.measured[first][0, 0, :, 0] - found.measured[first][0, 0, 0, 0] == pytest.approx([0.0, 0.01, 0.02])
