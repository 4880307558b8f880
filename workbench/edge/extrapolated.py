"""Corners of a joint that lie further from any return than its columns and noise explain."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from workbench.artefacts import Cloud, Joint
from workbench.geometry.blocks import evenly
from workbench.units import Float, Int

STATIONS = 200  # of a joint, evenly, that tell
COLUMNS, NOISES = 2.0, 3.0  # within which a corner is seen: the last column on a face may return nothing
J = TypeVar("J", bound=Joint)


def name_extrapolated(joint: J, cloud: Cloud, noise_mm: float) -> J:
    """The joint with a warning for every corner that lies further from any return than columns and noise explain.

    By the median along the joint, in the profile next to each station. cloud: the one that the joint was found in;
    noise_mm: of a range, standard deviation.

    Example:
        >>> from workbench import edge, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/groove.h5"))
        >>> joint = edge.segment_groove(points)
        >>> name_extrapolated(joint, points, 0.01).warnings == joint.warnings
        True
    """
    seen = np.flatnonzero(np.isfinite(joint.frame_arc_length_mm))
    some = evenly(joint.arc_length_mm.size, STATIONS)
    frame = seen[np.abs(joint.frame_arc_length_mm[seen] - joint.arc_length_mm[some, None]).argmin(axis=1)]
    warnings = list(joint.warnings)
    for name, corner in joint.corners.items():
        a, b = corner.section_mm[some].T[:, :, None]
        place = joint.origin_mm[some] + a * joint.normal[some] + b * joint.across[some]
        away = [_nearest(cloud, k, one) for k, one in zip(frame, place, strict=True) if np.isfinite(one).all()]
        if not away:
            continue
        distance, step = np.median(away, axis=0)
        if distance > COLUMNS * step + NOISES * noise_mm:
            warnings.append(f"corner {name} is extrapolated: it lies {distance:.2f} mm from the nearest return")
    return replace(joint, warnings=tuple(warnings))


def _nearest(cloud: Cloud, frame: int, place: Float) -> tuple[float, float]:
    """From a place (3,) in the base to a profile's nearest return, and from there to its nearer neighbour, mm."""
    pose = cloud.base_from_profiler[frame]
    x, _, z = pose[:3, :3].T @ (place - pose[:3, 3])
    columns: Int = np.flatnonzero(cloud.keep[frame])
    points = np.stack([cloud.x_mm[frame, columns] - x, cloud.z_mm[frame, columns] - z], axis=1)
    away = np.hypot(*points.T)
    k = int(np.argmin(away))
    steps = np.hypot(*np.diff(points[max(k - 1, 0) : k + 2], axis=0).T)
    return float(away[k]), float(steps.min())
