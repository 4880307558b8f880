"""Numbers that no cell has: a wrong unit is refused with the suspicion named, unless the mapping accepts it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from workbench.artefacts import Recording
from workbench.errors import InputError
from workbench.geometry.moves import chords_mm, interpolated
from workbench.geometry.poses import rotation_from_quaternion
from workbench.importing.mapping import Mapping, Suspicion
from workbench.importing.mapping_parts import LENGTH_MM
from workbench.importing.neutral import MAX_MM, PoseStream, ProfileFrames, returns_of
from workbench.scan.checks import in_micrometres
from workbench.units import Float

REACH_MM = (100.0, 30_000.0)  # of a flange from its base: less is inside the robot, more needs a track of 30 m
WIDTH_MM = (3.0, 3000.0)  # of what a profiler sees
RANGE_MM = 10_000.0
WAY_MM = (2.0, 100_000.0)  # of a pass
PITCH_MM = 50.0  # from frame to frame
SPEED_MM_S = (0.02, 3000.0)
LEAST_ACROSS = 0.1  # share of the motion that must leave the laser plane
TURN = 2 * np.pi


def refuse(mapping: Mapping, where: str, suspicion: Suspicion, what: str) -> None:
    """Refuse what looks wrong, unless the mapping says that it is so."""
    if suspicion not in mapping.accept:
        raise InputError(where, f'{what} (if it is right: "accept": ["{suspicion}"] in the mapping)')


def check_angles(values: Float, unit: str, mapping: Mapping, where: str) -> None:
    """Refuse angles that look like the other unit."""
    largest = float(np.abs(values).max())
    if unit == "rad" and largest > TURN + 1e-3:
        what = f"an angle of {largest:.6g} rad is more than a turn: degrees declared as rad?"
        refuse(mapping, where, "angle_unit", what)
    if unit == "deg" and 0.02 < largest <= TURN:
        what = f"all angles are within {largest:.3g} deg of 0: radians declared as deg?"
        refuse(mapping, where, "angle_unit", what)


def check_profiles(frames: ProfileFrames, mapping: Mapping) -> None:
    """Something is seen, in a field of view and at a distance that a profiler has."""
    for name, grid in (("x", frames.x_mm), ("z", frames.z_mm)):  # also where the other one is NaN: `scan.read` asks
        if max(np.fmax.reduce(grid, axis=None), -np.fmin.reduce(grid, axis=None)) > MAX_MM:
            frame, column = np.argwhere(np.abs(grid) > MAX_MM)[0]
            what = f"expected mm or no return, found {name} = {grid[frame, column]:g} in column {column + 1}"
            what += in_micrometres(grid)
            raise InputError(f"{frames.source}: frame {frame + 1}", what)
    count, ranges = returns_of(frames.x_mm, frames.z_mm)
    if not count:
        raise InputError(frames.source, "expected returns, found none in any profile")
    width_mm, farthest_mm = float(np.ptp(ranges[0])), float(np.abs(ranges[1]).max())
    if not WIDTH_MM[0] <= width_mm <= WIDTH_MM[1]:
        other = _other_unit(width_mm, frames.length_unit, WIDTH_MM)
        refuse(mapping, frames.source, "length_unit", f"profiles would be {width_mm:.3g} mm wide: {other}")
    if farthest_mm > RANGE_MM:
        other = _other_unit(farthest_mm, frames.length_unit, (0.0, RANGE_MM))
        what = f"a return would be {farthest_mm:.4g} mm away: {other}, or a number that means no return?"
        refuse(mapping, frames.source, "length_unit", what)


def check_poses(poses: PoseStream, mapping: Mapping) -> None:
    """The flange is where a robot can hold it."""
    reach_mm = float(np.linalg.norm(np.clip(poses.position_mm, -1e12, 1e12), axis=1).max())
    if not REACH_MM[0] <= reach_mm <= REACH_MM[1]:
        other = _other_unit(reach_mm, poses.length_unit, (200.0, 10_000.0))
        what = f"the flange is at most {reach_mm:.4g} mm from the robot's base: {other}"
        refuse(mapping, poses.source, "length_unit", what)


def check_motion(recording: Recording, has_clock: bool, mapping: Mapping) -> None:
    """Each pass goes as far, as fast and in such a direction as scanning does."""
    for number in np.unique(recording.pass_index):
        where = f"{recording.source}: pass {number}"
        frame, pose = recording.pass_index == number, recording.robot_pass == number
        time_s = recording.time_s[frame]
        position_mm = interpolated(time_s, recording.robot_time_s[pose], recording.robot_position_mm[pose])
        way_mm = float(chords_mm(position_mm).sum())
        _check_way(way_mm, len(time_s), partial(refuse, mapping, where))
        duration_s = float(np.ptp(time_s))
        if has_clock and duration_s > 0 and not SPEED_MM_S[0] <= way_mm / duration_s <= SPEED_MM_S[1]:
            what = f"the flange would move at {way_mm / duration_s:.3g} mm/s: is a unit of time or a rate wrong?"
            refuse(mapping, where, "time_unit", what)
        if recording.flange_from_profiler is not None:
            first = recording.robot_quaternion_wxyz[pose][0]
            _check_direction(position_mm, first, recording.flange_from_profiler, where, mapping)


def _check_way(way_mm: float, frames: int, complain: Callable[[Suspicion, str], None]) -> None:
    if way_mm == 0:
        complain("still", f"the flange does not move over {frames} frames")
    elif way_mm < WAY_MM[0]:
        complain("length_unit", f"the flange moves {way_mm:.3g} mm over {frames} frames: metres or inches read as mm?")
    elif way_mm > WAY_MM[1] or way_mm / max(1, frames - 1) > PITCH_MM:
        complain("length_unit", f"the flange moves {way_mm:.4g} mm over {frames} frames: mm read as inches or metres?")


def _check_direction(
    position_mm: Float, quaternion_wxyz: Float, flange_from_profiler: Float, where: str, mapping: Mapping
) -> None:
    """A profiler that moves within its own laser plane scans nothing."""
    base_from_profiler = rotation_from_quaternion(quaternion_wxyz) @ flange_from_profiler[:3, :3]
    along = base_from_profiler.T @ (position_mm[-1] - position_mm[0])
    length_mm = float(np.linalg.norm(along))
    if length_mm > WAY_MM[0] and abs(along[1]) < LEAST_ACROSS * length_mm:
        what = (
            f"the profiler moves in its own laser plane, along ({', '.join(f'{v:.2f}' for v in along / length_mm)}) "
            "of its frame: is the orientations' convention or the hand-eye pose wrong?"
        )
        refuse(mapping, where, "direction", what)


def _other_unit(length_mm: float, declared: str, usual_mm: tuple[float, float]) -> str:
    """'metres read as mm?' for the units in which the length would be a usual one."""
    number = length_mm / LENGTH_MM[declared]
    others = [unit for unit in LENGTH_MM if unit != declared and usual_mm[0] <= number * LENGTH_MM[unit] <= usual_mm[1]]
    return f"{' or '.join(others)} read as {declared}?" if others else f"read as {declared}: is the unit wrong?"
