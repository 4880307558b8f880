"""Directions of the faces along the edge: smoothed pass by pass, and judged by their own scatter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.geometry.faces import FaceLines
from workbench.geometry.sections import SectionLines
from workbench.geometry.smoothing import local_polynomial, robust_weights
from workbench.units import Bool, Float, Int

SMOOTHING_MM = 10.0  # half width of the local regressions that give drift along the edge


def runs_forward(points_mm: Float, t: Float, pass_index: Int, seen: Bool) -> Bool:
    """Does time run along t (N, 3), pass by pass (N,)? points_mm (N, 3): on the edge, in order of time."""
    forward = np.zeros(len(points_mm), bool)
    for p in np.unique(pass_index):
        mine = np.flatnonzero((pass_index == p) & seen)
        if mine.size >= 2:
            motion = np.diff(points_mm[mine], axis=0)
            forward[mine] = np.median((motion * t[mine[:-1]]).sum(axis=1)) > 0
    return forward


def smooth_along(s: Float, value: Float, weight: Float, pass_index: Int) -> tuple[Float, Float]:
    """Smooth value and slope at each frame (N,), pass by pass: local regression on s, evaluated every millimetre."""
    smooth, slope = np.full(s.shape, np.nan), np.full(s.shape, np.nan)
    for p in np.unique(pass_index):
        mine = np.flatnonzero((pass_index == p) & np.isfinite(s) & np.isfinite(value) & np.isfinite(weight))
        if mine.size < 2:
            continue
        mine = mine[np.argsort(s[mine], kind="stable")]
        at = np.linspace(s[mine[0]], s[mine[-1]], max(3, int(s[mine[-1]] - s[mine[0]]) + 2))
        kept = robust_weights(s[mine], value[mine], weight[mine], SMOOTHING_MM, at)
        fit = local_polynomial(s[mine], value[mine], kept, at, SMOOTHING_MM)
        ok = np.isfinite(fit[:, 0])
        smooth[mine] = np.interp(s[mine], at[ok], fit[ok, 0])
        slope[mine] = np.interp(s[mine], at[ok], fit[ok, 1])
    return smooth, slope


def smooth_slope(face: FaceLines, s: Float, pass_index: Int) -> Float:
    """Slope dz/dx of a face at each frame (N,), from the frames around it."""
    return smooth_along(s, face.sxz / face.sxx, face.sxx, pass_index)[0]


def pass_tilt(root: SectionLines, pass_index: Int) -> Float:
    """Direction of the root face (N,), one value a pass: the weighted mean over its frames, outliers left out. rad.

    A direction that keeps its angle to the curve's untwisted frame is the same tilt all along the edge.
    """
    tilt = np.full(root.angle.shape, np.nan)
    for p in np.unique(pass_index):
        mine = (pass_index == p) & np.isfinite(root.angle)
        if not mine.any():
            continue
        about = float(np.angle(np.nanmedian(np.exp(1j * root.angle[mine]).real)
                               + 1j * np.nanmedian(np.exp(1j * root.angle[mine]).imag)))  # fmt: skip
        off = wrapped(root.angle[mine] - about)
        weight = 1.0 / root.angle_variance[mine]
        for _ in range(2):
            mean = np.average(off, weights=weight)
            z = np.abs(off - mean) * np.sqrt(1.0 / root.angle_variance[mine])
            weight = np.where(z < 5.0 * np.median(z) / 0.6745 + 1e-9, 1.0 / root.angle_variance[mine], 0.0)
        tilt[pass_index == p] = about + np.average(off, weights=weight)
    return tilt


def with_true_noise(lines: SectionLines, off: Float, pass_index: Int) -> SectionLines:
    """The lines with their variances raised to what the scatter `off` (N,) of their directions shows, pass by pass.

    Residuals about a frame's own line do not show noise that its neighbouring columns share; the directions of many
    frames do, and vibration does not turn them.
    """
    factor = np.ones(off.shape)
    for p in np.unique(pass_index):
        mine = (pass_index == p) & np.isfinite(off)
        if mine.sum() >= 20:
            z2 = off[mine] ** 2 / lines.angle_variance[mine]
            factor[pass_index == p] = max(1.0, float(np.median(z2)) / 0.4549)
    return replace(lines, angle_variance=lines.angle_variance * factor, offset_variance=lines.offset_variance * factor)


def wrapped(angle: Float) -> Float:
    """Angle in (-pi, pi]."""
    return np.asarray(-((-angle + np.pi) % (2.0 * np.pi) - np.pi))
