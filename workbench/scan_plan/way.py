"""Where a pass leads the scanner: the edge as it is roughly known, and poses of the view along it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import splev, splprep
from scipy.ndimage import gaussian_filter1d

from workbench.errors import InputError
from workbench.geometry.moves import arc_lengths_mm, chords_mm, interpolated
from workbench.geometry.poses import pose_from, unit
from workbench.scan_plan.information import MARGIN_MM, Joint, Profiler, View, room_mm
from workbench.units import Float, Shaped

LEAST_MM = 5.0  # of edge, as an inspection needs
DRIFT, MOST_DRIFT = 0.2, 0.1  # columns per mm of edge, and the most, as a share of the columns
STATION_MM, SMOOTH_MM = 2.0, 10.0


@dataclass(frozen=True, slots=True, eq=False)
class EdgeLine:
    """The lower edge as it is roughly known, at k stations: t = m x n (docs/conventions.md), in the base."""

    arc_length_mm: Shaped[Float, " k"]
    position_mm: Shaped[Float, "k 3"]
    tangent: Shaped[Float, "k 3"]
    normal: Shaped[Float, "k 3"]  # n: outward normal of the root face
    across: Shaped[Float, "k 3"]  # m: from the lower to the upper side
    source: str
    surroundings_mm: Shaped[Float, "b 3"] | None = None  # what a coarse recording saw beside the plate, in the base
    roughness_mm: float | None = None  # of the end face, three standard deviations, as it saw it
    by_order: bool = False  # the order of taught points alone tells on which side of them the plate lies

    @property
    def length_mm(self) -> float:
        """From the first to the last station."""
        return float(self.arc_length_mm[-1])

    @classmethod
    def through(
        cls, points_mm: Shaped[Float, "p 3"], upper_side: Float, source: str | Path, *, by_order: bool = False
    ) -> EdgeLine:
        """Near points in order of t, as smoothly as half of what the view leaves free allows (root mean square).

        A scanner that follows errors of taught points swings, a stand-off away. `upper_side` (3,) or (p, 3): roughly m.

        Raises:
            InputError: less than 5 mm of edge, or an upper side along the edge.
        """
        step = chords_mm(points_mm)
        points = points_mm[np.append(True, step > 1e-6)]
        upper = np.broadcast_to(upper_side, points_mm.shape)[np.append(True, step > 1e-6)]
        along = arc_lengths_mm(points)
        if along[-1] < LEAST_MM:
            why = f"expected an edge of {LEAST_MM:g} mm and more, found {along[-1]:.2g}: are its points in metres?"
            raise InputError(str(source), why)
        at = np.linspace(0.0, along[-1], max(2, round(along[-1] / STATION_MM) + 1))
        both = np.union1d(along, at)  # a long straight piece holds the curve too
        every = interpolated(both, along, points).T
        given, up = (interpolated(at, along, a) for a in (points, upper))
        for room in 0.5 * MARGIN_MM * 0.5 ** np.arange(12):  # less where the mean hides a corner that is cut
            spline = splprep(every, u=both, k=min(2, len(both) - 1), s=len(both) * room**2)[0]
            position, tangent = (np.stack(splev(at, spline, der), axis=1) for der in (0, 1))
            off = gaussian_filter1d(position - given, SMOOTH_MM / STATION_MM, axis=0, mode="nearest")
            if np.linalg.norm(off, axis=1).max() <= MARGIN_MM:
                break
        at = arc_lengths_mm(position)
        tangent = unit(tangent)
        across = up - (up * tangent).sum(axis=1)[:, None] * tangent
        size = np.linalg.norm(across, axis=1)
        if size.min() < 0.1:
            raise InputError(str(source), "expected an upper side across the edge, found one along it")
        across /= size[:, None]
        return cls(at, position, tangent, np.cross(tangent, across), across, str(source), by_order=by_order)

    def at(self, arc_length_mm: Float) -> EdgeLine:
        """The same at other stations; beyond its ends it goes straight on."""
        s = np.asarray(arc_length_mm)
        inside = np.clip(s, 0.0, self.length_mm)
        position, tangent, across = (
            interpolated(inside, self.arc_length_mm, a) for a in (self.position_mm, self.tangent, self.across)
        )
        tangent, across = unit(tangent), unit(across)
        position = position + (s - inside)[:, None] * tangent
        return EdgeLine(s, position, tangent, np.cross(tangent, across), across, self.source, self.surroundings_mm)


def drift_mm(joint: Joint, profiler: Profiler, view: View, length_mm: float) -> float:
    """By how much the scanner moves across its view along the pass, mm, as far as the section has room in it.

    One column alone never tells where a face ends; columns that move past the edge do. Points that are taught wrong by
    some tenths of a mm move them as well, so passes drift to either side in turn: not all of them can be undone.
    """
    columns = min(DRIFT * length_mm, MOST_DRIFT * profiler.columns)
    return max(0.0, min(columns * profiler.pitch_mm(view.standoff_mm), room_mm(joint, profiler, view)))


def aim_mm(joint: Joint, view: View) -> Shaped[Float, " 2"]:
    """The middle of what is to be seen of the section, along n and m from the lower edge."""
    s, c = math.sin(view.elevation), math.cos(view.elevation)
    turn = np.array([[-s, c], [c, s]])  # across the rays, along them
    seen = joint.section_mm @ turn.T
    return np.asarray(0.5 * (seen.min(axis=0) + seen.max(axis=0)) @ turn)


def view_poses(
    edge: EdgeLine, joint: Joint, view: View, half_turn: bool, length_mm: float, drift_mm: float
) -> Shaped[Float, "k 4 4"]:
    """base_from_view at the stations of an edge `length_mm` long.

    The view's origin is the laser's middle at the stand-off, x across the view, z along the rays, y = z x x. With a
    `half_turn` about the rays y is -t. The view drifts across, by `drift_mm` on the whole way.
    """
    s, c = math.sin(view.elevation), math.cos(view.elevation)
    n, m, t = edge.normal, edge.across, edge.tangent
    x, z = c * m - s * n, -(c * n + s * m)
    share = edge.arc_length_mm / length_mm - 0.5
    u, v = aim_mm(joint, view)
    origin = edge.position_mm + u * n + v * m + (share * drift_mm)[:, None] * x
    z = math.cos(view.lead) * z + math.sin(view.lead) * np.cross(x, z)
    x = -x if half_turn else x
    return pose_from(np.stack([x, np.cross(z, x), z], axis=2), origin) if len(t) else np.empty((0, 4, 4))


def eyes_mm(profiler: Profiler, view: View, base_from_view: Float) -> Float:
    """Where laser and camera look from, (k, 2, 3) in the base."""
    laser = np.array([0.0, 0.0, -view.standoff_mm])
    side = {"x": 0, "y": 1}[profiler.camera_side[-1]]
    camera = laser.copy()
    camera[side] += math.copysign(1.0, -1.0 if profiler.camera_side.startswith("-") else 1.0) * (
        view.standoff_mm * math.tan(profiler.triangulation)
    )
    eyes = np.stack([laser, camera])
    return np.asarray(np.einsum("kij,ej->kei", base_from_view[:, :3, :3], eyes) + base_from_view[:, None, :3, 3])
