"""What a study of drawn joints prints: refusals, wrong types, values far off, and a table of errors by size."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from bench.tables import markdown
from workbench.errors import WorkbenchError

FAR = 3.0  # standard uncertainties: beyond, it is confidently wrong
Rows = Sequence[tuple[str, float, float]]  # size, error, u: mm or deg
Case = tuple[str, Callable[[], tuple[str | None, Rows]]]  # name, measure: the type that it is not, if taken for one


def study(cases: Iterable[Case], sizes: Sequence[str]) -> None:
    """Measure every case, and print."""
    found: dict[str, list[tuple[float, float]]] = defaultdict(list)
    parts = refused = taken = 0
    for name, measure in cases:
        parts += 1
        try:
            other, rows = measure()
        except WorkbenchError as error:
            refused += 1
            print(f"- {name} refused: {error}", flush=True)
            continue
        if other is not None:
            taken += 1
            print(f"- {name}: taken for {other}", flush=True)
            continue
        far: dict[str, tuple[float, float]] = {}
        for size, error, u in rows:
            found[size].append((error, u))
            far[size] = max(far.get(size, (FAR, 0.0)), (abs(error) / u, error))
        for size, (z, error) in far.items():
            if z > FAR:
                print(f"- {name}: {size} off by {error:.3f}, {z:.1f} u", flush=True)
    print(f"\n{parts} parts; {refused} refused; {taken} taken for a type that they are not\n")
    print_table(sizes, found)


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
