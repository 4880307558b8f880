"""A frame's straight faces as seen in the section plane of a curved edge.

The laser plane cuts the edge obliquely, so angles and lengths are taken in the plane normal to the edge's tangent, and
each point in the section plane at its own arc length: on a curved edge the far end of an oblique frame lies in another
section plane than its near end. Errors of second order in that distance are taken back in closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.geometry.blocks import as_input
from workbench.geometry.chains import FaceLines
from workbench.geometry.curves import Curve, foot, frame_at
from workbench.geometry.medians import robust_sd
from workbench.geometry.splines import derivatives, piece_of
from workbench.kernels import kernel
from workbench.units import Float, Shaped

BY_CHANCE = 5.0  # standard deviations of a sum of squares
SHARED = 1.0 / 3.0  # of a face, by how much of it second returns or spatter reach


@dataclass(frozen=True, slots=True, eq=False)
class SectionLines:
    """One face of n frames as lines in the section planes: place (u, v) along (a, b) of the curve's frame, direction.

    NaN where the face is not seen.
    """

    s: Shaped[Float, " n"]  # arc length of the face's centroid, mm
    place: Shaped[Float, "n 2"]  # centroid relative to the curve, mm
    angle: Shaped[Float, " n"]  # direction of the line against a, towards b; from the lower to the upper side; rad
    angle_variance: Shaped[Float, " n"]  # rad^2, of independent range noise
    offset_variance: Shaped[Float, " n"]  # of the centroid across the line, mm^2, likewise
    # how far the section advances along the edge per mm along the face (the obliquity's tangent)
    run: Shaped[Float, " n"]
    spread: Shaped[Float, " n"]  # mean square distance of the face's points from the centroid along the face, mm^2
    ray: Shaped[Float, "n 2"]  # direction of the range axis in (a, b)
    bow: Shaped[Float, " n"]  # a curved edge bends the face to the left of its line by so much times distance^2, 1/mm

    @property
    def facing(self) -> Float:
        """+1 or -1 (n,): whether the range axis points to the left or to the right, seen up along the lines."""
        return np.sign(np.cos(self.angle) * self.ray[:, 1] - np.sin(self.angle) * self.ray[:, 0])

    def bow_in_range(self, turn: Float) -> Float:
        """By how much an oblique frame sees the face bent along the range axis, times distance^2 (n,), 1/mm.

        turn (n,): of the face along the edge, rad/mm (eq. (7)).
        """
        return np.asarray(self.facing * (turn * self.run + self.bow))


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
    sigma = range_sigma_mm * np.sqrt(_shared_variance(face))
    known = np.stack([face.x_mean, face.z_mean, face.sxx, face.sxz, face.count, slope, side, sigma, s_frame], axis=1)
    out = np.empty((11, len(known)))
    _section_lines(*curve.compiled, as_input(base_from_profiler), as_input(known), out)
    return SectionLines(out[0], out[1:3].T.copy(), out[3], out[4], out[5], out[6], out[7], out[8:10].T.copy(), out[10])


def _shared_variance(face: FaceLines) -> Float:
    """Variance (n,) of lines whose returns scatter by more than those of most frames, over what noise makes of it.

    What they scatter by besides, neighbours share: second returns, spatter.
    """
    chance = np.sqrt(2.0 / np.maximum(face.count - 2.0, 1.0))
    excess = (0.5 * chance**2 * face.rss / face.noise_mm**2 - 1.0) / chance
    below = excess[excess < 0.0]
    usual = max(1.0, robust_sd(below)) if below.size else 1.0  # columns that share noise make it uneven
    return np.asarray(1.0 + np.maximum(excess - BY_CHANCE * usual, 0.0) * chance * SHARED * face.count)


@kernel(error_model="numpy")
def _section_lines(
    breaks: Float, powers: Float, limits: Float, references: Float, pose: Float, known: Float, out: Float
) -> None:
    """Fill `out` (11, n): what SectionLines holds, in its order."""
    frame, p, place, line = np.empty((3, 3)), np.empty(3), np.empty(2), np.empty(3)
    ray, bend = np.empty(2), np.empty(2)
    for m in range(known.shape[0]):
        sxx, sxz, count, slope = known[m, 2], known[m, 3], known[m, 4], known[m, 5]
        side, sigma = known[m, 6], known[m, 7]
        for d in range(3):
            p[d] = pose[m, d, 3] + known[m, 0] * pose[m, d, 0] + known[m, 1] * pose[m, d, 2]
            line[d] = 0.0
        for k in range(2):
            place[k] = ray[k] = bend[k] = 0.0
        s = foot(breaks, powers, p[0], p[1], p[2], known[m, 8])
        at = s if s == s else 0.0
        frame_at(breaks, powers, limits, references, at, frame)
        inside = min(max(at, breaks[0]), breaks[-1])
        i = piece_of(breaks, inside)
        speed2 = along = 0.0
        for d in range(3):
            value, first, second = derivatives(powers, i, d, inside - breaks[i])
            speed2 += first * first
            along += first * second
            off = p[d] - value - (at - inside) * first
            to_upper = -side * (pose[m, d, 0] + slope * pose[m, d, 2])
            for k in range(2):
                place[k] += off * frame[k + 1, d]
                ray[k] += pose[m, d, 2] * frame[k + 1, d]
                bend[k] += second * frame[k + 1, d]  # a and b stand square to the first derivative
            for k in range(3):
                line[k] += to_upper * frame[k, d]
        for k in range(2):
            bend[k] = bend[k] / speed2 if at == inside else 0.0
        run, du, dv = line[0], line[1], line[2]
        size2 = du * du + dv * dv
        size = math.sqrt(size2)
        across = (du * ray[1] - dv * ray[0]) / size  # range noise seen across the line
        turn = -side * across / size  # d angle / d slope
        run /= size
        spread = sxx / count * size2
        # A curved edge bends the face away from its chord by bow * (distance along the face)^2.
        lean_a, lean_b = -dv / size, du / size
        bow = 0.5 * (bend[0] * lean_a + bend[1] * lean_b) * run * run
        bow /= 1.0 - bend[0] * place[0] - bend[1] * place[1]
        out[0, m] = s
        out[1, m], out[2, m] = place[0] - bow * spread * lean_a, place[1] - bow * spread * lean_b
        out[3, m] = math.atan2(dv, du) + turn * (sxz / sxx - slope)
        out[4, m], out[5, m] = sigma * sigma / sxx * turn * turn, sigma * sigma * across * across / count
        out[6, m], out[7, m], out[8, m], out[9, m], out[10, m] = run, spread, ray[0], ray[1], bow


def in_section(points_mm: Float, curve: Curve, s_guess: Float) -> tuple[Float, Float]:
    """Arc length (n,) and place (n, 2) along (a, b), mm, of base points (n, 3), each in its own section plane."""
    s = curve.project(points_mm, s_guess)
    _, a, b = curve.frame(s)
    off = points_mm - curve.position(s)
    return s, np.stack([np.einsum("nd,nd->n", off, axis) for axis in (a, b)], axis=1)


def crossing(place_a: Float, angle_a: Float, place_b: Float, angle_b: Float) -> Float:
    """Where lines a and b meet, as distance (n,) along line a from place_a (n, 2), mm."""
    ca, sa, cb, sb = np.cos(angle_a), np.sin(angle_a), np.cos(angle_b), np.sin(angle_b)
    d = place_b - place_a
    return np.asarray((d[:, 0] * sb - d[:, 1] * cb) / (ca * sb - sa * cb))


def on_line(place: Float, angle: Float, distance: Float) -> Float:
    """Points (N, 2) at a distance along lines through `place` in direction `angle`."""
    return np.asarray(place + distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
