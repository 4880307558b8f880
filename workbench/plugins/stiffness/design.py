"""Optimal choice of loads: greedy, then exchange (Fedorov 1972), for the worst joint or for all of them together."""

from __future__ import annotations

from typing import Literal

import numpy as np

from workbench.api import Float

Criterion = Literal["minmax", "d_optimal"]
PRIOR = 1e-6  # information that keeps a design of few loads finite
POWER = 6  # of the uncertainties in the smooth maximum


def relative_u(information: Float) -> Float:
    """Relative standard uncertainties (..., 6) that an information (..., 6, 6) about logarithms leaves."""
    return np.asarray(np.sqrt(np.diagonal(np.linalg.inv(information), axis1=-2, axis2=-1)))


def cost(information: Float, criterion: Criterion) -> Float:
    """What to make small (...): the smooth maximum of the uncertainties, or the volume of their ellipsoid; as logs."""
    if criterion == "d_optimal":
        return np.asarray(-np.linalg.slogdet(information)[1] / 2)
    return np.asarray(np.log(np.sum(relative_u(information) ** POWER, axis=-1)) / POWER)


def choose(
    information: Float, postures: int, pairs: int, criterion: Criterion, target_u: float
) -> list[tuple[int, int]]:
    """Pairs of loads (posture, load), at most `postures` postures and `pairs` pairs each, one by one.

    The postures are those whose loads, all alike often, would tell most. Adding pairs ends when every joint is known to
    `target_u`, or at the caps; then each pair may be exchanged for a better one.
    """
    kept = choose_postures(information.mean(axis=1) * pairs, postures, criterion)
    offered = information[kept]
    chosen: list[tuple[int, int]] = []
    while _falls_short(offered, chosen, target_u):
        best = _best(offered, _sum(offered, chosen), chosen, pairs, criterion)
        if best is None:
            break
        chosen.append(best)
    for _ in range(2):
        for i in range(len(chosen)):
            rest = chosen[:i] + chosen[i + 1 :]
            best = _best(offered, _sum(offered, rest), rest, pairs, criterion)
            if best is not None:
                chosen[i] = best
    return [(kept[p], d) for p, d in _trimmed(offered, chosen, target_u)]


def choose_postures(information: Float, wanted: int, criterion: Criterion) -> list[int]:
    """The best `wanted` of P postures with information (P, 6, 6) each: greedy, then exchanged one for one."""
    chosen: list[int] = []
    while len(chosen) < min(wanted, len(information)):
        chosen.append(_next(information, chosen, criterion))
    for _ in range(5):
        before = list(chosen)
        for i in range(len(chosen)):
            chosen[i] = _next(information, chosen[:i] + chosen[i + 1 :], criterion)
        if chosen == before:
            break
    return sorted(chosen)


def _next(information: Float, chosen: list[int], criterion: Criterion) -> int:
    costs = cost(information + information[chosen].sum(axis=0) + np.eye(6) * PRIOR, criterion)
    costs[chosen] = np.inf
    return int(np.argmin(costs))


def _sum(information: Float, chosen: list[tuple[int, int]]) -> Float:
    return np.asarray(np.eye(6) * PRIOR + sum((information[one] for one in chosen), np.zeros((6, 6))))


def _falls_short(information: Float, chosen: list[tuple[int, int]], target_u: float) -> bool:
    return bool(relative_u(_sum(information, chosen)).max() > target_u)


def _best(
    information: Float, total: Float, chosen: list[tuple[int, int]], pairs: int, criterion: Criterion
) -> tuple[int, int] | None:
    """The pair that helps most among those of postures that have room."""
    room = np.bincount([p for p, _ in chosen], minlength=len(information)) < pairs
    if not room.any():
        return None
    costs = np.where(room[:, None], cost(total + information, criterion), np.inf)
    p, d = np.unravel_index(int(np.argmin(costs)), costs.shape)
    return int(p), int(d)


def _trimmed(information: Float, chosen: list[tuple[int, int]], target_u: float) -> list[tuple[int, int]]:
    """Without the pairs that the exchange made superfluous."""
    kept = list(chosen)
    for pair in reversed(chosen):
        rest = list(kept)
        rest.remove(pair)
        if rest and not _falls_short(information, rest, target_u):
            kept = rest
    return kept
