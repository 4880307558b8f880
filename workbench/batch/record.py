"""What a batch knows of one part, `part.json` beside the results; and what must agree for the part to be skipped."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from workbench.artefacts import Gate, Inspection, Recording
from workbench.pipeline.results import is_plain_name
from workbench.pipeline.run import Results, resolved, versions
from workbench.pipeline.sources import package_digest
from workbench.pipeline.wiring import Plan
from workbench.result_files import BatchPartFile
from workbench.strict_json import plain

PART_FILE = BatchPartFile.NAME
FORMAT = "bevel-part"
VERSION = 1

Outcome = Literal["passed", "rejected", "failed", "hung", "crashed"]
OUTCOMES: tuple[Outcome, ...] = ("crashed", "hung", "failed", "rejected", "passed")  # worst first


@dataclass(frozen=True, slots=True)
class Record:
    """One part of a batch. Passed and rejected parts have results; the others a `cause` and none.

    failed: the input was unusable (exit status 2 of `workbench run`); hung: it took longer than allowed; crashed: the
    process that it ran in died, twice.
    """

    part: str
    recording: str  # as given
    outcome: Outcome
    cause: str = ""  # why it was rejected, or has no results
    part_id: str | None = None  # free text out of the recording
    identity: Mapping[str, Any] = field(default_factory=dict)  # part, people, instruments, as in inspection.json
    verdict: str | None = None  # of the inspection, where the pipeline has one
    requirements: Mapping[str, Any] = field(default_factory=dict)
    sections: tuple[Mapping[str, Any], ...] = ()  # what the inspection says of each
    seconds: float = 0.0  # of the pipeline
    pipeline: str = ""  # SHA-256 of the pipeline as resolved
    versions: str = ""  # SHA-256 of versions and code
    inputs: tuple[Mapping[str, str | None], ...] = ()  # name, path, sha256, version in its store
    files: Mapping[str, str] = field(default_factory=dict)  # SHA-256 of each result
    skipped: bool = False  # whole results of the same inputs stood there already; not in the file

    def content(self) -> bytes:
        """`part.json`."""
        return BatchPartFile.written({"format": FORMAT, "version": VERSION, **{n: getattr(self, n) for n in KEPT}})

    @classmethod
    def read(cls, content: bytes | None) -> Record | None:
        """The record in a `part.json`; None for what no batch wrote."""
        try:
            known = BatchPartFile.model_validate_json(content or b"null", strict=True)
        except ValidationError:
            return None
        if not all(is_plain_name(name) for name in known.files):
            return None
        kept = {name: getattr(known, name) for name in KEPT}
        return cls(**kept | {"sections": tuple(known.sections), "inputs": tuple(known.inputs)})


KEPT = tuple(one.name for one in dataclasses.fields(Record) if one.name != "skipped")


def record_of(part: str, recording: str, checked: Plan, results: Results, files: Mapping[str, bytes]) -> Record:
    """What is kept of a run."""
    inspection = next((one for one in reversed([*results]) if isinstance(one, Inspection)), None)
    read = next((one for one in results if isinstance(one, Recording)), None)
    said = "; ".join(one.cause for one in results if isinstance(one, Gate) and not one.clean)
    judged: dict[str, Any] = {}
    if inspection:
        judged = {
            "verdict": inspection.verdict,
            "requirements": plain(dataclasses.asdict(inspection.requirements)),
            "sections": tuple(plain({k: getattr(one, k) for k in SECTION_KEYS}) for one in inspection.sections),
        }
    part_of = inspection.part if inspection else read.part if read else None
    return Record(
        part,
        recording,
        "passed" if results.passed else "rejected",
        cause=said,
        part_id=part_of.part_id if part_of else None,
        identity=plain(dataclasses.asdict(part_of)) if part_of else {},
        seconds=round(sum(results.seconds.values()), 6),
        pipeline=pipeline_digest(checked),
        versions=versions_digest(checked),
        inputs=tuple({"name": name, "path": path, "sha256": digest} for name, path, digest in results.inputs),
        files={name: sha256(content) for name, content in files.items()},
        **judged,
    )


SECTION_KEYS = ("index", "arc_length_mm", "root_mm", "root_u_mm", "bevel_deg", "bevel_u_deg", "verdict")


def pipeline_digest(checked: Plan) -> str:
    """Of the pipeline as it runs: inputs put in, defaults spelt out."""
    return sha256(json.dumps(plain(resolved(checked)), sort_keys=True).encode())


def versions_digest(checked: Plan) -> str:
    """Of the versions that results rest on, and of the sources of every package that a stage comes from."""
    packages = {step.stage.function.__module__.partition(".")[0] for step in checked.steps} | {"workbench"}
    code = {name: package_digest(name) for name in sorted(packages)}
    return sha256(json.dumps([versions(), code], sort_keys=True).encode())


def sha256(content: bytes) -> str:
    """As hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def file_digest(path: Path) -> str:
    """Of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
