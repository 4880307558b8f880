"""The faces of the edge in every frame: key frames are segmented from scratch, the frames between them followed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, UPPER_SURFACE, Cloud
from workbench.checks.judge import returns_cause
from workbench.checks.sensor import column_pitch_mm
from workbench.checks.window import averaged_columns
from workbench.edge.identify import CONTEXT, Candidate, candidates, contradicted, readings_apart, vote, votes
from workbench.edge.raw_direction import across_the_edge
from workbench.errors import InputError
from workbench.geometry import tracking
from workbench.geometry.along import by_pass
from workbench.geometry.blocks import in_order
from workbench.geometry.chains import FaceLines, noise_sigma, straight_faces
from workbench.geometry.medians import median
from workbench.units import DEG, AnyArray, Bool, Float, Float32, Int, Shaped

MOST_CONTRADICTED = 0.2  # of the key frames: sound recordings have 0.04 at most, a view that ends on the part 0.58
FEW_KEY_FRAMES, KEY_FRAMES = 24, 120  # a pass, where they agree, and where not; the faces are followed between them
NEIGHBOURS = 8  # frames to each side
KEY_SPACING = 5  # frames between key frames at the least
WORSE = 0.5  # than the median of the key frames' scores: of one whose faces second returns cut short or bend
FIRST_SIGMA_MM, NEAR_LINE_MM = 0.03, 0.6  # range noise before it is known; returns this near may be a face's
TOGETHER = 0.9  # of the mean of unit directions, that do not turn along the edge
MAX_LINES = 64  # straight lines kept of one profile
LABELS = np.array([UPPER_SURFACE, BEVEL_FACE, ROOT_FACE, LOWER_SURFACE])  # in the order of geometry.tracking


Readings: TypeAlias = tuple[Int, list[list[Candidate]]]  # numbers of key frames within a pass, and what each may show


@dataclass(frozen=True, slots=True, eq=False)
class TrackedFaces:
    """What following the faces found, for all N frames of a cloud."""

    faces: dict[int, FaceLines]  # by label
    seen: Shaped[Bool, " N"]  # root face and bevel face both found
    side: Shaped[Float, " N"]  # +1 or -1: the lower side lies towards rising side * x; NaN in a pass without the edge
    # x, z (profiler frame, mm) and step along the root face a column (mm), at its last return
    root_end: Shaped[Float, "N 3"]
    end_column: Shaped[Int, " N"]  # that return's column, counted towards the lower side
    end_is_mixed: Shaped[Bool, " N"]  # the next column saw both the root face and what lies behind it
    end_is_cut: Shaped[Bool, " N"]  # the field of view, or something in front, ends the root face: its size is not seen
    end_is_burred: Shaped[Bool, " N"]  # the surface rises out of the root face beyond its end: that turns its line
    end_is_corner: Shaped[Bool, " N"]  # the lower surface is seen and joins the root face; or what the plate lies on
    lies_on: Shaped[Bool, " N"]  # that is what the plate lies on
    labels: Shaped[AnyArray, "N M"]  # uint8
    range_sigma_mm: Shaped[Float, "N 4"]  # range noise of each face (order of LABELS) in the frame's pass
    readings_apart: float = math.inf  # in score, by which another reading of the profiles fits worse, in the worst pass


def find_faces(
    cloud: Cloud,
    root_nominal_mm: float,
    bevel_nominal_deg: float,
    rim_mm: float = 0.0,
    upper_side: Sequence[float] | None = None,
) -> TrackedFaces:
    """Find root face and bevel face, and the surfaces that join them, in every frame of a milled edge.

    rim_mm: how much of the root face's free end, along x, is rounded: its line leaves that out.
    upper_side: (3,) in the base, from the plate's lower to its upper surface; None: the views tell.

    Raises InputError where no pass shows a root face with a bevel face.
    """
    n, columns = cloud.x_mm.shape
    sums = np.zeros((n, 4, 8))
    end = np.full((n, 5), np.nan)
    seen = np.zeros(n, bool)
    lower = np.zeros(n, bool)
    side_of = np.full(n, np.nan)
    labels = np.zeros((n, columns), np.uint8)
    sigma = np.full((n, 4), np.nan)
    rising, apart = np.ones(n), math.inf
    passes = [_as_slice(frames) for frames in by_pass(cloud.pass_index)]
    nominal = root_nominal_mm, bevel_nominal_deg * DEG
    up = None if upper_side is None else across_the_edge(cloud, upper_side, "edge.segment.upper_side")
    first = [_readings(cloud, frames, nominal, up, FEW_KEY_FRAMES) for frames in passes]
    common = _common_up(cloud, passes, first)
    for frames, read in zip(passes, first, strict=True):
        named = labels[frames]  # a view, where the frames lie together
        found = _find_pass(cloud, frames, read, nominal, rim_mm, up, common, named)
        if found is not None:
            side_of[frames], rising[frames], tracked, worse = found
            apart = min(apart, worse)
            sums[frames], end[frames], seen[frames], sigma[frames], lower[frames] = tracked
            if not isinstance(frames, slice):
                labels[frames] = named
    if seen.sum() < 2:
        raise InputError(
            cloud.source,
            "no edge in view: expected a root face next to a bevel face of "
            f"{bevel_nominal_deg:g} deg in at least two frames (a raw edge has none)"
            + ("" if upper_side is None else ", with the bevel towards upper_side"),
        )
    if not (seen & ~((end[:, 4] == tracking.CUT) & ~lower)).sum() > 1:
        out = "lower edge not in view: the root face runs out of the field of view, or behind something, in every frame"
        raise InputError(cloud.source, returns_cause(cloud.x_mm, cloud.z_mm) or out)
    faces = {int(label): face_lines(sums[:, f], seen) for f, label in enumerate(LABELS)}
    lower &= seen & (faces[LOWER_SURFACE].count > 0)
    lies_on = lower & _turns_up(faces)
    end[~seen] = np.nan
    outward = np.where(seen, end[:, 3] * rising, 0).astype(np.int64)
    return TrackedFaces(
        faces,
        seen,
        side_of,
        end[:, :3],
        outward,
        end[:, 4] == tracking.MIXED,
        _among_such((end[:, 4] == tracking.CUT) & ~lower, seen, cloud.pass_index),
        _among_such((end[:, 4] == tracking.BURR) & ~lies_on, seen, cloud.pass_index),
        lower,
        lies_on,
        labels,
        sigma,
        apart,
    )


def _turns_up(faces: dict[int, FaceLines]) -> Bool:
    """Frames (N,) in which what joins the root face's lower end turns the other way than bevel and root face do."""
    bevel, root, lower = (np.arctan(faces[one].slope) for one in (BEVEL_FACE, ROOT_FACE, LOWER_SURFACE))
    return np.asarray((lower - root) * (root - bevel) < 0.0)


def _among_such(flagged: Bool, seen: Bool, pass_index: Int) -> Bool:
    """Frames (N,) that are flagged, or of whose neighbours most are.

    Where something covers the root face's end, a frame that does not show it as such (a mixed pixel, a stray or a lost
    return) shows a false end all the same.
    """
    out = flagged.copy()
    for mine in by_pass(pass_index, seen) if flagged.any() else ():
        near = np.ones(min(2 * NEIGHBOURS + 1, mine.size))
        share = np.convolve(flagged[mine], near, "same") / np.convolve(np.ones(mine.size), near, "same")
        out[mine] |= share > 0.5
    return out


def _as_slice(frames: Int) -> slice | Int:
    """The frames of a pass, as a slice where they lie together (a view instead of a copy)."""
    if frames[-1] - frames[0] + 1 == frames.size:
        return slice(int(frames[0]), int(frames[-1]) + 1)
    return frames


def _find_pass(
    cloud: Cloud,
    frames: slice | Int,
    first: Readings,
    nominal: tuple[float, float],
    rim_mm: float,
    up: Float | None,
    common: _CommonUp,
    labels: AnyArray,
) -> tuple[float, float, tuple[AnyArray, ...], float] | None:
    """Side and rise of a pass, its faces followed, labels (n, M) filled in, `readings_apart`; None: no edge.

    The `first` key frames are enough where all of them agree and no stretch between them is lost. nominal: mm, rad.
    """
    for most in (FEW_KEY_FRAMES, KEY_FRAMES):
        keys, readings = first if most < KEY_FRAMES else _readings(cloud, frames, nominal, up, most)
        agreed = _rising(readings, cloud.base_from_profiler[frames][keys], common.direction)
        found = vote(agreed)
        if found is not None:
            _refuse_contradicted(cloud, readings, found)
        choice = None if found is None else _agreed(keys, agreed, found)
        if found is None or choice is None or (most < KEY_FRAMES and choice[0].size < keys.size):
            continue
        at, states, side = choice
        tracked = _follow_pass(cloud, frames, at, states, side, rim_mm, labels)
        seen = np.flatnonzero(np.concatenate([[True], tracked[2], [True]]))
        if most == KEY_FRAMES or np.diff(seen).max() <= tracking.LOST_AFTER:
            return (
                side,
                side * (1.0 if rises_with_column(cloud.x_mm[frames], cloud.keep[frames], at) else -1.0),
                tracked,
                min(readings_apart(agreed, found), common.apart),
            )
    labels[:] = 0
    return None


def _readings(cloud: Cloud, frames: slice | Int, nominal: tuple[float, float], up: Float | None, most: int) -> Readings:
    """Key frames of a pass, and what each may show with the bevel where the upper side is, if that is known."""
    keys, readings = key_readings(cloud, frames, *nominal, most)
    return keys, _rising(readings, cloud.base_from_profiler[frames][keys], up)


class _CommonUp(NamedTuple):
    """Where the root face leads to the bevel, in the base, by which all passes together read best."""

    direction: Float | None = None  # (3,); None: passes read alike by themselves, or it turns along the edge
    apart: float = math.inf  # in score of a key frame, by which they read worse the other way


def _common_up(cloud: Cloud, passes: Sequence[slice | Int], first: Sequence[Readings]) -> _CommonUp:
    """What one pass leaves open, another decides."""
    read = [(one, cloud.base_from_profiler[frames][keys]) for frames, (keys, one) in zip(passes, first, strict=True)]
    ups = np.array([_mean_up(*one) for one in read])
    ups = ups[np.linalg.norm(ups, axis=1) > TOGETHER]
    if (ups @ ups.T > 0.0).all():
        return _CommonUp()
    support = np.array([[_most_votes(_rising(*one, up)) for one in read] for up in [*ups, None]])
    total = support[:-1].sum(axis=1)
    best = int(total.argmax())
    if (support[-1] - support[best] > [CONTEXT * len(one) for one, _ in read]).any():  # it turns along the edge
        return _CommonUp()
    other = total[ups @ ups[best] < 0.0].max(initial=0.0)
    return _CommonUp(ups[best], float(total[best] - other) / sum(len(one) for one, _ in read))


def _most_votes(readings: list[list[Candidate]]) -> float:
    return max(votes(readings).values(), default=0.0)


def _mean_up(readings: list[list[Candidate]], poses: Float) -> Float:
    """Mean (3,) of the root face's unit directions towards the bevel, in the base, as a pass reads it by itself."""
    choice = vote(readings)
    fitting = [[c for c in frame if (c.side, c.sense) == choice] for frame in readings]
    best = [(pose, min(frame, key=lambda c: c.score)) for pose, frame in zip(poses, fitting, strict=True) if frame]
    return np.asarray(np.zeros(3) + sum(pose[:3, 0:3:2] @ c.upwards for pose, c in best) / max(len(best), 1))


def _rising(readings: list[list[Candidate]], base_from_profiler: Float, up: Float | None) -> list[list[Candidate]]:
    """Those readings of frames (k, 4, 4) by which the bevel lies where the upper side does, `up` (3,) in the base."""
    if up is None:
        return readings
    along = base_from_profiler[:, :3, 0:3:2].swapaxes(1, 2) @ up
    return [[c for c in frame if c.rises(towards)] for frame, towards in zip(readings, along, strict=True)]


def key_readings(
    cloud: Cloud, frames: slice | Int, root_nominal_mm: float, bevel_nominal: float, most: int = KEY_FRAMES
) -> tuple[Int, list[list[Candidate]]]:
    """Numbers (within the pass) of its key frames, `most` at the most, and every plausible reading of each."""
    x, z, keep = cloud.x_mm[frames], cloud.z_mm[frames], cloud.keep[frames]
    count = max(2, min(most, x.shape[0] // KEY_SPACING))
    about = np.linspace(0, x.shape[0] - 1, count).round().astype(np.int64)
    keys = np.union1d(about, x.shape[0] - 1 - about)  # the same from either end
    rises = rises_with_column(x, keep, keys)
    chains = in_order(lambda k, _: _chain(x[keys[k]], z[keys[k]], keep[keys[k]], rises), keys.size, 1)
    return keys, [list(candidates(chain, cut, root_nominal_mm, bevel_nominal)) for chain, cut in chains]


def rises_with_column(x: Float32, keep: Bool, keys: Int) -> bool:
    """Does x rise with the column number (over the given frames)?"""
    with np.errstate(invalid="ignore"):
        steps = np.diff(np.where(keep[keys], x[keys], np.nan), axis=1)
    return bool(np.nansum(np.sign(steps)) >= 0)


def _chain(x: Float32, z: Float32, keep: Bool, rises: bool) -> tuple[Float, Bool]:
    """The straight faces (k, 7) of a frame, in order of rising x, and cut (2,).

    `cut`: the frame's first (last) column returns, so that the field of view ends its first (last) face.
    """
    if not rises:
        x, z, keep = x[::-1], z[::-1], keep[::-1]
    cut = np.array([keep[:2].any(), keep[-2:].any()])
    return straight_faces(x[keep].astype(np.float64), z[keep].astype(np.float64))[:MAX_LINES], cut


def _refuse_contradicted(cloud: Cloud, readings: list[list[Candidate]], choice: tuple[int, int]) -> None:
    share = contradicted(readings, choice)
    if share > MOST_CONTRADICTED:
        raise InputError(
            cloud.source,
            f"frames do not agree which face is the root face: in {100 * share:.0f} % of those looked at, other faces "
            "than in most are root face and bevel face; does the view end on the part? widen or shift the view",
        )


def _agreed(keys: Int, readings: list[list[Candidate]], choice: tuple[int, int]) -> tuple[Int, Float, int] | None:
    """Key frames that show the edge as the pass as a whole does, their states (k, 4, 4) and the side; None: no edge."""
    at, best = [], []
    for key, frame in zip(keys, readings, strict=True):
        fitting = [c for c in frame if (c.side, c.sense) == choice]
        if fitting:
            at.append(int(key))
            best.append(min(fitting, key=lambda c: c.score))
    states, alone = np.array([_state(one) for one in best]), np.array([one.alone for one in best])
    good = alone < median(alone) + WORSE
    if good.sum() < 2:
        return None
    return np.array(at)[good], states[good], choice[0]


def _state(c: Candidate) -> Float:
    """A reading as the kernel's state: rows (slope, offset, seen, free end) in the order of geometry.tracking."""
    rows = [
        (0.0, 0.0, 0.0, 0.0) if line is None else (line[0], line[1], 1.0, line[2])
        for line in (c.upper, c.bevel, c.root, c.lower)
    ]
    return np.array(rows)


def _follow_pass(
    cloud: Cloud, frames: slice | Int, keys: Int, states: Float, side: int, rim_mm: float, labels: AnyArray
) -> tuple[AnyArray, ...]:
    """Follow the faces through one pass: first its key frames alone, for the noise, then all of it."""
    x, z, keep = cloud.x_mm[frames], cloud.z_mm[frames], cloud.keep[frames]
    beyond = states[:, [0, 3], 2]
    common = beyond.mean(axis=0) > 0.5  # upper and lower surface: seen in most key frames, or not at all
    fitting = (beyond >= common).all(axis=1)
    keys, states = keys[fitting], states[fitting].copy()
    states[:, [0, 3], 2] = common
    sigma = _first_sigmas(x[keys], z[keys], keep[keys], states)
    wide = averaged_columns(cloud.checks)
    mean = wide * column_pitch_mm(x[keys]) if wide > 1.0 else 0.0
    for chosen in (keys, np.arange(x.shape[0])):
        n = chosen.size
        sums, end = np.zeros((n, 4, 8)), np.full((n, 5), np.nan)
        seen, whole = np.zeros(n, bool), n == x.shape[0]
        named = labels if whole else np.empty((n, x.shape[1]), np.uint8)
        grid = tracking.Profiles(*((x, z, keep) if whole else (x[chosen], z[chosen], keep[chosen])))
        known = tracking.KeyFrames(keys if whole else np.arange(n), states)
        faces = tracking.KnownFaces(float(side), sigma, LABELS, rim_mm, mean, math.ceil(0.5 * (wide - 1.0)))
        tracking.follow(grid, known, faces, tracking.Followed(sums, end, seen, named))
        if not whole:
            sigma = tracking.face_sigmas(sums, seen)
    return sums, end, seen, np.tile(sigma, (n, 1)), np.full(n, common[1])


def _first_sigmas(x: Float32, z: Float32, keep: Bool, states: Float) -> Float:
    """Range noise (4,) of each face by what neighbouring returns differ: ghosts and bows hardly count.

    x, z, keep (k, M): key frames, states (k, 4, 4): their lines. At most FIRST_SIGMA_MM, at least a third of it.
    """
    out = np.full(4, FIRST_SIGMA_MM)
    for f in np.flatnonzero(states[0, :, 2] > 0):
        off = z - states[:, f, :1] * x - states[:, f, 1:2]
        found = [noise_sigma(r[on]) for r, on in zip(off, keep & (np.abs(off) < NEAR_LINE_MM), strict=True)]
        out[f] = np.clip(np.median(found), FIRST_SIGMA_MM / 3.0, FIRST_SIGMA_MM)
    return out


def face_lines(sums: Float, seen: Bool) -> FaceLines:
    """The kernel's sums (N, 8) of one face as FaceLines."""
    here = seen & (sums[:, tracking.COUNT] >= 3)
    value = np.where(here[:, None], sums, np.nan)
    columns = np.where(here[:, None], sums[:, [tracking.FIRST, tracking.LAST]], -1).astype(np.int64)
    return FaceLines(
        np.where(here, sums[:, tracking.COUNT], 0).astype(np.int64),
        value[:, tracking.X_MEAN],
        value[:, tracking.Z_MEAN],
        value[:, tracking.SXX],
        value[:, tracking.SXZ],
        value[:, tracking.SZZ],
        columns,
    )
