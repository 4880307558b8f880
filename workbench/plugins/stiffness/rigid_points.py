"""Tracked points move as one rigid body: a point that does not is a gross error of the tracker."""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy

from workbench.api import Bool, Chain, Float, InputError, LoadingSetup, forward_kinematics
from workbench.plugins.stiffness.values import LoadingTests

GROSS = 1e-4  # chance that a sound set of loads loses a point


def check_rigid(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> tuple[LoadingTests, tuple[str, ...]]:
    """The tests without points that contradict the others, and a line on each.

    A load's points are fitted with a small rigid motion (six unknowns). Where the misfit is no chance, the point
    without which the others agree is put aside; where three points disagree and none can be told, all of them are.
    """
    if tests.targets_mm is None:
        return tests, ()
    at = _levers(chain, setup, tests)
    seen = np.isfinite(tests.targets_mm[..., 0])
    moved, notes = tests.targets_mm.copy(), []
    spread = _spread(moved, at, seen, setup.target_noise_mm)
    for i in range(len(moved)):
        for k in _gross(moved[i], at[i], seen[i], setup.target_noise_mm * spread, len(moved)):
            moved[i, k] = np.nan
            notes.append(f"line {tests.lines[i]}: point p{k + 1} does not move with the others: left out")
    if np.isnan(moved).all():
        raise InputError(tests.source, "expected tracked points that move as one rigid body, found none")
    return dataclasses.replace(tests, targets_mm=moved), tuple(notes)


def _levers(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Float:
    """(L, k, 3) from the points' middle to each point, in base axes."""
    assert tests.targets_mm is not None
    count = tests.targets_mm.shape[1]
    if count > len(setup.targets_mm):
        raise InputError(
            tests.source,
            f"expected at most {len(setup.targets_mm)} tracked points: the cell file's "
            f"$.loading.targets_mm places no p{count}",
        )
    rotation = forward_kinematics(chain, tests.joints)[:, None, :3, :3]
    arms = setup.targets_mm[:count] - setup.targets_mm[:count].mean(axis=0)
    return np.asarray((rotation @ arms[:, :, None])[..., 0])


def _misfit(moved: Float, at: Float, use: Bool) -> float:
    """Sum of squares (mm^2) that no small rigid motion explains."""
    x, y, z = at[use].T
    o = np.zeros_like(x)
    turn = np.stack([np.stack([o, z, -y], -1), np.stack([-z, o, x], -1), np.stack([y, -x, o], -1)], 1)
    a = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=2).reshape(-1, 6)
    b = moved[use].reshape(-1)
    return float(np.sum((b - a @ np.linalg.lstsq(a, b, rcond=None)[0]) ** 2))


def _spread(moved: Float, at: Float, seen: Bool, noise_mm: float) -> float:
    """How many times the stated noise most loads show, at least 1."""
    ratios = [
        _misfit(m, a, s) / noise_mm**2 / scipy.special.chdtri(3 * s.sum() - 6, 0.5)
        for m, a, s in zip(moved, at, seen, strict=True)
        if s.sum() >= 3
    ]
    return max(1.0, float(np.sqrt(np.median(ratios)))) if ratios else 1.0


def _gross(moved: Float, at: Float, seen: Bool, noise_mm: float, loads: int) -> list[int]:
    """Points of one load to leave out."""
    use = seen.copy()
    while use.sum() >= 3 and _misfit(moved, at, use) > noise_mm**2 * scipy.special.chdtri(
        3 * use.sum() - 6, GROSS / loads
    ):
        if use.sum() == 3:
            return [int(k) for k in np.flatnonzero(seen)]
        without = []
        for k in np.flatnonzero(use):
            rest = use.copy()
            rest[k] = False
            without.append((_misfit(moved, at, rest), int(k)))
        use[min(without)[1]] = False
    return [int(k) for k in np.flatnonzero(seen & ~use)]
