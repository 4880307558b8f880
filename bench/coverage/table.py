"""Results as Markdown: one row a condition."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from bench.coverage.measure import Result
from bench.metrology.table import markdown
from workbench.units import Float

MILLED = ("root_mm", "bevel_deg")
RAW = ("normal_mm", "across_mm", "axis_deg", "heading_deg", "upper_mm")
NAMES = {
    "root_mm": "root, mm",
    "bevel_deg": "bevel, deg",
    "normal_mm": "along n, mm",
    "across_mm": "along m, mm",
    "axis_deg": "axis, deg",
    "heading_deg": "heading, deg",
    "upper_mm": "upper edge, mm",
}
NO_U = ("heading_deg", "upper_mm")


def tables(results: list[Result]) -> str:
    """Both tables, of milled and of raw parts."""
    parts = []
    for quantities, title in ((MILLED, "Milled edges"), (RAW, "Raw edges")):
        chosen = [r for r in results if (set(r.error) or {_kind(r)}) & set(quantities)]
        if chosen:
            parts.append(f"### {title}\n\n" + _table(chosen, quantities))
    return "\n\n".join(parts)


def _kind(result: Result) -> str:
    return "axis_deg" if result.condition.removeprefix("swept_").startswith("raw_") else "root_mm"


def _table(results: list[Result], quantities: tuple[str, ...]) -> str:
    raw = quantities is RAW
    head = ["condition", "refused", "crashed", "covered, %" if raw else "unmeasured, %"]
    for name in quantities:
        head += [f"{NAMES[name]}: p95 of the greatest"]
        if name not in NO_U:
            head[-1] += "; worst error/u; mean u"
            head += [f"{NAMES[name]}: within 2u, %", f"{NAMES[name]}: beyond 4u"]
    head.append("s")
    rows = []
    for condition in dict.fromkeys(r.condition for r in results):
        rows.append([condition, *_row([r for r in results if r.condition == condition], quantities, raw)])
    rows.append(["all", *_row(results, quantities, raw)])
    return "\n".join(markdown(head, rows))


def _row(results: list[Result], quantities: tuple[str, ...], raw: bool) -> list[str]:
    done = [r for r in results if r.error]
    row = [str(sum(bool(r.refused) for r in results)), str(sum(bool(r.crashed) for r in results))]
    if raw:
        row.append(_number(100 * np.nanmean([r.covered for r in done]), 1) if done else "")
    else:
        wanted = sum(int(r.wanted.sum()) for r in done)
        missing = sum(int((r.wanted & np.isnan(r.error["root_mm"])).sum()) for r in done)
        row.append(_number(100 * missing / wanted, 1) if wanted else "")
    for name in quantities:
        row += _quantity(done, name)
    row.append(_number(float(np.mean([r.seconds for r in results])), 2))
    return row


def _quantity(results: list[Result], name: str) -> list[str]:
    columns = 1 if name in NO_U else 3
    results = [r for r in results if np.isfinite(r.error.get(name, math.nan)).any()]
    if not results:
        return [""] * columns
    digits = 3 if name.endswith("deg") else 4
    greatest = [float(np.nanmax(np.abs(r.error[name]))) for r in results]
    text = _number(float(np.percentile(greatest, 95)), digits)
    if name in NO_U:
        return [text]
    z, u = ratios(results, name), np.concatenate([r.u[name] for r in results])
    if not len(z):
        return [text, "", ""]
    share = 100 * float((z <= 2).mean())
    within = _number(share, 1) if 93 <= share <= 97 else f"**{_number(share, 1)}**"
    beyond = int((z > 4).sum())
    text = f"{text}; {_number(float(z.max()), 1)}; {_number(float(np.nanmean(u)), digits)}"
    return [text, within, f"**{beyond}**" if beyond else "0"]


def ratios(results: Iterable[Result], name: str) -> Float:
    """|error| / u of all measured sections."""
    pairs = [(np.abs(r.error[name]), r.u[name]) for r in results if name in r.error]
    if not pairs:
        return np.zeros(0)
    z = np.concatenate([e / np.maximum(u, 1e-12) for e, u in pairs])
    return np.asarray(z[np.isfinite(z)])


def worst(results: list[Result], count: int) -> list[str]:
    """One line for each of the parts whose greatest |error| / u is the largest."""
    lines: list[tuple[float, str]] = []
    for r in results:
        for name in r.error:
            z: Any = ratios([r], name) if name not in NO_U else np.zeros(0)
            if len(z):
                error = float(np.nanmax(np.abs(r.error[name])))
                lines.append(
                    (float(z.max()), f"{r.condition} {r.seed} {name}: {z.max():.1f} u, {error:.4f} ({r.title})")
                )
    return [text for _, text in sorted(lines, reverse=True)[:count]]


def _number(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}f}"
