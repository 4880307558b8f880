"""What the measured loop gave for one simulated raw edge, as it is kept on disk."""

from __future__ import annotations

from dataclasses import dataclass, field

from bench.metrology.part_result import Numbers


@dataclass(slots=True)
class MeasuredResult:
    """Finished part and blind one by their truth, beside inspection and correction.

    `places`: every 2 mm of the edge where the finishing pass cuts; `sections`: as inspected.
    """

    condition: str
    seed: int
    refused: str | None = None  # a stage's error, or a check that refused a path, in one line
    beyond: str | None = None  # `path.correct` refused: more than the allowance allows
    crashed: str | None = None  # any other exception: a defect
    seen_share: float = 1.0  # of the raw edge, by truth
    shape: str = ""
    error_mm: float = 0.0  # of tool and hand-eye together, along the bevel's normal, mean along the edge
    places: dict[str, Numbers] = field(default_factory=dict)  # see `measured.part.compare`
    sections: dict[str, Numbers] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
