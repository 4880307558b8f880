"""A cell in words and numbers: joints, reach, what is to be minded, and how near its bodies are in a posture."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from workbench.errors import InputError
from workbench.robot.cell import Cell
from workbench.robot.chain import Chain
from workbench.robot.collision import Clearance, CollisionModel
from workbench.robot.kinematics import joint_axes, motions
from workbench.robot.position_general import arm_size_mm
from workbench.robot.shapes import ON_BASE, ON_TURNTABLE
from workbench.robot.wrist import spherical_wrist
from workbench.units import DEG, Float

STEP = np.radians(2.0)  # of the joints that the reach is looked for with
OFF_LIMIT = 1e-9  # rad
SINGULAR = 0.01  # least of the singular values, that of a good posture being about 0.5


def described(cell: Cell, joints: Float, turntable: float) -> list[str]:
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


def check_posture(cell: Cell, joints: Float, turntable: float) -> None:
    """Refuse a posture (6,), rad, beyond the limits of a joint or of the turntable.

    Raises:
        InputError: naming the joint, its angle and its limits.
    """
    for name, angle, (low, high) in zip(cell.chain.joint_names, joints, cell.chain.limits, strict=True):
        if not low - OFF_LIMIT <= angle <= high + OFF_LIMIT:
            raise InputError(f"{cell.source}: {name}", f"expected {_span(low, high)}, got {angle / DEG:.6g} deg")
    if cell.turntable is None:
        if turntable:
            raise InputError(cell.source, "expected no turntable angle: the cell has no turntable")
        return
    low, high = cell.turntable.limits
    if not low - OFF_LIMIT <= turntable <= high + OFF_LIMIT:
        raise InputError(f"{cell.source}: turntable", f"expected {_span(low, high)}, got {turntable / DEG:.6g} deg")


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
    if cell.turntable is not None:
        yield f"turntable: {_span(*cell.turntable.limits)}, at most {cell.turntable.speed / DEG:.6g} deg/s"
    else:
        yield "turntable: none"
    yield from (f"warning: {warning}" for warning in cell.warnings)


def _posture(cell: Cell, joints: Float, turntable: float) -> Iterator[str]:
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


def posture_text(joints: Float, turntable: float) -> str:
    """A posture in words, from angles in rad."""
    angles = ", ".join(f"{angle / DEG:.6g}" for angle in joints)
    return f"posture, deg: {angles}; turntable {turntable / DEG:.6g}"


def nearest_gaps(cell: Cell, gaps: list[Clearance]) -> list[Clearance]:
    """The least of all gaps (nearest first), and the least of arm and tool to what stands around where another."""
    around = {shape.body for shape in cell.shapes if shape.link in (ON_BASE, ON_TURNTABLE)}
    moves = {shape.body for shape in cell.shapes if 3 <= shape.link <= 6}  # links 1 and 2 stand where they turn
    outer = next((gap for gap in gaps if around.intersection(gap.pair) and moves.intersection(gap.pair)), None)
    return gaps[:1] + ([outer] if outer is not None and outer is not gaps[0] else [])


def _span(low: float, high: float) -> str:
    return f"{low / DEG:.6g} to {high / DEG:.6g} deg"
