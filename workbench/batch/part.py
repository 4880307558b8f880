"""One part, from recording to results: the function that every worker runs, here, in a process or on a cluster."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from workbench.batch.folders import Folder, folder
from workbench.batch.record import (
    PART_FILE,
    Outcome,
    Record,
    file_digest,
    pipeline_digest,
    record_of,
    sha256,
    versions_digest,
)
from workbench.batch.store import copied, is_remote, local_path, version_token
from workbench.errors import OutputError, WorkbenchError, one_line
from workbench.pipeline.document import PipelineDocument
from workbench.pipeline.progress import Reporter
from workbench.pipeline.run import run_files, run_plan
from workbench.pipeline.substitute import Copied
from workbench.pipeline.wiring import Plan, plan

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
        folder(job.out).withdraw(PART_FILE, record.content())
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
    target.publish({**files, PART_FILE: record.content()}, PART_FILE)
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
            same = file_digest(path) == before[key]["sha256"]
        if not same:
            return False
    return True
