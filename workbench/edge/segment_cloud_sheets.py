"""Whether a sliced cloud is one surface: passes that disagree show as two sheets on its faces."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from workbench.artefacts import FACE_NAMES, Cloud
from workbench.edge.faces import TrackedFaces
from workbench.errors import InputError
from workbench.geometry.along import by_pass
from workbench.geometry.blocks import evenly
from workbench.geometry.chains import FaceLines
from workbench.geometry.gridless import SPAN_MM, Sheets, two_sheets
from workbench.geometry.moves import arc_lengths_mm
from workbench.units import Float, Int

STRETCH_MM, WIDE_MM, RIM_MM = 3.0, 2.0, 0.1  # of a patch, along the edge and across; left out at a face's ends
MOST_STRETCHES = 60
STRETCH_SLICES = 10  # a patch is at least so long
LEAST_POINTS, LEAST_SLICES = 60, 3
GAIN, APART, SHARE = 12.0, 2.0, 0.08  # two sheets: log-likelihood; sigmas between them; points on the smaller
LEAST_PATCHES, LEAST_PART = 3, 0.04  # so many patches of a face, and such a part of them: no chance


def check_one_sheet(cloud: Cloud, found: TrackedFaces) -> None:
    """Refuse a sliced cloud on whose faces points lie on two sheets: what was merged there does not agree.

    Every face is looked at in patches, small enough to be flat; cells of slices hold points of either sheet, as chance
    will. Noise of one surface may be correlated and may have stray returns: both are no two sheets.
    """
    for label, face in found.faces.items():
        fits = [two_sheets(*patch) for patch in _patches(cloud, face)]
        two = [fit for fit in fits if _is_double(fit)]
        if len(two) >= max(LEAST_PATCHES, LEAST_PART * len(fits)):
            apart = float(np.median([fit.distance_mm for fit in two]))
            raise InputError(
                cloud.source,
                f"points of the {FACE_NAMES[label]} lie on two sheets {apart:.2g} mm apart "
                f"in {len(two)} of {len(fits)} places: expected one surface. Passes do not agree, or the "
                "robot shook; give points in scan order or each pass alone",
            )


def _is_double(fit: Sheets) -> bool:
    return fit.gain > GAIN and fit.distance_mm > APART * fit.sigma_mm and fit.smaller_share > SHARE


def _patches(cloud: Cloud, face: FaceLines) -> Iterator[tuple[Float, Float, Float]]:
    """Points of the face as (x, along the edge, across the face), mm, patch by patch; stray returns among them."""
    place = cloud.base_from_profiler[:, :3, 3]
    s = arc_lengths_mm(place)
    known = face.count > LEAST_SLICES
    number = (s / max(STRETCH_MM, STRETCH_SLICES * float(np.median(np.diff(s))))).astype(np.int64)
    stretches = by_pass(number, known)
    for frames in [stretches[k] for k in evenly(len(stretches), MOST_STRETCHES)]:
        if frames.size >= LEAST_SLICES:
            yield from _of_stretch(cloud, face, frames, s[frames])


def _of_stretch(cloud: Cloud, face: FaceLines, frames: Int, s: Float) -> Iterator[tuple[Float, Float, Float]]:
    middle, height, slope = face.typical(frames)
    half = float(np.median(np.sqrt(3.0 * face.sxx[frames] / face.count[frames]))) - RIM_MM  # of evenly spread points
    x, z = cloud.x_mm[frames].astype(np.float64), cloud.z_mm[frames].astype(np.float64)
    off = (z - height - slope * (x - middle)) / np.hypot(1.0, slope)
    width = 2.0 * half / max(1, int(2.0 * half / WIDE_MM))
    for left in np.arange(middle - half, middle + half - 0.5 * width, width):
        here = (x >= left) & (x < left + width) & (np.abs(off) < SPAN_MM)
        if here.sum() >= LEAST_POINTS:
            yield x[here], np.broadcast_to(s[:, None], x.shape)[here], off[here]
