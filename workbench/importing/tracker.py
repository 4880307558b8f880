"""Readings of a laser tracker: `Pos n` with lines `X= ... Y= ... Z= ...`, a table with a name a row, or any table.

They are no recording: joined with the robot's postures they become the table that `calibrate.tracker` takes.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.cloud.readers import READING
from workbench.errors import InputError
from workbench.importing import joints, poses, tables
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import LENGTH_MM, TrackerPart
from workbench.importing.neutral import MAX_MM, Imported, PoseStream, TrackerReadings
from workbench.importing.roles import LENGTHS, role_of
from workbench.importing.text import (
    NO_VALUE,
    cells,
    head_text,
    number,
    numbered,
    numbers,
    read_table,
    read_text,
)
from workbench.units import DEG, Float, Int

NAME = "readings of a laser tracker"
POSITION = re.compile(r"^\s*Pos\w*\s*(\d{1,9})\b", re.IGNORECASE)
POINT_NAMES = ("name", "point", "pointname", "pointid", "target", "targetname", "measurement", "label")
OF_95 = re.compile(r"^\s*(u95|uncertainty|umag|u 95)", re.IGNORECASE)
HEADER_WITHIN = 20  # lines
CLOCKS = ("%H:%M:%S", "%H:%M:%S.%f", "%d.%m.%Y %H:%M:%S", "%d.%m.%Y %H:%M:%S.%f")  # besides ISO 8601 and seconds
K_95 = 2.0  # coverage factor of U95
INTO_A_TABLE = (
    "it is no recording: with the robot's joints or poses it becomes the table that stage calibrate.tracker takes: "
    "workbench import --draft READINGS JOINTS --out map.json (docs/howto/calibrate_robot.md)"
)


class Head(NamedTuple):
    """The header of a table of named readings."""

    line: int  # from 0
    delimiter: str
    places: dict[str, int]  # role -> column: x, y, z, and perhaps name, u95, time
    unit: str  # '' where the header tells none
    width: int  # cells


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether it begins with a position and readings, or has a header of named readings; or the mapping names it."""
    if mapping.tracker is not None and mapping.tracker.claims(path):
        return True
    text = head_text(head)
    if _by_position(text):
        return True
    others = (tables, poses, joints)  # by the columns that the mapping names
    return _head(text) is not None and not any(other.recognises(path, head, mapping) for other in others)


def read(path: Path, mapping: Mapping) -> Imported:
    """The readings, in mm.

    Raises:
        InputError: a line that is neither position nor reading, a cell that is no number; no readings.
    """
    part = mapping.tracker or TrackerPart()
    if part.targets is not None:
        found = _by_columns(path, part)
    else:
        text = read_text(path)
        head = None if _by_position(text) else _head(text)
        found = _positions(path, text, part) if head is None else _named(path, text, head, part)
    far = np.flatnonzero((np.abs(found.place_mm) > MAX_MM).any(axis=1))
    if len(far):
        shown = ", ".join(f"{v:.6g}" for v in found.place_mm[far[0]])
        raise InputError(f"{path}: reading {far[0] + 1}", f"expected a place in {MAX_MM:g} mm, found {shown} mm")
    return Imported(tracker=found, notes=(f"{NAME}: {'; '.join(told(found))}",))


def told(found: TrackerReadings) -> list[str]:
    """Counts, scatter within a position and the position whose readings scatter most, declared uncertainty."""
    count = len(found.place_mm)
    names = len(set(found.name))
    lines = [f"{count} readings" + (f" of {names} targets or points" if names > 1 else "")]
    if found.number is not None:
        lines = [f"positions: {len(np.unique(found.number))} with {lines[0]}", *_scatter(found)]
    if found.u95_mm is not None:
        u = found.u95_mm[np.isfinite(found.u95_mm)]
        if len(u):
            lines.append(
                f"U95 declared: {u.min():.4g} to {u.max():.4g} mm, median {np.median(u):.4g}; "
                f"calibrate.tracker takes it as tracker_noise_mm {np.median(u) / K_95:.3g} (half of it)"
            )
    if found.time_s is not None:
        lines.append(f"times over {np.ptp(found.time_s):.6g} s")
    return lines


def groups_of(found: TrackerReadings) -> list[tuple[int, Int]]:
    """Number of a position, and the rows of the readings of one target there."""
    assert found.number is not None
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


def _positions(path: Path, text: str, part: TrackerPart) -> TrackerReadings:
    """The readings by position; positions that have none are left out."""
    places: list[Float] = []
    numbers_: list[int] = []
    now: int | None = None
    for k, line in enumerate(text.split("\n"), 1):
        if head := POSITION.match(line):
            now = int(head[1])
        elif (told := READING.search(line)) and now is not None:
            places.append(numbers(told.groups(), f"{path}: line {k}"))
            numbers_.append(now)
        elif line.strip() and "INVALID" not in line:
            raise InputError(f"{path}: line {k}", "expected 'Pos n', or a reading as 'X= ... Y= ... Z= ...'")
    if not places:
        raise InputError(str(path), "expected readings as 'X= ... Y= ... Z= ...', found none")
    place_mm = np.array(places) * LENGTH_MM[part.length_unit]
    return TrackerReadings(str(path), place_mm, ("target",) * len(places), np.array(numbers_, np.int64))


def _head(text: str) -> Head | None:
    """The header of a table of named readings: x, y, z and a U95, or x, y, z and the readings' names."""
    for k, line in enumerate(text.split("\n")[:HEADER_WITHIN]):
        for delimiter in ",;\t":
            titles = cells(line, delimiter)
            places = _places(titles)
            if places is not None:
                units = {role_of(titles[places[axis]])[1] for axis in "xyz"}
                unit = units.pop() if len(units) == 1 else ""
                return Head(k, delimiter, places, unit if unit in LENGTHS else "", len(titles))
    return None


def _places(titles: Sequence[str]) -> dict[str, int] | None:
    """Where the columns of named readings stand; None where these are other titles."""
    places: dict[str, int] = {}
    for at, title in enumerate(titles):
        role = role_of(title)[0]
        if OF_95.match(title):
            role = "u95"
        elif re.sub(r"\W", "", title.lower()) in POINT_NAMES:
            role = "name"
        elif role not in ("x", "y", "z", "time", ""):
            return None  # an orientation, a frame's number: something else
        if role:
            places.setdefault(role, at)
    named = {"x", "y", "z"} <= set(places) and {"u95", "name"} & set(places)
    return places if named else None


def _named(path: Path, text: str, head: Head, part: TrackerPart) -> TrackerReadings:
    """A reading a row, with its name; rows without a place are no readings."""
    rows: list[dict[str, str]] = []
    values: list[Float] = []
    for k, line in numbered(text):
        if k <= head.line + 1:
            continue
        where, texts = f"{path}: line {k}", next(csv.reader([line], delimiter=head.delimiter))
        if len(texts) != head.width:
            raise InputError(where, f"expected {head.width} cells, found {len(texts)}")
        row = {role: texts[at].strip() for role, at in head.places.items()}
        told = [row[role] for role in ("x", "y", "z", "u95") if role in row]
        if all(one in NO_VALUE for one in told[:3]):
            continue
        decimal = "," if head.delimiter != "," and any("," in one for one in told) else "."
        values.append(numbers(told, where, decimal))
        if np.isnan(values[-1][:3]).any():
            raise InputError(where, "expected x, y and z, found one of them empty")
        rows.append(row)
    if not rows:
        raise InputError(str(path), "expected rows of readings under the header, found none")
    told_mm = np.array(values) * LENGTH_MM[head.unit or part.length_unit]
    names = tuple(row.get("name", "target") for row in rows)
    u95_mm = told_mm[:, 3] if "u95" in head.places else None
    times = _times([row["time"] for row in rows]) if "time" in head.places else None
    return TrackerReadings(str(path), told_mm[:, :3], names, None, times, u95_mm)


def _times(texts: Sequence[str]) -> Float | None:
    """Seconds, where every text is a number of them, ISO 8601, or a clock; None where they are something else."""
    found = [_clock(text) if (value := number(text)) is None else value for text in texts]
    return np.array(found, float) if None not in found and np.isfinite(np.array(found, float)).all() else None


def _clock(text: str) -> float | None:
    for form in ("", *CLOCKS):
        try:
            when = datetime.strptime(text, form) if form else datetime.fromisoformat(text)
        except ValueError:
            continue
        return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()
    return None


def _by_columns(path: Path, part: TrackerPart) -> TrackerReadings:
    """A row a posture with the places of all targets; an empty place is no reading."""
    assert part.targets is not None
    table, count = read_table(path, part), len(part.targets)
    roles = [f"{k} {axis}" for k in range(count) for axis in "xyz"]
    places = np.stack([table.columns[role] for role in roles], axis=1).reshape(-1, count, 3)
    row, target = np.nonzero(np.isfinite(places).all(axis=2))
    if not len(row):
        raise InputError(table.where, "expected readings, found none")
    told, times = table.whole("number"), table.times(part.time_unit)
    position = np.arange(1, len(places) + 1) if told is None else told
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
    way = part.pair or _usual(readings, postures)
    offset_s = mapping.times.clock_offset_s if mapping.times else 0.0
    by_time = partial(_by_time, within_s=part.within_s, offset_s=offset_s)
    ways: dict[str, Callable[..., Pairs]] = {"number": _by_number, "time": by_time, "order": _by_order}
    pairs = ways[way](readings, postures)
    if not pairs.groups:
        hint = "; other clocks? times.clock_offset_s in the mapping" if way == "time" else ""
        raise InputError(readings.source, f"no reading goes with a posture of {postures.source} by {way}{hint}")
    lines = [",".join(("target", *postures.columns, *PLACE))]
    for rows, at in pairs.groups:
        numbers = [*postures.values[at].mean(axis=0), *readings.place_mm[rows].mean(axis=0)]
        lines.append(",".join([_target(readings, int(rows[0])), *(f"{value:.9g}" for value in numbers)]))
    note = f"joined by {way}: {len(lines) - 1} rows of {sum(len(rows) for rows, _ in pairs.groups)} readings"
    return lines, (note, *pairs.lines)


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
    for position, rows in groups_of(readings):
        at = np.flatnonzero(own == position)
        if not len(at):
            raise InputError(readings.source, f"position {position}: {postures.source} has no such posture")
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
