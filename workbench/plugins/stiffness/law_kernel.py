"""Dynamic programming over (value of the law, its last step): the compiled kernel of `law`."""

from __future__ import annotations

import numpy as np
from numba import njit

from workbench.api import AnyArray


@njit(cache=True)
def best_law(cost: AnyArray, joints: AnyArray, free: AnyArray, dt: AnyArray, speed: AnyArray, acceleration: float,
             most_step: float, band: int, restless: float, closed: bool) -> AnyArray:  # fmt: skip
    """Indices (n,) of the cheapest way through n rows of k nodes, which steps by at most `band` nodes a row.

    A step is allowed if each of m coordinates moves by at most `most_step`, within `speed` (m,), and changes its
    speed within `acceleration`; a row that the way goes straight through (no step before and after) is always allowed.

    Args:
        cost: (n, k) of each node.
        joints: (n, k, m) coordinates; angles, rad.
        free: (n, k) whether the node may be used.
        dt: (n,) time from the row before.
        speed: (m,)
        acceleration: of any coordinate.
        most_step: of any coordinate.
        band: largest step, in nodes.
        restless: cost of a step, times its size in nodes squared.
        closed: whether the first node is a neighbour of the last.
    """
    n, k, m = joints.shape
    width = 2 * band + 1
    value, fresh = np.full((k, width), np.inf), np.full((k, width), np.inf)
    came = np.zeros((n, k, width), np.int8)
    before, now = np.zeros((k, width, m)), np.zeros((k, width, m))
    for t in range(k):
        if free[0, t]:
            value[t, band] = cost[0, t]
    for i in range(1, n):
        fresh[:] = np.inf
        for t in range(k):
            for d in range(width):
                if value[t].min() == np.inf:
                    break
                to = t + d - band
                if closed:
                    to %= k
                if to < 0 or to >= k or not free[i, to]:
                    continue
                allowed = _moves(joints[i - 1, t], joints[i, to], dt[i], speed, most_step, now[t, d])
                if not allowed and d != band:
                    continue
                added = cost[i, to] + restless * (d - band) ** 2
                for last in range(width):
                    total = value[t, last] + added
                    if total >= fresh[to, d]:
                        continue
                    if d != band or last != band:
                        start = (t - (last - band)) % k
                        if not allowed or (i > 1 and not _gentle(before[start, last], now[t, d],
                                                                 (dt[i - 1] + dt[i]) / 2, acceleration)):  # fmt: skip
                            continue
                    fresh[to, d] = total
                    came[i, to, d] = last
        value, fresh = fresh, value
        before, now = now, before
    return _traced(value, came, band, closed)


@njit(cache=True)
def _moves(a: AnyArray, b: AnyArray, dt: float, speed: AnyArray, most_step: float, out: AnyArray) -> bool:
    """Speeds from a to b the short way round, and whether they are allowed."""
    good = True
    for j in range(len(a)):
        step = (b[j] - a[j] + np.pi) % (2 * np.pi) - np.pi
        out[j] = step / dt
        if abs(step) > most_step or abs(out[j]) > speed[j]:
            good = False
    return good


@njit(cache=True)
def _gentle(before: AnyArray, now: AnyArray, dt: float, acceleration: float) -> bool:
    worst = 0.0
    for j in range(len(now)):
        worst = max(worst, abs(now[j] - before[j]))
    return worst <= acceleration * dt


@njit(cache=True)
def _traced(value: AnyArray, came: AnyArray, band: int, closed: bool) -> AnyArray:
    """From the cheapest end back to the start."""
    n, k, width = came.shape
    t, d = 0, 0
    for i in range(k):
        for j in range(width):
            if value[i, j] < value[t, d]:
                t, d = i, j
    way = np.zeros(n, np.int64)
    for i in range(n - 1, -1, -1):
        way[i] = t
        last = came[i, t, d]
        t = t - (d - band)
        if closed:
            t %= k
        d = last
    return way
