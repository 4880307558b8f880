"""What one simulated calibration gave, as it is kept on disk."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class CalibrationResult:
    """Errors over the field of view ("vol", RMS of a point), their bounds, and what the calibration said of itself."""

    condition: str
    seed: int
    refused: str | None = None  # the stage's error, in one line
    crashed: str | None = None  # any other exception: a defect
    vol_mm: float | None = None  # error
    bound_mm: float | None = None  # Cramer-Rao bound, at the truth
    u_mm: float | None = None  # as the calibration predicts it
    nees: float | None = None  # squared error of the six unknowns in units of the stated covariance: chi-square, 6
    rotation_deg: float | None = None  # error
    offset_ms: float | None = None  # error of the clock's offset
    offset_bound_ms: float | None = None
    offset_covered: bool | None = None  # within 1.96 times its stated uncertainty
    signs_wrong: int = 0  # postures put on the wrong side of the laser plane
    wrong: bool = False  # the error is beyond all uncertainty, whatever is said
    warned: bool = False
    flagged: bool = False  # a misfit that repeatability cannot explain
    gross_found: bool | None = None  # all postures that are grossly off were rejected
    sound_rejected: int = 0  # postures that are not
    correlated_nees: float | None = None  # with robot_error 'correlated'
    correlated_vol_mm: float | None = None
    random_mm: float | None = None  # median bound of random postures within a plan's limits
    others: dict[str, float] = field(default_factory=dict)  # method -> vol error
    seconds: dict[str, float] = field(default_factory=dict)
