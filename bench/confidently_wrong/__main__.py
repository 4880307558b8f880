"""`python -m bench.confidently_wrong --parts 20 --plans 10 --good 40`: the table of docs/confidently_wrong.md."""

from __future__ import annotations

from argparse import Namespace
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from bench.confidently_wrong.kinds import KINDS, Kind
from bench.drawn.seeds import nominal_sizes
from bench.harness import Option, Study
from bench.score.face import rough_upper_side
from bench.score.named import ANALYTIC, SWEPT, simulated
from bench.tables import folded, markdown
from workbench.artefacts import Check, Inspection, PointSet, Recording
from workbench.checks import judge_recording
from workbench.cloud import denoise
from workbench.edge import segment, segment_cloud, segment_raw
from workbench.errors import WorkbenchError
from workbench.inspect import sections
from workbench.path import check, feed, layers
from workbench.scan import fuse
from workbench.synthetic import Truth
from workbench.units import Float

SEED = 2_000_000  # from here on; not used for developing
INSPECTED = (  # of two simulators in turn
    "straight",
    "swept_twist",
    "arc",
    "swept_space_wave",
    "oblique",
    "swept_ring",
    "two_pass",
    "swept_clamps",
    "robot_error",
    "swept_lost_blocks",
)
PLANNED = ("raw_straight", "swept_raw_twist", "raw_arc", "swept_raw_ring", "raw_two_pass", "swept_raw_saddle")
CONDITION, NAMED = "wrong, on a condition", "wrong, named as not included"
CLASSES = (
    "right",
    "honest",
    "refused, right suspicion",
    "refused, other suspicion",
    CONDITION,
    NAMED,
    "confidently wrong",
    "crashed",
)
SHORT = {
    "refused, right suspicion": "refused",
    "refused, other suspicion": "otherwise",
    CONDITION: "conditional",
    NAMED: "named",
}
EXPECTED = ("right", "refused, right suspicion")
MOST = 2  # kinds that a class names, those with most parts
FLOOR_MM, FLOOR_DEG = 0.02, 0.1  # below these a difference to the truth at a place known to a few mm is none
WIDE_MM, WIDE_DEG = 1.0, 2.0  # off the drawing that any of the parts passes
HONEST_MM, HONEST_DEG = 0.25, 0.5  # u of what nobody would call confident: half of the default tolerance
Found = dict[str, dict[str, Counter[str]]]  # by what was asked for and kind of corruption, how many ended how
PATH_MM = 0.5  # off the true edge by less than robots err


def inspected(recording: Recording, truth: Truth, kind: Kind) -> str:
    """The class of an inspection."""
    inspection = passing(recording, truth, kind)
    told = [s for s in inspection.sections if s.values["root_mm"] is not None]
    count = len(inspection.sections)
    share = np.array([(s.index - 0.5) / count for s in told])
    seen = truth.arc_length_mm[truth.seen]
    places = [seen[0] + one * (seen[-1] - seen[0]) for one in (share, 1.0 - share)]
    if told:  # where only a part of the edge was left in view
        places.append(truth.arc_length_mm_at(np.array([s.origin_mm for s in told])))
    wrong = min((_wrong(told, truth, at) for at in places), default=0)
    if wrong > 2:
        return CONDITION if inspection.verdict != "pass" else _wrong_class(kind, inspection.checks)
    vague = [s for s in told if s.values["root_u_mm"] > HONEST_MM or s.values["bevel_u_deg"] > HONEST_DEG]
    return "honest" if len(told) - len(vague) < count / 2 else "right"


def passing(recording: Recording, truth: Truth, kind: Kind) -> Inspection:
    """The inspection by a user whose drawing says the true sizes, to 0.5 mm and 5 deg, and allows much."""
    root, bevel = float(truth.root_mm.mean()), float(truth.bevel_deg.mean())
    near = nominal_sizes(root, bevel)
    cloud = denoise(fuse(recording))
    if kind.as_cloud:
        points = cloud.placed(*np.nonzero(cloud.keep))
        edge: Any = segment_cloud(PointSet(points, recording.source), **near)[1]
    else:
        edge = segment(cloud, **near, thickness_mm=float(truth.thickness_mm.mean()) if kind.thickness else None)
    limits = {"root_tolerance_mm": (-WIDE_MM, WIDE_MM), "bevel_tolerance_deg": (-WIDE_DEG, WIDE_DEG)}
    return sections(edge, root_nominal_mm=root, bevel_nominal_deg=bevel, **limits)


def _wrong(told: list, truth: Truth, at: Float) -> int:
    """How many sections are off the truth at arc lengths `at` (k,) mm by more than 3 u."""
    root = np.interp(at, truth.arc_length_mm, truth.root_mm)
    bevel = np.interp(at, truth.arc_length_mm, truth.bevel_deg)
    return sum(
        abs(s.values["root_mm"] - r) > max(3 * s.values["root_u_mm"], FLOOR_MM)
        or abs(s.values["bevel_deg"] - b) > max(3 * s.values["bevel_u_deg"], FLOOR_DEG)
        for s, r, b in zip(told, root, bevel, strict=True)
    )


def planned(recording: Recording, truth: Truth, kind: Kind) -> str:
    """The class of a plan: wrong if a path passes its check although it lies off the true edge.

    Naming what no recording can show excuses a shape only; one that a program may be written of is confidently wrong.
    """
    cloud = denoise(fuse(recording))
    edge = segment_raw(cloud, upper_side=rough_upper_side(truth))  # with all defaults
    decision = check(feed(layers(edge, cloud), cloud, edge), edge, cloud)
    if not decision.passed:
        return "honest"
    place = edge.position_mm[np.isfinite(edge.position_mm[:, 0])]
    apart = np.array([np.linalg.norm(truth.position_mm - p, axis=1).min() for p in place[:: max(1, len(place) // 50)]])
    off = float(np.median(apart))
    if off < PATH_MM:
        return "right"
    return _wrong_class(kind, edge.checks) if decision.shape_only else "confidently wrong"


def _wrong_class(kind: Kind, checks: tuple[Check, ...]) -> str:
    """Whether the results say that it could not be seen: a sensor's scale, a flange that hardly turns, a still part."""
    told = " ".join(check.finding for check in checks if check.passed)
    named = {
        "flange": "nor a hand-eye" in told,
        "window": "beside a column that hardly ever returns" in told,
        "clock": "does not show whether the clocks agree" in told,
        "order": "frames out of order; the recording does not show which" in told,
        "digits": "were they rounded, or commanded instead" in told,
        "poses": "poses only: noise in them" in told,
    }
    seen = kind.unseen not in ("sensor", "travel", "end") and not named.get(kind.unseen, False)
    return "confidently wrong" if seen else NAMED


JUDGES = {"inspections": (inspected, INSPECTED), "plans": (planned, PLANNED)}
LARGEST = 900  # characters of the table that stays in the page


def drawn(given: Namespace) -> list[tuple[str, int, int, tuple[str, ...]]]:
    """Judge, seed, number and kinds of every part."""
    kinds = tuple(name for name in KINDS if not given.kinds or any(word in name for word in given.kinds))
    counts = {"inspections": given.parts, "plans": given.plans}
    return [(name, given.seed, k, kinds) for name, count in counts.items() for k in range(count)]


def report(parts: Sequence[tuple[str, dict[str, str]]], given: Namespace) -> Iterator[str]:
    """How parts end, of all kinds and of each; good ones that fail a check."""
    found: Found = {name: defaultdict(Counter) for name in JUDGES}
    for name, outcomes in parts:
        for kind, outcome in outcomes.items():
            found[name][kind][outcome] += 1
    yield from table(found)
    yield from ("", "## Corruptions", "")
    yield from markdown(["corruption", *found], every_kind(found))
    yield from ("", *_false_refusals(given.good, given.seed))


def spoilt_part(task: tuple[str, int, int, tuple[str, ...]]) -> tuple[str, dict[str, str]]:
    """Of a part and each kind of corruption the class that it ends in."""
    name, seed, k, kinds = task
    judge, conditions = JUDGES[name]
    recording, truth = simulated(conditions[k % len(conditions)], seed + k)
    rng = partial(np.random.default_rng, [seed, k])
    return name, {kind: _outcome(judge, KINDS[kind], recording, truth, rng()) for kind in kinds}


def table(found: Found) -> list[str]:
    """Lines of Markdown: how many parts ended in each class, and most kinds of those to look at."""
    rows = [[SHORT.get(one, one), *(_by_kind(of, one) for of in found.values())] for one in CLASSES]
    return markdown(["outcome", *found], rows)


def _by_kind(outcomes: dict[str, Counter[str]], outcome: str) -> str:
    found = Counter({name: one[outcome] for name, one in outcomes.items() if one[outcome] and name != "nothing"})
    most = "" if outcome in EXPECTED else ", ".join(f"{name} ({count})" for name, count in found.most_common(MOST))
    return f"{found.total()}" + (f": {most}" if most else "") + (", ..." if most and len(found) > MOST else "")


def every_kind(found: Found) -> list[list[str]]:
    """A row for each kind of corruption: what its inspections and its plans ended in."""

    def told(ended: Counter[str]) -> str:
        return ", ".join(f"{ended[one]} {SHORT.get(one, one)}" for one in CLASSES if ended[one])

    return [[kind, *(told(of[kind]) for of in found.values())] for kind in next(iter(found.values()))]


def _outcome(judge: Any, kind: Kind, recording: Recording, truth: Truth, rng: np.random.Generator) -> str:
    try:
        spoilt = kind.spoil(recording, rng)
        return judge(kind.lost.of(spoilt, truth) if kind.lost else spoilt, truth, kind)
    except WorkbenchError as error:
        return f"refused, {'right' if any(word in str(error) for word in kind.words) else 'other'} suspicion"
    except Exception:
        return "crashed"


def _false_refusals(count: int, seed: int) -> list[str]:
    failed, recordings = [], 0
    for condition in [*ANALYTIC, *SWEPT]:
        for k in range(count):
            recording, _ = simulated(condition, seed + 500 + k)
            recordings += 1
            failed += [f"{condition} {seed + 500 + k}: {c.name}" for c in judge_recording(recording) if not c.passed]
    told = f"{len(failed)} of {recordings} good recordings of two simulators, under all their conditions, fail a check"
    return ["## False refusals", "", told + (f": {'; '.join(failed[:20])}." if failed else ".")]


STUDY = Study(
    "confidently_wrong",
    str(__doc__),
    {
        "parts": Option(20, "inspected parts a kind"),
        "plans": Option(10, "planned parts a kind"),
        "good": Option(30, "good recordings a condition, for false refusals"),
        "seed": Option(SEED),
        "kinds": Option((), "only kinds whose name holds one of these words"),
    },
    drawn,
    spoilt_part,
    report,
    "confidently_wrong.md",
    put=partial(folded, largest=LARGEST),
)
if __name__ == "__main__":
    STUDY()
