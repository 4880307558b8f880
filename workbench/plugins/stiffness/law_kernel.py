"""Dynamic programming over (place on the grid of both angles, last step): the compiled kernels of `law`."""

from __future__ import annotations

import numpy as np

from workbench.api import AnyArray, kernel


@kernel
def stepped(value: AnyArray, bands: AnyArray, restless: float, closed: bool, least: AnyArray, came: AnyArray) -> None:
    """Least cost (a, t) of reaching each node from a neighbour: at most `bands` (2,) steps along each axis.

    The minimum over a window with a cost that is a sum over the axes, so each axis goes by itself (Felzenszwalb and
    Huttenlocher 2012): the work is that of the nodes times the width of one window plus the other.

    Args:
        value: (a, t) cost of being at each node before.
        bands: largest step along a and t.
        restless: cost of a step, times its size squared, along each axis.
        closed: whether the first node along t is a neighbour of the last.
        least: (a, t) out.
        came: (a, t) out, the step that was best: (e + bands[0]) (2 bands[1] + 1) + d + bands[1].
    """
    rows, columns = value.shape
    width = 2 * bands[1] + 1
    along, turn = np.empty_like(value), np.empty(value.shape, np.int8)
    _turned(value, bands[1], restless, closed, along, turn)
    for i in range(rows):
        for j in range(columns):
            least[i, j], came[i, j] = along[i, j], bands[0] * width + turn[i, j] + bands[1]
        for e in range(-bands[0], bands[0] + 1):
            if i - e < 0 or i - e >= rows:
                continue
            for j in range(columns):
                cost = along[i - e, j] + restless * e * e
                if cost < least[i, j]:
                    least[i, j] = cost
                    came[i, j] = (e + bands[0]) * width + turn[i - e, j] + bands[1]


@kernel
def _turned(value: AnyArray, band: int, restless: float, closed: bool, along: AnyArray, turn: AnyArray) -> None:
    """Fill in the least cost (a, t) of reaching each node along t alone, and the step that was best."""
    rows, columns = value.shape
    for i in range(rows):
        along[i], turn[i] = value[i], 0
        for d in range(-band, band + 1):
            for j in range(columns):
                source = j - d
                if source < 0 or source >= columns:
                    if not closed:
                        continue
                    source %= columns
                cost = value[i, source] + restless * d * d
                if cost < along[i, j]:
                    along[i, j], turn[i, j] = cost, d


@kernel
def best_law(
    cost: AnyArray,
    joints: AnyArray,
    free: AnyArray,
    shift: AnyArray,
    dt: AnyArray,
    speed: AnyArray,
    acceleration: AnyArray,
    most_step: float,
    bands: AnyArray,
    restless: float,
) -> AnyArray:
    """Indices (n, 2) of the cheapest way through n windows of a x t nodes; -1 where there is no way.

    A step is allowed if each of m coordinates moves by at most `most_step`, within `speed` (m,), and changes its
    speed within `acceleration` (m,); a row that the way goes straight through (no step before and after) is always
    allowed.

    Args:
        cost: (n, a, t) of each node.
        joints: (n, a, t, m) coordinates; angles, rad.
        free: (n, a, t) whether the node may be used.
        shift: (n, 2) how far each window lies from the one before, in nodes.
        dt: (n,) time from the row before.
        speed: (m,)
        acceleration: (m,)
        most_step: of any coordinate.
        bands: (2,) largest step along a and t, in nodes.
        restless: cost of a step, times its size in nodes squared.
    """
    n, rows, columns, m = joints.shape
    e_most, d_most = 2 * bands[0] + 1, 2 * bands[1] + 1
    value, fresh = np.full((rows, columns, e_most, d_most), np.inf), np.full((rows, columns, e_most, d_most), np.inf)
    came = np.full((n, rows, columns, e_most, d_most), -1, np.int16)
    before, now = np.zeros((rows, columns, e_most, d_most, m)), np.zeros((rows, columns, e_most, d_most, m))
    _enter(value[:, :, bands[0], bands[1]], cost[0], free[0])
    for i in range(1, n):
        fresh[:] = np.inf
        for a in range(rows):
            for t in range(columns):
                if value[a, t].min() == np.inf:
                    continue
                for e in range(e_most):
                    for d in range(d_most):
                        to_a, to_t = a + e - bands[0] - shift[i, 0], t + d - bands[1] - shift[i, 1]
                        if not (0 <= to_a < rows and 0 <= to_t < columns) or not free[i, to_a, to_t]:
                            continue
                        rests = e == bands[0] and d == bands[1]
                        allowed = _moves(
                            joints[i - 1, a, t], joints[i, to_a, to_t], dt[i], speed, most_step, now[a, t, e, d]
                        )
                        if not allowed and not rests:
                            continue
                        added = cost[i, to_a, to_t] + restless * ((e - bands[0]) ** 2 + (d - bands[1]) ** 2)
                        for last in range(e_most * d_most):
                            le, ld = last // d_most, last % d_most
                            total = value[a, t, le, ld] + added
                            if total >= fresh[to_a, to_t, e, d]:
                                continue
                            straight = i == 1 or (rests and le == bands[0] and ld == bands[1])
                            from_a, from_t = a - le + bands[0] + shift[i - 1, 0], t - ld + bands[1] + shift[i - 1, 1]
                            if not straight and not (
                                allowed
                                and _gentle(
                                    before[from_a, from_t, le, ld],
                                    now[a, t, e, d],
                                    (dt[i - 1] + dt[i]) / 2,
                                    acceleration,
                                )
                            ):
                                continue
                            fresh[to_a, to_t, e, d] = total
                            came[i, to_a, to_t, e, d] = last
        value, fresh = fresh, value
        before, now = now, before
    return _traced(value, came, shift, bands)


@kernel
def _enter(value: AnyArray, cost: AnyArray, free: AnyArray) -> None:
    """The way may begin in every free node (a, t) of the first window."""
    for a in range(value.shape[0]):
        for t in range(value.shape[1]):
            if free[a, t]:
                value[a, t] = cost[a, t]


@kernel
def _moves(a: AnyArray, b: AnyArray, dt: float, speed: AnyArray, most_step: float, out: AnyArray) -> bool:
    """Speeds from a to b the short way round, and whether they are allowed."""
    good = True
    for j in range(len(a)):
        step = (b[j] - a[j] + np.pi) % (2 * np.pi) - np.pi
        out[j] = step / dt
        if abs(step) > most_step or abs(out[j]) > speed[j]:
            good = False
    return good


@kernel
def _gentle(before: AnyArray, now: AnyArray, dt: float, acceleration: AnyArray) -> bool:
    good = True
    for j in range(len(now)):
        good &= abs(now[j] - before[j]) <= acceleration[j] * dt
    return good


@kernel
def _traced(value: AnyArray, came: AnyArray, shift: AnyArray, bands: AnyArray) -> AnyArray:
    """From the cheapest end back to the start."""
    n, d_most = len(came), came.shape[4]
    way = np.full((n, 2), -1, np.int64)
    best, a, t, e, d = np.inf, 0, 0, 0, 0
    for node, total in np.ndenumerate(value):
        if total < best:
            best = total
            a, t, e, d = node
    if best == np.inf:
        return way
    for i in range(n - 1, -1, -1):
        way[i] = a, t
        last = came[i, a, t, e, d]
        a, t = a - e + bands[0] + shift[i, 0], t - d + bands[1] + shift[i, 1]
        e, d = last // d_most, last % d_most
    return way
