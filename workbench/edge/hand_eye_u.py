"""What an uncertain hand-eye pose makes of a place and of a direction in the base."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Cloud
from workbench.units import Float, Int


def place_u_mm(cloud: Cloud, frame: Int, point_mm: Float, along: Float) -> Float:
    """Standard uncertainty (k,) mm, along unit vectors (k, 3), of points (k, 3) in the base that `frame` (k,) shows.

    With w the six errors of the pose (HandEye.covariance) a point moves by R (dt + dr x lever), R from flange to base.
    All that was scanned in one posture moves alike: it matters to a path, not to sizes.
    """
    pose = cloud.base_from_profiler[frame]
    lever = point_mm - pose[:, :3, 3]
    flange = _flange_axes(cloud, frame)
    return _propagated(cloud, np.concatenate([_turned(flange, along), _turned(flange, np.cross(lever, along))], axis=1))


def turn_u(cloud: Cloud, frame: Int, axis: Float) -> Float:
    """Standard uncertainty (k,) rad of a direction's turn about unit vectors (k, 3) in the base."""
    turned = _turned(_flange_axes(cloud, frame), axis)
    return _propagated(cloud, np.concatenate([np.zeros_like(turned), turned], axis=1))


def _flange_axes(cloud: Cloud, frame: Int) -> Float:
    """Rotation (k, 3, 3) from the flange to the base."""
    assert cloud.flange_from_profiler is not None
    return np.asarray(cloud.base_from_profiler[frame, :3, :3] @ cloud.flange_from_profiler[:3, :3].T)


def _turned(base_from_flange: Float, vectors: Float) -> Float:
    return np.asarray(np.einsum("kji,kj->ki", base_from_flange, vectors))


def _propagated(cloud: Cloud, rows: Float) -> Float:
    assert cloud.hand_eye_covariance is not None
    return np.asarray(np.sqrt(np.einsum("ki,ij,kj->k", rows, cloud.hand_eye_covariance, rows)))
