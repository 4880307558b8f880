"""Readings of a laser tracker: `Pos n` with lines `X= ... Y= ... Z= ...`, or a table by the mapping.

They are no recording: joined with the robot's postures they become the table that `calibrate.tracker` takes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.cloud.readers import READING
from workbench.errors import InputError
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import LENGTH_MM, TrackerPart
from workbench.importing.neutral import MAX_MM, Imported, PoseStream, TrackerReadings
from workbench.importing.text import (
    head_text,
    numbers,
    read_table,
    read_text,
)
from workbench.units import DEG, Float, Int

NAME = "readings of a laser tracker"
POSITION = re.compile(r"^\s*Pos\w*\s*(\d{1,9})\b", re.IGNORECASE)
INTO_A_TABLE = (
    "it is no recording: with the robot's joints or poses it becomes the table that stage calibrate.tracker takes: "
    "workbench import --draft READINGS JOINTS --out map.json (docs/howto/calibrate_robot.md)"
)


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether it begins with a position and readings, or the mapping names it."""
    claimed = mapping.tracker is not None and mapping.tracker.claims(path)
    return claimed or _by_position(head_text(head))


def read(path: Path, mapping: Mapping) -> Imported:
    """The readings, in mm.

    Raises:
        InputError: a line that is neither position nor reading, a cell that is no number; no readings.
    """
    part = mapping.tracker or TrackerPart()
    found = _positions(path, part) if part.targets is None else _by_columns(path, part)
    far = np.flatnonzero((np.abs(found.place_mm) > MAX_MM).any(axis=1))
    if len(far):
        shown = ", ".join(f"{v:.6g}" for v in found.place_mm[far[0]])
        raise InputError(f"{path}: reading {far[0] + 1}", f"expected a place in {MAX_MM:g} mm, found {shown} mm")
    return Imported(tracker=found, notes=(f"{NAME}: {'; '.join(summary(found))}",))


def summary(found: TrackerReadings) -> list[str]:
    """Counts, scatter within a position and the position whose readings scatter most, times."""
    count = len(found.place_mm)
    names = len(set(found.name))
    of = f" of {names} targets" if names > 1 else ""
    lines = [f"positions: {len(np.unique(found.number))} with {count} readings{of}", *_scatter(found)]
    if found.time_s is not None:
        lines.append(f"times over {np.ptp(found.time_s):.6g} s")
    return lines


def groups_of(found: TrackerReadings) -> list[tuple[int, Int]]:
    """Number of a position, and the rows of the readings of one target there."""
    rows: dict[tuple[int, str], list[int]] = {}
    for row, key in enumerate(zip(found.number.tolist(), found.name, strict=True)):
        rows.setdefault(key, []).append(row)
    return [(key[0], np.array(one)) for key, one in rows.items()]


def _scatter(found: TrackerReadings) -> list[str]:
    groups = groups_of(found)
    off = [found.place_mm[rows] - found.place_mm[rows].mean(axis=0) for _, rows in groups]
    free = len(found.place_mm) - len(groups)
    if not free:
        return []
    spread = float(np.sqrt(sum(float((one**2).sum()) for one in off) / (3 * free)))
    far = [float(np.linalg.norm(one, axis=1).max()) for one in off]
    worst = int(np.argmax(far))
    return [
        f"within a position: standard deviation {spread:.4g} mm an axis, {far[worst]:.4g} off the mean at the most, "
        f"at position {groups[worst][0]}"
    ]


def _by_position(text: str) -> bool:
    lines = [line for line in text[:4096].splitlines() if line.strip()][:2]
    return len(lines) == 2 and bool(POSITION.match(lines[0])) and bool(READING.search(lines[1]))


def _positions(path: Path, part: TrackerPart) -> TrackerReadings:
    """The readings by position; positions that have none are left out."""
    places: list[Float] = []
    numbers_: list[int] = []
    now: int | None = None
    for k, line in enumerate(read_text(path).split("\n"), 1):
        if head := POSITION.match(line):
            now = int(head[1])
        elif (reading := READING.search(line)) and now is not None:
            places.append(numbers(reading.groups(), f"{path}: line {k}"))
            numbers_.append(now)
        elif line.strip() and "INVALID" not in line:
            expected = "expected 'Pos n', or a reading as 'X= ... Y= ... Z= ...'; of a table: tracker.targets"
            raise InputError(f"{path}: line {k}", expected)
    if not places:
        raise InputError(str(path), "expected readings as 'X= ... Y= ... Z= ...', found none")
    place_mm = np.array(places) * LENGTH_MM[part.length_unit]
    return TrackerReadings(str(path), place_mm, ("target",) * len(places), np.array(numbers_, np.int64))


def _by_columns(path: Path, part: TrackerPart) -> TrackerReadings:
    """One row per posture with the places of all targets; an empty place is no reading."""
    assert part.targets is not None
    table, count = read_table(path, part), len(part.targets)
    roles = [f"{k} {axis}" for k in range(count) for axis in "xyz"]
    places = np.stack([table.columns[role] for role in roles], axis=1).reshape(-1, count, 3)
    row, target = np.nonzero(np.isfinite(places).all(axis=2))
    if not len(row):
        raise InputError(table.where, "expected readings, found none")
    number, times = table.whole("number"), table.times(part.time_unit)
    position = np.arange(1, len(places) + 1) if number is None else number
    names = tuple(f"t{k + 1}" for k in target)
    place_mm = places[row, target] * LENGTH_MM[part.length_unit]
    return TrackerReadings(table.where, place_mm, names, position[row], None if times is None else times[row])


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
    offset_s = mapping.times.clock_offset_s if mapping.times else 0.0
    by_time = partial(_by_time, within_s=part.within_s, offset_s=offset_s)
    ways: dict[str, Callable[..., Pairs]] = {"number": _by_number, "time": by_time, "order": _by_order}
    pairs = ways[part.pair](readings, postures)
    if not pairs.groups:
        hint = "; other clocks? times.clock_offset_s in the mapping" if part.pair == "time" else ""
        raise InputError(readings.source, f"no reading goes with a posture of {postures.source} by {part.pair}{hint}")
    lines = [",".join(("target", *postures.columns, *PLACE))]
    for rows, at in pairs.groups:
        numbers = [*postures.values[at].mean(axis=0), *readings.place_mm[rows].mean(axis=0)]
        lines.append(",".join([readings.name[rows[0]], *(f"{value:.9g}" for value in numbers)]))
    note = f"joined by {part.pair}: {len(lines) - 1} rows of {sum(len(rows) for rows, _ in pairs.groups)} readings"
    return lines, (note, *pairs.lines)


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


def _by_number(readings: TrackerReadings, postures: Postures) -> Pairs:
    """Position n is the posture of that number, else the n-th row."""
    own = postures.number if postures.number is not None else np.arange(1, len(postures.values) + 1)
    if len(np.unique(own)) < len(own):
        raise InputError(postures.source, "a posture's number occurs twice")
    groups = []
    for position, rows in groups_of(readings):
        at = np.flatnonzero(own == position)
        if not len(at):
            raise InputError(readings.source, f"position {position}: {postures.source} has no such posture")
        groups.append((rows, at))
    unseen = sorted(set(own.tolist()) - set(readings.number.tolist()))
    note = f"postures without a reading: {', '.join(map(str, unseen[:12]))}" if unseen else ""
    return Pairs(groups, tuple(filter(None, [note])))


def _by_time(readings: TrackerReadings, postures: Postures, within_s: float, offset_s: float) -> Pairs:
    """Postures within a time of the reading that all say the same; a robot that moves there tells nothing."""
    for what in (readings, postures):
        if what.time_s is None:
            raise InputError(what.source, "contains no times: expected another tracker.pair in the mapping")
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
    groups = []
    for name in dict.fromkeys(readings.name):
        rows = [row for row, other in enumerate(readings.name) if other == name]
        if len(rows) != len(postures.values):
            raise InputError(
                readings.source,
                f"{len(rows)} readings of '{name}' and {len(postures.values)} postures in {postures.source}: expected "
                "as many, or numbers or times in both (tracker.pair in the mapping)",
            )
        groups += [(np.array([row]), np.array([k])) for k, row in enumerate(rows)]
    return Pairs(sorted(groups, key=lambda pair: (pair[1][0], pair[0][0])), ())
