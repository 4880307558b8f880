"""Results as files: which artefact becomes which file, in strict JSON (null for what was not measured)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from workbench.artefacts import (
    Document,
    Engagement,
    GrooveInspection,
    Inspection,
    Layer,
    PathCorrection,
    PathGate,
    PreparationInspection,
    Rework,
    Toolpath,
)
from workbench.artefacts.edges import BEVEL_TERMS, JointInspection, RecognisedInspection
from workbench.artefacts.evidence import UNSEEN, Unseen
from workbench.artefacts.paths import CANCELS, NOT_INCLUDED
from workbench.errors import PipelineError
from workbench.strict_json import content_digest, strict_json
from workbench.units import DEG

RUN_FILE = "run.json"


def inspection_document(found: JointInspection) -> dict[str, Any]:
    """`inspection.json`, `groove.json`, `preparation.json`, version 1 (docs/pipelines.md): mm, degrees, the base."""
    table = found.characteristics
    columns = [list(zip(one.pairs, one.verdicts, strict=True)) for one in table]
    return {
        "format": found.FORMAT,
        "version": 1,
        "frame": "base",
        **_particular(found),
        "verdict": found.verdict,
        "reason": found.reason,
        "guard_factor": found.guard_factor,
        "part": dataclasses.asdict(found.part),
        "requirements": dict(found.requirements_in_file),
        "uncertainty": {
            "coverage_factor": found.uncertainty.coverage_factor,
            "sources": list(found.sources),
            "not_included": [one.told for one in found.uncertainty.not_included],
            "correlations": found.uncertainty.correlations,
        },
        "not_included": [_unseen(one) for one in found.uncertainty.not_included],
        "conditions": [_unseen(one) for one in found.conditions],
        "warnings": list(found.warnings),
        "checks": [dataclasses.asdict(check) for check in found.checks],
        "sections": [
            {
                **{name: getattr(section, name) for name in SECTION},
                **({"corners": section.corners} if isinstance(found, RecognisedInspection) else {}),
                **section.values,
                "quantities": [
                    {"name": one.name, "value": value, "u": u, "unit": one.quantity.unit, "verdict": verdict}
                    for one, column in zip(table, columns, strict=True)
                    for pair, verdict in (column[k],)
                    for value, u in (pair or (None, None),)
                ],
                "verdict": section.verdict,
                "reason": section.reason,
            }
            for k, section in enumerate(found.sections)
        ],
    }


def _unseen(one: Unseen) -> dict[str, Any]:
    """What a recording does not show, with what it may cost."""
    return {
        "name": one.name,
        "sentence": one.sentence,
        **dict.fromkeys(BEVEL_TERMS, 0.0 if one.costs else None),
        **one.costs,
    }


SECTION = ("index", "arc_length_mm", "origin_mm", "tangent", "normal", "across")


def _particular(found: JointInspection) -> dict[str, Any]:
    """What only one sort of joint has."""
    if isinstance(found, Inspection):
        return {
            "root_face_tilt": found.root_face_tilt,
            "profile": {f.name: getattr(found.profile, f.name) for f in dataclasses.fields(found.profile)},
        }
    if isinstance(found, RecognisedInspection):
        return {
            "type": found.type,
            "type_alternatives": list(found.alternatives),
            "type_declared": found.declared,
        }
    return {}


def toolpath_document(path: Toolpath, gate: PathGate | None = None) -> dict[str, Any]:
    """`toolpath.json`, version 1 (docs/pipelines.md): mm, quaternions w x y z, mm/s.

    `check` is what `gate` said of this path, with the digest of all the rest: `path.check_file` believes it only of a
    path that was not changed since.
    """
    work = path.base_from_workobject
    document = {
        "format": "bevel-toolpath",
        "version": 1,
        "frame": "base" if work is None else "workobject",
        **({} if work is None else {"base_from_workobject": work}),
        "part": dataclasses.asdict(path.part),
        "cutter": {name: each for name, each in dataclasses.asdict(path.cutter).items() if each or name != "ball_end"},
        "requirements": {
            "root_mm": path.root_mm,
            "bevel_deg": path.bevel_deg,
            "depth_of_cut_mm": path.depth_of_cut_mm,
            **({"root_radius_mm": path.root_radius_mm} if path.root_radius_mm else {}),
        },
        "edge_length_mm": path.edge_length_mm,
        **({} if path.chain is None else {"chain": dataclasses.asdict(path.chain)}),
        **(
            {}
            if path.finishing is None
            else {"finish_allowance_mm": path.finish_allowance_mm, "finishing": toolpath_document(path.finishing)}
        ),
        "refused": list(path.refused),
        "warnings": list(path.warnings),
        "evidence": [dataclasses.asdict(check) for check in path.evidence],
        "not_included": list(UNSEEN),
        "layers": [_layer(layer) for layer in path.layers],
        "travels": [{"points": _rows(travel, POSE_COLUMNS)} for travel in path.travels],
    }
    if gate is None:
        return document
    said = {
        "passed": gate.passed,
        "reason": gate.reason,
        "loosened": list(gate.loosened),
        "placed": not gate.shape_only,
    }
    return {**document, "check": {**said, "unchecked": list(gate.unchecked), "sha256": content_digest(document)}}


POSE_COLUMNS = ("position_mm", "quaternion_wxyz", "feed_mm_s")
POINT_COLUMNS = ("arc_length_mm", *POSE_COLUMNS, "cutting", "measured", "width_mm")


def _layer(layer: Layer) -> dict[str, Any]:
    return {"index": layer.index, "height_mm": layer.height_mm, "points": _rows(layer, POINT_COLUMNS)}


def _rows(table: Any, columns: tuple[str, ...]) -> list[dict[str, Any]]:
    """A frozen table's columns as one object a row."""
    values = [getattr(table, name).tolist() for name in columns]
    return [dict(zip(columns, row, strict=True)) for row in zip(*values, strict=True)]


def engagement_document(engagement: Engagement) -> dict[str, Any]:
    """`engagement.json`: what the cutter meets along each layer (docs/pipelines.md): mm and mm^2."""
    return {
        "part": dataclasses.asdict(engagement.part),
        "layers": [{f.name: getattr(layer, f.name) for f in dataclasses.fields(layer)} for layer in engagement.layers],
    }


def rework_document(rework: Rework) -> dict[str, Any]:
    """`rework.json` (docs/pipelines.md): the stretches by arc length in mm, and the path to mill if there is one."""
    return {
        "part": dataclasses.asdict(rework.part),
        "reason": rework.reason,
        "too_much_material": [dataclasses.asdict(stretch) for stretch in rework.too_much_material],
        "too_little_material": [dataclasses.asdict(stretch) for stretch in rework.too_little_material],
        "toolpath": None if rework.toolpath is None else toolpath_document(rework.toolpath),
    }


def correction_document(found: PathCorrection) -> dict[str, Any]:
    """`correction.json`, version 1 (docs/pipelines.md): what the finishing pass is moved and turned by, mm and degrees.

    A cut shows its displacement along the bevel's normal b only: the parts along n and along m are those of one shift.
    """
    columns = {
        "arc_length_mm": found.arc_length_mm,
        "along_n_mm": found.shift_mm * math.cos(found.bevel),
        "along_n_u_mm": found.displacement_u_mm * math.cos(found.bevel),
        "along_m_mm": found.shift_mm * math.sin(found.bevel),
        "along_m_u_mm": found.displacement_u_mm * math.sin(found.bevel),
        "tilt_deg": found.tilt / DEG,
        "tilt_u_deg": found.turn_u / DEG,
        "measured_displacement_mm": found.displacement_mm,
        "measured_displacement_u_mm": found.displacement_u_mm,
        "measured_tilt_deg": found.turn / DEG,
        "stock_mm": found.stock_mm,
        "cutting": found.cut,
    }
    if found.batch is not None:
        batch = found.batch.on(found.arc_length_mm)
        columns |= {"batch_displacement_mm": batch.shift_mm, "batch_tilt_deg": batch.turn / DEG}
    over = (found.arc_length_mm >= 0.0) & (found.arc_length_mm <= found.length_mm)
    rows = zip(*(column[over].tolist() for column in columns.values()), strict=True)
    return {
        "part": dataclasses.asdict(found.part),
        "frame": "section",
        "allowance_mm": found.allowance_mm,
        "refused": found.refused,
        "reason": found.reason,
        "batch": None
        if found.batch is None
        else {
            "parts": found.batch.parts,
            "length_mm": found.length_mm,
            "bevel_deg": found.bevel / DEG,
            "scatter_mm": found.batch.shift_scatter_mm,
            "scatter_deg": found.batch.turn_scatter / DEG,
            **found.batch.shared,
        },
        "stations": [dict(zip(columns, row, strict=True)) for row in rows],
        "checks": [dataclasses.asdict(check) for check in found.checks],
        "uncertainty": {
            "repeatability_mm": found.repeatability_mm,
            "variation_mm": found.variation_mm,
            "cancels": list(CANCELS),
            "not_included": list(NOT_INCLUDED),
        },
    }


# One line a type: artefacts that stand for a result of the contract. Others are seen by later stages only; a plug-in
# that makes a file of its own returns a `Document`.
WRITERS: dict[type, tuple[str, Callable[[Any], dict[str, Any]]]] = {
    Inspection: ("inspection.json", inspection_document),
    Toolpath: ("toolpath.json", toolpath_document),
    Engagement: ("engagement.json", engagement_document),
    Rework: ("rework.json", rework_document),
    PathCorrection: ("correction.json", correction_document),
    GrooveInspection: ("groove.json", inspection_document),
    PreparationInspection: ("preparation.json", inspection_document),
}


def file_of(kind: type) -> str | None:
    """The result file that an artefact type becomes; None: none, or known only when it runs."""
    return next((name for made, (name, _) in WRITERS.items() if issubclass(kind, made)), None)


def result_files(artefacts: Iterable[Any], gates: Sequence[PathGate] = ()) -> dict[str, bytes]:
    """File name -> content for everything among the artefacts that is a result; `gates` decided on paths."""
    files: dict[str, bytes] = {}
    for artefact in artefacts:
        for kind, (name, document) in WRITERS.items():
            if isinstance(artefact, kind):
                files[name] = written(name, document(artefact))
        if isinstance(artefact, Toolpath) and (gate := _gate_of(artefact, gates)):
            files["toolpath.json"] = written("toolpath.json", toolpath_document(artefact, gate))
        if isinstance(artefact, Document):
            if not is_plain_name(artefact.name) or artefact.name in (*files, RUN_FILE):
                raise PipelineError(f"result {artefact.name!r}", "expected a file name of its own, without directories")
            files[artefact.name] = checked(artefact)
    return files


def checked(document: Document) -> bytes:
    """The bytes of a file that a stage has made, as its model has them where it is a result file."""
    if document.name.endswith(".json"):
        from workbench.result_files import RESULT_FILES

        if model := RESULT_FILES.get(document.name):
            model.model_validate_json(document.content)
    return document.content


def written(name: str, document: Mapping[str, Any]) -> bytes:
    """The bytes of a result file, as its model has them where it has one."""
    from workbench.result_files import RESULT_FILES

    model = RESULT_FILES.get(name)
    return model.written(document) if model else strict_json(document)


def _gate_of(path: Toolpath, gates: Sequence[PathGate]) -> PathGate | None:
    """The decision on this path: a refusal where there is one, else the last."""
    own = sorted((gate for gate in gates if gate.toolpath is path), key=lambda gate: not gate.passed)
    return own[-1] if own else None


def is_plain_name(name: Any) -> bool:
    """Whether `name` can only be a visible file inside the output directory."""
    return isinstance(name, str) and name.isprintable() and not ({"/", "\\"} & {*name}) and name[:1] not in ("", ".")
