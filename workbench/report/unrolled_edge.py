"""Coordinates along and across the edge: the edge laid out straight, each section in its own plane.

For a point p near arc length s: u = (p - P(s)) . n, v = (p - P(s)) . m with the lower edge P and the axes (n, m) of
the stations, where s is the foot point, (p - P(s)) . t = 0. So a section of a curved edge is drawn without the
curvature.
"""

from __future__ import annotations

import math

import numpy as np

from workbench.artefacts import Edge, Section
from workbench.units import Float

FOOT_STEPS = 3  # Newton steps to the foot point: each divides its error by the radius over the distance
FOOT_MM = 1e-4  # a step as short is the last: the foot is then known far better


def developed(position_mm: Float, start_mm: Float, edge: Edge) -> Float:
    """(n, 3) arc length s, u (outward) and v (from the lower to the upper side), mm, of base positions (n, 3).

    `start_mm` (n,): arc length near each point, where the search for its foot point starts; NaN gives NaN.
    """
    arc_length = start_mm
    for _ in range(FOOT_STEPS):
        offset, tangent = _offset(position_mm, arc_length, edge)
        step = np.einsum("ij,ij->i", offset, tangent)
        arc_length = arc_length + step
        if not (np.abs(step) > FOOT_MM).any():
            break
    offset = position_mm - _on_curve(arc_length, edge)
    u = np.einsum("ij,ij->i", offset, axes_at(arc_length, edge, edge.normal))
    v = np.einsum("ij,ij->i", offset, axes_at(arc_length, edge, edge.across))
    return np.column_stack([arc_length, u, v])


def in_section(position_mm: Float, start_mm: Float, edge: Edge, section: Section) -> Float:
    """(n, 2) u and v in the section's own axes, which differ from the stations' by a turn about t and an origin."""
    _, u, v = developed(position_mm, start_mm, edge).T
    here = np.array([section.arc_length_mm])
    normal, across = axes_at(here, edge, edge.normal)[0], axes_at(here, edge, edge.across)[0]
    turn = math.atan2(float(section.normal @ across), float(section.normal @ normal))
    shift = section.origin_mm - _on_curve(here, edge)[0]
    u, v = u - shift @ normal, v - shift @ across
    return np.column_stack([math.cos(turn) * u + math.sin(turn) * v, math.cos(turn) * v - math.sin(turn) * u])


def _offset(position_mm: Float, arc_length: Float, edge: Edge) -> tuple[Float, Float]:
    """p - P(s) and t(s)."""
    return position_mm - _on_curve(arc_length, edge), axes_at(arc_length, edge, edge.tangent)


def _on_curve(arc_length: Float, edge: Edge) -> Float:
    """P(s): through the measured stations along their tangents, straight on beyond the first and the last of them."""
    measured = np.isfinite(edge.position_mm).all(axis=1)
    stations = edge.arc_length_mm[measured]
    inside = np.clip(arc_length, stations[0], stations[-1])
    if len(stations) == 1:
        on_curve = np.repeat(edge.position_mm[measured], len(inside), axis=0)
    else:
        on_curve = _hermite(inside, stations, edge.position_mm[measured], edge.tangent[measured])
    out = np.flatnonzero(inside != arc_length)  # few; NaN stays NaN
    on_curve[out] += (arc_length - inside)[out, None] * axes_at(inside[out], edge, edge.tangent)
    return np.asarray(on_curve)


def _hermite(at: Float, x: Float, y: Float, slope: Float) -> Float:
    """(n, 3) the piecewise cubic through places y (m, 3) with slopes (m, 3) at x (m,) rising."""
    k = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    step = (x[k + 1] - x[k])[:, None]
    t = (at - x[k])[:, None] / step
    left, right = 1.0 - t, t
    ends = left * left * (1.0 + 2.0 * t) * y[k] + right * right * (3.0 - 2.0 * t) * y[k + 1]
    return np.asarray(ends + step * left * right * (left * slope[k] - right * slope[k + 1]))


def axes_at(arc_length: Float, edge: Edge, vectors: Float) -> Float:
    """Unit vectors of the stations, interpolated."""
    mixed = np.column_stack([np.interp(arc_length, edge.arc_length_mm, axis) for axis in vectors.T])
    unit: Float = mixed / np.sqrt(np.einsum("ij,ij->i", mixed, mixed))[:, None]
    return unit
