"""Simple bodies, scanned without a scanner: points on planes with known noise, in frames along the edge."""

import numpy as np

from workbench.artefacts import Part
from workbench.compare.surface_stage import Surface

LENGTH, WIDTH, DEPTH = 40.0, 8.0, 6.0  # mm, of the faces of a rectangular edge along x
AT = np.array([1500.0, 200.0, 800.0])  # where it lies in the base
FRAME_MM = 0.4


def scanned(
    seed: int,
    kind: str = "edge",
    count: int = 9000,
    noise_mm: float = 0.01,
    frame_noise_mm: float = 0.0,
    step_mm: float = 0.0,
) -> Surface:
    """An upper face (normal z), a front face (normal y) and, of a `corner`, an end face (normal x).

    The front face of the middle third of the edge lies `step_mm` farther out. `frame_noise_mm` moves whole frames.
    """
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0.0, 1.0, (2, count))
    face = rng.integers(0, 3 if kind == "corner" else 2, count)
    zero = np.zeros(count)
    faces = [
        np.column_stack([u * LENGTH, -v * WIDTH, zero]),
        np.column_stack([u * LENGTH, zero, -v * DEPTH]),
        np.column_stack([zero + LENGTH, -u * WIDTH, -v * DEPTH]),
    ]
    normals = np.eye(3)[[2, 1, 0]]
    points = np.stack(faces)[face, np.arange(count)]
    frame = np.floor((points[:, 0] + 0.7 * (points[:, 1] + WIDTH)) / FRAME_MM).astype(np.int64)  # oblique
    middle = (face == 1) & (np.abs(points[:, 0] - LENGTH / 2) < LENGTH / 6)
    height = rng.normal(0.0, noise_mm, count) + step_mm * middle
    points = points + height[:, None] * normals[face]
    points += rng.normal(0.0, 1.0, (frame.max() + 1, 3))[frame] * frame_noise_mm
    return Surface(
        points + AT, frame=frame, range_axis=np.array([0.0, -0.6, -0.8]), source=f"scan {seed}", part=Part(part_id="P")
    )


def box() -> Surface:
    """The three faces above as a mesh."""
    x, y, z = LENGTH, WIDTH, DEPTH
    points = AT + np.array([[0, -y, 0], [x, -y, 0], [0, 0, 0], [x, 0, 0], [0, 0, -z], [x, 0, -z], [x, -y, -z]])
    return Surface(points, triangles=np.array([[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4], [3, 1, 6], [3, 6, 5]]))
