"""One part, from recording to results: the function that every worker runs, here, in a process or on a cluster.

What a batch knows of the part stands in `part.json` beside the results; and what must agree for it to be skipped.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Protocol

from pydantic import ValidationError

from workbench.artefacts import Gate, JointInspection, Recording
from workbench.artefacts.evidence import ACCEPTED
from workbench.batch.store import copied, is_remote, local_path, remote, version_token, write_file
from workbench.errors import InputError, OutputError, WorkbenchError, one_line
from workbench.pipeline.document import Copied, PipelineDocument
from workbench.pipeline.output import OutputDirectory
from workbench.pipeline.results import RUN_FILE, is_plain_name
from workbench.pipeline.run import Results, resolved, run_files, run_plan, versions
from workbench.pipeline.terminal import Reporter
from workbench.pipeline.wiring import Plan, plan
from workbench.result_files import BatchPartFile
from workbench.storage import digest_of
from workbench.strict_json import plain
from workbench.user_folder import package_digest

PART_FILE = BatchPartFile.NAME

Outcome = Literal["passed", "rejected", "failed", "hung", "crashed"]
OUTCOMES: tuple[Outcome, ...] = ("crashed", "hung", "failed", "rejected", "passed")  # worst first
# The folder of one part's results, on this machine or in a store: a whole set of results or none.


@dataclass(frozen=True, slots=True)
class Record:
    """One part of a batch. Passed and rejected parts have results; the others a `cause` and none.

    failed: the input was unusable (exit status 2 of `workbench run`); hung: it took longer than allowed; crashed: the
    process that it ran in died, twice.
    """

    part: str
    recording: str  # as given
    outcome: Outcome
    cause: str = ""  # why it was rejected, or has no results; what its pass rests on
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
        return BatchPartFile.written({name: getattr(self, name) for name in KEPT})

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
    inspection = next((one for one in reversed([*results]) if isinstance(one, JointInspection)), None)
    read = next((one for one in results if isinstance(one, Recording)), None)
    said = "; ".join(one.cause for one in results if isinstance(one, Gate) and not one.clean)
    judged: dict[str, Any] = {}
    if inspection and not said and ACCEPTED in inspection.reason:
        said = inspection.reason[inspection.reason.index(ACCEPTED) :]
    if inspection:
        judged = {
            "verdict": inspection.verdict,
            "requirements": plain(dict(inspection.requirements_in_file)),
            "sections": tuple(
                plain({"index": s.index, "arc_length_mm": s.arc_length_mm, **s.values, "verdict": s.verdict})
                for s in inspection.sections
            ),
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


class Folder(Protocol):
    """The folder of one part's results."""

    def reserved(self) -> AbstractContextManager[None]:
        """For the length of a run: it takes files, and nobody else writes there."""

    def read(self, name: str) -> bytes | None:
        """A file's content; None: there is none."""

    def publish(self, files: Mapping[str, bytes]) -> None:
        """Write the files as the folder's one set of results; without `part.json`, which comes last, it is none."""

    def withdraw(self, content: bytes) -> None:
        """No earlier result may stand for a run that failed; the `part.json` of this content says why."""


class LocalFolder:
    """On this machine: files change places by renaming."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._results = OutputDirectory(path, exists=True)

    @contextmanager
    def reserved(self) -> Iterator[None]:
        """As Folder; the lock is on the folder itself, so that a process that dies leaves none behind."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(str(self.path), f"cannot be written: {error.strerror}") from None
        with self._results.reserved():
            yield

    def read(self, name: str) -> bytes | None:
        """As Folder."""
        try:
            return (self.path / name).read_bytes()
        except OSError:
            return None

    def publish(self, files: Mapping[str, bytes]) -> None:
        """As Folder; `part.json` lists what belongs together, so it may come with the rest."""
        self._results.publish(files, over=PART_FILE)

    def withdraw(self, content: bytes) -> None:
        """As Folder: results move into `superseded/`."""
        self._results.supersede()
        self.publish({PART_FILE: content})


class RemoteFolder:
    """Behind a URL: a store of objects, each written whole."""

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")

    def reserved(self) -> AbstractContextManager[None]:
        """As Folder: a store of objects has no lock; who writes the same part writes the same bytes."""
        return nullcontext()

    def read(self, name: str) -> bytes | None:
        """As Folder."""
        with remote(self.url, InputError) as (files, path):
            try:
                return bytes(files.cat_file(f"{path}/{name}"))
            except FileNotFoundError:
                return None

    def publish(self, files: Mapping[str, bytes]) -> None:
        """As Folder."""
        self._remove(PART_FILE)
        for name in sorted(files, key=lambda name: (name == PART_FILE, name == RUN_FILE)):
            write_file(self.url, name, files[name])

    def withdraw(self, content: bytes) -> None:
        """As Folder: results are removed."""
        run = self.read(RUN_FILE)
        self._remove(PART_FILE)
        for name in {*filter(is_plain_name, json.loads(run).get("files", []) if run else []), RUN_FILE}:
            self._remove(name)
        write_file(self.url, PART_FILE, content)

    def _remove(self, name: str) -> None:
        with remote(self.url, OutputError) as (files, path):
            if files.exists(f"{path}/{name}"):
                files.rm_file(f"{path}/{name}")


def folder(place: str) -> Folder:
    """The folder at a path or URL; it need not exist."""
    return RemoteFolder(place) if is_remote(place) else LocalFolder(Path(local_path(place)))


RECORDING = "recording"  # the pipeline's input that each part gives anew


@dataclass(frozen=True, slots=True)
class Job:
    """What a worker needs for one part; plain values, since it may sit on another machine."""

    part: str
    recording: str  # path or URL as given
    document: PipelineDocument
    inputs: Mapping[str, Any]
    settings: Mapping[str, Any]
    out: str  # folder or URL of this part's results
    working_dir: str  # where relative paths start
    cache: str | None = None  # folder that keeps copies of recordings
    report: bool = True  # whether pages are made


def run_part(job: Job) -> Record:
    """Run one part and write its results, or skip it where whole results of the same inputs and versions stand.

    Never raises for what is wrong with the part: the record tells, and earlier results of it are moved away.
    """
    target = folder(job.out)
    try:
        with target.reserved():
            return _skipped(job, target) or _run(job, target)
    except OutputError as error:  # nothing can be written there
        return Record(job.part, job.recording, "failed", cause=str(error))
    except WorkbenchError as error:
        return fail(job, "failed", str(error))
    except Exception as error:
        return fail(job, "failed", one_line(f"internal: {type(error).__name__}: {error}"))


def fail(job: Job, outcome: Outcome, cause: str) -> Record:
    """The record of a part that has no results, written where they would be."""
    record = Record(job.part, job.recording, outcome, cause=cause)
    with suppress(WorkbenchError):  # the page of the fleet tells it in any case
        folder(job.out).withdraw(record.content())
    return record


def _run(job: Job, target: Folder) -> Record:
    remote = is_remote(job.recording)
    token = version_token(job.recording) if remote else None
    with copied(job.recording, Path(job.cache) if job.cache else None) if remote else nullcontext() as copy:
        checked = _planned(job, copy)
        try:
            results = run_plan(checked, Reporter())
        except WorkbenchError as error:  # stages know the copy only
            raise (
                type(error)(error.where.replace(str(copy), job.recording), error.expected) if copy else error
            ) from error
        files = run_files(checked, results)
    record = record_of(job.part, job.recording, checked, results, files)
    inputs = tuple({**one, "store": token if one["path"] == job.recording else None} for one in record.inputs)
    record = replace(record, inputs=inputs)
    target.publish({**files, PART_FILE: record.content()})
    return record


def _planned(job: Job, copy: Path | None) -> Plan:
    recording = Copied.of(job.recording, copy) if copy else local_path(job.recording)
    return plan(job.document, {**job.inputs, RECORDING: recording}, job.settings, report=job.report)


def _skipped(job: Job, target: Folder) -> Record | None:
    """The record of an earlier run if nothing that its results rest on has changed, and they are whole."""
    known = Record.read(target.read(PART_FILE))
    if known is None or not known.files:
        return None
    checked = _planned(job, Path(os.devnull) if is_remote(job.recording) else None)
    if (known.pipeline, known.versions) != (pipeline_digest(checked), versions_digest(checked)):
        return None
    if not _inputs_unchanged(known, checked, job) or not whole(known, target):
        return None
    return replace(known, part=job.part, skipped=True)


def whole(known: Record, target: Folder) -> bool:
    """Whether every result file is there and is what was written."""
    contents = ((target.read(name), digest) for name, digest in known.files.items())
    return all(content is not None and sha256(content) == digest for content, digest in contents)


def _inputs_unchanged(known: Record, checked: Plan, job: Job) -> bool:
    """Whether each input file has the content that it had; a recording in a store, the version."""
    paths = {(one.name, one.given): one.path for step in checked.steps for one in step.files}
    before = {(one["name"], one["path"]): one for one in known.inputs}
    if paths.keys() != before.keys():
        return False
    for key, path in paths.items():
        if is_remote(job.recording) and key[1] == job.recording:
            token = version_token(job.recording)
            same = token is not None and token == before[key]["store"]
        else:
            same = digest_of(path) == before[key]["sha256"]
        if not same:
            return False
    return True
