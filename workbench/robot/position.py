"""Where the first three joints put the wrist's centre, solved backwards: the closed form for parallel axes 2 and 3.

Subproblems after Paden and Kahan (Murray, Li, Sastry 1994, section 3.3): shoulder from the wrist centre's distance
along axis 2, elbow by the law of cosines. Lengths here in m.
"""

from __future__ import annotations

import numpy as np

from workbench.kernels import kernel
from workbench.units import AnyArray

ROUNDING = 1e-13  # of a share
SINGULAR = 1e-13  # distance from an axis in m, below which an angle is free and set to 0


@kernel
def parallel_position(h: AnyArray, o: AnyArray, centre: AnyArray, wanted: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Angles (n, 4, 3) of joints 1 to 3 that bring the wrist's centre to `wanted` (n, 3); NaN: no such branch.

    Rows are 2 * shoulder + elbow. `h`, `o` (6, 3): axes and points on them, `centre` (3,), all at zero in the base. And
    how far each is from where shoulder and elbow end (n, 4, 2), as shares, below 0 beyond: 0 with the arm stretched,
    and for the shoulder with the wrist's centre on axis 1, where joint 1 turns at once.
    """
    out, room = np.full((len(wanted), 4, 3), np.nan), np.empty((len(wanted), 4, 2))
    upper, fore = o[2] - o[1], centre - o[2]
    upper, fore = upper - (upper @ h[1]) * h[1], fore - (fore @ h[1]) * h[1]
    reach = np.sqrt(upper @ upper) + np.sqrt(fore @ fore)
    for n in range(len(wanted)):
        w = wanted[n]
        off = np.cross(h[0], w - o[0]) / reach
        shoulder, aside = _on_circle(h[1], h[0], w - o[0], h[1] @ (centre - o[0]), -1.0)
        for a in range(2):
            r1 = _rotation(h[0], shoulder[a])
            u = r1.T @ (w - o[0]) + o[0] - o[1]
            u = u - (u @ h[1]) * h[1]
            elbow, bent = _on_circle(upper, h[2], fore, (u @ u - upper @ upper - fore @ fore) / 2, 1.0)
            for b in range(2):
                room[n, 2 * a + b, 0], room[n, 2 * a + b, 1] = min(aside, off @ off), bent
            if min(aside, bent) < -ROUNDING:
                continue
            for b in range(2):
                row = out[n, 2 * a + b]
                q2 = _angle(h[1], upper + _rotation(h[2], elbow[b]) @ fore, u)
                row[0], row[1], row[2] = shoulder[a], q2, elbow[b]
    return out, room


@kernel
def _on_circle(d: AnyArray, axis: AnyArray, p: AnyArray, wanted: float, sense: float) -> tuple[AnyArray, float]:
    """Both angles t with d . Rot(axis, sense t) p = wanted, or where it comes nearest; and what is left to their end.

    That is a share, below 0 where there are none.
    """
    along = (d @ axis) * (p @ axis)
    a, b = d @ p - along, sense * (d @ np.cross(axis, p))
    c, r = wanted - along, np.hypot(d @ p - along, d @ np.cross(axis, p))
    angles = np.zeros(2)
    if r <= SINGULAR:
        return angles, 0.0 if abs(c) <= SINGULAR else -1.0
    middle, half = np.arctan2(b, a), np.arctan2(np.sqrt(max(r * r - c * c, 0.0)), c)
    angles[0], angles[1] = _wrapped(middle + half), _wrapped(middle - half)
    return angles, 1.0 - abs(c) / r


@kernel
def _angle(axis: AnyArray, start: AnyArray, end: AnyArray) -> float:
    """The angle about `axis` that turns `start` to `end`, as seen along it; 0 where either lies on it."""
    across, along = axis @ np.cross(start, end), start @ end - (axis @ start) * (axis @ end)
    return float(np.arctan2(across, along)) if across != 0.0 or along != 0.0 else 0.0


@kernel
def _wrapped(angle: float) -> float:
    return float(np.pi - (np.pi - angle) % (2 * np.pi))


@kernel
def _rotation(axis: AnyArray, angle: float) -> AnyArray:
    """Rodrigues."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis
    return np.array(
        [
            [c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s],
            [y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s],
            [z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)],
        ]
    )
