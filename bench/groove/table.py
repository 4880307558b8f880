"""Errors by size, as a table in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

FAR = 3.0  # standard uncertainties: beyond, it is confidently wrong


def print_table(
    sizes: Sequence[str],
    found: Mapping[str, Sequence[tuple[float, float]]],
    bounds: Mapping[str, Sequence[float]] | None = None,
) -> None:
    """Errors and standard uncertainties of each size, in mm or deg; with bounds, those of its values as well."""
    head = " over the bound |" if bounds else ""
    print(f"| size | values | median error | p95 error |{head} median u | within 2 u | beyond 3 u |")
    print("|---|---|---|---|---|---|---|" + "---|" * bool(bounds))
    for size in sizes:
        if not found[size]:
            continue
        error, u = np.array(found[size]).T
        z = np.abs(error) / u
        over = f" {np.quantile(np.abs(error) / bounds[size], 0.95):.1f} |" if bounds else ""
        print(
            f"| `{size}` | {z.size} | {np.median(error):.3f} | {np.quantile(np.abs(error), 0.95):.3f} |{over} "
            f"{np.median(u):.3f} | {100 * np.mean(z <= 2):.1f} % | {100 * np.mean(z > FAR):.1f} % |"
        )
