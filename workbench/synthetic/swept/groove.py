"""Grooves: two plates with a gap, their sections and sizes by ISO 9692-1, and what lies in them.

In the section a counts across the groove from the middle of the gap, b up from the left plate's lower surface. A plate
is drawn as a left one; the right one is its mirror image, raised by the misalignment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.synthetic.swept.recipe import GroovePart
from workbench.synthetic.swept.sweep import BEVEL, LOWER, ROOT, UNDER, UPPER, Chain, Outline, along, chain_of
from workbench.units import DEG, Float

RIGHT = 8  # added to the faces of the right plate
ONE_SIDED = ("HV", "HY", "K", "J")
GROOVES = ("I", "V", "Y", "HV", "HY", "X", "K", "U", "J")


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
