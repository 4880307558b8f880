"""The table of checks as docs/checks.md has it."""

from __future__ import annotations

from workbench.checks.limits import LIMITS, Bound


def limits_table() -> str:
    """Name, meaning, limit and reason of every check, in Markdown."""
    rows = [f"| `{name}` | {one.meaning} | {_text(one.bound)} | {one.reason} |" for name, one in LIMITS.items()]
    return "\n".join(["| check | value | limit | why |", "| --- | --- | --- | --- |", *rows])


def _text(bound: Bound) -> str:
    return f"{bound[0]:g} to {bound[1]:g}" if isinstance(bound, tuple) else f"{bound:g}"
