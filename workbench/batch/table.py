"""What the command prints of a batch: how many parts came out how, and the worst of them."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from workbench.batch.fleet_table import worst_first
from workbench.batch.part import Record
from workbench.batch.run import Batch
from workbench.errors import one_line

SHOWN = 20
COLOURS = {"passed": "green", "rejected": "red"}


def print_batch(made: Batch) -> None:
    """The parts that did not pass, worst first; the counts; the files."""
    console = Console(highlight=False)
    worth = [record for record in worst_first(made.records) if record.outcome != "passed" or record.verdict != "pass"]
    if worth:
        console.print(_table(worth[:SHOWN]))
    if len(worth) > SHOWN:
        console.print(f"and {len(worth) - SHOWN} more, in the page")
    console.print(Text(one_line(summary(made.records))), soft_wrap=True)
    for file in made.files:
        console.print(Text(one_line(f"wrote: {file}")), soft_wrap=True)


def summary(records: tuple[Record, ...]) -> str:
    """Parts by outcome, and by verdict where there is one."""
    words = [f"{len(records)} parts"]
    for kind in dict.fromkeys(record.outcome for record in worst_first(records)):
        words.append(f"{sum(record.outcome == kind for record in records)} {kind}")
    verdicts = [record.verdict for record in records if record.verdict]
    told = ", ".join(f"{verdicts.count(one)} {one}" for one in ("fail", "undecided", "pass") if one in verdicts)
    skipped = sum(record.skipped for record in records)
    return (
        ", ".join(words)
        + (f" (verdicts: {told})" if told else "")
        + (f"; {skipped} from an earlier run" * bool(skipped))
    )


def _table(records: list[Record]) -> Table:
    table = Table("part", "outcome", "verdict", "cause")
    for record in records:
        outcome = Text(record.outcome, COLOURS.get(record.outcome, "bold red"))
        table.add_row(Text(one_line(record.part)), outcome, record.verdict or "", Text(one_line(record.cause)))
    return table
