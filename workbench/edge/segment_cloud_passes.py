"""Whether a cloud without order holds several scanning passes: by the traces of scan lines on its faces."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Cloud
from workbench.edge.faces import TrackedFaces
from workbench.edge.segment_cloud_sheets import LEAST_POINTS, LEAST_SLICES
from workbench.geometry.chains import FaceLines
from workbench.geometry.gridless import Laid, Traces, seen_from, traces
from workbench.geometry.moves import arc_lengths_mm
from workbench.units import Float

PATCHES, LONG_MM, WIDE_MM, THICK_MM = 12, 2.0, 1.0, 0.3  # a face; of a patch along the edge, across, off the face
LONG_SLICES = 7  # a patch is at least so long
SEVERAL, ONE = 0.35, 0.8  # of a face's patches, at the least, that show several passes, or one


def passes_shown(laid: Laid, view: Float, cloud: Cloud, found: TrackedFaces) -> Traces:
    """Whether root face or bevel shows lines of several passes, or both those of one; "none": neither.

    laid, view: the points whose slices `cloud` holds. Passes that agree to within their noise are several all the same.
    """
    at = float(laid.s.min()) + arc_lengths_mm(cloud.base_from_profiler[:, :3, 3])
    seen = [list(_of_face(laid, view, at, found.faces[label])) for label in (ROOT_FACE, BEVEL_FACE)]
    if any(face.count("several passes") > SEVERAL * len(face) for face in seen):
        return "several passes"
    return "one pass" if all(face and face.count("one pass") >= ONE * len(face) for face in seen) else "none"


def _of_face(laid: Laid, view: Float, at: Float, face: FaceLines) -> Iterator[Traces]:
    """What patches of the face show; at (N,): arc length of each slice."""
    x, z = seen_from(laid, view, at)[1]
    known = np.flatnonzero(face.count > LEAST_SLICES)
    if not known.size:
        return
    length = max(LONG_MM, LONG_SLICES * float(np.median(np.diff(at))))
    for start in np.linspace(at[known[0]], max(at[known[-1]] - length, at[known[0]]), PATCHES):
        frames = known[(at[known] >= start) & (at[known] < start + length)]
        if frames.size >= LEAST_SLICES:
            points = np.flatnonzero((laid.s >= start) & (laid.s < start + length))
            middle, height, slope = face.typical(frames)
            across = (x[points] - middle) * np.hypot(1.0, slope)
            off = (z[points] - height - slope * (x[points] - middle)) / np.hypot(1.0, slope)
            here = (np.abs(across) < 0.5 * WIDE_MM) & (np.abs(off) < THICK_MM)
            if here.sum() >= LEAST_POINTS:
                yield traces(across[here], laid.s[points[here]])
