"""A plate that lies on something: how far above it the returns of its root face end (docs/method.md, section 3)."""

from __future__ import annotations

import math

import numpy as np

from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, Cloud
from workbench.edge.faces import TrackedFaces
from workbench.edge.raw_faces import RawFaces
from workbench.geometry import end_face
from workbench.geometry.along import in_order, near, running_median
from workbench.geometry.blocks import as_input
from workbench.geometry.tracking import FINAL_SIGMAS
from workbench.kernels import kernel
from workbench.units import Bool, Float, Float32

NEAR_MM = 5.0  # of a station, to each side, whose frames have a say
GATE_MM = 0.01  # beyond the gate of the range noise: returns that lie deeper are not on the root face
BEHIND = 1.0 / 3.0  # share of a gap's columns that return from behind the face: noise hides those next to the crossing


def under_u_mm(cloud: Cloud, tracked: TrackedFaces, s_frames: Float, at: Float) -> Float:
    """Standard uncertainty (m,), mm, of the lower edge at arc lengths `at` of a plate that lies on something; else 0.

    The root face may end above where it crosses what the plate lies on, by a gap below the plate; or by its rounded
    edge, which that crossing takes off. What returns from behind its line tells by how much; a part of a column and
    what noise hides of it are not told. s_frames (N,): where each frame shows the edge.
    """
    root, table = tracked.faces[ROOT_FACE], tracked.faces[LOWER_SURFACE]
    on = np.flatnonzero(tracked.lies_on & np.isfinite(s_frames) & (table.count > 2))
    if not on.size:
        return np.zeros(at.size)
    slope, offset = root.slope[on], root.z(np.zeros(root.count.size))[on]
    bevel = tracked.faces[BEVEL_FACE]
    away = np.sign(tracked.side[on] * (slope - bevel.slope[on]))  # +1: z counts away from the sensor
    gate = FINAL_SIGMAS * tracked.range_sigma_mm[on, 2] + GATE_MM
    known = np.stack(
        [root.x_mean[on], root.crossing(table)[on], slope, offset, away, gate, tracked.root_end[on, 2]], axis=1
    )
    gap, of_frames = np.empty(on.size), np.full(s_frames.size, np.nan)
    x, z, keep = (as_input(v[on]) for v in (cloud.x_mm, cloud.z_mm, cloud.keep))
    _gaps(x, z, keep, as_input(known), gap)
    of_frames[on] = gap
    return gap_u_mm(of_frames, s_frames, at, math.hypot(0.5 * float(np.median(known[:, -1])), np.median(gate)))


def raw_under_u_mm(found: RawFaces, s_frames: Float, at: Float) -> Float:
    """As `under_u_mm`, of the lower edge of a raw plate."""
    gap = found.lower.gap_mm
    on = np.flatnonzero(np.isfinite(gap) & np.isfinite(s_frames))
    if not on.size:
        return np.zeros(at.size)
    face = found.whole
    step = float(np.median(face.widths_mm[on] / face.count[on]))
    gate = max(FINAL_SIGMAS * float(np.median(np.sqrt(face.rss[on] / face.count[on]))), end_face.FINAL_LEAST_MM)
    return gap_u_mm(gap, s_frames, at, math.hypot(0.5 * step, gate))


def gap_u_mm(gap_mm: Float, s_frames: Float, at: Float, hidden_mm: float) -> Float:
    """Standard uncertainty (m,) at arc lengths `at`, by the gaps (N,) of frames at s_frames (N,), NaN without one; mm.

    hidden_mm: what frames do not show. The edge lies between where the face ends and where it crosses what is below.
    """
    on, shown = in_order(s_frames), np.isfinite(gap_mm)
    first, last = near(s_frames[on], at, NEAR_MM)
    count = np.append(0, np.cumsum(shown[on]))
    share = (count[last] - count[first]) / np.maximum(last - first, 1)  # a single frame may be misread
    typical_mm = running_median(s_frames, gap_mm, at, NEAR_MM)
    return np.asarray(np.hypot(typical_mm, hidden_mm) * np.sqrt(share / 3.0))


@kernel
def _gaps(x: Float32, z: Float32, keep: Bool, known: Float, gap: Float) -> None:
    """Fill in for f frames how far before the crossing most returns lie behind the root face, along it (f,), mm.

    Or how far, by more than a column, none lies on it: rays may go down between the face and what joins its line.
    known (f, 7): x of the root face's middle and of the crossing, the face's slope and offset, sense of z, gate, and a
    column's step along the face.
    """
    columns = x.shape[1]
    before, behind = np.empty(columns), np.empty(columns, np.bool_)
    for i in range(len(known)):
        middle, crossing, slope, offset = known[i, 0], known[i, 1], known[i, 2], known[i, 3]
        lean = math.sqrt(1.0 + slope * slope)
        low, high = min(middle, crossing), max(middle, crossing)
        size = 0
        for j in range(columns):
            if keep[i, j] and low < x[i, j] < high:
                before[size] = abs(x[i, j] - crossing) * lean
                behind[size] = (z[i, j] - slope * x[i, j] - offset) / lean * known[i, 4] > known[i, 5]
                size += 1
        # From the crossing on: columns come in order of x, either way.
        rising = size > 1 and before[0] < before[size - 1]
        deep = 0
        gap[i], on_face = 0.0, False
        for k in range(size):
            m = k if rising else size - 1 - k
            if not (behind[m] or on_face):
                gap[i], on_face = max(gap[i], before[m] - known[i, 6]), True
            deep += behind[m]
            if behind[m] and deep >= BEHIND * (k + 1):
                gap[i] = max(gap[i], before[m])
