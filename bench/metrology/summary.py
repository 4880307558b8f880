"""From the parts' results to the figures of one condition."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.metrology.part_result import PartResult
from workbench.units import Bool, Float

GOALS = dict.fromkeys(
    ("paper", "straight", "arc", "wavy", "oblique", "two_pass", "reversed", "partial_view", "outliers_5", "missing_20",
     "clamps", "vibration", "limit"), (0.015, 0.06)
) | dict.fromkeys(("coarse", "noisy", "correlated"), (0.04, 0.25)) | {"robot_error": (0.03, 0.08)}  # fmt: skip
COVERAGE = (0.93, 0.97)  # of |error| <= 2u
MOST_U_OVER_BOUND = 3.0
GUARD_RISK = 0.05
GUARD = 1.645  # standard uncertainties
FAR_BEYOND = 2.0  # of them: a wrong verdict this far from the limit is no matter of the guard band's risk
RESAMPLES = 2000


@dataclass(frozen=True, slots=True)
class Quantity:
    """Root size (mm) or bevel angle (deg) over the parts of a condition."""

    p95: float  # over parts, of the greatest |error| over the sections
    median: float
    bias: float  # mean error, sign kept
    bias_u: float  # its standard uncertainty, from the scatter of the parts' means
    coverage: float  # share of sections with |error| <= 2u
    coverage_low: float  # 95 % interval, by resampling parts
    coverage_high: float
    mean_u: float
    bound_p95: float  # over parts, of the greatest bound of the sections
    u_over_bound: float  # mean over sections
    u_over_bound_p95: float  # 95th percentile of the sections
    goal: float

    @property
    def accurate(self) -> bool:
        return self.p95 <= self.goal

    @property
    def covered(self) -> bool:
        return COVERAGE[0] <= self.coverage <= COVERAGE[1]

    @property
    def surely_not_covered(self) -> bool:
        """Even the interval that the number of parts leaves open lies outside."""
        return self.coverage_high < COVERAGE[0] or self.coverage_low > COVERAGE[1]

    @property
    def sharp(self) -> bool:
        return self.u_over_bound <= MOST_U_OVER_BOUND


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


def quantity(results: list[PartResult], name: str, unit: str, goal: float) -> Quantity:
    """Errors, coverage and uncertainties of `root` in `mm` or `bevel` in `deg`."""
    value, true, u, bound = (
        [np.array(getattr(r, f"{name}{what}_{unit}"), dtype=float) for r in results]
        for what in ("", "_true", "_u", "_bound")
    )
    signed = [v - t for v, t in zip(value, true, strict=True)]
    error = [np.abs(e) for e in signed]
    means = np.array([np.nanmean(e) for e in signed if np.isfinite(e).any()])
    worst = np.array([greatest_error(r, name, unit) for r in results])
    inside = [(e <= 2 * w)[np.isfinite(e)] for e, w in zip(error, u, strict=True)]
    low, high = coverage_interval(inside)
    ratio = np.concatenate(u) / np.concatenate(bound)
    ratio = ratio[np.isfinite(ratio) & (ratio > 0)]
    return Quantity(
        p95=percentile(worst, 95),
        median=percentile(worst, 50),
        bias=float(means.mean()) if len(means) else float("nan"),
        bias_u=float(means.std() / max(1, len(means) - 1) ** 0.5) if len(means) else float("nan"),
        coverage=float(np.concatenate(inside).mean()) if inside else float("nan"),
        coverage_low=low,
        coverage_high=high,
        mean_u=float(np.nanmean(np.concatenate(u))) if u else float("nan"),
        bound_p95=percentile([np.nanmax(b) for b in bound if np.isfinite(b).any()], 95),
        u_over_bound=float(ratio.mean()) if len(ratio) else float("nan"),
        u_over_bound_p95=percentile(ratio, 95),
        goal=goal,
    )


def coverage_interval(inside: list[Bool]) -> tuple[float, float]:
    """95 % interval of the pooled share: parts are resampled whole, since the sections of one share their errors."""
    if not inside:
        return float("nan"), float("nan")
    hits, counts = np.array([i.sum() for i in inside]), np.array([len(i) for i in inside])
    chosen = np.random.default_rng(0).integers(0, len(inside), (RESAMPLES, len(inside)))
    shares = hits[chosen].sum(axis=1) / np.maximum(counts[chosen].sum(axis=1), 1)
    return percentile(shares, 2.5), percentile(shares, 97.5)


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


def percentile(values: Any, at: float) -> float:
    """NaN of nothing."""
    return (
        float(np.percentile(values, at, method="lower" if np.isinf(values).any() else "linear"))
        if len(values)
        else float("nan")
    )


def worst_parts(results: list[PartResult], count: int) -> list[tuple[str, float, PartResult]]:
    """What ("root error", "root error/u", ...), how much, which part: the worst of each, to look into."""
    found: list[tuple[str, float, PartResult]] = []
    good = [r for r in results if not (r.refused or r.crashed)]
    for name, unit in (("root", "mm"), ("bevel", "deg")):
        for what, score in ((f"{name} error", greatest_error), (f"{name} error/u", greatest_ratio)):
            scored = sorted(((score(r, name, unit), r) for r in good), key=lambda pair: -pair[0])
            found += [(what, value, r) for value, r in scored[:count]]
    return found


def greatest_error(r: PartResult, name: str, unit: str) -> float:
    """Over the sections; 0 if none was measured."""
    value, true = (np.array(getattr(r, f"{name}{what}_{unit}"), dtype=float) for what in ("", "_true"))
    return float(np.nanmax(np.abs(value - true), initial=0.0))


def greatest_ratio(r: PartResult, name: str, unit: str) -> float:
    """Of error over u, over the sections; 0 if none was measured."""
    value, true, u = (np.array(getattr(r, f"{name}{what}_{unit}"), dtype=float) for what in ("", "_true", "_u"))
    return float(np.nanmax(np.abs(value - true) / u, initial=0.0))
