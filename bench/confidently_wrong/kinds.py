"""Kinds of corruption: what equipment, drivers and users do to a recording, and the words that name it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Concatenate, Literal, NamedTuple, ParamSpec

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter1d, median_filter, uniform_filter1d
from scipy.signal import savgol_filter
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from bench.recordings import columns, dense_stream, frames, stamped, with_grid, with_values
from workbench.artefacts import Recording
from workbench.geometry.poses import inverse, pose_from
from workbench.scan.checks import normalised
from workbench.scan.fuse_stage import flange_poses
from workbench.synthetic import Truth
from workbench.units import Bool, Float

Rng = np.random.Generator
Spoil = Callable[[Recording, Rng], Recording]


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
        return with_values(r, z_mm=z_mm)


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


P = ParamSpec("P")


def _kinds(spoil: Callable[Concatenate[Recording, Rng, P], Recording]) -> Callable[P, Spoil]:
    """What spoils a recording by the figures that it is called with."""
    return lambda *given, **named: lambda r, rng: spoil(r, rng, *given, **named)


def _ranges(change: Callable[Concatenate[Recording, Rng, P], Float]) -> Callable[P, Spoil]:
    """The same where the ranges alone are others."""
    return _kinds(lambda r, rng, *given, **named: with_grid(r, r.x_mm, change(r, rng, *given, **named)))


def _grid(change: Callable[[Recording], tuple[Float, Float]]) -> Spoil:
    return lambda r, _: with_grid(r, *change(r))


def _values(field: str, change: Callable[[Float], Float]) -> Spoil:
    return lambda r, _: with_values(r, **{field: change(np.asarray(getattr(r, field)))})


_quaternion, _position = partial(_values, "robot_quaternion_wxyz"), partial(_values, "robot_position_mm")
_hand_eye = partial(_values, "flange_from_profiler")


def _euler(written: str, read: str) -> Spoil:
    def change(q: Float) -> Float:
        angles = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_euler(written)
        return np.asarray(Rotation.from_euler(read, angles).as_quat()[:, [3, 0, 1, 2]])

    return _quaternion(change)


@_kinds
def _turned_hand_eye(r: Recording, rng: Rng, degrees: float) -> Recording:
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    pose = np.asarray(r.flange_from_profiler)
    return with_values(r, flange_from_profiler=pose_from(pose[:3, :3] @ turn, pose[:3, 3]))


def _frames(pick: Callable[[int], Float]) -> Spoil:
    """Frame i shows what frame pick[i] saw."""
    return _grid(lambda r: (r.x_mm[(which := np.asarray(pick(len(r.time_s)), int))], r.z_mm[which]))


def _hangs(n: int) -> Float:
    which = np.arange(n)
    which[n // 3 : n // 3 + n // 8] = n // 3
    return which


def _shuffled(n: int) -> Float:
    return np.random.default_rng(1).permutation(n)


@_ranges
def _smoothed(r: Recording, _: Rng, smooth: Callable[..., Float], columns: float) -> Float:
    """Means of what returned, weighted by a filter over so many columns."""
    seen = np.isfinite(r.z_mm)
    weight = smooth(seen.astype(float), columns, axis=1)
    total = smooth(np.where(seen, r.z_mm, 0.0).astype(float), columns, axis=1)
    return np.where(seen, total / np.maximum(weight, 1e-9), np.nan)


@_ranges
def _median(r: Recording, _: Rng, columns: int) -> Float:
    seen = np.isfinite(r.z_mm)
    return np.where(seen, median_filter(np.where(seen, r.z_mm, 1e3), (1, columns)), np.nan)


@_ranges
def _median_of_returns(r: Recording, _: Rng, columns: int) -> Float:
    """Of what returned within the window, and nothing where nothing did."""
    seen, half = np.isfinite(r.z_mm), columns // 2
    padded = np.pad(r.z_mm.astype(float), ((0, 0), (half, half)), constant_values=np.nan)
    around = np.lib.stride_tricks.sliding_window_view(padded, columns, axis=1)
    found = np.full(seen.shape, np.nan)
    found[seen] = np.nanmedian(around[seen], axis=1)
    return found


@_ranges
def _continued(r: Recording, _: Rng, columns: int, held: bool) -> Float:
    """The sensor goes on beyond the last return beside lost ones: with its range, or with the slope before it."""
    made = r.z_mm.astype(float)
    for z in (made, made[:, ::-1]):
        ends = np.isfinite(z[:, :-1]) & ~np.isfinite(z[:, 1:])
        for i, j in zip(*np.nonzero(ends), strict=True):
            step = 0.0 if held or j < 3 or not np.isfinite(z[i, j - 3]) else (z[i, j] - z[i, j - 3]) / 3.0
            for k in range(1, min(columns, z.shape[1] - 1 - j) + 1):
                if np.isfinite(z[i, j + k]):
                    break
                z[i, j + k] = z[i, j] + k * step
    return made


@_ranges
def _trimmed(r: Recording, _: Rng, columns: int) -> Float:
    """The last returns beside lost ones are lost too."""
    near = binary_dilation(~np.isfinite(r.z_mm), np.ones((1, 2 * columns + 1), bool))
    return np.where(near, np.nan, r.z_mm)


@_ranges
def _blind(r: Recording, rng: Rng, columns: int, bands: int = 1) -> Float:
    """Neighbouring columns that never return: at the end of the part that most frames show, and anywhere else."""
    z, ends = r.z_mm.copy(), []
    for row in z[:: max(1, len(z) // 40)]:
        seen = np.flatnonzero(np.isfinite(row))
        if len(seen) > 50:
            steps = np.abs(np.diff(row[seen])) + 50.0 * (np.diff(seen) > 20)
            ends.append(seen[np.argmax(steps)] + rng.integers(2))
    places = [int(np.median(ends)), *rng.integers(0, z.shape[1], bands - 1)] if ends else []
    for place in places:
        z[:, max(place - columns // 2, 0) : place - columns // 2 + columns] = np.nan
    return z


@_ranges
def _savitzky_golay(r: Recording, _: Rng, columns: int) -> Float:
    """Parabolas through the returns beside each one, whatever gaps and jumps lie between."""
    z = r.z_mm.astype(float)
    for row in z:
        seen = np.flatnonzero(np.isfinite(row))
        if len(seen) >= columns:
            row[seen] = savgol_filter(row[seen], columns, 2)
    return z


@_ranges
def _frame_mean(r: Recording, _: Rng, count: int) -> Float:
    """Every frame is the mean of the last ones, where all of them returned."""
    z = r.z_mm.astype(float)
    for number in np.unique(r.pass_index):
        at = np.flatnonzero(r.pass_index == number)
        before = np.maximum(np.arange(len(at))[:, None] - np.arange(count), 0)
        z[at] = np.mean([r.z_mm[at][before[:, k]] for k in range(count)], axis=0)
    return z


def _delivered(r: Recording, keep: Bool, absent: bool) -> Recording:
    """The columns that are kept: the others return nothing, or are left out."""
    if absent:
        return with_values(columns(r, keep), intensity=None)
    return with_values(r, z_mm=np.where(keep, r.z_mm, np.nan).astype(np.float32))


@_kinds
def _every(r: Recording, _: Rng, step: int, absent: bool) -> Recording:
    """One column of so many is delivered."""
    return _delivered(r, np.arange(r.z_mm.shape[1]) % step == 0, absent)


@_kinds
def _cropped(r: Recording, _: Rng, side: int, share: float, absent: bool = False) -> Recording:
    """The sensor's window ends in the part."""
    seen = np.flatnonzero(np.isfinite(r.z_mm).any(axis=0))
    beyond = side * (np.arange(r.z_mm.shape[1]) - seen[int(share * (len(seen) - 1))])
    return _delivered(r, beyond > 0, absent)


@_ranges
def _filled(r: Recording, _: Rng) -> Float:
    """Lost returns are interpolated by the sensor, also over the plate's ends."""
    z = r.z_mm.astype(float)
    column = np.arange(z.shape[1])
    for row in z:
        seen = np.isfinite(row)
        if seen.sum() > 1:
            inside = (column > column[seen][0]) & (column < column[seen][-1])
            row[inside] = np.interp(column[inside], column[seen], row[seen])
    return z


def _steps_of(step: float) -> Callable[[Float], Float]:
    return lambda values: np.round(values / step) * step


def _as_read(step: float) -> Callable[[Float], Float]:
    """Rounded quaternions as `scan.read` normalises, or refuses, them."""
    return lambda q: normalised(np.round(q / step) * step, "/robot/quaternion_wxyz")


@_kinds
def _noisy(r: Recording, rng: Rng, position_mm: float, degrees: float) -> Recording:
    q = r.robot_quaternion_wxyz
    turn = Rotation.from_rotvec(np.radians(degrees) * rng.normal(size=(len(q), 3)))
    turned = (Rotation.from_quat(q[:, [1, 2, 3, 0]]) * turn).as_quat()[:, [3, 0, 1, 2]]
    moved = r.robot_position_mm + position_mm * rng.normal(size=(len(q), 3))
    return with_values(r, robot_position_mm=moved, robot_quaternion_wxyz=turned)


@_kinds
def _drifting_clock(r: Recording, _: Rng, rate: float) -> Recording:
    """The profiler's clock runs fast by a share; both begin together."""
    start = np.array([r.time_s[r.pass_index == n][0] for n in r.pass_index])
    return stamped(r, start + (r.time_s - start) * (1.0 + rate))


def _evenly_stamped(r: Recording, rng: Rng) -> Recording:
    """A tenth of the frames is lost in bursts; the others are stamped evenly, as if none were."""
    n = len(r.time_s)
    keep = np.ones(n, bool)
    for start in rng.integers(0, n - n // 30, 3):
        keep[start : start + n // 30] = False
    time = []
    for number in np.unique(r.pass_index):
        whole = r.time_s[r.pass_index == number]
        time.append(np.linspace(whole[0], whole[-1], int((keep & (r.pass_index == number)).sum())))
    return with_values(frames(r, keep), time_s=np.concatenate(time), intensity=None)


@_kinds
def _second_pass_off(r: Recording, rng: Rng, millimetres: float) -> Recording:
    """The scan again as a second pass with noise of its own, the whole of it shifted across the edge."""
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
    return with_values(twice, z_mm=z, robot_position_mm=place)


@_kinds
def _mirrored(r: Recording, _: Rng, x: bool, z: bool) -> Recording:
    """Signs of the profiler's axes: z less the mirrored stand-off, so that ranges stay what they were."""
    return with_grid(r, -r.x_mm if x else r.x_mm, 2 * np.nanmedian(r.z_mm) - r.z_mm if z else r.z_mm)


def _rounded(step_x: float, step_z: float) -> Spoil:
    def one(values: Float, step: float) -> Float:
        return _steps_of(step)(values) if step else values

    return _grid(lambda r: (one(r.x_mm, step_x), one(r.z_mm, step_z)))


def _copied(number: Float, count: int) -> Float:
    """Pass numbers (n,) again and again, each time others."""
    return (number + (number.max() + 1) * np.arange(count)[:, None]).ravel()


@_kinds
def _passes(r: Recording, rng: Rng, count: int, dither_mm: float) -> Recording:
    n = len(r.time_s)
    z = np.tile(r.z_mm, (count, 1)) + rng.normal(0, dither_mm, (count * n, r.z_mm.shape[1])).astype(np.float32)
    return with_values(
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


@_kinds
def frozen_stream(r: Recording, _: Rng, share: float, turns: bool = False) -> Recording:
    """The pose stream, or its orientation, hangs for a share of the scan; poses at every frame, so that it can."""
    dense = dense_stream(r)
    n = len(dense.robot_time_s)
    which = np.arange(n)
    which[n // 4 : n // 4 + int(share * n)] = n // 4
    place = dense.robot_position_mm if turns else dense.robot_position_mm[which]
    return with_values(dense, robot_position_mm=place, robot_quaternion_wxyz=dense.robot_quaternion_wxyz[which])


@_kinds
def _clock(r: Recording, _: Rng, offset_s: float) -> Recording:
    return stamped(dense_stream(r), r.time_s + offset_s)


def _bowed(millimetres: float) -> Spoil:
    """x is off by a parabola over the columns, by so much at both ends of what they see."""
    return _grid(
        lambda r: (
            (x := r.x_mm.astype(float)) + millimetres * (x / np.nanmax(np.abs(x))) ** 2,
            r.z_mm,
        )
    )


def later(change: Callable[[Float, Float], tuple[Float, Float]]) -> Spoil:
    """x and z (N, M) are others from the middle frame on."""

    def changed(r: Recording) -> tuple[Float, Float]:
        early = np.arange(len(r.time_s))[:, None] < len(r.time_s) // 2
        x, z = change(r.x_mm, r.z_mm)
        return np.where(early, r.x_mm, x), np.where(early, r.z_mm, z)

    return _grid(changed)


def _same(r: Recording, _: Rng) -> Recording:
    return r


def _ordered(axes: str) -> Callable[[Float], Float]:
    return lambda p: p[:, ["xyz".index(axis) for axis in axes]]


def _negated(k: int) -> Callable[[Float], Float]:
    return lambda values: np.where(np.arange(values.shape[1]) == k, -values, values)


def _divided(by: float) -> Callable[[Float], Float]:
    return lambda values: values / by


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
    **{
        f"quaternion {c} negated": Kind(_quaternion(_negated(k)), ORIENTATION, "flange") for k, c in enumerate("xyz", 1)
    },
    "identity orientation": Kind(_quaternion(_identity), ORIENTATION, "flange"),
    "first orientation held": Kind(_quaternion(lambda q: np.repeat(q[:1], len(q), axis=0)), ORIENTATION, "flange"),
    **{
        f"Euler {written} read as {read}": Kind(_euler(written, read), ORIENTATION, "flange")
        for written, read in (("ZYX", "XYZ"), ("XYZ", "ZYX"), ("ZYZ", "ZYX"), ("ZYX", "zyx"))
    },
    "hand-eye inverted": Kind(_hand_eye(inverse), HAND_EYE, "flange"),
    "hand-eye transposed": Kind(_hand_eye(lambda p: pose_from(p[:3, :3].T, p[:3, 3])), HAND_EYE, "flange"),
    "hand-eye missing": Kind(_hand_eye(lambda p: np.eye(4)), HAND_EYE, "flange"),
    "hand-eye rotation missing": Kind(_hand_eye(lambda p: pose_from(np.eye(3), p[:3, 3])), HAND_EYE, "flange"),
    "hand-eye translation in m": Kind(_hand_eye(lambda p: pose_from(p[:3, :3], p[:3, 3] / 1e3)), (*HAND_EYE, *UNIT)),
    "hand-eye translation negated": Kind(_hand_eye(lambda p: pose_from(p[:3, :3], -p[:3, 3])), HAND_EYE, "flange"),
    "hand-eye translation 30 mm off": Kind(
        _hand_eye(lambda p: pose_from(p[:3, :3], p[:3, 3] + (30, 0, 0))), HAND_EYE, "flange"
    ),
    **{f"hand-eye turned by {n} deg": Kind(_turned_hand_eye(n), HAND_EYE, "flange") for n in (2, 10, 30, 90)},
    **{
        f"positions in {unit}": Kind(_position(_divided(mm)), UNIT)
        for unit, mm in (("m", 1e3), ("cm", 10), ("inches", 25.4))
    },
    "positions in micrometres": Kind(_position(lambda p: p * 1e3), UNIT),
    "travel doubled": Kind(_position(lambda p: p[:1] + 2 * (p - p[:1])), (*UNIT, "passes"), "travel"),
    "travel halved": Kind(_position(lambda p: p[:1] + (p - p[:1]) / 2), (*UNIT, "passes"), "travel"),
    **{
        f"axes {' '.join(order)}": Kind(_position(_ordered(order)), AXES, "flange")
        for order in ("yxz", "zyx", "xzy", "yzx")
    },
    **{f"{c} mirrored": Kind(_position(_negated(k)), AXES, "flange") for k, c in enumerate("xyz")},
    "poses frozen": Kind(_position(lambda p: np.repeat(p[:1], len(p), axis=0)), ("frozen",)),
    **{f"pose stream hangs for {n} %": Kind(frozen_stream(n / 100), ("frozen",)) for n in (60, 20)},
    "orientation hangs for 30 %": Kind(frozen_stream(0.3, turns=True), ("frozen",), "flange"),
    **{
        f"profiles in {unit}": Kind(_grid(lambda r, mm=mm: (r.x_mm / mm, r.z_mm / mm)), UNIT)
        for unit, mm in (("m", 1e3), ("inches", 25.4), ("cm", 10))
    },
    "x and z swapped": Kind(_grid(lambda r: (r.z_mm, r.x_mm)), ("axes", "edge"), "flange"),
    "x scale 1.01": Kind(_grid(lambda r: (r.x_mm * 1.01, r.z_mm)), ("scale",), "sensor"),
    "x scale 1.02": Kind(_grid(lambda r: (r.x_mm * 1.02, r.z_mm)), ("scale",), "sensor"),
    "x bowed by 0.1 mm": Kind(_bowed(0.1), ("scale",), "sensor"),
    "x scale 1.2": Kind(_grid(lambda r: (r.x_mm * 1.2, r.z_mm)), ("scale",), "sensor"),
    "z scale 1.05": Kind(_grid(lambda r: (r.x_mm, r.z_mm * 1.05)), ("scale",), "sensor"),
    "x scale 1.04 from the middle on": Kind(later(lambda x, z: (1.04 * x, z)), ("scaled by +4.0 %",)),
    "x mirrored from the middle on": Kind(later(lambda x, z: (-x, z)), ("mirrored",)),
    "columns reversed from the middle on": Kind(later(lambda x, z: (x[:, ::-1], z[:, ::-1])), ("reversed",)),
    "all frames alike": Kind(_frames(lambda n: np.full(n, n // 2)), ("repeating", "frozen")),
    "scanner hangs for an eighth": Kind(_frames(_hangs), ("repeating", "frozen")),
    "every frame twice": Kind(_frames(lambda n: np.arange(n) // 2 * 2), ("repeating", "frozen")),
    "every 20th frame 20 times": Kind(_frames(lambda n: np.arange(n) // 20 * 20), ("repeating", "frozen")),
    "last frames ten late": Kind(_frames(lambda n: np.maximum(np.arange(n) - 10, 0)), ("repeating", "frozen")),
    "frames shuffled": Kind(_frames(_shuffled), ("order",), "order"),
    "frames reversed": Kind(_frames(lambda n: np.arange(n)[::-1]), ("reverse order", *AXES), "travel"),
    "one pass nine times": Kind(_passes(9, 0.0), ("copies",)),
    "one pass nine times, dithered": Kind(_passes(9, 1e-4), ("copies",)),
    **{f"mean over {n} columns": Kind(_smoothed(uniform_filter1d, n), ("averaged", "filter")) for n in (3, 5, 9)},
    **{f"median over {n} columns": Kind(_median(n), ("filter",)) for n in (5, 11)},
    **{f"median of returns over {n} columns": Kind(_median_of_returns(n), FILTERED) for n in (3, 7)},
    "last range held over 2 columns": Kind(_continued(2, held=True), FILTERED),
    "last slope continued over 5 columns": Kind(_continued(5, held=False), FILTERED),
    **{f"{n} blind columns at the end": Kind(_blind(n), BLIND) for n in (4, 8)},
    "12 bands of 8 blind columns": Kind(_blind(8, bands=12), BLIND),
    "3 columns lost at every end": Kind(_trimmed(3), ("end", "edge"), "end"),
    **{f"z rounded to {step} mm": Kind(_rounded(0, step), ("rounded",)) for step in (0.1, 0.02)},
    **{f"x rounded to {step} mm": Kind(_rounded(step, 0), ("rounded",)) for step in (0.1, 0.2)},
    "Gauss over 1 column": Kind(_smoothed(gaussian_filter1d, 1.0), ("averaged", "filter")),
    "Gauss over 3 columns": Kind(_smoothed(gaussian_filter1d, 3.0), ("averaged", "filter")),
    "Savitzky-Golay over 7 columns": Kind(_savitzky_golay(7), ("averaged", "filter")),
    **{f"mean over {n} frames": Kind(_frame_mean(n), ("averaged", "filter")) for n in (3, 15)},
    "every 2nd column returns": Kind(_every(2, absent=False), ("column",)),
    "every 8th column returns": Kind(_every(8, absent=False), ("column",)),
    "every 8th column delivered": Kind(_every(8, absent=True), ("column",)),
    "lost returns interpolated": Kind(_filled(), ("interpolated", "filled")),
    "profile x mirrored": Kind(_mirrored(x=True, z=False), AXES, "flange"),
    "profile z mirrored": Kind(_mirrored(x=False, z=True), AXES, "flange"),
    "profile x and z mirrored": Kind(_mirrored(x=True, z=True), AXES, "flange"),
    "view ends in the part, left": Kind(_cropped(1, 0.5, absent=True), ("view", "column", "seen", "bevel")),
    "view ends in the part, right": Kind(_cropped(-1, 0.5, absent=True), ("view", "column", "seen", "bevel")),
    "window ends in the part, left": Kind(_cropped(1, 0.5), ("view", "column", "seen", "bevel"), "window"),
    "window ends in the part, right": Kind(_cropped(-1, 0.5), ("view", "column", "seen", "bevel"), "window"),
    "positions rounded to 1 mm": Kind(_position(_steps_of(1.0)), ("poses", "rounded"), "digits"),
    **{
        f"quaternions rounded to {step}": Kind(_quaternion(_as_read(step)), (*ORIENTATION, "rounded", "norm"))
        for step in (0.001, 0.01)
    },
    "poses noisy by 0.3 mm": Kind(_noisy(0.3, 0.0), ("poses",), "poses"),
    "poses noisy by 0.3 deg": Kind(_noisy(0.0, 0.3), ("poses", "orientation"), "flange"),
    **{f"clock {n} % fast": Kind(_drifting_clock(n / 100), ("clock",), "flange") for n in (1, 10)},
    "lost frames not stamped": Kind(_evenly_stamped, ("clock", "order", "stamp"), "flange"),
    **{f"second pass {mm:g} mm off": Kind(_second_pass_off(mm), ("passes",)) for mm in (0.05, 0.3, 5.0)},
    "clock 20 ms late": Kind(_clock(0.02), ("clock",), "clock"),
    "clock 0.5 s late": Kind(_clock(0.5), ("clock",), "clock"),
}
