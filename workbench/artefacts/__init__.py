"""The values that stages exchange. Frozen: a stage takes artefacts and returns new ones.

Lengths in mm, times in s, angles in rad unless a name ends in `_deg`; `a_from_b` maps coordinates in b to a.
N frames, M columns, K robot poses. NaN marks what was not measured.
"""

from workbench.artefacts.checks import Check
from workbench.artefacts.decisions import Gate, Provenance, RobotCell
from workbench.artefacts.edges import (
    BEVEL_FACE,
    DECLARED,
    DIRECTIONS,
    END,
    FACE_NAMES,
    FORM,
    KINDS,
    LOWER_SURFACE,
    PASSES,
    ROOT_FACE,
    ROUNDING,
    TANGENT,
    UNLABELLED,
    UPPER_SURFACE,
    Edge,
    MilledEdge,
    Quantity,
    RawEdge,
)
from workbench.artefacts.grooves import (
    SIZES,
    Corner,
    Groove,
    GrooveInspection,
    GrooveSection,
    GrooveType,
    Preparation,
    PreparationInspection,
    u_name,
)
from workbench.artefacts.inspections import (
    EdgeProfile,
    Inspection,
    Requirements,
    Section,
    Uncertainty,
    UncertaintySource,
    Verdict,
    conformity,
)
from workbench.artefacts.milling import Engagement, LayerEngagement, PathCorrection, Rework, Stretch
from workbench.artefacts.pages import Chapter, Document, Mark, Scene, Shading, Strokes
from workbench.artefacts.parts import LINEAR_AXIS, NO_NAMES, UNKNOWN_PART, Part, PartNames
from workbench.artefacts.paths import ChainU, Cutter, Layer, Moves, PathDeflection, PathGate, Postures, Toolpath, Travel
from workbench.artefacts.programs import (
    EventKind,
    Judgement,
    ProgramEvent,
    ProgramMove,
    ProgramMoves,
    ProgramTool,
    Violation,
)
from workbench.artefacts.scans import Cloud, HandEye, PointSet, Recording
from workbench.artefacts.showing import shown_all
from workbench.geometry.faces import FaceLines
from workbench.units import frozen

__all__ = [
    "BEVEL_FACE",
    "DECLARED",
    "DIRECTIONS",
    "END",
    "FACE_NAMES",
    "FORM",
    "KINDS",
    "LINEAR_AXIS",
    "LOWER_SURFACE",
    "NO_NAMES",
    "PASSES",
    "ROOT_FACE",
    "ROUNDING",
    "SIZES",
    "TANGENT",
    "UNKNOWN_PART",
    "UNLABELLED",
    "UPPER_SURFACE",
    "ChainU",
    "Chapter",
    "Check",
    "Cloud",
    "Corner",
    "Cutter",
    "Document",
    "Edge",
    "EdgeProfile",
    "Engagement",
    "EventKind",
    "Gate",
    "Groove",
    "GrooveInspection",
    "GrooveSection",
    "GrooveType",
    "HandEye",
    "Inspection",
    "Judgement",
    "Layer",
    "LayerEngagement",
    "Mark",
    "MilledEdge",
    "Moves",
    "Part",
    "PartNames",
    "PathCorrection",
    "PathDeflection",
    "PathGate",
    "PointSet",
    "Postures",
    "Preparation",
    "PreparationInspection",
    "ProgramEvent",
    "ProgramMove",
    "ProgramMoves",
    "ProgramTool",
    "Provenance",
    "Quantity",
    "RawEdge",
    "Recording",
    "Requirements",
    "Rework",
    "RobotCell",
    "Scene",
    "Section",
    "Shading",
    "Stretch",
    "Strokes",
    "Toolpath",
    "Travel",
    "Uncertainty",
    "UncertaintySource",
    "Verdict",
    "Violation",
    "conformity",
    "frozen",
    "u_name",
]

shown_all(FaceLines, *(globals()[_name] for _name in __all__))
del shown_all, FaceLines
