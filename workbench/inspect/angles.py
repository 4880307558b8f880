"""The bevel angle along the edge, with its uncertainty.

The bevel face's direction is taken near each place; the root face is too narrow for that, so its direction is one for
the whole edge (of each pass). All places share its error, and each carries it; where the frames show that it drifts
along the edge, each carries that drift too, and the inspection says so. Roughness is no drift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as fisher

from workbench.artefacts import Edge, EdgeFrames
from workbench.geometry.smoothing import local_polynomial, robust_weights
from workbench.units import Bool, Float, Int

TILT_STRETCH_MM = 20.0
ROUGH_PROOF = 0.95  # level of the test that the root face's direction differs between stretches
TILT_PROOF = 0.9999  # level of the test that the root face's direction varies
DRIFT_PROOF = 0.9  # level of the test that it drifts: rather carry a roughness than lose a drift


@dataclass(frozen=True, slots=True, eq=False)
class BevelAngles:
    """Bevel angle at m places of the edge, and the parts of its uncertainty."""

    bevel: Float  # (m,) rad; NaN where not measured
    u: Float  # (m,) standard uncertainty, all of it
    local_u: Float  # (m,) the part that each place has for itself
    tilt_u: Float  # (m,) the part of the root face's direction, which all places share
    tilt_variation: float  # standard deviation of that direction along the edge by its drift, rad; 0: none proven


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
    return BevelAngles(bevel, u, local_u, tilt_u, max(p.tilt_variation for p in parts))


def _of_pass(edge: Edge, mine: Bool, at_mm: Float, half_width_mm: float) -> BevelAngles:
    f = edge.frames
    assert f is not None, "a raw edge: measure_at refuses it"
    frames = np.flatnonzero(mine & np.isfinite(f.bevel_arc_length_mm) & np.isfinite(f.bevel_angle))
    if frames.size < 3:
        nothing = np.full(at_mm.shape, np.nan)
        return BevelAngles(nothing, nothing, nothing, nothing, 0.0)
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
    noise, variation = tilt_uncertainty(f, frames)
    tilt_u = np.full(at_mm.shape, np.hypot(noise, variation))
    tangent_u = edge.tangent_u * np.interp(at_mm, s, f.tangent_leverage[frames])
    return BevelAngles(fit[:, 0], np.sqrt(local_u**2 + tilt_u**2 + tangent_u**2), local_u, tilt_u, variation)


def scatter(s: Float, value: Float, weight: Float, half_width: float, stations: Float) -> float:
    """How much more than their weights say the values scatter about their local regression (1: as they say)."""
    fit = local_polynomial(s, value, weight, stations, half_width)[:, 0]
    good = np.isfinite(fit)
    used = weight > 0
    off = (value - np.interp(s, stations[good], fit[good]))[used] * np.sqrt(weight[used])
    parameters = 3.0 * (s[-1] - s[0]) / (1.4 * half_width) + 1.0  # about what the regression has spent
    freedom = max(1.0 - parameters / max(used.sum(), 1), 0.2)
    return float(np.sqrt(np.mean(off**2) / freedom))


def tilt_uncertainty(f: EdgeFrames, frames: Int) -> tuple[float, float]:
    """Standard uncertainty of the root face's mean direction, and how that direction drifts along the edge, both rad.

    What the directions of stretches of TILT_STRETCH_MM show beyond their own scatter (DerSimonian and Laird's moment
    estimate) is either a drift, if tests prove that, which every place then carries whole, or roughness, which the mean
    direction averages over the stretches.
    """
    off = np.angle(np.exp(1j * (f.root_angle - f.tilt)[frames]))
    weight = 1.0 / f.root_angle_variance[frames]
    z = off * np.sqrt(weight)
    inlier = np.abs(z) < 5.0 * np.median(np.abs(z)) / 0.6745 + 1e-9
    excess = float(np.mean(z[inlier] ** 2))
    off, weight = off[inlier], weight[inlier] / excess
    stretch = np.floor(f.arc_length_mm[frames][inlier] / TILT_STRETCH_MM)
    _, number = np.unique(stretch[np.isfinite(stretch)], return_inverse=True)
    good = np.isfinite(stretch)
    sums = np.bincount(number, weight[good])
    means = np.bincount(number, weight[good] * off[good]) / sums
    at = np.bincount(number, weight[good] * f.arc_length_mm[frames][inlier][good]) / sums
    misfit = float((sums * (means - np.average(means, weights=sums)) ** 2).sum())
    freedom = means.size - 1
    variation2 = 0.0
    if freedom > 0 and misfit > chi2.ppf(ROUGH_PROOF, freedom):
        variation2 = (misfit - freedom) / float(sums.sum() - (sums**2).sum() / sums.sum())
    noise2 = 1.0 / float(weight.sum())
    if misfit > chi2.ppf(TILT_PROOF, max(freedom, 1)) and drifts(at, means, 1.0 / (1.0 / sums + variation2)):
        return math.sqrt(noise2), math.sqrt(variation2)
    return math.sqrt(noise2 + variation2 / max(freedom, 1)), 0.0


def drifts(at: Float, value: Float, weight: Float) -> bool:
    """Whether values at n places follow a line (from six on: a parabola) beyond their scatter, by an F test.

    Too few places to tell (fewer than four) count as a drift.
    """
    order = 2 if at.size >= 6 else 1
    freedom = at.size - 1 - order
    if freedom < 1:
        return True
    course = np.polynomial.Polynomial.fit(at, value, order, w=np.sqrt(weight))
    misfit = float((weight * (value - course(at)) ** 2).sum())
    explained = float((weight * (value - np.average(value, weights=weight)) ** 2).sum()) - misfit
    return bool(explained / order > fisher.ppf(DRIFT_PROOF, order, freedom) * misfit / freedom)
