"""How far clouds without a grid agree with the gridded route, and with the truth: figures and tables."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bench.metrology.clouds.part import ROUTES, CloudResult
from bench.metrology.quantity import coverage_interval, percentile
from bench.metrology.table import markdown, study_text
from workbench.units import Float

CLOUD_CONDITIONS = ("paper", "arc", "wavy", "two_pass", "outliers_5")
GOALS = {"root": 0.03, "bevel": 0.15}  # mm and deg, between a route and the gridded one
UNITS = {"root": "mm", "bevel": "deg"}


@dataclass(frozen=True, slots=True)
class Route:
    """One quantity by one route: greatest over the sections of each part; median, 95th percentile and worst."""

    apart: tuple[float, float, float]  # from the gridded route
    error: tuple[float, float, float]  # from the truth
    within_2u: float  # share of the sections
    interval: tuple[float, float]  # 95 %, parts resampled
    mean_u: float


@dataclass(frozen=True, slots=True)
class CloudSummary:
    """All figures of one condition."""

    condition: str
    parts: int
    refused: list[CloudResult]
    crashed: list[CloudResult]
    routes: dict[tuple[str, str], Route | None]  # (route, root or bevel)
    missing: dict[str, int]  # sections that the gridded route measured and this one did not
    refused_routes: dict[str, list[str]]
    seconds: dict[str, float]  # median

    @property
    def shortcomings(self) -> list[str]:
        """In words, what does not reach its goal. Shuffled clouds have none: they are told as they are."""
        short = [
            f"{self.condition}: {name} apart"
            for name, goal in GOALS.items()
            if not ((found := self.routes["ply", name]) and found.apart[2] <= goal)
        ]
        if self.crashed or self.refused_routes["ply"]:
            short.append(f"{self.condition}: crashed or refused")
        return short


def summarise_clouds(condition: str, results: list[CloudResult]) -> CloudSummary:
    """All figures of one condition."""
    good = sorted((r for r in results if not (r.refused or r.crashed)), key=lambda r: r.seed)
    return CloudSummary(
        condition,
        len(results),
        [r for r in results if r.refused],
        [r for r in results if r.crashed],
        {(route, name): _route(good, route, name) for route in ROUTES for name in UNITS},
        {route: sum(_missing(r, route) for r in good) for route in ROUTES},
        {
            route: [f"seed {r.seed}: {r.refused_routes[route]}" for r in good if route in r.refused_routes]
            for route in ROUTES
        },
        {lap: percentile([r.seconds[lap] for r in good], 50) for lap in ("file", *ROUTES)},
    )


def _values(result: CloudResult, route: str, what: str) -> Float:
    return np.array(result.routes[route][what], dtype=float)


def _missing(r: CloudResult, route: str) -> int:
    if route not in r.routes:
        return 0
    seen = np.isfinite(_values(r, "grid", "root_error_mm"))
    return int((seen & ~np.isfinite(_values(r, route, "root_error_mm"))).sum())


def _route(good: list[CloudResult], route: str, name: str) -> Route | None:
    """None where the route refused every part."""
    unit = UNITS[name]
    mine = [r for r in good if route in r.routes]
    if not mine:
        return None
    error = [_values(r, route, f"{name}_error_{unit}") for r in mine]
    u = [_values(r, route, f"{name}_u_{unit}") for r in mine]
    apart = [e - _values(r, "grid", f"{name}_error_{unit}") for e, r in zip(error, mine, strict=True)]
    inside = [(np.abs(e) <= 2 * w)[np.isfinite(e)] for e, w in zip(error, u, strict=True)]
    return Route(
        _three(apart),
        _three(error),
        float(np.concatenate(inside).mean()),
        coverage_interval(inside),
        float(np.nanmean(np.concatenate(u))),
    )


def _three(values: list[Float]) -> tuple[float, float, float]:
    worst = [float(np.nanmax(np.abs(v), initial=0.0)) for v in values]
    return percentile(worst, 50), percentile(worst, 95), max(worst)


def worst_clouds(results: list[CloudResult], count: int) -> Iterable[str]:
    """The parts whose shuffled cloud agrees least with the gridded route, for the screen."""

    def apart(r: CloudResult) -> float:
        if "shuffled" not in r.routes:
            return 0.0
        off = _values(r, "shuffled", "root_error_mm") - _values(r, "grid", "root_error_mm")
        return float(np.nanmax(np.abs(off), initial=0.0))

    for r in sorted(results, key=apart, reverse=True)[:count]:
        yield f"{r.condition} {r.seed}: shuffled {apart(r):.4f} mm from the gridded route"


DIGITS = {"root": 4, "bevel": 3}
NONE = "-"  # every part was refused
NAMES = {"grid": "gridded", "ply": "PLY, in order", "shuffled": "PLY, shuffled"}


def cloud_tables(summaries: list[CloudSummary], command: str) -> str:
    """All tables, and what fell short."""
    refused = [
        f"- {s.condition}, {NAMES[route]}: {len(words)}, the first: {words[0]}"
        for s in summaries
        for route in ROUTES
        if (words := s.refused_routes[route])
    ]
    refused += [
        f"- {s.condition}, seed {r.seed}: {r.refused or r.crashed}" for s in summaries for r in (*s.refused, *s.crashed)
    ]
    parts = [
        (
            f"From the gridded route (goals {GOALS['root']:g} mm and {GOALS['bevel']:g} deg), the worst section of "
            "each part: median, 95th percentile and worst of the parts",
            agreement(summaries),
        ),
        ("From the truth, likewise, and beside the stated uncertainty", errors(summaries)),
    ]
    return study_text(command, parts, ["Refused:", "", *refused, ""] if refused else [], summaries)


def agreement(summaries: list[CloudSummary]) -> list[str]:
    head = ["condition", "route", "parts", "root, mm", "bevel, deg", "sections missing", "refused", "s a part", "met"]
    rows = []
    for s in summaries:
        for route in ROUTES[1:]:
            apart = {name: found.apart for name in UNITS if (found := s.routes[route, name])}
            met = all(name in apart and apart[name][2] <= goal for name, goal in GOALS.items())
            values = [_in_digits(apart[n], n) if n in apart else NONE for n in UNITS]
            rows.append(
                [
                    s.condition,
                    NAMES[route],
                    f"{s.parts}",
                    *values,
                    f"{s.missing[route]}",
                    f"{len(s.refused_routes[route])}",
                    f"{s.seconds[route]:.1f}",
                    "yes" if met else "**no**",
                ]
            )
    return markdown(head, rows)


def errors(summaries: list[CloudSummary]) -> list[str]:
    head = ["condition", "route"]
    for name, unit in UNITS.items():
        head += [f"{name}, {unit}", f"{name}: mean u", f"{name}: within 2u, %", "95 % interval"]
    rows = []
    for s in summaries:
        for route in ROUTES:
            row = [s.condition, NAMES[route]]
            for name in UNITS:
                r = s.routes[route, name]
                row += (
                    [NONE] * 4
                    if r is None
                    else [
                        _in_digits(r.error, name),
                        f"{r.mean_u:.{DIGITS[name]}f}",
                        f"{100 * r.within_2u:.1f}",
                        f"{100 * r.interval[0]:.1f} to {100 * r.interval[1]:.1f}",
                    ]
                )
            rows.append(row)
    return markdown(head, rows)


def _in_digits(values: tuple[float, float, float], name: str) -> str:
    return ", ".join(f"{v:.{DIGITS[name]}f}" for v in values)
