"""Conformity of measured values (ISO 14253-1)."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from workbench.artefacts import Part, Quantity, Section, Uncertainty, Unseen, Verdict, conformity
from workbench.artefacts.evidence import ACCEPTED
from workbench.units import COVERAGE

RANK: dict[Verdict, int] = {"pass": 0, "undecided": 1, "fail": 2}
NOTHING_REQUIRED = "no specification: measured, conformity not assessed"
NO_HAND_EYE = Unseen("hand_eye", "The uncertainty of the hand-eye calibration: the calibration in use states none.")
PROVIDED = "pass, provided that there is none of these: {}"


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """'fail' before 'undecided' before 'pass'; 'undecided' of none."""
    return max(verdicts, key=lambda v: RANK[v], default="undecided")


WORDS: dict[Verdict, str] = {
    "pass": "within tolerance",
    "undecided": "too near a limit to decide",
    "fail": "out of tolerance",
}


def judged(
    sizes: Mapping[str, Quantity],
    required: Mapping[str, tuple[float, tuple[float, float]]],
    terms: Mapping[str, tuple[str, str]],
    guard_factor: float,
) -> tuple[Verdict, str]:
    """Verdict of one section by all that is required of it, and the reason in words; a size not seen is undecided."""
    found: dict[str, tuple[Verdict, str]] = {}
    for name, wanted in required.items():
        one = sizes.get(name)
        if one is None or not np.isfinite(one.value) or not np.isfinite(one.u):
            found[name] = "undecided", "not seen"
            continue
        verdict = conformity(float(one.value), float(one.u), *wanted, guard_factor)
        found[name] = verdict, WORDS[verdict]
    reason = ", ".join(f"{terms[name][0].lower()} {words}" for name, (_, words) in found.items())
    return worst(verdict for verdict, _ in found.values()), reason or NOTHING_REQUIRED


def reason_of(sections: Sequence[Section], required: bool) -> str:
    """The part's verdict in words."""
    if not required:
        return NOTHING_REQUIRED
    for verdict, words in (("fail", "fail"), ("undecided", "undecided")):
        such = [s for s in sections if s.verdict == verdict]
        if such:
            return f"{len(such)} of {len(sections)} sections {words}: section {such[0].index}: {such[0].reason}"
    return f"all {len(sections)} sections within tolerance"


def of_a_joint(part: Part, *unseen: Unseen) -> Uncertainty:
    """What the uncertainty of a joint's sizes does not hold, whose cost nobody knows."""
    return Uncertainty(not_included=(*unseen, *(() if part.hand_eye_u_mm is not None else (NO_HAND_EYE,))))


def material(unseen: Sequence[Unseen], sections: Sequence[Section]) -> tuple[Unseen, ...]:
    """Those that may cost more than U, or nobody knows what; the dearest first, and that one in any case.

    U (k = 2) is that of the section where it is largest.
    """

    def share(one: Unseen) -> float:
        if one.is_doubt or not one.costs:
            return math.inf
        return max(cost / largest(name) for name, cost in one.costs.items())

    def largest(name: str) -> float:
        return COVERAGE * max((u for s in sections if np.isfinite(u := float(s.sizes[name].u))), default=math.inf)

    ranked = sorted(unseen, key=share, reverse=True)
    return tuple(one for one in ranked if one is ranked[0] or share(one) > 1.0)


def of_the_part(
    sections: Sequence[Section],
    unseen: Sequence[Unseen],
    required: Mapping[str, tuple[float, tuple[float, float]]],
    guard_factor: float,
    accepted: Collection[str],
) -> tuple[Verdict, str, tuple[Unseen, ...], tuple[str, ...]]:
    """Verdict and reason of a part; what its pass rests on and nobody accepted by name; warnings of what was."""
    verdict, reason = worst(s.verdict for s in sections), reason_of(sections, bool(required))
    if verdict != "pass":
        return verdict, reason, (), ()
    rests_on = conditions(unseen, sections, required, guard_factor)
    left = tuple(one for one in rests_on if one.name not in accepted)
    known = [one for one in rests_on if one not in left]
    notes = tuple(f"{ACCEPTED}, {one.name}: {one.told}" for one in known)
    if not left:
        named = f"; {ACCEPTED}: {', '.join(one.name for one in known)}" if known else ""
        return verdict, reason + named, (), notes
    return "undecided", PROVIDED.format(" ".join(one.told for one in left)), left, notes


def conditions(
    unseen: Sequence[Unseen],
    sections: Sequence[Section],
    required: Mapping[str, tuple[float, tuple[float, float]]],
    guard_factor: float,
) -> tuple[Unseen, ...]:
    """What a pass rests on: doubts, and what would carry a size of some section out of its limits."""

    def rests(one: Unseen) -> bool:
        return one.is_doubt or any(
            conformity(float(size.value) + sign * cost, float(size.u), *required[name], guard_factor) != "pass"
            for section in sections
            for name, cost in one.costs.items()
            if cost and name in required and (size := section.sizes.get(name))
            for sign in (-1.0, 1.0)
        )

    return tuple(one for one in unseen if required and not one.exchanges and rests(one))
