"""A drafted mapping as questions: each doubt with its place in the mapping, what was taken, and what else it may be."""

from __future__ import annotations

import json
from collections.abc import Mapping as Tree
from typing import Any, NamedTuple

from pydantic import ValidationError

from workbench.geometry.poses import CONVENTIONS
from workbench.importing.mapping import Mapping

OF_ONE_RECORDING = ("format", "version", "part_id", "recorded_at", "times", "uncertain", "lacking")


class Asked(NamedTuple):
    """One value of the mapping."""

    place: str  # such as profiles.length_unit
    value: Any
    choices: tuple[str, ...]  # none: any value


class Question(NamedTuple):
    """One doubt; it may be about several values, or about none that can be changed."""

    doubt: str  # as the draft has it
    text: str
    asked: tuple[Asked, ...]


def questions(mapping: Tree[str, Any]) -> list[Question]:
    """The doubts of a draft, in its order."""
    return [_question(mapping, doubt) for doubt in mapping.get("uncertain", ())]


def _question(mapping: Tree[str, Any], doubt: str) -> Question:
    head, _, text = doubt.partition(": ")
    values = {place: _value(mapping, place) for place in head.split(", ")}
    if not text or any(value is None for value in values.values()):
        return Question(doubt, doubt, ())
    return Question(
        doubt, text, tuple(Asked(place, value, _choices(mapping, place)) for place, value in values.items())
    )


def _value(mapping: Tree[str, Any], place: str) -> Any:
    part, _, name = place.partition(".")
    found = mapping.get(part)
    return found.get(name) if name and isinstance(found, dict) else found


def _choices(mapping: Tree[str, Any], place: str) -> tuple[str, ...]:
    """What the mapping may say there beside all else that it says."""
    part, _, name = place.partition(".")

    def allowed(value: str) -> bool:
        changed = {**mapping, part: {**mapping[part], name: value} if name else value}
        try:
            Mapping.model_validate_json(json.dumps(changed))
        except ValidationError:
            return False
        return True

    return tuple(filter(allowed, CONVENTIONS if name == "convention" else _named(place)))


def _named(place: str) -> tuple[str, ...]:
    """The values that the schema of a mapping names there."""
    schema = Mapping.model_json_schema()
    found: dict[str, Any] = schema
    for name in place.split("."):
        ways = [found, *found.get("anyOf", ())]
        ways += [schema["$defs"][way["$ref"].rpartition("/")[2]] for way in ways if "$ref" in way]
        found = next((way["properties"][name] for way in ways if name in way.get("properties", {})), {})
    return tuple(next((way["enum"] for way in (found, *found.get("anyOf", ())) if "enum" in way), ()))


def answered(draft: Tree[str, Any], preset: Tree[str, Any]) -> dict[str, Any]:
    """The draft of new files with what a preset says of their form; its doubts are then those that the preset leaves.

    Names of files, and what belongs to one recording, such as the offset of the clocks, are the draft's.
    """
    made = dict(draft)
    for part, said in preset.items():
        own = draft.get(part)
        if part in OF_ONE_RECORDING or (isinstance(said, dict) and "files" in said and own is None):
            continue
        made[part] = {**said, "files": own["files"]} if isinstance(own, dict) and "files" in own else said
    known = set(preset).difference(OF_ONE_RECORDING)
    asked = {name for name, own in draft.items() if isinstance(own, dict) and "files" in own}

    def settled(doubt: str) -> bool:
        question = _question(draft, doubt)
        return {one.place.partition(".")[0] for one in question.asked} <= known if question.asked else asked <= known

    left = [doubt for doubt in draft.get("uncertain", ()) if not settled(doubt)]
    lacking = [text for text in draft.get("lacking", ()) if text.partition(":")[0] not in known]
    return {**made, "uncertain": left, "lacking": lacking}
