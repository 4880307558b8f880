"""`python -m bench.scan_plan`: planned scans, promised against achieved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from bench.harness import Option, Study
from bench.scan_plan.achieved import SIMULATORS, examine
from bench.tables import markdown

QUANTITIES = (("root", "root face"), ("bevel", "bevel angle"))
Row = dict[str, Any]


def summary(rows: Sequence[Row], _: Any) -> Iterator[str]:
    """The table, and what else is counted."""
    head = ["simulator, lower edge", "quantity", "parts", "u achieved / predicted: 10 %", "median", "90 %"]
    head += ["within 0.8 to 1.25, %", "wanted U reached where promised, %", "error within U, %"]
    table = []
    for simulator in SIMULATORS:
        told = [row["simulators"][simulator] for row in rows if simulator in row.get("simulators", {})]
        for key, name in QUANTITIES:
            each = [one[key] for one in told if key in one]
            if not each:
                continue
            ratio = np.array([one["ratio"] for one in each])
            shown = [f"{value:.2f}" for value in np.percentile(ratio, [10.0, 50.0, 90.0])]
            shares = ((ratio >= 0.8) & (ratio <= 1.25), [one["held"] for one in each], [one["covered"] for one in each])
            shown += [f"{100.0 * float(np.mean(values)):.0f}" for values in shares]
            table.append([simulator, name, str(len(each)), *shown])
    yield from markdown(head, table)
    yield ""
    made = [row for row in rows if "refused" not in row]
    refused = sum("refused" in one for row in made for one in row["simulators"].values())
    seconds = [row["seconds"] for row in made]
    lit = sum(row["promised"] + row["unseen"] > 1.0 - 1e-9 for row in made)
    yield (
        f"{len(rows)} parts, {len(rows) - len(made)} without any pass. U is promised along the whole edge in "
        f"{sum(row['promised'] == 1.0 for row in made)}, along its whole visible part in {lit}. Recordings refused: "
        f"{refused}. Planning: median {np.median(seconds):.1f} s of a core, at most {max(seconds):.1f} s."
    )


STUDY = Study(
    "scan_plan",
    str(__doc__),
    {"parts": Option(300), "first": Option(0, "seed")},
    lambda given: range(given.first, given.first + given.parts),
    examine,
    summary,
    "scan_planning.md",
    "scan_plan",
)
if __name__ == "__main__":
    STUDY()
