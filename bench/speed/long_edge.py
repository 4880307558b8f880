"""What planning is timed on is a raw edge of metres and its cloud, by formula: no ray is cast and nothing is segmented.
The lower edge is an arc of 10 m in a level plane, convex, with slow waves as a measured edge has them. The plate is
12 mm thick, seen from 45 deg above: upper surface and end face, 0.012 mm of range noise. A frame every 0.1 mm in
arc length, 1,000 columns 0.03 mm apart: 5 m are 50 million points.
"""

from __future__ import annotations

import math

import numpy as np

from workbench.artefacts import ROOT_FACE, UPPER_SURFACE, Cloud, RawEdge
from workbench.units import AnyArray, Float

RADIUS_MM, THICKNESS_MM = 10_000.0, 12.0
FRAME_PITCH_MM, COLUMNS, COLUMN_PITCH_MM = 0.1, 1000, 0.03
ELEVATION, STANDOFF_MM, NOISE_MM = math.pi / 4, 150.0, 0.012
WAVES = ((0.004, 90.0, 0.3), (0.003, 140.0, 1.1))  # amplitude mm, wavelength mm, phase: of the measured lower edge


def long_raw_edge(length_mm: float) -> tuple[RawEdge, Cloud]:
    """The edge with a station every mm, and its cloud."""
    s = np.linspace(0.0, length_mm, round(length_mm) + 1)
    frames = np.arange(0.5 * FRAME_PITCH_MM, length_mm, FRAME_PITCH_MM)
    cloud, labels = _cloud(frames)
    position, tangent, normal, across = _course(s)
    waves = sum(a * np.sin(2 * np.pi * s / length + phase) for a, length, phase in WAVES)
    edge = RawEdge(
        faces={},
        labels=labels,
        pass_index=cloud.pass_index,
        frame_arc_length_mm=frames,
        tangent_u=np.full(len(s), 1e-5),
        arc_length_mm=s,
        position_mm=position + waves[:, None] * normal,
        tangent=tangent,
        normal=normal,
        across=across,
        seen=np.ones(len(s), bool),
        burr_stations=np.zeros(0, int),
        upper_position_mm=position + waves[:, None] * normal + THICKNESS_MM * across,
        upper_inward=-normal,
        position_u_mm=np.full((len(s), 2), 0.003),
        normal_u=np.full(len(s), 1e-4),
    )
    return edge, cloud


def _course(s: Float) -> tuple[Float, Float, Float, Float]:
    """Lower edge, t, n and m (k, 3) at arc lengths s: the plate lies on the inner side of the arc."""
    angle, zero = s / RADIUS_MM, np.zeros_like(s)
    normal = np.stack([np.cos(angle), np.sin(angle), zero], axis=1)
    across = np.tile([0.0, 0.0, 1.0], (len(s), 1))
    return RADIUS_MM * normal - [RADIUS_MM - 1500.0, 0.0, -700.0], np.cross(across, normal), normal, across


def _cloud(frames: Float) -> tuple[Cloud, AnyArray]:
    """The scanner looks at the upper edge from in front and above, each frame in its section plane."""
    position, _, normal, across = _course(frames)
    x = (np.arange(COLUMNS, dtype=np.float32) - 0.5 * (COLUMNS - 1)) * np.float32(COLUMN_PITCH_MM)
    below = x < 0.0  # the upper edge lies at x = 0
    depth = np.where(below, x * -math.tan(ELEVATION), x / math.tan(ELEVATION)).astype(np.float32)
    on_face = below & (-x <= THICKNESS_MM * math.cos(ELEVATION))
    shape = (len(frames), COLUMNS)
    z = np.random.default_rng(0).standard_normal(shape, np.float32)
    z *= np.float32(NOISE_MM)
    z += depth + np.float32(STANDOFF_MM)
    labels = np.broadcast_to(np.where(on_face, ROOT_FACE, UPPER_SURFACE).astype(np.uint8), shape).copy()
    keep = np.broadcast_to(on_face | ~below, shape).copy()
    labels[~keep] = 0
    z[~keep] = np.nan
    lateral = math.cos(ELEVATION) * across - math.sin(ELEVATION) * normal
    away = -math.sin(ELEVATION) * across - math.cos(ELEVATION) * normal
    pose = np.zeros((len(frames), 4, 4))
    pose[:, :3, 0], pose[:, :3, 1], pose[:, :3, 2] = lateral, np.cross(away, lateral), away
    pose[:, :3, 3] = position + THICKNESS_MM * across - STANDOFF_MM * away
    pose[:, 3, 3] = 1.0
    cloud = Cloud(
        x_mm=np.broadcast_to(x, shape).copy(),
        z_mm=z,
        keep=keep,
        base_from_profiler=pose,
        time_s=frames / 5.0,
        pass_index=np.zeros(len(frames), int),
    )
    return cloud, labels
