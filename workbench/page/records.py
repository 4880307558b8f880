"""What is kept of a run: part, verdict, sizes, and each section's values, as its result files say it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from workbench.artefacts.edges import required_in_file, u_name
from workbench.page.store import Run, Store
from workbench.strict_json import plain

NEXT_SCAN = "next_scan.json"  # of scan.next
INSPECTIONS = ("inspection.json", "groove.json", "preparation.json")
CALIBRATION = "handeye.json"
SIZE = re.compile(r"(?P<name>.+)_u(?P<unit>_mm|_deg)$")  # of a characteristic's uncertainty


def summary(folder: Path) -> dict[str, Any]:
    """Columns of the store out of a run's folder; nothing where the run made neither an inspection nor a calibration.

    An inspection that ends in a scan to make has that as `todo` in its record.
    """
    if (folder / CALIBRATION).is_file():
        return {"sizes": _calibrated(json.loads((folder / CALIBRATION).read_text(encoding="utf-8")))}
    path = next((folder / name for name in INSPECTIONS if (folder / name).is_file()), None)
    if path is None:
        return {}
    tree = json.loads(path.read_text(encoding="utf-8"))
    following = folder / NEXT_SCAN
    todo = json.loads(following.read_text(encoding="utf-8"))["sentence"] if following.is_file() else ""
    asked = required_in_file(tree["requirements"])
    names = ("index", "arc_length_mm", "verdict", *asked, *(u_name(name) for name in asked))
    sections = [{name: one.get(name) for name in names} for one in tree.get("sections", [])]
    row = measured(tree.get("part") or {}, tree["requirements"], sections)
    row["record"]["todo"] = todo
    return row | {"verdict": tree.get("verdict"), "reason": tree.get("reason")}


def measured(identity: Mapping[str, Any], required: Any, sections: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Columns of the store: part, sizes, and the record that charts are made of."""
    record = {"identity": dict(identity), "requirements": required, "sections": list(sections)}
    record |= {
        "cell": _named(identity, "robot", "robot_serial"),
        "sensor": _named(identity, "sensor", "sensor_serial"),
        "tool": identity.get("tool"),
    }
    return {"part": identity.get("part_id"), "sizes": sizes(sections), "record": plain(record)}


def _named(identity: Mapping[str, Any], *names: str) -> str | None:
    return " ".join(str(identity[name]) for name in names if identity.get(name)) or None


def _calibrated(tree: Mapping[str, Any]) -> dict[str, list[float]]:
    """Where the profiler sits on the flange, with U = 2 u; and the RMS error over the field of view, as predicted."""
    u = [2.0 * float(row[k]) ** 0.5 for k, row in enumerate(tree["covariance"][:3])]
    found = {
        f"{name}_mm": [value, u[k]] for k, (name, value) in enumerate(zip("xyz", tree["translation_mm"], strict=True))
    }
    return {**found, "volume_u_mm": [tree["volume_u_mm"], 0.0]}


def sizes(sections: Sequence[Mapping[str, Any]]) -> dict[str, list[float]]:
    """Mean over the sections and largest U = 2u of every value that has an uncertainty, by its name with its unit."""
    found: dict[str, list[float]] = {}
    for key in dict.fromkeys(key for section in sections for key in section):
        if not (match := SIZE.fullmatch(key)):
            continue
        name = f"{match['name']}{match['unit']}"
        pairs = [(one[name], one[key]) for one in sections if one.get(name) is not None and one.get(key) is not None]
        if pairs:
            values, us = zip(*pairs, strict=True)
            found[name] = [sum(values) / len(values), 2.0 * max(us)]
    return found


def alike(runs: Sequence[Run]) -> list[Run]:
    """Those that can share a chart, oldest first: of one pipeline, to the requirements of the newest.

    Of each recording the last run: a part that was judged again is one part.
    """
    inspected = [run for run in runs if run.record.get("sections")]
    if not inspected:
        return []
    newest = inspected[0]
    same = [
        run
        for run in inspected
        if (run.kind, run.record["requirements"]) == (newest.kind, newest.record["requirements"])
    ]
    last: dict[str, Run] = {}
    for run in same:
        last.setdefault(str(run.inputs.get("recording", "")), run)
    return sorted(last.values(), key=lambda run: run.id)


def fleet(runs: Sequence[Run]) -> list[Any]:
    """The runs as parts of a batch (`workbench.batch.part.Record`): its charts and its table are made of them."""
    from workbench.batch.part import Record

    return [
        Record(
            str(run.id),
            str(run.inputs.get("recording", "")),
            "passed" if run.status == 0 else "rejected",
            run.reason or "",
            run.part,
            run.record["identity"],
            run.verdict,
            run.record["requirements"],
            tuple(run.record["sections"]),
        )
        for run in runs
    ]


def keep_run(folder: str, kind: str, inputs: Mapping[str, Any], status: int, out: Path) -> int:
    """Store a run of the command line in the folder of `workbench open`; its number.

    Raises:
        InputError, OutputError: as Store.
    """
    given = {name: _absolute(value) for name, value in inputs.items()}
    with Store.of(Path(folder)) as store:
        return store.add(kind, given, state="done", status=status, **_with_place(summary(out), out))


def keep_batch(folder: str, kind: str, inputs: Mapping[str, Any], records: Sequence[Any], out: str) -> None:
    """Store the parts of a batch; one that is stored already, as it was, is not stored twice.

    Raises:
        InputError, OutputError: as Store.
    """
    with Store.of(Path(folder)) as store:
        for one in records:
            row = measured(one.identity, one.requirements, one.sections) | {
                "verdict": one.verdict,
                "part": one.part_id,
            }
            row |= {"reason": one.cause, "status": {"passed": 0, "rejected": 1}.get(one.outcome, 2)}
            row = _with_place(row, Path(out) / one.part)
            if not store.has(row["record"]):
                given = {**inputs, "recording": _absolute(one.recording)}
                store.add(kind, given, state="done" if row["status"] < 2 else "failed", **row)


def _with_place(row: dict[str, Any], out: Path) -> dict[str, Any]:
    return {**row, "record": {**row.get("record", {}), "out": str(out.resolve())}}


def _absolute(value: Any) -> Any:
    return str(Path(value).resolve()) if isinstance(value, str) and Path(value).is_file() else value
