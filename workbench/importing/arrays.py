"""Arrays by name: numpy's .npz, never pickles. Other programs' arrays become such files (docs/importing.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.errors import InputError, nearest
from workbench.geometry.poses import is_rigid, quaternion_from_rotation
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import LENGTH_MM, TIME_S, ArraysPart, named_twice
from workbench.importing.neutral import Imported, PoseStream, ProfileFrames, bounded, without
from workbench.scan.checks import normalised
from workbench.units import AnyArray, Float

NAME = "arrays (.npz)"
ENDING = ".npz"
ROLES = (
    "x",
    "z",
    "intensity",
    "time",
    "travel",
    "position",
    "quaternion_wxyz",
    "base_from_flange",
    "pose_time",
)
POSES = {"position", "base_from_flange"}
MOST_BYTES = 2**32
TOLERANCE = 1e-4  # of a pose's rotation: what float32 keeps


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether it ends and begins as such a file does."""
    return path.suffix.lower() == ENDING and path.is_file() and head.startswith(b"PK")


def read(path: Path, mapping: Mapping) -> Imported:
    """Profiles or poses, or both.

    Raises:
        InputError: not such a file, arrays of other shapes, none that is understood.
    """
    part = mapping.arrays
    if part is None or not (part.files is None or part.claims(path)):
        part = ArraysPart()
    found, values = by_role(path, part)
    unit, second, where = LENGTH_MM[part.length_unit], TIME_S[part.time_unit], str(path)
    profiles = _profiles(values, part.missing, unit, second, where) if "z" in values else None
    if profiles is not None and profiles.intensity is None and "intensity" in found:
        found["intensity"] += " (left out: not whole numbers from 0 to 65535 in the shape of z)"
    used = ", ".join(f"{role} = {name}" for role, name in found.items())
    notes = (f"{NAME}: {used}; lengths in {part.length_unit}",)
    poses = _poses(values, unit, second, where) if POSES & set(values) else None
    return Imported(profiles=profiles, poses=poses, notes=notes)


def by_role(path: Path, part: ArraysPart) -> tuple[dict[str, str], dict[str, AnyArray]]:
    """The name of each role's array, the mapping's or the role's own, and the arrays by role.

    Raises:
        InputError: not such a file, a name that it does not hold, neither profiles nor poses.
    """
    named = _numbers(path)
    if "joints" in named and not POSES & set(named):
        raise InputError(f"{path}: 'joints'", "joints come as a table: part joints of the mapping (docs/importing.md)")
    asked = {role: name for role in ROLES if (name := getattr(part, role)) is not None}
    wrong = next((name for name in asked.values() if name not in named), None)
    if wrong is not None:
        raise InputError(f"{path}: {wrong!r}", f"no such array{nearest(wrong, named)}")
    found = {role: asked.get(role, role) for role in ROLES if role in asked or role in named}
    if twice := named_twice(found):
        raise InputError(str(path), twice)
    if not {"z", *POSES} & set(found):
        shown = ", ".join(f"{name} {value.shape}" for name, value in list(named.items())[:8]) or "no array of numbers"
        what = f"expected arrays x and z, or poses; found {shown} (name them: 'arrays' in the mapping)"
        raise InputError(str(path), what)
    return found, {role: np.squeeze(named[name]) for role, name in found.items()}


def _numbers(path: Path) -> dict[str, AnyArray]:
    """The arrays of numbers by name."""
    try:
        loaded = np.load(path, allow_pickle=False)
        sizes = sum(member.file_size for member in loaded.zip.infolist())
        if sizes > MOST_BYTES:
            expected = f"expected at most {MOST_BYTES / 1e9:.1f} GB of arrays, found {sizes / 1e9:.1f}"
            raise InputError(str(path), expected)
        return {name: loaded[name] for name in loaded.files if loaded[name].dtype.kind in "iuf"}
    except InputError:
        raise
    except Exception as error:  # whatever numpy makes of a damaged file
        what = f"expected whole arrays of numbers: {str(error)[:120] or type(error).__name__}"
        raise InputError(str(path), what) from None


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
    if light is not None and (
        np.atleast_2d(light).shape != z.shape or not np.array_equal(light, np.clip(np.rint(light), 0, 65535))
    ):
        light = None

    def each(role: str, scale: float) -> Float | None:
        if (one := values.get(role)) is None:
            return None
        if np.atleast_1d(one).shape != z.shape[:1]:
            raise InputError(where, f"expected {role} of {len(z)} frames, found shape {np.atleast_1d(one).shape}")
        return np.atleast_1d(one).astype(np.float64) * scale

    return ProfileFrames(
        where,
        np.broadcast_to(bounded(x * unit), z.shape),
        bounded(without(z, missing) * unit),
        time_s=each("time", second),
        travel_mm=each("travel", unit),
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
