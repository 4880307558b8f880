"""What every importer produces, whatever the file: profile frames, poses, and what was understood of them.

N frames of M columns, K poses. Lengths in mm, times in s; profiler frame and base as in docs/conventions.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from workbench.units import AnyArray, Float, Float32, Int, Shaped


@dataclass(frozen=True, slots=True, eq=False)
class ProfileFrames:
    """Profiles out of one source, in the profiler frame."""

    source: str  # the file's name as given, for messages
    x_mm: Shaped[Float32, "N M"]  # lateral; NaN = no return
    z_mm: Shaped[Float32, "N M"]  # range; NaN = no return
    time_s: Shaped[Float, " N"] | None = None  # exposure times on the profiler's clock; None: the file has none
    travel_mm: Shaped[Float, " N"] | None = None  # way gone along the scan: an encoder's or a surface's y
    intensity: Shaped[AnyArray, "N M"] | None = None  # uint16
    pass_index: Shaped[Int, " N"] | None = None  # where the file itself tells passes apart
    sensor: str | None = None  # as the file names it
    length_unit: str = "mm"  # that the lengths were read from, for messages


@dataclass(frozen=True, slots=True, eq=False)
class PoseStream:
    """Flange poses out of one source, in the robot base."""

    source: str
    position_mm: Shaped[Float, "K 3"]
    quaternion_wxyz: Shaped[Float, "K 4"]  # unit length
    time_s: Shaped[Float, " K"] | None = None  # on the robot's clock; None: the file has none
    pass_index: Shaped[Int, " K"] | None = None  # where the file itself tells passes apart
    length_unit: str = "mm"  # that the lengths were read from, for messages
    time_unit: str = "s"


@dataclass(frozen=True, slots=True, eq=False)
class JointStream:
    """Postures out of one source: K of n joints, in the robot's own order."""

    source: str
    position: Shaped[Float, "K n"]  # rad; of linear joints, as far as a URDF tells them, m
    names: tuple[str, ...]  # as the file calls them
    time_s: Shaped[Float, " K"] | None = None  # on the robot's clock; None: the file has none
    number: Shaped[Int, " K"] | None = None  # of the posture, where the file tells it
    angle_unit: str = "rad"  # that the angles were read from


@dataclass(frozen=True, slots=True, eq=False)
class TrackerReadings:
    """n places that a laser tracker saw, in its own frame."""

    source: str
    place_mm: Shaped[Float, "n 3"]
    name: tuple[str, ...]  # of the target, or of the point
    number: Shaped[Int, " n"] | None = None  # of the position at which the robot stood; None: the file tells none
    time_s: Shaped[Float, " n"] | None = None  # on the tracker's clock
    u95_mm: Shaped[Float, " n"] | None = None  # expanded uncertainty (k = 2) as the tracker declares it


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """What one source held. `notes` are lines for the user: kind of file, columns, units, what was left out."""

    profiles: ProfileFrames | None = None
    poses: PoseStream | None = None
    notes: tuple[str, ...] = ()
    flange_from_profiler: Shaped[Float, "4 4"] | None = None  # where the source itself carries it
    stamps_s: Shaped[Float, " N"] | None = None  # or (K,) times alone, for the frames or poses of another source
    tracker: TrackerReadings | None = None
    joints: JointStream | None = None  # beside the poses that follow from them, or alone where no URDF is named


class TimedPass(NamedTuple):
    """One pass on the robot's clock."""

    time_s: Shaped[Float, " n"]  # of its frames
    poses: PoseStream  # with times
    note: str  # how the times came about
    has_clock: bool = True  # False: the times only count frames or mm
