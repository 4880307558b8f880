"""Result files as pydantic models: what a run writes is checked by them, what it reads comes through them, and
`workbench schema RESULT` prints them. Keys may be added to a file; what stands here must be there.

Lengths in mm, angles in degrees where a name says so, null for what was not measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from workbench.artefacts import Document
from workbench.result_files import contract, scan_plan, sensor, studies
from workbench.result_files.contract import (
    BatchPartFile,
    HandEyeFile,
    InspectionFile,
    PostureFile,
    ResultFile,
    StiffnessFile,
    ToolpathFile,
)
from workbench.result_files.scan_plan import ScanPlanFile
from workbench.result_files.sensor import SensorFile
from workbench.result_files.studies import (
    ChatterFile,
    CoefficientsFile,
    ModesFile,
    RobotFile,
    SubmissionFile,
    ToolFile,
    TruthFile,
    TurntableFile,
)

RESULT_FILES: dict[str, type[ResultFile]] = {
    model.NAME: model
    for module in (contract, studies, sensor, scan_plan)
    for model in vars(module).values()
    if isinstance(model, type) and issubclass(model, ResultFile) and "NAME" in vars(model)
}


def result_file(name: str, content: Mapping[str, Any]) -> Document:
    """A result file as a stage returns it: what its model accepts, its format and version first."""
    return Document(name, RESULT_FILES[name].written(content))


def result_schema(name: str) -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of the result file `name`."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **RESULT_FILES[name].model_json_schema()}


__all__ = [
    "RESULT_FILES",
    "BatchPartFile",
    "ChatterFile",
    "CoefficientsFile",
    "HandEyeFile",
    "InspectionFile",
    "ModesFile",
    "PostureFile",
    "ResultFile",
    "RobotFile",
    "ScanPlanFile",
    "SensorFile",
    "StiffnessFile",
    "SubmissionFile",
    "ToolFile",
    "ToolpathFile",
    "TruthFile",
    "TurntableFile",
    "result_file",
    "result_schema",
]
