"""From a document to steps that can run: stages looked up, parameters checked, sources found. Nothing runs here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.artefacts import Chapter, Document, Provenance
from workbench.artefacts.showing import shown
from workbench.errors import ArgumentError, InputError, PipelineError, nearest
from workbench.pipeline.catalogue import find
from workbench.pipeline.document import Copied, FromCaller, PipelineDocument, from_caller, references, substitute
from workbench.pipeline.results import file_of
from workbench.stage import RESERVED, Role, Source, Stage


@dataclass(frozen=True)
class InputRecord:
    """A file that a step reads: the name it is known by, the path as given, and where that is."""

    name: str
    given: str
    path: Path


@shown
@dataclass(frozen=True)
class Step:
    """One stage of a pipeline, ready to run. `sources`: by parameter, the ids of the steps that supply it."""

    id: str
    stage: Stage
    sources: Mapping[str, tuple[str, ...]]
    parameters: Mapping[str, Any]
    given: Mapping[str, Any]  # the parameters written in the document, inputs substituted
    files: tuple[InputRecord, ...]
    write: bool = True  # False: what it makes is for later stages only, no result file


@shown
@dataclass(frozen=True)
class Plan:
    """A pipeline in which everything that can be checked without running has been checked."""

    document: PipelineDocument
    inputs: Mapping[str, Any]
    steps: tuple[Step, ...]
    warnings: tuple[str, ...]


def plan(
    document: PipelineDocument, inputs: Mapping[str, Any], settings: Mapping[str, Any], *, report: bool = True
) -> Plan:
    """Check a document with the caller's inputs and settings (`STAGE.KEY` -> value) and wire its stages.

    Without `report` the stages that only make pages are left out. Raises PipelineError naming the JSON path, what was
    expected and the nearest known name; InputError for a file that is not there.
    """
    for name in inputs:
        if name not in document.inputs:
            where = f"{document.name}: inputs"
            raise ArgumentError(where, f"the pipeline has no input '{name}'{nearest(name, document.inputs)}")
    values = {**document.inputs, **{name: from_caller(value) for name, value in inputs.items()}}
    entries = _with_settings(document, settings)
    steps: list[Step] = []
    for i, entry in enumerate(entries):
        where = f"{document.name}: stages[{i}]"
        if report or not makes_pages(find(entry["stage"], f"{where}.stage")):
            steps.append(_step(entry, values, steps, entries, document, where))
    _check_result_files(steps, document)
    used = set(references(list(entries)))
    unused = tuple(f"input '{name}' is used by no stage" for name in document.inputs if name not in used)
    return Plan(document, values, tuple(steps), unused)


def makes_pages(stage: Stage) -> bool:
    """Whether all that a stage makes is for a person to look at: chapters, or the page that they stand in."""
    makes, takes = set(stage.produces), {source.type for source in stage.sources}
    return makes == {Chapter} or (makes == {Document} and Chapter in takes)


def _with_settings(document: PipelineDocument, settings: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The document's stages, with keys replaced or added by the caller."""
    entries = [dict(entry) for entry in document.stages]
    for target, value in settings.items():
        where, (stage, _, key) = f"setting '{target}'", target.rpartition(".")
        found = [entry for entry in entries if entry_id(entry) == stage] or [e for e in entries if e["stage"] == stage]
        if not stage or not found:
            known = {entry_id(entry) for entry in entries}
            raise ArgumentError(where, f"{document.name} has no stage '{stage}'{nearest(stage, known)}")
        if len(found) > 1:
            ids = ", ".join(entry_id(entry) for entry in found)
            raise ArgumentError(where, f"the pipeline has {len(found)} stages '{stage}': name one by its id ({ids})")
        if key in RESERVED:
            raise ArgumentError(where, f"'{key}' belongs to the document and cannot be set from outside")
        found[0][key] = from_caller(value)
    return entries


def entry_id(entry: Mapping[str, Any]) -> str:
    """The id of a stage in the document: its own, or the stage's name."""
    return str(entry.get("id", entry["stage"]))


def _step(
    entry: Mapping[str, Any],
    inputs: Mapping[str, Any],
    earlier: list[Step],
    entries: list[dict[str, Any]],
    document: PipelineDocument,
    where: str,
) -> Step:
    stage, step_id = find(entry["stage"], f"{where}.stage"), entry_id(entry)
    if any(step.id == step_id for step in earlier):
        raise PipelineError(f"{where}.id", f"'{step_id}' is taken by an earlier stage: give one of them another id")
    written = {key: value for key, value in entry.items() if key not in RESERVED}
    for key in written:
        if key not in stage.model.model_fields:
            known = [*stage.model.model_fields, *RESERVED]
            raise PipelineError(f"{where}.{key}", f"{stage.name} has no such parameter{nearest(key, known)}")
    given = {key: substitute(value, inputs, f"{where}.{key}") for key, value in written.items()}
    placed = dict(given)
    files: list[InputRecord] = []
    for key, role in stage.parameters.items():
        if role is Role.SEED:
            placed.setdefault(key, document.seed)
        if role is Role.INPUT_FILE and key in given:
            name = next(references(written[key]), "") or f"{step_id}.{key}"
            placed[key] = _place(given[key], document.base_dir, name, files)
    parameters = stage.validate(placed, where)
    for record in files:
        _check_file(record, where)
    sources = {source.name: _find_source(source, entry, earlier, entries, where) for source in stage.sources}
    for key in entry.get("from", {}):
        if key not in sources:
            raise PipelineError(f"{where}.from.{key}", f"{stage.name} takes no '{key}'{nearest(key, sources)}")
    step = Step(step_id, stage, sources, parameters, given, tuple(files), entry.get("write", True))
    _check_floors(step, {one.id: one for one in earlier}, where)
    return step


def _check_floors(step: Step, earlier: Mapping[str, Step], where: str) -> None:
    """No parameter is below what an earlier stage on the way of the same artefact was given: v_fast below v_slow."""
    for name, floor in step.stage.floors.items():
        maker: Step | None = step
        while maker and floor.name not in maker.parameters:
            made = next((one.name for one in maker.stage.sources if one.type is floor.made), None)
            maker = earlier[maker.sources[made][0]] if made else None
        value = step.parameters[name]
        if maker and value is not None and value < maker.parameters[floor.name]:
            least = f"the {floor.name} of {maker.id}, {maker.parameters[floor.name]:g}"
            raise PipelineError(f"{where}.{name}", f"expected at least {least}, got {value:g}: are the two swapped?")


def _place(value: Any, base_dir: Path, name: str, files: list[InputRecord]) -> Any:
    """Paths made relative to where they were written; what is no path is left to the parameter's own check."""
    if isinstance(value, list):
        return [_place(part, base_dir, name, files) for part in value]
    if not isinstance(value, str):
        return value
    if isinstance(value, Copied):
        path = value.copy
    else:
        path = Path(value) if isinstance(value, FromCaller) else base_dir / value
    files.append(InputRecord(name, str(value), path))
    return str(path)


def _check_file(record: InputRecord, where: str) -> None:
    try:
        with open(record.path, "rb"):
            return
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise InputError(str(record.path), f"cannot be read: {why} ('{record.name}' of {where})") from None


def _find_source(
    source: Source, entry: Mapping[str, Any], earlier: list[Step], entries: list[dict[str, Any]], where: str
) -> tuple[str, ...]:
    """The steps that supply one artefact: those named in `from`, else the nearest (or all) of the type before it."""
    if issubclass(source.type, Provenance):
        return ()
    offered = [step.id for step in earlier if any(issubclass(made, source.type) for made in step.stage.produces)]
    if source.name in entry.get("from", {}):
        named = entry["from"][source.name]
        ids = tuple(named) if isinstance(named, list) else (named,)
        for one in ids:
            if one not in offered:
                why = _why_not(one, source, earlier, entries)
                raise PipelineError(f"{where}.from.{source.name}", why + nearest(one, offered))
        if len(ids) != 1 and not source.several:
            raise PipelineError(f"{where}.from.{source.name}", f"expected one id, got {len(ids)}")
        return ids
    if not offered and source.required:
        makers = sorted({s.id for s in earlier})
        have = f"; the stages before it ({', '.join(makers)}) make none" if makers else "; it is the first stage"
        raise PipelineError(where, f"{entry['stage']} needs a {source.type.__name__} for '{source.name}'{have}")
    return tuple(offered) if source.several else tuple(offered[-1:])


def _why_not(name: str, source: Source, earlier: list[Step], entries: list[dict[str, Any]]) -> str:
    if any(step.id == name for step in earlier):
        return f"stage '{name}' makes no {source.type.__name__}"
    if any(entry_id(entry) == name for entry in entries):
        return f"stage '{name}' does not come before this one, and sources must"
    return f"no stage has the id '{name}'"


def _check_result_files(steps: list[Step], document: PipelineDocument) -> None:
    """Two stages whose results would be the same file are refused, before the one overwrites the other.

    A stage that takes the other's result and refines it (`path.feed` after `path.layers`) may: the last word counts.
    """
    makers: dict[str, str] = {}
    for i, step in enumerate(steps):
        taken = {maker for ids in step.sources.values() for maker in ids}
        for file in filter(None, map(file_of, step.stage.produces)) if step.write else ():
            if makers.get(file, step.id) not in {step.id, *taken}:
                where = f"{document.name}: stages[{i}]"
                raise PipelineError(
                    where,
                    f"{step.id} and {makers[file]} would both write {file}: keep one of "
                    'them, or say "write": false of the other',
                )
            makers[file] = step.id
