"""The smooth lower and upper edge of a raw edge and the direction of its end face, from what all frames show.

All is measured relative to a reference curve, which in the end is the lower edge itself: how far each frame's end face
stands out of it (along n), and how far its two ends lie from it along the face (along m). Roughness and vibration
average out along the edge; the end face's direction is one for the whole edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.artefacts import LOWER_SURFACE, ROOT_FACE, UPPER_SURFACE, Cloud
from workbench.edge.directions import pass_tilt, runs_forward, smooth_slope, wrapped
from workbench.edge.measure import check_advance
from workbench.edge.raw_ends import EndCourse, end_course, frame_shift, place_ends, range_noise
from workbench.edge.raw_faces import RawFaces, middle_of, outward_of
from workbench.geometry.courses import fit_course_curve
from workbench.geometry.curves import Curve, arrange, fit_curve
from workbench.geometry.sections import SectionLines, section_lines
from workbench.units import Float

ROUNDS = 3
BLOCKS_MM = (5.0, 10.0, 20.0)  # of edge whose frames' directions count as one


@dataclass(frozen=True, slots=True, eq=False)
class RawMeasured:
    """The lower edge as a curve with the lower and the upper edge along m from it; directions; N frames."""

    curve: Curve
    tilt: float  # direction of the end face, from the lower to the upper side, against a of the curve's frame; rad
    tilt_u: float  # rad
    lean: float  # turn from there to the direction of the upper surface into the plate; NaN: not seen; rad
    s: Float  # (N,) where each frame shows the lower edge, mm; NaN where it does not
    s_upper: Float  # (N,) likewise the upper edge
    lower: EndCourse
    upper: EndCourse
    stand_out: Float  # (N,) of each frame's end face from the curve, along n; NaN where not seen; mm
    s_face: Float  # (N,) where
    lever_mm: float  # from the lower edge to the middle of what is seen of the end face
    tangent_u: float  # rad


def measure_raw_edge(cloud: Cloud, found: RawFaces) -> RawMeasured:
    """Measure the edge in the section planes of its own smooth course: starts from the faces' middles, repeats.

    Raises InputError where the frames do not run along an edge.
    """
    middle = middle_of(cloud, found.faces[ROOT_FACE])
    seen = found.seen & np.isfinite(middle).all(axis=1)
    check_advance(cloud, middle[seen])
    t = np.cross(_upwards(cloud, found), outward_of(cloud, found))
    forward = runs_forward(middle, t, cloud.pass_index, found.seen)
    s = np.full(seen.size, np.nan)
    s[seen] = arrange(middle[seen], cloud.pass_index[seen], forward[seen])
    tangent_u = fit_curve(middle[seen], s[seen]).tangent_u
    travelled = middle[np.nanargmax(s)] - middle[np.nanargmin(s)]
    curve = fit_course_curve(middle[seen], s[seen], _across(cloud, found, travelled))
    sigma = range_noise(cloud, found)
    for last in [False] * ROUNDS + [True]:
        s[seen] = curve.project(middle[seen], s[seen])
        slope = smooth_slope(found.faces[ROOT_FACE], s, cloud.pass_index)
        face = section_lines(found.faces[ROOT_FACE], slope, cloud.base_from_profiler, found.side,
                             np.full(seen.size, sigma), curve, s)  # fmt: skip
        tilt = _mean_angle(pass_tilt(face, cloud.pass_index))
        m, n = np.array([math.cos(tilt), math.sin(tilt)]), np.array([-math.sin(tilt), math.cos(tilt)])
        stand_out = face.place @ n
        placed = tuple(place_ends(cloud, found, ends, way, curve, s, tilt, sigma)
                       for ends, way in ((found.lower, -1.0), (found.upper, 1.0)))  # fmt: skip
        shift = frame_shift((placed[0], placed[1]), _vibration(cloud, stand_out))
        lower = end_course(placed[0], shift, cloud.pass_index, last)
        if not last:
            on = np.isfinite(stand_out) & np.isfinite(face.s)
            _, a, b = curve.frame(face.s[on])
            spot = stand_out[on, None] * n + lower.rough(face.s[on])[:, None] * m
            points = curve.position(face.s[on]) + spot[:, :1] * a + spot[:, 1:] * b
            lean = [_lean(cloud, found, curve, s, tilt, sigma, f) for f in (UPPER_SURFACE, LOWER_SURFACE)]
            square = tilt + next((turn + math.pi / 2.0 for turn in lean if math.isfinite(turn)), 0.0)
            across = _unit((math.cos(square) * a + math.sin(square) * b).mean(axis=0))
            curve = fit_course_curve(points, face.s[on], across, float(np.nanmedian(placed[0].step)))
    upper = end_course(placed[1], shift, cloud.pass_index, True)
    return RawMeasured(
        curve, tilt, _tilt_u(face, tilt), _lean(cloud, found, curve, s, tilt, sigma, UPPER_SURFACE),
        np.where(lower.used, placed[0].s, np.nan), np.where(upper.used, placed[1].s, np.nan), lower, upper, stand_out,
        face.s, float(np.nanmedian(face.place @ m)), tangent_u,
    )  # fmt: skip


def _upwards(cloud: Cloud, found: RawFaces) -> Float:
    """Direction (N, 3) of the end face in each laser plane, from the lower to the upper side; NaN where not seen."""
    face = found.faces[ROOT_FACE]
    slope = (face.sxz / face.sxx)[:, None]
    ex, ez = cloud.base_from_profiler[:, :3, 0], cloud.base_from_profiler[:, :3, 2]
    return np.asarray(-found.side[:, None] * (ex + slope * ez) / np.hypot(1.0, slope))


def _across(cloud: Cloud, found: RawFaces, travelled: Float) -> Float:
    """Direction (3,) of the end face across the edge, roughly; travelled (3,): along it."""
    up = np.nanmedian(_upwards(cloud, found), axis=0)
    return _unit(up - travelled * (up @ travelled) / (travelled @ travelled))


def _unit(vector: Float) -> Float:
    return np.asarray(vector / np.linalg.norm(vector))


def _vibration(cloud: Cloud, stand_out: Float) -> Float:
    """Standard deviation of what shifts each frame by itself (N,), pass by pass, from how the end face jumps; mm."""
    out = np.full(stand_out.shape, np.nan)
    for p in np.unique(cloud.pass_index):
        mine = np.flatnonzero((cloud.pass_index == p) & np.isfinite(stand_out))
        second = np.abs(np.diff(stand_out[mine], 2)) if mine.size > 2 else np.zeros(1)
        out[cloud.pass_index == p] = float(np.median(second)) / 0.6745 / math.sqrt(6.0)
    return out


def _mean_angle(angle: Float) -> float:
    return float(np.angle(np.nanmean(np.exp(1j * angle))))


def _tilt_u(face: SectionLines, tilt: float) -> float:
    """Standard uncertainty of the end face's direction, rad: the largest that blocks of edge show by their scatter.

    Roughness hangs together over centimetres, so that short blocks may agree by chance.
    """
    on = np.isfinite(face.angle) & np.isfinite(face.s)
    s, off = face.s[on], wrapped(face.angle[on] - tilt)
    found = [float(np.std(off)) / math.sqrt(off.size)]
    for length in BLOCKS_MM:
        blocks = round(float(np.ptp(s)) / length)
        if blocks >= 3:
            number = np.minimum((s - s.min()) / np.ptp(s) * blocks, blocks - 1).astype(np.int64)
            means = np.array([np.median(off[number == k]) for k in np.unique(number)])
            found.append(float(np.std(means, ddof=1)) / math.sqrt(means.size))
    return max(found)


def _lean(cloud: Cloud, found: RawFaces, curve: Curve, s: Float, tilt: float, sigma: float, label: int) -> float:
    """Turn from the end face's direction to that of a surface of the plate, into it; NaN if it is never seen."""
    surface = found.faces[label]
    if (surface.count > 0).sum() < 3:
        return math.nan
    slope = smooth_slope(surface, s, cloud.pass_index)
    lines = section_lines(surface, slope, cloud.base_from_profiler, found.side, np.full(s.size, sigma), curve, s)
    turn = _mean_angle(2.0 * wrapped(lines.angle - tilt)) / 2.0  # a line has two senses; the plate lies at -n
    return turn if math.sin(turn) < 0.0 else turn - math.pi
