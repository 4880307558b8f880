"""What the columns of an unknown table are: by their names, else by their numbers."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from workbench.importing.mapping_parts import UNITS
from workbench.importing.text import Form, steady
from workbench.units import Float

LENGTHS, ANGLES = ("mm", "m", "um", "inch"), ("deg", "rad")
OWN = ("qw", "qx", "qy", "qz", "q1", "q2", "q3", "q4", *"wprabc", "rx", "ry", "rz", "roll", "pitch", "yaw")
ROLES = {  # names of a column, in small letters without what stands between words
    "x": "x xpos posx lateral",
    "y": "y ypos posy",
    "z": "z zpos posz range height distance depth",
    "frame": "frame frameid framenumber frameno profile profileno profileid profilenumber profileindex profil "
    "scan line",
    "time": "t time stamp timestamp clock zeit ipoc",
    "intensity": "intensity brightness luminance reflectance",
    "travel": "encoder travel feed",
    "pass": "pass scanpass",
    "valid": "valid isvalid",
    **dict(zip(OWN, OWN, strict=True)),
    **{"qw": "qw u0", "qx": "qx u1", "qy": "qy u2", "qz": "qz u3"},  # u: EgmQuaternion
}
ALIKE = {name: role for role, names in ROLES.items() for name in names.split()}
ORIENTATIONS = (  # columns, convention, robot, what is uncertain
    (("qw", "qx", "qy", "qz"), "quaternion_wxyz", "", ""),
    (("q1", "q2", "q3", "q4"), "abb", "ABB", ""),
    (("w", "p", "r"), "fanuc_wpr", "FANUC", ""),
    (
        ("a", "b", "c"),
        "kuka_abc",
        "KUKA",
        "poses.convention: A, B, C are taken as KUKA's; Kawasaki's O, A, T and others differ",
    ),
    (("rx", "ry", "rz"), "", "", ""),  # UR's, Yaskawa's, Staubli's, ABB's: by the numbers
    (
        ("roll", "pitch", "yaw"),
        "euler_xyz_extrinsic",
        "",
        "poses.convention: roll, pitch, yaw are taken about the fixed x, y, z",
    ),
)
AXES = re.compile(r"(?:j|q|a|axis|joint|jnt|achse|theta|th|rax|position|pos|angle)(\d\d?)(?:pos|position|angle|act)?")
NAMED_AXES = (  # in the robot's order
    ("shoulderpan", "shoulderlift", "elbow", "wrist1", "wrist2", "wrist3"),  # Universal Robots
    ("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3"),
    ("s", "l", "u", "r", "b", "t"),  # Yaskawa
)
FEWEST_AXES, MOST_AXES = 5, 9  # numbered columns that are a robot's joints: q1 to q4 may be a quaternion
POSTURES = ("posture", "position", "pos", "pose", "point", "nr", "no", "number", "index", "id")  # names of a count
TURN_RAD, TURN_DEG = 2 * np.pi + 1e-3, 720.0  # beyond which numbers are no angles; a wrist may turn twice
FEWEST_RANGES = 48  # columns from which a row without names is a profile
UR_REACH_M = 2.5  # of the flange, a pedestal or a table's frame included
COUNTER = "counter"
OF_A_PROFILE = ("x", "z", "frame", "time", "travel", "intensity", "valid", "pass")
WAY_BY_Y = "profiles.columns: a profile's x and z with its way y, not the places of a robot or a cloud"


class Named(NamedTuple):
    """A column as a mapping names it, and the unit in its name."""

    column: str | int
    unit: str


class Columns(NamedTuple):
    """Columns by role; what they are for ('profiles', 'poses', 'joints', 'rows' of ranges, '' unknown)."""

    kind: str
    roles: dict[str, Named]
    convention: str = ""
    robot: str = ""
    orientation: tuple[str, ...] = ()  # roles in the convention's order
    doubts: tuple[str, ...] = ()


def columns_of(form: Form) -> Columns:
    """What the columns are."""
    return _by_name(form) if form.header else _by_numbers(form)


def role_of(name: str) -> tuple[str, str]:
    """(role or '', unit or '') of a column's name: 'X [mm]', 'pose.position.x', 'time_s'."""
    text, unit = _bare(name)
    tokens = [token for token in re.split(r"[\s._/:-]+", text) if token]
    if not tokens:
        return "", unit
    about = " ".join(tokens[:-1])
    if re.search(r"orient|quat|rot", about) and tokens[-1] in ("w", "x", "y", "z"):
        return f"q{tokens[-1]}", unit
    return ALIKE.get("".join(tokens), ALIKE.get(tokens[-1], "")), unit


def _bare(name: str) -> tuple[str, str]:
    """A column's name in small letters without its unit, and the unit or ''."""
    text, unit = name.strip().lower(), ""
    bracket = re.search(r"[\[(]([^][()]*)[\])]", text)
    if bracket and not bracket[1].strip().isdigit():
        unit, text = UNITS.get(bracket[1].strip(), ""), text.replace(bracket[0], " ").strip()
    last = re.search(r"[\s._/:-]([^\s._/:-]+)$", text)
    if not unit and last and last[1] in UNITS and last[1] != "in":
        unit, text = UNITS[last[1]], text[: last.start()]
    return text, unit


def _by_name(form: Form) -> Columns:
    found: dict[str, Named] = {}
    for name, below in zip(form.header, form.units or [""] * len(form.header), strict=True):
        role, unit = role_of(name)
        if role and role not in found and form.header.count(name) == 1:
            found[role] = Named(name, unit or below)
    for names, convention, robot, doubt in ORIENTATIONS:
        if {"x", "y", "z", *names} <= set(found):
            roles = {role: found[role] for role in ("x", "y", "z", *names, "time", "pass") if role in found}
            values = [form.rows[:, form.header.index(str(found[name].column))] for name in names]
            if not convention:
                return _angles(
                    Columns("poses", roles, orientation=names), np.stack(values, axis=1), found[names[0]].unit
                )
            return Columns("poses", roles, convention, robot, names, (doubt,) if doubt else ())
    if not {"x", "z", "frame"} <= set(found) and (joints := _joints_named(form)):
        return Columns("joints", joints | {role: found[role] for role in ("time",) if role in found})
    if {"x", "y", "z"} <= set(found) and "frame" not in found and not steady(column_of(form, found["y"])):
        return Columns("", {"a cloud: see cloud.read and `workbench look`": found["x"]})
    if {"x", "z"} <= set(found):
        return _profile(form, found)
    numbered = all(re.fullmatch(r"[\d.]*", name) for name in form.header)  # columns that are counted, not named
    return Columns("rows", {}) if numbered and form.rows.shape[1] >= FEWEST_RANGES else Columns("", found)


def _profile(form: Form, found: dict[str, Named]) -> Columns:
    """Columns of points: what else is named counts if it behaves so."""
    roles = {role: found[role] for role in OF_A_PROFILE if role in found}
    doubts: tuple[str, ...] = ()
    if "y" in found:
        roles.setdefault("travel", found["y"])
    behaves = {"valid": _labels, "pass": _whole} | dict.fromkeys(("frame", "time", "travel"), steady)
    roles = {role: one for role, one in roles.items() if role not in behaves or behaves[role](column_of(form, one))}
    if "time" in roles and "frame" not in roles and (count := _changing_with(form, roles)):
        roles["frame"], doubts = count, (f"profiles.columns.frame: {count.column!r} changes with the time",)
    if roles.get("travel", found["x"]) is found.get("y"):
        doubts = (*doubts, WAY_BY_Y)
    return Columns("profiles", roles, doubts=doubts)


def _changing_with(form: Form, roles: dict[str, Named]) -> Named | None:
    """A column of whole numbers that rises where the frames' time changes, and only there."""
    changes = np.diff(column_of(form, roles["time"])) != 0
    used = {one.column for one in roles.values()}
    for name in form.header:
        values = form.rows[:, form.header.index(name)]
        if name and name not in used and _whole(values) and ((np.diff(values) > 0) == changes).all():
            return Named(name, "")
    return None


def _joints_named(form: Form) -> dict[str, Named]:
    """A robot's joints by the names of their columns, and the number of the posture; none where there are none."""
    sets: dict[str, dict[int, Named]] = {}
    words: dict[str, Named] = {}
    counts: dict[str, Named] = {}
    for name, below in zip(form.header, form.units or [""] * len(form.header), strict=True):
        text, unit = _bare(name)
        tokens = [token for token in re.split(r"[\s._/:\[\]()-]+", text) if token and token != "joint"] or [text]
        tail = "".join(tokens[-2:]) if tokens[-1].isdigit() else tokens[-1]
        about = " ".join(tokens[: -2 if tokens[-1].isdigit() else -1])
        if form.header.count(name) > 1:
            continue
        words["".join(tokens)] = one = Named(name, unit or below)
        if found := AXES.fullmatch(tail) or re.fullmatch(r"(\d\d?)", tail if "joint" in text else ""):
            sets.setdefault(f"{about} {tail.rstrip('0123456789')}", {})[int(found[1])] = one
        elif text in POSTURES and _whole(column_of(form, one)):
            counts["number"] = one
    for numbered in sets.values():
        first, count = min(numbered), len(numbered)
        in_order = first in (0, 1) and sorted(numbered) == list(range(first, first + count))
        if in_order and FEWEST_AXES <= count <= MOST_AXES:
            return {f"joint {k}": numbered[first + k] for k in range(count)} | counts
    for axes in NAMED_AXES:
        if set(axes) <= set(words):
            return {f"joint {k}": words[axis] for k, axis in enumerate(axes)} | counts
    return {}


def _whole(values: Float) -> bool:
    return bool(np.isfinite(values).all() and (values == np.round(values)).all())


def column_of(form: Form, named: Named) -> Float:
    """The numbers (r,) of a column."""
    return np.asarray(form.rows[:, named.column if isinstance(named.column, int) else form.header.index(named.column)])


USUAL_REACH_MM = (200.0, 5000.0)  # of a flange from its base


def _by_numbers(form: Form) -> Columns:
    """Without names: a few columns are points or poses, many are ranges."""
    rows, count = form.rows, form.rows.shape[1]
    if count >= FEWEST_RANGES:
        return Columns("rows", {})
    first = leading(rows)
    places = [k for k in range(len(first), count) if not _labels(rows[:, k])]
    doubt = "the columns have no names: their meaning was inferred from the numbers"
    roles = {role: Named(k, "") for k, role in enumerate(first) if role != COUNTER}
    if len(places) in (6, 7) and (found := _posed(rows, places, first, roles, doubt)) is not None:
        return found
    if joints := _behind_targets(rows, places):
        return joints._replace(doubts=(doubt, *joints.doubts))
    if len(places) == 3 and steady(rows[:, places[1]]):
        roles["travel"] = Named(places.pop(1), "")
    if len(places) == 2:
        roles |= {"x": Named(places[0], ""), "z": Named(places[1], "")}
        if _lateral(rows[:, places[1]]) and not _lateral(rows[:, places[0]]):
            roles |= {"x": Named(places[1], ""), "z": Named(places[0], "")}
        return Columns("profiles", roles, doubts=() if count == 2 else (doubt,))
    return Columns("", roles)


def _posed(rows: Float, places: list[int], first: list[str], roles: dict[str, Named], doubt: str) -> Columns | None:
    """Six or seven columns behind a count and a time: poses, or joints; None where a place rises from row to row."""
    turns_first = len(places) == 6 and _turns_first(rows[:, places])
    if turns_first:
        places = places[3:] + places[:3]
    if not _reaches(rows[:, places]):
        return Columns("", {})
    if any(steady(rows[:, k]) for k in places[:3]):
        return None
    roles |= {role: Named(places[k], "") for k, role in enumerate("xyz")}
    values = rows[:, places[3:]]
    turning = np.nanmax(np.abs(rows[:, places])) <= TURN_RAD and not _metres(rows[:, places[:3]])
    if len(places) == 6 and turning:
        return _joints_placed(places, first, doubt)
    if len(places) == 7:
        found = _quaternion(roles, places[3:], values, doubt)
        return _joints_placed(places, first, doubt) if turning and not found.kind else found
    names = ("rx", "ry", "rz")
    roles |= {role: Named(at, "") for role, at in zip(names, places[3:], strict=True)}
    if turns_first:
        why = "poses.convention: angles before lengths are taken about the fixed x, y, z; a logarithm of poses is not"
        return Columns("poses", roles, "euler_xyz_extrinsic", "", names, (doubt, why))
    if np.nanmax(np.abs(rows[:, places])) <= 2 * np.pi + 1e-3:
        doubt += "; six of them within 2 pi could be joint angles too"
    return _angles(Columns("poses", roles, orientation=names, doubts=(doubt,)), values, "")


def _joints_placed(places: list[int], first: list[str], doubt: str) -> Columns:
    """Joints in columns without names, behind a count of the postures and their time."""
    known = {"number": COUNTER, "time": "time"}
    roles = {role: Named(first.index(name), "") for role, name in known.items() if name in first}
    return Columns("joints", {f"joint {k}": Named(at, "") for k, at in enumerate(places)} | roles, doubts=(doubt,))


def _behind_targets(rows: Float, places: list[int]) -> Columns | None:
    """Six joints in deg in the last columns, behind places of a tracker's targets; what never changes is neither."""
    joints, others = places[-6:], [k for k in places[:-6] if np.nanmax(rows[:, k]) > np.nanmin(rows[:, k])]
    far = [np.nanmax(np.abs(rows[:, others[k : k + 3]])) > TURN_DEG / 2 for k in range(0, len(others), 3)]
    if not others or len(others) % 3 or not all(far) or np.nanmax(np.abs(rows[:, joints])) > TURN_DEG / 2:
        return None
    roles = {f"joint {k}": Named(at, "") for k, at in enumerate(joints)}
    roles |= {f"target {k // 3 + 1} {'xyz'[k % 3]}": Named(at, "") for k, at in enumerate(others)}
    doubt = f"columns {others[0]} to {others[-1]} are taken as the places of {len(others) // 3} targets of a tracker"
    return Columns("joints", roles, doubts=(doubt,))


def _reaches(places: Float) -> bool:
    """Whether columns without names could be a robot's: joints, or places in mm or m that a flange comes to."""
    if np.nanmax(np.abs(places)) <= TURN_RAD:
        return True
    far = float(np.nanmax(np.linalg.norm(places[:, :3], axis=1)))
    return any(USUAL_REACH_MM[0] <= far * mm <= USUAL_REACH_MM[1] for mm in (1.0, 1000.0))


def _labels(values: Float) -> bool:
    """Whether a column only says which of two kinds each row is of: 0 or 1."""
    return bool(np.isin(values, (0.0, 1.0)).all() and np.ptp(values) == 1.0)


def _turns_first(rows: Float) -> bool:
    """Whether three angles stand before three lengths, as ABB's external guidance logs them."""
    turns, lengths = np.nanmax(np.abs(rows[:, :3])), np.nanmax(np.abs(rows[:, 3:]))
    return bool(turns <= TURN_RAD and lengths > TURN_DEG / 2)


def _metres(position: Float) -> bool:
    """Whether numbers could be a flange's positions in m: arms that log rotation vectors (UR) reach up to 1.75 m."""
    return bool(0.2 <= np.nanmax(np.linalg.norm(position, axis=1)) <= UR_REACH_M)


def leading(rows: Float) -> list[str]:
    """Roles of the first columns: a counter, a frame's number, a time.

    What rises from row to row, and stands there without a return too, is the sensor's own count and no place.
    """
    first: list[str] = []
    for k in range(min(2, rows.shape[1] - 2)):
        values = rows[:, k]
        whole = _whole(values)
        counted = whole and len(values) > 1 and (np.diff(values) == 1).all() and values[0] in (0, 1)
        if counted or (k == 0 and _rising(values) and np.isnan(rows[:, 1:]).all(axis=1).any()):
            first.append(COUNTER)
        elif whole and _held(values) and "frame" not in first:
            first.append("frame")
        elif "time" not in first and ((_rising(values) and rows.shape[1] > 6) or ("frame" in first and _held(values))):
            first.append("time")
        else:
            break
    return first


def _held(values: Float) -> bool:
    return steady(values) and bool((np.diff(values) >= 0).all())


def _rising(values: Float) -> bool:
    return bool(np.isfinite(values).all() and len(values) > 1 and (np.diff(values) > 0).all())


def _lateral(values: Float) -> bool:
    """Whether a column steps evenly, as x does."""
    step = np.diff(values[np.isfinite(values)])
    return len(step) > 2 and float(np.mean(np.abs(step - np.median(step)) < 1e-6 + 0.01 * abs(np.median(step)))) > 0.8


def _quaternion(roles: dict[str, Named], places: list[int], values: Float, doubt: str) -> Columns:
    norm = np.linalg.norm(values, axis=1)
    if not (np.abs(norm - 1.0) < 1e-2).all():
        return Columns("", roles)
    names = ("qw", "qx", "qy", "qz")
    roles |= {role: Named(at, "") for role, at in zip(names, places, strict=True)}
    why = "poses.convention: four unnamed numbers are taken as w, x, y, z; quaternion_xyzw is as common"
    return Columns("poses", roles, "quaternion_wxyz", "", names, (doubt, why))


def _angles(columns: Columns, values: Float, unit: str) -> Columns:
    """Three angles called rx, ry, rz, or nothing: rotation vectors where radians, else the commonest Euler angles."""
    largest = float(np.nanmax(np.abs(values)))
    if unit == "rad" or (not unit and largest <= 2 * np.pi + 1e-3):
        why = "poses.convention: rx, ry, rz within 2 pi are taken as UR's rotation vectors in rad"
        return columns._replace(convention="ur", robot="Universal Robots", doubts=(*columns.doubts, why))
    why = (
        "poses.convention: rx, ry, rz in deg are taken as Rz Ry Rx about fixed axes (Yaskawa, ABB's X Y Z, FANUC); "
        "Staubli's is staubli_rxyz"
    )
    return columns._replace(convention="yaskawa_rxyz", doubts=(*columns.doubts, why))
