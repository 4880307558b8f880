"""A profile recording as it lies in the base."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from workbench.artefacts import Check, Recording, Strokes
from workbench.checks import AS_READ, Convention, consistent_conventions, judge_recording, known_profile_readings
from workbench.checks.judge import UNITS_MM
from workbench.checks.limits import most
from workbench.errors import InputError
from workbench.geometry.blocks import evenly
from workbench.geometry.poses import (
    inverse,
    pose_from,
    rotation_from_quaternion,
    rpy_from_rotation,
    vector_from_rotation,
)
from workbench.importing.command import summary
from workbench.look.content import FileContent, box, failed, measured, places, profile_lines, shades_of, stacked
from workbench.scan.fuse_stage import flange_poses, pass_after_pass
from workbench.scan.hdf5 import FIELDS, data_sets, opened, whole
from workbench.scan.read_stage import ON_THE_GRID, read_in
from workbench.units import AnyArray, Float, Float32

MOST_SUGGESTIONS, MOST_TRIED = 5, 12  # conventions named; those, the likeliest first, that every check is tried on
OF_LENGTHS = ("view_width_mm", "range_mm", "reach_mm", "hand_eye_mm")
NEARLY_ALL = 1.0  # percentile of the returns' |z| from which on they count
SCANNERS, MOST_PLACES = 24, 4000  # scanner poses drawn; places of a line
BASE_AXES_MM = 200.0
RED, GREEN, BLUE, WAY, SCANNER_WAY = (200, 60, 20), (0, 130, 90), (0, 90, 180), (27, 31, 36), (150, 90, 160)


def recording_content(recording: Recording) -> FileContent:
    """Points in the base, the flange's and the profiler's ways, scanner poses, base axes; what the checks say."""
    checks, suggestions = judged(recording)
    recording = pass_after_pass(recording)
    own_clock = recording.clock == "own"
    base_from_flange = _held(recording) if own_clock else flange_poses(recording)
    hand_eye = np.eye(4) if recording.flange_from_profiler is None else recording.flange_from_profiler
    base_from_profiler = base_from_flange @ hand_eye
    frame, column = places(recording.x_mm, recording.z_mm)
    points = placed(recording.x_mm[frame, column], recording.z_mm[frame, column], base_from_profiler[frame])
    more: dict[str, AnyArray] = {
        "frame": frame,
        "pass": recording.pass_index[frame],
        "column": column,
        "range z of the profiler, mm": recording.z_mm[frame, column],
    }
    if recording.intensity is not None:
        more["intensity"] = recording.intensity[frame, column]
    lines = [
        *summary(recording),
        *_pose_lines(recording, base_from_profiler),
        f"points lie in: {box(points)}" if len(points) else "points: none",
    ]
    hints = []
    if recording.flange_from_profiler is None:
        hints.append("no hand-eye pose: points are shown as if the profiler stood in the flange (input hand_eye)")
    if own_clock:
        hints.append("the profiler's own clock: every frame is shown at its pass's middle pose")
    return FileContent(
        recording.source,
        "calibration recording" if recording.sphere_diameter_mm is not None else "profile recording",
        "the robot's base",
        tuple(lines),
        points,
        shades_of(points, **more),
        strokes=strokes(recording, base_from_profiler, points),
        checks=checks,
        suggestions=suggestions,
        hints=tuple(hints),
    )


def judged(recording: Recording) -> tuple[tuple[Check, ...], tuple[str, ...]]:
    """Every plausibility check, and the conventions under which neighbouring profiles agree where one failed."""
    checks = judge_recording(recording)
    recording = replace(recording, not_confirmed=())  # no reading of the numbers changes that
    if all(check.passed for check in checks) or recording.sphere_diameter_mm is not None:
        return checks, ()
    if units := consistent_units(recording, checks):
        return checks, units
    axes = consistent_axes(recording)
    fits = [(reading, fit) for reading, fit in consistent_conventions(recording) if reading is not AS_READ]
    sound = [(reading, fit) for reading, fit in fits[:MOST_TRIED] if _sound(_read_by(recording, reading))]
    named = tuple(
        f"{reading.name} (laser plane {fit.obliquity_deg:.1f} deg off the edge's normal plane, sections turn by "
        f"{fit.twist_deg:.2f} deg unexplained)"
        for reading, fit in (sound if sound or axes else fits)[:MOST_SUGGESTIONS]
    )
    return checks, (*named, *axes)


def _read_by(recording: Recording, reading: Convention) -> Recording:
    """The recording as it would be if `reading` were right."""
    assert recording.flange_from_profiler is not None  # nothing is tried without
    quaternion, position, hand_eye = reading.read(
        recording.robot_quaternion_wxyz, recording.robot_position_mm, recording.flange_from_profiler
    )
    changed = replace(
        recording, robot_quaternion_wxyz=quaternion, robot_position_mm=position, flange_from_profiler=hand_eye
    )
    if not reading.frames_reversed:
        return changed
    numbers = np.unique(recording.pass_index)
    order = np.concatenate([np.flatnonzero(recording.pass_index == number)[::-1] for number in numbers])
    into = np.concatenate([np.flatnonzero(recording.pass_index == number) for number in numbers])
    x_mm, z_mm = np.empty_like(recording.x_mm), np.empty_like(recording.z_mm)
    x_mm[into], z_mm[into] = recording.x_mm[order], recording.z_mm[order]
    return _with_profiles(changed, x_mm, z_mm)


PROFILES = "the profiles' x and z"
LENGTHS = {  # what may be in another unit, and the recording's fields that hold it
    "the robot's positions": ("robot_position_mm",),
    PROFILES: ("x_mm", "z_mm"),
    "the hand-eye pose's translation": ("flange_from_profiler",),
}
RARER = {  # tried where none of these explains it
    "all lengths": ("robot_position_mm", "x_mm", "z_mm", "flange_from_profiler"),
    "the profiles' z, but not their x,": ("z_mm",),
    "the profiles' x, but not their z,": ("x_mm",),
}


def consistent_units(recording: Recording, checks: tuple[Check, ...]) -> tuple[str, ...]:
    """Units of lengths under which every check passes, where one of a length failed; nothing else needs trying then."""
    if all(check.passed for check in checks if check.name in OF_LENGTHS):
        return ()

    def fitting(kinds: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
        return tuple(
            _in(what, unit)
            for unit, scale in UNITS_MM.items()
            for what, names in kinds.items()
            if _sound(_scaled(recording, names, scale))
        )

    return fitting(LENGTHS) or fitting(RARER)


def consistent_axes(recording: Recording) -> tuple[str, ...]:
    """What may be wrong with the profiles' axes: the readings of them under which every check passes."""
    readings = known_profile_readings()
    found = [
        reading
        for reading in readings
        if _sound(_with_profiles(recording, *reading.read(recording.x_mm, recording.z_mm)))
    ]
    swapped = [reading.name for reading in found if reading.swapped]
    if len(swapped) == sum(reading.swapped for reading in readings):
        swapped = [f"{swapped[0]} (signs unknown)"]
    return (*swapped, *(reading.name for reading in found if not reading.swapped))


def consistent_profile_units(file: Path, z_mm: Float32) -> tuple[str, ...]:
    """Units of x and z under which a recording that is refused as it stands is read, and every check passes.

    Asked only where nearly all returns z (N, M) are too far: some that are may be a code for 'no return'.
    """
    returns = np.abs(z_mm[np.isfinite(z_mm)])
    if not len(returns) or np.percentile(returns, NEARLY_ALL) < most("range_mm"):
        return ()
    kinds = {PROFILES: LENGTHS[PROFILES], **RARER}
    small = {unit: scale for unit, scale in UNITS_MM.items() if scale < 1}  # what is refused is too large
    for what, names in kinds.items():
        for unit, scale in small.items():
            with suppress(InputError):
                recording = read_in(file, {name: scale for name in names if name in ON_THE_GRID})
                others = [name for name in names if name not in ON_THE_GRID]
                if _sound(_scaled(recording, others, scale)):
                    return (_in(what, unit),)
    return ()


def _with_profiles(recording: Recording, x_mm: Float32, z_mm: Float32) -> Recording:
    return replace(recording, x_mm=x_mm, z_mm=z_mm)


def _sound(recording: Recording) -> bool:
    return all(check.passed for check in judge_recording(replace(recording, not_confirmed=())))


def _in(what: str, unit: str) -> str:
    return f"{what} {'is' if what.endswith('translation') else 'are'} in {unit}"


def _scaled(recording: Recording, names: Iterable[str], scale: float) -> Recording:
    """The recording with some of its lengths times `scale`."""
    changed: dict[str, AnyArray] = {}
    for name in names:
        value = getattr(recording, name)
        if name != "flange_from_profiler":
            changed[name] = value * scale
        elif value is not None:
            changed[name] = pose_from(value[:3, :3], value[:3, 3] * scale)
    return replace(recording, **changed)  # type: ignore[arg-type]


def placed(x_mm: AnyArray, z_mm: AnyArray, base_from_profiler: Float) -> Float:
    """Points (n, 3) in the base of profiler coordinates (n,), each with its pose (n, 4, 4)."""
    x, z = np.asarray(x_mm, float)[:, None], np.asarray(z_mm, float)[:, None]
    return np.asarray(
        x * base_from_profiler[:, :3, 0] + z * base_from_profiler[:, :3, 2] + base_from_profiler[:, :3, 3]
    )


def _held(recording: Recording) -> Float:
    """One pose per pass, its middle one, where the frames' times cannot be compared with the poses'."""
    out = np.empty((len(recording.time_s), 4, 4))
    for number in np.unique(recording.pass_index):
        of_pass = np.flatnonzero(recording.robot_pass == number)
        middle = of_pass[len(of_pass) // 2]
        rotation = rotation_from_quaternion(recording.robot_quaternion_wxyz[middle])
        out[recording.pass_index == number] = pose_from(rotation, recording.robot_position_mm[middle])
    return out


def _pose_lines(recording: Recording, base_from_profiler: Float) -> list[str]:
    """The hand-eye pose, where the flange is, and how the profiler moves across its laser plane."""
    lines = []
    if recording.flange_from_profiler is not None:
        t = recording.flange_from_profiler[:3, 3]
        rpy = np.degrees(rpy_from_rotation(recording.flange_from_profiler[:3, :3]))
        lines.append(
            f"hand-eye: x {t[0]:.3f}, y {t[1]:.3f}, z {t[2]:.3f} mm; roll {rpy[0]:.3f}, pitch {rpy[1]:.3f}, "
            f"yaw {rpy[2]:.3f} deg (R = Rz(roll) Ry(pitch) Rx(yaw))"
        )
    lines.append(f"flange: {box(recording.robot_position_mm)}")
    for number in np.unique(recording.pass_index):
        frames = np.flatnonzero(recording.pass_index == number)
        first = base_from_profiler[frames[0]]
        along = inverse(first)[:3, :3] @ (base_from_profiler[frames[-1], :3, 3] - first[:3, 3])
        length = float(np.linalg.norm(along))
        duration = float(recording.time_s[frames[-1]] - recording.time_s[frames[0]])
        if length < 1e-6 or recording.flange_from_profiler is None:
            continue
        tilt = math.degrees(math.acos(min(1.0, abs(along[1]) / length)))
        turn = vector_from_rotation(base_from_profiler[frames[-1], :3, :3] @ first[:3, :3].T)
        angle = math.degrees(np.linalg.norm(turn))
        speed = f", {length / duration:.4g} mm/s" if duration > 0 else ""
        lines.append(
            f"motion of pass {number}: {length:.4g} mm{speed}, {tilt:.1f} deg off the laser plane's normal, "
            f"turning {angle:.2f} deg"
        )
    return lines


def strokes(recording: Recording, base_from_profiler: Float, points_mm: Float) -> tuple[Strokes, ...]:
    """The ways of flange and profiler, scanner poses, the base's axes (not shown at first where they are far)."""
    ways = [recording.robot_position_mm[recording.robot_pass == n] for n in np.unique(recording.robot_pass)]
    scanner = [base_from_profiler[recording.pass_index == n, :3, 3] for n in np.unique(recording.pass_index)]
    size = float(np.ptp(points_mm, axis=0).max()) if len(points_mm) else 100.0
    far = not len(points_mm) or float(np.linalg.norm(points_mm.mean(axis=0))) > 3.0 * max(size, BASE_AXES_MM)
    some = evenly(len(base_from_profiler), SCANNERS)
    return (
        lines_of("robot's way (flange)", ways, WAY),
        lines_of("profiler's way", scanner, SCANNER_WAY),
        axes_of("scanner poses (x red, y green, z blue)", base_from_profiler[some], max(5.0, size / 12.0)),
        axes_of("base axes (x red, y green, z blue)", np.eye(4)[None], BASE_AXES_MM, shown=not far),
    )


def lines_of(name: str, lines_mm: list[Float], colour: tuple[int, int, int]) -> Strokes:
    """Lines (n, 3) in one colour, thinned; those of one point are none."""
    kept = tuple(line[evenly(len(line), MOST_PLACES)] for line in lines_mm if len(line) > 1)
    return Strokes(name, kept, tuple(np.tile(np.array(colour, np.uint8), (len(line), 1)) for line in kept))


def axes_of(name: str, base_from_a: Float, length_mm: float, shown: bool = True) -> Strokes:
    """x, y, z of frames (k, 4, 4) as short lines."""
    lines, colours = [], []
    for pose in base_from_a:
        for axis, colour in enumerate((RED, GREEN, BLUE)):
            lines.append(np.stack([pose[:3, 3], pose[:3, 3] + length_mm * pose[:3, axis]]))
            colours.append(np.tile(np.array(colour, np.uint8), (2, 1)))
    return Strokes(name, tuple(lines), tuple(colours), shown)


def unchecked(file: Path, error: InputError) -> FileContent:
    """A recording that `scan.read` refuses: its profiles one behind the other, if they can be had at all."""
    where = str(file)
    with opened(file) as open_file:
        try:
            sets = data_sets(open_file, where)
            if "x_mm" not in sets or "z_mm" not in sets:
                raise error
            x_mm, z_mm = (whole(sets[name], FIELDS[name].dtype) for name in ("x_mm", "z_mm"))
            way = whole(sets["robot_position_mm"], np.float64) if "robot_position_mm" in sets else np.zeros((0, 3))
        except InputError:
            raise error from None
    frames, columns = z_mm.shape
    shown = stacked(x_mm, z_mm, None)
    units = consistent_profile_units(file, z_mm)
    finding = failed("recording_read", None, "what scan.read refuses, nothing may measure", error.expected)
    place = error.where.removeprefix(f"{where}: ").removeprefix(where)
    lines = [f"profiles: {frames} frames of {columns} columns", f"refused by scan.read: {place}: {error.expected}"]
    profile = measured(x_mm[0], z_mm[0]) if frames == 1 else None
    return FileContent(
        where,
        "profile recording (refused)",
        "the profiler's frame, frames one behind the other",
        tuple([*lines, *(profile_lines(profile) if profile else [])]),
        shown.points_mm,
        shown.shades,
        strokes=(lines_of("robot's way (flange)", [way], WAY),) if len(way) > 1 and np.isfinite(way).all() else (),
        checks=(finding,),
        suggestions=units,
        profile=profile,
    )
