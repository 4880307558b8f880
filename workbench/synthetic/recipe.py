"""What a synthetic recording is made from: part, scanner, robot and disturbances, as one JSON document.

Every key is documented in `docs/tables/simulation_keys.csv`. Lengths in mm, angles in degrees (`_deg`), times in s.
The part's frame: the lower surface lies in z = 0, the plate above it; the lower edge starts at the origin and runs
along +x, the plate to its left (+y), so that t = x, n = -y, m = z there.

A calibration recording has a sphere instead of the part, and where the scanner sees it. The *view* of a scanner has its
origin on the laser's axis at the stand-off: x lateral as in the profiler frame, y normal to the laser plane, range away
from the sensor, whatever the sense of z.

Straight weld grooves are such documents too (`"format": "groove-recipe"`). There the groove runs
along +x, its middle at y = 0, the left plate at +y; the left plate's lower surface lies in z = 0.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from workbench.units import DEG, Float

_MOST = 1e5  # no length, angle or rate of a recipe is greater
_MOST_FRAMES, _MOST_POSES = 1_000_000, 5_000_000
_MOST_SPHERE_FRAMES = 20_000

Number = Annotated[float, Field(ge=-_MOST, le=_MOST)]
Positive = Annotated[float, Field(ge=1e-6, le=_MOST)]
NonNegative = Annotated[float, Field(ge=0, le=_MOST)]
Triple: TypeAlias = tuple[Number, Number, Number]
Share = Annotated[float, Field(ge=0, le=0.9)]


class Strict(BaseModel):
    """Unknown keys, infinities and NaN are refused; a recipe does not change once made."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Course(Strict):
    """A value along the edge, in its key's unit: linear from `start` to `end`, plus a sine wave."""

    start: Number
    end: Number
    amplitude: Number = 0.0
    wavelength_mm: Positive = 100.0
    phase_deg: Number = 0.0

    def at(self, s: Float, length_mm: float) -> Float:
        """The values at s, mm from the start of an edge of this length."""
        wave = self.amplitude * np.sin(2 * math.pi * s / self.wavelength_mm + self.phase_deg * DEG)
        return np.asarray(self.start + (self.end - self.start) * s / length_mm + wave)

    @property
    def lowest(self) -> float:
        return min(self.start, self.end) - abs(self.amplitude)

    @property
    def highest(self) -> float:
        return max(self.start, self.end) + abs(self.amplitude)


def _constant(value: Any) -> Any:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return {"start": value, "end": value}
    return value


Along = Annotated[Course, BeforeValidator(_constant)]


class Placement(Strict):
    """A pose: translation, and R = Rz(roll) Ry(pitch) Rx(yaw) as in the paper."""

    position_mm: Triple = (0.0, 0.0, 0.0)
    rpy_deg: Triple = (0.0, 0.0, 0.0)


class Curve(Strict):
    """Plan curve of the lower edge. An arc is convex (centre on the plate's side) or concave; a wave is a sine."""

    shape: Literal["straight", "arc", "wavy"] = "straight"
    radius_mm: Annotated[float, Field(ge=100, le=_MOST)] = 1000.0
    sense: Literal["convex", "concave"] = "convex"
    amplitude_mm: Annotated[float, Field(ge=0, le=10)] = 3.0
    wavelength_mm: Annotated[float, Field(ge=50, le=_MOST)] = 200.0
    phase_deg: Number = 0.0

    @model_validator(mode="after")
    def _sound(self) -> Curve:
        if self.shape == "wavy" and self.amplitude_mm * (2 * math.pi / self.wavelength_mm) ** 2 > 1 / 50:
            raise ValueError("the wave must bend with a radius of at least 50 mm")
        return self


class Burr(Strict):
    """A ridge that stands out of the root face at its lower edge, or out of the upper surface at its edge."""

    edge: Literal["lower", "upper"] = "lower"
    from_mm: Number
    to_mm: Number
    height_mm: Annotated[float, Field(gt=0, le=3)] = 0.3
    width_mm: Annotated[float, Field(gt=0, le=5)] = 0.4


class Clamp(Strict):
    """A box over the edge from `from_mm` to `to_mm`: it hides the edge there."""

    from_mm: Number
    to_mm: Number
    reach_in_mm: Positive = 40.0
    reach_out_mm: Positive = 6.0
    height_mm: Positive = 15.0


class Part(Strict):
    """A plate with one edge. Angles and sizes hold in the section plane, normal to the lower edge's tangent."""

    kind: Literal["milled", "raw"] = "milled"
    length_mm: Annotated[float, Field(ge=5, le=20000)] = 120.0
    curve: Curve = Curve()
    thickness_mm: Along = Course(start=8.0, end=8.0)
    root_mm: Along = Course(start=1.5, end=1.5)
    bevel_deg: Along = Course(start=40.0, end=40.0)
    end_face_tilt_deg: Annotated[float, Field(ge=-20, le=20)] = 0.0
    end_face_twist_deg: Annotated[float, Field(ge=-30, le=30)] = 0.0
    roughness_mm: Annotated[float, Field(ge=0, le=0.3)] = 0.0
    plate_width_mm: Positive = 200.0
    table_gap_mm: NonNegative | None = None
    burrs: tuple[Burr, ...] = ()
    clamps: tuple[Clamp, ...] = ()
    base_from_part: Placement = Placement(position_mm=(1500.0, 0.0, 800.0))

    @model_validator(mode="after")
    def _sound(self) -> Part:
        if self.curve.shape == "arc" and self.length_mm > 3 * self.curve.radius_mm:
            raise ValueError("length_mm must not exceed 3 radius_mm on an arc")
        if self.thickness_mm.lowest <= 0:
            raise ValueError("thickness_mm must stay above 0 along the edge")
        if self.kind == "milled":
            if self.root_mm.lowest <= 0 or self.root_mm.highest >= self.thickness_mm.lowest:
                raise ValueError("root_mm must stay above 0 and below thickness_mm along the edge")
            if self.bevel_deg.lowest <= 0 or self.bevel_deg.highest >= 80:
                raise ValueError("bevel_deg must stay between 0 and 80 along the edge")
        for name, intervals in (("burrs", self.burrs), ("clamps", self.clamps)):
            if any(item.to_mm <= item.from_mm for item in intervals):
                raise ValueError(f"{name}: to_mm must be above from_mm")
        return self


class GrazingNoise(Strict):
    """Range noise (along z): `sd_mm` / cos(incidence)^`grazing_power`, at most `grazing_cap` times `sd_mm`."""

    sd_mm: NonNegative = 0.012
    grazing_power: Annotated[float, Field(ge=0, le=4)] = 0.5
    grazing_cap: Annotated[float, Field(ge=1, le=20)] = 3.0


class Noise(GrazingNoise):
    """The same, shared by neighbouring columns."""

    correlation_columns: NonNegative = 0.0


class Profiler(Strict):
    """Axes and range of a laser profiler; the camera stands `baseline_mm` off the laser along y."""

    columns: Annotated[int, Field(ge=8, le=8192)] = 800
    pitch_mm: Positive = 0.05
    x_rises: bool = True
    z_away: bool = True
    zero_range_mm: Number = 0.0
    standoff_mm: Positive = 150.0
    near_mm: NonNegative = 100.0
    far_mm: Positive = 200.0
    baseline_mm: Number = 60.0
    quantum_mm: NonNegative = 0.0
    intensity: bool = False

    @model_validator(mode="after")
    def _ranged(self) -> Self:
        if not self.near_mm < self.standoff_mm < self.far_mm:
            raise ValueError("near_mm < standoff_mm < far_mm must hold")
        return self


class Scanner(Profiler):
    """A laser profiler: its rays, its field of view, its axes and its noise."""

    beam: Literal["parallel", "fan"] = "fan"
    sampling: Literal["lateral", "angular"] = "lateral"
    x_offset_mm: Number = 0.0
    max_incidence_deg: Annotated[float, Field(gt=0, le=90)] = 85.0
    noise: Noise = Noise()

    @model_validator(mode="after")
    def _sound(self) -> Scanner:
        if self.columns * self.pitch_mm > 2 * self.standoff_mm:
            raise ValueError("columns * pitch_mm must not exceed 2 standoff_mm")
        return self


class Disturbances(Strict):
    """What goes wrong in the returns, as shares of all returns."""

    dropout_share: Share = 0.0
    grazing_dropout: Share = 0.0
    streak_dropout_share: Share = 0.0
    outlier_share: Share = 0.0
    streak_outlier_share: Share = 0.0
    outlier_reach_mm: Positive = 5.0
    mixed_pixel_probability: Annotated[float, Field(ge=0, le=1)] = 0.0
    mixed_pixel_jump_mm: Positive = 0.5


Motion: TypeAlias = Literal["two_poses", "stream", "stop_and_go"]


class Look(Strict):
    """How the scanner looks at the edge."""

    elevation_deg: Annotated[float, Field(gt=-90, lt=180)] = 40.0
    oblique_deg: Annotated[float, Field(ge=-30, le=30)] = 0.0
    lead_deg: Annotated[float, Field(ge=-30, le=30)] = 0.0
    aim_mm: tuple[Number, Number] = (-2.0, 4.0)
    skew_mm: tuple[Number, Number] = (0.0, 0.0)
    upside_down: bool = False


class Pass(Look):
    """One scanning pass: where from, where to, how the scanner looks at the edge and how the robot moves."""

    from_mm: Number
    to_mm: Number
    turn_deg: Triple = (0.0, 0.0, 0.0)
    motion: Motion = "two_poses"
    follow: Literal["line", "edge"] = "line"

    @model_validator(mode="after")
    def _sound(self) -> Pass:
        if self.from_mm == self.to_mm:
            raise ValueError("from_mm and to_mm must differ")
        if self.motion == "two_poses" and self.follow == "edge":
            raise ValueError("a motion of two_poses is a straight line: follow must be 'line'")
        return self


class RecordedRobot(Strict):
    """When a robot records, and with which errors."""

    frame_rate_hz: Positive = 50.0
    frame_pitch_mm: Positive = 0.2
    pose_rate_hz: Positive = 100.0
    flange_from_profiler: Placement = Placement(position_mm=(126.92, 9.44, 41.48), rpy_deg=(60.489, -3.813, -2.024))
    hand_eye_error_mm: NonNegative = 0.0
    hand_eye_error_deg: NonNegative = 0.0
    pose_noise_mm: NonNegative = 0.0
    pose_noise_deg: NonNegative = 0.0


class Robot(RecordedRobot):
    """The robot's motion as it is and as it is recorded."""

    smooth_error_mm: NonNegative = 0.0
    smooth_error_wavelength_mm: tuple[Positive, Positive] = (50.0, 200.0)
    vibration_mm: NonNegative = 0.0
    clock_jitter_s: NonNegative = 0.0


class Headed(Strict):
    """What every recipe says of itself."""

    version: Literal[1] = 1
    title: str = ""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0


class Scanned(Headed):
    """A part before a scanner: by which passes it is scanned, and what goes wrong."""

    part_id: str | None = None
    scanner: Scanner = Scanner()
    robot: Robot = Robot()
    disturbances: Disturbances = Disturbances()
    passes: Annotated[tuple[Pass, ...], Field(min_length=1, max_length=100)]


class Recipe(Scanned):
    """A synthetic recording in full. The same recipe gives the same bytes."""

    format: Literal["bevel-recipe"] = "bevel-recipe"
    part: Part = Part()

    @model_validator(mode="after")
    def _bounded(self) -> Recipe:
        frames = sum(abs(scan.to_mm - scan.from_mm) / self.robot.frame_pitch_mm for scan in self.passes)
        if frames > _MOST_FRAMES or frames / self.robot.frame_rate_hz * self.robot.pose_rate_hz > _MOST_POSES:
            raise ValueError(f"at most {_MOST_FRAMES} frames and {_MOST_POSES} poses in all")
        return self


class Sphere(Strict):
    """The sphere on its stem above a table, whose normal points at the sensor in the nominal posture, less a tilt."""

    diameter_mm: Annotated[float, Field(ge=2, le=200)] = 10.0
    stated_diameter_mm: Positive | None = None  # in the recording; None: the true one
    center_mm: Triple = (1890.33, 241.48, 1079.72)
    table_gap_mm: Positive | None = None  # below the sphere; None: no table
    table_tilt_deg: tuple[Number, Number] = (0.0, 0.0)
    stem_diameter_mm: NonNegative = 0.0


class SpherePass(Strict):
    """A posture held still, or (`to_mm`) a scan over the sphere, straight in the view or weaved."""

    sphere_mm: Triple  # the sphere's centre in the view: x, y, range
    turn_deg: Triple = (0.0, 0.0, 0.0)  # of the flange from its nominal orientation: rotation vector, flange frame
    repeats: Annotated[int, Field(ge=1, le=1000)] = 1  # frames held still
    to_mm: Triple | None = None  # a scan: where the centre lies at its end
    seconds: Annotated[float, Field(gt=0, le=100)] = 1.0
    weave_mm: NonNegative = 0.0  # amplitude in x, with 1.5 waves a scan, and in range, with 2.5
    weave_deg: NonNegative = 0.0  # amplitude of a swing about an oblique axis, with two waves
    center_mm: Triple | None = None  # of the sphere now: another sphere, or on a table that turned; None: the sphere's
    gross_mm: Triple = (0.0, 0.0, 0.0)  # what the recorded pose is off, beyond the noise


class SphereRobot(Strict):
    """The robot: what it does, what it records, and what its hand-eye pose is by design."""

    flange_from_profiler: Placement = Placement(position_mm=(126.92, 9.44, 41.48), rpy_deg=(60.489, -3.813, -2.024))
    design_error_mm: NonNegative = 0.0  # size of a shift in a random direction
    design_error_deg: NonNegative = 0.0  # size of a turn about a random axis
    nominal_rpy_deg: Triple = (20.0, 65.0, 10.0)
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


class SphereRecipe(Headed):
    """A synthetic calibration recording in full. The same recipe gives the same bytes."""

    format: Literal["sphere-recipe"]
    sphere: Sphere = Sphere()
    scanner: Scanner = Scanner(noise=Noise(sd_mm=0.015, grazing_power=0.0))
    robot: SphereRobot = SphereRobot()
    disturbances: Disturbances = Disturbances()
    passes: Annotated[tuple[SpherePass, ...], Field(min_length=1, max_length=1000)]

    @model_validator(mode="after")
    def _bounded(self) -> SphereRecipe:
        frames = sum(p.repeats if p.to_mm is None else p.seconds * self.robot.frame_rate_hz for p in self.passes)
        if frames > _MOST_SPHERE_FRAMES:
            raise ValueError(f"at most {_MOST_SPHERE_FRAMES} frames in all")
        if self.scanner.intensity:
            raise ValueError("scanner.intensity is not simulated for a sphere")
        if self.robot.clock == "robot" and self.robot.clock_offset_s != 0:
            raise ValueError("clock_offset_s needs clock 'own'")
        return self


SQUARE = {"I": ("left", "right"), "HV": ("right",), "HY": ("right",), "K": ("right",), "J": ("right",)}


class Mound(Strict):
    """A tack weld: an ellipsoid about the middle of the gap."""

    at_mm: Number
    z_mm: Number = 1.0
    half_mm: tuple[Positive, Positive, Positive] = (6.0, 2.5, 2.0)  # along the groove, across, up


class PrismGroove(Strict):
    """Two plates with a gap; one-sided types have their bevel on the left plate."""

    type: Literal["I", "V", "Y", "HV", "HY", "X", "K", "U", "J"] = "V"
    length_mm: Annotated[float, Field(ge=5, le=20000)] = 120.0
    thickness_mm: Along = Course(start=10.0, end=10.0)
    gap_mm: Along = Course(start=2.0, end=2.0)
    root_face_mm: Along = Course(start=2.0, end=2.0)
    bevel_left_deg: Along = Course(start=30.0, end=30.0)
    bevel_right_deg: Along = Course(start=30.0, end=30.0)
    radius_mm: Annotated[float, Field(ge=0.5, le=30)] = 6.0
    under_mm: Annotated[float, Field(gt=0, le=100)] = 4.0
    under_deg: Annotated[float, Field(ge=5, le=70)] = 30.0
    misalignment_mm: Along = Course(start=0.0, end=0.0)
    plate_width_mm: Positive = 60.0
    background_mm: NonNegative | None = None
    mounds: tuple[Mound, ...] = ()
    base_from_part: Placement = Placement(position_mm=(1500.0, 0.0, 800.0))

    @model_validator(mode="after")
    def _sound(self) -> PrismGroove:
        below = self.under_mm if self.type in ("X", "K") else 0.0
        if self.gap_mm.lowest < 0 or self.root_face_mm.lowest < 0:
            raise ValueError("gap_mm and root_face_mm must not fall below 0 along the edge")
        if self.type != "I" and self.root_face_mm.highest + below > 0.9 * self.thickness_mm.lowest:
            raise ValueError("root_face_mm must stay below 0.9 thickness_mm, less under_mm of an X or K")
        if min(self.bevel_left_deg.lowest, self.bevel_right_deg.lowest) < 3:
            raise ValueError("bevel_left_deg and bevel_right_deg must stay above 3")
        if max(self.bevel_left_deg.highest, self.bevel_right_deg.highest) > 70:
            raise ValueError("bevel_left_deg and bevel_right_deg must stay below 70")
        return self


class PrismRecipe(Scanned):
    """A synthetic recording of a straight groove in full. The same recipe gives the same numbers."""

    format: Literal["groove-recipe"] = "groove-recipe"
    groove: PrismGroove = PrismGroove()

    def on_plate(self) -> Recipe:
        """The same scan past a raw plate's edge that lies where the groove's middle does: it moves alike."""
        groove = self.groove
        part = Part(kind="raw", length_mm=groove.length_mm, base_from_part=groove.base_from_part)
        shared = {name: getattr(self, name) for name in Scanned.model_fields}
        return Recipe(part=part, **shared)


TYPES = ("I", "V", "Y", "HV", "HY", "X", "K", "U", "J")
