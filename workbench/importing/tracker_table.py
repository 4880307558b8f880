"""Readings of a laser tracker joined with the robot's postures: the table that `calibrate.tracker` takes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.errors import InputError, OutputError
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import TrackerPart
from workbench.importing.neutral import Imported, PoseStream, TrackerReadings
from workbench.importing.tracker import groups_of
from workbench.units import DEG, Float, Int

AXES = 6  # of the robots that calibrate.tracker knows
PLACE = ("tracker_x_mm", "tracker_y_mm", "tracker_z_mm")
POSE = ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")
STILL_RAD, STILL_MM = 0.05 * DEG, 0.05  # by which a robot that stands may seem to move


class Postures(NamedTuple):
    """Rows of the robot's table: what it tells of each, for the table that is written and for standing still."""

    source: str
    columns: tuple[str, ...]
    values: Float  # (K, columns)
    still: Float  # (K, n) in units of what a standing robot may seem to move by
    number: Int | None
    time_s: Float | None


class Pairs(NamedTuple):
    """Which readings belong to which postures, and what was left out."""

    groups: list[tuple[Int, Int]]  # rows of the readings, rows of the postures: means of both make a row
    lines: tuple[str, ...]


def joined(sources: Sequence[Imported], mapping: Mapping) -> tuple[list[str], tuple[str, ...]]:
    """The table's lines, header first, and lines that say how it came about.

    Raises:
        InputError: no joints and no poses, or several; readings and postures that do not go together.
    """
    part = mapping.tracker or TrackerPart()
    found = [source.tracker for source in sources if source.tracker is not None]
    if len(found) != 1:
        raise InputError("sources", f"expected one file with readings of a tracker, found {len(found)}")
    (readings,) = found
    postures = _postures(sources, readings)
    way = part.pair or _usual(readings, postures)
    ways: dict[str, Callable[[], Pairs]] = {
        "number": lambda: _by_number(readings, postures),
        "time": lambda: _by_time(
            readings, postures, part.within_s, mapping.times.clock_offset_s if mapping.times else 0.0
        ),
        "order": lambda: _by_order(readings, postures),
    }
    pairs = ways[way]()
    if not pairs.groups:
        hint = "; other clocks? times.clock_offset_s in the mapping" if way == "time" else ""
        raise InputError(readings.source, f"no reading goes with a posture of {postures.source} by {way}{hint}")
    lines = [",".join(("target", *postures.columns, *PLACE))]
    for rows, at in pairs.groups:
        numbers = [*postures.values[at].mean(axis=0), *readings.place_mm[rows].mean(axis=0)]
        lines.append(",".join([_target(readings, int(rows[0])), *(f"{value:.9g}" for value in numbers)]))
    note = f"joined by {way}: {len(lines) - 1} rows of {sum(len(rows) for rows, _ in pairs.groups)} readings"
    return lines, (note, *pairs.lines)


def write_table(lines: Sequence[str], target: Path) -> None:
    """Write the table, whole or not at all."""
    part = target.with_name(f".{target.name}.part")
    try:
        part.write_text("\n".join([*lines, ""]), encoding="utf-8")
        part.replace(target)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise OutputError(str(target), f"cannot be written: {error.strerror}") from None


def _target(readings: TrackerReadings, row: int) -> str:
    """The reading's target; where every reading has a name of its own, these are points of one target."""
    if len(set(readings.name)) == len(readings.name):
        return "target"
    return readings.name[row].replace(",", " ").replace('"', "") or "target"


def _postures(sources: Sequence[Imported], readings: TrackerReadings) -> Postures:
    """The joints, beside the poses that follow from them; or the poses."""
    own = [source for source in sources if source.joints is not None or source.poses is not None]
    if len(own) != 1:
        what = "expected one file with the robot's joints or poses beside it ('joints' or 'poses' in the mapping)"
        raise InputError(readings.source, f"{what}, found {len(own)}")
    joints, poses = own[0].joints, own[0].poses
    if joints is None:
        assert poses is not None
        return Postures(poses.source, POSE, _pose_values(poses), poses.position_mm / STILL_MM, None, poses.time_s)
    if joints.position.shape[1] != AXES:
        raise InputError(joints.source, f"expected {AXES} joints, found {joints.position.shape[1]}")
    columns, values = tuple(f"q{k}_deg" for k in range(1, AXES + 1)), joints.position / DEG
    if poses is not None:
        columns, values = (*columns, *POSE), np.concatenate([values, _pose_values(poses)], axis=1)
    return Postures(joints.source, columns, values, joints.position / STILL_RAD, joints.number, joints.time_s)


def _pose_values(poses: PoseStream) -> Float:
    return np.concatenate([poses.position_mm, poses.quaternion_wxyz], axis=1)


def _usual(readings: TrackerReadings, postures: Postures) -> str:
    """By number, else by time, else in order: the first that both tell."""
    if readings.number is not None:
        return "number"
    return "time" if readings.time_s is not None and postures.time_s is not None else "order"


def _by_number(readings: TrackerReadings, postures: Postures) -> Pairs:
    """Position n is the posture of that number, else the n-th row."""
    if readings.number is None:
        raise InputError(readings.source, "tells no numbers of positions: expected another tracker.pair in the mapping")
    own = postures.number if postures.number is not None else np.arange(1, len(postures.values) + 1)
    if len(np.unique(own)) < len(own):
        raise InputError(postures.source, "a posture's number stands twice")
    groups = []
    for number, rows in groups_of(readings):
        at = np.flatnonzero(own == number)
        if not len(at):
            raise InputError(readings.source, f"position {number}: {postures.source} has no such posture")
        groups.append((rows, at))
    unseen = sorted(set(own.tolist()) - set(readings.number.tolist()))
    told = f"postures without a reading: {', '.join(map(str, unseen[:12]))}" if unseen else ""
    return Pairs(groups, tuple(filter(None, [told])))


def _by_time(readings: TrackerReadings, postures: Postures, within_s: float, offset_s: float) -> Pairs:
    """Postures within a time of the reading that all say the same; a robot that moves there tells nothing."""
    for what in (readings, postures):
        if what.time_s is None:
            raise InputError(what.source, "tells no times: expected another tracker.pair in the mapping")
    assert readings.time_s is not None
    assert postures.time_s is not None
    groups, far, moving = [], 0, 0
    for row, time_s in enumerate(readings.time_s - offset_s):
        at = np.flatnonzero(np.abs(postures.time_s - time_s) <= within_s)
        if not len(at):
            far += 1
        elif np.ptp(postures.still[at], axis=0).max() > 1.0:
            moving += 1
        else:
            groups.append((np.array([row]), at))
    lines = [f"left out: {far} readings without a posture within {within_s:g} s"] if far else []
    lines += [f"left out: {moving} readings while the robot moved"] if moving else []
    return Pairs(groups, tuple(lines))


def _by_order(readings: TrackerReadings, postures: Postures) -> Pairs:
    """As many readings of each target as postures, in the same order."""
    targets = [_target(readings, row) for row in range(len(readings.name))]
    groups = []
    for name in dict.fromkeys(targets):
        rows = [row for row, other in enumerate(targets) if other == name]
        if len(rows) != len(postures.values):
            raise InputError(
                readings.source,
                f"{len(rows)} readings of '{name}' and {len(postures.values)} postures in {postures.source}: expected "
                "as many, or numbers or times in both (tracker.pair in the mapping)",
            )
        groups += [(np.array([row]), np.array([k])) for k, row in enumerate(rows)]
    return Pairs(sorted(groups, key=lambda pair: (pair[1][0], pair[0][0])), ())
