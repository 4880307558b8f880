"""A frame's straight faces as seen in the section plane of a curved edge.

The laser plane cuts the edge obliquely, so angles and lengths are taken in the plane normal to the edge's tangent, and
each point in the section plane at its own arc length: on a curved edge the far end of an oblique frame lies in another
section plane than its near end. Errors of second order in that distance are taken back in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.geometry.curves import Curve
from workbench.geometry.faces import FaceLines
from workbench.units import Float


@dataclass(frozen=True, slots=True, eq=False)
class SectionLines:
    """One face of n frames as lines in the section planes: place (u, v) along (a, b) of the curve's frame, direction.

    NaN where the face is not seen.
    """

    s: Float  # (n,) arc length of the face's centroid, mm
    place: Float  # (n, 2) centroid relative to the curve, mm
    angle: Float  # (n,) direction of the line against a, towards b; from the lower to the upper side; rad
    angle_variance: Float  # (n,) rad^2, of independent range noise
    offset_variance: Float  # (n,) of the centroid across the line, mm^2, likewise
    run: Float  # (n,) how far the section advances along the edge per mm along the face (the obliquity's tangent)
    spread: Float  # (n,) mean square distance of the face's points from the centroid along the face, mm^2
    ray: Float  # (n, 2) direction of the range axis in (a, b)


def section_lines(
    face: FaceLines,
    slope: Float,
    base_from_profiler: Float,
    side: Float,
    range_sigma_mm: Float,
    curve: Curve,
    s_frame: Float,
) -> SectionLines:
    """Project a face's lines (n frames) into the section planes of the curve.

    slope (n,): the face's slope dz/dx as its neighbouring frames say. A frame's own slope counts by its difference
    from that, to first order: the mean of the arctangents of noisy slopes is not the arctangent of their mean.

    side (n,): the upper side lies towards falling side * x. range_sigma_mm (n,): noise along z. s_frame (n,): about
    where each frame crosses the edge.
    """
    ex, ez = base_from_profiler[:, :3, 0], base_from_profiler[:, :3, 2]
    centroid = base_from_profiler[:, :3, 3] + face.x_mean[:, None] * ex + face.z_mean[:, None] * ez
    seen = np.isfinite(centroid[:, 0]) & np.isfinite(s_frame)
    s = np.full(len(centroid), np.nan)
    s[seen] = curve.project(centroid[seen], s_frame[seen])
    safe = np.where(seen, s, 0.0)
    t, a, b = curve.frame(safe)
    off = centroid - curve.position(safe)
    place = np.stack([_dot(off, a), _dot(off, b)], axis=1)
    line = -side[:, None] * (ex + slope[:, None] * ez)
    du, dv = _dot(line, a), _dot(line, b)
    size2 = du * du + dv * dv
    ray = np.stack([_dot(ez, a), _dot(ez, b)], axis=1)
    turn = -side * (du * ray[:, 1] - dv * ray[:, 0]) / size2  # d angle / d slope
    across = np.abs(du * ray[:, 1] - dv * ray[:, 0]) / np.sqrt(size2)  # range noise seen across the line
    run = _dot(line, t) / np.sqrt(size2)
    spread = face.sxx / face.count * size2
    # A curved edge bends the face away from its chord by bow * (distance along the face)^2.
    lean = np.stack([-dv, du], axis=1) / np.sqrt(size2)[:, None]
    kappa = curve.curvature(safe)
    bend = np.stack([_dot(kappa, a), _dot(kappa, b)], axis=1)
    bow = 0.5 * (bend * lean).sum(axis=1) * run**2 / (1.0 - (bend * place).sum(axis=1))
    place = place - (bow * spread)[:, None] * lean
    variance = range_sigma_mm**2
    angle = np.arctan2(dv, du) + turn * (face.sxz / face.sxx - slope)
    return SectionLines(
        s, place, angle, variance / face.sxx * turn**2, variance * across**2 / face.count, run, spread, ray
    )


def in_section(points_mm: Float, curve: Curve, s_guess: Float) -> tuple[Float, Float]:
    """Arc length (n,) and place (n, 2) along (a, b), mm, of base points (n, 3), each in its own section plane."""
    s = curve.project(points_mm, s_guess)
    _, a, b = curve.frame(s)
    off = points_mm - curve.position(s)
    return s, np.stack([_dot(off, a), _dot(off, b)], axis=1)


def crossing(place_a: Float, angle_a: Float, place_b: Float, angle_b: Float) -> Float:
    """Where lines a and b meet, as distance (n,) along line a from place_a (n, 2), mm."""
    ca, sa, cb, sb = np.cos(angle_a), np.sin(angle_a), np.cos(angle_b), np.sin(angle_b)
    d = place_b - place_a
    return np.asarray((d[:, 0] * sb - d[:, 1] * cb) / (ca * sb - sa * cb))


def on_line(place: Float, angle: Float, distance: Float) -> Float:
    """Points (N, 2) at a distance along lines through `place` in direction `angle`."""
    return np.asarray(place + distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def _dot(p: Float, q: Float) -> Float:
    return np.asarray((p * q).sum(axis=-1))
