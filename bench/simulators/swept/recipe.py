"""What the swept simulator makes a recording from. Every key is documented in `docs/tables/simulation_keys.csv`.

Lengths in mm, angles in degrees (`_deg`), times in s. Along the edge s is the arc length of the spine, the curve that
the section is swept along; in the section a counts along the end face's normal n, b along m, from the spine.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from workbench.synthetic.recipe import (
    Along,
    Burr,
    Clamp,
    Course,
    GrazingNoise,
    Headed,
    Look,
    Motion,
    NonNegative,
    Number,
    Placement,
    Positive,
    Profiler,
    RecordedRobot,
    Share,
    Strict,
    Triple,
)

Small = Annotated[float, Field(ge=0, le=5)]


def _flat(value: float) -> Course:
    return Course(start=value, end=value)


class Spine(Strict):
    """The curve. `arc`: in the plate's plane, any part of a turn, with `rise_mm` a turn a helix; `saddle`: where a
    nozzle of `radius_mm` cuts a shell of `shell_radius_mm`.
    """

    shape: Literal["straight", "arc", "wavy", "saddle"] = "straight"
    length_mm: Annotated[float, Field(ge=5, le=5000)] = 120.0
    radius_mm: Annotated[float, Field(ge=20, le=1e5)] = 300.0
    sense: Literal["convex", "concave"] = "convex"
    rise_mm: Number = 0.0
    amplitude_mm: Annotated[float, Field(ge=0, le=20)] = 2.0
    height_amplitude_mm: Annotated[float, Field(ge=0, le=20)] = 0.0
    wavelength_mm: Annotated[float, Field(ge=30, le=1e4)] = 200.0
    phase_deg: Number = 0.0
    shell_radius_mm: Positive = 500.0
    start_deg: Number = 0.0


class EdgeBurr(Burr):
    """Material along an edge: `in_plane` prolongs the root face beyond it, `out_of_plane` stands out of the face.

    `lean_deg`: by which what is in plane leans out of it; `begins`: share of the height at `from_mm`, from where on it
    grows.
    """

    direction: Literal["in_plane", "out_of_plane"] = "out_of_plane"
    height_mm: Annotated[float, Field(gt=0, le=2)] = 0.2
    width_mm: Annotated[float, Field(gt=0, le=2)] = 0.2
    ragged: Annotated[float, Field(ge=0, le=1)] = 0.5
    lean_deg: Annotated[float, Field(ge=-45, le=45)] = 0.0
    begins: Annotated[float, Field(ge=0, le=1)] = 1.0


class Ghost(Strict):
    """Second returns: on a part of a face the range is off by `offset_mm`."""

    face: Literal["root", "bevel"] = "bevel"
    from_mm: Number = -1e4
    to_mm: Number = 1e4
    across: tuple[Annotated[float, Field(ge=0, le=1)], Annotated[float, Field(ge=0, le=1)]] = (0.0, 0.33)
    offset_mm: Number = 0.08
    probability: Annotated[float, Field(ge=0, le=1)] = 1.0


class Block(Clamp):
    """A clamp: a box round the edge from `from_mm` to `to_mm`."""

    reach_in_mm: Positive = 30.0
    height_mm: Positive = 12.0


class Texture(Strict):
    """Micro-relief of all faces: standard deviation and correlation length of a Gaussian field."""

    sd_mm: Annotated[float, Field(ge=0, le=0.05)] = 0.0
    correlation_mm: Annotated[float, Field(ge=0.02, le=5)] = 0.3


class Roughness(Strict):
    """Relief of the end face or root face that is part of the mesh, as a thermal cut leaves it."""

    sd_mm: Annotated[float, Field(ge=0, le=0.3)] = 0.0
    correlation_mm: Annotated[float, Field(ge=1, le=50)] = 2.0


class SweptPart(Strict):
    """A section swept along the spine."""

    kind: Literal["milled", "raw"] = "milled"
    spine: Spine = Spine()
    twist_deg: Along = _flat(0.0)
    thickness_mm: Along = _flat(8.0)
    root_mm: Along = _flat(1.5)
    bevel_deg: Along = _flat(40.0)
    preparation: Literal["bevel", "compound", "nose", "J"] = "bevel"
    upper_bevel_deg: Along = _flat(60.0)
    lower_bevel_mm: Along = _flat(3.0)
    land_mm: Along = _flat(1.0)
    root_radius_mm: Annotated[float, Field(ge=0.5, le=30)] = 3.0
    wave_mm: Along = _flat(0.0)
    root_bow_mm: Annotated[float, Field(ge=-0.3, le=0.3)] = 0.0
    bevel_bow_mm: Annotated[float, Field(ge=-0.3, le=0.3)] = 0.0
    lower_radius_mm: Small = 0.0
    middle_radius_mm: Small = 0.0
    upper_radius_mm: Small = 0.0
    texture: Texture = Texture()
    roughness: Roughness = Roughness()
    reach_mm: Positive = 40.0
    burrs: tuple[EdgeBurr, ...] = ()
    ghosts: tuple[Ghost, ...] = ()
    clamps: tuple[Block, ...] = ()
    base_from_part: Placement = Placement(position_mm=(1500.0, 0.0, 800.0))


class SweptNoise(GrazingNoise):
    """Noise of the ranges: neighbours share `column_correlation`; `pattern_share` of the variance stays the same in
    every frame; `speckle` is the contrast.
    """

    column_correlation: Annotated[float, Field(ge=0, le=0.99)] = 0.0
    pattern_share: Annotated[float, Field(ge=0, le=1)] = 0.0
    speckle: Annotated[float, Field(ge=0, le=1)] = 0.2


class SweptScanner(Profiler):
    """The columns' lines in the laser plane meet `apex_mm` behind the laser (null: they are parallel). `footprint`:
    width of the strip that a column sees, in columns.
    """

    columns: Annotated[int, Field(ge=16, le=4096)] = 600
    apex_mm: Positive | None = 40.0
    max_incidence_deg: Annotated[float, Field(gt=0, lt=90)] = 84.0
    footprint: Annotated[float, Field(ge=0, le=4)] = 1.0
    least_fill: Annotated[float, Field(gt=0, le=1)] = 0.5
    mixed_share: Annotated[float, Field(ge=0, le=1)] = 0.5
    noise: SweptNoise = SweptNoise()


class Losses(Strict):
    """Returns that are lost, or wrong."""

    single_share: Share = 0.0
    block_share: Share = 0.0
    block_columns: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]] = (5, 40)
    block_frames: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]] = (3, 30)
    edge_columns: Annotated[int, Field(ge=0, le=50)] = 0
    edge_from_mm: Number = -1e4
    edge_to_mm: Number = 1e4
    outlier_share: Share = 0.0
    outlier_reach_mm: Positive = 5.0


class Way(Look):
    """One pass: s at which it starts, turns back or ends, and how the scanner looks at the edge."""

    way_mm: Annotated[tuple[Number, ...], Field(min_length=2, max_length=50)]
    sway_deg: Triple = (0.0, 0.0, 0.0)
    sway_wavelength_mm: Positive = 60.0
    motion: Motion = "stream"
    follow: Literal["line", "edge", "section"] = "edge"


class SweptRobot(RecordedRobot):
    """The robot's motion as it is and as it is recorded."""

    frame_pitch_mm: Positive = 0.4
    drift_mm: NonNegative = 0.0
    smooth_error_mm: NonNegative = 0.0
    smooth_error_wavelength_mm: Positive = 100.0
    vibration_mm: NonNegative = 0.0
    time_offset_s: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0


class Tack(Strict):
    """A tack weld: half of an ellipsoid on the root of the groove."""

    at_mm: Number
    length_mm: Annotated[float, Field(gt=0, le=200)] = 12.0
    width_mm: Annotated[float, Field(gt=0, le=50)] = 4.0
    height_mm: Annotated[float, Field(gt=0, le=20)] = 2.0


class GroovePart(Strict):
    """Two plates with a gap; a counts across the groove from its middle, left is a < 0, b up from the left plate."""

    kind: Literal["groove"]
    groove: Literal["I", "V", "Y", "HV", "HY", "X", "K", "U", "J"] = "V"
    bevelled: Literal["left", "right"] = "left"
    spine: Spine = Spine()
    twist_deg: Along = _flat(0.0)
    thickness_mm: Along = _flat(10.0)
    gap_mm: Along = _flat(2.0)
    root_face_left_mm: Along = _flat(2.0)
    root_face_right_mm: Along = _flat(2.0)
    bevel_left_deg: Along = _flat(30.0)
    bevel_right_deg: Along = _flat(30.0)
    under_depth_mm: Annotated[float, Field(gt=0, le=100)] = 4.0
    under_deg: Annotated[float, Field(ge=5, le=70)] = 30.0
    root_radius_mm: Annotated[float, Field(ge=0.5, le=30)] = 6.0
    misalignment_mm: Along = _flat(0.0)
    upper_radius_mm: Small = 0.0
    texture: Texture = Texture()
    reach_mm: Positive = 30.0
    background_mm: NonNegative | None = None
    tacks: tuple[Tack, ...] = ()
    base_from_part: Placement = Placement(position_mm=(1500.0, 0.0, 800.0))


class ScanRecipe(Headed):
    """What all recipes of this simulator share."""

    simulator: Literal["swept"]
    format: Literal["bevel-recipe"] = "bevel-recipe"
    part_id: str | None = None
    scanner: SweptScanner = SweptScanner()
    losses: Losses = Losses()
    robot: SweptRobot = SweptRobot()
    passes: Annotated[tuple[Way, ...], Field(min_length=1, max_length=20)]


class SweptRecipe(ScanRecipe):
    """A synthetic recording of a plate's edge in full. The same recipe gives the same numbers."""

    part: SweptPart = SweptPart()


class GrooveRecipe(ScanRecipe):
    """A synthetic recording of a groove in full: `part` has the kind `groove`."""

    part: GroovePart


AnyRecipe = SweptRecipe | GrooveRecipe
