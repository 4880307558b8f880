"""The spine: a smooth space curve with the moving frame that the section stands in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.synthetic.recipe import Course
from workbench.synthetic.swept.recipe import GroovePart, Spine, SweptPart
from workbench.units import DEG, Float, Shaped

_GAUSS_AT, _GAUSS_WEIGHT = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """The spine and its frame at k places: n is the end face's outward normal, m points up, t = m x n."""

    s: Shaped[Float, " k"]
    position: Shaped[Float, "k 3"]  # part frame
    t: Shaped[Float, "k 3"]
    n: Shaped[Float, "k 3"]  # twisted
    m: Shaped[Float, "k 3"]
    n0: Shaped[Float, "k 3"]  # before the twist
    m0: Shaped[Float, "k 3"]


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A spine with its arc length: s over the parameter u, densely."""

    part: SweptPart | GroovePart
    u: Float
    s: Float
    closed: bool

    @property
    def length(self) -> float:
        return float(self.s[-1])

    def frames(self, s: Float) -> Frames:
        """The frames at arc lengths s (k,). Beyond its ends an open curve goes straight on, a closed one round."""
        s = np.asarray(s, dtype=float)
        within = np.mod(s, self.length) if self.closed else np.clip(s, 0.0, self.length)
        u = np.interp(within, self.s, self.u)
        for _ in range(2):  # Newton: the table gives s within micrometres
            speed = np.linalg.norm(_derivative(self.part.spine, u), axis=1)
            u = u - (self._length_to(u) - within) / speed
        position, t, n0, m0 = _frame(self.part.spine, u)
        position = position + (0.0 if self.closed else 1.0) * (s - within)[:, None] * t
        turn = along(self.part.twist_deg, within, self.length)[:, None] * DEG
        n, m = np.cos(turn) * n0 + np.sin(turn) * m0, np.cos(turn) * m0 - np.sin(turn) * n0
        return Frames(s, position, t, n, m, n0, m0)

    def _length_to(self, u: Float) -> Float:
        """Arc length to u, exact to the quadrature: the table up to the node before, then five-point Gauss."""
        node = np.clip(np.searchsorted(self.u, u, side="right") - 1, 0, len(self.u) - 2)
        half = (u - self.u[node]) / 2
        return np.asarray(self.s[node] + _gauss(self.part.spine, self.u[node], half))


def curve_of(part: SweptPart | GroovePart) -> Curve:
    """The spine of a part, tabled."""
    spine = part.spine
    stop = _parameter_range(spine)
    u = np.linspace(0.0, stop, max(64, math.ceil(spine.length_mm / 2.0)) + 1)
    half = np.diff(u) / 2
    s = np.concatenate([[0.0], np.cumsum(_gauss(spine, u[:-1], half))])
    turn = stop if spine.shape == "saddle" or (spine.shape == "arc" and spine.rise_mm == 0) else 0.0
    return Curve(part, u, s, closed=abs(turn - 2 * math.pi) < 1e-6)


def along(course: Course, s: Float, length: float) -> Float:
    """The values of a course at arc lengths s of an edge of `length` mm."""
    share = np.asarray(s) / length
    phase = 2 * math.pi * np.asarray(s) / course.wavelength_mm + course.phase_deg * DEG
    return np.asarray(course.start + (course.end - course.start) * share + course.amplitude * np.sin(phase))


def _gauss(spine: Spine, start: Float, half: Float) -> Float:
    at = start[:, None] + half[:, None] * (1 + _GAUSS_AT)
    speed = np.linalg.norm(_derivative(spine, at.ravel()), axis=1).reshape(at.shape)
    return np.asarray(half * (speed @ _GAUSS_WEIGHT))


def _parameter_range(spine: Spine) -> float:
    """Where the parameter ends so that the arc length is `length_mm` (a saddle's angle is that of its nozzle)."""
    if spine.shape == "straight":
        return spine.length_mm
    if spine.shape == "arc":
        turn = spine.length_mm / math.hypot(spine.radius_mm, spine.rise_mm / (2 * math.pi))
        return min(turn, 2 * math.pi) if spine.rise_mm == 0 else turn
    if spine.shape == "saddle":
        return min(spine.length_mm / spine.radius_mm, 2 * math.pi)
    return spine.length_mm  # wavy: along its chord


def _point(spine: Spine, u: Float) -> Float:
    if spine.shape == "straight":
        return np.stack([u, 0 * u, 0 * u], axis=1)
    if spine.shape == "arc":  # starts at the origin along +x; the plate lies at +y
        side = 1.0 if spine.sense == "convex" else -1.0
        r = spine.radius_mm
        return np.stack([r * np.sin(u), side * r * (1 - np.cos(u)), spine.rise_mm * u / (2 * math.pi)], axis=1)
    if spine.shape == "saddle":
        angle = spine.start_deg * DEG - u  # so that the hole lies to the right of t
        r, big = spine.radius_mm, spine.shell_radius_mm
        height = np.sqrt(big**2 - (r * np.sin(angle)) ** 2)
        return np.stack([r * np.sin(angle), -r * np.cos(angle), height - big], axis=1)
    k, phase = 2 * math.pi / spine.wavelength_mm, spine.phase_deg * DEG
    wave = np.sin(k * u + phase) - math.sin(phase)
    return np.stack([u, spine.amplitude_mm * wave, spine.height_amplitude_mm * np.sin(k * u)], axis=1)


def _derivative(spine: Spine, u: Float) -> Float:
    if spine.shape == "straight":
        return np.stack([1 + 0 * u, 0 * u, 0 * u], axis=1)
    if spine.shape == "arc":
        side = 1.0 if spine.sense == "convex" else -1.0
        r = spine.radius_mm
        return np.stack([r * np.cos(u), side * r * np.sin(u), 0 * u + spine.rise_mm / (2 * math.pi)], axis=1)
    if spine.shape == "saddle":
        angle = spine.start_deg * DEG - u
        r, big = spine.radius_mm, spine.shell_radius_mm
        height = np.sqrt(big**2 - (r * np.sin(angle)) ** 2)
        rise = -(r**2) * np.sin(angle) * np.cos(angle) / height
        return -np.stack([r * np.cos(angle), r * np.sin(angle), rise], axis=1)
    k, phase = 2 * math.pi / spine.wavelength_mm, spine.phase_deg * DEG
    slope, climb = spine.amplitude_mm * k * np.cos(k * u + phase), spine.height_amplitude_mm * k * np.cos(k * u)
    return np.stack([1 + 0 * u, slope, climb], axis=1)


def _frame(spine: Spine, u: Float) -> tuple[Float, Float, Float, Float]:
    """Position, t, n and m (k, 3) before any twist.

    On plate curves m is the plate's normal made square to t; on a saddle the end face is a cylinder about the
    nozzle's axis, so that n points at this axis and the hole lies there.
    """
    position, slope = _point(spine, u), _derivative(spine, u)
    t = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    if spine.shape == "saddle":
        n = -position * (1.0, 1.0, 0.0) / spine.radius_mm
        return position, t, n, np.cross(n, t)
    m = np.array([0.0, 0.0, 1.0]) - t[:, 2:] * t
    m = m / np.linalg.norm(m, axis=1, keepdims=True)
    return position, t, np.cross(t, m), m
