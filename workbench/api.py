"""All that a plug-in imports: the stage decorator, its special parameters, artefacts, errors.

A plug-in is a distribution with an entry point in the group `workbench.stages`: the name is its family, the value the
module that defines its stages (docs/pipelines.md).
"""

from workbench.artefacts import (
    Cloud,
    Document,
    Edge,
    EdgeFrames,
    EdgeProfile,
    Gate,
    HandEye,
    Inspection,
    Provenance,
    Recording,
    Requirements,
    Section,
    Verdict,
    frozen,
)
from workbench.errors import InputError, OutputError, PipelineError, WorkbenchError
from workbench.geometry.faces import FaceLines
from workbench.stage import InputFile, Progress, Seed, stage

__all__ = [
    "Cloud",
    "Document",
    "Edge",
    "EdgeFrames",
    "EdgeProfile",
    "FaceLines",
    "Gate",
    "HandEye",
    "InputError",
    "InputFile",
    "Inspection",
    "OutputError",
    "PipelineError",
    "Progress",
    "Provenance",
    "Recording",
    "Requirements",
    "Section",
    "Seed",
    "Verdict",
    "WorkbenchError",
    "frozen",
    "stage",
]
