"""Grooves: two plates with a gap, their sections and sizes by ISO 9692-1, and what lies in them.

In the section a counts across the groove from the middle of the gap, b up from the left plate's lower surface. A plate
is drawn as a left one; the right one is its mirror image, raised by the misalignment. Random grooves of each type are
for statistics over many of them.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.errors import InputError, nearest
from workbench.synthetic.swept.recipe import GroovePart, GrooveRecipe
from workbench.synthetic.swept.sweep import BEVEL, LOWER, ROOT, UNDER, UPPER, Chain, Outline, along, chain_of
from workbench.units import DEG, Float

RIGHT = 8  # added to the faces of the right plate
ONE_SIDED = ("HV", "HY", "K", "J")
GROOVES = ("I", "V", "Y", "HV", "HY", "X", "K", "U", "J")
BEVEL_DEG = {"U": (8, 20), "J": (10, 20), "HV": (30, 50), "HY": (30, 50), "K": (35, 50)}  # others 25 to 35
Document = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class PlateSection:
    """One plate at k stations, drawn as a left one: corners (k, 2) and sizes, NaN where the type has none."""

    lower: Float  # lower edge of the root face, or the sharp root of a V
    root: Float  # its upper edge
    upper: Float  # where bevel or root face meets the upper surface
    outline: Outline
    root_face_mm: Float
    bevel: Float  # rad


def is_square(part: GroovePart, side: str) -> bool:
    """Whether the `left` or `right` plate has no bevel."""
    return part.groove == "I" or (part.groove in ONE_SIDED and part.bevelled != side)


def plate_section(part: GroovePart, side: str, s: Float, length: float) -> PlateSection:
    """The section of the `left` or `right` plate at arc lengths s (k,)."""
    thickness, half = along(part.thickness_mm, s, length), along(part.gap_mm, s, length) / 2
    none = np.full(len(s), np.nan)
    edge = -half
    far = [np.stack([edge - part.reach_mm, b], axis=1) for b in (np.zeros(len(s)), thickness)]
    if is_square(part, side):
        low, high = (np.stack([edge, b], axis=1) for b in (np.zeros(len(s)), thickness))
        corner = np.stack([far[0], low, high, far[1]], axis=1)
        outline = Outline(corner, (LOWER, ROOT, UPPER), (0.0, 0.0, part.upper_radius_mm, 0.0))
        return PlateSection(low, high, high, outline, none, none)
    face = along(getattr(part, f"root_face_{side}_mm"), s, length)
    if part.groove in ("V", "HV"):
        face = np.zeros(len(s))
    bevel = along(getattr(part, f"bevel_{side}_deg"), s, length) * DEG
    under = part.under_depth_mm if part.groove in ("X", "K") else 0.0
    low = np.stack([edge, np.full(len(s), under)], axis=1)
    root = low + np.stack([np.zeros(len(s)), face], axis=1)
    start, radii = root, [0.0, 0.0]  # of the bevel: beyond the fillet of a U or J it would meet the root's level here
    corners, faces = [far[0], low], [LOWER]
    if under > 0:
        foot = low - np.stack([np.full(len(s), under * math.tan(part.under_deg * DEG)), np.full(len(s), under)], axis=1)
        corners, faces, radii = [far[0], foot, low], [LOWER, UNDER], [0.0, 0.0, 0.0]
    if (face > 0).all():
        corners.append(root)
        faces.append(ROOT)
        radii.append(0.0)
    if part.groove in ("U", "J"):  # the fillet is tangent to the root's level at the root face, and to the bevel
        reach = part.root_radius_mm * np.tan((math.pi / 2 - bevel) / 2)
        start = root - np.stack([reach, np.zeros(len(s))], axis=1)
        corners.append(start)
        faces.append(BEVEL)
        radii.append(part.root_radius_mm)
    rise = thickness - start[:, 1]
    upper = start + np.stack([-rise * np.tan(bevel), rise], axis=1)
    corner = np.stack([*corners, upper, far[1]], axis=1)
    outline = Outline(corner, (*faces, BEVEL, UPPER), (*radii, part.upper_radius_mm, 0.0))
    has_face = part.groove not in ("V", "HV")
    return PlateSection(low, root, upper, outline, face if has_face else none, bevel)


def groove_chains(part: GroovePart, s: Float, length: float) -> list[Chain]:
    """The polylines of both plates."""
    left = chain_of(plate_section(part, "left", s, length).outline)
    right = chain_of(plate_section(part, "right", s, length).outline)
    raised = along(part.misalignment_mm, s, length)[:, None]
    points = mirrored(right.points[:, ::-1], raised)
    return [left, Chain(points, right.face[::-1] + RIGHT, right.across[:, ::-1])]


def mirrored(points: Float, raised: Float) -> Float:
    """Section points (k, ..., 2) of a left plate as those of the right one, `raised` (k, ...) mm."""
    return np.stack([-points[..., 0], points[..., 1] + raised], axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class GrooveSizes:
    """The exact sizes at k stations; NaN where the type has none."""

    gap_mm: Float
    root_face_left_mm: Float
    root_face_right_mm: Float
    bevel_left_deg: Float
    bevel_right_deg: Float
    included_deg: Float
    depth_mm: Float
    width_mm: Float
    misalignment_mm: Float
    root_radius_mm: Float
    corners: dict[str, Float]  # name -> (k, 2) as (a, b)


def groove_sizes(part: GroovePart, s: Float, length: float) -> GrooveSizes:
    """Sizes by ISO 9692-1. The depth is that from the upper surface to the root face's upper edge, of the bevelled
    plate (both: the mean); an I groove has none. The width is taken between the upper edges, across.
    """
    left, right = (plate_section(part, side, s, length) for side in ("left", "right"))
    raised = along(part.misalignment_mm, s, length)
    none = np.full(len(s), np.nan)
    bevels = np.stack([left.bevel, right.bevel])
    depths = np.stack([p.upper[:, 1] - p.root[:, 1] for p in (left, right)])
    depths[np.isnan(bevels)] = np.nan
    bevelled = part.groove != "I"
    corners = {f"left_{name}": getattr(left, name) for name in ("upper", "root", "lower")}
    corners |= {f"right_{name}": mirrored(getattr(right, name), raised) for name in ("root", "lower", "upper")}
    return GrooveSizes(
        gap_mm=along(part.gap_mm, s, length),
        root_face_left_mm=left.root_face_mm,
        root_face_right_mm=right.root_face_mm,
        bevel_left_deg=left.bevel / DEG,
        bevel_right_deg=right.bevel / DEG,
        included_deg=np.nansum(bevels / DEG, axis=0) if bevelled else none,
        depth_mm=np.nanmean(depths, axis=0) if bevelled else none,
        width_mm=corners["right_upper"][:, 0] - corners["left_upper"][:, 0],
        misalignment_mm=raised,
        root_radius_mm=np.full(len(s), part.root_radius_mm) if part.groove in ("U", "J") else none,
        corners=corners,
    )


def random_groove_recipe(groove: str, seed: int, clutter: bool = True) -> GrooveRecipe:
    """A groove of type `groove` (a letter of GROOVES) drawn at random; the same seed gives the same recipe.

    Plates of 6 to 15 mm, 80 to 120 mm long, straight, an arc or waving in space; gap, root faces, angles and
    misalignment drift. With `clutter`: tack welds, spatter, reflections, texture of mill scale.
    """
    if groove not in GROOVES:
        raise InputError(f"groove '{groove}'", "a type of groove" + nearest(groove, GROOVES))
    rng = np.random.default_rng([seed, zlib.crc32(f"groove {groove}".encode())])
    length, thickness = rng.uniform(80, 120), rng.uniform(8, 15) if groove in "XK" else rng.uniform(6, 15)
    under = rng.uniform(0.25, 0.4) * thickness
    root = rng.uniform(0.5, 0.2 * thickness)
    low, high = BEVEL_DEG.get(groove, (25, 35))
    left, right = rng.uniform(low, high, 2)
    part: Document = {
        "kind": "groove",
        "groove": groove,
        "bevelled": str(rng.choice(["left", "right"])),
        "spine": _spine(rng, length),
        "thickness_mm": _course(rng, thickness, 0.05, 0.05),
        "gap_mm": _course(rng, rng.uniform(0.9, 3.5), 0.5, 0.2),
        "root_face_left_mm": _course(rng, root, 0.1, 0.05),
        "root_face_right_mm": _course(rng, root * rng.uniform(0.9, 1.1), 0.1, 0.05),
        "bevel_left_deg": _course(rng, left, 0.5, 0.2),
        "bevel_right_deg": _course(rng, right, 0.5, 0.2),
        "under_depth_mm": under,
        "root_radius_mm": rng.uniform(2, 5),
        "misalignment_mm": _course(rng, rng.uniform(-0.8, 0.8), 0.3, 0.1),
        "background_mm": None if rng.random() < 0.4 else rng.uniform(2, 20),
        "upper_radius_mm": 0.0 if rng.random() < 0.5 else rng.uniform(0, 0.3),
        "base_from_part": {
            "position_mm": [rng.uniform(800, 1800), rng.uniform(-800, 800), rng.uniform(300, 1200)],
            "rpy_deg": [rng.uniform(-180, 180), rng.uniform(-40, 40), rng.uniform(-40, 40)],
        },
    }
    if clutter:
        part["tacks"] = [
            {
                "at_mm": rng.uniform(10, length - 10),
                "length_mm": rng.uniform(6, 15),
                "width_mm": rng.uniform(3, 6),
                "height_mm": rng.uniform(1, 3),
            }
            for _ in range(rng.integers(0, 3))
        ]
        part["spatter"] = {"per_100_mm": rng.uniform(0, 15)}
        part["reflections"] = {"share": rng.uniform(0, 0.08), "patch_mm": rng.uniform(0.5, 3)}
        part["texture"] = {"sd_mm": rng.uniform(0, 0.01), "correlation_mm": rng.uniform(0.1, 0.8)}
    half_width = (thickness - root) * math.tan(max(left, right) * DEG) + (6 if groove in "UJ" else 3)
    columns = 640
    pitch = max(0.04, (2 * half_width + 16) / columns)
    standoff = rng.uniform(120, 250)
    lateral = 0.1 * half_width * rng.uniform(-1, 1)
    lean = rng.uniform(-8, 8)
    if groove in ("HV", "HY", "K", "J") or groove == "I":  # from the bevelled side, so that the square face shows
        lean = rng.uniform(3, 9 if groove == "J" else 20) * (-1 if part["bevelled"] == "right" else 1)
    return GrooveRecipe.model_validate(
        {
            "simulator": "swept",
            "title": groove,
            "seed": seed,
            "part": part,
            "scanner": {
                "columns": columns,
                "pitch_mm": pitch,
                "apex_mm": None if rng.random() < 0.3 else rng.uniform(10, 100),
                "x_rises": bool(rng.random() < 0.5),
                "z_away": bool(rng.random() < 0.8),
                "zero_range_mm": float(rng.choice([0.0, standoff])),
                "standoff_mm": standoff,
                "near_mm": standoff - 40,
                "far_mm": standoff + 60,
                "baseline_mm": float(rng.choice([-1, 1])) * rng.uniform(30, 80),
                "mixed_share": rng.uniform(0.2, 0.8),
                "noise": {
                    "sd_mm": 0.015,
                    "grazing_power": rng.uniform(0, 1),
                    "speckle": rng.uniform(0.1, 0.3),
                    "column_correlation": float(rng.choice([0, rng.uniform(0, 0.8)])),
                },
                "intensity": bool(rng.random() < 0.5),
            },
            "losses": {
                "single_share": 0.005,
                "outlier_share": 0.003,
                "outlier_reach_mm": rng.uniform(1, 8),
                "block_share": float(rng.choice([0.0, 0.05])),
            },
            "robot": {"pose_noise_mm": rng.uniform(0, 0.02), "pose_noise_deg": rng.uniform(0, 0.003)},
            "passes": [
                {
                    "way_mm": [2.0, length - 2.0] if rng.random() < 0.5 else [length - 2.0, 2.0],
                    "elevation_deg": 90 + lean,
                    "oblique_deg": rng.uniform(-4, 4),
                    "lead_deg": rng.uniform(-6, 6),
                    "aim_mm": [lateral, 0.7 * thickness],
                    "skew_mm": [-1.0, 1.0],
                    "upside_down": bool(rng.random() < 0.5),
                    "follow": "line" if part["spine"]["shape"] == "straight" else "edge",
                }
            ],
        }
    )


def _spine(rng: np.random.Generator, length: float) -> Document:
    shape = str(rng.choice(["straight", "straight", "arc", "wavy"]))
    spine: Document = {"shape": shape, "length_mm": length}
    if shape == "arc":
        spine |= {"radius_mm": rng.uniform(150, 1500), "sense": str(rng.choice(["convex", "concave"]))}
    if shape == "wavy":
        spine |= {
            "amplitude_mm": rng.uniform(0.3, 2),
            "height_amplitude_mm": rng.uniform(0, 1),
            "wavelength_mm": rng.uniform(120, 300),
        }
    return spine


def _course(rng: np.random.Generator, mean: float, drift: float, wave: float) -> Document:
    change, amplitude = rng.uniform(-drift, drift), rng.uniform(0, wave)
    return {
        "start": mean - change / 2,
        "end": mean + change / 2,
        "amplitude": amplitude,
        "wavelength_mm": rng.uniform(60, 200),
        "phase_deg": rng.uniform(0, 360),
    }
