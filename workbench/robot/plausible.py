"""Whether a cell file's numbers can be what their names say: mm and not metres, degrees and not radians, z outwards.

A cell that passes may still be wrong by what no number shows; what the file leaves open is named in results.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from workbench.errors import InputError
from workbench.robot.cell_file import CellPart, Pose, ShapePart, TurntablePart, matrix_of
from workbench.units import Float

LEAST_MM = 5.0  # no tool, turntable or frame of a cell lies nearer to its origin; what is in metres does, to 5 m
THINNEST_MM, LONGEST_MM = 1.0, 10.0  # no body is thinner and shorter; in metres, any is that 1 m and 10 m hold
LEAST_MARGIN_MM = 0.1  # a clearance below it is one in metres, to 100 mm
LEAST_U_MM = 1e-3  # nothing in a cell is calibrated better; in metres, any u below 1 mm is
LEAST_KG = 0.1  # lighter is in tonnes, to 100 kg
LEAST_ROOM_MM = 100.0  # no robot moves in less; in metres, any envelope below 100 m is
BURIED_MM = 10.0  # deeper within the spindle's own body than the radius of a cutter modelled as part of it
FEW_DEG, NEAR_DEG = 13.0, 0.01  # a turntable's range up to 4 pi, its limits as near to parts of pi as they are rounded
LEAST_DEG = 0.1  # a margin below it is one in radians, to 5 deg
FOLDED_DEG = 3.2  # a home with all joints within it, but for 0, stretches the arm and its wrist; in radians any does
AHEAD_MM = 20.0  # from the cutter's tip, along its axis: no body of the tool is there; others beside it may be
BARE_MM = 10.0  # of the cutter's end that bodies may leave uncovered
OFF_MM = 50.0  # that a centre of gravity may lie outside the box around the tool's bodies
STIFFEST = 5e7  # Nm/rad, of a joint: the stiffest axis of the paper's robot has 3.4e6, of those that carry 1 t some 1e7
SLOWEST_DEG_S2, SLOWEST_MM_S = 10.0, 0.2  # industrial axes reach 50 deg/s2 and more; in m/s any feed up to 200 mm/s
SLOWEST_TABLE_DEG_S2 = 4.0  # of a turntable, however heavy; in rad/s2 any up to 230 deg/s2
METRES = "is it in metres?"


def check_plausible(part: CellPart, where: str) -> None:
    """Refuse a cell whose numbers show another unit or sense than their names; `where` is the file and '$'.

    Raises:
        InputError: the first of them, with its place in the file.
    """
    for place, text in _doubts(part):
        raise InputError(f"{where}.{place}", text)


def _doubts(part: CellPart) -> Iterator[tuple[str, str]]:
    yield from _tool(part)
    if part.turntable is not None:
        yield from _turntable(part.turntable)
    if part.work_object is not None and np.any(_matrix(part.work_object.pose)[:3, 3]):
        yield from _near(part.work_object.pose, "work_object.pose", "robot's base")
    yield from _bodies(part)
    yield from _margins(part)
    yield from _robot(part)
    if part.process is not None and part.process.feed is not None and part.process.feed.most_mm_s < SLOWEST_MM_S:
        found = f"found {part.process.feed.most_mm_s:g}: is it in m/s?"
        yield "process.feed.most_mm_s", f"expected at least {SLOWEST_MM_S:g} mm/s, {found}"
    if part.process is not None:
        home = part.process.home.joints_deg
        if 0 < max(map(abs, home)) < FOLDED_DEG:
            found = ", ".join(f"{value:g}" for value in home)
            yield "process.home.joints_deg", f"expected degrees, found {found}: are they radians?"


def _turntable(table: TurntablePart) -> Iterator[tuple[str, str]]:
    yield from _near(table.base_from_turntable, "turntable.base_from_turntable", "robot's base")
    low, high = table.limits_deg
    parts_of_pi = [abs(limit / (np.pi / 4) - round(limit / (np.pi / 4))) * np.pi / 4 for limit in (low, high)]
    if high - low < FEW_DEG and max(abs(low), abs(high)) > 0.5 and max(parts_of_pi) < NEAR_DEG:
        yield "turntable.limits_deg", f"expected degrees, found {low:g}, {high:g}: are they radians?"


def _bodies(part: CellPart) -> Iterator[tuple[str, str]]:
    for place, shape in _shapes(part):
        size = _extents_mm(shape)
        if min(size) < THINNEST_MM and max(size) < LONGEST_MM:
            found = " x ".join(f"{value:g}" for value in size)
            yield place, f"expected a body of mm, found one of {found}: {METRES}"
    for i, fixture in enumerate(part.fixtures):
        if fixture.on == "base" and fixture.mesh is None and np.any(_matrix(fixture.pose)[:3, 3]):
            yield from _near(fixture.pose, f"fixtures[{i}].pose", "robot's base")
    if part.envelope is not None:
        room = min(h - low for low, h in zip(part.envelope.lowest_mm, part.envelope.highest_mm, strict=True))
        if room < LEAST_ROOM_MM:
            yield "envelope", f"expected a box in which a robot can move, found one {room:.3g} mm wide: {METRES}"


def _margins(part: CellPart) -> Iterator[tuple[str, str]]:
    if 0 < part.margin_mm < LEAST_MARGIN_MM:
        yield "margin_mm", f"expected 0 or at least {LEAST_MARGIN_MM:g} mm, found {part.margin_mm:g}: {METRES}"
    for name in ("limit_deg", "wrist_deg"):
        margin = getattr(part.margins, name)
        if 0 < margin < LEAST_DEG:
            yield f"margins.{name}", f"expected 0 or at least {LEAST_DEG:g} deg, found {margin:g}: is it in radians?"
    for name in ("tool_u_mm", "base_u_mm", "turntable_u_mm"):
        u = 0.0 if part.uncertainty is None else getattr(part.uncertainty, name)
        if 0 < u < LEAST_U_MM:
            yield f"uncertainty.{name}", f"expected 0 or at least {LEAST_U_MM:g} mm, found {u:g}: {METRES}"


def _robot(part: CellPart) -> Iterator[tuple[str, str]]:
    springs, fastest = part.robot.joint_stiffness_nm_per_rad, part.robot.acceleration_deg_s2
    if springs is not None and max(springs) > STIFFEST:
        unit = "is it in Nmm/rad, or multiplied by 57.3?"
        yield (
            "robot.joint_stiffness_nm_per_rad",
            f"expected at most {STIFFEST:g} Nm/rad, found {max(springs):g}: {unit}",
        )
    if fastest is not None and min(fastest) < SLOWEST_DEG_S2:
        yield (
            "robot.acceleration_deg_s2",
            f"expected at least {SLOWEST_DEG_S2:g} deg/s^2, found {min(fastest):g}: is it in rad/s^2?",
        )
    turned = None if part.turntable is None else part.turntable.acceleration_deg_s2
    if turned is not None and turned < SLOWEST_TABLE_DEG_S2:
        yield (
            "turntable.acceleration_deg_s2",
            f"expected at least {SLOWEST_TABLE_DEG_S2:g} deg/s^2, found {turned:g}: is it in rad/s^2?",
        )


def bare_mm(part: CellPart) -> float:
    """How much of the cutter's end lies outside the tool's bodies, more than bodies leave uncovered; else 0."""
    if not part.tool.shapes or any(shape.mesh for shape in part.tool.shapes):
        return 0.0
    tip = _matrix(part.tool.flange_from_cutter)[:3, 3]
    nearest = min(-_depth_mm(shape, tip) for shape in part.tool.shapes)
    return nearest if nearest > BARE_MM else 0.0


def _tool(part: CellPart) -> Iterator[tuple[str, str]]:
    tool = part.tool
    yield from _near(tool.flange_from_cutter, "tool.flange_from_cutter", "flange")
    tip = _matrix(tool.flange_from_cutter)
    for i, shape in enumerate(tool.shapes):
        depth = _depth_mm(shape, tip[:3, 3])
        if shape.body == "tool" and depth > BURIED_MM:
            yield (
                "tool.flange_from_cutter",
                f"expected the cutter's tip outside the spindle, found it {depth:.0f} mm within $.tool.shapes[{i}]: "
                "are its unit and the frame right?",
            )
    middles = [(s.body, _matrix(s.pose)[:3, 3]) for s in tool.shapes if s.mesh is None]
    cutter = [middle for body, middle in middles if body == "cutter"] or [middle for _, middle in middles]
    if cutter and all(tip[:3, 2] @ (middle - tip[:3, 3]) > LEAST_MM for middle in cutter):
        yield (
            "tool.flange_from_cutter",
            "expected z from shank to tip, found the shapes ahead of the tip: is z flipped?",
        )
    elif any(_depth_mm(shape, tip[:3, 3] + AHEAD_MM * tip[:3, 2]) > 0.0 for shape in tool.shapes):
        yield (
            "tool.flange_from_cutter",
            f"expected the tool's bodies to end at the cutter's tip, found one {AHEAD_MM:g} mm beyond it: another "
            "cutter, or is the tip's place wrong?",
        )
    if tool.mass_kg is not None and tool.mass_kg < LEAST_KG:
        yield (
            "tool.mass_kg",
            f"expected a spindle of at least {LEAST_KG:g} kg, found {tool.mass_kg:g}: is it in tonnes?",
        )
    if tool.centre_of_gravity_mm is not None and np.linalg.norm(tool.centre_of_gravity_mm) < LEAST_MM:
        found = ", ".join(f"{value:g}" for value in tool.centre_of_gravity_mm)
        yield "tool.centre_of_gravity_mm", f"expected at least {LEAST_MM:g} mm from the flange, found {found}: {METRES}"
    elif tool.centre_of_gravity_mm is not None and tool.shapes and not any(shape.mesh for shape in tool.shapes):
        boxes = [_around(shape) for shape in tool.shapes]
        low, high = np.min([one for one, _ in boxes], axis=0), np.max([one for _, one in boxes], axis=0)
        at = np.array(tool.centre_of_gravity_mm)
        off = float(np.maximum(np.minimum(low, 0.0) - at, at - np.maximum(high, 0.0)).max())  # the flange counts too
        if off > OFF_MM:
            yield (
                "tool.centre_of_gravity_mm",
                f"expected a place among the tool's bodies, found one {off:.0f} mm outside: "
                "is it in the flange's frame?",
            )


def _near(pose: Pose, place: str, origin: str) -> Iterator[tuple[str, str]]:
    at = _matrix(pose)[:3, 3]
    if np.linalg.norm(at) < LEAST_MM:
        found = ", ".join(f"{value:g}" for value in at)
        why = METRES if at.any() else "was it left out?"
        yield place, f"expected a place at least {LEAST_MM:g} mm from the {origin}, found {found}: {why}"


def _matrix(pose: Pose) -> Float:
    matrix = matrix_of(pose)
    assert matrix is not None  # the cell was built of it
    return matrix


def _shapes(part: CellPart) -> Iterator[tuple[str, ShapePart]]:
    for i, shape in enumerate(part.tool.shapes):
        yield f"tool.shapes[{i}]", shape
    for i, other in enumerate(part.turntable.shapes if part.turntable else []):
        yield f"turntable.shapes[{i}]", other
    for i, fixture in enumerate(part.fixtures):
        yield f"fixtures[{i}]", fixture


def _extents_mm(shape: ShapePart) -> tuple[float, ...]:
    """Extents of a shape of the file along its own axes; infinite for a mesh, which `read_cell` looks at."""
    if shape.box_mm is not None:
        return shape.box_mm
    if shape.cylinder_mm is not None:
        return 2 * shape.cylinder_mm[0], shape.cylinder_mm[1]
    if shape.capsule_mm is not None:
        return 2 * shape.capsule_mm[0], 2 * shape.capsule_mm[0] + shape.capsule_mm[1]
    return (np.inf,) if shape.sphere_mm is None else (2 * shape.sphere_mm,)


def _reach_mm(shape: ShapePart, direction: Float) -> float:
    """How far a shape, no mesh, reaches from its middle along a unit vector of the frame that it is given in."""
    x, y, z = np.abs(_matrix(shape.pose)[:3, :3].T @ direction)
    if shape.box_mm is not None:
        return float(np.array([x, y, z]) @ np.array(shape.box_mm) / 2)
    if shape.cylinder_mm is not None:
        return float(shape.cylinder_mm[0] * np.hypot(x, y) + shape.cylinder_mm[1] / 2 * z)
    if shape.capsule_mm is not None:
        return float(shape.capsule_mm[0] + shape.capsule_mm[1] / 2 * z)
    return shape.sphere_mm or 0.0


def _around(shape: ShapePart) -> tuple[Float, Float]:
    """Lowest and highest corner of the box around a shape, along the axes of the frame that it is given in."""
    middle, reach = _matrix(shape.pose)[:3, 3], np.array([_reach_mm(shape, axis) for axis in np.eye(3)])
    return middle - reach, middle + reach


def _depth_mm(shape: ShapePart, point_mm: Float) -> float:
    """How deep a point lies within a shape; negative outside, and for a mesh."""
    pose = _matrix(shape.pose)
    at = np.abs(pose[:3, :3].T @ (point_mm - pose[:3, 3]))
    if shape.box_mm is not None:
        return float((np.array(shape.box_mm) / 2 - at).min())
    if shape.cylinder_mm is not None:
        radius, length = shape.cylinder_mm
        return float(min(radius - np.hypot(at[0], at[1]), length / 2 - at[2]))
    if shape.capsule_mm is not None:
        radius, length = shape.capsule_mm
        return float(radius - np.linalg.norm([at[0], at[1], max(at[2] - length / 2, 0.0)]))
    return -np.inf if shape.sphere_mm is None else float(shape.sphere_mm - np.linalg.norm(at))
