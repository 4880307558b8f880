"""The spine, a smooth space curve with a moving frame, and the section that is swept along it.

In the section plane a counts along n, b along m. Corners stand at: lower end of the plate behind the edge, lower edge
(w, 0), upper edge of the root face, upper edge of the bevel (raw: of the end face), upper end of the
plate. w is the wave of the root face, which lets bevel and surfaces stay where they are.

Grooves: two plates with a gap, their sections and sizes by ISO 9692-1, and what lies in them.

In the section a counts across the groove from the middle of the gap, b up from the left plate's lower surface. A plate
is drawn as a left one; the right one is its mirror image, raised by the misalignment.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from bench.simulators.swept.recipe import GroovePart, Spine, SweptPart
from workbench.synthetic.groove_truth import GrooveSizes
from workbench.units import DEG, AnyArray, Float, Int, Shaped

STEP = 1e-30
_GAUSS_AT, _GAUSS_WEIGHT = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """The spine and its frame at k places: n is the end face's outward normal, m points up, t = m x n."""

    s: Shaped[Float, " k"]
    position: Shaped[Float, "k 3"]  # part frame
    t: Shaped[Float, "k 3"]
    n: Shaped[Float, "k 3"]  # twisted
    m: Shaped[Float, "k 3"]
    n0: Shaped[Float, "k 3"]  # before the twist
    m0: Shaped[Float, "k 3"]


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A spine by its arc length: the parameter at s."""

    part: SweptPart | GroovePart
    at: CubicHermiteSpline
    length: float
    closed: bool

    def frames(self, s: Float) -> Frames:
        """The frames at arc lengths s (k,). Beyond its ends an open curve goes straight on, a closed one round."""
        s = np.asarray(s, dtype=float)
        within = np.mod(s, self.length) if self.closed else np.clip(s, 0.0, self.length)
        position, t, n0, m0 = _frame(self.part.spine, self.at(within))
        position = position + (0.0 if self.closed else 1.0) * (s - within)[:, None] * t
        turn = self.part.twist_deg.at(within, self.length)[:, None] * DEG
        n, m = np.cos(turn) * n0 + np.sin(turn) * m0, np.cos(turn) * m0 - np.sin(turn) * n0
        return Frames(s, position, t, n, m, n0, m0)

    def stations(self, count: int) -> Frames:
        """Frames at so many places from end to end; the last one of a closed curve not yet the first again."""
        s = np.linspace(0.0, self.length, count)
        return replace(self.frames(np.append(s[:-1], s[-1] - (1e-9 if self.closed else 0.0))), s=s)


def curve_of(part: SweptPart | GroovePart) -> Curve:
    """The spine of a part, tabled every 2 mm by five-point Gauss quadrature: arc lengths hold to 1e-8 mm."""
    spine = part.spine
    stop = _parameter_range(spine)
    u = np.linspace(0.0, stop, max(64, math.ceil(spine.length_mm / 2.0)) + 1)
    half = np.diff(u)[:, None] / 2
    places = u[:-1, None] + half * (1 + _GAUSS_AT)
    speed = np.linalg.norm(_derivative(spine, places.ravel()), axis=1).reshape(places.shape)
    s = np.concatenate([[0.0], np.cumsum(half[:, 0] * (speed @ _GAUSS_WEIGHT))])
    turn = stop if spine.shape == "saddle" or (spine.shape == "arc" and spine.rise_mm == 0) else 0.0
    at = CubicHermiteSpline(s, u, 1.0 / np.linalg.norm(_derivative(spine, u), axis=1))
    return Curve(part, at, float(s[-1]), closed=abs(turn - 2 * math.pi) < 1e-6)


def _parameter_range(spine: Spine) -> float:
    """Where the parameter ends so that the arc length is `length_mm` (a saddle's angle is that of its nozzle)."""
    if spine.shape == "straight":
        return spine.length_mm
    if spine.shape == "arc":
        turn = spine.length_mm / math.hypot(spine.radius_mm, spine.rise_mm / (2 * math.pi))
        return min(turn, 2 * math.pi) if spine.rise_mm == 0 else turn
    if spine.shape == "saddle":
        return min(spine.length_mm / spine.radius_mm, 2 * math.pi)
    return spine.length_mm  # wavy: along its chord


def _point(spine: Spine, u: AnyArray) -> AnyArray:
    if spine.shape == "straight":
        return np.stack([u, 0 * u, 0 * u], axis=1)
    if spine.shape == "arc":  # starts at the origin along +x; the plate lies at +y
        side = 1.0 if spine.sense == "convex" else -1.0
        r = spine.radius_mm
        return np.stack([r * np.sin(u), side * r * (1 - np.cos(u)), spine.rise_mm * u / (2 * math.pi)], axis=1)
    if spine.shape == "saddle":
        angle = spine.start_deg * DEG - u  # so that the hole lies to the right of t
        r, big = spine.radius_mm, spine.shell_radius_mm
        height = np.sqrt(big**2 - (r * np.sin(angle)) ** 2)
        return np.stack([r * np.sin(angle), -r * np.cos(angle), height - big], axis=1)
    k, phase = 2 * math.pi / spine.wavelength_mm, spine.phase_deg * DEG
    wave = np.sin(k * u + phase) - math.sin(phase)
    return np.stack([u, spine.amplitude_mm * wave, spine.height_amplitude_mm * np.sin(k * u)], axis=1)


def _derivative(spine: Spine, u: Float) -> Float:
    """By a complex step, which has no rounding of differences (Squire and Trapp 1998)."""
    return np.asarray(_point(spine, u + STEP * 1j).imag / STEP)


def _frame(spine: Spine, u: Float) -> tuple[Float, Float, Float, Float]:
    """Position, t, n and m (k, 3) before any twist.

    On plate curves m is the plate's normal made square to t; on a saddle the end face is a cylinder about the
    nozzle's axis, so that n points at this axis and the hole lies there.
    """
    position, slope = _point(spine, u), _derivative(spine, u)
    t = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    if spine.shape == "saddle":
        n = -position * (1.0, 1.0, 0.0) / spine.radius_mm
        return position, t, n, np.cross(n, t)
    m = np.array([0.0, 0.0, 1.0]) - t[:, 2:] * t
    m = m / np.linalg.norm(m, axis=1, keepdims=True)
    return position, t, np.cross(t, m), m


# Faces of a mesh. UNDER: the bevel below the root face of an X groove; LAND, UPPER_BEVEL: of a prepared plate.
LOWER, ROOT, BEVEL, UPPER, UNDER, LAND, UPPER_BEVEL = range(7)
FACE_STEP_MM = 0.5  # greatest width of a strip of a face: with the mesh's step it bounds what triangles miss of a twist
_ARC_SAG_MM = 2e-4  # of the facets of a rounding


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """What a chain is made of: sharp corners at k stations, then what becomes of them."""

    corner: Shaped[Float, "k c 2"]
    faces: tuple[int, ...]  # (c - 1,)
    radii: tuple[float, ...]  # (c,) mm; 0 at both ends
    bevel: Shaped[Float, " k"]  # rad; NaN where there is none
    bows: Mapping[int, float] = field(default_factory=dict)  # face -> height of its middle over the chord, mm
    rough: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """The section as a polyline at k stations, with j points."""

    points: Shaped[Float, "k j 2"]
    face: Int  # (j - 1,) of the strip between neighbouring points
    across: Shaped[Float, "k j"]  # share of its face, 0 at its lower end; of the rounding, the nearer end


def outline_of(part: SweptPart, s: Float, length: float) -> Outline:
    """The section of a plate's edge at arc lengths s (k,)."""
    thickness, wave = (c.at(s, length) for c in (part.thickness_mm, part.wave_mm))
    root, bevel = part.root_mm.at(s, length), part.bevel_deg.at(s, length) * DEG
    reach, zero = np.full(len(s), part.reach_mm), np.zeros(len(s))
    faces: tuple[int, ...] = ()  # between root face and upper surface
    if part.kind == "raw":
        bevel = np.full(len(s), np.nan)
        above = [np.stack([wave, thickness], axis=1)]
    elif part.preparation != "bevel":
        faces, above = _prepared(part, s, length, root, bevel, thickness)
    else:
        faces, k = (BEVEL,), (thickness - root) / np.cos(bevel)
        middle = np.stack([wave, root - wave / np.tan(bevel)], axis=1)
        above = [middle, np.stack([-k * np.sin(bevel), root + k * np.cos(bevel)], axis=1)]
    behind_low, behind_high = (np.stack([-reach, level], axis=1) for level in (zero, thickness))
    lower = np.stack([wave, zero], axis=1)
    corner = np.stack([behind_low, lower, *above, behind_high], axis=1)
    middle_radii = [part.middle_radius_mm] * len(faces)
    if part.preparation == "J":
        middle_radii[-1] = part.root_radius_mm
    radii = (0.0, part.lower_radius_mm, *middle_radii, part.upper_radius_mm, 0.0)
    bows = {ROOT: part.root_bow_mm, BEVEL: part.bevel_bow_mm}
    return Outline(corner, (LOWER, ROOT, *faces, UPPER), radii, bevel, bows, part.roughness.sd_mm > 0)


def _prepared(
    part: SweptPart, s: Float, length: float, root: Float, bevel: Float, thickness: Float
) -> tuple[tuple[int, ...], list[Float]]:
    """Faces from the root face's upper edge to the upper surface, and their corners (k, 2), both ends included."""
    zero = np.zeros(len(s))
    if part.preparation == "compound":
        faces, foot = (BEVEL, UPPER_BEVEL), root + part.lower_bevel_mm.at(s, length)
        start, steep = -(foot - root) * np.tan(bevel), part.upper_bevel_deg.at(s, length) * DEG
    else:
        faces, foot, steep = (LAND, BEVEL), root, bevel
        start = -part.land_mm.at(s, length)
        if part.preparation == "J":  # the fillet touches land and bevel; without it they would meet here
            start = start - part.root_radius_mm * np.tan((math.pi / 2 - bevel) / 2)
    top = start - (thickness - foot) * np.tan(steep)
    return faces, [np.stack(pair, axis=1) for pair in ((zero, root), (start, foot), (top, thickness))]


def preparation_sizes(part: SweptPart, s: Float, length: float) -> dict[str, Float]:
    """The sizes of a milled plate's preparation at arc lengths s (k,), by the names of `preparation.json`."""
    top = outline_of(part, s, length).corner[:, -2]
    root, bevel = part.root_mm.at(s, length), part.bevel_deg.at(s, length)
    sizes = {"root_face_mm": root, "bevel_deg": bevel, "depth_mm": top[:, 1] - root, "width_mm": -top[:, 0]}
    if part.preparation == "compound":
        sizes["upper_bevel_deg"] = part.upper_bevel_deg.at(s, length)
        sizes["lower_bevel_mm"] = part.lower_bevel_mm.at(s, length)
    if part.preparation in ("nose", "J"):
        sizes["land_mm"] = part.land_mm.at(s, length)
    if part.preparation == "J":
        sizes["root_radius_mm"] = np.full(len(s), part.root_radius_mm)
    return sizes


def chain_of(outline: Outline) -> Chain:
    """The section's polyline: faces in strips, bowed, corners rounded by arcs."""
    corner, faces, radii, bows = outline.corner, outline.faces, outline.radii, outline.bows
    side = corner[:, 1:] - corner[:, :-1]
    width = np.linalg.norm(side, axis=2)
    way = side / width[:, :, None]
    trim = np.zeros((len(corner), len(radii)))
    for i in range(1, len(radii) - 1):
        turn = np.arccos(np.clip((way[:, i - 1] * way[:, i]).sum(axis=1), -1, 1))
        trim[:, i] = radii[i] * np.tan(turn / 2)
    points, across, labels = [], [], []
    for i, face in enumerate(faces):
        start, stop = trim[:, i] / width[:, i], 1 - trim[:, i + 1] / width[:, i]
        if (start > stop + 1e-9).any():
            raise ValueError("a rounding is wider than its face")
        strips = _strips(face, float(width[:, i].max()), bows.get(face, 0.0), outline.rough)
        share = start[:, None] + (stop - start)[:, None] * strips
        outward = np.stack([way[:, i, 1], -way[:, i, 0]], axis=1)
        bulge = 4 * bows.get(face, 0.0) * share * (1 - share)
        points.append(corner[:, i, None] + share[..., None] * side[:, i, None] + bulge[..., None] * outward[:, None])
        across.append(share)
        labels += [face] * (len(strips) - 1)
        if i + 1 < len(faces):
            if radii[i + 1] > 0:
                arc = _arc(points[-1][:, -1], way[:, i], way[:, i + 1], radii[i + 1])
                points.append(arc)
                inner, half = arc.shape[1], arc.shape[1] // 2
                across.append(np.repeat([[1.0] * half + [0.0] * (inner - half)], len(corner), axis=0))
                labels += [face] * (half + 1) + [faces[i + 1]] * (inner - half)
            else:  # the next face begins where this one ends: a strip of no width parts them
                labels += [face]
    return Chain(np.concatenate(points, axis=1), np.array(labels), np.concatenate(across, axis=1))


def _strips(face: int, width: float, bow: float, rough: bool) -> Float:
    """Shares of a face at which its strips part. Surfaces are seen for some mm beside the edge only."""
    if face in (LOWER, UPPER):
        # plane strips, but on a twisted part: narrow near the edge, wide behind it
        near = np.array([0.0, 0.5, 1, 1.5, 2, 3, 4, 6, 8, 11, 15, 20, 30])
        near = near[near < 0.8 * width] / width
        return np.concatenate([near, [1.0]]) if face == UPPER else np.concatenate([[0.0], 1.0 - near[::-1]])
    step = 0.25 if rough else 0.1 if bow != 0 else FACE_STEP_MM
    return np.linspace(0.0, 1.0, max(2, int(np.ceil(width / step)) + 1))


def _arc(start: Float, way_in: Float, way_out: Float, radius: float) -> Float:
    """Inner points (k, p, 2) of the arc that leaves `start` along `way_in` and ends along `way_out`."""
    turn = np.arctan2(way_in[:, 0] * way_out[:, 1] - way_in[:, 1] * way_out[:, 0], (way_in * way_out).sum(axis=1))
    left = np.stack([-way_in[:, 1], way_in[:, 0]], axis=1)
    facets = math.ceil(float(np.abs(turn).max()) * math.sqrt(radius / (8 * _ARC_SAG_MM))) + 1
    angle = np.linspace(0, 1, facets + 1)[1:-1] * turn[:, None]
    # the chain turns left (towards the plate) or, on a concave corner, right
    sign = np.sign(turn)[:, None, None]
    forward, sideways = np.sin(np.abs(angle))[..., None], (1 - np.cos(angle))[..., None]
    return np.asarray(start[:, None] + radius * (forward * way_in[:, None] + sign * sideways * left[:, None]))


@dataclass(frozen=True, slots=True, eq=False)
class VirtualEdges:
    """Sharp edges between the least-squares lines of the faces, in the section of k stations."""

    lower: Shaped[Float, "k 2"]  # (a, b)
    upper: Shaped[Float, "k 2"]  # raw: upper edge of the end face; milled: of the root face
    root_mm: Shaped[Float, " k"]  # NaN on a raw edge
    bevel: Shaped[Float, " k"]  # rad; NaN on a raw edge


def virtual_edges(part: SweptPart, outline: Outline) -> VirtualEdges:
    """Where the fitted faces meet. A bow b shifts the least-squares line of a face outwards by 2 b / 3, unturned."""
    out = 2 * part.root_bow_mm / 3
    corner, bevel = outline.corner, outline.bevel
    lower = np.stack([corner[:, 1, 0] + out, corner[:, 1, 1]], axis=1)
    if part.kind == "raw":
        upper = np.stack([corner[:, 2, 0] + out, corner[:, 2, 1]], axis=1)
        return VirtualEdges(lower, upper, bevel, bevel)
    shift = 2 * part.bevel_bow_mm / 3
    up = (shift - out * np.cos(bevel)) / np.sin(bevel)
    upper = np.stack([corner[:, 2, 0] + out, corner[:, 2, 1] + up], axis=1)
    return VirtualEdges(lower, upper, upper[:, 1] - lower[:, 1], bevel)


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


def is_square(part: GroovePart, side: str) -> bool:
    """Whether the `left` or `right` plate has no bevel."""
    return part.groove == "I" or (part.groove in ONE_SIDED and part.bevelled != side)


def plate_section(part: GroovePart, side: str, s: Float, length: float) -> PlateSection:
    """The section of the `left` or `right` plate at arc lengths s (k,)."""
    thickness, half = part.thickness_mm.at(s, length), part.gap_mm.at(s, length) / 2
    none = np.full(len(s), np.nan)
    edge = -half
    far = [np.stack([edge - part.reach_mm, b], axis=1) for b in (np.zeros(len(s)), thickness)]
    if is_square(part, side):
        low, high = (np.stack([edge, b], axis=1) for b in (np.zeros(len(s)), thickness))
        corner = np.stack([far[0], low, high, far[1]], axis=1)
        outline = Outline(corner, (LOWER, ROOT, UPPER), (0.0, 0.0, part.upper_radius_mm, 0.0), none)
        return PlateSection(low, high, high, outline, none)
    face = getattr(part, f"root_face_{side}_mm").at(s, length)
    if part.groove in ("V", "HV"):
        face = np.zeros(len(s))
    bevel = getattr(part, f"bevel_{side}_deg").at(s, length) * DEG
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
    outline = Outline(corner, (*faces, BEVEL, UPPER), (*radii, part.upper_radius_mm, 0.0), bevel)
    has_face = part.groove not in ("V", "HV")
    return PlateSection(low, root, upper, outline, face if has_face else none)


def groove_chains(part: GroovePart, s: Float, length: float) -> list[Chain]:
    """The polylines of both plates."""
    left = chain_of(plate_section(part, "left", s, length).outline)
    right = chain_of(plate_section(part, "right", s, length).outline)
    raised = part.misalignment_mm.at(s, length)[:, None]
    points = mirrored(right.points[:, ::-1], raised)
    return [left, Chain(points, right.face[::-1] + RIGHT, right.across[:, ::-1])]


def mirrored(points: Float, raised: Float) -> Float:
    """Section points (k, ..., 2) of a left plate as those of the right one, `raised` (k, ...) mm."""
    return np.stack([-points[..., 0], points[..., 1] + raised], axis=-1)


def groove_sizes(part: GroovePart, s: Float, length: float) -> GrooveSizes:
    """Sizes by ISO 9692-1. The depth is that from the upper surface to the root face's upper edge, of the bevelled
    plate (both: the mean); an I groove has none. The width is taken between the upper edges, across.
    """
    left, right = (plate_section(part, side, s, length) for side in ("left", "right"))
    raised = part.misalignment_mm.at(s, length)
    none = np.full(len(s), np.nan)
    bevels = np.stack([left.outline.bevel, right.outline.bevel])
    depths = np.stack([p.upper[:, 1] - p.root[:, 1] for p in (left, right)])
    depths[np.isnan(bevels)] = np.nan
    bevelled = part.groove != "I"
    corners = {f"left_{name}": getattr(left, name) for name in ("upper", "root", "lower")}
    corners |= {f"right_{name}": mirrored(getattr(right, name), raised) for name in ("root", "lower", "upper")}
    return GrooveSizes(
        gap_mm=part.gap_mm.at(s, length),
        root_face_left_mm=left.root_face_mm,
        root_face_right_mm=right.root_face_mm,
        bevel_left_deg=left.outline.bevel / DEG,
        bevel_right_deg=right.outline.bevel / DEG,
        included_deg=np.nansum(bevels / DEG, axis=0) if bevelled else none,
        depth_mm=np.nanmean(depths, axis=0) if bevelled else none,
        width_mm=corners["right_upper"][:, 0] - corners["left_upper"][:, 0],
        misalignment_mm=raised,
        root_radius_mm=np.full(len(s), part.root_radius_mm) if part.groove in ("U", "J") else none,
        corners=corners,
    )
