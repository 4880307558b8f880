"""The last returns of a face before its free end, frame by frame: how deep they lie under the face's line."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, UPPER_SURFACE, Cloud
from workbench.edge.end_templates import LAST
from workbench.edge.faces import TrackedFaces
from workbench.geometry.blocks import as_input, evenly
from workbench.geometry.chains import FaceLines
from workbench.geometry.end_face import BROKEN_MM
from workbench.kernels import kernel
from workbench.units import Bool, Float, Float32, Int, Shaped

SAMPLE_FRAMES, LEAST_FRAMES = 480, 20  # of a pass, evenly over it; with fewer its depths tell nothing
LEAST_GROUPS, DEEP_MM = 5, 3.0  # columns pooled one by one, then by tenths, up to this far from the end
DEPTH_U_MM, PATTERN_PLACES = 0.0005, 9  # of a mean depth; how many places of a face a sensor has off apart
STEP_MM = 0.15  # between columns of one surface


@dataclass(frozen=True, slots=True, eq=False)
class FaceRim:
    """The free end of a face in each of N frames."""

    face: FaceLines
    side: Shaped[Float, " N"]  # +1 or -1: the end lies towards rising side * x
    end_x_mm: Shaped[Float, " N"]  # x of the last return on the face's line
    step_mm: Shaped[Float, " N"]  # between columns, along the face
    sense: Shaped[Float, " N"]  # +1: z counts away from the sensor
    on_line: bool  # where that return's ray meets the line, the end is told; False: at the return
    left_out_mm: float = 0.0  # of the face before that end, along x, that its line does not rest on
    adjacent: FaceLines | None = None  # the face that it meets in a corner
    upper: FaceLines | None = None  # the surface beyond that one, square to the face

    def recession(self, frames: Int) -> Float:
        """How fast the face falls away from the sensor towards its end, by x; negative: seen from beyond the end."""
        return np.asarray(self.sense[frames] * self.side[frames] * self.face.slope[frames])


def root_rim(tracked: TrackedFaces, left_out_mm: float = 0.0) -> FaceRim:
    """The lower end of a milled edge's root face; left_out_mm: of it, along x, where its line was fitted elsewhere."""
    root, bevel = tracked.faces[ROOT_FACE], tracked.faces[BEVEL_FACE]
    sense = np.sign(tracked.side * (root.slope - bevel.slope))  # they meet in a convex corner
    return FaceRim(
        root,
        tracked.side,
        tracked.root_end[:, 0],
        tracked.root_end[:, 2],
        sense,
        True,
        left_out_mm,
        bevel,
        tracked.faces[UPPER_SURFACE],
    )


def is_free_end(tracked: TrackedFaces) -> Bool:
    """Frames (N,) in which nothing but its own edge ends the root face.

    A return between it and what lies behind it is mostly far off its line; one that is not may be of a rounding.
    """
    return tracked.seen & ~(tracked.end_is_cut | tracked.end_is_corner)


def sampled(frames: Bool) -> Int:
    """Some of the frames (N,), evenly, where there are many: more of them say no more of the end's form."""
    at = np.flatnonzero(frames)
    return np.asarray(at[evenly(at.size, SAMPLE_FRAMES)])


def end_groups(columns: float) -> Float:
    """Limits (g + 1,), in columns before the last return, of what is pooled: LAST columns each alone, then tenths."""
    if columns < LAST:  # beyond them lies the next face
        return np.arange(max(math.floor(columns), 1) + 1.0)
    wide = max(1.0, (columns - LAST) / 10.0)
    return np.concatenate([np.arange(LAST), np.arange(LAST, columns + 1e-9, wide)])


def last_returns(
    cloud: Cloud, rim: FaceRim, frames: Int, edges: Shaped[Float, " g1"]
) -> tuple[Shaped[Float, "f g"], Shaped[Float, "f 2"]]:
    """Mean depths of frames (f,) under their lines, mm, between `edges` columns before the last return.

    And how many columns the returns go on beyond those on the line, and how deep the last of these lies.
    """
    face = rim.face
    line = [face.x_mean, face.z_mean, face.slope, rim.side, rim.end_x_mm, rim.step_mm, rim.sense]
    known = as_input(np.stack([of[frames] for of in line], axis=1))
    x, z, keep = (as_input(of[frames]) for of in (cloud.x_mm, cloud.z_mm, cloud.keep))
    depth, last = np.full((frames.size, edges.size - 1), np.nan), np.full((frames.size, 2), np.nan)
    _last_returns(x, z, keep, known, as_input(edges), depth, last)
    return _between(depth), last


def _between(depth: Float) -> Float:
    """Depths (f, g) with what a frame does not show between two groups that it does: its returns may lie at the limits
    of the groups, one by one on this side or that.
    """
    mean = 0.5 * (depth[:, :-2] + depth[:, 2:])
    return np.concatenate([depth[:, :1], np.where(np.isnan(depth[:, 1:-1]), mean, depth[:, 1:-1]), depth[:, -1:]], 1)


def pattern_noise(
    mean: Shaped[Float, " g"], noise: Shaped[Float, "g g"], edges_mm: Shaped[Float, " g1"]
) -> Shaped[Float, "g g"]:
    """Covariance, mm^2, of what a sensor does to mean depths of many frames: by what lies off a bow inside the face.

    noise: their covariance by what differs between frames, which that scatter holds, too.
    """
    middle = 0.5 * (edges_mm[1:] + edges_mm[:-1])
    t = 2.0 * middle / edges_mm[-1] - 1.0
    shapes = np.stack([np.ones_like(t), t, t * t - 1.0 / 3.0], axis=1)
    inner = np.arange(t.size) >= min(LAST, t.size - 4)
    weight = np.sqrt(np.diff(edges_mm)[inner])
    fit = np.linalg.lstsq(shapes[inner] * weight[:, None], mean[inner] * weight, rcond=None)[0]
    left = mean[inner] - shapes[inner] @ fit
    pattern = float((left**2 - np.diag(noise)[inner]).sum()) / max(int(inner.sum()) - 3, 1)
    far = np.abs(middle[:, None] - middle[None, :]) / (edges_mm[-1] / PATTERN_PLACES)
    return np.asarray(max(pattern, 0.0) * np.exp(-far) + DEPTH_U_MM**2 * np.eye(t.size))


@kernel
def _one_surface(along: Float, below: Float, order: Int, step: float, fallen: float) -> tuple[float, float]:
    """How many returns go on in one surface, without gap of columns or jump, from an end `fallen` deep; how far."""
    reach, level, further = 0.0, fallen, 0
    for j in order:
        if along[j] - reach > 2.2 * step or abs(below[j] - level) > STEP_MM + 2.0 * level:
            break
        further += 1
        reach, level = along[j], max(below[j], 0.0)
    return float(further), reach


@kernel
def _group_of(place: float, edges: Float) -> int:
    """Number of the group between `edges` (g + 1,) in which a place lies; -1 before them."""
    group = -1
    while group + 1 < edges.size and edges[group + 1] <= place:
        group += 1
    return group


@kernel
def _last_returns(x: Float32, z: Float32, keep: Bool, known: Float, edges: Float, depth: Float, last: Float) -> None:
    """Fill depth (f, g): mean depths under the line of f frames' returns, by how many columns they lie before the last.

    known (f, 7): x and z of the line's middle, its slope, side, end, step and sense of a FaceRim. last (f, 2): how many
    lie beyond those on the line, and how deep the last of these lies under it.
    """
    columns = x.shape[1]
    along, below, order = np.empty(columns), np.empty(columns), np.empty(columns, np.int64)
    for i in range(x.shape[0]):
        middle_x, middle_z, slope, side = known[i, 0], known[i, 1], known[i, 2], known[i, 3]
        end, step, sense = known[i, 4], known[i, 5], known[i, 6]
        lean = math.sqrt(1.0 + slope * slope)
        outside = 0
        for j in range(columns):
            xj, zj = np.float64(x[i, j]), np.float64(z[i, j])
            along[j] = side * (xj - end) * lean
            below[j] = (zj - middle_z - slope * (xj - middle_x)) / lean * sense
            if keep[i, j] and abs(along[j]) <= 1e-6:
                last[i, 1] = below[j]
            if keep[i, j] and 1e-6 < along[j] < BROKEN_MM:
                k = outside
                while k > 0 and along[order[k - 1]] > along[j]:
                    order[k] = order[k - 1]
                    k -= 1
                order[k] = j
                outside += 1
        # Where the end is told on a rounding, what falls to it and what follows it lie deep.
        fallen = last[i, 1] if last[i, 1] > 0.0 else 0.0
        deep = STEP_MM + fallen
        last[i, 0], reach = _one_surface(along, below, order[:outside], step, fallen)
        total, count = np.zeros(edges.size - 1), np.zeros(edges.size - 1)
        for j in range(columns):
            on_line = -edges[-1] * step < along[j] <= 1e-6
            on_line &= -STEP_MM < below[j] < (deep if along[j] > -LAST * step else STEP_MM)
            if keep[i, j] and (on_line or 1e-6 < along[j] <= reach):
                group = _group_of((reach - along[j]) / step + 0.5, edges)
                if 0 <= group < total.size:
                    total[group] += below[j]
                    count[group] += 1.0
        for group in range(total.size):
            if count[group] > 0.0:
                depth[i, group] = total[group] / count[group]
