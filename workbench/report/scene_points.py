"""Which points of a cloud a scene holds: many about the ends of faces, where corners are, the rest evenly in space."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np

from workbench.artefacts import UNLABELLED, Cloud, Edge
from workbench.report.sample import Points, at_places, overview
from workbench.units import AnyArray, Float, Int

CORNER_SHARE = 0.4  # of the points that lie near ends of faces, at most
CORNER_COLUMNS = np.arange(-3, 4)  # about each end of a face
CANDIDATES = 4  # points looked at for one that is taken
TRIES = 6  # voxel sizes tried


def telling(cloud: Cloud, edge: Edge, budget: int) -> Points:
    """At most `budget` kept points, in an order of which any first part shows the whole."""
    corners = near_ends(cloud, edge, int(CORNER_SHARE * budget))
    rest = overview(cloud, edge, CANDIDATES * budget)
    rest = evenly(rest.where(~np.isin(_place(rest, cloud), _place(corners, cloud))), budget - len(corners.label))
    order = np.random.default_rng(0)  # the same every time
    rank = [order.permutation(len(each.label)) / max(1, len(each.label)) for each in (corners, rest)]
    both = (np.concatenate([getattr(corners, f.name), getattr(rest, f.name)]) for f in fields(Points))
    return Points(*both).where(np.argsort(np.concatenate(rank), kind="stable"))


def _place(points: Points, cloud: Cloud) -> Int:
    """(n,) where in the grid each point is, as one number."""
    place: Int = points.frame * cloud.x_mm.shape[1] + points.column
    return place


def near_ends(cloud: Cloud, edge: Edge, budget: int) -> Points:
    """At most `budget` kept points of the columns about the first and the last one of each face in a frame."""
    frames, columns = cloud.x_mm.shape
    faces = [label for label in edge.faces or np.unique(edge.labels[:: max(1, frames // 300)]) if label != UNLABELLED]
    a_frame = 2 * len(faces) * len(CORNER_COLUMNS)
    some = np.arange(0, frames, max(1, math.ceil(frames * a_frame / max(1, budget))))
    found = [_ends(cloud, edge, some, int(face)) for face in faces]
    place = np.unique(np.concatenate([np.zeros(0, np.int64), *found]))
    frame, column = place // columns, place % columns
    there = cloud.keep[frame, column] & np.isfinite(cloud.x_mm[frame, column]) & np.isfinite(cloud.z_mm[frame, column])
    return at_places(cloud, edge, frame[there], column[there])


def _ends(cloud: Cloud, edge: Edge, frames: Int, face: int) -> Int:
    """Places frame x M + column about both ends of a face in each of `frames`."""
    here = (edge.labels[frames] == face) & cloud.keep[frames]
    seen = here.any(axis=1)
    frames, here, columns = frames[seen], here[seen], here.shape[1]
    ends = np.stack([here.argmax(axis=1), columns - 1 - here[:, ::-1].argmax(axis=1)], axis=1)
    column = np.clip(ends[:, :, None] + CORNER_COLUMNS, 0, columns - 1)
    return np.asarray((frames[:, None, None] * columns + column).ravel(), dtype=np.int64)


def evenly(points: Points, budget: int) -> Points:
    """At most `budget` of the points: one in each cell of a cubic grid in space, as fine as that allows."""
    if len(points.label) <= budget:
        return points
    offset = points.position_mm - points.position_mm.min(axis=0)
    first, cell_mm = np.arange(0), math.sqrt(float(np.prod(np.sort(offset.max(axis=0))[1:])) / max(1, budget))
    for _ in range(TRIES):  # on surfaces the number of cells goes with one over the square of their size
        found = _first_in_cells(offset, cell_mm)
        if len(first) < len(found) <= budget:
            first = found
        if 0.9 * budget <= len(found) <= budget:
            break
        cell_mm *= math.sqrt(len(found) / (0.95 * budget))
    return points.where(first)


def _first_in_cells(offset_mm: Float, cell_mm: float) -> AnyArray:
    cell = (offset_mm / cell_mm).astype(np.int64)
    count = cell.max(axis=0) + 1
    return np.unique((cell[:, 0] * count[1] + cell[:, 1]) * count[2] + cell[:, 2], return_index=True)[1]
