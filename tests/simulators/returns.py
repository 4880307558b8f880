"""Returns of a recording in the base, and in the sections of its truth."""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.artefacts import Recording
from workbench.scan.fuse_stage import flange_poses
from workbench.units import Float


def base_points(recording: Recording) -> Float:
    """All returns (k, 3) in the base, by the recorded poses; no check may refuse what has no noise."""
    assert recording.flange_from_profiler is not None
    base_from_profiler = flange_poses(recording) @ recording.flange_from_profiler
    frame, column = np.nonzero(np.isfinite(recording.z_mm))
    x, z = recording.x_mm[frame, column].astype(float), recording.z_mm[frame, column].astype(float)
    poses = base_from_profiler[frame]
    return np.asarray(poses[:, :3, 0] * x[:, None] + poses[:, :3, 2] * z[:, None] + poses[:, :3, 3])


def in_sections(recording: Recording, truth: Any) -> tuple[Float, Float, Float]:
    """All returns: base points (k, 3), and their places along n and along m from the edge of their sections."""
    base = base_points(recording)
    off = base - truth.at(base, truth.position_mm)
    return base, (off * truth.at(base, truth.normal)).sum(axis=1), (off * truth.at(base, truth.across)).sum(axis=1)
