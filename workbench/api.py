"""All that a plug-in imports: the stage decorator, its special parameters, artefacts, errors.

A plug-in is a distribution with an entry point in the group `workbench.stages`: the name is its family, the value the
module that defines its stages (docs/pipelines.md).
"""

from workbench.artefacts import (
    Chapter,
    Cloud,
    Cutter,
    Document,
    Edge,
    EdgeFrames,
    EdgeProfile,
    Engagement,
    Gate,
    HandEye,
    Inspection,
    Layer,
    LayerEngagement,
    Moves,
    Provenance,
    Recording,
    Requirements,
    Rework,
    Section,
    Stretch,
    Toolpath,
    Travel,
    Verdict,
    frozen,
)
from workbench.dialect import Dialect, MillingTool, ProgramJob, write_program
from workbench.errors import InputError, OutputError, PipelineError, WorkbenchError
from workbench.geometry.faces import FaceLines
from workbench.stage import InputFile, Progress, Seed, stage

__all__ = [
    "Chapter",
    "Cloud",
    "Cutter",
    "Dialect",
    "Document",
    "Edge",
    "EdgeFrames",
    "EdgeProfile",
    "Engagement",
    "FaceLines",
    "Gate",
    "HandEye",
    "InputError",
    "InputFile",
    "Inspection",
    "Layer",
    "LayerEngagement",
    "MillingTool",
    "Moves",
    "OutputError",
    "PipelineError",
    "ProgramJob",
    "Progress",
    "Provenance",
    "Recording",
    "Requirements",
    "Rework",
    "Section",
    "Seed",
    "Stretch",
    "Toolpath",
    "Travel",
    "Verdict",
    "WorkbenchError",
    "frozen",
    "stage",
    "write_program",
]
