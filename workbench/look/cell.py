"""`workbench view-cell`: a robot cell in a posture, to turn in the browser, and what there is to say of both."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from workbench.artefacts import Check
from workbench.errors import InputError, PipelineError
from workbench.geometry.poses import mapped
from workbench.look.command import write_page
from workbench.look.content import FileContent, failed
from workbench.look.recorded import axes_of, lines_of
from workbench.robot import (
    Cell,
    Chain,
    Clearance,
    CollisionModel,
    external_at,
    forward_kinematics,
    joint_axes,
    motions,
    read_cell,
    spherical_wrist,
    turntable_pose,
)
from workbench.robot.drawing import cell_strokes
from workbench.robot.wrist import arm_size_mm
from workbench.units import DEG, Float

STEP = np.radians(2.0)  # of the joints that the reach is looked for with
OFF_LIMIT = 1e-9  # rad
SINGULAR = 0.01  # least of the singular values, that of a good posture being about 0.5
AXES_MM, RED = 150.0, (209, 31, 31)
APART = "bodies that may not meet stay apart"


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
    arm = mapped(moved, point) - chain.points_mm[0]
    return float(np.linalg.norm(np.cross(arm, chain.axes[0]), axis=-1).max()), what


def singularities(chain: Chain, joints: Float) -> list[str]:
    """Directions in which a robot with a spherical wrist cannot move, or hardly, at joint angles (6,); in words."""
    try:
        centre = spherical_wrist(chain).centre_mm
    except InputError:
        return []
    axes, points = joint_axes(chain, joints)
    moved = motions(chain, joints)[3]
    arm = np.cross(axes[:3], mapped(moved, centre) - points[:3]) / arm_size_mm(chain, centre)
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


def _posture(cell: Cell, joints: Float, turntable: Float | float, gaps: list[Clearance]) -> Iterator[str]:
    """Where the bodies are, and how near to each other: the distances, the smallest first."""
    yield posture_text(joints, turntable)
    yield from (f"singular: {what}" for what in singularities(cell.chain, joints))
    hits = [f"collision: {' with '.join(gap.pair)}" for gap in gaps if gap.near]
    near = nearest_gaps(cell, gaps)
    yield from hits or (f"clearance: {gap.distance_mm:.1f} mm, {' to '.join(gap.pair)}" for gap in near)
    if not gaps:
        yield "clearance: no two bodies are to be kept apart"


def posture_text(joints: Float, turntable: Float | float) -> str:
    """A posture in words, from angles in rad."""
    angles = ", ".join(f"{angle / DEG:.6g}" for angle in joints)
    externals = ", ".join(f"{value / DEG:.6g}" for value in np.atleast_1d(turntable))
    return f"posture, deg: {angles}; {'tilt and ' if np.ndim(turntable) else ''}turntable {externals}"


def nearest_gaps(cell: Cell, gaps: list[Clearance]) -> list[Clearance]:
    """The least of all gaps (nearest first), and the least of arm and tool to what stands around where another."""
    around = {shape.body for shape in cell.shapes if not 0 <= shape.link <= 6}
    moves = {shape.body for shape in cell.shapes if 3 <= shape.link <= 6}  # links 1 and 2 stand where they turn
    outer = next((gap for gap in gaps if around.intersection(gap.pair) and moves.intersection(gap.pair)), None)
    return gaps[:1] + ([outer] if outer is not None and outer is not gaps[0] else [])


def _span(low: float, high: float) -> str:
    return f"{low / DEG:.6g} to {high / DEG:.6g} deg"


def cell_content(cell: Cell, joints: Float, turntable: Float | float) -> FileContent:
    """The cell at joint angles (6,) and a turntable angle, rad: bodies, frames, and the shortest distances.

    Raises:
        InputError: no body is known.
    """
    bodies = cell_strokes(cell, joints, turntable)
    if not bodies:
        raise InputError(cell.source, "expected bodies to draw: neither the URDF nor the cell file gives any")
    gaps = CollisionModel(cell).gaps(joints, turntable)
    near = [(gap.points_mm, gap.distance_mm) for gap in nearest_gaps(cell, gaps) if gap.distance_mm > 0]
    frames = [
        axes_of(f"{name} (x red, y green, z blue)", pose[None], AXES_MM)
        for name, pose in cell_frames(cell, joints, turntable).items()
    ]
    distances = [lines_of(f"{mm:.1f} mm", [ends], RED) for ends, mm in near if ends is not None]
    lines = (*_cell(cell), *_posture(cell, joints, turntable, gaps))
    met = [failed("collision", None, APART, line) for line in lines if line.startswith("collision: ")]
    return FileContent(
        cell.source,
        "robot cell",
        "the robot's base",
        lines,
        np.zeros((0, 3)),
        (),
        strokes=(*bodies, *frames, *distances),
        checks=tuple(met or ([Check("collision", None, None, True, APART)] if gaps else [])),
    )


def cell_frames(cell: Cell, joints: Float, turntable: Float | float) -> dict[str, Float]:
    """`base_from_frame` (4, 4) by name."""
    flange = forward_kinematics(cell.chain, joints)
    found = {"base": np.eye(4), "flange": flange, "cutter": flange @ cell.flange_from_cutter}
    if cell.loading is not None:
        found["sensor"] = flange @ cell.loading.flange_from_sensor
    if cell.turntable is not None:
        found["turntable"] = turntable_pose(cell, turntable)
    return found


def view_cell(cell_file: str, posture: str, turntable_deg: float, out: str, tilt_deg: float = 0.0) -> list[str]:
    """Draws the cell of a file to the page `out`; the lines to print.

    Args:
        cell_file: JSON.
        posture: six joint angles in deg, the controller's, separated by commas.
        turntable_deg: angle of the turntable.
        out: the page's name, `.html`.
        tilt_deg: angle of its tilt.

    Raises:
        WorkbenchError: an unusable file or posture, a page that cannot be drawn or written; then none is written.
    """
    joints = _angles(posture) * DEG
    cell = read_cell(Path(cell_file))
    external = external_at(cell, turntable_deg, tilt_deg, "--tilt-deg")
    check_posture(cell, joints, external)
    found = cell_content(cell, joints, external)
    write_page(found, Path(out))
    return [*found.lines, f"page: {out}"]


def _angles(text: str) -> Float:
    """Six numbers, separated by commas."""
    try:
        angles = np.array([float(part) for part in text.split(",")])
    except ValueError:
        angles = np.array([])
    if len(angles) != 6 or not np.isfinite(angles).all():
        raise PipelineError(f"--posture '{text}'", "expected six joint angles in deg, separated by commas")
    return angles
