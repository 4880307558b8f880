"""The root face's direction: how well the mean over the edge is known, and whether it drifts or is rough."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, fdtri

from workbench.artefacts import EdgeFrames
from workbench.units import Float, Int

STRETCHES_MM = (5.0, 10.0, 20.0)  # of edge, whose mean directions are compared
ROUGH_PROOF = 0.99  # level of the test that they differ by more than their own scatter
TILT_PROOF = 0.9999  # the same where it may be a drift
DRIFT_PROOF = 0.98  # level of the test that it is one


@dataclass(frozen=True, slots=True)
class RootFaceDirection:
    """Uncertainties of the root face's direction, rad."""

    mean_u: float  # standard uncertainty of its mean over the edge
    drift: float  # its standard deviation along the edge by a drift; 0: none proven
    scatter: float  # its standard deviation between stretches of 20 mm, by drift or roughness


def root_face_direction(f: EdgeFrames, frames: Int) -> RootFaceDirection:
    """What the frames of one pass tell of it; their own scatter counts as it is, not as range noise alone says.

    What the directions of stretches of edge show beyond that scatter is either a drift along the edge, if tests prove
    one: every place then carries it whole; or roughness, which the mean direction averages over the edge.
    """
    off = np.angle(np.exp(1j * (f.root_angle - f.tilt)[frames]))
    s, weight = f.arc_length_mm[frames], 1.0 / f.root_angle_variance[frames]
    z = off * np.sqrt(weight)
    inlier = np.isfinite(s) & (np.abs(z) < 5.0 * np.median(np.abs(z)) / 0.6745 + 1e-9)
    s, off, weight = s[inlier], off[inlier], weight[inlier] / float(np.mean(z[inlier] ** 2))
    noise2 = 1.0 / float(weight.sum())
    stretches = [stretch_means(s, off, weight, length) for length in STRETCHES_MM]
    found = [between(means, sums, ROUGH_PROOF) for _, means, sums in stretches]
    density = max(v * length for v, length in zip(found, STRETCHES_MM, strict=True))  # rad^2 mm, of long waves
    scatter2 = density / STRETCHES_MM[-1]
    at, means, sums = stretches[1]
    drift2 = between(means, sums, TILT_PROOF)
    if drift2 > 0.0 and drifts(at, means, 1.0 / (1.0 / sums + drift2)):
        return RootFaceDirection(math.sqrt(noise2), math.sqrt(drift2), math.sqrt(max(drift2, scatter2)))
    covered_mm = STRETCHES_MM[0] * stretches[0][0].size
    return RootFaceDirection(math.sqrt(noise2 + density / covered_mm), 0.0, math.sqrt(scatter2))


def stretch_means(s: Float, value: Float, weight: Float, length_mm: float) -> tuple[Float, Float, Float]:
    """Place, weighted mean and weight of each stretch of `length_mm` that holds values."""
    _, number = np.unique(np.floor(s / length_mm), return_inverse=True)
    sums: Float = np.bincount(number, weight).astype(np.float64)
    return np.bincount(number, weight * s) / sums, np.bincount(number, weight * value) / sums, sums


def between(means: Float, sums: Float, proof: float) -> float:
    """Variance between means (n,) of variance 1 / sums beyond that (DerSimonian and Laird, Control. Clin. Trials 7,
    1986), where a chi-square test proves some; else 0.
    """
    misfit, freedom = float((sums * (means - np.average(means, weights=sums)) ** 2).sum()), means.size - 1
    if freedom < 1 or misfit <= chdtri(freedom, 1.0 - proof):
        return 0.0
    return (misfit - freedom) / float(sums.sum() - (sums**2).sum() / sums.sum())


def drifts(at: Float, value: Float, weight: Float) -> bool:
    """Whether values at n places follow a polynomial of degree n / 3 (1 to 4) beyond their scatter, by an F test.

    Too few places to tell (fewer than four) count as a drift.
    """
    order = min(max(at.size // 3, 1), 4)
    freedom = at.size - 1 - order
    if freedom < 1:
        return True
    course = np.polynomial.Polynomial.fit(at, value, order, w=np.sqrt(weight))
    misfit = float((weight * (value - course(at)) ** 2).sum())
    explained = float((weight * (value - np.average(value, weights=weight)) ** 2).sum()) - misfit
    return bool(explained / order > fdtri(order, freedom, DRIFT_PROOF) * misfit / freedom)
