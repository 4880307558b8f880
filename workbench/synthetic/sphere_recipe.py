"""What a synthetic calibration recording is made from: a sphere, where the scanner sees it, robot and disturbances.

The *view* of a scanner has its origin on the laser's axis at the stand-off: x lateral as in the profiler frame, y
normal to the laser plane, range away from the sensor, whatever the sense of z. Lengths in mm, angles in degrees.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from workbench.synthetic.recipe import Disturbances, Noise, NonNegative, Number, Placement, Positive, Scanner, Strict
from workbench.synthetic.recipe import Triple as Vector

_MOST_FRAMES = 20_000


class Sphere(Strict):
    """The sphere on its stem above a table, whose normal points at the sensor in the nominal posture, less a tilt."""

    diameter_mm: Annotated[float, Field(ge=2, le=200)] = 10.0
    stated_diameter_mm: Positive | None = None  # in the recording; None: the true one
    center_mm: Vector = (1890.33, 241.48, 1079.72)
    table_gap_mm: Positive | None = None  # below the sphere; None: no table
    table_tilt_deg: tuple[Number, Number] = (0.0, 0.0)
    stem_diameter_mm: NonNegative = 0.0


class SpherePass(Strict):
    """A posture held still, or (`to_mm`) a scan over the sphere, straight in the view or weaved."""

    sphere_mm: Vector  # the sphere's centre in the view: x, y, range
    turn_deg: Vector = (0.0, 0.0, 0.0)  # of the flange from its nominal orientation: rotation vector, flange frame
    repeats: Annotated[int, Field(ge=1, le=1000)] = 1  # frames held still
    to_mm: Vector | None = None  # a scan: where the centre lies at its end
    seconds: Annotated[float, Field(gt=0, le=100)] = 1.0
    weave_mm: NonNegative = 0.0  # amplitude in x, with 1.5 waves a scan, and in range, with 2.5
    weave_deg: NonNegative = 0.0  # amplitude of a swing about an oblique axis, with two waves
    center_mm: Vector | None = None  # of the sphere now: another sphere, or on a table that turned; None: the sphere's
    gross_mm: Vector = (0.0, 0.0, 0.0)  # what the recorded pose is off, beyond the noise


class SphereRobot(Strict):
    """The robot: what it does, what it records, and what its hand-eye pose is by design."""

    flange_from_profiler: Placement = Placement(position_mm=(126.92, 9.44, 41.48), rpy_deg=(60.489, -3.813, -2.024))
    design_error_mm: NonNegative = 0.0  # size of a shift in a random direction
    design_error_deg: NonNegative = 0.0  # size of a turn about a random axis
    nominal_rpy_deg: Vector = (20.0, 65.0, 10.0)
    frame_rate_hz: Positive = 50.0
    pose_rate_hz: Positive = 100.0
    pose_margin_s: NonNegative = 0.3  # of recorded poses, before and after a scan
    pose_noise_mm: NonNegative = 0.07
    pose_noise_deg: NonNegative = 0.01
    pose_noise_common: Annotated[float, Field(ge=0, le=1)] = 0.0  # share of its variance that a scan's poses share
    systematic_mm: NonNegative = 0.0  # of each axis, RMS: an error that is smooth in the posture
    systematic_reach_deg: Annotated[float, Field(ge=5, le=720)] = 90.0  # its wavelength; a metre counts as a radian
    clock: Literal["robot", "own"] = "robot"
    clock_offset_s: Annotated[float, Field(ge=-10, le=10)] = 0.0  # profile time - robot time


class SphereRecipe(Strict):
    """A synthetic calibration recording in full. The same recipe gives the same bytes."""

    format: Literal["sphere-recipe"]
    version: Literal[1] = 1
    title: str = ""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    sphere: Sphere = Sphere()
    scanner: Scanner = Scanner(noise=Noise(sd_mm=0.015, grazing_power=0.0))
    robot: SphereRobot = SphereRobot()
    disturbances: Disturbances = Disturbances()
    passes: Annotated[tuple[SpherePass, ...], Field(min_length=1, max_length=1000)]

    @model_validator(mode="after")
    def _bounded(self) -> SphereRecipe:
        frames = sum(p.repeats if p.to_mm is None else p.seconds * self.robot.frame_rate_hz for p in self.passes)
        if frames > _MOST_FRAMES:
            raise ValueError(f"at most {_MOST_FRAMES} frames in all")
        if self.scanner.intensity:
            raise ValueError("scanner.intensity is not simulated for a sphere")
        if self.robot.clock == "robot" and self.robot.clock_offset_s != 0:
            raise ValueError("clock_offset_s needs clock 'own'")
        return self
