"""Times of a bag's messages, and rows brought into their order."""

from __future__ import annotations

from typing import Literal

import numpy as np

from workbench.errors import InputError
from workbench.importing.bags_reader import Message
from workbench.units import Float


def stamp_s(message: Message, time: Literal["header", "message"]) -> float:
    """The time of a message that has a header. Raises InputError for a header without time."""
    return message.time_ns / 1e9 if time == "message" else header_s(message.value.header, message.where)


def header_s(header: object, where: str) -> float:
    """The header's stamp. Raises InputError where it was never set."""
    stamp = header.stamp  # type: ignore[attr-defined]
    if stamp.sec == 0 and stamp.nanosec == 0:
        raise InputError(where, 'the header has no time: expected "time": "message" in $.bag of the mapping')
    return float(stamp.sec + stamp.nanosec / 1e9)


def in_order(time_s: Float, rows: Float, where: str) -> tuple[Float, Float, int]:
    """Times (K,) and rows (K, n) sorted by time, and how many repeats were dropped.

    Publishers may run ahead of each other, and repeat themselves: what says the same at the same time counts once.

    Raises:
        InputError: two different rows at one time.
    """
    order = np.argsort(time_s, kind="stable")
    time_s, rows = time_s[order], rows[order]
    again = np.flatnonzero(np.diff(time_s) == 0) + 1
    for k in again:
        if not np.allclose(rows[k], rows[k - 1], rtol=0, atol=1e-9):
            raise InputError(where, f"two different poses at {time_s[k]!s} s")
    return np.delete(time_s, again), np.delete(rows, again, axis=0), len(again)
