"""One Gaussian process along the edge for each quantity, in the edge's own frame.

A smooth curve through the corners has the frame (t, a, b) at every arc length s; a return has h = (p - c) . b along the
root face and w = (p - c) . a across it. The angle of each face and the root's width are Matern 5/2 processes over s
with a noise of their own, hyperparameters by marginal likelihood (Rasmussen and Williams 2006, 5.4). What stays over
the frames of both faces' residuals widens u: 4.2 e / width of a direction, 1.4 e of an end.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import make_smoothing_spline
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from bench.open.rivals.reader import SECTIONS, Corners, corners, crossing, in_base, line
from workbench.units import Float

TITLE = "Gaussian process"
TRACKS = ("milled",)
BIN_MM, PLACES, GROWS_ANGLE, GROWS_END = 2.0, 10, 4.2, 1.4
KNOT_MM = 8.0  # of the curve
LENGTH_MM = (40.0, 1.2)  # prior of a process's length: median, sd of its logarithm


def measure(recording: Path, declared: Mapping[str, Any]) -> dict[str, Any]:
    """Nine sections at the middles of equal stretches."""
    seen = corners(recording, declared)
    lines = [[line(points[1:-1]) for points in faces] for faces in (seen.root, seen.bevel)]
    corner = np.array([crossing(a, b) for a, b in zip(*lines, strict=True)])
    curve = Edge(in_base(seen.base_from_profiler, corner), seen)
    root, bevel = curve.face(seen.root), curve.face(seen.bevel)
    turn = bevel.angle - root.angle
    angle = 180.0 - np.abs(np.degrees(np.arctan2(np.sin(turn), np.cos(turn))))
    last = in_base(seen.base_from_profiler, seen.end[:, :2])
    ends = [np.stack(curve.place(points)[1:], axis=1) for points in (last, in_base(seen.base_from_profiler, corner))]
    size = np.linalg.norm(ends[0] - ends[1], axis=1) + 0.5 * seen.end[:, 2]  # half a column beyond the last return
    at = root.s.min() + (np.arange(SECTIONS) + 0.5) / SECTIONS * np.ptp(root.s)
    root_mm, root_u = process(root.s, size, seen.end[:, 2] / 12**0.5, at)
    bevel_deg, bevel_u = process(root.s, angle, np.degrees(np.hypot(root.u, bevel.u)), at)
    steep = np.radians(np.median(angle))
    form = np.hypot(GROWS_END * root.form_mm / np.tan(steep), GROWS_END * bevel.form_mm / np.sin(steep))
    tilt = np.degrees(GROWS_ANGLE * np.hypot(root.form_mm / root.width_mm, bevel.form_mm / bevel.width_mm))
    order = np.argsort(root.s)
    lower = np.stack([np.interp(at, root.s[order], last[order, k]) for k in range(3)], axis=1)
    names = ("root_mm", "root_u_mm", "bevel_deg", "bevel_u_deg")
    rows = zip(root_mm, np.hypot(root_u, form), bevel_deg, np.hypot(bevel_u, tilt), strict=True)
    values = (dict(zip(names, map(float, row), strict=True)) for row in rows)
    return {"sections": [{"origin_mm": p.tolist(), **one} for p, one in zip(lower, values, strict=True)]}


class Face(NamedTuple):
    """Of n frames: where along the edge, the line's angle in the edge's frame and its sd, rad; what stays."""

    s: Float
    angle: Float
    u: Float
    form_mm: float
    width_mm: float


class Edge:
    """A smooth curve through points (n, 3), parametrised along its chord, with its frame."""

    def __init__(self, points: Float, seen: Corners) -> None:
        self.seen, self.middle = seen, np.median(points, axis=0)
        self.way = np.linalg.svd(points - self.middle, full_matrices=False)[2][0]
        q = (points - self.middle) @ self.way
        cell = np.floor((q - q.min()) / KNOT_MM).astype(int)
        mine = [np.flatnonzero(cell == k) for k in np.unique(cell)]
        knots = np.array([np.median(q[m]) for m in mine])
        values = np.array([np.median(points[m], axis=0) for m in mine])
        if len(knots) < 5:
            raise ValueError("the edge is seen over less than 40 mm")
        self.curve = [make_smoothing_spline(knots, column) for column in values.T]
        self.slope = [one.derivative() for one in self.curve]
        self.up = np.median(
            [(f[-1] - f[0]) @ p[:3, [0, 2]].T for f, p in zip(seen.root, seen.base_from_profiler, strict=True)], 0
        )

    def place(self, points: Float) -> tuple[Float, Float, Float]:
        """s, h along the root face and w across it of points (n, 3) in the base."""
        s = (points - self.middle) @ self.way
        for _ in range(3):
            centre, t = (np.stack([one(s) for one in ones], axis=1) for ones in (self.curve, self.slope))
            s = s + ((points - centre) * t).sum(axis=1) / (t * t).sum(axis=1)
        t /= np.linalg.norm(t, axis=1, keepdims=True)
        b = self.up - (t @ self.up)[:, None] * t
        b /= np.linalg.norm(b, axis=1, keepdims=True)
        off = points - np.stack([one(s) for one in self.curve], axis=1)
        return s, (off * b).sum(axis=1), (off * np.cross(t, b)).sum(axis=1)

    def face(self, faces: list[Float]) -> Face:
        """Lines of all frames, and the residual that all frames share, less its scatter."""
        rows, left = [], []
        for pose, points in zip(self.seen.base_from_profiler, faces, strict=True):
            inner = points[1:-1]
            s, h, w = self.place(in_base(np.broadcast_to(pose, (len(inner), 4, 4)), inner))
            middle, way, residual = line(np.stack([h, w], axis=1))
            along = (np.stack([h, w], axis=1) - middle) @ way
            sigma = residual.std() * np.sqrt(len(h) / max(len(h) - 2, 1))
            rows.append((s.mean(), np.arctan2(way[1], way[0]), sigma / np.sqrt((along**2).sum()), np.ptp(along)))
            cell = np.minimum(((along - along.min()) / max(np.ptp(along), 1e-9) * PLACES).astype(int), PLACES - 1)
            count = np.bincount(cell, minlength=PLACES)
            left.append(np.where(count > 0, np.bincount(cell, residual, PLACES) / np.maximum(count, 1), np.nan))
        columns, image = np.array(rows).T, np.array(left)
        lasting = np.nanmean(image, axis=0) ** 2 - np.nanvar(image, axis=0) / np.isfinite(image).sum(axis=0).clip(1)
        form = float(np.sqrt(max(0.0, np.nanmean(lasting) * PLACES / (PLACES - 2))))
        return Face(columns[0], columns[1], columns[2], form, float(np.median(columns[3])))


def binned(s: Float, y: Float, u: Float) -> tuple[Float, Float, Float]:
    """Weighted means in cells of 2 mm and their variance, after leaving out what is off by more than 4 deviations."""
    cell = np.floor((s - s.min()) / BIN_MM).astype(int)
    cell = np.unique(cell, return_inverse=True)[1]

    def mean(values: Float, weight: Float) -> Float:
        return np.bincount(cell, weight * values) / np.maximum(np.bincount(cell, weight), 1e-30)

    weight = 1.0 / np.maximum(u, 1e-9) ** 2
    off = (y - np.array([np.median(y[cell == k]) for k in range(cell.max() + 1)])[cell]) / u
    weight = np.where(np.abs(off) < 4.0 * max(1.4826 * float(np.median(np.abs(off))), 1.0), weight, 0.0)
    middle = mean(y, weight)
    free = max(int((weight > 0).sum()) - cell.max() - 1, 1)
    excess = max(1.0, float((weight * (y - middle[cell]) ** 2).sum()) / free)  # frames scatter more than their lines
    good = np.bincount(cell, weight) > 0
    return mean(s, weight)[good], middle[good], (excess / np.bincount(cell, weight)[good])


def process(s: Float, y: Float, u: Float, at: Float) -> tuple[Float, Float]:
    """Mean and standard deviation at places `at` of a Matern 5/2 process plus a constant through values y at s."""
    s, y, v = binned(s, y, u)
    mean = np.average(y, weights=1.0 / v)
    y, spread = y - mean, max(float(np.std(y)), 1e-6)
    constant, d = (10.0 * spread) ** 2, np.abs(s[:, None] - s[None])

    def cost(p: Float) -> float:
        factor = cho_factor(matern(d, p) + np.diag(v * (1.0 + np.exp(p[2]))) + constant, lower=True)
        prior = ((p[1] - np.log(LENGTH_MM[0])) / LENGTH_MM[1]) ** 2 + ((p[2] - np.log(0.1)) / 1.5) ** 2
        prior += ((p[0] - np.log(spread)) / 2.0) ** 2
        return float(0.5 * y @ cho_solve(factor, y) + np.log(np.diag(factor[0])).sum() + 0.5 * prior)

    starts = ([np.log(spread), np.log(length), np.log(0.1)] for length in (15.0, 60.0))
    options = {"maxiter": 160, "xatol": 0.05, "fatol": 0.05}
    p = min((minimize(cost, one, method="Nelder-Mead", options=options) for one in starts), key=lambda r: r.fun).x
    factor = cho_factor(matern(d, p) + np.diag(v * (1.0 + np.exp(p[2]))) + constant, lower=True)
    cross = matern(np.abs(at[:, None] - s[None]), p) + constant
    variance = np.exp(2.0 * p[0]) + constant - (cross * cho_solve(factor, cross.T).T).sum(axis=1)
    return mean + cross @ cho_solve(factor, y), np.sqrt(np.maximum(variance, 1e-14))


def matern(d: Float, p: Float) -> Float:
    """Covariance at distances d, mm; p: logarithms of strength and length."""
    r = 5**0.5 * d / np.exp(p[1])
    return np.asarray(np.exp(2.0 * p[0]) * (1.0 + r + r * r / 3.0) * np.exp(-r))
