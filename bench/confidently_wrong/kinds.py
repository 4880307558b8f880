"""Kinds of corruption: what equipment, drivers and users do to a recording, and the words that name it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter1d, median_filter, uniform_filter1d
from scipy.signal import savgol_filter
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from workbench.artefacts import Recording
from workbench.geometry.poses import inverse, pose_from, quaternion_from_rotation
from workbench.scan.checks import normalised
from workbench.scan.fuse import flange_poses
from workbench.synthetic import Truth
from workbench.units import Float

Spoil = Callable[[Recording, np.random.Generator], Recording]


class Lost(NamedTuple):
    """Returns that are lost along the lower edge, up to so far above it: those of the face alone, or all."""

    above_mm: float
    only_face: bool

    def of(self, r: Recording, truth: Truth) -> Recording:
        """The recording without them."""
        pose, near = flange_poses(r) @ np.asarray(r.flange_from_profiler), cKDTree(truth.position_mm)
        z_mm = r.z_mm.copy()
        for row, x, at in zip(z_mm, r.x_mm, pose, strict=True):
            seen = np.flatnonzero(np.isfinite(row))
            points = at[:3, 3] + x[seen, None] * at[:3, 0] + row[seen, None] * at[:3, 2]
            station = near.query(points)[1]
            off = points - truth.position_mm[station]
            up, out = ((off * axes[station]).sum(axis=1) for axes in (truth.across, truth.normal))
            gone = up < self.above_mm
            row[seen[gone & (np.abs(out) < FACE_MM) if self.only_face else gone]] = np.nan
        return _with(r, z_mm=z_mm)


class Kind(NamedTuple):
    """A corruption; `words`: any of them in a refusal is the right suspicion.

    `unseen`: what results say of what they leave out names it, where the recording cannot show it: sensor (a scale of
    it), travel (a scale or the sense of it), flange (all that only a flange that turns within a pass shows), window
    (its end on a part that lies still in it), order (of frames that are alike), clock (where the motion does not show
    it), end (of the root face, lost in every frame), digits (of the positions), poses (noise of the few that a pass
    has); empty: it must be seen.
    """

    spoil: Spoil
    words: tuple[str, ...]
    unseen: Literal["", "sensor", "flange", "travel", "window", "order", "clock", "end", "digits", "poses"] = ""
    lost: Lost | None = None  # what else is lost
    as_cloud: bool = False  # inspected as a cloud without a grid
    thickness: bool = False  # the plate's is declared


ORIENTATION = ("orientation", "quaternion", "Euler", "hand-eye")
AXES = ("axes", "orientation")
HAND_EYE = ("hand-eye", "profiler's axes")
UNIT = ("read as mm", "unit")
BLIND = ("column", "end", "root face", "view", "seen")
FILTERED = ("filter", "blurred")
FACE_MM = 0.3  # before or behind the root face or end face: of it


def _with(r: Recording, **changes: object) -> Recording:
    return dataclasses.replace(r, **changes)  # type: ignore[arg-type]


def _quaternion(change: Callable[[Float], Float]) -> Spoil:
    return lambda r, _: _with(r, robot_quaternion_wxyz=change(r.robot_quaternion_wxyz))


def _position(change: Callable[[Float], Float]) -> Spoil:
    return lambda r, _: _with(r, robot_position_mm=change(r.robot_position_mm))


def _hand_eye(change: Callable[[Float], Float]) -> Spoil:
    return lambda r, _: _with(r, flange_from_profiler=change(np.asarray(r.flange_from_profiler)))


def _grid(change: Callable[[Recording, np.random.Generator], tuple[Float, Float]]) -> Spoil:
    def spoil(r: Recording, rng: np.random.Generator) -> Recording:
        x, z = change(r, rng)
        return _with(r, x_mm=np.ascontiguousarray(x, np.float32), z_mm=np.ascontiguousarray(z, np.float32))

    return spoil


def _euler(written: str, read: str) -> Spoil:
    def change(q: Float) -> Float:
        angles = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_euler(written)
        return np.asarray(Rotation.from_euler(read, angles).as_quat()[:, [3, 0, 1, 2]])

    return _quaternion(change)


def _turned_hand_eye(degrees: float) -> Spoil:
    def spoil(r: Recording, rng: np.random.Generator) -> Recording:
        axis = rng.normal(size=3)
        turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
        pose = np.asarray(r.flange_from_profiler)
        return _with(r, flange_from_profiler=pose_from(pose[:3, :3] @ turn, pose[:3, 3]))

    return spoil


def _frames(pick: Callable[[int], Float]) -> Spoil:
    """Frame i shows what frame pick[i] saw."""

    def spoil(r: Recording, _: np.random.Generator) -> Recording:
        which = np.asarray(pick(len(r.time_s)), int)
        return _with(r, x_mm=r.x_mm[which], z_mm=r.z_mm[which])

    return spoil


def _hangs(n: int) -> Float:
    which = np.arange(n)
    which[n // 3 : n // 3 + n // 8] = n // 3
    return which


def _shuffled(n: int) -> Float:
    return np.random.default_rng(1).permutation(n)


def _mean(columns: int) -> Spoil:
    def change(r: Recording, _: np.random.Generator) -> tuple[Float, Float]:
        seen = np.isfinite(r.z_mm)
        count = uniform_filter1d(seen.astype(float), columns, axis=1)
        total = uniform_filter1d(np.where(seen, r.z_mm, 0.0).astype(float), columns, axis=1)
        return r.x_mm, np.where(seen, total / np.maximum(count, 1e-9), np.nan)

    return _grid(change)


def _median(columns: int) -> Spoil:
    def change(r: Recording, _: np.random.Generator) -> tuple[Float, Float]:
        seen = np.isfinite(r.z_mm)
        return r.x_mm, np.where(seen, median_filter(np.where(seen, r.z_mm, 1e3), (1, columns)), np.nan)

    return _grid(change)


def _median_of_returns(columns: int) -> Spoil:
    """Of what returned within the window, and nothing where nothing did."""

    def change(r: Recording, _: np.random.Generator) -> tuple[Float, Float]:
        seen, half = np.isfinite(r.z_mm), columns // 2
        padded = np.pad(r.z_mm.astype(float), ((0, 0), (half, half)), constant_values=np.nan)
        around = np.lib.stride_tricks.sliding_window_view(padded, columns, axis=1)
        found = np.full(seen.shape, np.nan)
        found[seen] = np.nanmedian(around[seen], axis=1)
        return r.x_mm, found

    return _grid(change)


def _continued(columns: int, held: bool) -> Spoil:
    """The sensor goes on beyond the last return beside lost ones: with its range, or with the slope before it."""

    def change(r: Recording, _: np.random.Generator) -> tuple[Float, Float]:
        made = r.z_mm.astype(float)
        for z in (made, made[:, ::-1]):
            ends = np.isfinite(z[:, :-1]) & ~np.isfinite(z[:, 1:])
            for i, j in zip(*np.nonzero(ends), strict=True):
                step = 0.0 if held or j < 3 or not np.isfinite(z[i, j - 3]) else (z[i, j] - z[i, j - 3]) / 3.0
                for k in range(1, min(columns, z.shape[1] - 1 - j) + 1):
                    if np.isfinite(z[i, j + k]):
                        break
                    z[i, j + k] = z[i, j] + k * step
        return r.x_mm, made

    return _grid(change)


def _trimmed(columns: int) -> Spoil:
    """The last returns beside lost ones are lost too."""

    def change(r: Recording, _: np.random.Generator) -> tuple[Float, Float]:
        lost = ~np.isfinite(r.z_mm)
        near = binary_dilation(lost, np.ones((1, 2 * columns + 1), bool))
        return r.x_mm, np.where(near, np.nan, r.z_mm)

    return _grid(change)


def _blind(columns: int, bands: int = 1) -> Spoil:
    """Neighbouring columns that never return: at the end of the part that most frames show, and anywhere else."""

    def change(r: Recording, rng: np.random.Generator) -> tuple[Float, Float]:
        z, ends = r.z_mm.copy(), []
        for row in z[:: max(1, len(z) // 40)]:
            seen = np.flatnonzero(np.isfinite(row))
            if len(seen) > 50:
                steps = np.abs(np.diff(row[seen])) + 50.0 * (np.diff(seen) > 20)
                ends.append(seen[np.argmax(steps)] + rng.integers(2))
        places = [int(np.median(ends)), *rng.integers(0, z.shape[1], bands - 1)] if ends else []
        for place in places:
            z[:, max(place - columns // 2, 0) : place - columns // 2 + columns] = np.nan
        return r.x_mm, z

    return _grid(change)


def _gauss(columns: float) -> Spoil:
    def change(r: Recording, _: np.random.Generator) -> tuple[Float, Float]:
        seen = np.isfinite(r.z_mm)
        weight = gaussian_filter1d(seen.astype(float), columns, axis=1)
        total = gaussian_filter1d(np.where(seen, r.z_mm, 0.0).astype(float), columns, axis=1)
        return r.x_mm, np.where(seen, total / np.maximum(weight, 1e-9), np.nan)

    return _grid(change)


def _savitzky_golay(columns: int) -> Spoil:
    """Parabolas through the returns beside each one, whatever gaps and jumps lie between."""

    def change(r: Recording, _: np.random.Generator) -> tuple[Float, Float]:
        z = r.z_mm.astype(float)
        for row in z:
            seen = np.flatnonzero(np.isfinite(row))
            if len(seen) >= columns:
                row[seen] = savgol_filter(row[seen], columns, 2)
        return r.x_mm, z

    return _grid(change)


def _frame_mean(frames: int) -> Spoil:
    """Every frame is the mean of the last ones, where all of them returned."""

    def change(r: Recording, _: np.random.Generator) -> tuple[Float, Float]:
        z = r.z_mm.astype(float)
        for number in np.unique(r.pass_index):
            at = np.flatnonzero(r.pass_index == number)
            before = np.maximum(np.arange(len(at))[:, None] - np.arange(frames), 0)
            z[at] = np.mean([r.z_mm[at][before[:, k]] for k in range(frames)], axis=0)
        return r.x_mm, z

    return _grid(change)


def _every(columns: int, absent: bool) -> Spoil:
    """One column of so many is delivered; the others return nothing, or are left out."""

    def spoil(r: Recording, _: np.random.Generator) -> Recording:
        keep = np.arange(r.z_mm.shape[1]) % columns == 0
        if absent:
            return _with(r, x_mm=r.x_mm[:, keep], z_mm=r.z_mm[:, keep], intensity=None)
        return _with(r, z_mm=np.where(keep, r.z_mm, np.nan).astype(np.float32))

    return spoil


def _filled(r: Recording, _: np.random.Generator) -> tuple[Float, Float]:
    """Lost returns are interpolated by the sensor, also over the plate's ends."""
    z = r.z_mm.astype(float)
    column = np.arange(z.shape[1])
    for row in z:
        seen = np.isfinite(row)
        if seen.sum() > 1:
            inside = (column > column[seen][0]) & (column < column[seen][-1])
            row[inside] = np.interp(column[inside], column[seen], row[seen])
    return r.x_mm, z


def _steps_of(step: float) -> Callable[[Float], Float]:
    return lambda values: np.round(values / step) * step


def _as_read(step: float) -> Callable[[Float], Float]:
    """Rounded quaternions as `scan.read` normalises, or refuses, them."""
    return lambda q: normalised(np.round(q / step) * step, "/robot/quaternion_wxyz")


def _noisy(position_mm: float, degrees: float) -> Spoil:
    def spoil(r: Recording, rng: np.random.Generator) -> Recording:
        q = r.robot_quaternion_wxyz
        turn = Rotation.from_rotvec(np.radians(degrees) * rng.normal(size=(len(q), 3)))
        turned = (Rotation.from_quat(q[:, [1, 2, 3, 0]]) * turn).as_quat()[:, [3, 0, 1, 2]]
        moved = r.robot_position_mm + position_mm * rng.normal(size=(len(q), 3))
        return _with(r, robot_position_mm=moved, robot_quaternion_wxyz=turned)

    return spoil


def _drifting_clock(rate: float) -> Spoil:
    """The profiler's clock runs fast by a share; both begin together."""

    def spoil(r: Recording, _: np.random.Generator) -> Recording:
        start = np.array([r.time_s[r.pass_index == n][0] for n in r.pass_index])
        last = np.array([r.robot_time_s[r.robot_pass == n].max() for n in r.pass_index])
        late = start + (r.time_s - start) * (1.0 + rate)
        keep = late <= last
        return _with(
            r,
            time_s=late[keep],
            x_mm=r.x_mm[keep],
            z_mm=r.z_mm[keep],
            pass_index=r.pass_index[keep],
            intensity=None,
        )

    return spoil


def _evenly_stamped(r: Recording, rng: np.random.Generator) -> Recording:
    """A tenth of the frames is lost in bursts; the others are stamped evenly, as if none were."""
    n = len(r.time_s)
    keep = np.ones(n, bool)
    for start in rng.integers(0, n - n // 30, 3):
        keep[start : start + n // 30] = False
    time = []
    for number in np.unique(r.pass_index):
        whole = r.time_s[r.pass_index == number]
        time.append(np.linspace(whole[0], whole[-1], int((keep & (r.pass_index == number)).sum())))
    return _with(
        r,
        time_s=np.concatenate(time),
        x_mm=r.x_mm[keep],
        z_mm=r.z_mm[keep],
        pass_index=r.pass_index[keep],
        intensity=None,
    )


def _second_pass_off(millimetres: float) -> Spoil:
    """The scan again as a second pass with noise of its own, the whole of it shifted across the edge."""

    def spoil(r: Recording, rng: np.random.Generator) -> Recording:
        twice = _passes(2, 0.0)(r, rng)
        n = len(r.time_s)
        noise = rng.normal(0, 0.01, (n, r.z_mm.shape[1])).astype(np.float32)
        z = twice.z_mm.copy()
        z[:n] += rng.normal(0, 0.01, z[:n].shape).astype(np.float32)
        z[n:] += noise
        place = twice.robot_position_mm.copy()
        along = np.ptp(r.robot_position_mm[r.robot_pass == r.robot_pass[0]], axis=0)
        across = np.cross(along, rng.normal(size=3))
        place[len(r.robot_position_mm) :] += millimetres * across / np.linalg.norm(across)
        return _with(twice, z_mm=z, robot_position_mm=place)

    return spoil


def _mirrored(x: bool, z: bool) -> Spoil:
    """Signs of the profiler's axes: z less the mirrored stand-off, so that ranges stay what they were."""

    def change(r: Recording, _: np.random.Generator) -> tuple[Float, Float]:
        middle = np.nanmedian(r.z_mm)
        return (-r.x_mm if x else r.x_mm), (2 * middle - r.z_mm if z else r.z_mm)

    return _grid(change)


def _cropped(side: int, share: float, absent: bool = False) -> Spoil:
    """The sensor's window ends in the part: the columns beyond return nothing, or are left out."""

    def spoil(r: Recording, _: np.random.Generator) -> Recording:
        seen = np.flatnonzero(np.isfinite(r.z_mm).any(axis=0))
        at = seen[int(share * (len(seen) - 1))]
        columns = np.arange(r.z_mm.shape[1])
        keep = columns < at if side < 0 else columns > at
        if absent:
            return _with(r, x_mm=r.x_mm[:, keep], z_mm=r.z_mm[:, keep], intensity=None)
        return _with(r, z_mm=np.where(keep, r.z_mm, np.nan).astype(np.float32))

    return spoil


def _rounded(step_x: float, step_z: float) -> Spoil:
    def one(values: Float, step: float) -> Float:
        return np.round(values / step) * step if step else values

    return _grid(lambda r, _: (one(r.x_mm, step_x), one(r.z_mm, step_z)))


def _copied(number: Float, count: int) -> Float:
    """Pass numbers (n,) again and again, each time others."""
    return (number + (number.max() + 1) * np.arange(count)[:, None]).ravel()


def _passes(count: int, dither_mm: float) -> Spoil:
    def spoil(r: Recording, rng: np.random.Generator) -> Recording:
        n = len(r.time_s)
        z = np.tile(r.z_mm, (count, 1)) + rng.normal(0, dither_mm, (count * n, r.z_mm.shape[1])).astype(np.float32)
        return _with(
            r,
            time_s=np.tile(r.time_s, count),
            x_mm=np.tile(r.x_mm, (count, 1)),
            z_mm=z,
            pass_index=_copied(r.pass_index, count),
            intensity=None,
            robot_time_s=np.tile(r.robot_time_s, count),
            robot_position_mm=np.tile(r.robot_position_mm, (count, 1)),
            robot_quaternion_wxyz=np.tile(r.robot_quaternion_wxyz, (count, 1)),
            robot_pass=_copied(r.robot_pass, count),
        )

    return spoil


def _frozen_stream(share: float) -> Spoil:
    """The pose stream hangs for a share of the scan; poses at every frame, so that it can."""

    def spoil(r: Recording, _: np.random.Generator) -> Recording:
        dense = dense_stream(r)
        n = len(dense.robot_time_s)
        which = np.arange(n)
        which[n // 4 : n // 4 + int(share * n)] = n // 4
        return _with(
            dense,
            robot_position_mm=dense.robot_position_mm[which],
            robot_quaternion_wxyz=dense.robot_quaternion_wxyz[which],
        )

    return spoil


def dense_stream(r: Recording) -> Recording:
    """The same poses, told at every frame's time."""
    poses = flange_poses(r)
    return _with(
        r,
        robot_time_s=r.time_s,
        robot_position_mm=poses[:, :3, 3],
        robot_pass=r.pass_index,
        robot_quaternion_wxyz=quaternion_from_rotation(poses[:, :3, :3]),
    )


def _clock(offset_s: float) -> Spoil:
    def spoil(r: Recording, _: np.random.Generator) -> Recording:
        dense = dense_stream(r)
        keep = np.zeros(len(r.time_s), bool)
        for number in np.unique(r.pass_index):
            time = r.time_s[r.pass_index == number]
            keep[r.pass_index == number] = time + offset_s <= time[-1]
        return _with(
            dense,
            time_s=r.time_s[keep] + offset_s,
            x_mm=r.x_mm[keep],
            z_mm=r.z_mm[keep],
            pass_index=r.pass_index[keep],
            intensity=None,
        )

    return spoil


def _bowed(millimetres: float) -> Spoil:
    """x is off by a parabola over the columns, by so much at both ends of what they see."""

    def change(r: Recording, _: np.random.Generator) -> tuple[Float, Float]:
        x = r.x_mm.astype(float)
        return x + millimetres * (x / np.nanmax(np.abs(x))) ** 2, r.z_mm

    return _grid(change)


def _same(r: Recording, _: np.random.Generator) -> Recording:
    return r


def _axes(order: list[int], signs: tuple[int, int, int]) -> Spoil:
    return _position(lambda p: p[:, order] * signs)


def _identity(q: Float) -> Float:
    return np.tile([1.0, 0.0, 0.0, 0.0], (len(q), 1))


KINDS: dict[str, Kind] = {
    "nothing": Kind(_same, ()),
    "nothing, as a cloud": Kind(_same, (), as_cloud=True),
    "0.1 mm of the end dark": Kind(_same, BLIND, "end", Lost(0.1, only_face=True)),
    "0.3 mm of the end dark": Kind(_same, BLIND, "end", Lost(0.3, only_face=True)),
    "nothing, thickness declared": Kind(_same, (), thickness=True),
    "0.3 mm of the end dark, thickness declared": Kind(_same, BLIND, "end", Lost(0.3, only_face=True), thickness=True),
    "0.3 mm cut off a cloud": Kind(_same, BLIND, "end", Lost(0.3, only_face=False), as_cloud=True),
    "quaternions x y z w": Kind(_quaternion(lambda q: q[:, [1, 2, 3, 0]]), ORIENTATION, "flange"),
    "quaternions z y x w": Kind(_quaternion(lambda q: q[:, [3, 2, 1, 0]]), ORIENTATION, "flange"),
    "quaternions w z y x": Kind(_quaternion(lambda q: q[:, [0, 3, 2, 1]]), ORIENTATION, "flange"),
    "quaternions conjugated": Kind(_quaternion(lambda q: q * (1, -1, -1, -1)), ORIENTATION, "flange"),
    "quaternions x y z w, conjugated": Kind(
        _quaternion(lambda q: (q * (1, -1, -1, -1))[:, [1, 2, 3, 0]]), ORIENTATION, "flange"
    ),
    "quaternion x negated": Kind(_quaternion(lambda q: q * (1, -1, 1, 1)), ORIENTATION, "flange"),
    "quaternion y negated": Kind(_quaternion(lambda q: q * (1, 1, -1, 1)), ORIENTATION, "flange"),
    "quaternion z negated": Kind(_quaternion(lambda q: q * (1, 1, 1, -1)), ORIENTATION, "flange"),
    "identity orientation": Kind(_quaternion(_identity), ORIENTATION, "flange"),
    "first orientation held": Kind(_quaternion(lambda q: np.repeat(q[:1], len(q), axis=0)), ORIENTATION, "flange"),
    "Euler ZYX read as XYZ": Kind(_euler("ZYX", "XYZ"), ORIENTATION, "flange"),
    "Euler XYZ read as ZYX": Kind(_euler("XYZ", "ZYX"), ORIENTATION, "flange"),
    "Euler ZYZ read as ZYX": Kind(_euler("ZYZ", "ZYX"), ORIENTATION, "flange"),
    "Euler ZYX read as zyx": Kind(_euler("ZYX", "zyx"), ORIENTATION, "flange"),
    "hand-eye inverted": Kind(_hand_eye(inverse), HAND_EYE, "flange"),
    "hand-eye transposed": Kind(_hand_eye(lambda p: pose_from(p[:3, :3].T, p[:3, 3])), HAND_EYE, "flange"),
    "hand-eye missing": Kind(_hand_eye(lambda p: np.eye(4)), HAND_EYE, "flange"),
    "hand-eye rotation missing": Kind(_hand_eye(lambda p: pose_from(np.eye(3), p[:3, 3])), HAND_EYE, "flange"),
    "hand-eye translation in m": Kind(_hand_eye(lambda p: pose_from(p[:3, :3], p[:3, 3] / 1e3)), (*HAND_EYE, *UNIT)),
    "hand-eye translation negated": Kind(_hand_eye(lambda p: pose_from(p[:3, :3], -p[:3, 3])), HAND_EYE, "flange"),
    "hand-eye translation 30 mm off": Kind(
        _hand_eye(lambda p: pose_from(p[:3, :3], p[:3, 3] + (30, 0, 0))), HAND_EYE, "flange"
    ),
    "hand-eye turned by 2 deg": Kind(_turned_hand_eye(2), HAND_EYE, "flange"),
    "hand-eye turned by 10 deg": Kind(_turned_hand_eye(10), HAND_EYE, "flange"),
    "hand-eye turned by 30 deg": Kind(_turned_hand_eye(30), HAND_EYE, "flange"),
    "hand-eye turned by 90 deg": Kind(_turned_hand_eye(90), HAND_EYE, "flange"),
    "positions in m": Kind(_position(lambda p: p / 1e3), UNIT),
    "positions in cm": Kind(_position(lambda p: p / 10), UNIT),
    "positions in inches": Kind(_position(lambda p: p / 25.4), UNIT),
    "positions in micrometres": Kind(_position(lambda p: p * 1e3), UNIT),
    "travel doubled": Kind(_position(lambda p: p[:1] + 2 * (p - p[:1])), (*UNIT, "passes"), "travel"),
    "travel halved": Kind(_position(lambda p: p[:1] + (p - p[:1]) / 2), (*UNIT, "passes"), "travel"),
    "axes y x z": Kind(_axes([1, 0, 2], (1, 1, 1)), AXES, "flange"),
    "axes z y x": Kind(_axes([2, 1, 0], (1, 1, 1)), AXES, "flange"),
    "axes x z y": Kind(_axes([0, 2, 1], (1, 1, 1)), AXES, "flange"),
    "axes y z x": Kind(_axes([1, 2, 0], (1, 1, 1)), AXES, "flange"),
    "x mirrored": Kind(_axes([0, 1, 2], (-1, 1, 1)), AXES, "flange"),
    "y mirrored": Kind(_axes([0, 1, 2], (1, -1, 1)), AXES, "flange"),
    "z mirrored": Kind(_axes([0, 1, 2], (1, 1, -1)), AXES, "flange"),
    "poses frozen": Kind(_position(lambda p: np.repeat(p[:1], len(p), axis=0)), ("frozen",)),
    "pose stream hangs for 60 %": Kind(_frozen_stream(0.6), ("frozen",)),
    "pose stream hangs for 20 %": Kind(_frozen_stream(0.2), ("frozen",)),
    "profiles in m": Kind(_grid(lambda r, _: (r.x_mm / 1e3, r.z_mm / 1e3)), UNIT),
    "profiles in inches": Kind(_grid(lambda r, _: (r.x_mm / 25.4, r.z_mm / 25.4)), UNIT),
    "profiles in cm": Kind(_grid(lambda r, _: (r.x_mm / 10, r.z_mm / 10)), UNIT),
    "x and z swapped": Kind(_grid(lambda r, _: (r.z_mm, r.x_mm)), ("axes", "edge"), "flange"),
    "x scale 1.01": Kind(_grid(lambda r, _: (r.x_mm * 1.01, r.z_mm)), ("scale",), "sensor"),
    "x scale 1.02": Kind(_grid(lambda r, _: (r.x_mm * 1.02, r.z_mm)), ("scale",), "sensor"),
    "x bowed by 0.1 mm": Kind(_bowed(0.1), ("scale",), "sensor"),
    "x scale 1.2": Kind(_grid(lambda r, _: (r.x_mm * 1.2, r.z_mm)), ("scale",), "sensor"),
    "z scale 1.05": Kind(_grid(lambda r, _: (r.x_mm, r.z_mm * 1.05)), ("scale",), "sensor"),
    "all frames alike": Kind(_frames(lambda n: np.full(n, n // 2)), ("repeating", "frozen")),
    "scanner hangs for an eighth": Kind(_frames(_hangs), ("repeating", "frozen")),
    "every frame twice": Kind(_frames(lambda n: np.arange(n) // 2 * 2), ("repeating", "frozen")),
    "every 20th frame 20 times": Kind(_frames(lambda n: np.arange(n) // 20 * 20), ("repeating", "frozen")),
    "last frames ten late": Kind(_frames(lambda n: np.maximum(np.arange(n) - 10, 0)), ("repeating", "frozen")),
    "frames shuffled": Kind(_frames(_shuffled), ("order",), "order"),
    "frames reversed": Kind(_frames(lambda n: np.arange(n)[::-1]), ("reverse order", *AXES), "travel"),
    "one pass nine times": Kind(_passes(9, 0.0), ("copies",)),
    "one pass nine times, dithered": Kind(_passes(9, 1e-4), ("copies",)),
    "mean over 3 columns": Kind(_mean(3), ("averaged", "filter")),
    "mean over 5 columns": Kind(_mean(5), ("averaged", "filter")),
    "mean over 9 columns": Kind(_mean(9), ("averaged", "filter")),
    "median over 5 columns": Kind(_median(5), ("filter",)),
    "median over 11 columns": Kind(_median(11), ("filter",)),
    "median of returns over 3 columns": Kind(_median_of_returns(3), FILTERED),
    "median of returns over 7 columns": Kind(_median_of_returns(7), FILTERED),
    "last range held over 2 columns": Kind(_continued(2, held=True), FILTERED),
    "last slope continued over 5 columns": Kind(_continued(5, held=False), FILTERED),
    "4 blind columns at the end": Kind(_blind(4), BLIND),
    "8 blind columns at the end": Kind(_blind(8), BLIND),
    "12 bands of 8 blind columns": Kind(_blind(8, bands=12), BLIND),
    "3 columns lost at every end": Kind(_trimmed(3), ("end", "edge"), "end"),
    "z rounded to 0.1 mm": Kind(_rounded(0, 0.1), ("rounded",)),
    "z rounded to 0.02 mm": Kind(_rounded(0, 0.02), ("rounded",)),
    "x rounded to 0.1 mm": Kind(_rounded(0.1, 0), ("rounded",)),
    "x rounded to 0.2 mm": Kind(_rounded(0.2, 0), ("rounded",)),
    "Gauss over 1 column": Kind(_gauss(1.0), ("averaged", "filter")),
    "Gauss over 3 columns": Kind(_gauss(3.0), ("averaged", "filter")),
    "Savitzky-Golay over 7 columns": Kind(_savitzky_golay(7), ("averaged", "filter")),
    "mean over 3 frames": Kind(_frame_mean(3), ("averaged", "filter")),
    "mean over 15 frames": Kind(_frame_mean(15), ("averaged", "filter")),
    "every 2nd column returns": Kind(_every(2, absent=False), ("column",)),
    "every 8th column returns": Kind(_every(8, absent=False), ("column",)),
    "every 8th column delivered": Kind(_every(8, absent=True), ("column",)),
    "lost returns interpolated": Kind(_grid(_filled), ("interpolated", "filled")),
    "profile x mirrored": Kind(_mirrored(x=True, z=False), AXES, "flange"),
    "profile z mirrored": Kind(_mirrored(x=False, z=True), AXES, "flange"),
    "profile x and z mirrored": Kind(_mirrored(x=True, z=True), AXES, "flange"),
    "view ends in the part, left": Kind(_cropped(1, 0.5, absent=True), ("view", "column", "seen", "bevel")),
    "view ends in the part, right": Kind(_cropped(-1, 0.5, absent=True), ("view", "column", "seen", "bevel")),
    "window ends in the part, left": Kind(_cropped(1, 0.5), ("view", "column", "seen", "bevel"), "window"),
    "window ends in the part, right": Kind(_cropped(-1, 0.5), ("view", "column", "seen", "bevel"), "window"),
    "positions rounded to 1 mm": Kind(_position(_steps_of(1.0)), ("poses", "rounded"), "digits"),
    "quaternions rounded to 0.001": Kind(_quaternion(_as_read(1e-3)), (*ORIENTATION, "rounded", "norm")),
    "quaternions rounded to 0.01": Kind(_quaternion(_as_read(1e-2)), (*ORIENTATION, "rounded", "norm")),
    "poses noisy by 0.3 mm": Kind(_noisy(0.3, 0.0), ("poses",), "poses"),
    "poses noisy by 0.3 deg": Kind(_noisy(0.0, 0.3), ("poses", "orientation"), "flange"),
    "clock 1 % fast": Kind(_drifting_clock(0.01), ("clock",), "flange"),
    "clock 10 % fast": Kind(_drifting_clock(0.1), ("clock",), "flange"),
    "lost frames not stamped": Kind(_evenly_stamped, ("clock", "order", "stamp"), "flange"),
    "second pass 0.05 mm off": Kind(_second_pass_off(0.05), ("passes",)),
    "second pass 0.3 mm off": Kind(_second_pass_off(0.3), ("passes",)),
    "second pass 5 mm off": Kind(_second_pass_off(5.0), ("passes",)),
    "clock 20 ms late": Kind(_clock(0.02), ("clock",), "clock"),
    "clock 0.5 s late": Kind(_clock(0.5), ("clock",), "clock"),
}
