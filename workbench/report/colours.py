"""The report's colours: told apart with any colour vision (after Okabe and Ito), and dark enough to print."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, UNLABELLED, UPPER_SURFACE
from workbench.units import AnyArray

INK, GREY, PALE, AIR = "#1b1f24", "#6b7280", "#c9ced6", "#98a1ad"
MEASURED, TOLERANCE, LIMIT, REJECTED = "#0072b2", "#d9efe6", "#00664b", "#8c0f5b"

FACES = {
    ROOT_FACE: "#d55e00",
    BEVEL_FACE: "#0072b2",
    UPPER_SURFACE: "#8fa3ad",
    LOWER_SURFACE: "#b79f6a",
    UNLABELLED: "#d5d9de",
}
LOWER_EDGE, UPPER_EDGE = "#0072b2", "#d55e00"
TOOL_AXES = ("#d55e00", "#009e73", "#0072b2")  # x, y, z of a key point
VERDICTS = {"pass": "#00664b", "fail": "#a8200d", "undecided": "#8a5a00"}
SIGNS = {"pass": "✓", "fail": "✕", "undecided": "?"}


def rgb(colour: str) -> tuple[int, int, int]:
    """'#rrggbb' as red, green, blue from 0 to 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def face_shades() -> AnyArray:
    """(256, 3) uint8: the colour of each face label."""
    return np.array([rgb(FACES.get(label, FACES[UNLABELLED])) for label in range(256)], dtype=np.uint8)
