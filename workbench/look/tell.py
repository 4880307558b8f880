"""Checks made while looking, and how checks are told."""

from __future__ import annotations

from workbench.artefacts.checks import Check
from workbench.units import Float


def failed(name: str, value: float | None, reason: str, finding: str) -> Check:
    """A check that the file does not pass."""
    return Check(name, value, None, False, reason, finding)


def told(checks: tuple[Check, ...]) -> list[str]:
    """A line a check: those that failed first, with what was found."""
    rows = []
    for check in sorted(checks, key=lambda each: each.passed):
        value = "" if check.value is None else f" {check.value:.4g}"
        limit = "" if check.limit is None else f" (limit {limit_text(check.limit)})"
        text = check.reason if check.passed else check.finding or check.reason
        rows.append(f"  {'ok  ' if check.passed else 'FAIL'} {check.name}{value}{limit}: {text}")
    return rows


def limit_text(limit: float | tuple[float, float] | None) -> str:
    """A limit, or a range."""
    if limit is None:
        return ""
    return f"{limit[0]:.4g} to {limit[1]:.4g}" if isinstance(limit, tuple) else f"{limit:.4g}"


def box(points_mm: Float) -> str:
    """Least and greatest coordinates of points (n, 3), n > 0."""
    low, high = points_mm.min(axis=0), points_mm.max(axis=0)
    return ", ".join(f"{name} {a:.6g} to {b:.6g} mm" for name, a, b in zip("xyz", low, high, strict=True))
