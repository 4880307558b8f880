"""What the closed loop gave for one simulated raw edge, as it is kept on disk."""

from __future__ import annotations

from dataclasses import dataclass, field

from bench.metrology.part_result import Numbers


@dataclass(slots=True)
class LoopResult:
    """Sections as inspected and as milled, by case: 'perfect' mechanics, and 'errors' of hand-eye and robot."""

    condition: str
    seed: int
    refused: str | None = None  # a stage's error, in one line
    crashed: str | None = None  # any other exception: a defect
    seen_share: float = 1.0  # of the raw edge, by truth
    cases: dict[str, dict[str, Numbers]] = field(default_factory=dict)  # case -> see `loop.part.compare`
    cut: dict[str, list[bool]] = field(default_factory=dict)  # case -> whether the plan cuts all about each section
    warnings: dict[str, list[str]] = field(default_factory=dict)  # case -> of the mill
    seconds: dict[str, float] = field(default_factory=dict)
