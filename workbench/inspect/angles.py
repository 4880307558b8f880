"""The bevel angle along the edge, with its uncertainty.

The bevel face's direction is taken near each place; the root face is too narrow for that, so its direction is one for
the whole edge (of each pass). All places share its error, and each carries it; where the frames show that it drifts
along the edge, each carries that drift too, and the inspection says so. Roughness is no drift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from workbench.artefacts import Edge
from workbench.geometry.smoothing import local_polynomial, robust_weights
from workbench.inspect.root_face import root_face_direction
from workbench.units import Bool, Float


@dataclass(frozen=True, slots=True, eq=False)
class BevelAngles:
    """Bevel angle at m places of the edge, and the parts of its uncertainty."""

    bevel: Float  # (m,) rad; NaN where not measured
    u: Float  # (m,) standard uncertainty, all of it
    local_u: Float  # (m,) the part that each place has for itself
    tilt_u: Float  # (m,) the part of the root face's direction, which all places share
    tilt_variation: float  # standard deviation of that direction along the edge by its drift, rad; 0: none proven
    tilt_scatter: float  # standard deviation of that direction between stretches of edge, by drift or roughness, rad

    def where(self, mask: Bool) -> BevelAngles:
        """The places where `mask` (m,) holds."""
        return replace(self, **{name: getattr(self, name)[mask] for name in ("bevel", "u", "local_u", "tilt_u")})


def bevel_angles(edge: Edge, at_mm: Float, half_width_mm: float) -> BevelAngles:
    """Bevel angle at arc lengths at_mm (m,), from the frames within half_width_mm; passes averaged by their weight."""
    parts = [_of_pass(edge, edge.pass_index == p, at_mm, half_width_mm) for p in np.unique(edge.pass_index)]
    values = np.array([p.bevel for p in parts])
    variance = np.array([p.u**2 for p in parts])
    weight = np.where(np.isfinite(values), 1.0 / variance, 0.0)
    total = weight.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = weight / total

        def pooled(name: str) -> Float:
            return np.asarray(np.sqrt(np.nansum((share * np.array([getattr(p, name) for p in parts])) ** 2, axis=0)))

        bevel = np.where(total > 0, np.nansum(share * values, axis=0), np.nan)
    hidden = ~np.isfinite(bevel)
    u, local_u, tilt_u = (np.where(hidden, np.nan, pooled(name)) for name in ("u", "local_u", "tilt_u"))
    variation, scattered = (max(getattr(p, name) for p in parts) for name in ("tilt_variation", "tilt_scatter"))
    return BevelAngles(bevel, u, local_u, tilt_u, variation, scattered)


def _of_pass(edge: Edge, mine: Bool, at_mm: Float, half_width_mm: float) -> BevelAngles:
    f = edge.frames
    assert f is not None, "a raw edge: measure_at refuses it"
    frames = np.flatnonzero(mine & np.isfinite(f.bevel_arc_length_mm) & np.isfinite(f.bevel_angle))
    if frames.size < 3:
        nothing = np.full(at_mm.shape, np.nan)
        return BevelAngles(nothing, nothing, nothing, nothing, 0.0, 0.0)
    frames = frames[np.argsort(f.bevel_arc_length_mm[frames], kind="stable")]
    s = f.bevel_arc_length_mm[frames]
    value = (f.tilt - f.bevel_angle)[frames]
    value = np.angle(np.exp(1j * value))
    weight = 1.0 / f.bevel_angle_variance[frames]
    stations = np.linspace(s[0], s[-1], max(3, int(s[-1] - s[0]) + 2))
    kept = robust_weights(s, value, weight, half_width_mm, stations)
    fit = local_polynomial(s, value, kept, at_mm, half_width_mm)
    excess = scatter(s, value, kept, half_width_mm, stations)
    local_u = np.sqrt(fit[:, 2]) * excess
    face = root_face_direction(f, frames)
    tilt_u = np.full(at_mm.shape, math.hypot(face.mean_u, face.drift, edge.root_direction_u))
    tangent_u = edge.tangent_u * np.interp(at_mm, s, f.tangent_leverage[frames])
    u = np.sqrt(local_u**2 + tilt_u**2 + tangent_u**2)
    return BevelAngles(fit[:, 0], u, local_u, tilt_u, face.drift, face.scatter)


def scatter(s: Float, value: Float, weight: Float, half_width: float, stations: Float) -> float:
    """How much more than their weights say the values scatter about their local regression (1: as they say)."""
    fit = local_polynomial(s, value, weight, stations, half_width)[:, 0]
    good = np.isfinite(fit)
    used = weight > 0
    off = (value - np.interp(s, stations[good], fit[good]))[used] * np.sqrt(weight[used])
    parameters = 3.0 * (s[-1] - s[0]) / (1.4 * half_width) + 1.0  # about what the regression has spent
    freedom = max(1.0 - parameters / max(used.sum(), 1), 0.2)
    return float(np.sqrt(np.mean(off**2) / freedom))
