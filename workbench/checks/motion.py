"""The motion that the poses tell against the motion that the profiles show."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from workbench.checks.profiles import Chain
from workbench.units import DEG, Float, Int

REACH = 3  # profiles on each side, for the direction of the way
LEAST_STRETCH = 6  # profiles: fewer tell nothing of a way
SURE = 3.0  # standard uncertainties by which a turn of the section is one
LEAST_SINE = 0.1  # of the angle between a section's line and the way
LEAST_MM = 1e-6  # of way between them


@dataclass(frozen=True, slots=True)
class Consistency:
    """How poses and profiles agree over all passes; NaN where nothing tells."""

    obliquity_deg: float  # between the laser plane's normal and the edge, the worst pass's median
    varies_deg: float  # of that angle within a pass: half of its middle nine tenths
    twist_deg: float  # greatest turn of the section about the edge that the poses do not explain
    wiggle_mm: float  # robust standard deviation of a place from the straight line through the two beside it
    way_mm: float  # of the edge, all passes


def consistency(chains: Mapping[int, Chain], base_from_profiler: Mapping[int, Float]) -> Consistency:
    """Carry each pass's section through the base by the poses (k, 4, 4) at its chain's profiles.

    A plate's edge looks the same in neighbouring profiles; so a point that goes with the section runs along the edge,
    and the section turns about the edge only where the plate is twisted. The angle between the edge and the normal of
    the laser plane is small in a scan that measures anything; where orientation or hand-eye pose are wrong it is large.
    """
    found = [_of_pass(chains[number], base_from_profiler[number]) for number in chains]
    found = [one for one in found if one is not None]
    if not found:
        return Consistency(*[float("nan")] * 5)
    angle, spread, twist, wiggle, way = (np.array(column) for column in zip(*found, strict=True))
    return Consistency(
        float(angle.max()), float(spread.max()), float(twist.max()), float(wiggle.max()), float(way.sum())
    )


def _of_pass(chain: Chain, pose: Float) -> tuple[float, float, float, float, float] | None:
    point, turn, stretch = chain.track()
    place = np.einsum("kij,kj->ki", pose[:, :3, :3], _spatial(point)) + pose[:, :3, 3]
    length, tangent, oblique = way_of(place, stretch, pose)
    here = np.isfinite(oblique)
    if here.sum() < 2:
        return None
    low, high = np.percentile(oblique[here], [5, 95])
    across = np.einsum("kij,kj->ki", pose[:, :3, :3], _spatial(np.stack([np.cos(turn), np.sin(turn)], axis=1)))
    return (
        float(np.median(oblique[here])),
        float(high - low) / 2.0,
        _twist(across, tangent, stretch, chain.turn_u),
        _wiggle(place, stretch),
        length,
    )


def _wiggle(place: Float, stretch: Int) -> float:
    """Robust standard deviation of a place from the straight line through the two beside it, mm."""
    together = stretch[2:] == stretch[:-2]
    before, here, after = place[:-2][together], place[1:-1][together], place[2:][together]
    if len(here) < LEAST_STRETCH:
        return 0.0
    chord, off = after - before, here - before
    size = np.maximum(np.linalg.norm(chord, axis=1), LEAST_MM)
    aside = np.linalg.norm(np.cross(off, chord), axis=1) / size
    return float(np.median(aside)) / 1.1774 / math.sqrt(1.5)  # of two normal numbers, of a place less the mean of two


def section_turns(chain: Chain, pose: Float) -> Float | None:
    """Turn (k,) rad of the section about its way by poses (k, 4, 4), over the longest stretch; None: too short."""
    point, turn, stretch = chain.track()
    place = np.einsum("kij,kj->ki", pose[:, :3, :3], _spatial(point)) + pose[:, :3, 3]
    _, tangent, _ = way_of(place, stretch, pose)
    across = np.einsum("kij,kj->ki", pose[:, :3, :3], _spatial(np.stack([np.cos(turn), np.sin(turn)], axis=1)))
    longest = np.bincount(stretch).argmax()
    return _turns(across, tangent, np.flatnonzero((stretch == longest) & np.isfinite(tangent[:, 0])))


def _spatial(point: Float) -> Float:
    """Points or directions (k, 2) of the laser plane in the profiler frame."""
    return np.stack([point[:, 0], np.zeros(len(point)), point[:, 1]], axis=1)


def way_of(place: Float, stretch: Int, pose: Float) -> tuple[float, Float, Float]:
    """Length, tangents (k, 3) and angles (k,) to the laser plane's normal in degrees, of a way through the base."""
    count = len(place)
    tangent, length = np.full((count, 3), np.nan), 0.0
    for number in np.unique(stretch):
        at = np.flatnonzero(stretch == number)
        if len(at) < min(LEAST_STRETCH, count):
            continue
        ahead, behind = (
            at[np.minimum(np.arange(len(at)) + REACH, len(at) - 1)],
            at[np.maximum(np.arange(len(at)) - REACH, 0)],
        )
        chord = place[ahead] - place[behind]
        size = np.linalg.norm(chord, axis=1)
        tangent[at] = np.where(size[:, None] > LEAST_MM, chord / np.maximum(size, LEAST_MM)[:, None], np.nan)
        length += float(np.linalg.norm(place[at[-1]] - place[at[0]]))
    cosine = np.abs(np.einsum("ki,ki->k", tangent, pose[:, :3, 1]))
    return length, tangent, np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0)))


def _twist(across: Float, tangent: Float, stretch: Int, turn_u: Float) -> float:
    """Greatest turn (deg) of directions `across` about the way, against directions carried along without twist."""
    greatest = 0.0
    for number in np.unique(stretch):
        at = np.flatnonzero((stretch == number) & np.isfinite(tangent[:, 0]))
        if len(at) < LEAST_STRETCH:
            continue
        angle = _turns(across, tangent, at)
        if angle is not None:
            u = math.sqrt(float((turn_u[at[:-1]] ** 2).sum()))
            greatest = max(greatest, (float(np.ptp(angle)) - SURE * u) / DEG)
    return greatest


def _turns(across: Float, tangent: Float, at: Int) -> Float | None:
    """Turn (n,) rad about the way at the places `at`; None where the section lies along it."""
    if len(at) < LEAST_STRETCH:
        return None
    t, a = tangent[at], across[at]
    normal = a - np.einsum("ki,ki->k", a, t)[:, None] * t
    size = np.linalg.norm(normal, axis=1)
    if (size < LEAST_SINE).any():
        return None
    normal /= size[:, None]
    carried = _carried(normal[:-1], t[:-1], t[1:])
    sine = np.einsum("ki,ki->k", np.cross(carried, normal[1:]), t[1:])
    steps = np.arctan2(sine, np.einsum("ki,ki->k", carried, normal[1:]))
    return np.concatenate([[0.0], np.cumsum(steps)])


def _carried(vector: Float, start: Float, end: Float) -> Float:
    """Vectors (n, 3), each turned by the shortest turn from unit vector `start` to unit vector `end`."""
    axis, cosine = np.cross(start, end), np.einsum("ki,ki->k", start, end)[:, None]
    return np.asarray(
        vector + np.cross(axis, vector) + np.cross(axis, np.cross(axis, vector)) / np.maximum(1.0 + cosine, 1e-9)
    )
