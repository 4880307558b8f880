"""`stiffness.plan_loads`: which loading tests determine all six joints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.api import (
    DEG,
    AngleConvention,
    Cell,
    CollisionModel,
    Document,
    Float,
    InputError,
    Int,
    LoadingSetup,
    Seed,
    Shaped,
    abb_angles,
    stage,
    within_limits,
)
from workbench.plugins import design
from workbench.plugins.csv_table import csv_bytes
from workbench.plugins.ranges import AsBuiltU, Positive, RelativeU, ScaleU, Targets
from workbench.plugins.stiffness.beyond_springs import promised
from workbench.plugins.stiffness.elastic import wrench_at
from workbench.plugins.stiffness.equations import covariances, equations
from workbench.plugins.stiffness.read_stage import ANGLES, WRENCH
from workbench.plugins.stiffness.values import JointStiffness, LoadingTests, LoadPlan, Six, moved_columns

# Postures and loads that a loading test could use, and what each would tell.


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """P postures with the same D loads each; a load is a pair of opposite forces."""

    joints: Shaped[Float, "P 6"]  # rad
    points_mm: Shaped[Float, "D 3"]  # where the force acts, in the flange frame
    force_n: Shaped[Float, "D 3"]  # in the flange's axes
    wrench: Shaped[Float, "D 6"]  # N, Nm in the sensor frame
    information: Shaped[Float, "P D 6 6"]  # of the logarithm of the stiffness, of a pair


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
    # 13 unit directions: axes, diagonals of faces and of the cube; their opposites belong to the pairs
    grid = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], float)
    half = grid[14:]  # behind the middle: one of each opposite two
    directions = half / np.linalg.norm(half, axis=1, keepdims=True)
    at = np.repeat(setup.load_points_mm, len(directions), axis=0)
    force = np.tile(directions * force_n, (len(setup.load_points_mm), 1))
    turn, origin = setup.flange_from_sensor[:3, :3].T, setup.flange_from_sensor[:3, 3]
    wrench = wrench_at(turn, (at - origin) @ turn.T, np.hstack([force, np.zeros_like(force)]))
    count, loads = len(joints), len(wrench)
    every = ("",) * (count * loads)
    tests = _tests(every, np.repeat(joints, loads, axis=0), np.tile(wrench, (count, 1)), targets)
    eq = equations(cell.chain, setup, tests)
    relative = eq.a / stiffness
    weighted = np.linalg.solve(covariances(eq, 1 / stiffness), relative)
    information = 2 * relative.mT @ weighted
    return Candidates(joints, at, force, wrench, information.reshape(count, loads, 6, 6))


def _tests(labels: tuple[str, ...], joints: Float, wrench: Float, targets: int) -> LoadingTests:
    """Tests (L) that are still to be made: nothing has moved."""
    moved = np.zeros((len(labels), len(moved_columns(targets))))
    return LoadingTests("plan", labels, (0,) * len(labels), joints, wrench, moved, targets)


@stage("stiffness.plan_loads")
def plan_loads(
    cell: Cell,
    stiffness: JointStiffness,
    *,
    postures_deg: Annotated[list[Six] | None, Field(min_length=1)] = None,
    angle_convention: AngleConvention = "abb",
    postures: Annotated[int, Field(ge=1, le=20)] = 3,
    loads_per_posture: Annotated[int, Field(ge=2, le=400)] = 40,
    force_n: Positive = 200.0,
    target_relative_u: RelativeU = 0.025,
    scale_relative_u: ScaleU = 0.02,
    as_built_u: AsBuiltU = 1.0,
    targets: Targets = 0,
    trials: Annotated[int, Field(ge=10, le=5000)] = 150,
    seed: Seed = 0,
) -> tuple[LoadPlan, Document]:
    """Plan loading tests that determine the worst joint best.

    Pairs of opposite forces at the cell's load points are added until every joint reaches the target. What is promised
    is what `stiffness.identify` will state.

    Args:
        cell: the cell; chosen postures are within limits and free of collision in it.
        stiffness: as expected, for instance of a sister robot.
        postures_deg: postures to load at; null: choose them.
        angle_convention: as in `stiffness.deflection`.
        postures: largest count of postures, where they are chosen.
        loads_per_posture: largest count of loads at a posture.
        force_n: of each load.
        target_relative_u: ratio of standard uncertainty, by noise alone, to stiffness to reach for every joint.
        scale_relative_u: ratio of the two scales, as in `stiffness.identify`.
        as_built_u: factor on u of what is not as built, as in `stiffness.identify`.
        targets: count of tracked points; 0: the tool frame's displacement in six dimensions.
        trials: count of random postures to choose from.
        seed: of these.

    Raises:
        InputError: the cell has no load points or too few targets; a posture is out of limits or collides; no posture
            is free.

    Example:
        >>> from workbench import robot
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> loads, *files = stiffness.plan_loads(cell, stiffness.read(cell))
        >>> loads.relative_u.shape
        (6,)
    """
    where, setup = f"{cell.source}: $.loading", cell.loading
    if setup is None or not len(setup.load_points_mm):
        raise InputError(where, "expected load_points_mm, where forces can be applied")
    if targets and not 3 <= targets <= len(setup.targets_mm):
        raise InputError(f"{where}.targets_mm", f"expected three or more, and as many as asked for ({targets})")
    if postures_deg is None:
        joints = free_postures(cell, trials, np.random.default_rng(seed))
        if not len(joints):
            raise InputError(cell.source, "expected a cell with free postures, found none by trial")
    else:
        joints = abb_angles(np.array(postures_deg, float) * DEG, angle_convention)
        _check_postures(cell, joints)
        postures = len(joints)
    offered = candidates(cell, setup, stiffness.nm_per_rad, joints, force_n, targets)
    chosen = choose(offered.information, postures, loads_per_posture // 2, target_relative_u)
    found = _plan(offered, chosen, target_relative_u)
    compliance, tests = 1.0 / stiffness.nm_per_rad, _tests(found.labels, found.joints, found.wrench, targets)
    u2 = np.diag(promised(cell.chain, setup, tests, compliance, as_built_u)) / compliance**2
    found = replace(found, relative_u=np.sqrt(u2 + scale_relative_u**2))
    # a table for the shop floor: where to load, which way, and the wrench that the sensor should then show
    names = ("px_mm", "py_mm", "pz_mm", "force_x_n", "force_y_n", "force_z_n")
    known, by_noise = (", ".join(f"{100 * one:.2f} %" for one in u) for u in (found.relative_u, found.noise_relative_u))
    comment = (
        "# point and force in the flange frame; wrench as the sensor sees it (nominal). "
        f"Joints will be known to (u): {known}; by noise alone: {by_noise}"
    )
    values = np.hstack([found.joints / DEG, found.points_mm, found.force_n, found.wrench])
    rows = ([label, *(f"{v + 0.0:.4f}" for v in row)] for label, row in zip(found.labels, values, strict=True))
    table = f"{comment}\n".encode() + csv_bytes(["posture", *ANGLES, *names, *WRENCH], rows)
    return found, Document("load_plan.csv", table)


def _check_postures(cell: Cell, joints: Float) -> None:
    model = CollisionModel(cell)
    for i, q in enumerate(joints, 1):
        inside = within_limits(cell.chain, q, q)
        if np.isnan(inside).any():
            axis = int(np.flatnonzero(np.isnan(inside))[0]) + 1
            raise InputError(f"posture {i}", f"expected angles within the robot's limits: joint {axis} is beyond")
        pair = model.collision(inside)
        if pair is not None:
            raise InputError(f"posture {i}", f"expected a posture free of collision: {pair[0]} meets {pair[1]}")


def _plan(offered: Candidates, chosen: list[tuple[int, int]], target: float) -> LoadPlan:
    """The chosen pairs, posture by posture, each as two loads."""
    chosen = sorted(chosen)
    p, d = np.array(chosen).T
    information = offered.information[p, d].sum(axis=0) + np.eye(6) * 1e-12
    u = relative_u(information)
    names = {int(one): str(i) for i, one in enumerate(sorted(set(p.tolist())), 1)}
    sign = np.tile([1.0, -1.0], len(p))[:, None]
    warnings = []
    if u.max() > target:
        needed = int(np.ceil(2 * len(p) * (u.max() / target) ** 2))
        warnings.append(
            f"joint {u.argmax() + 1} is known to {100 * u.max():.1f} % only with these {2 * len(p)} loads; "
            f"{100 * target:.1f} % needs some {needed} such loads, larger forces, longer levers or other postures"
        )
    return LoadPlan(
        labels=tuple(names[int(one)] for one in np.repeat(p, 2)),
        joints=np.repeat(offered.joints[p], 2, axis=0),
        points_mm=np.repeat(offered.points_mm[d], 2, axis=0),
        force_n=sign * np.repeat(offered.force_n[d], 2, axis=0),
        wrench=sign * np.repeat(offered.wrench[d], 2, axis=0),
        noise_relative_u=u,
        relative_u=u,
        warnings=tuple(warnings),
    )


# Optimal choice of loads for the worst joint: greedy, then exchange (Fedorov 1972).

PRIOR = 1e-6  # information that keeps a design of few loads finite
POWER = 6  # of the uncertainties in the smooth maximum


def relative_u(information: Float) -> Float:
    """Relative standard uncertainties (..., 6) that an information (..., 6, 6) about logarithms leaves."""
    return np.sqrt(np.diagonal(np.linalg.inv(information), axis1=-2, axis2=-1))


def choose(information: Float, postures: int, pairs: int, target_u: float) -> list[tuple[int, int]]:
    """Pairs of loads (posture, load), at most `postures` postures and `pairs` pairs each.

    The postures are those whose loads, all alike often, would tell most. Adding pairs ends when every joint is known to
    `target_u`, or at the caps; then each pair may be exchanged for a better one, and what is superfluous goes.
    """
    every, loads = np.arange(len(information)), information.shape[1]
    kept = sorted(_chosen(information.mean(axis=1) * pairs, every, 1, min(postures, len(every)), 0.0))
    offered, owner = information[kept].reshape(-1, 6, 6), np.repeat(np.arange(len(kept)), loads)
    chosen = _chosen(offered, owner, pairs, pairs * len(kept), target_u)
    for one in reversed(chosen):
        rest = list(chosen)
        rest.remove(one)
        if rest and not _falls_short(offered[rest], target_u):
            chosen = rest
    return [(kept[owner[one]], one % loads) for one in chosen]


def _chosen(information: Float, owner: Int, most: int, wanted: int, target_u: float) -> list[int]:
    """`wanted` of n with information (n, 6, 6), or so many as reach the target; `most` of each owner (n,)."""

    def enough(taken: list[int]) -> bool:
        return len(taken) >= wanted or not _falls_short(information[taken], target_u)

    return design.chosen(lambda taken: _best(information, owner, most, taken), enough, 2)


def _falls_short(information: Float, target_u: float) -> bool:
    return bool(relative_u(np.eye(6) * PRIOR + information.sum(axis=0)).max() > target_u)


def _best(information: Float, owner: Int, most: int, chosen: list[int]) -> int:
    """The one that helps most beside those chosen, of owners that have room: by the smooth maximum of u."""
    total = np.eye(6) * PRIOR + information[chosen].sum(axis=0)
    room = np.bincount(owner[chosen], minlength=owner[-1] + 1) < most
    costs = np.sum(relative_u(total + information) ** POWER, axis=-1)
    return int(np.where(room[owner], costs, np.inf).argmin())
