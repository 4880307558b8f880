"""The distance from the cutter's axis to the stock that is still there, as one would compute it without this project.

The axis is sampled every mm; the nearest point of the cloud to each sample comes from Open3D or from a k-d tree, and
the least over the samples is d_min. What is left of the cloud changes from layer to layer, so its tree is built anew.
A sampled axis errs by up to 0.025 mm at 5 mm, the radius of the cutter; finer samples would take longer.

What planning is timed on is a raw edge of metres and its cloud, by formula: no ray is cast and nothing is segmented.
The lower edge is an arc of 10 m in a level plane, convex, with slow waves as a measured edge has them. The plate is
12 mm thick, seen from 45 deg above: upper surface and end face, 0.012 mm of range noise. A frame every 0.1 mm in
arc length, 1,000 columns 0.03 mm apart: 5 m are 50 million points.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from workbench.artefacts import ROOT_FACE, UPPER_SURFACE, Cloud, Layer, RawEdge, Toolpath
from workbench.geometry import grids
from workbench.geometry.poses import rotation_from_quaternion
from workbench.units import DEG, AnyArray, Float

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


def section_frames(count: int) -> tuple[Float, Float, Float, Float]:
    """Lower edge, t, n and m (count, 3) in the section planes of the first `count` frames."""
    return _course((np.arange(count) + 0.5) * FRAME_PITCH_MM)


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


SAMPLE_MM = 1.0


def open3d_distances(samples: Float, points: Float) -> Float:
    """d_min (k,) of samples (k, j, 3) to points (p, 3)."""
    import open3d as o3d

    cloud, query = (
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(values)) for values in (points, samples.reshape(-1, 3))
    )
    return np.asarray(query.compute_point_cloud_distance(cloud)).reshape(samples.shape[:2]).min(axis=1)


def tree_distances(samples: Float, points: Float) -> Float:
    """The same with scipy's k-d tree."""
    return np.asarray(cKDTree(points).query(samples.reshape(-1, 3))[0].reshape(samples.shape[:2]).min(axis=1))


def layer_problems(toolpath: Toolpath, cloud: Cloud) -> Iterator[tuple[Float, Float]]:
    """For each layer: samples (k, j, 3) of the axis, and points (p, 3) of what still stands.

    Those are the points of the cloud that no earlier layer removed, and the face that the layer before left.
    """
    centre = cloud.base_from_profiler[len(cloud.base_from_profiler) // 2, :3, 3]
    points = grids.fuse(cloud.x_mm, cloud.z_mm, cloud.base_from_profiler, centre).astype(float)
    height = _heights(points + centre, cloud, toolpath)
    left, face = np.inf, np.zeros((0, 3))
    for layer in toolpath.layers:
        standing = np.concatenate([points[cloud.keep & (height <= left)], face])
        yield axis_samples(layer, toolpath) - centre, standing
        left, face = layer.height_mm, face_samples(layer) - centre


def face_samples(layer: Layer) -> Float:
    """Points (p, 3) of the bevel face that a layer leaves: lines across it at its cutting points."""
    along = np.linspace(-0.5, 0.5, math.ceil(float(layer.width_mm.max()) / SAMPLE_MM) + 1)
    axis = rotation_from_quaternion(layer.quaternion_wxyz[layer.cutting])[:, None, :, 2]
    reach = (layer.width_mm[layer.cutting, None] * along)[:, :, None]
    return np.asarray((layer.position_mm[layer.cutting][:, None] + reach * axis).reshape(-1, 3))


def axis_samples(layer: Layer, toolpath: Toolpath) -> Float:
    """Points (k, j, 3) of the cutter's axis, as long as its flutes, a radius off the frame's origin."""
    axes = rotation_from_quaternion(layer.quaternion_wxyz)
    half = 0.5 * toolpath.cutter.flute_length_mm
    along = np.linspace(-half, half, math.ceil(2 * half / SAMPLE_MM) + 1)
    centre = layer.position_mm - 0.5 * toolpath.cutter.diameter_mm * axes[:, :, 0]
    return np.asarray(centre[:, None] + along[:, None] * axes[:, None, :, 2])


def _heights(points: Float, cloud: Cloud, toolpath: Toolpath) -> Float:
    """Height (N, M) over the finished bevel, each frame in its own section plane."""
    position, _, normal, across = section_frames(len(points))
    up = normal * math.cos(toolpath.bevel_deg * DEG) + across * math.sin(toolpath.bevel_deg * DEG)
    corner = position + toolpath.root_mm * across
    return np.asarray(np.einsum("ijk,ik->ij", points - corner[:, None], up))
