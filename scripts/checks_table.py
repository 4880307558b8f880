"""docs/tables/checks.csv, every check with its limit and reason: `python -m scripts.checks_table`."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from workbench.checks.limits import LIMITS, Bound

PAGE = Path("docs/tables/checks.csv")


def limits_table() -> str:
    """Name, meaning, limit and reason of every check, as CSV."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["check", "value", "limit", "why"])
    table.writerows([name, one.meaning, _text(one.bound), one.reason] for name, one in LIMITS.items())
    return text.getvalue()


def _text(bound: Bound) -> str:
    return f"{bound[0]:g} to {bound[1]:g}" if isinstance(bound, tuple) else f"{bound:g}"


if __name__ == "__main__":
    PAGE.write_text(limits_table(), encoding="utf-8")
