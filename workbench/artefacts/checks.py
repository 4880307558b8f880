"""What was checked of a recording, an edge or a path, and what was found."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Check:
    """One plausibility check. Checks travel with what they are of: recording, cloud, edge, inspection, toolpath.

    The unit of `value` and `limit` stands in `name`; a name without one is a pure number.
    """

    name: str  # such as 'obliquity_deg'
    value: float | None  # None: nothing to judge by, and `finding` says why
    limit: float | tuple[float, float] | None  # greatest allowed value, or least and greatest; None: told only
    passed: bool
    reason: str  # why the limit is where it is
    finding: str = ""  # what was found, in words; of a failed check: the suspicion
    loosened: bool = False  # a parameter made it weaker than the rule: results say so, and a path then ends in exit 1
