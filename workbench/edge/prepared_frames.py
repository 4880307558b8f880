"""Every profile across a prepared plate: its faces as lines, and where its root face ends."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, UPPER_SURFACE, Cloud
from workbench.artefacts.edges import PreparationType
from workbench.edge.faces import MAX_LINES, TrackedFaces
from workbench.edge.fillet import SHARP_MM, fit_on_land
from workbench.edge.frame_order import flips, profile
from workbench.edge.identify import crossing, lies_on, whole_faces, width_mm
from workbench.edge.layers import Surface, surface, without_layers
from workbench.edge.prepared_profile import Reading, readings
from workbench.errors import InputError
from workbench.geometry import tracking
from workbench.geometry.blocks import evenly, in_order
from workbench.geometry.chains import (
    FIRST,
    LAST,
    MIN_POINTS,
    MIN_SIGMA_MM,
    OFFSET,
    SLOPE,
    X0,
    X1,
    FaceLines,
    labelled_lines,
    straight_faces,
)
from workbench.geometry.medians import robust_sd
from workbench.units import Bool, Float, Int, Shaped

FILLETED: tuple[PreparationType, ...] = ("nose", "J")
FEW_FRAMES = 40  # evenly, by which a nose is told from a J
MOST_FRAMES = 4000  # evenly, that are read: more tell no more of faces that run smoothly
LEAST_RETURNS = 40  # of a profile
SHOWN = 0.5  # share of the profiles that show one reading, for it to be that of the plate
SURELY = math.log(1.5)  # by which one of two readings' root face lies nearer to the nominal one
TRIM_MM, TRIM_SHARE = 0.2, 0.15  # left out of a face beside a corner: its rounding; of a narrow one at most this share
FILLET_MM = 1.0  # likewise of a flank beside its fillet, of which so much may pass for the flank under the noise
WHOLE = 0.8  # of a flank's usual width, and of the returns on flank and fillet
SIDE_MM = 12.0  # of the upper surface only this much serves to measure it
UPPER_BEVEL, FLANK, FILLET = 16, 17, 18  # labels of faces that a plain bevel has not
# Labels of the straight faces, from the upper surface to the root face. BEVEL_FACE is the one whose corner with the
# root face its size is counted from: where only a fillet meets it, the upper surface, which stands upright on it.
ORDERS: dict[PreparationType, tuple[int, ...]] = {
    "bevel": (UPPER_SURFACE, BEVEL_FACE, ROOT_FACE),
    "compound": (UPPER_SURFACE, UPPER_BEVEL, BEVEL_FACE, ROOT_FACE),
    "nose": (UPPER_SURFACE, UPPER_BEVEL, BEVEL_FACE, ROOT_FACE),
    "J": (BEVEL_FACE, FLANK, ROOT_FACE),
}


@dataclass(frozen=True, slots=True, eq=False)
class PreparedFrames:
    """What reading every profile found, for all N frames of a cloud."""

    kind: PreparationType
    share: float  # of the profiles with enough returns, that show such a plate
    agreement: float  # share of these that show this kind
    tracked: TrackedFaces  # root face, and as bevel face what meets it; as upper surface: the upper surface
    order: tuple[int, ...]  # labels of the straight faces, from the upper surface to the root face
    sigma_mm: dict[int, float]  # range noise by label


def convex_corners(frames: PreparedFrames) -> tuple[tuple[int, int], ...]:
    """Labels of the faces that meet in a corner of the plate, less hollow corners and what meets above a fillet."""
    pairs = straight_corners(frames)
    return (pairs[0], pairs[2]) if frames.kind == "nose" else pairs


def straight_corners(frames: PreparedFrames) -> tuple[tuple[int, int], ...]:
    """Labels of the faces that meet in a corner, hollow ones included, less what meets above a fillet."""
    pairs = tuple(pairwise(frames.order))
    return pairs[:1] if frames.kind == "J" else pairs


@dataclass(frozen=True, slots=True, eq=False)
class Plates:
    """What every profile of a cloud was read as."""

    kind: PreparationType
    share: float  # see PreparedFrames
    agreement: float
    side: Shaped[Int, " N"]  # +1: from the upper surface to the root face x rises
    sense: int  # +1: z counts away from the sensor
    readings: list[Reading | None]  # of N profiles; None: none of this kind


def read_plates(cloud: Cloud, root_nominal_mm: float, upper_side: Float | None) -> Plates:
    """Read every profile; upper_side (3,): a vector in the base that points to the plate's upper side.

    Raises:
        InputError: no plate with an upper surface, a preparation and a root face is in view, or two readings are
            alike likely.
    """
    read = evenly(len(cloud.keep), MOST_FRAMES)
    found: list[list[Reading]] = [[] for _ in cloud.keep]
    for i, one in zip(read, in_order(lambda k, _: _readings(cloud, int(read[k])), read.size, 1), strict=True):
        found[i] = one
    side, sense = _plate(cloud, found, root_nominal_mm, upper_side)
    mine = [
        next((one for one in frame if (one.side, one.sense) == (side[i], sense)), None) for i, frame in enumerate(found)
    ]
    enough = int((cloud.keep[read].sum(axis=1) >= LEAST_RETURNS).sum())
    kinds = Counter(one.kind for one in mine if one is not None)
    shows = kinds.total()
    kind = max(sorted(kinds), key=kinds.__getitem__)
    if kind in FILLETED:  # what is one where the chain has a piece of its fillet, is the other where it has none
        noses = [one if one is not None and one.kind == "nose" else None for one in mine]
        kind = "J" if kinds["J"] > kinds["nose"] or _foot_radius_mm(cloud, noses) > SHARP_MM else "nose"
    if kind == "J":
        mine = [_above_fillet(one) if one is not None and one.kind == "nose" else one for one in mine]
    chosen = [one if one is not None and one.kind == kind else None for one in mine]
    if kind not in FILLETED:
        _refuse_other_root(cloud, [one for one in chosen if one is not None], root_nominal_mm)
    agree = sum(one is not None for one in chosen) / shows
    return Plates(kind, shows / max(enough, 1), agree, side, sense, chosen)


def bare(cloud: Cloud, plates: Plates) -> tuple[Cloud, tuple[str, ...]]:
    """The cloud without layers that end beside the upper edge, and what they were, in words."""
    shown = np.array([i for i, one in enumerate(plates.readings) if one is not None])
    surfaces = [_upper_surface(cloud, int(i), one) for i, one in zip(shown, filter(None, plates.readings), strict=True)]
    return without_layers(cloud, shown, {"plate": surfaces}, -plates.sense)


def _upper_surface(cloud: Cloud, i: int, one: Reading) -> Surface:
    """Of frame i, from its edge to the end of the profile."""
    x, z, columns = profile(cloud, i)
    upper, below = one.faces[:2]
    inner, outer = (int(below[FIRST]) - 1, 0) if one.side > 0 else (int(below[LAST]) + 1, x.size - 1)
    on = np.arange(int(upper[FIRST]), int(upper[LAST]) + 1)
    return surface(x, z, -one.sense, columns, on, inner, outer)


def _refuse_other_root(cloud: Cloud, found: list[Reading], root_nominal_mm: float) -> None:
    """Refuse a plate of which a face between looks more like the expected root face than what is taken for it."""
    wide = np.median([[width_mm(face) for face in one.faces[1:]] for one in found], axis=0)
    off = np.abs(np.log(wide / root_nominal_mm))
    if off[:-1].min() < off[-1] - SURELY:
        raise InputError(
            cloud.source,
            f"what would be the root face is {wide[-1]:.2g} mm wide, another face {wide[int(np.argmin(off))]:.2g} mm: "
            "that one may be the root face, between two bevels, and the upper surface out of view? Show the upper "
            "surface, or give root_nominal_mm",
        )


def _above_fillet(one: Reading) -> Reading:
    """The reading of a nose as that of a J."""
    upper, flank, land, root = one.faces
    return one._replace(kind="J", faces=[upper, flank, root], arc=[land])


def _foot_radius_mm(cloud: Cloud, noses: list[Reading | None]) -> float:
    """Radius of the fillet between the bevel and the land of a nose; 0: none is told from a corner."""
    shows = [i for i, one in enumerate(noses) if one is not None]
    found = []
    for i in [shows[k] for k in evenly(len(shows), FEW_FRAMES)]:
        one, (x, z, _) = noses[i], profile(cloud, i)
        if one is None:
            raise AssertionError("chosen above")
        upper, flank, land, _ = one.faces
        ends = sorted((0.5 * (flank[X0] + flank[X1]), land[X1] if one.side > 0 else land[X0]))
        on = (x > ends[0]) & (x < ends[1])
        out, top = one.side * np.array([1.0, upper[SLOPE]]), crossing(upper, flank)
        axes = np.array([out, one.sense * one.side * np.array([out[1], -out[0]])]) / math.hypot(1.0, upper[SLOPE])
        place = np.stack([x[on] - top, z[on] - upper[SLOPE] * top - upper[OFFSET]], axis=1) @ axes.T
        fall = abs(math.atan(flank[SLOPE]) - math.atan(upper[SLOPE]))
        above = np.arange(int(flank[FIRST]), int(flank[LAST]) + 1)
        noise = robust_sd(z[above] - flank[SLOPE] * x[above] - flank[OFFSET])
        fit = fit_on_land(place, fall, max(noise * math.cos(math.atan(flank[SLOPE])), MIN_SIGMA_MM), None)
        found.append(0.0 if fit is None else fit.radius_mm)
    return float(np.median(found)) if found else 0.0


def _readings(cloud: Cloud, i: int) -> list[Reading]:
    x, z, column = profile(cloud, i)
    if x.size < LEAST_RETURNS:
        return []
    chain = whole_faces(straight_faces(x, z)[:MAX_LINES])
    return [one for one in readings(chain) if not _cut(cloud, one, column)]


def _stands_on(cloud: Cloud, i: int) -> bool:
    """Whether the last face in frame i joins an upright one, is parallel to the first and goes on to the view's end."""
    x, z, _ = profile(cloud, i)
    if x.size < LEAST_RETURNS:
        return False
    chain = whole_faces(straight_faces(x, z)[:MAX_LINES])
    last = len(chain) - 1
    return last > 1 and (lies_on(chain, last - 1, last, chain[0]) or lies_on(chain, 1, 0, chain[last]))


def _cut(cloud: Cloud, one: Reading, column: Int) -> bool:
    """Whether the field of view ends the root face of a reading: then it is none."""
    end = column[int(one.faces[-1][LAST if one.side > 0 else FIRST])]
    return bool(end <= 1 or end >= cloud.keep.shape[1] - 2)


def _plate(
    cloud: Cloud, found: list[list[Reading]], root_nominal_mm: float, upper_side: Float | None
) -> tuple[Int, int]:
    """Side (N,) and sense on which the profiles agree. A pass may look at the plate the other way round."""
    shows = [i for i, frame in enumerate(found) if frame]
    refused = "expected a plate with its upper surface, the faces of its preparation and its root face in view"
    if len(shows) < 2:
        cause = "no prepared plate, or its upper surface is not seen?"
        some = np.linspace(0, len(found) - 1, min(len(found), FEW_FRAMES)).round().astype(int)
        if np.mean([_stands_on(cloud, i) for i in some]) > SHOWN:
            cause = "it lies on a table or right above it (lift it), or beside another plate (`edge.segment_groove`)?"
        raise InputError(cloud.source, f"{refused}, found none: {cause}")
    best: list[tuple[float, int, Int]] = []
    way = flips(cloud).astype(np.int64)
    for sense in (1, -1):
        for first in (1, -1):
            sides = first * way
            roots = [
                width_mm(one.faces[-1])
                for i in shows
                for one in found[i]
                if (one.side, one.sense) == (sides[i], sense) and _is_upper(cloud, i, one, upper_side)
            ]
            typical = float(np.median(roots)) if len(roots) >= SHOWN * len(shows) else 0.0
            if typical > 0.0:  # returns of swapped axes run to and fro
                best.append((abs(math.log(typical / root_nominal_mm)), sense, sides))
    if not best:
        raise InputError(cloud.source, f"{refused}; the profiles do not agree on one: give upper_side, if you know it")
    best.sort(key=lambda one: one[0])
    if len(best) > 1 and best[1][0] - best[0][0] < SURELY:
        raise InputError(
            cloud.source,
            "upper surface and root face may each be the other, and both are about as wide as the nominal root face: "
            "give upper_side, a vector in the base that points to the plate's upper side",
        )
    return best[0][2], best[0][1]


def _is_upper(cloud: Cloud, i: int, one: Reading, upper_side: Float | None) -> bool:
    """Whether the upper surface of a reading looks where the user says that the upper side lies."""
    if upper_side is None:
        return True
    slope = one.faces[0][SLOPE]
    ex, ez = cloud.base_from_profiler[i, :3, 0], cloud.base_from_profiler[i, :3, 2]
    return float(one.sense * (slope * ex - ez) @ upper_side) > 0.0


def frames_of(cloud: Cloud, plates: Plates, rim_mm: float = 0.0, flank_mm: float = math.inf) -> PreparedFrames:
    """The faces of each profile as lines, their labels, and the end of the root face.

    rim_mm: how much of the root face's free end, along x, is rounded: its line leaves that out.
    flank_mm: of a J, length of its flank from the upper corner on; inf: not known.

    Raises:
        InputError: hardly a profile shows enough of every face.
    """
    kind, side = plates.kind, plates.side
    order = ORDERS[kind]
    ends_at = [one is not None and one.below is not None for one in plates.readings]
    has_below = sum(ends_at) > SHOWN * sum(one is not None for one in plates.readings)
    found = (*order, LOWER_SURFACE) if has_below else order
    labels = np.zeros(cloud.keep.shape, np.uint8)
    for i, one in enumerate(plates.readings):
        if one is None or (has_below and one.below is None):
            continue
        if has_below and one.below is not None:
            one = one._replace(faces=[*one.faces, one.below])
        x, _, column = profile(cloud, i)
        for k, label in enumerate(found):
            labels[i, column[_on_face(x, one, k, 0.0 if has_below else rim_mm, flank_mm)]] = label
        if one.arc:
            fillet = column[_fillet(x, one)]
            labels[i, fillet[labels[i, fillet] == 0]] = FILLET
    faces = {label: labelled_lines(cloud.x_mm, cloud.z_mm, labels, label) for label in found}
    seen = np.all([face.count > 0 for face in faces.values()], axis=0)
    if kind == "J":
        seen &= _whole(faces[FLANK], seen)
    labels[~seen] = 0
    faces = {label: labelled_lines(cloud.x_mm, cloud.z_mm, labels, label) for label in found}
    if seen.sum() < 2:
        raise InputError(
            cloud.source,
            f"what looks like a {kind} preparation shows all its faces, each with {MIN_POINTS} returns clear of its "
            f"corners, in {seen.sum()} profiles only: columns too coarse for it, or another preparation?",
        )
    sigma = {label: face.noise_mm for label, face in faces.items()}
    end, rising = _root_ends(cloud, side, faces[ROOT_FACE], faces[BEVEL_FACE], sigma[ROOT_FACE])
    nothing = labelled_lines(cloud.x_mm, cloud.z_mm, np.zeros_like(labels), 1)
    outward = np.where(seen, end[:, 3] * rising, 0).astype(np.int64)
    noise = [sigma[order[0]], sigma[BEVEL_FACE], sigma[ROOT_FACE], sigma[found[-1]]]
    tracked = TrackedFaces(
        {UPPER_SURFACE: nothing, LOWER_SURFACE: nothing, **faces},
        seen,
        np.where(seen, side, np.nan).astype(float),
        end[:, :3],
        outward,
        end[:, 4] == tracking.MIXED,
        (end[:, 4] == tracking.CUT) & (not has_below),
        (end[:, 4] == tracking.BURR) & (not has_below),
        seen & has_below,
        np.zeros(len(labels), bool),
        labels,
        np.tile(noise, (len(labels), 1)),
    )
    return PreparedFrames(kind, plates.share, plates.agreement, tracked, order, sigma)


def _root_ends(cloud: Cloud, side: Int, root: FaceLines, bevel: FaceLines, sigma_mm: float) -> tuple[Float, Float]:
    """What `tracking.root_end` finds (N, 5); 1 where the way out goes with rising columns, -1: with falling ones."""
    end, rising = np.full((len(side), 5), np.nan), np.ones(len(side))
    for i in np.flatnonzero(root.count > 0):
        state, row = np.zeros((4, 4)), np.zeros((4, 8))
        for f, face in ((tracking.ROOT, root), (tracking.BEVEL, bevel)):
            slope = face.slope[i]
            state[f, :2] = slope, face.z_mean[i] - slope * face.x_mean[i]
            row[f] = (
                face.count[i],
                face.x_mean[i],
                face.z_mean[i],
                face.sxx[i],
                face.sxz[i],
                face.szz[i],
                *face.columns[i],
            )
        x, z, keep = cloud.x_mm[i], cloud.z_mm[i], cloud.keep[i]
        gate = tracking.FINAL_SIGMAS * sigma_mm + 0.004
        end[i] = tracking.root_end(x, z, keep, float(side[i]), state, row, gate)
        first, last = root.columns[i]
        rising[i] = np.sign(side[i] * float(x[last] - x[first]))
    return end, rising


def _on_face(x: Float, one: Reading, k: int, rim_mm: float, flank_mm: float) -> Int:
    """Indices of the points of face k of a reading, clear of its corners."""
    row, last = one.faces[k], len(one.faces) - 1
    lean = math.hypot(1.0, row[SLOPE])
    trim = min(TRIM_MM, TRIM_SHARE * width_mm(row)) / lean
    start, stop = _ends(one, k)  # along side * x
    start += trim if k > 0 else 0.0
    stop -= trim if k < last else tracking.CORNER_MARGIN_MM / lean
    if k == last:
        stop = max(stop - rim_mm, 0.5 * (start + stop))
    if k == 0:
        start = max(start, stop - SIDE_MM / lean)
    if one.arc and k == 1:
        stop -= min(FILLET_MM, 0.5 * width_mm(row)) / lean
        stop = min(stop, start + (flank_mm - TRIM_MM) / lean)
    on = np.arange(int(row[FIRST]), int(row[LAST]) + 1)
    return on[(one.side * x[on] >= start) & (one.side * x[on] <= stop)]


def _fillet(x: Float, one: Reading) -> Int:
    """Indices of the points of a reading's fillet and land, and of the flank, less what may be a rounded corner."""
    rows = sorted((one.faces[1], *one.arc), key=lambda row: row[FIRST])
    on = np.arange(int(rows[0][FIRST]), int(rows[-1][LAST]) + 1)
    last = one.arc[-1]
    far = max(one.side * float(last[X0]), one.side * float(last[X1]))
    trim = min(TRIM_MM, TRIM_SHARE * sum(width_mm(row) for row in one.arc)) / math.hypot(1.0, last[SLOPE])
    return on[one.side * x[on] < far - trim]


def _ends(one: Reading, k: int) -> tuple[float, float]:
    """Where face k of a reading starts and ends along side * x: at its corners, or where its own line does."""
    row = one.faces[k]
    ends = sorted(one.side * float(at) for at in row[:2])
    neighbours = [one.faces[k - 1] if k > 0 else None, one.faces[k + 1] if k + 1 < len(one.faces) else None]
    if one.arc:  # between flank and root face
        neighbours = [None if k == 2 else neighbours[0], None if k == 1 else neighbours[1]]
    corners = [math.nan if other is None else one.side * crossing(row, other) for other in neighbours]
    start, stop = (own if math.isnan(corner) else corner for own, corner in zip(ends, corners, strict=True))
    return start, stop


def _whole(flank: FaceLines, seen: Bool) -> Bool:
    """Frames (N,) that show as much of a flank as most do: where returns are lost, its line leans on the fillet."""
    return np.asarray(flank.widths_mm > WHOLE * np.median(flank.widths_mm[seen])) if seen.any() else seen
