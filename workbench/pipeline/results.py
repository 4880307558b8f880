"""Results as files: which artefact becomes which file, in strict JSON (null for what was not measured)."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from workbench.artefacts import Document, Inspection, Section
from workbench.errors import PipelineError

RUN_FILE = "run.json"


def inspection_document(inspection: Inspection) -> dict[str, Any]:
    """`inspection.json`, version 1 (docs/pipelines.md): mm and degrees, frame of the robot base."""
    return {
        "format": "bevel-inspection",
        "version": 1,
        "frame": "base",
        "verdict": inspection.verdict,
        "reason": inspection.reason,
        "guard_factor": inspection.guard_factor,
        "root_face_tilt": inspection.root_face_tilt,
        "requirements": dataclasses.asdict(inspection.requirements),
        "warnings": list(inspection.warnings),
        "sections": [_section(section) for section in inspection.sections],
        "profile": {f.name: getattr(inspection.profile, f.name) for f in dataclasses.fields(inspection.profile)},
    }


def _section(section: Section) -> dict[str, Any]:
    return {f.name: getattr(section, f.name) for f in dataclasses.fields(section) if f.name != "frames"}


# One line a type: artefacts that stand for a result of the contract. Others are seen by later stages only; a plug-in
# that makes a file of its own returns a `Document`.
WRITERS: dict[type, tuple[str, Callable[[Any], dict[str, Any]]]] = {
    Inspection: ("inspection.json", inspection_document),
}


def file_of(kind: type) -> str | None:
    """The result file that an artefact type becomes; None: none, or known only when it runs."""
    return next((name for made, (name, _) in WRITERS.items() if issubclass(kind, made)), None)


def result_files(artefacts: Iterable[Any]) -> dict[str, bytes]:
    """File name -> content for everything among the artefacts that is a result."""
    files: dict[str, bytes] = {}
    for artefact in artefacts:
        for kind, (name, document) in WRITERS.items():
            if isinstance(artefact, kind):
                files[name] = strict_json(document(artefact))
        if isinstance(artefact, Document):
            if not is_plain_name(artefact.name) or artefact.name in (*files, RUN_FILE):
                raise PipelineError(f"result {artefact.name!r}", "expected a file name of its own, without directories")
            files[artefact.name] = artefact.content
    return files


def is_plain_name(name: Any) -> bool:
    """Whether `name` can only be a visible file inside the output directory."""
    return isinstance(name, str) and name.isprintable() and not ({"/", "\\"} & {*name}) and name[:1] not in ("", ".")


def strict_json(document: Mapping[str, Any]) -> bytes:
    """A JSON object, one member a line, one entry a line in a list of objects; NaN becomes null."""
    members = (f"{json.dumps(key)}: {_lines(plain(value))}" for key, value in document.items())
    return ("{\n  " + ",\n  ".join(members) + "\n}\n").encode()


def _lines(value: Any) -> str:
    if isinstance(value, list) and value and all(isinstance(part, dict) for part in value):
        return "[\n    " + ",\n    ".join(json.dumps(part, allow_nan=False) for part in value) + "\n  ]"
    return json.dumps(value, allow_nan=False)


def plain(value: Any) -> Any:
    """`value` as JSON knows it: arrays as lists, what is not finite as null, anything else as text."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return value if value is None or isinstance(value, str | int) else str(value)
