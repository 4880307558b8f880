"""Profiles, poses, joints and readings of other people's files, before they are imported."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.geometry.blocks import evenly
from workbench.geometry.moves import chords_mm
from workbench.geometry.poses import pose_from, rotation_from_quaternion
from workbench.importing import tracker
from workbench.importing.command import grid_lines
from workbench.importing.joints import NO_ROBOT
from workbench.importing.neutral import Imported, JointStream, TrackerReadings
from workbench.importing.text import Form
from workbench.look.content import FileContent, box, measured, profile_lines, shades_of, stacked
from workbench.look.recorded import BASE_AXES_MM, SCANNERS, WAY, axes_of, lines_of
from workbench.units import DEG

MOST_COLUMNS = 24  # that are told
TO_IMPORT = "to bring it in: workbench import FILE --out part.h5, then workbench look part.h5 (docs/importing.md)"
IMPORT_HINT = "to bring it in: workbench import --draft FILE POSES --out map.json (docs/importing.md)"


def frames_alone(found: Imported, source: str) -> FileContent:
    """Profiles in their own frame; a single one is measured."""
    frames = found.profiles
    assert frames is not None
    count = len(frames.z_mm)
    seen = np.isfinite(frames.x_mm) & np.isfinite(frames.z_mm)
    lines = [*found.notes, *grid_lines(frames.x_mm, frames.z_mm)]
    if frames.travel_mm is not None:
        t = frames.travel_mm
        lines.append(f"travel: {t[0]:.6g} to {t[-1]:.6g} mm, {abs(t[-1] - t[0]) / max(1, count - 1):.4g} mm a frame")
    if frames.time_s is not None:
        lines.append(f"times: {frames.time_s[0]:.9g} to {frames.time_s[-1]:.9g} s on the profiler's clock")
    shown = stacked(frames.x_mm, frames.z_mm, frames.travel_mm)
    profile = measured(frames.x_mm[0], frames.z_mm[0]) if count == 1 else None
    hints = ["no poses: nothing is known of where it lies in the base", IMPORT_HINT]
    if found.poses is not None:
        hints = [
            f"{len(found.poses.position_mm)} poses are in it too: as a recording it is seen in the base",
            TO_IMPORT,
        ]
    if seen.sum() > 2 and np.ptp(frames.z_mm[seen]) == 0.0:
        hints.insert(0, f"z is {frames.z_mm[seen][0]:g} throughout: these are no ranges")
    y = "y is the way along the scan" if frames.travel_mm is not None else "y counts frames"
    return FileContent(
        source,
        frames.sensor or "profiles",
        f"the profiler's frame; {y}",
        tuple([*lines, *(profile_lines(profile) if profile else [])]),
        shown.points_mm,
        shown.shades,
        profile=profile,
        hints=tuple(hints),
    )


def numbers_alone(form: Form, source: str) -> FileContent:
    """A table of numbers that is neither profiles nor poses nor a cloud: its columns, and what could be made of it."""
    names = list(form.header) or [f"column {k}" for k in range(form.rows.shape[1])]
    lines = [f"rows: {len(form.rows)}, columns: {len(names)}"]
    for name, values in list(zip(names, form.rows.T, strict=True))[:MOST_COLUMNS]:
        kept = values[np.isfinite(values)]
        extent = f"{kept.min():.6g} to {kept.max():.6g}, {len(np.unique(kept))} different" if len(kept) else "empty"
        lines.append(f"  {name}: {extent}")
    if len(names) > MOST_COLUMNS:
        lines.append(f"  and {len(names) - MOST_COLUMNS} more")
    hint = (
        "a recording needs x and z of points, or x, y, z and an orientation, or joints: name the columns in a "
        "mapping (docs/importing.md); a gauge study with one row per trial: stage compare.study (docs/comparison.md)"
    )
    frame, nothing = "no frame: columns as they stand", np.zeros((0, 3))
    return FileContent(source, "table of numbers", frame, tuple(lines), nothing, (), hints=(hint,))


def joints_alone(joints: JointStream, notes: Sequence[str], source: str) -> FileContent:
    """A robot's postures, of which no URDF tells the poses: the range of each joint."""
    unit = joints.angle_unit
    values = joints.position / (DEG if unit == "deg" else 1.0)
    count = f"postures: {len(values)}, joints: {len(joints.names)}"
    if joints.time_s is not None:
        count += f", times {joints.time_s[0]:.9g} to {joints.time_s[-1]:.9g} s on the robot's clock"
    ranges = [
        f"  joint {k} (column {name}): {one.min():.6g} to {one.max():.6g} {unit}, {len(np.unique(one))} different"
        for k, (name, one) in enumerate(zip(joints.names, values.T, strict=True), 1)
    ]
    lines, nothing = (*notes, count, *ranges), np.zeros((0, 3))
    return FileContent(source, "joint angles of a robot", "no frame", lines, nothing, (), hints=(NO_ROBOT, IMPORT_HINT))


def tracker_alone(found: TrackerReadings, source: str) -> FileContent:
    """Places that a laser tracker saw: the mean of each position."""
    places = np.array([found.place_mm[rows].mean(axis=0) for _, rows in tracker.groups_of(found)])
    lines = (*tracker.summary(found), f"means of the positions: {box(places)}")
    shades = shades_of(places)
    return FileContent(
        source, tracker.NAME, "the tracker's frame", lines, places, shades, hints=(tracker.INTO_A_TABLE,)
    )


def poses_alone(found: Imported, source: str) -> FileContent:
    """The way of a robot, without profiles."""
    poses = found.poses
    assert poses is not None
    pose = pose_from(rotation_from_quaternion(poses.quaternion_wxyz), poses.position_mm)
    way = chords_mm(poses.position_mm)
    lines = [
        *found.notes,
        f"poses: {len(pose)}, way {way.sum():.6g} mm, largest step {way.max(initial=0.0):.4g} mm",
        f"flange: {box(poses.position_mm)}",
    ]
    some = evenly(len(pose), SCANNERS)
    size = max(50.0, float(np.ptp(poses.position_mm, axis=0).max()))
    return FileContent(
        source,
        "robot poses",
        "the robot's base",
        tuple(lines),
        np.zeros((0, 3)),
        (),
        strokes=(
            lines_of("robot's way (flange)", [poses.position_mm], WAY),
            axes_of("flange poses (x red, y green, z blue)", pose[some], size / 12.0),
            axes_of("base axes (x red, y green, z blue)", np.eye(4)[None], BASE_AXES_MM),
        ),
        hints=(IMPORT_HINT,),
    )
