"""`Pipeline`: load, check, run. The command line and a notebook go through the same few lines."""

from __future__ import annotations

import contextlib
import functools
import inspect
import json
import os
import platform
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

from workbench import __version__
from workbench.artefacts import Gate, PathGate, Provenance
from workbench.artefacts.showing import brief, shown
from workbench.errors import InputError, PipelineError, WorkbenchError, one_line
from workbench.parameters import jsonable
from workbench.pipeline.cache import Made, StageCache
from workbench.pipeline.catalogue import FILES
from workbench.pipeline.digests import digesting
from workbench.pipeline.document import PipelineDocument, check_document, parse_json, read_document
from workbench.pipeline.output import OutputDirectory
from workbench.pipeline.results import RUN_FILE, result_files, written
from workbench.pipeline.terminal import Reporter, compilation_watch
from workbench.pipeline.wiring import Plan, Step, makes_pages, plan
from workbench.stage import Role, Source

A = TypeVar("A")
VERSIONED = ("numpy", "scipy", "numba", "h5py", "pydantic", "open3d", "pyvista", "matplotlib")
NOTED = (UserWarning, RuntimeWarning)  # Python warnings that a user should see; the rest is for developers


@dataclass(repr=False)
class Results:
    """What a run made: artefacts by stage id, in order; files, if it wrote any."""

    artefacts: dict[str, tuple[Any, ...]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    inputs: list[tuple[str, str, str]] = field(default_factory=list)  # name, path as given, SHA-256
    warnings: list[str] = field(default_factory=list)
    files: tuple[Path, ...] = ()

    def __getitem__(self, stage_id: str) -> Any:
        """What one stage returned: its artefact, or a tuple of them."""
        made = self.artefacts[stage_id]
        return made[0] if len(made) == 1 else made

    def __repr__(self) -> str:
        """What was made, in a line a notebook can show."""
        made = ", ".join(
            f"{name}: {'/'.join(type(one).__name__ for one in ones)}" for name, ones in self.artefacts.items()
        )
        return f"Results(passed={self.passed}, {made}, {len(self.files)} files, {len(self.warnings)} warnings)"

    def last(self, kind: type[A]) -> A:
        """The last artefact of a type, e.g. `results.last(Inspection)`; KeyError if there is none."""
        found = [artefact for artefact in self if isinstance(artefact, kind)]
        if not found:
            raise KeyError(f"the run made no {kind.__name__}")
        return found[-1]

    def __iter__(self) -> Iterator[Any]:
        """All artefacts, in the order they were made."""
        return (artefact for made in self.artefacts.values() for artefact in made)

    @property
    def decisions(self) -> tuple[Gate, ...]:
        """The gates that count: of those on one path the last, which holds what the ones before it said."""
        last = {id(one.toolpath if isinstance(one, PathGate) else one): one for one in self if isinstance(one, Gate)}
        return tuple(last.values())

    @property
    def passed(self) -> bool:
        """Whether every gate of the pipeline let the part through, with all its checks in force."""
        return all(gate.clean for gate in self.decisions)


shown(PipelineDocument)


class Pipeline:
    """A pipeline document (docs/pipelines.md): `Pipeline.load("inspect.json").run(out="result")`."""

    def __init__(self, document: Mapping[str, Any], *, base_dir: str | Path = ".") -> None:
        """Take a document as Python data; its relative paths start at `base_dir`. Raises PipelineError."""
        try:
            text = json.dumps(document, default=jsonable)
        except (TypeError, ValueError, RecursionError) as error:
            raise PipelineError("pipeline", f"expected what JSON can hold: {error}") from None
        self.document = check_document(parse_json(text.encode(), "pipeline"), "pipeline", Path(base_dir))

    @classmethod
    def load(cls, path: str | Path) -> Pipeline:
        """Read a pipeline file; raises PipelineError with line and column, or the JSON path, of what is wrong."""
        pipeline = cls.__new__(cls)
        pipeline.document = read_document(Path(path))
        return pipeline

    def __repr__(self) -> str:
        """Its file, title, stages and inputs, in a line a notebook can show."""
        document = self.document
        stages = ", ".join(str(one["stage"]) for one in document.stages)
        inputs = ", ".join(document.inputs)
        return f"Pipeline({document.name!r}: {brief(document.title)}; stages {stages}; inputs {inputs or 'none'})"

    def plan(
        self,
        inputs: Mapping[str, Any] | None = None,
        settings: Mapping[str, Any] | None = None,
        *,
        report: bool = True,
    ) -> Plan:
        """Check all that can be checked without running; raises PipelineError or InputError."""
        return plan(self.document, inputs or {}, settings or {}, report=report)

    def run(
        self,
        out: str | Path | None = None,
        *,
        inputs: Mapping[str, Any] | None = None,
        settings: Mapping[str, Any] | None = None,
        reporter: Reporter | None = None,
        report: bool = True,
        cache: str | Path | None = None,
        **named: Any,
    ) -> Results:
        """Check, run, and write the results into the directory `out` (None: write nothing).

        `inputs`: values by input name, or by its own name, as `recording="part.h5"`;
        `settings`: values by `STAGE.KEY`, STAGE an id or a stage's name;
        without `report` no pages are made; `cache`: a folder that keeps what stages make for the next run. Raises a
        WorkbenchError for anything unusable outside the program.
        """
        checked = self.plan({**(inputs or {}), **named}, settings, report=report)
        kept = None if cache is None else StageCache(Path(cache), versions())
        if out is None:
            return run_plan(checked, reporter or Reporter(), kept)
        target = OutputDirectory(out)
        with target.reserved(record.path for step in checked.steps for record in step.files):
            results = run_plan(checked, reporter or Reporter(), kept)
            results.files = target.publish(run_files(checked, results))
        return results


def run_plan(checked: Plan, reporter: Reporter, cache: StageCache | None = None) -> Results:
    """Run the steps in order, in memory."""
    results = Results(warnings=list(checked.warnings))
    records = [record for step in checked.steps for record in step.files]
    pages = _first_page(checked)
    with compilation_watch(reporter), digesting(records) as digests:
        for i, step in enumerate(checked.steps):
            if i == pages:
                reporter.known(results)
            reporter.begin(i, len(checked.steps), step.id)
            start = time.perf_counter()
            if any(issubclass(source.type, Provenance) for source in step.stage.sources):
                results.inputs = digests.all()
            run = functools.partial(_run_step, step, checked, results, reporter)
            made, notes = cache.made(step, run) if cache else run()
            results.warnings += notes
            results.seconds[step.id] = time.perf_counter() - start
            results.artefacts[step.id] = made
            results.warnings += [note for one in made for note in getattr(one, "warnings", ())]
            reporter.end(results.seconds[step.id])
            for later in checked.steps[i + 1 :]:
                _look_ahead(later, step, checked, results, reporter)
        results.inputs = digests.all()
    if pages == len(checked.steps):
        reporter.known(results)
    results.warnings = list(dict.fromkeys(results.warnings))
    return results


def _first_page(checked: Plan) -> int:
    """The step from which on nothing is measured or decided any more."""
    last = (i for i, step in reversed([*enumerate(checked.steps)]) if not makes_pages(step.stage))
    return next(last, -1) + 1


def _run_step(step: Step, checked: Plan, results: Results, reporter: Reporter) -> Made:
    sources = {source.name: _artefact(source, step, checked, results) for source in step.stage.sources}
    extra = {key: reporter.fraction for key, role in step.stage.parameters.items() if role is Role.PROGRESS}
    with _one_line_errors(step, checked), warnings.catch_warnings(record=True) as caught:
        for category in NOTED:
            warnings.simplefilter("always", category)
        made = step.stage.function(**sources, **step.parameters, **extra)
    noted = [item for item in caught if issubclass(item.category, NOTED)]
    notes = [f"{step.id}: {one_line(str(item.message))}" for item in noted]
    return (made if isinstance(made, tuple) else (made,) if made is not None else ()), notes


def _look_ahead(later: Step, step: Step, checked: Plan, results: Results, reporter: Reporter) -> None:
    """What a later stage decides by what `step` made, or made last: refused or said before the stages in between."""
    if (ahead := later.stage.ahead) is None:
        return
    names = inspect.signature(ahead).parameters
    sources = {source.name: source for source in later.stage.sources if source.name in names}
    needed = {one for name in sources for one in later.sources[name]}
    if step.id in needed and needed <= results.artefacts.keys():
        given = {name: later.parameters[name] for name in names if name not in sources}
        given |= {name: _artefact(source, later, checked, results) for name, source in sources.items()}
        with _one_line_errors(later, checked):
            reporter.note(ahead(**given))


def _artefact(source: Source, step: Step, checked: Plan, results: Results) -> Any:
    """The value of one positional parameter."""
    if issubclass(source.type, Provenance):
        return provenance(checked, results)
    found = [one for i in step.sources[source.name] for one in results.artefacts[i] if isinstance(one, source.type)]
    made = [type(one).__name__ for i in step.sources[source.name] for one in results.artefacts[i]]
    if source.required and not source.several and not found and (made or not source.nullable):
        makers = ", ".join(step.sources[source.name])  # made by one of two ways, and it went the other
        what = f"needs a {source.type.__name__} for '{source.name}', but {makers} made {', '.join(made) or 'none'}"
        raise InputError(f"{checked.document.name}: {step.id}", what)
    return tuple(found) if source.several else (found[0] if found else None)


@contextmanager
def _one_line_errors(step: Step, checked: Plan) -> Iterator[None]:
    """What a stage raises, as an error that names the stage; the cause stays attached for `--traceback`."""
    where = f"{checked.document.name}: {step.id}"
    try:
        yield
    except WorkbenchError as error:
        if os.path.exists(error.where.partition(": ")[0]):  # False for what no file can be named
            raise
        place = error.where.removeprefix(step.stage.name).lstrip(".: ")  # what names no file is found by its stage
        raise type(error)(f"{where}: {place}" if place else where, error.expected) from error
    except MemoryError as error:
        raise InputError(where, "not enough memory for this recording") from error
    except Exception as error:
        why = f"failed inside: {type(error).__name__}: {error} (--traceback shows where)"
        raise PipelineError(where, why) from error


def provenance(checked: Plan, results: Results) -> Provenance:
    """What the results so far rest on."""
    return Provenance(
        title=checked.document.title,
        inputs=tuple(results.inputs),
        versions=versions(),
        pipeline=resolved(checked),
        seed=checked.document.seed,
    )


def resolved(checked: Plan) -> dict[str, Any]:
    """The pipeline as it runs: inputs substituted, defaults and sources spelt out; itself a pipeline document."""
    from pydantic_core import to_jsonable_python

    stages = []
    for step in checked.steps:
        sources = {name: ids[0] if len(ids) == 1 else list(ids) for name, ids in step.sources.items() if ids}
        parameters = {**to_jsonable_python(dict(step.parameters)), **step.given}
        own = ({"from": sources} if sources else {}) | ({} if step.write else {"write": False})
        stages.append({"stage": step.stage.name, "id": step.id, **own, **parameters})
    document = checked.document
    head = {"version": 1, "title": document.title, "seed": document.seed}
    return {**head, "inputs": dict(checked.inputs), "stages": stages}


def versions() -> dict[str, str]:
    """Versions of the project, Python and the packages that the numbers depend on."""
    return {**_versions(), **{name: f"sha256:{digest}" for name, digest in FILES.items()}}


@functools.cache
def _versions() -> dict[str, str]:
    found = {"workbench": __version__, "python": platform.python_version()}
    for name in VERSIONED:
        for distribution in (name, f"{name}-cpu"):  # as which Open3D comes too
            with contextlib.suppress(PackageNotFoundError):
                found[name] = version(distribution)
    return found


def run_files(checked: Plan, results: Results) -> dict[str, bytes]:
    """All result files of a run, `run.json` included."""
    made = (made for step in checked.steps if step.write for made in results.artefacts[step.id])
    files = result_files(made, [one for one in results if isinstance(one, PathGate)])
    made_of = provenance(checked, results)
    files[RUN_FILE] = written(
        RUN_FILE,
        {
            "pipeline": made_of.pipeline,
            "versions": made_of.versions,
            "seed": made_of.seed,
            "inputs": [{"name": name, "path": path, "sha256": digest} for name, path, digest in made_of.inputs],
            "stages": [{"name": name, "seconds": round(spent, 6)} for name, spent in results.seconds.items()],
            "warnings": results.warnings,
            "files": [*files, RUN_FILE],
        },
    )
    return files
