"""What one simulated identification gave, as it is kept on disk."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class StiffnessResult:
    """Relative errors of the six joints, their bound, and what the identification said of itself."""

    condition: str
    seed: int
    refused: str | None = None  # the stage's error, in one line
    crashed: str | None = None  # any other exception: a defect
    loads: list[int] = field(default_factory=list)  # at each posture
    error: list[float] = field(default_factory=list)  # (6,) of the stiffness, relative
    bound: list[float] = field(default_factory=list)  # (6,) Cramer-Rao bound, relative, at the truth
    stated: list[float] = field(default_factory=list)  # (6,) standard uncertainty over the true value
    nees: float | None = None  # squared error in units of the stated covariance: chi-square, 6
    put_aside: int = 0  # loads and points that were taken for gross errors; none is
    warned: bool = False
    seconds: dict[str, float] = field(default_factory=dict)
