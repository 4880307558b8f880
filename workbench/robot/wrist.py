"""Which robots have a closed-form inverse: axes 4, 5, 6 through one point, which the first three move everywhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.errors import InputError
from workbench.robot.kinematics import Chain
from workbench.robot.position import moves_everywhere
from workbench.units import Float, Shaped

PARALLEL = 1e-9  # sine of an angle that still counts as zero
MEETING_MM = 1e-4  # distance at which lines still count as meeting


@dataclass(frozen=True, slots=True, eq=False)
class SphericalWrist:
    """Where the wrist's three axes meet, all joints at zero."""

    centre_mm: Shaped[Float, " 3"]  # in the base
    behind_parallel_axes: bool  # axes 2 and 3 are parallel and axis 1 is not, as in most robots
    square: bool  # axis 5 at right angles to axes 4 and 6


@dataclass(frozen=True, slots=True, eq=False)
class OffsetWrist:
    """A wrist whose axes 4 and 6 meet axis 5 in two points, all joints at zero, in the base."""

    on_4_mm: Shaped[Float, " 3"]  # where axes 4 and 5 meet
    on_6_mm: Shaped[Float, " 3"]  # where axes 5 and 6 meet
    offset_mm: float  # from the one to the other, along axis 5


def offset_wrist(chain: Chain) -> OffsetWrist | None:
    """The robot's wrist, if it is offset along axis 5 behind parallel axes 2 and 3 (UR, CRX); None: it is not."""
    h, o = chain.axes, chain.points_mm
    square = min(_sine(h[3], h[4]), _sine(h[4], h[5])) > PARALLEL
    if not square or _sine(h[1], h[2]) >= PARALLEL or _sine(h[0], h[1]) < PARALLEL:
        return None
    (on_4, miss_4), (on_6, miss_6) = (meeting_point(h[i : i + 2], o[i : i + 2]) for i in (3, 4))
    if max(miss_4, miss_6) > MEETING_MM or not moves_everywhere(chain, on_4):
        return None
    return OffsetWrist(on_4, on_6, float((on_6 - on_4) @ h[4]))


def spherical_wrist(chain: Chain) -> SphericalWrist:
    """The robot's wrist, if it is spherical.

    Raises:
        InputError: it is not, or there are places or turns that its joints cannot reach; the line says why.
    """
    h = chain.axes
    for i, j in ((3, 4), (4, 5)):
        if _sine(h[i], h[j]) < PARALLEL:
            raise _unsolved(chain, f"axes {i + 1} and {j + 1} are parallel")
    centre, miss = meeting_point(h[3:], chain.points_mm[3:])
    if miss > MEETING_MM:
        raise _unsolved(chain, f"its wrist is not spherical (axes 4, 5 and 6 miss each other by {miss:.3g} mm)")
    if not moves_everywhere(chain, centre):
        raise _unsolved(chain, "joints 1 to 3 cannot move the wrist's centre in all directions")
    return SphericalWrist(
        centre,
        behind_parallel_axes=_sine(h[1], h[2]) < PARALLEL <= _sine(h[0], h[1]),
        square=bool(max(abs(h[3] @ h[4]), abs(h[4] @ h[5])) < PARALLEL),
    )


def _sine(a: Float, b: Float) -> float:
    return float(np.linalg.norm(np.cross(a, b)))


def meeting_point(axes: Float, points: Float) -> tuple[Float, float]:
    """The point nearest to three lines, and its largest distance from one of them."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    point = np.linalg.solve(across.sum(axis=0), np.einsum("kij,kj->i", across, points))
    return point, float(np.linalg.norm(np.einsum("kij,kj->ki", across, point - points), axis=1).max())


def _unsolved(chain: Chain, why: str) -> InputError:
    return InputError(f"robot '{chain.name}'", f"expected a spherical wrist that its arm moves everywhere: {why}")
