"""`python -m bench.scan_plan [--parts N] [--docs WHEN]`: planned scans, promised against achieved.

One line a part goes to the log; a run that was stopped goes on behind the last one. `--docs`: the table into
docs/scan_planning.md.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bench.scan_plan.achieved import LIGHT_MM, SIMULATORS, examine
from bench.tables import put_into

PAGE = Path(__file__).parents[2] / "docs" / "scan_planning.md"
QUANTITIES = (("root", "root face"), ("bevel", "bevel angle"))
Row = dict[str, Any]


def summary(rows: list[Row]) -> Iterator[str]:
    """The table, and what else is counted."""
    head = "| simulator, lower edge | quantity | parts | u achieved / predicted: 10 % | median | 90 % "
    yield f"{head}| within 0.8 to 1.25, % | wanted U reached where promised, % | error within U, % |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for simulator in SIMULATORS:
        told = [row["simulators"][simulator] for row in rows if simulator in row.get("simulators", {})]
        for key, name in QUANTITIES:
            each = [one[key] for one in told if key in one]
            if not each:
                continue
            ratio = np.array([one["ratio"] for one in each])
            low, middle, high = np.percentile(ratio, [10.0, 50.0, 90.0])
            within, held, covered = (
                100.0 * float(np.mean(values))
                for values in (
                    (ratio >= 0.8) & (ratio <= 1.25),
                    [one["held"] for one in each],
                    [one["covered"] for one in each],
                )
            )
            yield (
                f"| {simulator} | {name} | {len(each)} | {low:.2f} | {middle:.2f} | {high:.2f} | {within:.0f} "
                f"| {held:.0f} | {covered:.0f} |"
            )
    yield ""
    made = [row for row in rows if "refused" not in row]
    clamped = [row for row in made if row["clamped"]]
    written = [row for row in made if row["collision"] is not None and not row["collision"].startswith("none")]
    missed = sum(row["missed"]["free"] > 0.0 for row in clamped)
    beside = sum(row["missed"]["beside"] > 0.0 for row in clamped)
    hit = sum(bool(row["collision"]) for row in written)
    refused = sum("refused" in one for row in made for one in row["simulators"].values())
    seconds = [row["seconds"] for row in made]
    lit = sum(row["promised"] + row["missed"]["unseen"] > 1.0 - 1e-9 for row in made)
    yield (
        f"{len(rows)} parts, {len(rows) - len(made)} without any pass; all of the edge promised in "
        f"{sum(row['promised'] == 1.0 for row in made)}, all that is seen of it in {lit}. "
        f"Clamped: {len(clamped)}, of these {missed} with a stretch "
        f"missed to which light is free from somewhere, {beside} of them with {LIGHT_MM:g} mm "
        f"beside it. Programs driven by the outsider: of {len(written)} plans, "
        f"{hit} with a collision. Recordings that the engine refuses: {refused}. Planning: median "
        f"{np.median(seconds):.1f} s of a core, at most {max(seconds):.1f} s."
    )


def main() -> None:
    """Examine parts, print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.scan_plan", description=__doc__)
    parser.add_argument("--parts", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--log", type=Path, default=Path("out/scan_plan.jsonl"), help="a line a part; read on restart")
    parser.add_argument(
        "--docs", metavar="WHEN", help="the table into docs/scan_planning.md; commit and date of the run"
    )
    arguments = parser.parse_args()
    os.nice(5)
    arguments.log.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in arguments.log.read_text().splitlines()] if arguments.log.exists() else []
    done = {row["seed"] for row in rows}
    for seed in range(arguments.first, arguments.first + arguments.parts):
        if seed not in done:
            rows.append(examine(seed))
            with open(arguments.log, "a", encoding="utf-8") as log:
                print(json.dumps(rows[-1]), file=log)
    text = "\n".join(summary(rows))
    print(text)
    if arguments.docs:
        seeds = [row["seed"] for row in rows]
        told = f"`python -m bench.scan_plan`, {len(seeds)} seeds from {min(seeds)} to {max(seeds)}; {arguments.docs}"
        put_into(PAGE, f"{told}\n\n{text}", "scan_plan")


if __name__ == "__main__":
    main()
