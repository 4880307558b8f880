"""Which postures tell most: D-optimal choice on the predicted information of the hand-eye pose.

Every candidate posture adds J^T (C_fit + H S H^T)^-1 J to the information of the ten unknowns. Those are chosen whose
sum has the largest determinant once the sphere's centre and radius are eliminated (D_s-optimality), one after the
other and then by exchange (Fedorov, Theory of Optimal Experiments, 1972).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.api import DEG, Float, Int, Shaped, pose_from, rotation_from_vector
from workbench.plugins.calibration.arcs import LATERAL, STEEP
from workbench.plugins.calibration.model import Estimate, Noise, linearise
from workbench.plugins.calibration.observations import from_arrays

HAND_EYE = 6  # of the ten unknowns
EXCHANGES = 4  # rounds over the chosen postures
AT_LIMIT = 0.6  # share of candidates that lie on a limit, where the best ones are
UNKNOWN_MM, UNKNOWN_RAD, UNKNOWN_CENTER_MM = 50.0, 20 * DEG, 100.0  # before any posture


@dataclass(frozen=True)
class Limits:
    """Where the robot may show the sphere: orientations about a nominal one, places in the profiler frame."""

    base_from_profiler: Shaped[Float, "3 3"]  # nominal orientation
    cone: float  # greatest tilt of the range axis from it, rad
    roll: float  # greatest turn about the range axis, rad
    middle_mm: tuple[float, float]  # of the view: x, z
    half_mm: tuple[float, float]  # half its width and height
    off_plane: tuple[float, float] = (0.3, 0.7)  # |y| of the sphere's centre, in radii: beyond, an error may miss it


@dataclass(frozen=True)
class Optics:
    """What decides how well a circle is fitted."""

    noise_mm: float  # of a point along z, correlation of neighbours included
    pitch_mm: float  # between columns


def candidates(limits: Limits, estimate: Estimate, count: int, rng: np.random.Generator) -> tuple[Float, Float]:
    """Random postures within the limits, most of them on one: flange poses (c, 4, 4), sphere centres (c, 3)."""
    radius = estimate.radius_mm
    way, tilt = rng.uniform(0, 2 * np.pi, count), limits.cone * np.sqrt(_to_limit(rng, count))
    roll = limits.roll * _to_limit(rng, count) * _sign(rng, count)
    low, high = limits.off_plane
    y = radius * (low + (high - low) * _to_limit(rng, count)) * _sign(rng, count)
    x, z = (
        m + h * _to_limit(rng, count) * _sign(rng, count) for m, h in zip(limits.middle_mm, limits.half_mm, strict=True)
    )
    centre = np.stack([x, y, z], axis=1)
    return poses(limits, estimate, np.stack([tilt * np.cos(way), tilt * np.sin(way)], axis=1), roll, centre), centre


def random_postures(limits: Limits, estimate: Estimate, count: int, rng: np.random.Generator) -> tuple[Float, Float]:
    """Postures drawn evenly within the same limits: what a plan is compared with."""
    way, tilt = rng.uniform(0, 2 * np.pi, count), limits.cone * np.sqrt(rng.random(count))
    low, high = limits.off_plane
    y = estimate.radius_mm * rng.uniform(low, high, count) * _sign(rng, count)
    x, z = (m + h * rng.uniform(-1, 1, count) for m, h in zip(limits.middle_mm, limits.half_mm, strict=True))
    centre = np.stack([x, y, z], axis=1)
    tilts = np.stack([tilt * np.cos(way), tilt * np.sin(way)], axis=1)
    return poses(limits, estimate, tilts, limits.roll * rng.uniform(-1, 1, count), centre), centre


def poses(limits: Limits, estimate: Estimate, tilt: Float, roll: Float, centre: Float) -> Float:
    """Flange poses (c, 4, 4) that show the sphere at `centre` (c, 3), tilted (c, 2) about x and y, then rolled (c,)."""
    zero = np.zeros(len(tilt))
    turned = rotation_from_vector(np.column_stack([tilt, zero])) @ rotation_from_vector(
        np.column_stack([zero, zero, roll])
    )
    flange = limits.base_from_profiler @ turned @ estimate.rotation.T
    lever = centre @ estimate.rotation.T + estimate.translation_mm
    return pose_from(flange, estimate.center_mm - (flange @ lever[..., None])[..., 0])


def gains(base_from_flange: Float, centre: Float, estimate: Estimate, noise: Noise, optics: Optics) -> Float:
    """Information (c, 10, 10) that each posture adds."""
    w = estimate.radius_mm**2 - centre[:, 1] ** 2
    circle = np.stack([centre[:, 0], centre[:, 2], w], axis=1)
    linear = linearise(estimate, from_arrays(circle, circle_covariance(w, optics), base_from_flange), noise)
    J = linear.jacobian
    return np.asarray(np.swapaxes(J, 1, 2) @ np.linalg.solve(linear.covariance, J))


def circle_covariance(w: Float, optics: Optics) -> Float:
    """Covariance (c, 3, 3) of (x_c, z_c, w) of circles of squared radius w (c,): all columns of the arc return."""
    u = np.linspace(-STEEP, STEEP, 61)
    r, q = np.sqrt(w)[:, None], np.sqrt(1 - u**2)
    row = np.stack([np.broadcast_to(u / q, (len(w), 61)), np.ones((len(w), 61)), 1 / (2 * r * q)], axis=-1)
    weight = (2 * STEEP * r / optics.pitch_mm / 61) / (1 + (LATERAL * u / q) ** 2)
    information = np.einsum("ck,cki,ckj->cij", weight, row, row)
    return np.asarray(np.linalg.inv(information) * optics.noise_mm**2)


def before(estimate: Estimate, noise: Noise) -> Float:
    """Information (10, 10) before any posture: the design's, and what is known of the sphere's radius."""
    spread = np.repeat([UNKNOWN_MM, UNKNOWN_RAD, UNKNOWN_CENTER_MM, noise.radius_u_mm], [3, 3, 3, 1])
    return np.diag(spread**-2)


def determinant(information: Float) -> Float:
    """Logarithm of the determinant (...) of the hand-eye pose's information, centre and radius eliminated."""
    rest = information[..., HAND_EYE:, HAND_EYE:]
    return np.asarray(np.linalg.slogdet(information)[1] - np.linalg.slogdet(rest)[1])


def choose(gain: Float, start: Float, count: int) -> Int:
    """Indices (count,) of the postures that together add most to `start` (10, 10), the most useful first."""
    chosen: list[int] = []
    for _ in range(count):
        chosen.append(_best(gain, start + gain[chosen].sum(axis=0), chosen))
    for _ in range(EXCHANGES):
        previous = list(chosen)
        for i in range(count):
            others = chosen[:i] + chosen[i + 1 :]
            chosen[i] = _best(gain, start + gain[others].sum(axis=0), others)
        if chosen == previous:
            break
    found = np.array(chosen)
    return found[_in_order(gain[found], start)]


def _best(gain: Float, start: Float, taken: list[int]) -> int:
    score = determinant(start + gain)
    score[taken] = -np.inf
    return int(np.argmax(score))


def _in_order(gain: Float, start: Float) -> Int:
    """The chosen ones, the most useful next one first."""
    order: list[int] = []
    for _ in range(len(gain)):
        order.append(_best(gain, start + gain[order].sum(axis=0), order))
    return np.array(order)


def volume_after(information: Float, weight: Float) -> Float:
    """Predicted volume_u (...) in mm of informations (..., 10, 10)."""
    covariance = np.linalg.inv(information)[..., :HAND_EYE, :HAND_EYE]
    return np.asarray(np.sqrt(np.einsum("ij,...ji->...", weight, covariance)))


def _to_limit(rng: np.random.Generator, count: int) -> Float:
    """Shares of a limit (count,): 1 for most, the rest evenly between 0 and 1."""
    return np.where(rng.random(count) < AT_LIMIT, 1.0, rng.random(count))


def _sign(rng: np.random.Generator, count: int) -> Float:
    return rng.choice([-1.0, 1.0], count)
