"""What was checked of a recording, an edge or a path, and what was found."""

from __future__ import annotations

from dataclasses import dataclass

UNSEEN = (
    "Errors of scale and linearity of the profile sensor: see its calibration certificate.",
    "Errors of the robot's position that stay constant within a pass, such as those of its kinematic calibration; "
    "where a pass has only the poses of its two ends, how far the robot left the straight line between them.",
    "A rotation of the laser plane by up to 20°, a displaced hand-eye pose, mirrored axes, an orientation that was not "
    "measured, and a scale error or the reverse sense of the robot's travel: passes in which the flange hardly turns "
    "do not reveal them.",
    "An offset between the clocks of profiler and robot, unless the motion shows it: it moves values along the edge.",
    "A burr in the plane of the root face or end face, or a loss of returns at its end, along the whole edge: no "
    "profile reveals it. An allowance for it can be declared.",
    "What stands back below the root face or end face, in the shadow that it throws along the rays (an undercut).",
)  # what no recording of a straight edge shows


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
