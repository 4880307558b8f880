"""Which way the end face of a raw edge runs in each frame, and whether z counts away from the sensor.

`upper_side` says so roughly. Key frames are searched for the straight run along it, some 30 deg about. Rays that fan
out tell the sense of z by themselves; else what lies beside that run does, the plate's surfaces or what stands behind,
which is farther from the sensor than the face.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Cloud
from workbench.errors import InputError
from workbench.geometry.along import by_pass, running_median
from workbench.geometry.blocks import as_input, evenly, in_order
from workbench.geometry.end_face import best_direction
from workbench.units import DEG, Float, Int, Shaped

WHERE = "edge.segment_raw.upper_side"
LEAST_FRAMES, LEAST_LENGTH_MM = 3, 1.0  # of an edge
KEY_FRAMES = 60  # a pass
TRAVEL_FRAMES = 400  # that say where the scan goes
SEARCH = np.arange(-33.0, 34.0, 3.0) * DEG  # of the face's direction about `upper_side`
LEAST_ACROSS = 30.0 * DEG  # between `upper_side` and the edge
NEIGHBOURS = 4  # key frames on each side whose median direction counts
LEAST_COUNT, LEAST_VOTES, LEAST_SHARE, LEAST_MAJORITY = 3, 3, 0.25, 0.5
FAN_FRAMES, FAN_LEAST, FAN = 120, 10, 0.9  # frames in all, and of a column; correlation by which rays fan out
# Returns' scatter about their column's ray over the columns' pitch, at most: a sensor's own lie on it, while those of a
# cloud that was put into a grid scatter by 1/sqrt(12) about its columns.
OFF_RAY = 0.5 / np.sqrt(12.0)
BY_LOWER_END = (
    "that z counts {} the sensor is told only by what joins the lower end of the end face: it is the plate's lower "
    "surface, unless the plate lies on a table and its upper surface gives no returns; if so, give z_away"
)


class Directions(NamedTuple):
    """How the end face lies in N frames."""

    along: Shaped[Float, "N 2"]  # its direction in (x, z), unit, towards the upper side; NaN: none
    sense: float  # +1: z counts away from the sensor
    warnings: tuple[str, ...]


def face_directions(cloud: Cloud, upper_side: Sequence[float], z_away: bool | None) -> Directions:
    """How the end face lies in every frame.

    Raises InputError where `upper_side` is no direction across the edge, no raw edge is in view, or nothing tells
    whether z counts away from the sensor (+1) or towards it (-1).
    """
    wished = across_the_edge(cloud, upper_side)
    flat = np.stack([cloud.base_from_profiler[:, :3, k].astype(float) @ wished for k in (0, 2)], axis=1)
    size = np.linalg.norm(flat, axis=1, keepdims=True)
    flat = np.where(size > np.sin(LEAST_ACROSS), flat / size, np.nan)
    turn, votes, read = np.full(len(flat), np.nan), np.zeros((2, 2)), 0
    for mine in by_pass(cloud.pass_index, np.isfinite(flat[:, 0])):
        keys = mine[evenly(mine.size, KEY_FRAMES)]
        readings = _read_keys(cloud, keys, flat[keys])
        found = readings[:, 1] > 0
        votes += [_votes(readings[found, 2:4]), _votes(readings[found, 4:6])]
        read += int(found.sum())
        if found.any():
            number = np.arange(float(found.sum()))
            turn[mine] = np.interp(mine, keys[found], running_median(number, readings[found, 0], number, NEIGHBOURS))
    if not np.isfinite(turn).any():
        raise InputError(
            cloud.source,
            "no raw edge in view: expected an end face of 1 mm or more that runs along "
            f"upper_side {_text(upper_side)} within 30 deg",
        )
    c, s = np.cos(turn), np.sin(turn)
    along = np.stack([flat[:, 0] * c - flat[:, 1] * s, flat[:, 1] * c + flat[:, 0] * s], axis=1)
    if z_away is not None:
        return Directions(along, 1.0 if z_away else -1.0, ())
    sense = fan_sense(cloud) or _majority(votes[0], LEAST_VOTES)
    if sense:
        return Directions(along, sense, ())
    sense = _majority(votes[1], max(LEAST_VOTES, LEAST_SHARE * read))
    if not sense:
        raise InputError(
            cloud.source,
            "nothing beside the end face tells whether z counts away from the sensor: expected the plate's surface or "
            "something behind it in view, or z_away; or is the edge prepared already (edge.segment)?",
        )
    return Directions(along, sense, (BY_LOWER_END.format("away from" if sense > 0 else "towards"),))


def across_the_edge(cloud: Cloud, upper_side: Sequence[float], where: str = WHERE) -> Float:
    """`upper_side` as a unit vector (3,); InputError where it runs along the edge that was scanned."""
    wished: Float = np.array(upper_side, dtype=float)
    wished /= np.linalg.norm(wished)
    travelled = _travelled(cloud)
    length = float(np.linalg.norm(travelled))
    if len(cloud.keep) < LEAST_FRAMES or length < LEAST_LENGTH_MM:
        raise InputError(
            cloud.source,
            f"expected at least {LEAST_FRAMES} frames along at least {LEAST_LENGTH_MM:g} mm "
            f"of the edge, found {len(cloud.keep)} along {length:.2f} mm",
        )
    angle = np.arccos(min(1.0, abs(float(wished @ travelled)) / length))
    if angle < LEAST_ACROSS:
        raise InputError(
            where,
            f"expected a direction across the edge, from its lower to its upper side; "
            f"{_text(upper_side)} is within {angle / DEG:.0f} deg of the direction of the scan, "
            "which runs along the edge",
        )
    return wished


def _travelled(cloud: Cloud) -> Float:
    """How far (3,) the seen surface reaches through the base in the longest pass, mm: there and back is once."""
    shown = np.flatnonzero(cloud.keep.any(axis=1))
    shown = shown[evenly(shown.size, TRAVEL_FRAMES)]
    centre = np.full((len(cloud.keep), 3), np.nan)
    for i in shown:
        x, z = (float(np.median(v[i][cloud.keep[i]])) for v in (cloud.x_mm, cloud.z_mm))
        pose = cloud.base_from_profiler[i]
        centre[i] = pose[:3, 3] + x * pose[:3, 0] + z * pose[:3, 2]
    best = np.zeros(3)
    for seen in by_pass(cloud.pass_index, np.isfinite(centre[:, 0])):
        if seen.size >= 2:
            off = centre[seen] - np.median(centre[seen], axis=0)
            axis = np.linalg.svd(off, full_matrices=False)[2][0]
            moved = axis * float(np.ptp(np.percentile(off @ axis, [2.5, 97.5])))
            best = moved if np.linalg.norm(moved) > np.linalg.norm(best) else best
    return best


def _read_keys(cloud: Cloud, keys: Int, flat: Float) -> Float:
    """What `best_direction` finds in each key frame: (k, 6)."""
    x, z, keep = (as_input(v[keys]) for v in (cloud.x_mm, cloud.z_mm, cloud.keep))
    out = np.zeros((keys.size, 6))

    def read(i: int, _: int) -> None:
        best_direction(x[i], z[i], keep[i], flat[i, 0], flat[i, 1], SEARCH, out[i])

    for _ in in_order(read, keys.size, 1):
        pass
    return out


def _votes(counts: Float) -> Float:
    """Key frames (2,) that show what lies beside one end at higher, and at lower z; counts (k, 2): points of each.

    A frame counts if most of its points agree: a table that reaches out before the face lies nearer than it.
    """
    more = counts[:, 0] - counts[:, 1]
    clear = (counts.sum(axis=1) >= LEAST_COUNT) & (np.abs(more) > LEAST_MAJORITY * counts.sum(axis=1))
    return np.array([(clear & (more > 0)).sum(), (clear & (more < 0)).sum()], dtype=float)


def _majority(votes: Float, least: float) -> float:
    """+1 if the key frames agree that z counts away from the sensor, -1 if towards it; 0: they do not say.

    votes (2,): see `_votes` of one end. What lies beside the face is farther off than it. At the lower end that may be
    a table, which reaches out before the face as well.
    """
    above, below = votes
    if above + below < least or abs(above - below) < LEAST_MAJORITY * (above + below):
        return 0.0
    return 1.0 if above > below else -1.0


def fan_sense(cloud: Cloud) -> float:
    """+1 if the rays fan out in the sense of z, -1 if against it; 0: the columns are parallel, or resampled.

    A column's returns lie on its ray: x changes with z by the tangent of the ray's angle, which grows with x.
    """
    frames = evenly(len(cloud.keep), FAN_FRAMES)
    on = np.isfinite(cloud.x_mm[frames]) & np.isfinite(cloud.z_mm[frames])
    column = np.flatnonzero(on.sum(axis=0) >= FAN_LEAST)
    if column.size < FAN_LEAST:
        return 0.0
    on = on[:, column]
    x, z = (np.where(on, of[np.ix_(frames, column)], 0.0).astype(np.float64) for of in (cloud.x_mm, cloud.z_mm))
    count = on.sum(axis=0)
    at = x.sum(axis=0) / count
    off_x, off_z = np.where(on, x - at, 0.0), np.where(on, z - z.sum(axis=0) / count, 0.0)
    tangent = (off_x * off_z).sum(axis=0) / np.maximum((off_z**2).sum(axis=0), 1e-12)
    scatter = np.sqrt((np.where(on, off_x - tangent * off_z, 0.0) ** 2).sum(axis=0) / count)
    pitch = float(np.median(np.abs(np.diff(at))))
    if not np.ptp(tangent) > 0.0 or np.median(scatter) > OFF_RAY * pitch:
        return 0.0
    together = float(np.corrcoef(at, tangent)[0, 1])
    return float(np.sign(together)) if abs(together) > FAN else 0.0


def _text(vector: Sequence[float]) -> str:
    return "[" + ", ".join(f"{v:g}" for v in vector) + "]"
