"""Passes that show the root face of a prepared plate and what it meets, without the upper surface.

They measure no preparation, but what they show of the lower edge holds for all passes.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, Cloud
from workbench.edge.faces import TrackedFaces, find_faces
from workbench.errors import InputError
from workbench.geometry.chains import FaceLines
from workbench.geometry.poses import unit
from workbench.units import DEG, AnyArray, Float, Int, Shaped

SHARED = (BEVEL_FACE, ROOT_FACE, LOWER_SURFACE)  # faces that such a pass may show


def with_other_passes(cloud: Cloud, tracked: TrackedFaces, root_nominal_mm: float, rim_mm: float) -> TrackedFaces:
    """The faces, with those of passes of which `tracked` has no frame, if these show root face and bevel face.

    rim_mm: as in `find_faces`.
    """
    others = np.flatnonzero(~np.isin(cloud.pass_index, cloud.pass_index[tracked.seen]))
    if not others.size:
        return tracked
    root, bevel = tracked.faces[ROOT_FACE], tracked.faces[BEVEL_FACE]
    angle_deg = float(np.nanmedian(np.abs(np.arctan(root.slope) - np.arctan(bevel.slope)))) / DEG
    try:
        found = find_faces(
            cloud.of_frames(others), root_nominal_mm, angle_deg, rim_mm, _upwards(cloud, tracked).tolist()
        )
    except InputError:
        return tracked  # they show something else
    found = replace(found, labels=np.where(np.isin(found.labels, SHARED), found.labels, 0))
    every: dict[str, Any] = {
        one.name: _with(getattr(tracked, one.name), getattr(found, one.name), others)
        for one in fields(TrackedFaces)
        if isinstance(getattr(tracked, one.name), np.ndarray)
    }
    faces = {label: _lines(tracked.faces[label], found.faces[label], others) for label in SHARED}
    return replace(tracked, faces=tracked.faces | faces, **every)


def _upwards(cloud: Cloud, tracked: TrackedFaces) -> Shaped[Float, " 3"]:
    """Along the root face, to the upper side, in the base: mean of all frames."""
    ex, ez = cloud.base_from_profiler[:, :3, 0], cloud.base_from_profiler[:, :3, 2]
    root = tracked.faces[ROOT_FACE]
    lower = tracked.side[:, None] * (ex + root.slope[:, None] * ez) / root.lean[:, None]
    return np.asarray(unit(-np.nanmean(lower, axis=0)))


def _lines(one: FaceLines, other: FaceLines, at: Int) -> FaceLines:
    return FaceLines(*(_with(getattr(one, of.name), getattr(other, of.name), at) for of in fields(FaceLines)))


def _with(one: AnyArray, other: AnyArray, at: Int) -> Any:
    """Values of all frames, `other` at those numbered in `at`."""
    out = one.copy()
    out[at] = other
    return out
