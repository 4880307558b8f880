"""The robot cell: robot, tool, turntable, the bodies in it. Lengths in mm.

And the margins that postures in it keep: how far a robot stays from its limits, from singular postures and from bodies,
and how well its cell is known.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from workbench.artefacts import RobotCell
from workbench.errors import InputError
from workbench.geometry.moves import chords_mm
from workbench.geometry.poses import pose_from
from workbench.robot.cell_file import ControllerPart, LoadingSetup, ProcessPart, SpindleCurvePart
from workbench.robot.kinematics import Chain, jacobian_at, joint_axes
from workbench.robot.wrist import Side
from workbench.storage import regular_file
from workbench.units import COVERAGE, DEG, AnyArray, Float, Shaped

# Values of `Shape.link` for what is no part of the robot; a track's floor is the second, a tilt the third.
ON_BASE, ON_TURNTABLE, ON_CRADLE = -1, 7, 8
DIGITS = 3  # of mm and deg behind the point, in the programs of the dialect that has the fewest: FANUC's
ROUNDED = 0.5 * 10.0**-DIGITS  # mm, deg: by which such a number may be off
# What a program may leave its path by: the tolerances of path.simplify, and three angles of each orientation rounded.
WRITTEN_MM, WRITTEN = 0.01 + ROUNDED, (0.05 + 3 * ROUNDED) * DEG
WRITTEN_JOINT = 2 * ROUNDED * DEG  # joint angles rounded; FANUC's joint 3 has the error of joint 2 besides
OFF_MM = 1.0  # of bodies, at most, between a way and what its places and its program tell of it
REGULAR = 1e9  # condition number up to which a Jacobian is inverted
COAXIAL = 1e-3  # rad, mm: nearer than this, the cutter's axis is the flange's


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A rigid shape on a body of the cell.

    `pose` is where it is with all joints at zero: in the base, or for ON_TURNTABLE and ON_CRADLE in that axis' frame.
    """

    body: str  # name of what it belongs to; shapes of one body may touch
    link: int  # 0 to 6: hangs on that link of the robot, whose base is 0; else ON_BASE, ON_TURNTABLE or ON_CRADLE
    kind: str  # box (x, y, z), sphere (radius), capsule and cylinder (radius, length along z without caps), mesh
    size_mm: tuple[float, ...]
    pose: Shaped[Float, "4 4"]
    vertices_mm: Shaped[Float, "v 3"] | None = None  # of a mesh, in the shape's frame
    triangles: Shaped[AnyArray, "t 3"] | None = None

    @property
    def box(self) -> tuple[Float, Float]:
        """Pose (4, 4) of the middle of a box around it along its own axes, where `pose` is, and half its edges (3,)."""
        middle = self.pose
        if self.vertices_mm is not None:
            low, high = self.vertices_mm.min(axis=0), self.vertices_mm.max(axis=0)
            return middle @ pose_from(np.eye(3), (low + high) / 2), (high - low) / 2
        size = np.array(self.size_mm)
        if self.kind == "box":
            return middle, size / 2
        caps = 0.0 if self.kind == "cylinder" else size[0]
        return middle, np.array([size[0], size[0], size[1:].sum() / 2 + caps])

    @property
    def sphere(self) -> tuple[Float, float]:
        """Middle (3,), where `pose` is, and radius of a sphere around it, mm."""
        pose, half = self.box
        if self.kind in ("sphere", "capsule"):
            return pose[:3, 3], float(half[2])
        return pose[:3, 3], float(np.linalg.norm(half[1:] if self.kind == "cylinder" else half))


def named_file(path: Path, where: str, what: str) -> None:
    """Refuse a file that the cell names at `where` and that is not there, or is none."""
    try:
        regular_file(path)
    except InputError as error:
        raise InputError(where, f"the {what} '{path}': {error.expected}") from None


def read_mesh(path: Path, where: str) -> tuple[Float, AnyArray]:
    """Vertices (v, 3), in the file's own unit, and triangles (t, 3) of an STL, OBJ or PLY file.

    Raises:
        InputError: no such file, or no triangles in it.
    """
    import open3d

    named_file(path, where, "mesh")
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        mesh = open3d.io.read_triangle_mesh(path)
    if not len(mesh.triangles):
        raise InputError(where, f"the mesh '{path}' holds no triangles: expected an STL, OBJ or PLY file")
    return np.array(mesh.vertices), np.array(mesh.triangles)


@dataclass(frozen=True, slots=True)
class Margins:
    """What a posture must keep. The defaults are a cell engineer's; the cell file may say otherwise."""

    limit: float = 2.0 * DEG  # of every joint and the turntable from its limits
    wrist: float = 5.0 * DEG  # of axis 6 from the line of axis 4
    condition: float = 50.0  # of the Jacobian, lengths in units of half the robot's own
    flange_mm: float = 0.0  # standard uncertainty of the tool, each axis
    flange_rad: float = 0.0
    part_mm: float = 0.0  # of what stands on the base or the turntable, as the robot sees it: hand-eye, base, turntable
    part_rad: float = 0.0

    @property
    def twist(self) -> Float:
        """By how much the tool may be off its target (6,): mm and rad, coverage 2, each axis."""
        size = np.hypot([self.flange_mm, self.flange_rad], [self.part_mm, self.part_rad])
        return np.asarray(COVERAGE * np.repeat(size, 3))

    @property
    def written(self) -> Float:
        """By how much a program may leave the postures that it was made from (6,): mm and rad, each axis."""
        return np.repeat([WRITTEN_MM, WRITTEN], 3)


def wrist_angles(axes: Float) -> Float:
    """Angle (n,), 0 to pi/2, between axes 4 and 6, of joint axes (n, 6, 3): 0 is the wrist's singularity."""
    a, b = axes[..., 3, :], axes[..., 5, :]
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.abs((a * b).sum(axis=-1))))


def own_length_mm(chain: Chain) -> float:
    """Half the length of the chain from axis to axis to the flange, which makes the Jacobian's rows alike."""
    points = np.vstack([chain.points_mm, chain.base_from_flange_at_zero[:3, 3]])
    return float(chords_mm(points).sum() / 2)


def dexterity(
    chain: Chain,
    joints: Shaped[Float, "n 6"],
    tip_mm: Shaped[Float, "n 3"],
    twist: Shaped[Float, "*k 6"],
    enough: float = 0.0,
) -> tuple[Float, Float, Float]:
    """Wrist angle (n,), condition number (n,) and what an error of the tool asks of the joints (*k, n, 6), at (n, 6).

    Args:
        chain: the robot.
        joints: (n, 6) rad.
        tip_mm: (n, 3) the tool centre point in the base.
        twist: (6,), or several (k, 6): how far the tool may be off, mm and rad, each axis.
        enough: condition number up to which an upper bound of it will do (by Frobenius norms: at most 6 times it).
    """
    axes, points = joint_axes(chain, joints)
    scale = np.array([own_length_mm(chain)] * 3 + [1.0] * 3)
    j = np.ascontiguousarray(jacobian_at(axes, points, tip_mm) / scale[:, None])
    back, finite = np.full_like(j, np.nan), np.isfinite(j).all(axis=(1, 2))
    regular = np.flatnonzero(finite)[np.linalg.det(j[finite]) != 0.0]
    back[regular] = np.linalg.inv(j[regular])
    condition = np.sqrt((j * j).sum(axis=(1, 2)) * (back * back).sum(axis=(1, 2)))
    condition[~np.isfinite(condition)] = np.inf
    open_ = np.flatnonzero((condition > enough) & finite)
    sizes = np.linalg.svd(j[open_], compute_uv=False)
    with np.errstate(divide="ignore", over="ignore"):
        condition[open_] = sizes[:, 0] / sizes[:, 5]
    asked = np.zeros((*twist.shape[:-1], len(joints), 6))
    if twist.any():
        by_joint = np.einsum("nij,...j->...ni", np.abs(back), twist / scale)
        asked = np.where((condition < REGULAR)[:, None], by_joint, np.inf)
    return wrist_angles(axes), condition, asked


@dataclass(frozen=True, slots=True, eq=False)
class Turntable:
    """An external axis: what moves all that does not stand on the robot's base, against that base.

    A turntable turns about the z-axis of its frame, and may stand `on` another one that tilts it. A track under the
    robot is the same seen from the robot: the floor slides along z, and a millimetre of it counts as a degree does, so
    that digits, margins and limits hold for both.

    Values of a cell's external axes are one number where there is one axis or none, shape (...), else a vector of them
    from the base outwards, (..., e).
    """

    base_from_turntable: Shaped[Float, "4 4"]  # with all axes at 0
    limits: Shaped[Float, " 2"]  # rad
    speed: float  # rad/s, largest
    acceleration: float | None = None  # rad/s^2, largest; None: not stated
    slides: bool = False  # it is a track
    on: Turntable | None = None  # the axis that carries it; None: it stands on the base
    tilts: bool = False  # it carries a turntable

    @property
    def axes(self) -> tuple[Turntable, ...]:
        """All that carry it and itself, from the base outwards."""
        return (*(self.on.axes if self.on else ()), self)

    @property
    def name(self) -> str:
        """For messages, and of its keys in files."""
        return "track" if self.slides else "tilt" if self.tilts else "turntable"

    @property
    def unit(self) -> str:
        """Of its values divided by DEG."""
        return "mm" if self.slides else "deg"


@dataclass(frozen=True, slots=True, eq=False)
class Cell(RobotCell):
    """A robot cell as its file describes it; `shapes` are the robot's links first, then all that stands around."""

    source: str  # the file's name as given, for messages
    title: str
    chain: Chain
    shapes: tuple[Shape, ...]
    flange_from_cutter: Shaped[Float, "4 4"]  # the tool's tip: z along the cutter's axis, from shank to tip
    turntable: Turntable | None  # the external axis, of several the outermost
    loading: LoadingSetup | None
    may_touch: tuple[tuple[str, str], ...]  # pairs of bodies that are not checked
    margin_mm: float  # clearance below which a posture counts as colliding
    warnings: tuple[str, ...] = ()
    controller: ControllerPart | None = None  # as far as a program must know it; None: the file does not say
    margins: Margins = field(default_factory=Margins)
    accelerations: Shaped[Float, " 6"] | None = None  # rad/s^2, largest of the joints; None: not stated
    controller_tools: Mapping[str, Float] = field(
        default_factory=dict
    )  # flange_from_tool (4, 4) by the controller's name
    controller_frames: Mapping[str, Float] = field(default_factory=dict)  # base_from_workobject (4, 4), likewise
    tool_mass_kg: float | None = None
    tool_centre_of_gravity_mm: Shaped[Float, " 3"] | None = None  # in the flange
    base_from_workobject: Float = field(default_factory=lambda: np.eye(4))
    joint_stiffness_nm_per_rad: Shaped[Float, " 6"] | None = None  # of this robot; None: not stated
    repeatability_mm: float | None = None  # of a pose (ISO 9283); None: not stated
    spindle: SpindleCurvePart | None = None  # what it gives over its speed; None: not stated
    material: str | None = None  # of the workpiece: whose cutting coefficients hold; None: not stated
    unchecked: tuple[str, ...] = ()  # what the cell file does not say, so that nothing can look at it
    process: ProcessPart | None = None  # what a program does around the milling; None: not stated
    configuration: tuple[Side, ...] = ()  # in which the arm is to mill; of a pair neither word: either
    unseen: tuple[str, ...] = ()  # what stands in the cell and no body was given for
    scanned_at: Float | None = None  # where the external axes stood when the part was scanned, rad; None: not said

    @property
    def without_contact(self) -> Cell:
        """The same where nothing may touch the plate, since nothing is milled."""
        return dataclasses.replace(self, may_touch=tuple(pair for pair in self.may_touch if "workpiece" not in pair))

    @property
    def probes(self) -> bool:
        """Whether its programs stop at a point of the path, for the operator to see that it is there."""
        return self.process is not None and self.process.probe is not None

    @property
    def rated_accelerations(self) -> Float | None:
        """Largest of joints and external axes (7 or more,), rad/s^2, inf where the file states none; None: no one."""
        joints = np.full(6, np.inf) if self.accelerations is None else self.accelerations
        said = [np.inf if axis.acceleration is None else axis.acceleration for axis in self.axes] or [np.inf]
        found = np.append(joints, said)
        return found if np.isfinite(found).any() else None

    @property
    def rated_speeds(self) -> Float:
        """Largest of joints and external axes (7 or more,), rad/s; inf for a turntable that is not there."""
        return np.append(self.chain.speeds, [axis.speed for axis in self.axes] or [np.inf])

    @property
    def axes(self) -> tuple[Turntable, ...]:
        """The external axes, from the base outwards."""
        return () if self.turntable is None else self.turntable.axes

    @property
    def tool_name(self) -> str | None:
        """Of the tool as the controller has it; None: programs declare it."""
        return next(iter(self.controller_tools), None)

    @property
    def work_object_name(self) -> str | None:
        """Of the work object as the controller has it; None: programs declare it."""
        return next(iter(self.controller_frames), None)


def within_margins(cell: Cell) -> Cell:
    """The cell with limits nearer by their margins, and all of it by what a program may be off its postures.

    What is planned in it keeps the margins as a program too.

    Raises:
        InputError: a joint or a turntable that is left no range.
    """
    inwards = np.array([1.0, -1.0])
    limits, table = cell.chain.limits + (cell.margins.limit + WRITTEN_JOINT) * inwards, None
    for axis in cell.axes:
        kept = turntable_margin(cell, axis) + WRITTEN_JOINT
        table = dataclasses.replace(axis, limits=axis.limits + kept * inwards, on=table)
    if (np.diff(limits) <= 0).any():
        raise InputError(
            f"{cell.source}: $.margins.limit_deg",
            f"no range is left of a joint within {np.degrees(cell.margins.limit):g} deg of its limits",
        )
    chain = dataclasses.replace(cell.chain, limits=limits)
    return dataclasses.replace(cell, chain=chain, turntable=table, margin_mm=cell.margin_mm + OFF_MM)


def turntable_margin(cell: Cell, axis: Turntable) -> float:
    """What an external axis keeps from its limits, rad: the margin, but no more than a quarter of a narrow range."""
    return float(min(cell.margins.limit, np.ptp(axis.limits) / 4))


def spindle_warning(flange_from_cutter: Float) -> str | None:
    """What to say of a spindle whose axis is the flange's own: turning the cutter about it is turning joint 6."""
    axis, at = flange_from_cutter[:3, 2], flange_from_cutter[:3, 3]
    off = np.hypot(at[0], at[1])
    if np.hypot(axis[0], axis[1]) > COAXIAL or off > COAXIAL:
        return None
    return (
        "the spindle is coaxial with the flange: joint 6 alone turns the cutter about its axis, so the cutter rotation "
        "changes no posture and no displacement; mount the spindle at an angle or offset"
    )
