"""The figures of clouds without a grid as Markdown tables."""

from __future__ import annotations

from bench.metrology.clouds.part import ROUTES
from bench.metrology.clouds.summary import GOALS, UNITS, CloudSummary
from bench.metrology.table import markdown, study_text

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
            values = [_three(apart[n], n) if n in apart else NONE for n in UNITS]
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
                        _three(r.error, name),
                        f"{r.mean_u:.{DIGITS[name]}f}",
                        f"{100 * r.within_2u:.1f}",
                        f"{100 * r.interval[0]:.1f} to {100 * r.interval[1]:.1f}",
                    ]
                )
            rows.append(row)
    return markdown(head, rows)


def _three(values: tuple[float, float, float], name: str) -> str:
    return ", ".join(f"{v:.{DIGITS[name]}f}" for v in values)
