"""`workbench view-cell`: a picture of a robot cell in a posture, and what there is to say of both.

The picture is drawn by VTK in a process of its own: where a system's OpenGL is missing, VTK ends the process that it
runs in (a segmentation fault with libegl1 absent, seen with VTK 9.7), and no exception handler survives that.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from workbench.children import environment
from workbench.errors import InputError, OutputError, PipelineError
from workbench.extras import require
from workbench.robot.cell import ON_BASE, Cell, Shape
from workbench.robot.collision import Clearance, CollisionModel, external_at, standing_poses, turntable_pose
from workbench.robot.kinematics import Chain, forward_kinematics, joint_axes, motions
from workbench.robot.read import read_cell
from workbench.robot.wrist import arm_size_mm, spherical_wrist
from workbench.storage import write_whole
from workbench.units import DEG, AnyArray, Float, Shaped

STEP = np.radians(2.0)  # of the joints that the reach is looked for with
OFF_LIMIT = 1e-9  # rad
SINGULAR = 0.01  # least of the singular values, that of a good posture being about 0.5
ROUND = 16  # sides of a round body
SIDES = 64  # of a round body
ROBOT, HIT = ("#e8a33d", "#d9922b"), "#d11f1f"  # one link and the next
COLOURS = {"tool": "#4f5d75", "cutter": "#2f3a4f", "turntable": "#8d99a6", "workpiece": "#b59b6a"}
RED = "; red: in collision"
AROUND = ("#a9bcae", "#b7aec4", "#c4b5a5", "#a5b8c4")


def described(cell: Cell, joints: Float, turntable: Float | float) -> list[str]:
    """Lines on the cell and on the posture at joint angles (6,) and a turntable angle, rad."""
    return [*_cell(cell), *_posture(cell, joints, turntable)]


def reach_mm(chain: Chain) -> tuple[float, str]:
    """The largest distance from axis 1 within the limits of joints 2 and 3, and of what: wrist centre or flange.

    The data sheets' reach is that of the wrist's centre. To within the step: 2 deg, or 0.02 % of the distance.
    """
    try:
        point, what = spherical_wrist(chain).centre_mm, "wrist centre"
    except InputError:
        point, what = chain.base_from_flange_at_zero[:3, 3], "flange, joints 4 to 6 at 0"
    second, third = (np.arange(low, high + STEP, STEP).clip(max=high) for low, high in chain.limits[1:3])
    q = np.zeros((len(second), len(third), 6))
    q[..., 1], q[..., 2] = second[:, None], third
    moved = motions(chain, q)[..., 3 if what == "wrist centre" else 6, :, :]
    arm = moved[..., :3, :3] @ point + moved[..., :3, 3] - chain.points_mm[0]
    return float(np.linalg.norm(np.cross(arm, chain.axes[0]), axis=-1).max()), what


def singularities(chain: Chain, joints: Float) -> list[str]:
    """Directions in which a robot with a spherical wrist cannot move, or hardly, at joint angles (6,); in words."""
    try:
        centre = spherical_wrist(chain).centre_mm
    except InputError:
        return []
    axes, points = joint_axes(chain, joints)
    moved = motions(chain, joints)[3]
    arm = np.cross(axes[:3], moved[:3, :3] @ centre + moved[:3, 3] - points[:3]) / arm_size_mm(chain, centre)
    found = []
    if np.linalg.svd(axes[3:], compute_uv=False)[2] < SINGULAR:
        found.append("axes 4, 5 and 6 lie in a plane, the wrist cannot turn in every direction")
    if np.linalg.svd(arm, compute_uv=False)[2] < SINGULAR:
        found.append("joints 1 to 3 cannot move the wrist's centre in every direction")
    return found


def check_posture(cell: Cell, joints: Float, turntable: Float | float) -> None:
    """Refuse a posture (6,), rad, beyond the limits of a joint or of the turntable.

    Raises:
        InputError: naming the joint, its angle and its limits.
    """
    for name, angle, (low, high) in zip(cell.chain.joint_names, joints, cell.chain.limits, strict=True):
        if not low - OFF_LIMIT <= angle <= high + OFF_LIMIT:
            raise InputError(f"{cell.source}: {name}", f"expected {_span(low, high)}, got {angle / DEG:.6g} deg")
    if not cell.axes and turntable:
        raise InputError(cell.source, "expected no turntable angle: the cell has no turntable")
    for axis, value in zip(cell.axes, np.atleast_1d(turntable), strict=False):
        low, high = axis.limits
        if not low - OFF_LIMIT <= value <= high + OFF_LIMIT:
            raise InputError(f"{cell.source}: {axis.name}", f"expected {_span(low, high)}, got {value / DEG:.6g} deg")


def _cell(cell: Cell) -> Iterator[str]:
    chain = cell.chain
    yield f"cell: {cell.title}"
    limits = ", ".join(
        f"{name} {low / DEG:.6g} to {high / DEG:.6g}"
        for name, (low, high) in zip(chain.joint_names, chain.limits, strict=True)
    )
    yield f"robot: {chain.name}; limits, deg: {limits}"
    distance, what = reach_mm(chain)
    yield f"reach: {distance:.0f} mm from axis 1 ({what})"
    at, axis = cell.flange_from_cutter[:3, 3], cell.flange_from_cutter[:3, 2]
    angle = np.degrees(np.arctan2(np.hypot(axis[0], axis[1]), axis[2]))
    tip = ", ".join(f"{value:.6g}" for value in at)
    yield f"tool: tip at ({tip}) mm in the flange, cutter's axis {angle:.4g} deg to the flange's z"
    for external in cell.axes:
        yield f"{external.name}: {_span(*external.limits)}, at most {external.speed / DEG:.6g} deg/s"
    if not cell.axes:
        yield "turntable: none"
    yield from (f"warning: {warning}" for warning in cell.warnings)


def _posture(cell: Cell, joints: Float, turntable: Float | float) -> Iterator[str]:
    """Where the bodies are, and how near to each other."""
    yield posture_text(joints, turntable)
    yield from (f"singular: {what}" for what in singularities(cell.chain, joints))
    gaps = CollisionModel(cell).gaps(joints, turntable)
    hits = [gap for gap in gaps if gap.near]
    for gap in hits:
        yield f"collision: {' with '.join(gap.pair)}"
    for gap in [] if hits else nearest_gaps(cell, gaps):
        yield f"clearance: {gap.distance_mm:.1f} mm, {' to '.join(gap.pair)}"
    if not gaps:
        yield "clearance: no two bodies are to be kept apart"


def posture_text(joints: Float, turntable: Float | float) -> str:
    """A posture in words, from angles in rad."""
    angles = ", ".join(f"{angle / DEG:.6g}" for angle in joints)
    beside = ", ".join(f"{value / DEG:.6g}" for value in np.atleast_1d(turntable))
    return f"posture, deg: {angles}; {'tilt and ' if np.ndim(turntable) else ''}turntable {beside}"


def nearest_gaps(cell: Cell, gaps: list[Clearance]) -> list[Clearance]:
    """The least of all gaps (nearest first), and the least of arm and tool to what stands around where another."""
    around = {shape.body for shape in cell.shapes if not 0 <= shape.link <= 6}
    moves = {shape.body for shape in cell.shapes if 3 <= shape.link <= 6}  # links 1 and 2 stand where they turn
    outer = next((gap for gap in gaps if around.intersection(gap.pair) and moves.intersection(gap.pair)), None)
    return gaps[:1] + ([outer] if outer is not None and outer is not gaps[0] else [])


def _span(low: float, high: float) -> str:
    return f"{low / DEG:.6g} to {high / DEG:.6g} deg"


def cell_triangles(cell: Cell, joints: Float, turntable: Float | float, sides: int = ROUND) -> list[tuple[str, Float]]:
    """Body and triangles (t, 3, 3) of every shape, in the base, at joint angles (6,) and a turntable angle, rad."""
    links, standing = motions(cell.chain, joints), standing_poses(cell, turntable)
    moved = [*links, *standing]  # by `Shape.link`
    found = []
    for shape in cell.shapes:
        pose = moved[max(shape.link, 0)] @ shape.pose
        corners = shape_triangles(shape, sides)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        found.append((shape.body, corners[area > 0] @ pose[:3, :3].T + pose[:3, 3]))
    return found


def shape_triangles(shape: Shape, sides: int = ROUND) -> Float:
    """Triangles (t, 3, 3) of a shape in its own frame."""
    if shape.vertices_mm is not None:
        return np.asarray(shape.vertices_mm[shape.triangles])
    if shape.kind == "box":
        half = np.array(shape.size_mm) / 2
        ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
        return _skin(
            np.array(
                [
                    np.column_stack([ring * s, np.full(4, z)])
                    for s, z in ((0, -half[2]), (1, -half[2]), (1, half[2]), (0, half[2]))
                ]
            )
        )
    radius = shape.size_mm[0]
    length = shape.size_mm[1] if len(shape.size_mm) > 1 else 0.0
    if shape.kind == "cylinder":
        outline = np.array([[0, -length / 2], [radius, -length / 2], [radius, length / 2], [0, length / 2]])
    else:
        bow = np.linspace(0, np.pi / 2, sides // 4 + 2)
        cap = np.column_stack([radius * np.sin(bow), length / 2 + radius * np.cos(bow)])
        outline = np.vstack([cap * (1, -1), cap[::-1]])
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    return _skin(np.array([np.column_stack([r * circle, np.full(sides, z)]) for r, z in outline]))


def _skin(rings: Float) -> Float:
    """Triangles between rings (r, k, 3) one above the other."""
    a, b = rings[:-1], rings[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    return np.concatenate(
        [np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, a_next, b_next), (a, b_next, b))]
    )


@dataclass(frozen=True, slots=True, eq=False)
class CellPicture:
    """What is drawn, in mm in the base. F frames, B bodies."""

    triangles_mm: Shaped[Float, "t 3 3"]
    body: Shaped[AnyArray, " t"]  # index of the body of each triangle
    names: tuple[str, ...]  # (B,)
    colours: tuple[str, ...]  # (B,) '#rrggbb'
    named: Shaped[AnyArray, " B"]  # bool: its name is written beside it
    base_from_frame: Shaped[Float, "F 4 4"]
    frames: tuple[str, ...]  # (F,)
    gaps_mm: Shaped[Float, "g 2 3"]  # the nearest points of bodies
    caption: str


def cell_picture(cell: Cell, joints: Float, turntable: Float | float) -> bytes:
    """A PNG of the cell at joint angles (6,) and a turntable angle, rad.

    Robot, tool, turntable, workpiece and fixtures as their collision shapes, colliding ones in red; frames; and the
    shortest distance.

    Raises:
        OutputError: VTK cannot draw here; the line names the missing system libraries.
    """
    require("pyvista")
    view = _view(cell, joints, turntable)
    with tempfile.TemporaryDirectory(prefix="workbench-cell-") as folder:
        np.savez(Path(folder) / "cell.npz", **{f.name: getattr(view, f.name) for f in fields(view)})
        try:
            problem = problem_of(start_drawing("workbench.robot.draw", ["cell"], folder))
        except OSError as error:
            problem = str(error)
        drawn = Path(folder) / "cell.png"
        if problem or not drawn.is_file():
            raise OutputError("picture of the cell", f"VTK could not draw offscreen ({cause_of(problem)})")
        return drawn.read_bytes()


def _view(cell: Cell, joints: Float, turntable: Float | float) -> CellPicture:
    """Bodies, frames and the gap between the nearest two."""
    gaps = CollisionModel(cell).gaps(joints, turntable)
    hit = {name for gap in gaps if gap.near for name in gap.pair}
    shown = [gap.points_mm for gap in nearest_gaps(cell, gaps) if gap.points_mm is not None and gap.distance_mm > 0]
    made = cell_triangles(cell, joints, turntable, SIDES)
    if not made:
        raise InputError(cell.source, "expected bodies to draw: neither the URDF nor the cell file gives any")
    names = tuple(dict.fromkeys(name for name, _ in made))
    frames = _frames(cell, joints, turntable)
    posture = posture_text(joints, turntable) + (RED if hit else "")
    return CellPicture(
        triangles_mm=np.concatenate([triangles for _, triangles in made]),
        body=np.concatenate([np.full(len(triangles), names.index(name)) for name, triangles in made]),
        names=names,
        colours=_colours(cell, names, hit),
        named=np.array([any(s.body == name and s.link == ON_BASE for s in cell.shapes) for name in names]),
        base_from_frame=np.array(list(frames.values())),
        frames=tuple(frames),
        gaps_mm=np.array(shown).reshape(-1, 2, 3),
        caption=f"{cell.title}\n{posture}",
    )


def _colours(cell: Cell, names: tuple[str, ...], hit: set[str]) -> tuple[str, ...]:
    links = {shape.body: ROBOT[shape.link % 2] for shape in cell.shapes if 0 <= shape.link <= 6}
    others = [name for name in names if name not in links and name not in COLOURS]
    own = {**links, **COLOURS, **{name: AROUND[i % len(AROUND)] for i, name in enumerate(others)}}
    return tuple(HIT if name in hit else own[name] for name in names)


def _frames(cell: Cell, joints: Float, turntable: Float | float) -> dict[str, Float]:
    """`base_from_frame` by name."""
    flange = forward_kinematics(cell.chain, joints)
    found = {"base": np.eye(4), "flange": flange, "cutter": flange @ cell.flange_from_cutter}
    if cell.loading is not None:
        found["sensor"] = flange @ cell.loading.flange_from_sensor
    if cell.turntable is not None:
        found["turntable"] = turntable_pose(cell, turntable)
    return found


def view_cell(cell_file: str, posture: str, turntable_deg: float, out: str, tilt_deg: float = 0.0) -> list[str]:
    """Draws the cell of a file to `out` (PNG); the lines to print.

    Args:
        cell_file: JSON.
        posture: six joint angles in deg, the controller's, separated by commas.
        turntable_deg: angle of the turntable.
        out: the picture's name.
        tilt_deg: angle of its tilt.

    Raises:
        WorkbenchError: an unusable file or posture, a picture that cannot be drawn or written; then none is written.
    """
    picture = Path(out)
    if picture.suffix.lower() != ".png" or picture.is_dir():
        raise PipelineError(f"--out '{out}'", "expected the name of a picture that ends in .png")
    joints = _angles(posture) * DEG
    cell = read_cell(Path(cell_file))
    external = external_at(cell, turntable_deg, tilt_deg, "--tilt-deg")
    check_posture(cell, joints, external)
    lines = described(cell, joints, external)
    write_whole(picture, cell_picture(cell, joints, external))
    return [*lines, f"picture: {out}"]


def _angles(text: str) -> Float:
    """Six numbers, separated by commas."""
    try:
        angles = np.array([float(part) for part in text.split(",")])
    except ValueError:
        angles = np.array([])
    if len(angles) != 6 or not np.isfinite(angles).all():
        raise PipelineError(f"--posture '{text}'", "expected six joint angles in deg, separated by commas")
    return angles


TIME_LIMIT_S = 120.0
LIBRARIES = {"libGL.so.1": "libgl1", "libEGL.so.1": "libegl1"}  # what VTK loads -> its package in Debian


def start_drawing(module: str, arguments: list[str], folder: str) -> subprocess.Popen[bytes]:
    """`python -m module arguments` at work in `folder`, with this project's own copy, from whatever directory."""
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        cwd=folder,
        env=environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def problem_of(process: subprocess.Popen[bytes]) -> str:
    """Waits for the process: '' where it ended well, else what went wrong."""
    try:
        _, messages = process.communicate(timeout=TIME_LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return f"drawing took more than {TIME_LIMIT_S:.0f} s"
    if process.returncode == 0:
        return ""
    if process.returncode < 0:
        return f"its process was ended by signal {-process.returncode}"
    lines = messages.decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else f"its process ended with status {process.returncode}"


def cause_of(problem: str) -> str:
    """The missing system libraries and how to get them, if that is what it was; else `problem`."""
    missing = {library: package for library, package in LIBRARIES.items() if not _loads(library)}
    if not missing:
        return problem
    return f"missing {' and '.join(missing)}; on Debian or Ubuntu: apt-get install {' '.join(missing.values())}"


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
