"""What every frame says about the edge in the section plane: directions of the faces, and the root size."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, Cloud, EdgeFrames
from workbench.edge.faces import TrackedFaces
from workbench.errors import InputError
from workbench.geometry.curves import Curve, arrange, fit_curve
from workbench.geometry.ends import Ends, fit_end, settled
from workbench.geometry.faces import FaceLines
from workbench.geometry.sections import SectionLines, crossing, in_section, section_lines
from workbench.geometry.smoothing import local_polynomial, robust_weights
from workbench.units import Float, Int

MIXED = 0.5
LEAST_FRAMES, LEAST_LENGTH_MM = 3, 1.0
SMOOTHING_MM = 10.0  # half width of the local regressions that give drift along the edge


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """The frames' measures, the lower edge as a smooth curve, and what ties both."""

    frames: EdgeFrames
    curve: Curve
    s_low: Float  # (N,) arc length of each frame's lower edge on the curve, from 0; NaN where not seen


def measure_edge(cloud: Cloud, tracked: TrackedFaces) -> Measured:
    """Measure every frame in the section planes of the lower edge, which itself comes out of the measures.

    Starts from the corners between root face and bevel face, which every frame shows by itself, and repeats with the
    lower edge that this gives.
    """
    corners, forward = _corners(cloud, tracked)
    seen = tracked.seen & np.isfinite(corners).all(axis=1)
    _check_advance(cloud, corners[seen])
    s = np.full(seen.size, np.nan)
    s[seen] = arrange(corners[seen], cloud.pass_index[seen], forward[seen])
    curve = fit_curve(corners[seen], s[seen])
    s[seen] = curve.project(corners[seen], s[seen])
    for _ in range(2):
        frames, lower_edge = _measure(cloud, tracked, curve, s)
        good = np.isfinite(lower_edge[:, 0])
        curve = fit_curve(lower_edge[good], frames.lower_arc_length_mm[good], curve.stiffness)
        s[good] = curve.project(lower_edge[good], frames.lower_arc_length_mm[good])
        s[~good] = np.nan
    frames, lower_edge = _measure(cloud, tracked, curve, s)
    return _from_zero(frames, curve)


def _check_advance(cloud: Cloud, corners: Float) -> None:
    """Refuse frames that do not run along an edge: angles and lengths need its direction."""
    travelled = np.ptp(corners, axis=0) if len(corners) else np.zeros(3)
    if len(corners) < LEAST_FRAMES or np.linalg.norm(travelled) < LEAST_LENGTH_MM:
        raise InputError(cloud.source, f"expected at least {LEAST_FRAMES} frames that see the edge along at least "
                         f"{LEAST_LENGTH_MM:g} mm of it, found {len(corners)} frames along "
                         f"{np.linalg.norm(travelled):.2f} mm")  # fmt: skip


def _corners(cloud: Cloud, tracked: TrackedFaces) -> tuple[Float, np.ndarray]:
    """Corner of root face and bevel face in the base (N, 3), each frame by itself; and whether time runs along t (N,)."""
    root, bevel = tracked.faces[ROOT_FACE], tracked.faces[BEVEL_FACE]
    kr, kb = root.sxz / root.sxx, bevel.sxz / bevel.sxx
    cr, cb = root.z_mean - kr * root.x_mean, bevel.z_mean - kb * bevel.x_mean
    x = (cb - cr) / (kr - kb)
    ex, ez = cloud.base_from_profiler[:, :3, 0], cloud.base_from_profiler[:, :3, 2]
    corners = cloud.base_from_profiler[:, :3, 3] + x[:, None] * ex + (kr * x + cr)[:, None] * ez
    up_root = -tracked.side[:, None] * (ex + kr[:, None] * ez)
    up_bevel = -tracked.side[:, None] * (ex + kb[:, None] * ez)
    t = np.cross(up_bevel, up_root)  # t = m x n
    forward = np.zeros(len(x), bool)
    for p in np.unique(cloud.pass_index):
        mine = np.flatnonzero((cloud.pass_index == p) & tracked.seen)
        if mine.size >= 2:
            motion = np.diff(corners[mine], axis=0)
            forward[mine] = np.median((motion * t[mine[:-1]]).sum(axis=1)) > 0
    return corners, forward


def _measure(cloud: Cloud, tracked: TrackedFaces, curve: Curve, s: Float) -> tuple[EdgeFrames, Float]:
    """All frames in the section planes of `curve`; and each frame's lower edge in the base (N, 3)."""
    pose, side, sigma = cloud.base_from_profiler, tracked.side, tracked.range_sigma_mm
    slope = {label: _smooth_slope(face, s, cloud.pass_index) for label, face in tracked.faces.items()}
    root = section_lines(tracked.faces[ROOT_FACE], slope[ROOT_FACE], pose, side, sigma[:, 2], curve, s)
    bevel = section_lines(tracked.faces[BEVEL_FACE], slope[BEVEL_FACE], pose, side, sigma[:, 1], curve, s)
    tilt = pass_tilt(root, cloud.pass_index)
    root = _with_true_noise(root, wrapped(root.angle - tilt), cloud.pass_index)
    apparent = wrapped(tilt - bevel.angle)
    beta, beta_slope = _along(bevel.s, apparent, 1.0 / bevel.angle_variance, cloud.pass_index)
    bevel = _with_true_noise(bevel, apparent - beta, cloud.pass_index)
    size_slope = np.zeros_like(beta)
    for _ in range(2):
        # Drift bends an oblique frame's bevel: take it back (docs/geometry.md).
        nu = tilt + np.pi / 2 - beta
        across = np.stack([np.cos(nu), np.sin(nu)], axis=1)
        place = bevel.place + (beta_slope * bevel.run * bevel.spread)[:, None] * across
        up = crossing(root.place, tilt, place, tilt - beta)
        lever = np.hypot(*(place - _on(root.place, tilt, up)).T)
        drift = bevel.run * (size_slope * np.sin(beta) - beta_slope * lever)
        beta, beta_slope = _along(bevel.s, apparent + drift, 1.0 / bevel.angle_variance, cloud.pass_index)
        low, step, low_sigma = _root_size(cloud, tracked, curve, root, bevel, tilt, beta, up, slope[LOWER_SURFACE])
        low, low_sigma, counts = settled(low, step, low_sigma, tracked.end_column, cloud.pass_index)
        s_up = root.s + root.run * up
        missing = _missing_share(tracked, cloud.pass_index)
        size, size_slope = _smooth_size(s_up, low, step, low_sigma, missing, counts)
    t, a, b = curve.frame(np.where(np.isfinite(s_up), s_up, 0.0))
    spot = _on(root.place, tilt, up - size)
    lower_edge = curve.position(np.where(np.isfinite(s_up), s_up, 0.0)) + spot[:, :1] * a + spot[:, 1:] * b
    lower_edge[~np.isfinite(s_up)] = np.nan
    frames = EdgeFrames(
        arc_length_mm=s_up, lower_arc_length_mm=s_up - root.run * size, reference=a, tilt=tilt,
        root_angle=root.angle, root_angle_variance=root.angle_variance, bevel_arc_length_mm=bevel.s,
        bevel_angle=tilt - apparent - drift, bevel_angle_variance=bevel.angle_variance, bevel_lever_mm=lever,
        root_low_mm=low, root_step_mm=step, root_sigma_mm=low_sigma,
        root_weight=counts, missing=missing,
        tangent_leverage=np.sqrt(root.run**2 + bevel.run**2 - 2.0 * root.run * bevel.run * np.cos(beta)),
    )  # fmt: skip
    return frames, lower_edge


def _smooth_slope(face: FaceLines, s: Float, pass_index: Int) -> Float:
    """Slope dz/dx of a face at each frame (N,), from the frames around it."""
    return _along(s, face.sxz / face.sxx, face.sxx, pass_index)[0]


def _with_true_noise(lines: SectionLines, off: Float, pass_index: Int) -> SectionLines:
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


def wrapped(angle: Float) -> Float:
    """Angle in (-pi, pi]."""
    return np.asarray(-((-angle + np.pi) % (2.0 * np.pi) - np.pi))


def _along(s: Float, value: Float, weight: Float, pass_index: Int) -> tuple[Float, Float]:
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


def _smooth_size(s: Float, low: Float, step: Float, sigma: Float, missing: Float,
                 counts: Float) -> tuple[Float, Float]:  # fmt: skip
    """Root size and its slope along the edge at each frame (N,), all passes together."""
    size, slope = np.full(s.shape, np.nan), np.full(s.shape, np.nan)
    mine = np.flatnonzero(np.isfinite(s) & np.isfinite(low) & np.isfinite(sigma))
    mine = mine[np.argsort(s[mine], kind="stable")]
    end = fit_end(Ends(s[mine], low[mine], step[mine], sigma[mine], missing[mine], counts[mine]))
    size[mine], slope[mine] = end.spline(s[mine]), end.spline(s[mine], 1)
    return size, slope


def _on(place: Float, angle: Float, distance: Float) -> Float:
    """Points (N, 2) at a distance along lines through `place` in direction `angle`."""
    return place + distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _root_size(cloud: Cloud, tracked: TrackedFaces, curve: Curve, root: SectionLines, bevel: SectionLines, tilt: Float,
               beta: Float, up: Float, lower_slope: Float) -> tuple[Float, Float, Float]:  # fmt: skip
    """Root size to the last return on the root face (N,), the step to the next column, and its standard deviation, mm.

    Where the lower surface is seen, the size is that to the corner with it, and the step 0.
    """
    pose = cloud.base_from_profiler[:, :3]
    end = tracked.root_end
    point = pose[:, :, 3] + end[:, :1] * pose[:, :, 0] + end[:, 1:2] * pose[:, :, 2]
    place = np.full((len(end), 2), np.nan)
    seen = np.isfinite(root.s) & np.isfinite(end[:, 0])
    _, place[seen] = in_section(point[seen], curve, root.s[seen])
    m = np.stack([np.cos(tilt), np.sin(tilt)], axis=1)
    n = np.stack([-np.sin(tilt), np.cos(tilt)], axis=1)
    ray_m, ray_n = (root.ray * m).sum(axis=1), (root.ray * n).sum(axis=1)
    slide = ((root.place - place) * n).sum(axis=1) / ray_n  # along the ray onto the line of all the face's points
    down = ((place - root.place) * m).sum(axis=1) + slide * ray_m
    step = end[:, 2] / np.hypot(1.0, root.run)
    down[tracked.end_is_cut] = np.nan
    root_share = (1.0 / np.tan(beta) + ray_m / ray_n) ** 2
    if tracked.end_is_corner.any():
        corner, lean = _lower_corner(cloud, tracked, curve, root, tilt, lower_slope)
        at_corner = tracked.end_is_corner & np.isfinite(corner)
        down, step = np.where(at_corner, corner, down), np.where(at_corner, 0.0, step)
        root_share = np.where(at_corner, (1.0 / np.tan(beta) - 1.0 / np.tan(lean)) ** 2, root_share)
    variance = root_share * root.offset_variance + bevel.offset_variance / np.sin(beta) ** 2
    return up - down, step, np.sqrt(variance)


def _lower_corner(cloud: Cloud, tracked: TrackedFaces, curve: Curve, root: SectionLines, tilt: Float,
                  slope: Float) -> tuple[Float, Float]:  # fmt: skip
    """Distance along the root face to the corner with the lower surface (N,), mm; and the angle between both, rad."""
    lower = section_lines(tracked.faces[LOWER_SURFACE], slope, cloud.base_from_profiler, tracked.side,
                          tracked.range_sigma_mm[:, 3], curve, root.s)  # fmt: skip
    apparent = wrapped(lower.angle - tilt)
    lean, _ = _along(lower.s, apparent, 1.0 / lower.angle_variance, cloud.pass_index)
    return crossing(root.place, tilt, lower.place, tilt + lean), lean


def _missing_share(tracked: TrackedFaces, pass_index: Int) -> Float:
    """Probability that a column of the root face has no return on it (N,).

    The share inside the face, one value a pass; at the end of the face MIXED where the next column saw a mixed pixel,
    which may have taken the place of the face's last return as well as of the first one behind it.
    """
    root = tracked.faces[ROOT_FACE]
    share = np.full(root.count.shape, np.nan)
    for p in np.unique(pass_index):
        mine = (pass_index == p) & (root.count > 2)
        inner = (root.columns[mine, 1] - root.columns[mine, 0] - 1).sum()
        if inner > 0:
            share[pass_index == p] = 1.0 - (root.count[mine] - 2).sum() / inner
    return np.where(tracked.end_is_mixed, MIXED, np.clip(share, 0.02, 0.6))


def _from_zero(frames: EdgeFrames, curve: Curve) -> Measured:
    """The same with arc length 0 at the first measured point of the lower edge."""
    s0 = float(np.nanmin(frames.lower_arc_length_mm))
    moved = replace(
        frames,
        arc_length_mm=frames.arc_length_mm - s0,
        lower_arc_length_mm=frames.lower_arc_length_mm - s0,
        bevel_arc_length_mm=frames.bevel_arc_length_mm - s0,
    )
    return Measured(moved, curve.shifted(s0), moved.lower_arc_length_mm)
