"""Conformity of measured values (ISO 14253-1)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from workbench.artefacts import GrooveSection, Part, Quantity, Section, Uncertainty, Verdict, conformity
from workbench.artefacts.evidence import UNSEEN

RANK: dict[Verdict, int] = {"pass": 0, "undecided": 1, "fail": 2}
NOT_INCLUDED = (
    *UNSEEN,
    "Thermal expansion: values hold at the temperature of the measurement and are not corrected to 20 °C (ISO 1).",
)
NOTHING_REQUIRED = "no specification: measured, conformity not assessed"
NO_HAND_EYE = "The uncertainty of the hand-eye calibration: the calibration in use states none."


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


def reason_of(sections: Sequence[Section | GrooveSection], required: bool) -> str:
    """The part's verdict in words."""
    if not required:
        return NOTHING_REQUIRED
    for verdict, words in (("fail", "fail"), ("undecided", "undecided")):
        such = [s for s in sections if s.verdict == verdict]
        if such:
            return f"{len(such)} of {len(sections)} sections {words}: section {such[0].index}: {such[0].reason}"
    return f"all {len(sections)} sections within tolerance"


def not_included(part: Part, *particular: str) -> Uncertainty:
    """What the uncertainty of a part's sizes does not hold."""
    hand_eye = () if part.hand_eye_u_mm is not None else (NO_HAND_EYE,)
    return Uncertainty(not_included=(*NOT_INCLUDED, *particular, *hand_eye))
