"""From the parts' results to the figures of one condition."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bench.metrology.part_result import PartResult
from bench.metrology.quantity import Quantity, greatest_error, greatest_ratio, percentile, quantity
from workbench.units import Float

GOALS = (
    dict.fromkeys(
        (
            "paper",
            "straight",
            "arc",
            "wavy",
            "oblique",
            "two_pass",
            "reversed",
            "partial_view",
            "outliers_5",
            "missing_20",
            "clamps",
            "vibration",
            "limit",
        ),
        (0.015, 0.06),
    )
    | dict.fromkeys(("coarse", "noisy", "correlated"), (0.04, 0.25))
    | {"robot_error": (0.03, 0.08)}
)
GUARD_RISK = 0.05
GUARD = 1.645  # standard uncertainties
FAR_BEYOND = 2.0  # of them: a wrong verdict this far from the limit is no matter of the guard band's risk


@dataclass(frozen=True, slots=True)
class Summary:
    """The figures of one condition."""

    condition: str
    parts: int
    refused: list[PartResult]
    crashed: list[PartResult]
    root: Quantity
    bevel: Quantity
    passed: int  # sections
    failed: int
    undecided: int
    wrong: int  # sections said to pass that do not, or to fail that do not
    at_risk: int  # sections whose truth lies within the guard band of a limit
    far_wrong: int  # wrong, and FAR_BEYOND from the limit
    invented: int  # sections measured where the edge is hidden
    stations_invented: int  # of the profile along the edge, likewise
    missing: float  # share of the seen sections that were not measured
    seconds: float  # a part without the peers, median
    peers: dict[str, tuple[int, tuple[float, float], tuple[float, float]]]  # parts; p95 and median of root; of bevel

    @property
    def shortcomings(self) -> list[str]:
        """In words, what does not reach its goal."""
        checks = (
            (bool(self.crashed), f"{len(self.crashed)} crashed"),
            (not self.root.accurate, "root error"),
            (not self.bevel.accurate, "bevel error"),
            (self.root.surely_not_covered, "root coverage"),
            (self.bevel.surely_not_covered, "bevel coverage"),
            (not self.root.sharp, "root u over bound"),
            (not self.bevel.sharp, "bevel u over bound"),
            (self.far_wrong > 0 or self.wrong > max(1.0, GUARD_RISK * self.at_risk), "wrong verdicts"),
            (self.invented + self.stations_invented > 0, "invented sections"),
        )
        return [f"{self.condition}: {words}" for wrong, words in checks if wrong]


def summarise(condition: str, results: list[PartResult]) -> Summary:
    """All figures of one condition."""
    results = sorted(results, key=lambda r: r.seed)
    good = [r for r in results if not (r.refused or r.crashed)]
    verdict = np.array([v for r in good for v in r.verdicts])
    margin = flat(good, "margins")
    wrong = ((verdict == "pass") & (margin < 0)) | ((verdict == "fail") & (margin > 0))
    measured = np.isfinite(flat(good, "root_mm"))
    hidden, seen = (np.array([b for r in good for b in getattr(r, name)], dtype=bool) for name in ("hidden", "seen"))
    return Summary(
        condition=condition,
        parts=len(results),
        refused=[r for r in results if r.refused],
        crashed=[r for r in results if r.crashed],
        root=quantity(good, "root", "mm", GOALS[condition][0]),
        bevel=quantity(good, "bevel", "deg", GOALS[condition][1]),
        passed=int((verdict == "pass").sum()),
        failed=int((verdict == "fail").sum()),
        undecided=int((verdict == "undecided").sum()),
        wrong=int(wrong.sum()),
        at_risk=int((np.abs(margin) <= GUARD).sum()),
        far_wrong=int((wrong & (np.abs(margin) > FAR_BEYOND)).sum()),
        invented=int((measured & hidden).sum()),
        stations_invented=sum(r.stations_invented for r in good),
        missing=float((~measured & seen).sum() / max(1, seen.sum())),
        seconds=float(np.median([sum(v for k, v in r.seconds.items() if k not in r.peers) for r in results])),
        peers={name: peer(good, name) for name in sorted({name for r in good for name in r.peers})},
    )


def peer(results: list[PartResult], name: str) -> tuple[int, tuple[float, float], tuple[float, float]]:
    """Parts measured by a peer; 95th percentile and median of its greatest errors: root, bevel."""
    found = [r.peers[name] for r in results if name in r.peers]

    def worst(what: str) -> Float:
        errors = [np.abs(np.array(f[what], dtype=float)) for f in found]
        return np.array([np.nanmax(e) if np.isfinite(e).any() else np.inf for e in errors])

    roots, bevels = worst("root_mm"), worst("bevel_deg")
    return len(found), (percentile(roots, 95), percentile(roots, 50)), (percentile(bevels, 95), percentile(bevels, 50))


def flat(results: list[PartResult], name: str) -> Float:
    """A list of numbers a part as one array, NaN for None."""
    return np.array([v for r in results for v in getattr(r, name)], dtype=float)


def worst_parts(results: list[PartResult], count: int) -> list[tuple[str, float, PartResult]]:
    """What ("root error", "root error/u", ...), how much, which part: the worst of each, to look into."""
    found: list[tuple[str, float, PartResult]] = []
    good = [r for r in results if not (r.refused or r.crashed)]
    for name, unit in (("root", "mm"), ("bevel", "deg")):
        for what, score in ((f"{name} error", greatest_error), (f"{name} error/u", greatest_ratio)):
            scored = sorted(((score(r, name, unit), r) for r in good), key=lambda pair: -pair[0])
            found += [(what, value, r) for value, r in scored[:count]]
    return found


def worst_sections(results: list[PartResult], count: int) -> Iterator[str]:
    """The worst parts' sections as lines: value, truth, uncertainty, bound."""
    for what, value, part in worst_parts(results, count):
        name, unit = ("root", "mm") if what.startswith("root") else ("bevel", "deg")
        yield f"\n{part.condition}, seed {part.seed}: {what} {value:.3f}"
        for column in ("", "_true", "_u", "_bound"):
            numbers = getattr(part, f"{name}{column}_{unit}")
            yield " ".join(
                [f"  {column[1:] or 'value':6}", *(f"{v:8.4f}" if v is not None else "    null" for v in numbers)]
            )
