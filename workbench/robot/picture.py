"""`workbench view-cell`: a picture of a robot cell in a posture, and what there is to say of both."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from workbench.errors import InputError, PipelineError
from workbench.geometry.poses import mapped
from workbench.geometry.splat import Camera
from workbench.robot.cell import ON_BASE, Cell
from workbench.robot.collision import Clearance, CollisionModel, external_at, turntable_pose
from workbench.robot.drawing import CUBE, RED, Sheet, cell_triangles, colour_of, is_huge, looking, png
from workbench.robot.kinematics import Chain, forward_kinematics, joint_axes, motions
from workbench.robot.read import read_cell
from workbench.robot.wrist import arm_size_mm, spherical_wrist
from workbench.storage import write_whole
from workbench.units import DEG, Float

STEP = np.radians(2.0)  # of the joints that the reach is looked for with
OFF_LIMIT = 1e-9  # rad
SINGULAR = 0.01  # least of the singular values, that of a good posture being about 0.5
AXES, GRID = ("#d55e00", "#009e73", "#0072b2"), "#a4adb8"  # x, y, z
VIEWS: tuple[tuple[str, tuple[float, float, float], tuple[float, float, float]], ...] = (
    ("overview", (0.75, -1.0, 0.55), (0, 0, 1)),
    ("from the side: x to the right, z up", (0, -1, 0), (0, 0, 1)),
    ("from above: x to the right, y up", (0, 0, 1), (0, 1, 0)),
)
VIEW_PX, FILLED = (1000, 750), 0.8  # of one view, and the share of it that is filled
TOOL, LEAST_MM = ("flange", "cutter", "sensor"), 60.0  # what the close-up shows, and half of its width at least
AXIS_PX = 160.0
BESIDE_PX = (-70.0, -60.0)  # right and up of a place, where its name stands


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


def cell_picture(cell: Cell, joints: Float, turntable: Float | float) -> bytes:
    """A PNG of the cell at joint angles (6,) and a turntable angle, rad: overview, side, top, and the tool close up.

    Robot, tool, turntable, workpiece and fixtures as their collision shapes, colliding ones in red; what is huge is
    left out; frames; and the shortest distances.

    Raises:
        InputError: no body is known.
    """
    gaps = CollisionModel(cell).gaps(joints, turntable)
    hit = {name for gap in gaps if gap.near for name in gap.pair}
    near = [gap.points_mm for gap in nearest_gaps(cell, gaps) if gap.points_mm is not None and gap.distance_mm > 0]
    made = [(name, one) for name, one in cell_triangles(cell, joints, turntable) if not is_huge(one)]
    if not made:
        raise InputError(cell.source, "expected bodies to draw: neither the URDF nor the cell file gives any")
    frames = cell_frames(cell, joints, turntable)
    bodies = [(triangles, RED if name in hit else colour_of(cell, name)) for name, triangles in made]
    corners = np.concatenate(
        [*(one.reshape(-1, 3) for one, _ in bodies), *(one[None, :3, 3] for one in frames.values())]
    )
    steps = np.outer(10.0 ** np.arange(4), (1, 2, 5)).ravel()
    spacing = steps[np.abs(np.log(10 * steps / np.ptp(corners, axis=0).max())).argmin()]
    told = f"{cell.title}\n{posture_text(joints, turntable)}{'; red: in collision' if hit else ''}\n"
    views: list[tuple[str, Camera, tuple[str, ...]]] = []
    for name, look, up in VIEWS:
        caption = f"{'' if views else told}{name}; grid {spacing:.0f} mm"
        camera = looking(look, up, corners, VIEW_PX, FILLED, caption.count("\n") + 1)
        views.append((caption, camera, ("base", "turntable", "cutter")))
    tool = looking(*VIEWS[0][1:], _about_tool(made, frames), VIEW_PX, FILLED)
    views.append(("tool; axes x vermilion, y green, z blue", tool, TOOL))
    picture = Image.new("RGB", (2 * VIEW_PX[0], 2 * VIEW_PX[1]))
    for i, (caption, camera, named) in enumerate(views):
        sheet = Sheet(camera, bodies)
        if named != TOOL:
            _add_grid(sheet, corners, spacing)
        sheet.caption(caption)
        _add_frames(sheet, frames, named)
        _add_gaps(sheet, near)
        if i == 0:
            _add_names(sheet, cell, made)
        picture.paste(sheet.smaller(), (i % 2 * VIEW_PX[0], i // 2 * VIEW_PX[1]))
    return png(picture)


def _about_tool(made: list[tuple[str, Float]], frames: dict[str, Float]) -> Float:
    """Corners (8, 3) of a cube around flange, sensor, cutter and the tool's bodies."""
    tool = [one.reshape(-1, 3) for name, one in made if name in ("tool", "cutter")]
    points = np.concatenate([*tool, *(frames[name][None, :3, 3] for name in TOOL if name in frames)])
    half = max(float(np.ptp(points, axis=0).max()) / 2, LEAST_MM)
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2 + half * CUBE)


def _add_names(sheet: Sheet, cell: Cell, made: list[tuple[str, Float]]) -> None:
    """What stands around, named on top of it."""
    around = {shape.body for shape in cell.shapes if shape.link == ON_BASE}
    for body in dict.fromkeys(name for name, _ in made if name in around):
        corners = np.concatenate([one.reshape(-1, 3) for name, one in made if name == body])
        low, high = corners.min(axis=0), corners.max(axis=0)
        sheet.note(np.append((low + high)[:2] / 2, high[2]), (0.0, 30.0), body)


def _add_grid(sheet: Sheet, corners: Float, spacing: float) -> None:
    """Lines at whole multiples of the spacing on the floor or, seen from the side, behind everything."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    across = 1 if sheet.camera.screen[2, 2] == 0 else 2
    level = high[1] if across == 1 else np.clip(0.0, low[2], high[2])
    first, second = (axis for axis in range(3) if axis != across)
    for along, other in ((first, second), (second, first)):
        for at in np.arange(np.ceil(low[other] / spacing), high[other] / spacing) * spacing:
            ends = np.full((2, 3), level)
            ends[:, other], ends[:, along] = at, (low[along], high[along])
            sheet.hidden_line(ends, GRID)


def _add_frames(sheet: Sheet, frames: dict[str, Float], names: tuple[str, ...]) -> None:
    """Three axes and a name for each frame, over all bodies."""
    for name in (name for name in names if name in frames):
        origin, length_mm = frames[name][:3, 3], AXIS_PX / sheet.camera.scale_px_mm
        for axis, colour in zip(frames[name][:3, :3].T, AXES, strict=True):
            sheet.line(np.array([origin, origin + length_mm * axis]), colour, 3.0)
        sheet.note(origin, BESIDE_PX, name)


def _add_gaps(sheet: Sheet, gaps_mm: list[Float]) -> None:
    """The shortest distances (2, 3), over all bodies."""
    for ends in gaps_mm:
        if sheet.shows(ends):
            sheet.line(ends, RED, 3.0)
            sheet.note(ends.mean(axis=0), BESIDE_PX, f"{np.linalg.norm(ends[1] - ends[0]):.1f} mm", RED)


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
