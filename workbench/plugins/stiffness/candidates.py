"""Postures and loads that a loading test could use, and what each would tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.api import Cell, CollisionModel, Float, LoadingSetup
from workbench.plugins.stiffness.elastic import MM
from workbench.plugins.stiffness.equations import covariances, equations
from workbench.plugins.stiffness.values import LoadingTests


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """P postures with the same D loads each; a load is a pair of opposite forces."""

    joints: Float  # (P, 6) rad
    points_mm: Float  # (D, 3) where the force acts, in the flange frame
    force_n: Float  # (D, 3) in the flange's axes
    wrench: Float  # (D, 6) N, Nm in the sensor frame
    information: Float  # (P, D, 6, 6) of the logarithm of the stiffness, of a pair


def free_postures(cell: Cell, wanted: int, rng: np.random.Generator) -> Float:
    """Random postures (n, 6), rad, within limits and free of collision; fewer than wanted in a narrow cell.

    The wrist keeps away from its singularity, and joints 4 and 6 within one turn.
    """
    low, high = np.maximum(cell.chain.limits[:, 0], -np.pi), np.minimum(cell.chain.limits[:, 1], np.pi)
    model, found = CollisionModel(cell), []
    for _ in range(20 * wanted):
        q = rng.uniform(low, high)
        if abs(np.sin(q[4])) > 0.3 and model.collision(q) is None:
            found.append(q)
            if len(found) == wanted:
                break
    return np.array(found).reshape(-1, 6)


def candidates(
    cell: Cell, setup: LoadingSetup, stiffness: Float, joints: Float, force_n: float, targets: int
) -> Candidates:
    """What pairs of opposite forces at the cell's load points would tell at given postures (P, 6)."""
    directions = _directions()
    at = np.repeat(setup.load_points_mm, len(directions), axis=0)
    force = np.tile(directions * force_n, (len(setup.load_points_mm), 1))
    wrench = _at_sensor(setup, at, force)
    count, loads = len(joints), len(wrench)
    tests = LoadingTests(
        source="plan",
        labels=("",) * (count * loads),
        lines=(0,) * (count * loads),
        joints=np.repeat(joints, loads, axis=0),
        wrench=np.tile(wrench, (count, 1)),
        displacement=None if targets else np.zeros((count * loads, 6)),
        targets_mm=np.zeros((count * loads, targets, 3)) if targets else None,
    )
    eq = equations(cell.chain, setup, tests)
    relative = eq.a / stiffness
    weighted = np.linalg.solve(covariances(eq, 1 / stiffness), relative)
    information = 2 * np.swapaxes(relative, 1, 2) @ weighted
    return Candidates(joints, at, force, wrench, information.reshape(count, loads, 6, 6))


def _directions() -> Float:
    """13 unit directions: axes, diagonals of faces and of the cube; their opposites belong to the pairs."""
    grid = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], float)
    half = grid[14:]  # behind the middle: one of each opposite two
    return np.asarray(half / np.linalg.norm(half, axis=1, keepdims=True))


def _at_sensor(setup: LoadingSetup, point_mm: Float, force: Float) -> Float:
    """Wrenches (D, 6) in the sensor frame of forces at points of the flange."""
    rotation, origin = setup.flange_from_sensor[:3, :3], setup.flange_from_sensor[:3, 3]
    moment = np.cross(point_mm - origin, force) / MM
    return np.hstack([force @ rotation, moment @ rotation])
