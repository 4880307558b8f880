"""Whether a cell file's numbers can be what their names say: mm and not metres, degrees and not radians, z outwards.

A cell that passes may still be wrong by what no number shows; what the file leaves open is named in results.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from workbench.errors import InputError
from workbench.geometry.poses import mapped
from workbench.robot.cell_file import (
    AxisPart,
    CellPart,
    EnvelopePart,
    ShapePart,
    SpindleCurvePart,
    ToolPart,
    TurntablePart,
    stated,
)
from workbench.robot.cell_model import Shape
from workbench.robot.drawing import normals, shape_triangles
from workbench.units import Float

LEAST_MM = 5.0  # no tool, turntable or frame of a cell lies nearer to its origin; what is in metres does, to 5 m
THINNEST_MM, LONGEST_MM = 1.0, 10.0  # no body is thinner and shorter; in metres, any is that 1 m and 10 m hold
UNLIKE = 20.0  # times or parts of torque times speed that a stated power is; in W it is 1000 times
LEAST_ROOM_MM = 100.0  # no robot moves in less; in metres, any envelope below 100 m is
BURIED_MM = 10.0  # deeper within the spindle's own body than the radius of a cutter modelled as part of it
FEW_DEG, NEAR_DEG = 13.0, 0.01  # a turntable's range up to 4 pi, its limits as near to parts of pi as they are rounded
FOLDED_DEG = 3.2  # a home with all joints within it, but for 0, stretches the arm and its wrist; in radians any does
AHEAD_MM = 20.0  # from the cutter's tip, along its axis: no body of the tool is there; others beside it may be
BARE_MM = 10.0  # of the cutter's end that bodies may leave uncovered
OFF_MM = 50.0  # that a centre of gravity may lie outside the box around the tool's bodies
STIFFEST = 5e7  # Nm/rad, of a joint: the stiffest axis of the paper's robot has 3.4e6, of those that carry 1 t some 1e7
LEAST_TRACK_MM = 50.0  # of a track; in metres any up to 50 m
METRES = "is it in metres?"
LEAST = {  # of numbers that the file states: nothing has less, but what is in another unit
    "tool.mass_kg": (0.1, "kg", "is it in tonnes?"),  # to 100 kg
    "margin_mm": (0.1, "mm", METRES),  # to 100 mm
    **dict.fromkeys(("margins.limit_deg", "margins.wrist_deg"), (0.1, "deg", "is it in radians?")),  # to 5 deg
    **dict.fromkeys(  # nothing in a cell is calibrated better, nor repeats; in metres, any below 1 mm is
        (*(f"uncertainty.{of}_u_mm" for of in ("tool", "base", "turntable")), "robot.repeatability_mm"),
        (1e-3, "mm", METRES),
    ),
    "robot.acceleration_deg_s2": (10.0, "deg/s^2", "is it in rad/s^2?"),  # industrial axes reach 50 and more
    **dict.fromkeys(  # however heavy; in rad/s2 any up to 230 deg/s2
        ("turntable.acceleration_deg_s2", "turntable.tilt.acceleration_deg_s2"), (4.0, "deg/s^2", "is it in rad/s^2?")
    ),
    **dict.fromkeys(("track.speed_mm_s", "process.feed.most_mm_s"), (0.2, "mm/s", "is it in m/s?")),  # to 200 mm/s
}
MAY_BE_NONE = {place for place in LEAST if place.startswith(("margin", "uncertainty"))}  # 0 states none


def check_plausible(part: CellPart, where: str) -> None:
    """Refuse a cell whose numbers show another unit or sense than their names; `where` is the file and '$'.

    Raises:
        InputError: the first of them, with its place in the file.
    """
    for place, text in _doubts(part):
        raise InputError(f"{where}.{place}", text)


def _doubts(part: CellPart) -> Iterator[tuple[str, str]]:
    """Places, and what is wrong there."""
    yield from _tool(part.tool)
    yield from _turntable(part)
    if part.turntable is not None and part.envelope is not None:
        yield from _out_of_reach(part.turntable, part.envelope)
    if part.track is not None and part.track.limits_mm is not None and np.ptp(part.track.limits_mm) < LEAST_TRACK_MM:
        found = "{:g}, {:g}".format(*part.track.limits_mm)
        yield "track.limits_mm", f"expected a range of at least {LEAST_TRACK_MM:g} mm, found {found}: {METRES}"
    if part.work_object is not None and np.any(part.work_object.pose[:3, 3]):
        yield from _near(part.work_object.pose, "work_object.pose", "robot's base")
    yield from _sizes(part)
    for i, fixture in enumerate(part.fixtures):
        if fixture.on == "base" and fixture.mesh is None and np.any(fixture.pose[:3, 3]):
            yield from _near(fixture.pose, f"fixtures[{i}].pose", "robot's base")
    yield from _numbers(part)


def _numbers(part: CellPart) -> Iterator[tuple[str, str]]:
    """Numbers that are one in another unit."""
    room = part.envelope
    wide = np.inf if room is None else np.min(np.subtract(room.highest_mm, room.lowest_mm))
    if wide < LEAST_ROOM_MM:
        yield "envelope", f"expected a box in which a robot can move, found one {wide:.3g} mm wide: {METRES}"
    for place, (least, unit, guess) in LEAST.items():
        value = np.min(stated(part, place) or 0.0)  # of several the least
        if 0 < value < least:
            none = "0 or " if place in MAY_BE_NONE else ""
            yield place, f"expected {none}at least {least:g} {unit}, found {value:g}: {guess}"
    if (stiffest := max(part.robot.joint_stiffness_nm_per_rad or (0.0,))) > STIFFEST:
        unit = "is it in Nmm/rad, or multiplied by 57.3?"
        yield (
            "robot.joint_stiffness_nm_per_rad",
            f"expected at most {STIFFEST:g} Nm/rad, found {stiffest:g}: {unit}",
        )
    home = (0.0,) if part.process is None else part.process.home.joints_deg
    if 0 < max(map(abs, home)) < FOLDED_DEG:
        yield "process.home.joints_deg", f"expected degrees, found {_listed(home)}: are they radians?"


def external_axes(part: CellPart) -> Iterator[tuple[str, AxisPart, Float]]:
    """Turntable and tilt by their places, and where they stand."""
    if (table := part.turntable) is not None:
        yield "turntable", table, table.base_from_turntable
        if table.tilt is not None:
            yield "turntable.tilt", table.tilt, table.tilt.base_from_tilt


def _turntable(part: CellPart) -> Iterator[tuple[str, str]]:
    for place, axis, pose in external_axes(part):
        yield from _near(pose, f"{place}.base_from_{place.rpartition('.')[2]}", "robot's base")
        limits = np.array(axis.limits_deg)
        off_pi = np.abs(limits / (np.pi / 4) - np.round(limits / (np.pi / 4))) * np.pi / 4
        if np.ptp(limits) < FEW_DEG and np.abs(limits).max() > 0.5 and off_pi.max() < NEAR_DEG:
            yield f"{place}.limits_deg", f"expected degrees, found {_listed(limits)}: are they radians?"


def _out_of_reach(table: TurntablePart, room: EnvelopePart) -> Iterator[tuple[str, str]]:
    """What is milled on a turntable lies where robot and tool may go; a mesh is not looked at."""
    bodies = [_corners(shape) for shape in table.shapes]
    pose = table.base_from_turntable
    placed = [mapped(pose, one) for one in bodies if one is not None]
    beyond = [
        (one.min(axis=(0, 1)) > np.array(room.highest_mm)).any()
        or (one.max(axis=(0, 1)) < np.array(room.lowest_mm)).any()
        for one in placed
    ]
    if beyond and len(beyond) == len(bodies) and all(beyond):
        found = "found all of its bodies outside: is it in another unit or frame?"
        yield "turntable.base_from_turntable", f"expected a turntable that reaches into $.envelope, {found}"


def _sizes(part: CellPart) -> Iterator[tuple[str, str]]:
    """Bodies that are too small for one of mm."""
    carriers: list[tuple[str, Sequence[ShapePart]]] = [("tool", part.tool.shapes)]
    carriers += [(place, axis.shapes) for place, axis, _ in external_axes(part)]
    shapes = [(f"{place}.shapes[{i}]", one) for place, all_ in carriers for i, one in enumerate(all_)]
    for place, shape in (*shapes, *((f"fixtures[{i}]", one) for i, one in enumerate(part.fixtures))):
        size = () if shape.solid is None else np.ptp(shape_triangles(_shape(shape)), axis=(0, 1)).tolist()
        if size and min(size) < THINNEST_MM and max(size) < LONGEST_MM:
            found = " x ".join(f"{value:g}" for value in size)
            yield place, f"expected a body of mm, found one of {found}: {METRES}"


def bare_mm(tool: ToolPart) -> float:
    """How much of the cutter's end lies outside the tool's bodies, more than bodies leave uncovered; else 0."""
    bodies = [one for shape in tool.shapes if (one := _corners(shape)) is not None]
    if not bodies or len(bodies) < len(tool.shapes):
        return 0.0
    tip = tool.flange_from_cutter[:3, 3]
    nearest = min(-_depth_mm(one, tip) for one in bodies)
    return nearest if nearest > BARE_MM else 0.0


def _tool(tool: ToolPart) -> Iterator[tuple[str, str]]:
    yield from _near(tool.flange_from_cutter, "tool.flange_from_cutter", "flange")
    if tool.spindle is not None:
        yield from _curve(tool.spindle)
    tip, bodies = tool.flange_from_cutter, [_corners(shape) for shape in tool.shapes]
    at, axis, known = tip[:3, 3], tip[:3, 2], [one for one in bodies if one is not None]
    whole = bool(known) and len(known) == len(bodies)  # no mesh among them

    def depths(point: Float) -> list[float]:
        """How deep a point lies in each body."""
        return [-np.inf if one is None else _depth_mm(one, point) for one in bodies]

    for i, (shape, depth) in enumerate(zip(tool.shapes, depths(at), strict=True)):
        if shape.body == "tool" and depth > BURIED_MM:
            yield (
                "tool.flange_from_cutter",
                f"expected the cutter's tip outside the spindle, found it {depth:.0f} mm within $.tool.shapes[{i}]: "
                "are its unit and the frame right?",
            )
    middles = [(s.body, s.pose[:3, 3]) for s in tool.shapes if s.mesh is None]
    cutter = [middle for body, middle in middles if body == "cutter"] or [middle for _, middle in middles]
    if cutter and all(axis @ (middle - at) > LEAST_MM for middle in cutter):
        yield (
            "tool.flange_from_cutter",
            "expected z from shank to tip, found the shapes ahead of the tip: is z flipped?",
        )
    elif any(depth > 0.0 for depth in depths(at + AHEAD_MM * axis)):
        yield (
            "tool.flange_from_cutter",
            f"expected the tool's bodies to end at the cutter's tip, found one {AHEAD_MM:g} mm beyond it: another "
            "cutter, or is the tip's place wrong?",
        )
    if whole and not bare_mm(tool) and max(depths(at - AHEAD_MM * axis)) < -BARE_MM:
        yield (
            "tool.flange_from_cutter",
            f"expected z along the cutter's axis, found no body of the tool {AHEAD_MM:g} mm back from the tip: is z "
            "another axis, or the quaternion not scalar first?",
        )
    if tool.centre_of_gravity_mm is not None:
        yield from _centre(np.array(tool.centre_of_gravity_mm), known if whole else [])


def _centre(centre: Float, bodies: Sequence[Float]) -> Iterator[tuple[str, str]]:
    """A centre of gravity (3,) that is at the flange, or lies beside the tool's bodies, where all of them are known."""
    places = np.concatenate([np.zeros((1, 3)), *(one.reshape(-1, 3) for one in bodies)])  # the flange counts too
    off = float(np.maximum(places.min(axis=0) - centre, centre - places.max(axis=0)).max()) if bodies else 0.0
    if np.linalg.norm(centre) < LEAST_MM:
        found = f"expected at least {LEAST_MM:g} mm from the flange, found {_listed(centre)}: {METRES}"
        yield "tool.centre_of_gravity_mm", found
    elif off > OFF_MM:
        yield (
            "tool.centre_of_gravity_mm",
            f"expected a place among the tool's bodies, found one {off:.0f} mm outside: is it in the flange's frame?",
        )


def _curve(curve: SpindleCurvePart) -> Iterator[tuple[str, str]]:
    """Torque and power that no one spindle has: P = T omega, but for what the drive limits."""
    if curve.torque_nm is None or curve.power_kw is None:
        return
    asked = np.array(curve.torque_nm) * np.array(curve.speed_rpm) * (2 * np.pi / 60 / 1000)
    ratio = float(np.median(np.array(curve.power_kw) / asked))
    if not 1 / UNLIKE < ratio < UNLIKE:
        yield "tool.spindle.power_kw", f"expected about torque times speed, found {ratio:.3g} times that: is it in W?"


def _near(pose: Float, place: str, origin: str) -> Iterator[tuple[str, str]]:
    at = pose[:3, 3]
    if np.linalg.norm(at) < LEAST_MM:
        why = METRES if at.any() else "was it left out?"
        yield place, f"expected a place at least {LEAST_MM:g} mm from the {origin}, found {_listed(at)}: {why}"


def _listed(values: Any) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _shape(part: ShapePart) -> Shape:
    assert part.solid is not None
    return Shape("", 0, *part.solid, part.pose)


def _corners(part: ShapePart) -> Float | None:
    """Triangles (t, 3, 3) of a shape in the frame that it is given in; None: a mesh, which `read_cell` looks at."""
    if part.solid is None:
        return None
    shape = _shape(part)
    return mapped(shape.pose, shape_triangles(shape))


def _depth_mm(triangles: Float, point_mm: Float) -> float:
    """How deep a point lies within a convex body of triangles (t, 3, 3); negative outside."""
    normal, size = normals(triangles)
    whole = size > 1e-9 * size.max()  # of the others, between a round body's rings, the normal is one of rounding
    off = ((point_mm - triangles[whole, 0]) * normal[whole]).sum(axis=1) / size[whole]
    return -float(off.max())
