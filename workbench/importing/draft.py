"""`workbench import --draft`: the smallest mapping under which the sources make sense, its doubts marked."""

from __future__ import annotations

import glob
import json
import os.path
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import InputError, one_line
from workbench.importing import arrays, programs
from workbench.importing.assemble import assemble, joined
from workbench.importing.kinds import AS_A_CLOUD, AS_ARRAYS, read_source
from workbench.importing.mapping import mapping_of, no_mapping
from workbench.importing.mapping_parts import LENGTH_MM, TIME_S, ArraysPart
from workbench.importing.neutral import Imported
from workbench.importing.roles import (
    ANGLES,
    LENGTHS,
    TURN_DEG,
    TURN_RAD,
    USUAL_REACH_MM,
    WAY_BY_Y,
    Columns,
    Named,
    column_of,
    columns_of,
)
from workbench.importing.suspicions import WIDTH_MM
from workbench.importing.tables import way_of
from workbench.importing.text import Form, first_bytes, form_of
from workbench.importing.tracker import joined as joined_with_postures
from workbench.storage import write_whole
from workbench.units import AnyArray, Float

FRAME_S, POSE_S = (2e-5, 1.0), (1e-3, 60.0)  # from one frame, or pose, to the next
STREAM, STREAM_S = 500, (1e-3, 1.0)  # so many poses are a controller's stream
CODES = (-999.999, -999.99, -999.0, -9999.0, -99999.0, -99.99, 0.0, -32768.0, 32767.0, 65535.0, 9999.0, 99999.0)
MOST = 10**6  # ranges that are looked at for them
CODE_GAP = 0.3  # share of the other values' span that lies free around a code for 'no return'
LENGTHWISE = ("x", "y", "z", "travel")
Tree = dict[str, Any]
Size = tuple[float, tuple[float, float]]  # as the file has it; usual ones, mm or s


def draft_files(sources: Sequence[str | Path], out: str | Path) -> tuple[str, ...]:
    """Write MAP.json for the sources; returns lines that say what was understood and what is uncertain.

    Raises:
        InputError: a source is neither of a known kind nor a table of numbers that can be told.
        OutputError: the mapping cannot be written.
    """
    target = Path(out)
    if target.suffix != ".json":
        raise InputError(str(target), "expected the name of a mapping to write, ending in .json")
    tree, lines = drafted([Path(source) for source in sources])
    write_whole(target, (json.dumps(tree, indent=2, ensure_ascii=False) + "\n").encode())
    open_points = [f"{what}: {text}" for what in ("uncertain", "lacking") for text in tree.get(what, ())]
    return tuple(one_line(line) for line in [*lines, *open_points, f"mapping: {target}"])


def drafted(sources: Sequence[Path]) -> tuple[Tree, list[str]]:
    """The mapping, and what was understood of each source."""
    tree: Tree = {"format": "import-mapping", "version": 1}
    doubts: list[str] = []
    lines: list[str] = []
    by_part: dict[str, list[tuple[Path, Form, Columns]]] = {"profiles": [], "poses": [], "joints": []}
    frames_s = 0.0
    of_arrays = [one for one in sources if one.is_file() and arrays.recognises(one, first_bytes(one), no_mapping())]
    if of_arrays:
        tree["arrays"], doubts = _arrays(of_arrays)
    for source in sources:
        if source in of_arrays:  # numbers alone: nothing in the file tells their units
            continue
        try:
            known = read_source(source, no_mapping())
        except InputError as error:
            if source.is_file() and programs.recognises(source, first_bytes(source), no_mapping()):
                part, more = programs.drafted(source, error)
                tree["program"] = {"files": glob.escape(source.name), **part}
                doubts += more
                continue
            form, columns = _table(source, error)
            by_part[columns.kind if columns.kind in by_part else "profiles"].append((source, form, columns))
            continue
        lines += [f"{source}: {note}" for note in known.notes]
    for name, tables in by_part.items():
        if tables:
            others = [source.name for source in sources if source not in [table[0] for table in tables]]
            part, more = {"profiles": _profiles, "poses": _poses, "joints": _joints}[name](*tables[0][1:], frames_s)
            if name == "profiles":
                frames_s = _duration_s(part, *tables[0][1:])
            tree[name] = {"files": _pattern([table[0].name for table in tables], others), **part}
            if targets := _targets(tables[0][2].roles):
                written = {"files": tree[name]["files"], **tables[0][1].as_part()}
                tree["tracker"] = {**written, "length_unit": "mm", "targets": targets}
                more.append("tracker.length_unit: mm, as trackers write")
            doubts += [*tables[0][2].doubts, *more]
            if name == "poses" and tables[0][2].robot:
                tree["robot"] = tables[0][2].robot
    more, lacking = _settle(tree, sources, lines)
    tree |= {name: texts for name, texts in (("uncertain", [*doubts, *more]), ("lacking", lacking)) if texts}
    return tree, lines


def _arrays(sources: Sequence[Path]) -> tuple[Tree, list[str]]:
    """The part `arrays` of files whose names tell what is in them: the units of all, by the size of the numbers.

    Raises:
        InputError: names that tell neither profiles nor poses.
    """
    part: Tree = {}
    doubts: list[str] = []
    lengths: list[Size] = []
    steps: list[Size] = []
    for source in sources:
        names, values = arrays.by_role(source, ArraysPart())
        if {"x", "z"} <= set(names):
            lengths.append((float(np.nanmax(values["x"]) - np.nanmin(values["x"])), WIDTH_MM))
            z = values["z"].ravel()
            if codes := _codes(z[:: 1 + z.size // MOST].astype(float)):
                part["missing"] = codes
        if {"position", "base_from_flange"} & set(names):
            places = (
                values["position"] if "position" in names else values["base_from_flange"].reshape(-1, 4, 4)[:, :3, 3]
            )
            lengths.append((float(np.linalg.norm(np.atleast_2d(places), axis=1).max()), USUAL_REACH_MM))
        times = {"time": FRAME_S if "z" in names else POSE_S, "pose_time": POSE_S}
        steps += [_step(values[role], usual) for role, usual in times.items() if role in names]
    for name, known, sizes in (("length_unit", LENGTH_MM, lengths), ("time_unit", TIME_S, steps)):
        if sizes:
            part[name], more = _unit(f"arrays.{name}", "", known, *sizes)
            doubts += more
    return part, doubts


def _table(source: Path, error: InputError) -> tuple[Form, Columns]:
    """A table of numbers whose columns can be told; else the reader's own refusal."""
    form = form_of(source) if source.is_file() else None
    if form is None:
        raise error
    columns = columns_of(form)
    if not columns.kind:
        names = ", ".join(map(repr, form.header[:12])) or f"{form.rows.shape[1]} columns without names"
        known = f" (understood: {', '.join(columns.roles)})" if columns.roles else ""
        if form.rows.shape[1] == 3 or {"x", "y", "z"} <= set(map(str.lower, form.header)):
            raise InputError(str(source), f"three coordinates a point, in no rows of profiles: {AS_A_CLOUD}")
        raise InputError(
            str(source),
            f"expected columns x and z of points, or x, y, z and an orientation, or joints; found {names}{known}. "
            f"Another form: {AS_ARRAYS}",
        )
    stated = {one.unit: one.column for role, one in columns.roles.items() if role in LENGTHWISE and one.unit}
    if len(stated) > 1:
        names = " and ".join(map(repr, stated.values()))
        raise InputError(str(source), f"expected lengths in one unit, found {names}")
    return form, columns


def _profiles(form: Form, columns: Columns, frames_s: float) -> tuple[Tree, list[str]]:
    """The part `profiles`; how long frames last is not known before (0)."""
    if columns.kind == "rows":
        return _ranges(form)
    roles = columns.roles
    x, z = (column_of(form, roles[role]) for role in "xz")
    missing = _codes(z)
    good = ~np.isin(z, missing) & np.isfinite(x) & np.isfinite(z)
    unit, doubts = _unit(
        "profiles.length_unit",
        roles["x"].unit or roles["z"].unit,
        LENGTH_MM,
        (float(np.ptp(x[good])) if good.any() else 0.0, WIDTH_MM),
    )
    part: Tree = {**form.as_part(), "length_unit": unit}
    part["frames"] = _frames(form, columns, x)
    names = {"scan_pass" if role == "pass" else role: one.column for role, one in roles.items()}
    if "travel" in roles and not roles["travel"].unit and WAY_BY_Y not in columns.doubts:
        doubts.append(f"profiles.columns.travel: {names['travel']!r} is taken as {unit} along the scan, not as counts")
    if part["frames"] != "column":
        names.pop("frame", None)
    doubts += _timed(part, "profiles", form, roles, FRAME_S, frames_s)
    part["columns"] = names
    return part, doubts + _no_return(part, missing)


def _timed(
    part: Tree, name: str, form: Form, roles: dict[str, Named], usual_s: tuple[float, float], frames_s: float
) -> list[str]:
    """Adds the unit of times, where the table has some; returns its doubts. Poses last about as long as frames do."""
    if "time" not in roles:
        return []
    times = np.unique(column_of(form, roles["time"]))
    units = [unit for unit, scale in TIME_S.items() if np.ptp(times) * scale > 0.9 * frames_s > 0.0]
    nearest_first = dict(sorted(TIME_S.items(), key=lambda one: (one[0] not in units, one[1])) if units else TIME_S)
    part["time_unit"], doubts = _unit(f"{name}.time_unit", roles["time"].unit, nearest_first, _step(times, usual_s))
    if name != "profiles":
        part["time"] = roles["time"].column
    return doubts


def _duration_s(part: Tree, form: Form, columns: Columns) -> float:
    """How long the frames of a table last; 0 where it has no times."""
    if "time" not in columns.roles:
        return 0.0
    return float(np.ptp(column_of(form, columns.roles["time"]))) * TIME_S[part["time_unit"]]


def _no_return(part: Tree, missing: list[float]) -> list[str]:
    """Adds the numbers that mean no return; returns the doubt about them."""
    if not missing:
        return []
    part["missing"] = missing
    return [f"profiles.missing: {', '.join(f'{v:g}' for v in missing)} is taken as no return"]


def _frames(form: Form, columns: Columns, x: Float) -> str:
    """What tells frames apart."""
    if "frame" in columns.roles:
        return "column"
    if form.after_blank[1:].any():
        return "blank_lines"
    x = x[np.isfinite(x)]
    way, span = way_of(x)
    return "restart" if (np.diff(x) * way < -0.5 * span).any() else "one"


def _ranges(form: Form) -> tuple[Tree, list[str]]:
    """A row of ranges a frame: nothing tells x, and often nothing the unit."""
    part: Tree = {**form.as_part(), "length_unit": "mm", "frames": "rows", "x_first": 0.0, "x_pitch": 1.0}
    return part, [
        "profiles.x_pitch, profiles.x_first: a row of ranges does not contain x; 1 and 0 are assumed",
        "profiles.length_unit: a row of ranges does not state its unit",
        *_no_return(part, _codes(form.rows)),
    ]


def _poses(form: Form, columns: Columns, frames_s: float) -> tuple[Tree, list[str]]:
    """The part `poses`, of frames over `frames_s` (0: unknown)."""
    roles = columns.roles
    position = np.stack([column_of(form, roles[role]) for role in "xyz"], axis=1)
    reach = float(np.nanmax(np.linalg.norm(position, axis=1)))
    unit, doubts = _unit("poses.length_unit", roles["x"].unit, LENGTH_MM, (reach, USUAL_REACH_MM))
    part: Tree = {**form.as_part(), "length_unit": unit}
    doubts += _timed(part, "poses", form, roles, STREAM_S if len(form.rows) >= STREAM else POSE_S, frames_s)
    part["position"] = [roles[role].column for role in "xyz"]
    part["orientation"] = [roles[role].column for role in columns.orientation]
    part["convention"] = columns.convention
    if columns.convention.startswith("euler"):
        values = np.stack([column_of(form, roles[role]) for role in columns.orientation], axis=1)
        angle_unit = roles[columns.orientation[0]].unit
        part["angle_unit"] = angle_unit or ("rad" if np.nanmax(np.abs(values)) <= 2 * np.pi + 1e-3 else "deg")
        if not angle_unit:
            doubts.append(f"poses.angle_unit: {part['angle_unit']}, by the size of the numbers")
    if "pass" in roles:
        part["scan_pass"] = roles["pass"].column
    if not any(re.search("flange|tool0", name.lower()) for name in form.header):
        doubts.append("poses.flange_from_tool: none; a controller's log may be of its tool (TCP), not of the flange")
    return part, doubts


def _joints(form: Form, columns: Columns, frames_s: float) -> tuple[Tree, list[str]]:
    """The part `joints`, without the robot, of frames over `frames_s` (0: unknown)."""
    roles = columns.roles
    axes = [one for role, one in roles.items() if role.startswith("joint")]
    part: Tree = form.as_part()
    unit, doubts = _angle(form, axes)
    linear = [one for one in axes if one.unit in LENGTHS]
    part["length_unit"] = linear[0].unit if linear else "mm"
    part["angle_unit"] = unit
    doubts += _timed(part, "joints", form, roles, POSE_S, frames_s)
    if "number" in roles:
        part["number"] = roles["number"].column
    part["columns"] = [one.column for one in axes]
    return part, doubts


def _targets(roles: dict[str, Named]) -> list[list[str | int]]:
    """Columns of the places of a tracker's targets."""
    columns = [one.column for role, one in roles.items() if role.startswith("target")]
    return [columns[k : k + 3] for k in range(0, len(columns), 3)]


def _angle(form: Form, axes: Sequence[Named]) -> tuple[str, list[str]]:
    """The joints' unit by name, else by size; what is beyond two turns in deg goes along its axis."""
    stated = next((one.unit for one in axes if one.unit in ANGLES), "")
    largest = {
        repr(one.column): float(np.nanmax(np.abs(column_of(form, one)))) for one in axes if one.unit not in LENGTHS
    }
    far = [name for name, value in largest.items() if value > TURN_DEG]
    doubts = [f"joints.length_unit: mm for {', '.join(far)}, by the size of the numbers: a linear axis?"] if far else []
    if stated:
        return stated, doubts
    turning = [value for name, value in largest.items() if name not in far]
    unit = "rad" if max(turning, default=0.0) <= TURN_RAD else "deg"
    return unit, [*doubts, f"joints.angle_unit: {unit}, by the size of the numbers ({max(turning, default=0.0):.4g})"]


def _unit(what: str, stated: str, known: dict[str, float], *sizes: Size) -> tuple[str, list[str]]:
    """The unit that the name tells, else the first under which each size is a usual one."""
    if stated in known:
        return stated, []
    units = [unit for unit, scale in known.items() if all(low <= size * scale <= high for size, (low, high) in sizes)]
    others = f"; {' or '.join(units[1:])} would be possible too" if units[1:] else ""
    chosen, by = next(iter(units or known)), "steps of time" if "s" in known else "size of the numbers"
    return chosen, [f"{what}: {chosen}, by the {by} ({', '.join(f'{size:.4g}' for size, _ in sizes)}){others}"]


def _step(times: AnyArray, usual_s: tuple[float, float]) -> Size:
    steps = np.diff(np.atleast_1d(times).astype(float))
    return float(np.median(steps)) if len(steps) else 0.0, usual_s


def _codes(values: Float) -> list[float]:
    """Numbers that mean no return: known ones, apart from all others."""
    known, found = values[np.isfinite(values)], []
    for code in CODES:
        hits = known == code
        rest = known[~hits & ~np.isin(known, CODES)]
        if hits.any() and len(rest) and np.abs(rest - code).min() > CODE_GAP * max(float(np.ptp(rest)), 1e-9):
            found.append(code)
    return found


def _pattern(names: list[str], others: list[str]) -> str:
    """A file name pattern for these names and none of the others."""
    if len(names) == 1:
        return glob.escape(names[0])
    head = os.path.commonprefix(names)  # noqa: RUF071  (of letters, not of folders)
    tail = os.path.commonprefix([name[len(head) :][::-1] for name in names])[::-1]  # noqa: RUF071
    if any(name.startswith(head) and name.endswith(tail) for name in others):
        raise InputError(
            ", ".join(names[:3]),
            "expected names that distinguish profiles from poses, such as scan1.csv and robot1.csv",
        )
    return f"{glob.escape(head)}*{glob.escape(tail)}"


def _settle(tree: Tree, sources: Sequence[Path], lines: list[str]) -> tuple[list[str], list[str]]:
    """Times and hand-eye, by what the sources hold under the mapping so far; adds to tree and lines.

    Returns doubts, and what is lacking.
    """
    mapping, found, unread = mapping_of(tree), [], []
    for source in sources:
        try:
            one = read_source(source, mapping)
        except InputError as error:
            unread.append(f"{error}")
            continue
        found.append(one)
        lines += [f"{source}: {note}" for note in one.notes if f"{source}: {note}" not in lines]
    if unread:
        return [], [f"with this mapping: {text}" for text in unread]
    if any(one.tracker is not None for one in found):
        try:
            joined_with_postures(found, mapping_of(tree))
        except InputError as error:
            return [], [f"with this mapping: {error}"]
        return [], []
    doubts = _times(tree, found)
    has = [any(one.profiles is not None for one in found), any(_times_of_poses(one) is not None for one in found)]
    if has == [True, False] and sum(len(one.profiles.z_mm) for one in found if one.profiles is not None) == 1:
        return doubts, ["a single profile: `workbench look` shows and measures it; a recording needs frames and poses"]
    lacking = []
    if has == [True, True]:
        lacking.append("hand_eye: not in the files; add it, or name a handeye.json in the pipeline")
    unmoved = [one for one in found if one.joints is not None] if all(one.poses is None for one in found) else []
    if unmoved:
        lacking.append("joints.urdf, joints.base_frame, joints.flange_frame: the robot's description and its links")
    if not has[0]:
        return doubts, [*lacking, "profiles: none among the sources"]
    if unmoved:
        return doubts, lacking
    try:
        assemble(found, mapping_of(tree))
    except InputError as error:
        lacking.append(f"with this mapping: {error}")
    return doubts, lacking


def _times(tree: Tree, found: Sequence[Imported]) -> list[str]:
    """The part `times`, where profiles and poses do not have times on one clock."""
    streams = [times for one in found if (times := _times_of_poses(one)) is not None]
    profiles = [one.profiles for one in found if one.profiles is not None]
    if not profiles:
        return []
    frames = joined(profiles)
    count = len(frames.z_mm)
    if not streams:
        if frames.travel_mm is None and count > 1:
            tree["linear_axis"] = {}
            tree["times"] = {"source": "travel", "start_mm": 0.0, "pitch_mm": 1.0}
            return ["times.pitch_mm: the files do not contain the travel; 1 mm per frame is assumed"]
        return []
    poses, pose_s = streams[0]
    if frames.time_s is not None and pose_s is not None:
        of_all = np.concatenate([times for _, times in streams if times is not None])  # a stream may be of one pass
        if frames.time_s[0] >= of_all.min() and frames.time_s[-1] <= of_all.max():
            return []
        offset = round(float(frames.time_s[0] - of_all.min()), 9)
        tree["times"] = {"source": "file", "clock_offset_s": offset}
        return [f"times.clock_offset_s: the clocks differ; {offset:g} s puts the first frame on the first pose"]
    if poses == count and len(streams) == 1:
        tree["times"] = {"source": "pose_each"}
        return ["times.source: as many poses as frames: one pose per frame"]
    if frames.travel_mm is not None:
        tree["times"] = {"source": "travel", "start_mm": float(frames.travel_mm[0])}
        return ["times.start_mm: the travel at the first frame is taken as that at the first pose"]
    if pose_s is None or count < 2:
        return []
    duration = float(pose_s[-1] - pose_s[0])
    rate = round((count - 1) / duration * (1 + 1e-9), 9) if duration > 0 else 1.0
    tree["times"] = {"source": "rate", "rate_hz": rate, "start_s": "first_pose"}
    return [f"times.rate_hz: no times in the profiles; {rate:.6g} spreads the frames evenly over the poses"]


def _times_of_poses(one: Imported) -> tuple[int, Float | None] | None:
    """How many poses, or postures that poses will follow from, and their times; None of a source that has none."""
    if one.poses is not None:
        return len(one.poses.position_mm), one.poses.time_s
    return None if one.joints is None else (len(one.joints.position), one.joints.time_s)
