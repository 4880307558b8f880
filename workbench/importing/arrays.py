"""Arrays: numpy's .npy and .npz (never pickles), MATLAB's .mat (by scipy, newer ones as HDF5)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import InputError, nearest
from workbench.geometry.poses import is_rigid, quaternion_from_rotation
from workbench.importing.joints import moved
from workbench.importing.mapping import Mapping, claims
from workbench.importing.mapping_parts import LENGTH_MM, TIME_S, ArraysPart
from workbench.importing.neutral import Imported, JointStream, PoseStream, ProfileFrames, bounded, without
from workbench.importing.roles import TURN_DEG
from workbench.scan.checks import normalised
from workbench.scan.hdf5 import CPU_SECONDS, survives
from workbench.units import AnyArray, Float

NAME = "arrays (.npy, .npz, .mat)"
MAGIC = b"\x93NUMPY"
ENDINGS = (".npy", ".npz", ".mat")
ALIASES: dict[str, tuple[str, ...]] = {
    "x": ("x", "x_mm", "lateral"),
    "z": ("z", "z_mm", "range", "height", "heights", "profiles"),
    "intensity": ("intensity",),
    "time": ("time", "time_s", "t", "timestamps", "profile_time"),
    "travel": ("travel", "travel_mm", "y", "encoder"),
    "position": ("position", "position_mm", "positions", "xyz"),
    "quaternion_wxyz": ("quaternion_wxyz",),
    "base_from_flange": ("base_from_flange", "poses", "pose"),
    "pose_time": ("pose_time", "pose_time_s", "robot_time"),
    "joints": ("joints", "joint_positions", "joint_angles", "q", "position", "positions"),
}
ORDER = (
    "z",
    "x",
    "intensity",
    "travel",
    "base_from_flange",
    "position",
    "quaternion_wxyz",
    "joints",
    "time",
    "pose_time",
)
POSES = {"position", "base_from_flange"}
AXES = range(5, 8)  # joints of a robot, in a row
MOST_BYTES = 2**32
BYTES_A_SECOND = 10_000_000  # a compressed file is read several times as fast
DEEPEST = 4  # structures within structures
ONE_WAY, LEAST_COLUMNS = 0.98, 8  # of lateral coordinates: share of their steps in one sense; fewer are no profile
TOLERANCE = 1e-4  # of a pose's rotation: what float32 keeps


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether it ends and begins as such a file does, and is no height map."""
    begins = {".npy": MAGIC, ".npz": b"PK", ".mat": b""}
    if path.suffix.lower() not in ENDINGS or not path.is_file() or not head.startswith(begins[path.suffix.lower()]):
        return False
    return claims(mapping.arrays, path) or not is_height_map(path)


def read(path: Path, mapping: Mapping) -> Imported:
    """Profiles, poses or joints, or both.

    Raises:
        InputError: not such a file, arrays of other shapes, none that is understood.
    """
    part = (
        mapping.arrays
        if mapping.arrays is not None and (mapping.arrays.files is None or claims(mapping.arrays, path))
        else None
    )
    named = _numbers(path)
    part = part or ArraysPart()
    found = _roles(named, {role: name for role in ALIASES if (name := getattr(part, role)) is not None}, str(path))
    values = {role: np.squeeze(named[name]) for role, name in found.items()}
    if POSES & set(values):
        values.pop("joints", None)  # the poses say more
    if not {"z", "joints", *POSES} & set(values):
        shown = ", ".join(f"{name} {value.shape}" for name, value in list(named.items())[:8]) or "no array of numbers"
        raise InputError(
            str(path),
            f"expected arrays x and z, or poses or joints; found {shown} (name them: 'arrays' in the mapping; "
            "workbench import --draft tells what it can)",
        )
    unit, second = LENGTH_MM[part.length_unit], TIME_S[part.time_unit]
    used = ", ".join(f"{role} = {name}" for role, name in found.items())
    alike = [name for role in ALIASES if role not in found for name in _alike(named, role)]
    odd = ", ".join(f"{name} {named[name].shape}" for name in dict.fromkeys(alike) if name not in found.values())
    notes = (f"{NAME}: {used}; lengths in {part.length_unit}", *([f"left out, by shape: {odd}"] if odd else []))
    profiles = _profiles(values, part.missing, unit, second, str(path)) if "z" in values else None
    if "joints" in values:
        robot = _joints(values, part, mapping.base_dir, str(path))
        return replace(robot, profiles=profiles, notes=(*notes, *robot.notes))
    poses = _poses(values, unit, second, str(path)) if POSES & set(values) else None
    return Imported(profiles=profiles, poses=poses, notes=notes)


def is_height_map(path: Path) -> bool:
    """Whether it is a .npy file of one array of rows and columns that is nothing else by its shape."""
    if path.suffix.lower() != ".npy":
        return False
    try:
        shape = np.load(path, mmap_mode="r", allow_pickle=False).shape
    except (ValueError, OSError, EOFError):
        return False  # pickled or damaged: the reader says so
    return len(shape) == 2 and min(shape) >= LEAST_COLUMNS


def drafted(path: Path) -> tuple[dict[str, str], dict[str, AnyArray], list[str]]:
    """Names of the arrays of profiles and poses, as `arrays` of a mapping has them, their values, and what is doubtful.

    A name counts where the shape fits. What no name tells is told by shape and values: x and z of one shape, x rising
    along the columns; times that rise; rows of four numbers and length one; rigid motions; rows of three.

    Raises:
        InputError: not such a file.
    """
    named = _numbers(path)
    found = _roles(named, {}, str(path))
    kinds = {name: _kind(value) for name, value in named.items() if name not in found.values()}
    grids = [name for name, kind in kinds.items() if kind == "grid"]
    if "z" not in found and len(grids) == 1:
        found = _roles(named, {"z": grids[0]}, str(path))  # what fits beside it
        kinds = {name: _kind(value) for name, value in named.items() if name not in found.values()} | {grids[0]: "grid"}
    for role, name in _told_by_values(named, kinds, found):
        found[role] = name
    told = [name for name in kinds if name in found.values()]
    doubts = [
        f"arrays.{role}: {name!r}, by its shape {np.squeeze(named[name]).shape} and its numbers"
        for role, name in found.items()
        if name in told
    ]
    if found.get("quaternion_wxyz") in told:
        doubts.append("arrays.quaternion_wxyz: w first is taken; nothing in the numbers tells it from w last")
    left = [f"{name} {np.squeeze(named[name]).shape}" for name in kinds if name not in told and named[name].size > 1]
    if left and found:
        doubts.append(f"arrays: not understood and left out: {', '.join(left[:8])}")
    return found, {role: np.squeeze(named[name]) for role, name in found.items()}, doubts


def _told_by_values(named: dict[str, Any], kinds: dict[str, str], found: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Roles that no name has told, and the array that each is."""
    grids = [name for name, kind in kinds.items() if kind in ("x", "grid")]
    z = found.get("z")
    if z is not None:
        shape = np.squeeze(named[z]).shape
        across = [name for name in grids if kinds[name] == "x" and np.squeeze(named[name]).shape == shape]
        rising = [name for name, kind in kinds.items() if kind == "rising"]
        across = across or [name for name in rising if shape[1:] == np.squeeze(named[name]).shape != shape[:1]]
        if "x" not in found and len(across) == 1:
            yield "x", across[0]
        times = [name for name in rising if np.squeeze(named[name]).shape == shape[:1] and name not in across]
        if not {"time", "travel"} & set(found) and len(times) == 1:
            yield "time", times[0]
    for role, kind in (("quaternion_wxyz", "quaternion"), ("base_from_flange", "motion"), ("joints", "joints")):
        of_kind = [name for name, other in kinds.items() if other == kind]
        if role not in found and len(of_kind) == 1 and (role != "joints" or not POSES & set(found)):
            yield role, of_kind[0]
            count = len(named[of_kind[0]])
            places = [name for name, other in kinds.items() if other == "place" and len(named[name]) == count]
            if kind == "quaternion" and "position" not in found and len(places) == 1:
                yield "position", places[0]
            times = [n for n, other in kinds.items() if other == "rising" and np.squeeze(named[n]).shape == (count,)]
            if "pose_time" not in found and len(times) == 1 and (z is None or count != len(named[z])):
                yield "pose_time", times[0]


def _kind(value: AnyArray) -> str:
    """What an array may be by itself: x, grid, rising, quaternion, motion, place, joints, or nothing known."""
    value = np.squeeze(value).astype(np.float64)
    if value.ndim == 1 and len(value) > 1:
        return "rising" if (np.diff(value) > 0).all() else ""
    if value.ndim == 3 and value.shape[1:] == (4, 4):
        return "motion" if all(is_rigid(one, TOLERANCE) for one in value) else ""
    if value.ndim != 2 or len(value) < 2:
        return ""
    if value.shape[1] == 4 and np.allclose(np.linalg.norm(value, axis=1), 1.0, atol=1e-3):
        return "quaternion"
    if value.shape[1] == 3:
        return "place"
    if value.shape[1] in AXES:
        return "joints" if np.isfinite(value).all() and np.abs(value).max() <= TURN_DEG and np.ptp(value) > 0 else ""
    steps = np.diff(value, axis=1)
    steps = steps[np.isfinite(steps)]
    one_way = max((steps > 0).mean(), (steps < 0).mean()) if steps.size else 0.0
    return ("x" if one_way > ONE_WAY else "grid") if value.shape[1] >= LEAST_COLUMNS else ""


def _numbers(path: Path) -> dict[str, Any]:
    """The arrays of numbers by name; one without name is what its shape tells. MATLAB's 4 x 4 x K is turned."""
    named = {
        name: np.moveaxis(value, 2, 0) if value.ndim == 3 and value.shape[:2] == (4, 4) != value.shape[1:] else value
        for name, value in _load(path).items()
        if isinstance(value, np.ndarray) and value.dtype.kind in "iuf"
    }
    return _alone(named[""], str(path)) if list(named) == [""] else named


def _load(path: Path) -> dict[str, Any]:
    try:
        if path.suffix.lower() == ".mat":
            return _matlab(path)
        loaded = np.load(path, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return {"": loaded}
        sizes = sum(member.file_size for member in loaded.zip.infolist())
        if sizes > MOST_BYTES:
            raise InputError(
                str(path), f"expected at most {MOST_BYTES / 1e9:.1f} GB of arrays, found {sizes / 1e9:.1f}"
            )
        return {name: loaded[name] for name in loaded.files}
    except InputError:
        raise
    except Exception as error:  # whatever a library makes of a damaged file
        raise InputError(
            str(path), f"expected whole arrays of numbers: {str(error)[:120] or type(error).__name__}"
        ) from None


def _matlab(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    with open(path, "rb") as file:
        newer = b"MATLAB 7.3" in file.read(128)
    if not newer:
        seconds = CPU_SECONDS + path.stat().st_size // BYTES_A_SECOND
        if not survives(lambda: loadmat(path), seconds):  # its compiled reader crashes on some damaged files
            raise InputError(str(path), "expected a whole MATLAB file: its reader crashed")
        return {k: v for name, value in loadmat(path).items() if name[:2] != "__" for k, v in _fields(name, value)}
    import h5py

    with h5py.File(path, "r") as file:
        found: dict[str, Any] = {}
        file.visititems(
            lambda name, one: (
                found.update({name.replace("/", "."): np.asarray(one).T})
                if isinstance(one, h5py.Dataset) and one.nbytes < MOST_BYTES and not name.startswith("#")
                else None
            )
        )
        return found


def _fields(name: str, value: Any, depth: int = 0) -> Iterator[tuple[str, Any]]:
    """An array by its name, those in a structure as `structure.field`."""
    if not isinstance(value, np.ndarray) or value.dtype.names is None:
        yield name, value
    elif value.size == 1 and depth < DEEPEST:
        for field in value.dtype.names:
            yield from _fields(f"{name}.{field}", value.flat[0][field], depth + 1)


def _alone(value: AnyArray, where: str) -> dict[str, AnyArray]:
    """What a single array is, by its shape."""
    if value.ndim == 3 and value.shape[1:] == (4, 4):
        return {"base_from_flange": value}
    if value.ndim == 3 and 2 in (value.shape[0], value.shape[2]):
        x, z = (value[0], value[1]) if value.shape[0] == 2 else (value[..., 0], value[..., 1])
        return {"x": x, "z": z}
    if value.ndim == 2 and value.shape[1] == 2:
        return {"x": value[:, 0], "z": value[:, 1]}
    if value.ndim == 2 and value.shape[1] in AXES:
        return {"joints": value}
    what = f"(N, M, 2) or (n, 2) with x and z, (K, 4, 4) poses, (K, 6) joints, or {LEAST_COLUMNS} rows and columns of"
    raise InputError(where, f"expected {what} heights; found shape {value.shape}")


def _roles(named: dict[str, Any], asked: dict[str, str], where: str) -> dict[str, str]:
    """The array of each role: what is asked for, else the first of a known name whose shape fits beside the others."""
    for name in asked.values():
        if name not in named:
            raise InputError(f"{where}: {name!r}", f"no such array{nearest(name, named)}")
    found = dict(asked)
    for role in ORDER:
        shapes = {other: np.squeeze(named[name]).shape for other, name in found.items()}
        free = [name for name in _alike(named, role) if name not in found.values()]
        fitting = [name for name in free if _fits(role, np.squeeze(named[name]).shape, shapes)]
        if role not in found and fitting:
            found[role] = fitting[0]
    return {role: found[role] for role in ALIASES if role in found}


def _alike(named: dict[str, Any], role: str) -> list[str]:
    """Arrays with one of a role's names, the same letters first; in structures by the last part, if it stands once."""
    last = [name.lower().rpartition(".")[2] for name in named]
    short = {name for name, part in zip(named, last, strict=True) if last.count(part) == 1}
    alike = [
        name
        for alias in ALIASES[role]
        for name in sorted(named, key=lambda name: (name != alias, name.lower() != alias))
        if name.lower() == alias or (name in short and name.lower().rpartition(".")[2] == alias)
    ]
    return list(dict.fromkeys(alike))


def _fits(role: str, shape: tuple[int, ...], told: dict[str, tuple[int, ...]]) -> bool:
    """Whether an array of this shape may have the role beside those whose shapes are told."""
    z, counts = told.get("z"), _pose_counts(told)
    if role in ("x", "intensity", "z"):
        return len(shape) in (1, 2) if z is None else shape == z or (role == "x" and len(z) == 2 and shape == z[1:])
    if role in ("time", "travel", "pose_time"):
        frames = None if z is None else z[:-1] or (1,)
        if role == "pose_time" or (role == "time" and frames is None):
            return len(shape) == 1 and (not counts or shape[0] in counts)
        return len(shape) == 1 if frames is None else (shape or (1,)) == frames
    if role == "joints":
        return len(shape) == 2 and shape[1] in AXES
    if role == "base_from_flange":
        return shape[-2:] == (4, 4) and len(shape) in (2, 3)
    return shape[-1:] == ((3,) if role == "position" else (4,)) and len(shape) <= 2


def _pose_counts(told: dict[str, tuple[int, ...]]) -> set[int]:
    """How many poses the arrays of poses hold."""
    own = {"position": 1, "base_from_flange": 2, "joints": 1}  # axes of a single pose
    return {shape[0] if len(shape) > own[role] else 1 for role, shape in told.items() if role in own}


def _profiles(
    values: dict[str, AnyArray], missing: list[float], unit: float, second: float, where: str
) -> ProfileFrames:
    z = np.atleast_2d(values["z"]).astype(np.float64)
    if "x" not in values:
        raise InputError(where, "expected an array x too")
    x = values["x"].astype(np.float64)
    if z.ndim != 2 or x.shape not in (z.shape, z.shape[1:]):
        raise InputError(where, f"expected x like z, found shapes {x.shape} and {z.shape}")
    light = values.get("intensity")
    if light is not None and (np.atleast_2d(light).shape != z.shape or light.dtype.kind not in "u"):
        light = None
    series = {role: None if (one := values.get(role)) is None else np.atleast_1d(one) for role in ("time", "travel")}
    for role, one in series.items():
        if one is not None and one.shape != z.shape[:1]:
            raise InputError(where, f"expected {role} of {len(z)} frames, found shape {one.shape}")
    time, travel = series["time"], series["travel"]
    return ProfileFrames(
        where,
        np.broadcast_to(bounded(x * unit), z.shape),
        bounded(without(z, missing) * unit),
        time_s=None if time is None else time.astype(np.float64) * second,
        travel_mm=None if travel is None else travel.astype(np.float64) * unit,
        intensity=None if light is None else np.atleast_2d(light).astype(np.uint16),
    )


def _poses(values: dict[str, AnyArray], unit: float, second: float, where: str) -> PoseStream:
    if "base_from_flange" in values:
        pose = np.asarray(values["base_from_flange"], np.float64).reshape(-1, 4, 4)
        wrong = [k for k, one in enumerate(pose) if not is_rigid(one, TOLERANCE)]
        if wrong:
            raise InputError(f"{where}: pose {wrong[0] + 1}", "expected a rigid motion: orthonormal, determinant +1")
        position: Float = pose[:, :3, 3]
        quaternion = quaternion_from_rotation(pose[:, :3, :3])
    else:
        position = np.atleast_2d(values["position"]).astype(np.float64)
        given = values.get("quaternion_wxyz")
        if given is None or position.shape[1] != 3 or np.atleast_2d(given).shape != (len(position), 4):
            raise InputError(
                where,
                "expected position (K, 3) and quaternion_wxyz (K, 4), w first: name one that is called "
                "otherwise as arrays.quaternion_wxyz in the mapping",
            )
        quaternion = normalised(np.atleast_2d(given).astype(np.float64), f"{where}: quaternion_wxyz")
    if not np.isfinite(position).all():
        raise InputError(where, "expected finite positions")
    return PoseStream(where, position * unit, quaternion, _pose_time(values, len(position), second, where))


def _pose_time(values: dict[str, AnyArray], count: int, second: float, where: str) -> Float | None:
    """Times of the poses; where there are no profiles any times are theirs."""
    time = values.get("pose_time")
    if time is None and "z" not in values:
        time = values.get("time")
    if time is not None and time.shape != (count,):
        raise InputError(where, f"expected a time a pose, found shape {time.shape}")
    return None if time is None else time.astype(np.float64) * second


def _joints(values: dict[str, AnyArray], part: ArraysPart, folder: Path, where: str) -> Imported:
    """Postures; with the robot's URDF also the flange's poses."""
    joints = values["joints"].astype(np.float64)
    if part.angle_unit is None:
        what = "expected 'arrays' in the mapping with angle_unit and the robot (workbench import --draft writes one)"
        raise InputError(where, f"joints of shape {joints.shape}: {what}")
    if joints.ndim != 2 or not np.isfinite(joints).all():
        raise InputError(where, f"expected finite joints (K, n), found shape {joints.shape}")
    names = tuple(f"joint {k + 1}" for k in range(joints.shape[1]))
    time_s = _pose_time(values, len(joints), TIME_S[part.time_unit], where)
    stream = JointStream(where, joints, names, time_s, angle_unit=part.angle_unit)
    return moved(stream, part, folder, LENGTH_MM[part.length_unit], lambda row: f"{where}: row {row + 1}")
