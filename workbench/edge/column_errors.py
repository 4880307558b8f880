"""What a sensor errs by its columns, told from the form of the faces by how these move in the view.

A face's form goes with the face, the errors stay in their columns, the same in all frames: least squares explain by
both what straight lines leave of the face (docs/method.md, eq. (11d)). The form may be anything; the errors are an
Ornstein-Uhlenbeck process over the columns, whose strength and length are weighed by their restricted likelihood
(Harville, JASA 72 (1977), 320). Their mean is taken off the ranges, what stays open of them turns the faces' lines.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter

from workbench.artefacts import Cloud
from workbench.edge.last_returns import SAMPLE_FRAMES
from workbench.geometry.along import by_pass
from workbench.geometry.blocks import evenly
from workbench.geometry.chains import FaceLines
from workbench.geometry.course import shares
from workbench.units import AnyArray, Bool, Float, Float32, Int, Shaped

LEAST_RETURNS, MOSTLY, FAR = 6, 0.5, 4.0  # of a face in a frame; share of frames that show it; standard deviations
PLACES, PARTS = 96, 6  # of a face, columns side by side are one; parts of a pass, each with a form of its own
LIKE_PRIOR = 1.5  # mean square of errors over their process's: real ones have 0.5 to 0.9, what a form undoes 4
SMOOTH, MOVES = 15, 2  # frames that tell where a face ends; columns by which both ends move, or nothing is told
CHANGES = (
    3.0  # frames whose residuals count as one: the form of a rough face changes within its part, others have 1 to 2
)
FORM, BENT_MM = 3.0, 0.0005  # standard deviation of a place of a face, in those of its returns; of a frame's bow
# Share of the sensors that err so: small, since no model of a face's form is quite as free as faces are, and what does
# not show is none. How strongly, mm, the rarer beyond what good ones do; over how many columns alike.
ERRS, USUAL_MM, ERRORS_MM = 1e-18, 0.001, np.geomspace(5e-4, 0.05, 9)
LENGTHS = np.array([0.5, 2.0, 8.0, 32.0, 128.0, 512.0])
SMOOTH_COLUMNS, SMOOTH_MM = 20.0, 0.015  # over more columns an error is a matter of linearity: no sensor errs by more
UNLIKELY, LEAST_MM = 1e-5, 1e-4  # shares, and errors, that count for nothing
NUGGET = 1e-9  # for rounding
LEAST_REPORTED_MM = 0.001
TAKEN_OFF = "The sensor errs by its columns, by {:.0f} um rms in all frames: that is taken off, its rest is in u."


class Linearity(NamedTuple):
    """The sensor's own error over its columns, a Matern process (nu = 3/2): rms and length, mm, a quarter of a wave's.

    Distortion is smooth: over a face shorter than that it is a slope (Rasmussen and Williams, Gaussian Processes for
    Machine Learning, 2006, eq. 4.17). What is not declared is taken for half a micrometre, the least that a face's own
    residuals cannot disprove, and for a wave as long as a small field of view.
    """

    rms_mm: float = 0.0005
    length_mm: float = 6.0

    def covariance(self, apart_mm: Float) -> Float:
        """Of the errors of two places so far apart, mm^2."""
        apart = math.sqrt(3.0) * np.abs(apart_mm) / self.length_mm
        return np.asarray(self.rms_mm**2 * (1.0 + apart) * np.exp(-apart))


def declared_linearity(sensor: Path | None) -> Linearity:
    """The linearity that a `sensor.json` declares; the default where there is none, or it says nothing of it."""
    from workbench.result_files import SensorFile  # pydantic: loaded when there is something to read

    declared = SensorFile() if sensor is None else SensorFile.read(sensor)
    usual = Linearity()
    return Linearity(
        usual.rms_mm if declared.linearity_mm is None else declared.linearity_mm,
        declared.linearity_length_mm or usual.length_mm,
    )


class ColumnErrors(NamedTuple):
    """The errors of M columns along the range where they see a face, and what is open of them at n nodes."""

    mean_mm: Shaped[Float, " M"]
    node: Shaped[Int, " M"]
    covariance: Shaped[Float, "n n"]  # mm^2

    def common(self, one: Float, other: Float) -> Float:
        """Covariances (k, p, q), mm^2, of what is open at columns (k, p) and (k, q)."""
        last = self.node.size - 1
        at, there = (self.node[of.round().astype(np.int64).clip(0, last)] for of in (one, other))
        return np.asarray(self.covariance[at[:, :, None], there[:, None, :]])


def without_column_errors(
    cloud: Cloud, labels: AnyArray, faces: Mapping[int, FaceLines], sensor: Linearity
) -> tuple[Cloud, dict[int, ColumnErrors]]:
    """The cloud less what the sensor errs by its columns, itself where that is hardly anything, and the errors."""
    errors = column_errors(cloud, labels, faces, sensor)
    if max((float(np.abs(one.mean_mm).max()) for one in errors.values()), default=0.0) < LEAST_MM:
        return cloud, errors
    z_mm = cloud.z_mm.copy()
    for label, one in errors.items():
        z_mm -= np.where(labels == label, one.mean_mm, 0.0).astype(z_mm.dtype)
    return replace(cloud, z_mm=z_mm), errors


def notes_of(errors: Mapping[int, ColumnErrors]) -> tuple[str, ...]:
    """What was taken off, in words; (): hardly anything."""
    rms_mm = [float(np.std(one.mean_mm[one.mean_mm != 0.0])) for one in errors.values() if one.mean_mm.any()]
    most_mm = max(rms_mm, default=0.0)
    return (TAKEN_OFF.format(1000.0 * most_mm),) if most_mm > LEAST_REPORTED_MM else ()


def column_errors(
    cloud: Cloud, labels: AnyArray, faces: Mapping[int, FaceLines], sensor: Linearity
) -> dict[int, ColumnErrors]:
    """The errors of the columns beyond the `sensor`'s, for each face that most frames show; labels (N, M).

    Errors depend on range and incidence: each face has its own, as strong and alike as those of the others.
    """
    few = [mine[evenly(mine.size, SAMPLE_FRAMES)] for mine in by_pass(cloud.pass_index)]
    frames = np.concatenate(few)
    begins = np.cumsum([0, *(part.size for mine in few for part in np.array_split(mine, PARTS))])
    equations = {}
    for label, face in faces.items():
        off = cloud.z_mm[frames] - face.z_at(frames, cloud.x_mm[frames])
        on = (labels[frames] == label) & cloud.keep[frames] & np.isfinite(off)
        count = on.sum(axis=1)
        if (count >= LEAST_RETURNS).mean() > MOSTLY:
            wide = math.ceil(float(np.median(count)) / PLACES)
            equations[label] = _normal_equations(cloud.x_mm[frames], off, on, begins, sensor, wide)
    every = {label: _looks(one) for label, one in equations.items()}
    looks = {label: look for label, look in every.items() if look.size < LIKE_PRIOR}
    possible = (LENGTHS[:, None] < SMOOTH_COLUMNS) | (ERRORS_MM < SMOOTH_MM)
    rarer = np.where(possible, np.minimum(1.0, USUAL_MM / ERRORS_MM), 0.0)
    with np.errstate(divide="ignore"):
        prior = np.log(ERRS * rarer / rarer.sum())
    log = sum((look.log for look in looks.values()), prior)
    share = shares(np.append(log.ravel(), math.log1p(-ERRS)))[:-1].reshape(prior.shape)
    return {label: _mean(equations[label], look, share) for label, look in looks.items()}


def _side_by_side(x: Float32, off: Float, on: Bool, wide: int) -> tuple[Float32, Float, Bool]:
    """Means of so many columns side by side in frames (f, M), where most of them are on the face."""
    if wide == 1:
        return x, off, on
    begins = np.arange(0, on.shape[1], wide)
    count = np.add.reduceat(on, begins, axis=1, dtype=np.int64)
    means = [np.add.reduceat(np.where(on, one, 0.0), begins, axis=1) / count.clip(1) for one in (x, off)]
    return means[0], means[1], count > MOSTLY * np.diff(begins, append=on.shape[1])


class _NormalEquations(NamedTuple):
    """The errors at n nodes as the returns of a face determine them, whatever its form is."""

    node: Shaped[Int, " M"]  # of each column
    wide: int  # columns of a node
    normal: Shaped[Float, "n n"]  # 1 / mm^2
    force: Shaped[Float, " n"]  # 1 / mm


def _normal_equations(x: Float32, off: Float, on: Bool, begins: Int, sensor: Linearity, wide: int) -> _NormalEquations:
    """Of frames (f, M): returns `on` a face, `off` its line; each frame's line is free, and the form in each part.

    begins: of the parts, and the number of frames. wide: as many columns are one here.
    """
    every = on.shape[1]
    x, off, on = _side_by_side(x, off, on, wide)
    on = on & (np.abs(off) < FAR * math.sqrt(float((off[on] ** 2).mean())) + LEAST_MM)
    on &= on.sum(axis=1, keepdims=True) >= LEAST_RETURNS
    variance = float((off[on] ** 2).mean()) + LEAST_MM**2
    off = np.where(on, off, 0.0)
    columns = _together(np.diff(off, axis=0))  # what changes between frames is noise
    lines, seen = np.flatnonzero(on.any(axis=1)), np.flatnonzero(on.any(axis=0))
    ends = np.argmax(on[lines], axis=1), on.shape[1] - 1 - np.argmax(on[lines, ::-1], axis=1)
    first, last = (np.rint(np.interp(np.arange(len(on)), lines, one)).astype(np.int64) for one in ends)
    node = np.arange(on.shape[1]).clip(seen[0], seen[-1]) - seen[0]
    nodes = int(node[-1]) + 1
    of, form = slice(0, nodes), slice(nodes, None)
    normal, force = np.zeros((nodes, nodes)), np.zeros(nodes)
    for begin, end in pairwise(begins):
        mine = on[begin:end]
        # The form goes with either end of the face that is in view: single frames lose these.
        low, high = (median_filter(one[begin:end], SMOOTH, mode="nearest") for one in (first, last))
        in_view = [(1, low)] if low.any() else []
        in_view += [(-1, high)] if (high < on.shape[1] - 1).any() else []
        shows = mine.any(axis=1)
        if shows.sum() < SMOOTH or min((np.ptp(one[shows]) for _, one in in_view), default=0) < MOVES:
            continue
        frame, column = np.nonzero(mine)
        beyond = [way * (column - one[frame]) for way, one in in_view]
        at = [node[column]]
        at += [nodes + k * PLACES + one.clip(0, PLACES - 1) for k, one in enumerate(beyond)]
        left = _residuals(off[begin:end], mine, at[1] - nodes)
        frames = _together(left.T)
        if frames > CHANGES:
            continue
        weight = 1.0 / (columns * frames * (float((left[mine] ** 2).mean()) + LEAST_MM**2))
        full, pull = _normal(frame, at, nodes + 2 * PLACES, x[begin:end][mine], off[begin:end][mine], weight)
        free = weight * full[form, form] + np.eye(2 * PLACES) / (FORM**2 * variance)
        gain = weight * np.linalg.solve(free, full[form, of]).T
        normal += weight * (full[of, of] - gain @ full[form, of])
        force += weight * (pull[of] - gain @ pull[form])
    outer = np.stack(ends, axis=1)
    pitch_mm = float(np.median(np.diff(np.take_along_axis(x[lines], outer, axis=1)) / np.diff(outer)))
    middle_mm = pitch_mm * np.bincount(node, np.arange(node.size)) / np.bincount(node)
    noise = np.eye(nodes) + normal @ sensor.covariance(middle_mm[:, None] - middle_mm)
    normal, force = (np.asarray(np.linalg.solve(noise, one), np.float64) for one in (normal, force))
    return _NormalEquations(np.repeat(node, wide)[:every], wide, normal, force)


def _normal(frame: Int, at: Sequence[Int], size: int, x: AnyArray, off: AnyArray, weight: float) -> tuple[Float, Float]:
    """Normal matrix (size, size) and force (size,) of unknowns, of which those `at` each return (k,) add up.

    x, off: of the returns, each of a `weight`, 1 / mm^2. Each frame's line is free, and its bow a little: an oblique
    one sees a face bent that turns along the edge.
    """
    many = int(frame.max()) + 1
    count, way = np.bincount(frame).clip(1), x.astype(np.float64)
    way -= (np.bincount(frame, way) / count)[frame]
    square = np.bincount(frame, way**2) + NUGGET
    bow = way**2 - (square / count)[frame] - way * (np.bincount(frame, way**3) / square)[frame]
    bow *= BENT_MM * math.sqrt(weight) / (np.abs(bow).max() + NUGGET)
    off, single, none = off.astype(np.float64), np.ones(way.size), np.zeros(way.size, np.int64)

    def sums(weights: Float, by: Int, rows: int) -> Float:
        """Of weights of the returns (rows, size), by a number of each return and the unknowns there."""
        found = [np.bincount(by * size + one, weights, rows * size) for one in at]
        return np.asarray(np.sum(found, axis=0)).reshape(rows, size)

    normal, force = np.zeros((size, size)), sums(off, none, 1)[0]
    for one in at:
        normal += sums(single, one, size)
    for lever, prior in ((single, NUGGET), (way, NUGGET), (bow, 1.0)):
        length = np.sqrt(np.bincount(frame, lever**2) + prior)
        share = sums(lever, frame, many) / length[:, None]
        normal -= share.T @ share
        force -= share.T @ (np.bincount(frame, off * lever) / length)
    return normal, force


def _together(left: Float) -> float:
    """How many values in a row count as one, of noise (m, n) of first order along the rows."""
    shared = float((left[:, 1:] * left[:, :-1]).sum()) / (float((left**2).sum()) + NUGGET)
    return max((1.0 + shared) / (1.0 - shared), 1.0)


def _residuals(off: Float, on: Bool, place: Int) -> Float:
    """What frames (f, M) have beside what columns and places on the face have on average; 0 where not `on`."""
    frame, column = np.nonzero(on)
    left = off[frame, column]
    for group in (column, place, column, place):
        left = left - (np.bincount(group, left) / np.bincount(group).clip(1))[group]
    out = np.zeros(on.shape)
    out[frame, column] = left
    return out


class _Looks(NamedTuple):
    """The errors at n nodes under each of l lengths, in directions that are told apart."""

    basis: Shaped[Float, "l n n"]
    known: Shaped[Float, "l n"]  # 1 / variance, of directions with a prior variance of 1
    along: Shaped[Float, "l n"]  # force
    log: Shaped[Float, "l s"]  # log-likelihood, under each of ERRORS_MM, against no errors
    size: float  # mean square of the likeliest errors over what their own process makes: 1 at most, or it is none


def _looks(equations: _NormalEquations) -> _Looks:
    node, within = np.arange(len(equations.force)), np.arange(equations.wide)
    apart = equations.wide * node[:, None, None] + within[:, None] - within
    alike = np.exp(-np.abs(apart) / LENGTHS[:, None, None, None]).mean(axis=(2, 3))[:, np.abs(node[:, None] - node)]
    root = np.linalg.cholesky(alike + NUGGET * np.eye(len(equations.force)))
    known, vector = np.linalg.eigh(root.swapaxes(1, 2) @ equations.normal @ root)
    known, basis = known.clip(0.0), root @ vector
    along, variance = equations.force @ basis, ERRORS_MM[:, None] ** 2
    gain = along[:, None] ** 2 * variance / (1.0 + variance * known[:, None])
    log = 0.5 * (gain - np.log1p(variance * known[:, None])).sum(axis=2)
    k, e = np.unravel_index(log.argmax(), log.shape)
    likeliest = along[k] / (known[k] + 1.0 / variance[e]) / ERRORS_MM[e]
    return _Looks(basis, known, along, log, float((likeliest**2).mean()))


def _mean(equations: _NormalEquations, looks: _Looks, share: Float) -> ColumnErrors:
    """Mean and covariance over lengths and strengths, by their shares (l, s); the rest: no errors."""
    nodes = len(equations.force)
    mean, square = np.zeros(nodes), np.zeros((nodes, nodes))
    for k, e in np.argwhere(share > UNLIKELY):
        variance = 1.0 / (looks.known[k] + 1.0 / ERRORS_MM[e] ** 2)
        basis, one = looks.basis[k], looks.basis[k] @ (variance * looks.along[k])
        mean += share[k, e] * one
        square += share[k, e] * (np.outer(one, one) + (basis * variance) @ basis.T)
    return ColumnErrors(mean[equations.node], equations.node, square - np.outer(mean, mean))
