"""What planning gave for one simulated raw edge, as it is kept on disk."""

from __future__ import annotations

from dataclasses import dataclass, field

from bench.metrology.part_result import Numbers


@dataclass(slots=True)
class PlanResult:
    """Errors of the final layer and of the edge that it rests on; the lists have one entry a station, every few mm."""

    condition: str
    seed: int
    refused: str | None = None  # the stage's error, in one line
    crashed: str | None = None  # any other exception: a defect
    rejected: str | None = None  # by `path.check`, with its reason
    seen_share: float = 1.0  # of the part's edge, by truth
    layers: int = 0
    distance_mm: float | None = None  # greatest, of the cutting points from the finished bevel, along its normal
    axis_deg: float | None = None  # greatest angle of the cutter's axis against the true one
    spacing_error: float | None = None  # greatest |spacing - 1 mm| along the true lower edge, as a share
    covered: float | None = None  # share of the seen edge with cutting points
    reachable_covered: float | None = None  # likewise, of what is clear of hidden stretches
    wrong_side: bool = False  # the cutter on the wrong side, or fed backwards
    blind_points: int = 0  # that cut where the edge is hidden
    stations_invented: int = 0  # of the edge, said to be seen where it is hidden
    normal_error_mm: Numbers = field(default_factory=list)  # of the lower edge, along n
    normal_u_mm: Numbers = field(default_factory=list)
    across_error_mm: Numbers = field(default_factory=list)  # along m
    across_u_mm: Numbers = field(default_factory=list)
    turn_error_deg: Numbers = field(default_factory=list)  # of n about t
    turn_u_deg: Numbers = field(default_factory=list)
    plane_deg: float | None = None  # turn of the plane through the true face, rough as it is, about t
    seconds: dict[str, float] = field(default_factory=dict)
