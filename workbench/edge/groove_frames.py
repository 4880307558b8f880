"""Every profile across a groove, read and brought into the groove's section planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from workbench.artefacts import Cloud
from workbench.checks.corners import thinning
from workbench.edge.frame_order import flips, profile
from workbench.edge.groove_profile import (
    LEAST_FALL,
    Kind,
    Side,
    is_read,
    read_profile,
    upwards,
)
from workbench.edge.measure import UNDETERMINED, check_advance, edge_direction
from workbench.errors import InputError
from workbench.geometry.along import by_pass
from workbench.geometry.blocks import evenly
from workbench.geometry.curves import Curve, along_motion, fit_curve
from workbench.geometry.poses import inverse
from workbench.units import TO_SD, Bool, Float, Int, Shaped

SAMPLE = 24  # profiles that show which way is up
FEW, COLUMNS = 10, 400  # profiles that show whether there are two plates, and about how many columns of each
LOOKED_AT = 100  # and eight times as many profiles, among which these are
LEAST_RETURNS = 50  # of a profile
LEAST_FOR_TYPE = 150  # of most profiles, for a type: of 98, a fillet of 4 mm had seven, and a U was measured as an HV
NEIGHBOURS, STEADY_SIGMAS, STEADY_MM = 31, 5.0, 0.3  # profiles; corners further off their running median are false
LEAST_FACE = 0.34  # share of the profiles that show a face, for a plate to have it
COMPOUND = "in {:.3g} % of the profiles a plate shows a face above a steeper one: a compound bevel, or one whose upper "
COMPOUND += "edge is dressed?"
FLUSH = 0.5  # of the depth: the level of one plate of a groove is off that of the other by less


@dataclass(frozen=True, slots=True, eq=False)
class ReadFrames:
    """The n profiles that show both plates as most do."""

    frame: Shaped[Int, " n"]  # their numbers in the cloud
    sides: tuple[list[Side], list[Side]]  # left, right
    columns: list[Int]  # of the points of each profile, in the order of their indices
    flip: Shaped[Float, " n"]  # -1 where the profiler's x falls from left to right
    kinds: tuple[Kind, Kind]
    up: float  # 1 where z counts out of the plates
    share: float  # of the profiles that have enough returns
    unread: float  # share of those with two plates of which a face could not be read
    compound: float  # share of those in which a plate shows two faces
    agreement: float  # share of the profiles with a face that show the kind that most do, of the worse side
    blind: float  # share of those in which nothing but the same columns parts the plates, which return nothing

    def only(self, keep: Bool) -> ReadFrames:
        """Of the profiles marked in `keep` (n,)."""
        sides = [[one for one, kept in zip(of, keep, strict=True) if kept] for of in self.sides]
        columns = [one for one, kept in zip(self.columns, keep, strict=True) if kept]
        return replace(self, frame=self.frame[keep], sides=(sides[0], sides[1]), columns=columns, flip=self.flip[keep])


def read_frames(cloud: Cloud) -> ReadFrames:
    """Read every profile of a cloud; the first pass's x rises from left to right.

    Raises:
        InputError: profiles have too few returns; most do not show two plates.
    """
    frames, profiles, way = _profiles(cloud)
    returns = int(np.median([x.size for x, _, _ in profiles])) if profiles else 0
    if 0 < returns < LEAST_FOR_TYPE:
        raise InputError(
            cloud.source,
            f"expected {LEAST_FOR_TYPE} returns and more in a profile, found {returns}: too few to tell a flank with "
            "its fillet from a bevel; record every column, or a narrower view",
        )
    some = profiles[:: max(1, len(profiles) // SAMPLE)]
    up = upwards([p[0] for p in some], [p[1] for p in some])
    if up == 0.0:  # few profiles show what lies below: all of them are asked
        up = upwards([p[0] for p in profiles], [p[1] for p in profiles]) or _towards_flange(cloud, profiles)
    if up == 0.0:
        raise InputError(
            cloud.source,
            "expected two plates with a groove between them: nothing is seen below them, and no flange "
            "above them tells which side is up: expected a hand-eye pose with its place",
        )
    seen = [read_profile(x, up * z) for x, z, _ in profiles]
    read = [one if one and is_read(one) else None for one in seen]
    both = [one for one in read if one is not None]
    shown = [{side.kind for side in one} for one in seen if one]
    share, unread, compound = (
        count / max(len(frames), 1)
        for count in (len(both), len(shown) - len(both), sum("compound" in one for one in shown))
    )
    if not both:
        why = COMPOUND.format(100.0 * compound) if compound else "no groove?"
        raise InputError(cloud.source, f"expected two plates with a groove between them, found none: {why}")
    left, agree_left = _kind([one[0] for one in both])
    right, agree_right = _kind([one[1] for one in both])
    good = [k for k, one in enumerate(read) if one is not None and one[0].kind == left and one[1].kind == right]
    if not good:
        why = f"no profile shows the plates as most do ({left} left, {right} right): "
        why += "does each pass see one plate's face alone? Add one from above the groove that sees both"
        raise InputError(cloud.source, why)
    alike = [one for k in good if (one := read[k]) is not None]
    corners = np.array([[*one[0].corner, *one[1].corner] for one in alike])
    falls = np.nan_to_num([[one[0].fall, one[1].fall] for one in alike])
    same = (np.abs(falls - np.median(falls, axis=0)) < LEAST_FALL).all(axis=1)  # others are of a rounding, or a weld
    steady = same & _steady(corners, cloud.pass_index[[frames[k] for k in good]])
    good = [k for k, on in zip(good, steady, strict=True) if on]
    kept = [one for k in good if (one := read[k]) is not None]
    ends = np.array([profiles[k][2][[a.last, b.last]] for k, (a, b) in zip(good, kept, strict=True)])
    parted = [a.last + 1 == b.last for a, b in kept]  # by nothing that returns
    blind = (ends == np.median(ends, axis=0)).all(axis=1) & parted if left == right == "edge" else np.zeros(1)
    numbers = np.array([frames[k] for k in good], np.int64)
    return ReadFrames(
        numbers,
        ([one[0] for one in kept], [one[1] for one in kept]),
        [profiles[k][2] for k in good],
        way[numbers],
        (left, right),
        up,
        share,
        unread,
        compound,
        min(agree_left, agree_right),
        float(blind.mean()),
    )


def _towards_flange(cloud: Cloud, profiles: Sequence[tuple[Float, Float, Int]]) -> float:
    """1 where z counts towards the flange, which carries the sensor above the plates, -1: away from it; 0: level."""
    if cloud.flange_from_profiler is None or not cloud.flange_from_profiler[:3, 3].any():
        return 0.0  # poses of the profiler itself: where its ranges are 0 is the sensor's, and may be among the plates
    flange = inverse(cloud.flange_from_profiler)[2, 3]
    z = np.concatenate([z for _, z, _ in profiles])
    return float(flange > z.max()) - float(flange < z.min())


def two_plates_share(cloud: Cloud) -> float:
    """Share of some profiles in which two plates stand nearly level with a groove between them: no milled, no raw edge.

    A table or a fixture beside a plate lies deeper than half of what is seen between the two.
    """
    every = thinning(len(cloud.keep), LOOKED_AT)
    shows = every * np.flatnonzero(cloud.keep[::every].sum(axis=1) >= LEAST_RETURNS)
    if not shows.size:
        return 0.0
    some = cloud.of_frames(shows[evenly(shows.size, FEW)])
    _, profiles, _ = _profiles(some)
    thin = [(x[:: 1 + x.size // COLUMNS], z[:: 1 + z.size // COLUMNS]) for x, z, _ in profiles]
    up = upwards([x for x, _ in thin[::3]], [z for _, z in thin[::3]])
    return float(np.mean([_is_groove(x, up * z) for x, z in thin])) if up else 0.0


def _is_groove(x: Float, y: Float) -> bool:
    read = read_profile(x, y)
    if read is None or all(side.kind == "edge" for side in read):
        return False
    left, right = read
    upper = float(np.median(y[left.upper])), float(np.median(y[right.upper]))
    between = y[min(left.last, right.last) : max(left.last, right.last) + 1]  # roots that touch may overlap
    depth = max(upper) - float(between.min())
    return abs(float(right.corner[1] - left.corner[1])) < FLUSH * depth


def _profiles(cloud: Cloud) -> tuple[list[int], list[tuple[Float, Float, Int]], Float]:
    """Frames with enough returns; x from left to right, z and columns of each; and `flips` of all."""
    way = flips(cloud)
    frames = np.flatnonzero(cloud.keep.sum(axis=1) >= LEAST_RETURNS).tolist()
    return frames, [profile(cloud, i, way[i]) for i in frames], way


def _steady(corners: Float, group: Int) -> Bool:
    """Profiles (n,) whose corners (n, 4) lie where those of their neighbours do: lost returns make false ends."""
    out = np.ones(len(corners), bool)
    for mine in by_pass(group):
        for _ in range(2):
            near = mine[out[mine]]
            off = np.abs(corners[near] - scipy.ndimage.median_filter(corners[near], (NEIGHBOURS, 1), mode="nearest"))
            wide = np.maximum(STEADY_SIGMAS * np.median(off, axis=0) * TO_SD, STEADY_MM)
            out[near] = (off < wide).all(axis=1)
    return out


def _kind(sides: list[Side]) -> tuple[Kind, float]:
    """The kind that most profiles show of a plate, and their share of those that show a face.

    A fillet whose flank another pass sees is the same as with it.
    """
    faces = [side.kind for side in sides if side.kind != "edge"]
    if faces.count("round") >= LEAST_FACE * len(sides):
        faces = ["round" if kind == "hidden" else kind for kind in faces]
    if len(faces) < LEAST_FACE * len(sides):
        return "edge", 1.0
    best = max(sorted(set(faces)), key=faces.count)
    return best, faces.count(best) / len(faces)


def groove_curve(cloud: Cloud, read: ReadFrames) -> tuple[Curve, ReadFrames, Float]:
    """The curve midway between the upper edges; the profiles of which it is known where they cut it, and there (n,)."""
    points, across = middles(cloud, read)
    check_advance(cloud, points)
    along = edge_direction(points, across, cloud.of_frames(read.frame))
    good = np.asarray(np.isfinite(along).all(axis=1))
    points, along, read = points[good], along[good], read.only(good)
    check_advance(cloud, points)
    group = cloud.pass_index[read.frame]
    s = along_motion(points, along, group)
    try:
        curve = fit_curve(points, s, group)
    except np.linalg.LinAlgError:
        raise InputError(cloud.source, UNDETERMINED) from None
    return curve, read, curve.project(points, s)


def middles(cloud: Cloud, read: ReadFrames) -> tuple[Float, Float]:
    """Midway between the upper edges in every profile (n, 3), in the base; a direction (n, 3) along the groove."""
    left, right = ([side.corner for side in sides] for sides in read.sides)
    middle = 0.5 * (np.array(left) + np.array(right))
    pose = cloud.base_from_profiler[read.frame]
    ex, up = read.flip[:, None] * pose[:, :3, 0], read.up * pose[:, :3, 2]
    return pose[:, :3, 3] + middle[:, :1] * ex + middle[:, 1:] * up, np.cross(up, ex)


def axes(curve: Curve, s: Float, turn: Float) -> tuple[Float, Float]:
    """Right and up (n, 3) of the section planes; `turn` (n,): direction of right in the curve's frame."""
    _, a, b = curve.frame(s)
    c, d = np.cos(turn)[:, None], np.sin(turn)[:, None]
    return c * a + d * b, d * a - c * b
