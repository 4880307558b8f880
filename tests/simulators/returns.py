"""Returns of a recording in the base."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Recording
from workbench.scan.fuse import flange_poses
from workbench.units import Float


def base_points(recording: Recording) -> Float:
    """All returns (k, 3) in the base, by the recorded poses; no check may refuse what has no noise."""
    assert recording.flange_from_profiler is not None
    base_from_profiler = flange_poses(recording) @ recording.flange_from_profiler
    frame, column = np.nonzero(np.isfinite(recording.z_mm))
    x, z = recording.x_mm[frame, column].astype(float), recording.z_mm[frame, column].astype(float)
    poses = base_from_profiler[frame]
    return np.asarray(poses[:, :3, 0] * x[:, None] + poses[:, :3, 2] * z[:, None] + poses[:, :3, 3])
