"""What a recording can disprove of itself, before anything is measured: docs/checks.md."""

from workbench.artefacts.showing import shown_all
from workbench.checks.conventions import AS_READ, Convention, ProfileReading, known_conventions, known_profile_readings
from workbench.checks.judge import (
    NOT_JUDGED,
    consistent_conventions,
    judge_recording,
    judged,
    refuse_failed,
    refuse_unsound,
)
from workbench.checks.limits import LIMITS, Limit, Limits
from workbench.checks.motion import Consistency

__all__ = [
    "AS_READ",
    "LIMITS",
    "NOT_JUDGED",
    "Consistency",
    "Convention",
    "Limit",
    "Limits",
    "ProfileReading",
    "consistent_conventions",
    "judge_recording",
    "judged",
    "known_conventions",
    "known_profile_readings",
    "refuse_failed",
    "refuse_unsound",
]

shown_all(Consistency, Convention, Limit, ProfileReading)
del shown_all
