"""Pairs of opposite loads: what does not reverse is drift, backlash or friction, not elasticity."""

from __future__ import annotations

import numpy as np
import scipy

from workbench.api import Float
from workbench.plugins.stiffness.equations import Equations, covariances, curvature
from workbench.plugins.stiffness.values import LoadingTests

OPPOSITE = 0.05  # of the wrench: how far the two may be from opposite
SURE = 1e-3  # chance that sound pairs are complained of


def opposite_pairs(tests: LoadingTests) -> list[tuple[int, int]]:
    """Loads (i, j) of one posture whose wrenches are opposite; each load in one pair at most."""
    pairs: list[tuple[int, int]] = []
    free = set(range(len(tests.lines)))
    for i in range(len(tests.lines)):
        for j in range(i + 1, len(tests.lines)):
            same = tests.labels[i] == tests.labels[j] and np.abs(tests.joints[i] - tests.joints[j]).max() < 1e-6
            opposed = np.abs(tests.wrench[i] + tests.wrench[j]).max() <= OPPOSITE * np.abs(tests.wrench[i]).max()
            if same and opposed and {i, j} <= free:
                pairs.append((i, j))
                free -= {i, j}
    return pairs


def check_pairs(tests: LoadingTests, eq: Equations, compliance: Float, use: Float, scale2: float) -> tuple[str, ...]:
    """A line for each posture whose opposite loads do not give opposite displacements."""
    covariance = covariances(eq, compliance) * max(scale2, 1.0)
    even = eq.y - eq.a @ compliance - curvature(eq, compliance)
    sums: dict[str, list[tuple[float, int, float]]] = {}
    for i, j in opposite_pairs(tests):
        both = (eq.seen[i] * eq.seen[j] * use[i] * use[j]) > 0
        if not both.any():
            continue
        e = (even[i] + even[j])[both] / 2
        square = e @ np.linalg.solve((covariance[i] + covariance[j])[np.ix_(both, both)] / 4, e)
        sums.setdefault(tests.labels[i], []).append((float(square), int(both.sum()), float(np.linalg.norm(e[:3]))))
    notes = []
    for label, found in sums.items():
        if sum(s for s, _, _ in found) > scipy.special.chdtri(sum(n for _, n, _ in found), SURE / len(sums)):
            most = max(mm for _, _, mm in found)
            notes.append(
                f"posture {label}: opposite loads do not give opposite displacements (up to {most:.3f} mm "
                "remain): drift, backlash or friction beside elasticity"
            )
    return tuple(notes)
