"""What the calibration's stages exchange. mm, s, rad; n circles, N frames, M columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from workbench.api import UNKNOWN_PART, Bool, Float, HandEye, Int, Part, Shaped

if TYPE_CHECKING:
    from workbench.plugins.calibration.model import Noise, View

Method = Literal["bundle", "analytic", "genetic"]


@dataclass(frozen=True, slots=True, eq=False)
class Rejected:
    """A frame that does not count, and why."""

    frame: int  # index in the recording
    cause: str


@dataclass(frozen=True, slots=True, eq=False)
class SphereProfiles:
    """The circles in which the laser plane cuts the calibration sphere, one a frame, in the profiler frame."""

    frame: Shaped[Int, " n"]  # index in the recording
    circle: Shaped[Float, "n 3"]  # x_c mm, z_c mm, w = r^2 mm^2
    covariance: Shaped[Float, "n 3 3"]  # of them, from the points' noise
    on_arc: Shaped[Bool, "N M"]  # which points of the grid count
    sense: int  # +1: z counts towards the sensor; -1: away from it (from the arcs' convexity)
    noise_mm: float  # of a point along z, as found in all arcs, or as stated if that is larger
    stated_noise_mm: float
    correlation: float  # of the noise of neighbouring columns; the covariances contain it
    sphere_diameter_mm: float
    rejected: tuple[Rejected, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A hand-eye calibration with all that its report tells. k postures (or frames of a scan)."""

    hand_eye: HandEye
    method: Method
    sphere_center_mm: Shaped[Float, " 3"]  # in the base
    sphere_radius_mm: float
    covariance: Shaped[Float, "6 6"]  # as in HandEye
    volume_u_mm: float  # predicted RMS error of a point over the field of view around the sphere centres
    directions: tuple[tuple[str, float], ...]  # six, worst first: in words, and their uncertainty in mm over the field
    time_offset_s: float | None  # profile time - robot time; None: not estimated
    time_offset_u_s: float | None
    frames: tuple[tuple[int, ...], ...]  # (k) frames of the recording that each posture rests on
    centre_mm: Shaped[Float, "k 3"]  # sphere centre in the profiler frame: measured x and z, y by the answer
    center_base_before_mm: Shaped[Float, "k 3"]  # centre in the base by the design's hand-eye; NaN without one
    center_base_mm: Shaped[Float, "k 3"]  # by the answer
    residual: Shaped[Float, "k 3"]  # of x_c mm, z_c mm, w mm^2
    distance: Shaped[Float, " k"]  # Mahalanobis distance of the residual, left out of the fit; 1.7 is usual
    used: Shaped[Bool, " k"]  # False: rejected as gross
    residual_rms_mm: float  # RMS distance of the measured points from the sphere
    misfit: float  # chi-square over degrees of freedom, the stated noise taken for true
    noise: Noise  # that the answer rests on: of the poses as large as the residuals say
    view: View  # the field of view
    systematic_mm: float | None  # amplitude of the robot's systematic error; None: not estimated
    frames_used: tuple[int, ...]
    frames_rejected: tuple[Rejected, ...]
    warnings: tuple[str, ...]
    good_enough: bool  # for the tolerances that were given
    verdict: str  # in words
    sensor_scale_u: tuple[float, float] = (0.0, 0.0)  # of hand_eye.sensor_scale
    not_included: tuple[str, ...] = ()  # errors that no posture shows, with their size
    part: Part = UNKNOWN_PART  # sensor, robot and date of the recording


@dataclass(frozen=True, slots=True, eq=False)
class PosturePlan:
    """The next p postures that tell most. `volume_u_mm` is predicted from the noise that the residuals show."""

    base_from_flange: Shaped[Float, "p 4 4"]  # to go to, in order
    centre_mm: Shaped[Float, "p 3"]  # where the sphere's centre will lie in the profiler frame
    volume_u_mm: Float  # (p + 1,) now, and after each posture
    middle_mm: tuple[float, float]  # of the view: x, z in the profiler frame
    half_mm: tuple[float, float]  # half width and half height within which the sphere is shown


@dataclass(frozen=True, slots=True, eq=False)
class Validation:
    """How well a calibration predicts postures that it was not made from. k postures."""

    how: str  # in words
    frames: tuple[tuple[int, ...], ...]  # (k)
    # measured minus predicted sphere centre in the profiler frame; y NaN near the equator
    error_mm: Shaped[Float, "k 3"]
    u_mm: Shaped[Float, "k 3"]  # standard uncertainty of that: calibration, robot and profile
    rms_mm: float  # of the errors in x and z
    expected_mm: float  # RMS of their uncertainty
    misfit: float  # chi-square over degrees of freedom; 1 where the stated uncertainties are right
    freedom: int
