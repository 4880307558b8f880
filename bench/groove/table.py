"""Errors by size, as a table in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bench.tables import markdown

FAR = 3.0  # standard uncertainties: beyond, it is confidently wrong


def print_table(sizes: Sequence[str], found: Mapping[str, Sequence[tuple[float, float]]]) -> None:
    """Errors and standard uncertainties of each size, in mm or deg."""
    rows = []
    for size in filter(found.get, sizes):
        error, u = np.array(found[size]).T
        z = np.abs(error) / u
        ends = [f"{value:.3f}" for value in (np.median(error), np.quantile(np.abs(error), 0.95), np.median(u))]
        rows.append(
            [f"`{size}`", str(z.size), *ends, f"{100 * np.mean(z <= 2):.1f} %", f"{100 * np.mean(z > FAR):.1f} %"]
        )
    head = ["size", "values", "median error", "p95 error", "median u", "within 2 u", "beyond 3 u"]
    print(*markdown(head, rows), sep="\n")
