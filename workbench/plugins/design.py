"""Optimal designs: what is measured is chosen one by one, then exchanged (Fedorov, Theory of Optimal Experiments)."""

from __future__ import annotations

from collections.abc import Callable


def chosen(best: Callable[[list[int]], int], enough: Callable[[list[int]], bool], exchanges: int) -> list[int]:
    """Numbers of candidates, in the order in which they were chosen.

    Args:
        best: the one that helps most beside those that are taken.
        enough: whether those suffice.
        exchanges: rounds in which each is exchanged for what is best beside the others, while that changes any.
    """
    found: list[int] = []
    while not enough(found):
        found.append(best(found))
    for _ in range(exchanges):
        before = list(found)
        for i in range(len(found)):
            found[i] = best(found[:i] + found[i + 1 :])
        if found == before:
            break
    return found
