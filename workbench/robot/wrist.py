"""Which robots have a closed-form inverse: axes 2 and 3 parallel, axes 4, 5, 6 through one point at right angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.errors import InputError
from workbench.robot.chain import Chain
from workbench.units import Float

PARALLEL = 1e-9  # sine of an angle that still counts as zero
MEETING_MM = 1e-4  # distance at which lines still count as meeting


@dataclass(frozen=True, slots=True, eq=False)
class SphericalWrist:
    """Where the wrist's three axes meet, all joints at zero."""

    centre_mm: Float  # (3,) in the base


def spherical_wrist(chain: Chain) -> SphericalWrist:
    """The robot's wrist, if the closed form holds for it.

    Raises:
        InputError: it does not; the line says which axes stand in the way.
    """
    h = chain.axes
    if np.linalg.norm(np.cross(h[1], h[2])) > PARALLEL:
        raise _unsolved(chain, "axes 2 and 3 are not parallel")
    if max(abs(h[3] @ h[4]), abs(h[4] @ h[5])) > PARALLEL:
        raise _unsolved(chain, "axes 4, 5 and 6 are not at right angles to their neighbours")
    if np.linalg.norm(np.cross(h[0], h[1])) < PARALLEL:
        raise _unsolved(chain, "axes 1 and 2 are parallel")
    centre, miss = _meeting_point(h[3:], chain.points_mm[3:])
    if miss > MEETING_MM:
        raise _unsolved(chain, f"its wrist is not spherical (axes 4, 5 and 6 miss each other by {miss:.3g} mm)")
    return SphericalWrist(centre)


def _meeting_point(axes: Float, points: Float) -> tuple[Float, float]:
    """The point nearest to three lines, and its largest distance from one of them."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    point = np.linalg.solve(across.sum(axis=0), np.einsum("kij,kj->i", across, points))
    return point, float(np.linalg.norm(np.einsum("kij,kj->ki", across, point - points), axis=1).max())


def _unsolved(chain: Chain, why: str) -> InputError:
    return InputError(f"robot '{chain.name}'", f"expected a spherical wrist behind two parallel axes: {why}")
