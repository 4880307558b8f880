"""What the robot's path leaves of a registered scan: small motions that all faces of a stretch share.

A robot that errs smoothly along its path moves every face of a stretch together: a shift d across the edge and a turn w
about it. With m = (d, w), a place i with normal n_i and lever l_i about the stretch's middle comes to lie off by

    r_i = f_i' m,    f_i = (n_i, l_i).

A change of one face does not move the others. So for places i, j of different faces

    E[r_i r_j] = f_i' S f_j,    S = E[m m'], 3 x 3 in the section,

linear in S, which the pairs of a stretch determine by least squares: wholly where it shows three faces, and where it
shows two as near to an even shift as they allow. Pairs of one face are left out: there a change and a motion are alike.
A part that is bent between two scans, or two faces that were milled again together, move in the same way and count so.
"""

from __future__ import annotations

import math

import numpy as np

from workbench.units import DEG, Float, Int, Shaped

STRETCH_MM = 4.0  # as far as places are taken to share a motion: that of `compare.register`
ONE_FACE_DEG = 15.0  # normals less apart may belong to one face
MOST_PLACES = 300  # of a stretch that are paired: 45,000 pairs
LEAST_STRETCHES = 3  # that show two faces: below, nothing is known of the path
DETERMINED = 0.05  # least singular value of what the pairs tell of S, of the greatest


def path_error_u(
    position_mm: Shaped[Float, "c 3"],
    distance_mm: Shaped[Float, " c"],
    normal: Shaped[Float, "c 3"],
    arc_length_mm: Shaped[Float, " c"],
) -> Float | None:
    """Standard uncertainty (c,), mm, of a scan along its places' normals by its path; None: one face tells nothing.

    At every place the larger of what its stretch shows and of the mean shift over all stretches.

    Args:
        position_mm: (c, 3) of places.
        distance_mm: (c,) of a registered scan from the reference there, NaN where there is none.
        normal: (c, 3) unit.
        arc_length_mm: (c,) along the part.
    """
    stretch = np.floor(arc_length_mm / STRETCH_MM)
    variance = np.full(len(distance_mm), np.nan)
    shifts = []
    for k in np.unique(stretch[np.isfinite(stretch)]):
        mine = np.flatnonzero(stretch == k)
        seen = np.flatnonzero(np.isfinite(distance_mm[mine]))
        seen = seen[:: -(-len(seen) // MOST_PLACES) or 1]
        pairs = _of_two_faces(normal[mine[seen]])
        if pairs is not None:
            f = _in_section(position_mm[mine], normal[mine])
            shared = _shared(f[seen], distance_mm[mine[seen]], *pairs)
            variance[mine] = ((f @ shared) * f).sum(axis=1)
            shifts.append(0.5 * float(np.trace(shared[:2, :2])))
    if len(shifts) < LEAST_STRETCHES:
        return None
    return np.asarray(np.sqrt(np.fmax(variance, float(np.mean(shifts)))))


def _of_two_faces(normal: Float) -> tuple[Int, Int] | None:
    """Pairs of places whose faces differ; None: no second face, or none but at a right angle."""
    cosine = normal @ normal.T
    first, second = np.nonzero(np.triu(np.abs(cosine) < math.cos(ONE_FACE_DEG * DEG)))
    enough = len(first) > len(normal) and float((cosine[first, second] ** 2).mean()) > DETERMINED
    return (first, second) if enough else None


def _in_section(position_mm: Float, normal: Float) -> Float:
    """f (c, 3) of places: the normal in the plane of all normals, and the lever about their middle by its rms."""
    along, *plane = np.linalg.eigh(normal.T @ normal)[1].T  # all normals stand square to the edge
    lever = np.cross(position_mm - position_mm.mean(axis=0), normal) @ along
    return np.column_stack([*(normal @ axis for axis in plane), lever / max(float(np.sqrt((lever**2).mean())), 1e-9)])


def _shared(f: Float, distance_mm: Float, first: Int, second: Int) -> Float:
    """S (3, 3), mm^2, of one stretch by its pairs of places."""
    a, b = f[first], f[second]
    squares = a * b
    mixed = np.stack([a[:, i] * b[:, j] + a[:, j] * b[:, i] for i, j in ((0, 1), (0, 2), (1, 2))], axis=1)
    rows = np.hstack([squares, mixed])
    product = distance_mm[first] * distance_mm[second]
    even = squares[:, 0] + squares[:, 1]  # of a shift alike in all directions
    level = max(float(even @ product) / float(even @ even), 0.0)
    x, y, turn, xy, x_turn, y_turn = np.linalg.lstsq(rows, product - level * even, rcond=DETERMINED)[0]
    found = np.array([[level + x, xy, x_turn], [xy, level + y, y_turn], [x_turn, y_turn, turn]])
    size, axes = np.linalg.eigh(found)
    return np.asarray((axes * np.maximum(size, 0.0)) @ axes.T)
