"""Data sets whose least-squares answer is known exactly.

Feet lie on a known shape; residuals along its normals are orthogonal to every column of the Jacobian there, so the
gradient of the sum of squares vanishes at the known parameters (null-space construction; Cox, Forbes and others, "The
design and use of reference data sets for testing scientific software", Anal. Chim. Acta 380, 1999).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.geometry.fits import Shape
from workbench.units import Float

FAR_MM = 1e6


@dataclass
class Known:
    """Points and the shape that fits them best: in its own frame about the origin, then moved."""

    points_mm: Float
    centre_mm: Float
    axis: Float
    size_mm: float


def known(shape: Shape, seed: int, arc_deg: float, far: bool) -> Known:
    rng = np.random.default_rng([seed, int(arc_deg), far])
    count, size = int(rng.integers(12, 80)), float(10 ** rng.uniform(1, 3))
    feet, normals, jacobian = CONSTRUCTION[shape](rng, count, np.deg2rad(arc_deg))
    residual = rng.normal(size=len(jacobian))
    columns = np.linalg.qr(jacobian)[0]
    for _ in range(2):
        residual -= columns @ (columns.T @ residual)
    height = 1 - np.cos(min(np.deg2rad(arc_deg), np.pi) / 2)  # of the arc over its chord: the shape must show
    residual *= 0.02 * height / np.abs(residual).max()
    local = feet + sum(r[:, None] * n for r, n in zip(residual.reshape(-1, count), normals, strict=True))
    turn = Rotation.random(random_state=rng).as_matrix()
    at = rng.uniform(-1, 1, 3) * (FAR_MM if far else 100.0)
    return Known(size * local @ turn.T + at, at, turn[:, 2], size)


def line(rng: np.random.Generator, count: int, _: float) -> tuple[Float, list[Float], Float]:
    h, zero, one = rng.uniform(-1, 1, count), np.zeros(count), np.ones(count)
    x, y = np.column_stack([one, zero, zero]), np.column_stack([zero, one, zero])
    half = np.column_stack([one, h])
    return np.column_stack([zero, zero, h]), [x, y], np.kron(np.eye(2), half)


def plane(rng: np.random.Generator, count: int, _: float) -> tuple[Float, list[Float], Float]:
    u, v = rng.uniform(-1, 1, (2, count))
    normal = np.tile([0.0, 0.0, 1.0], (count, 1))
    return np.column_stack([u, v, 0 * u]), [normal], np.column_stack([np.ones(count), u, v])


def circle(rng: np.random.Generator, count: int, arc: float) -> tuple[Float, list[Float], Float]:
    angle = rng.uniform(-arc / 2, arc / 2, count)
    radial = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    up, none = np.tile([0.0, 0.0, 1.0], (count, 1)), np.zeros((count, 3))
    inside = np.column_stack([radial[:, :2], np.ones(count)])
    off = np.column_stack([np.ones(count), radial[:, :2]])
    return radial, [radial, up], np.block([[inside, none], [none, off]])


def sphere(rng: np.random.Generator, count: int, arc: float) -> tuple[Float, list[Float], Float]:
    away, around = np.arccos(rng.uniform(np.cos(arc / 2), 1, count)), rng.uniform(0, 2 * np.pi, count)
    normal = np.column_stack([np.sin(away) * np.cos(around), np.sin(away) * np.sin(around), np.cos(away)])
    return normal, [normal], np.column_stack([normal, np.ones(count)])


def cylinder(rng: np.random.Generator, count: int, arc: float) -> tuple[Float, list[Float], Float]:
    angle, h = rng.uniform(-arc / 2, arc / 2, count), rng.uniform(-1, 1, count) * max(arc, 0.5)
    normal = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    jacobian = np.column_stack([normal[:, :2], h[:, None] * normal[:, :2], np.ones(count)])
    return normal + np.outer(h, [0.0, 0.0, 1.0]), [normal], jacobian


CONSTRUCTION = {"line": line, "plane": plane, "circle": circle, "sphere": sphere, "cylinder": cylinder}
