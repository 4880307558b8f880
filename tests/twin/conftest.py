"""Milling paths by formula, on parts whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from workbench.api import quaternion_from_rotation
from workbench.artefacts import Cutter, Layer, Toolpath, Travel
from workbench.synthetic import Workpiece, milled_truth, parse_recipe
from workbench.units import DEG

PLACE = {"position_mm": [1400, -300, 700], "rpy_deg": [35, 12, -20]}
SCAN = {"from_mm": 1, "to_mm": 39, "motion": "stream", "follow": "edge"}
CURVES = {
    "straight": {},
    "convex": {"curve": {"shape": "arc", "radius_mm": 300}},
    "concave": {"curve": {"shape": "arc", "radius_mm": 300, "sense": "concave"}},
    "wavy": {"curve": {"shape": "wavy", "amplitude_mm": 3, "wavelength_mm": 150, "phase_deg": 40}},
    "leaning": {"end_face_tilt_deg": 4},
    # A cylinder of radius r cuts a face that turns by c rad/mm too deep by r c^2 w^2 / 2, w from the axis of turning.
    "twisted": {"end_face_tilt_deg": -2, "end_face_twist_deg": 4},
}
LEAD_MM, CLEAR_MM = 8.0, 12.0


def raw_recipe(part=None, **more):
    """A raw part of 40 mm with a scanner that is quick to simulate."""
    part = {"kind": "raw", "length_mm": 40, "base_from_part": PLACE} | (part or {})
    scanner = {"columns": 400, "pitch_mm": 0.05}
    return parse_recipe({"seed": 5, "part": part, "scanner": scanner, "passes": [SCAN]} | more)


def perfect_path(recipe, root_mm=1.5, bevel_deg=40.0, depth_of_cut_mm=1.0, heights=None):
    """The path that the true lower edge implies: key points every mm, layers down to the finished bevel.

    In the section plane (n, m) a layer at height h meets the end face at root + h / sin(bevel) from the lower edge; its
    face runs up along -z of the tool frame, to where the plate ends.
    """
    truth, bevel = milled_truth(Workpiece(recipe)), bevel_deg * DEG
    length = truth.arc_length_mm[-1]
    lead = np.arange(1, LEAD_MM + 1)
    s = np.concatenate([-lead[::-1], np.arange(0, length, 1.0), [length], length + lead])
    at = np.clip(s, 0, length)
    t, n, m, lower = (
        CubicSpline(truth.arc_length_mm, a)(at) for a in (truth.tangent, truth.normal, truth.across, truth.position_mm)
    )
    z = -np.cos(bevel) * m + np.sin(bevel) * n
    b = np.cos(bevel) * n + np.sin(bevel) * m
    quaternion = quaternion_from_rotation(np.stack([-b, t, z], axis=-1))
    lower = lower + (s - at)[:, None] * t
    thickness = np.interp(at, truth.arc_length_mm, truth.thickness_mm)
    share = np.clip(np.maximum(-s, s - length) / LEAD_MM, 0, 1)
    rise = share**2 * (3 - 2 * share)
    if heights is None:
        count = int(np.ceil((thickness.max() - root_mm) * np.sin(bevel) / depth_of_cut_mm))
        heights = depth_of_cut_mm * np.arange(count - 1, -1, -1)
    layers = []
    for index, h in enumerate(heights, start=1):
        foot = root_mm + h / np.sin(bevel)
        width = np.maximum(thickness - foot, 0) / np.cos(bevel)
        position = lower + foot * m - (width / 2)[:, None] * z + (rise * (CLEAR_MM - h))[:, None] * b
        cutting = (share == 0) & (width > 0)
        layers.append(
            Layer(
                index,
                float(h),
                s,
                position,
                quaternion,
                np.ones(len(s)),
                cutting,
                np.ones(len(s), bool),
                np.where(cutting, width, 0.0),
            )
        )
    return Toolpath(Cutter(), tuple(layers), (), root_mm, bevel_deg, depth_of_cut_mm, 1.0, float(length))


def travel_at(toolpath, lift_mm):
    """A travel back along the first layer, `lift_mm` off it along the face's outward normal (-x of the frames)."""
    layer = toolpath.layers[0]
    from workbench.api import rotation_from_quaternion

    outward = -rotation_from_quaternion(layer.quaternion_wxyz)[:, :, 0]
    keep = slice(None, None, -8)
    position = (layer.position_mm + lift_mm * outward)[keep]
    return Travel(position, layer.quaternion_wxyz[keep], np.ones(len(position)))


@pytest.fixture(scope="session")
def recipe():
    return raw_recipe()
