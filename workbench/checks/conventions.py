"""Known mistakes in poses, hand-eye and profiles, and which of them would make poses and profiles agree."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
import scipy

from workbench.geometry.poses import inverse, pose_from, quaternion_from_rotation, rotation_from_quaternion
from workbench.units import Float, Float32

Quaternions = Callable[[Float], Float]
Positions = Callable[[Float], Float]
HandEyes = Callable[[Float], Float]


@dataclass(frozen=True, slots=True)
class Convention:
    """One way to read poses and hand-eye otherwise; each function turns what was read into what would then be right."""

    name: str  # what would be wrong with the recording, to follow 'suspicion: '
    quaternion: Quaternions | None = None  # (k, 4) w x y z
    position: Positions | None = None  # (k, 3) mm
    hand_eye: HandEyes | None = None  # (4, 4)
    inverted: bool = False  # the poses map the base to the flange
    frames_reversed: bool = False  # the first frame of a pass was seen last

    def read(
        self, quaternion_wxyz: Float, position_mm: Float, flange_from_profiler: Float
    ) -> tuple[Float, Float, Float]:
        """Quaternions, positions and hand-eye as they would be, if this were what is wrong."""
        if self.inverted:
            back = inverse(pose_from(rotation_from_quaternion(quaternion_wxyz), position_mm))
            return _conjugate(quaternion_wxyz), back[:, :3, 3], flange_from_profiler
        return (
            quaternion_wxyz if self.quaternion is None else self.quaternion(quaternion_wxyz),
            position_mm if self.position is None else self.position(position_mm),
            flange_from_profiler if self.hand_eye is None else self.hand_eye(flange_from_profiler),
        )


@dataclass(frozen=True, slots=True)
class ProfileReading:
    """One way to read the profiles' axes otherwise."""

    name: str  # what would be wrong with the recording
    swapped: bool
    signs: tuple[int, int]  # of x and z, as they would then be

    def read(self, x_mm: Float32, z_mm: Float32) -> tuple[Float32, Float32]:
        """x and z as they would be, if this were what is wrong."""
        x, z = (z_mm, x_mm) if self.swapped else (x_mm, z_mm)
        return x * np.float32(self.signs[0]), z * np.float32(self.signs[1])


def known_profile_readings() -> tuple[ProfileReading, ...]:
    """Axes of a profiler that are known to go wrong, the likeliest first."""
    x, z, both = ((-1, 1), (1, -1), (-1, -1))
    swapped = "the profiles' x and z are swapped"
    return (
        ProfileReading(swapped, True, (1, 1)),
        ProfileReading(f"{swapped}, and the sign of x is wrong", True, x),
        ProfileReading(f"{swapped}, and the sign of z is wrong", True, z),
        ProfileReading(f"{swapped}, and both signs are wrong", True, both),
        ProfileReading("the sign of x of the profiles is wrong", False, x),
        ProfileReading("the sign of z of the profiles is wrong", False, z),
        ProfileReading("the signs of x and z of the profiles are wrong", False, both),
    )


def mirrored_profiles() -> tuple[Convention, ...]:
    """Those of them that mirror one axis, as hand-eye poses: no pose of a body has them, but points go with them."""
    return tuple(
        Convention(one.name, hand_eye=_mirrored(one.signs))
        for one in known_profile_readings()
        if not one.swapped and sum(one.signs) == 0
    )


AS_READ = Convention("as it is read")
EULER = ("ZYX", "XYZ", "ZYZ", "zyx", "xyz")


def known_conventions() -> tuple[Convention, ...]:
    """What is known to go wrong, the likeliest first."""
    return tuple(_known())


def _known() -> Iterator[Convention]:
    yield Convention("quaternions are stored x y z w, not w x y z", quaternion=lambda q: q[:, [3, 0, 1, 2]])
    yield Convention("quaternions are conjugated: they turn from the base to the flange", quaternion=_conjugate)
    yield Convention(
        "quaternions are stored x y z w and conjugated", quaternion=lambda q: _conjugate(q[:, [3, 0, 1, 2]])
    )
    yield Convention(
        "quaternions are stored x y z w on writing and on reading", quaternion=lambda q: q[:, [1, 2, 3, 0]]
    )
    yield Convention("the hand-eye pose is inverted: it maps the flange to the profiler", hand_eye=inverse)
    yield Convention("the hand-eye rotation is transposed", hand_eye=_transposed)
    yield Convention("the hand-eye pose is missing from the poses: they are the profiler's own", hand_eye=_identity)
    for axis, name in enumerate("xyz", start=1):
        yield Convention(f"the sign of {name} of the quaternions is wrong", quaternion=_negated(axis))
    yield Convention("quaternions are stored w z y x, not w x y z", quaternion=lambda q: q[:, [0, 3, 2, 1]])
    yield Convention("quaternions are stored z y x w, not w x y z", quaternion=lambda q: q[:, [3, 2, 1, 0]])
    yield Convention("the frames are in reverse order", frames_reversed=True)
    for written, read in permutations(EULER, 2):
        yield Convention(
            f"Euler angles of order {_order(written)}, read as {_order(read)}",
            quaternion=_reordered(written, read),
        )
        yield Convention(
            f"hand-eye angles of order {_order(written)}, read as {_order(read)}",
            hand_eye=_reordered_pose(written, read),
        )
        if written[0] == written[2]:  # their middle angle goes to 180 deg, where the others' goes to 90
            yield Convention(
                f"Euler angles of order {_order(written)}, read as {_order(read)}",
                quaternion=_reordered(written, read, beyond=True),
            )
    for axes in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            if axes != (0, 1, 2) or signs != (1, 1, 1):
                yield Convention(f"the robot's axes are {_axes(axes, signs)}", position=_axis_map(axes, signs))
    yield Convention("the poses are inverted: they map the base to the flange", inverted=True)
    for axes in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), axes] = signs
            if np.linalg.det(turn) > 0 and axes != (0, 1, 2):
                yield Convention(f"the profiler's axes are {_axes(axes, signs)}", hand_eye=_rotated(turn))


def _conjugate(q: Float) -> Float:
    return np.asarray(q * (1.0, -1.0, -1.0, -1.0))


def _negated(axis: int) -> Quaternions:
    return lambda q: np.asarray(q * np.where(np.arange(4) == axis, -1.0, 1.0))


def _mirrored(signs: tuple[int, int]) -> HandEyes:
    """The hand-eye pose with which profiles lie where those of other signs of x and z would."""
    return lambda pose: pose @ np.diag([signs[0], 1.0, signs[1], 1.0])


def _transposed(pose: Float) -> Float:
    return pose_from(pose[:3, :3].T, pose[:3, 3])


def _identity(pose: Float) -> Float:
    return np.eye(4)


def _rotated(turn: Float) -> HandEyes:
    return lambda pose: pose_from(pose[:3, :3] @ turn, pose[:3, 3])


def _axis_map(axes: tuple[int, ...], signs: tuple[int, ...]) -> Positions:
    return lambda position: np.asarray(position[:, list(axes)] * signs)


def _reordered(written: str, read: str, beyond: bool = False) -> Quaternions:
    """Undo that angles written in one order were read in another; `beyond`: with the middle angle beyond 90 deg."""

    def undo(q: Float) -> Float:
        import warnings

        with warnings.catch_warnings():  # gimbal lock: any of the angles will do
            warnings.simplefilter("ignore")
            angles = scipy.spatial.transform.Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_euler(read)
        if beyond:
            angles = angles * (1.0, -1.0, 1.0) + np.pi
        return np.asarray(scipy.spatial.transform.Rotation.from_euler(written, angles).as_quat()[:, [3, 0, 1, 2]])

    return undo


def _reordered_pose(written: str, read: str) -> HandEyes:
    undo = _reordered(written, read)
    return lambda pose: pose_from(
        rotation_from_quaternion(undo(quaternion_from_rotation(pose[None, :3, :3])))[0], pose[:3, 3]
    )


def _order(name: str) -> str:
    return f"{'-'.join(name.upper())} ({'moving' if name.isupper() else 'fixed'})"


def _axes(axes: tuple[int, ...], signs: tuple[int, ...]) -> str:
    return ", ".join(f"{'-' if sign < 0 else ''}{'xyz'[axis]}" for axis, sign in zip(axes, signs, strict=True))
