"""What every frame says about the edge in the section plane: directions of the faces, and the root size."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, Cloud, EdgeFrames
from workbench.edge.directions import pass_tilt, runs_forward, smooth_along, smooth_slope, with_true_noise, wrapped
from workbench.edge.faces import TrackedFaces
from workbench.edge.root_size import missing_share, root_size, smooth_size
from workbench.errors import InputError
from workbench.geometry.curves import Curve, arrange, fit_curve
from workbench.geometry.sections import crossing, on_line, section_lines
from workbench.geometry.settling import settled
from workbench.units import Bool, Float

LEAST_FRAMES, LEAST_LENGTH_MM = 3, 1.0
FAR_MM, FAR_TIMES = 5.0, 5.0  # of the root size: frames that say more have lost the faces


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
    check_advance(cloud, corners[seen])
    s = np.full(seen.size, np.nan)
    s[seen] = arrange(corners[seen], cloud.pass_index[seen], forward[seen])
    curve = fit_curve(corners[seen], s[seen])
    s[seen] = curve.project(corners[seen], s[seen])
    for _ in range(2):
        frames, lower_edge = _measure(cloud, tracked, curve, s)
        good = _sound(cloud, lower_edge, frames.lower_arc_length_mm, corners)
        curve = fit_curve(lower_edge[good], frames.lower_arc_length_mm[good], curve.stiffness)
        s[good] = curve.project(lower_edge[good], frames.lower_arc_length_mm[good])
        s[~good] = np.nan
    frames, lower_edge = _measure(cloud, tracked, curve, s)
    return _from_zero(frames, curve)


def _sound(cloud: Cloud, lower_edge: Float, s: Float, corners: Float) -> Bool:
    """Frames (N,) whose lower edge lies about as far from the corner of their faces as elsewhere.

    Raises InputError where too few are left: what was followed is no root face next to a bevel.
    """
    away = np.linalg.norm(lower_edge - corners, axis=1)
    good = np.isfinite(away) & np.isfinite(s)
    if good.any():
        good &= away < max(FAR_MM, FAR_TIMES * float(np.median(away[good])))
    check_advance(cloud, corners[good])
    return np.asarray(good)


def check_advance(cloud: Cloud, corners: Float) -> None:
    """Refuse frames that do not run along an edge: angles and lengths need its direction."""
    travelled = np.ptp(corners, axis=0) if len(corners) else np.zeros(3)
    if len(corners) < LEAST_FRAMES or np.linalg.norm(travelled) < LEAST_LENGTH_MM:
        raise InputError(cloud.source, f"expected at least {LEAST_FRAMES} frames that see the edge along at least "
                         f"{LEAST_LENGTH_MM:g} mm of it, found {len(corners)} frames along "
                         f"{np.linalg.norm(travelled):.2f} mm")  # fmt: skip


def _corners(cloud: Cloud, tracked: TrackedFaces) -> tuple[Float, Bool]:
    """Corner of root face and bevel face in the base (N, 3), frame by frame; does time run along t (N,)?"""
    root, bevel = tracked.faces[ROOT_FACE], tracked.faces[BEVEL_FACE]
    kr, kb = root.sxz / root.sxx, bevel.sxz / bevel.sxx
    cr, cb = root.z_mean - kr * root.x_mean, bevel.z_mean - kb * bevel.x_mean
    x = (cb - cr) / (kr - kb)
    ex, ez = cloud.base_from_profiler[:, :3, 0], cloud.base_from_profiler[:, :3, 2]
    corners = cloud.base_from_profiler[:, :3, 3] + x[:, None] * ex + (kr * x + cr)[:, None] * ez
    up_root = -tracked.side[:, None] * (ex + kr[:, None] * ez)
    up_bevel = -tracked.side[:, None] * (ex + kb[:, None] * ez)
    t = np.cross(up_bevel, up_root)  # t = m x n
    return corners, runs_forward(corners, t, cloud.pass_index, tracked.seen)


def _measure(cloud: Cloud, tracked: TrackedFaces, curve: Curve, s: Float) -> tuple[EdgeFrames, Float]:
    """All frames in the section planes of `curve`; and each frame's lower edge in the base (N, 3)."""
    pose, side, sigma = cloud.base_from_profiler, tracked.side, tracked.range_sigma_mm
    slope = {label: smooth_slope(face, s, cloud.pass_index) for label, face in tracked.faces.items()}
    root = section_lines(tracked.faces[ROOT_FACE], slope[ROOT_FACE], pose, side, sigma[:, 2], curve, s)
    bevel = section_lines(tracked.faces[BEVEL_FACE], slope[BEVEL_FACE], pose, side, sigma[:, 1], curve, s)
    tilt = pass_tilt(root, cloud.pass_index)
    root = with_true_noise(root, wrapped(root.angle - tilt), cloud.pass_index)
    apparent = wrapped(tilt - bevel.angle)
    beta, beta_slope = smooth_along(bevel.s, apparent, 1.0 / bevel.angle_variance, cloud.pass_index)
    bevel = with_true_noise(bevel, apparent - beta, cloud.pass_index)
    missing = missing_share(tracked, cloud.pass_index)
    size_slope = np.zeros_like(beta)
    for last in (False, True):
        # Drift bends an oblique frame's bevel: take it back (docs/geometry.md).
        nu = tilt + np.pi / 2 - beta
        across = np.stack([np.cos(nu), np.sin(nu)], axis=1)
        place = bevel.place + (beta_slope * bevel.run * bevel.spread)[:, None] * across
        up = crossing(root.place, tilt, place, tilt - beta)
        lever = np.hypot(*(place - on_line(root.place, tilt, up)).T)
        drift = bevel.run * (size_slope * np.sin(beta) - beta_slope * lever)
        beta, beta_slope = smooth_along(bevel.s, apparent + drift, 1.0 / bevel.angle_variance, cloud.pass_index)
        low, step, low_sigma = root_size(cloud, tracked, curve, root, bevel, tilt, beta, up, slope[LOWER_SURFACE])
        low, step, low_sigma, counts = settled(low, step, low_sigma, tracked.end_column, cloud.pass_index)
        s_up = root.s + root.run * up
        if last:
            size, size_slope = smooth_size(s_up, low, step, low_sigma, missing, counts, tracked.end_is_burred)
        else:
            rough = 1.0 / (low_sigma**2 + step**2 / 12.0 + 1e-8)
            size, size_slope = smooth_along(s_up, low + 0.5 * step, rough, cloud.pass_index)
    _, a, b = curve.frame(np.where(np.isfinite(s_up), s_up, 0.0))
    spot = on_line(root.place, tilt, up - size)
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
