"""Every profile across a groove, read and brought into the groove's section planes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.artefacts import Cloud
from workbench.checks.corners import thinning
from workbench.checks.limits import most
from workbench.edge.fillet import Fillets, fit_below_flank, fit_circle
from workbench.edge.groove_form import NOTHING_TOLD, Form, Repeated
from workbench.edge.groove_profile import (
    DROP_MM,
    DROP_POINTS,
    SHARED,
    Kind,
    Side,
    is_read,
    read_profile,
    upwards,
)
from workbench.edge.measure import check_advance, edge_direction
from workbench.errors import InputError
from workbench.geometry.course import Course, fit_course
from workbench.geometry.curves import Curve, along_motion, fit_curve
from workbench.geometry.grids import columns_to_next
from workbench.units import DEG, Bool, Float, Int, Shaped

SAMPLE = 24  # profiles that show which way is up
FEW, COLUMNS = 10, 400  # profiles that show whether there are two plates, and about how many columns of each
LOOKED_AT = 100  # and eight times as many profiles, among which these are
LEAST_RETURNS = 50  # of a profile
LEAST_TOLD = 150  # of most profiles, for a type: of 98, a fillet of 4 mm had seven, and a U was measured as an HV
NEIGHBOURS, STEADY_SIGMAS, STEADY_MM = 31, 5.0, 0.3  # profiles; corners further off their running median are false
LEAST_FACE = 0.34  # share of the profiles that show a face, for a plate to have it
LEAST_SIGMA_MM = 1e-3
COVERED = 0.34  # of profiles in which something joins a plate's end, from which on nothing tells where it is
STRAY_SIGMAS = 3.5
LEAST_ACROSS = 0.5  # of an error along the rays, that counts across a face: steeper ones show other errors
ADJOINS_COLUMNS, ADJOINS_RETURNS = 2, 3  # at most between the plates' ends, where these lie side by side in the view
MOST_BETWEEN = DROP_POINTS + SHARED + 1  # as few do not tell a weld; they join the ends where none lies deeper
LAST_COLUMNS = 20  # of a face, among which those without return are counted
THIRD = 3  # return beyond an upper surface's end


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


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """One plate of n profiles in the section planes, drawn as a left one: the right plate's a is mirrored."""

    kind: Kind
    plate: Shaped[Float, " n"]  # direction of the upper surface, towards the groove, rad
    plate_variance: Float
    face: Shaped[Float, " n"]  # direction of the face downwards; NaN at an `edge`
    face_variance: Float
    face_s: Shaped[Float, " n"]  # arc length where the profile cuts the face's middle
    # how far the profile goes along the groove a mm of the upper surface: it stands obliquely
    plate_way: Shaped[Float, " n"]
    face_way: Float
    corner: Shaped[Float, "n 2"]  # where both meet
    corner_variance: Shaped[Float, "n 2"]
    last: Shaped[Float, "n 2"]  # innermost return of the plate; NaN where something covers its end
    step: Shaped[Float, " n"]  # from there to the next column
    edge_step: Shaped[Float, " n"]  # from the upper surface's last return to the next column
    missing: float  # mm of the upper surface, as many columns return nothing beyond the last return, before others do
    # how far above the plate's last return the other plate's lies that is next to it in the profile; NaN where columns
    # without return, or more than a few returns, lie between them, or where a root face is seen below
    next_up: Shaped[Float, " n"]
    grazing: Shaped[Float, " n"]  # how many times as far apart as on the plate the returns stand on the face
    rounded: float  # mm by which a rounded edge is seen beyond the upper surface, where nothing is seen below it
    sigma: float  # noise of a return across the face, mm
    radius_lever: Shaped[Float, " n"]  # of the fillet's radius, a mm of its form: large where a short arc is seen
    fillets: Fillets
    lowest: Shaped[Float, "n 2"]  # lowest return of the root face; NaN: none, or something covers its end
    root_a: Shaped[Float, " n"]  # a of the root face's returns; NaN where it is not seen
    spacing: Shaped[Float, " n"]  # of its returns, down
    lost: Shaped[Float, "n 2"]  # share of the last columns without return, of the face and of the root face
    below: Shaped[Float, "n 2"]  # from the last return of the bevel to that of the root face, inwards and down; NaN
    is_covered: bool  # whether a third of the profiles show something that joins the last return: a weld, a strip
    pattern: float  # share of the noise's variance that every profile repeats in the same column
    # log-likelihood of WALKS, by which an error of the sensor that every profile repeats grows as a random walk, as the
    # upper surface shows it and as the face does; 0: it tells nothing
    walk: Shaped[Float, "w k"]
    face_walk: Shaped[Float, "w k"]
    form_mm: float  # u of the upper surface's height at the corner: it is not straight, or carries a tape
    form_turn: float  # and of its direction, rad
    plate_mm: float  # width of the upper surface that is measured
    face_mm: float  # width of the face; NaN: there is none

    @property
    def lean_deg(self) -> float:
        """By how much what is taken for the root face leans from the square to its plate; 0: none is seen.

        By the bevel's last return and the lowest one, less a column.
        """
        shown = np.isfinite(self.below[:, 0])
        if not shown.mean() > LEAST_FACE:
            return 0.0
        inwards, down = np.median(self.below[shown], axis=0)
        beyond = max(float(inwards - np.nanmedian(self.step)), 0.0)
        return math.atan2(beyond, float(down)) / DEG


def read_frames(cloud: Cloud) -> ReadFrames:
    """Read every profile of a cloud; the first pass's x rises from left to right.

    Raises:
        InputError: profiles have too few returns; most do not show two plates.
    """
    frames, profiles, flips = _profiles(cloud, np.arange(len(cloud.keep)))
    returns = int(np.median([x.size for x, _, _ in profiles])) if profiles else 0
    if 0 < returns < LEAST_TOLD:
        raise InputError(
            cloud.source,
            f"expected {LEAST_TOLD} returns and more in a profile, found {returns}: too few to tell a flank with its "
            "fillet from a bevel; record every column, or a narrower view",
        )
    some = profiles[:: max(1, len(profiles) // SAMPLE)]
    up = upwards([p[0] for p in some], [p[1] for p in some])
    if up == 0.0:  # few profiles show what lies below: all of them are asked
        up = upwards([p[0] for p in profiles], [p[1] for p in profiles])
    if up == 0.0:
        raise InputError(cloud.source, "expected two plates with a groove between them: nothing is seen below them")
    seen = [read_profile(x, up * z) for x, z, _ in profiles]
    read = [one if one and is_read(one) else None for one in seen]
    both = [one for one in read if one is not None]
    share = len(both) / max(len(frames), 1)
    if not both:
        raise InputError(cloud.source, "expected two plates with a groove between them, found none: no groove?")
    left, agree_left = _kind([one[0] for one in both])
    right, agree_right = _kind([one[1] for one in both])
    good = [k for k, one in enumerate(read) if one is not None and one[0].kind == left and one[1].kind == right]
    if not good:
        raise InputError(
            cloud.source, f"no profile shows the plates as most do ({left} left, {right} right): no groove?"
        )
    steady = _steady(
        np.array([[*one[0].corner, *one[1].corner] for k in good if (one := read[k]) is not None]),
        cloud.pass_index[[frames[k] for k in good]],
    )
    good = [k for k, on in zip(good, steady, strict=True) if on]
    kept = [one for k in good if (one := read[k]) is not None]
    numbers = np.array([frames[k] for k in good], np.int64)
    return ReadFrames(
        numbers,
        ([one[0] for one in kept], [one[1] for one in kept]),
        [profiles[k][2] for k in good],
        flips[numbers],
        (left, right),
        up,
        share,
        sum(one is not None and not is_read(one) for one in seen) / max(len(frames), 1),
        sum(one is not None and "compound" in (one[0].kind, one[1].kind) for one in seen) / max(len(frames), 1),
        min(agree_left, agree_right),
    )


def two_plates_share(cloud: Cloud) -> float:
    """Share of some profiles in which two plates stand nearly level with a groove between them: no milled, no raw edge.

    A table or a fixture beside a plate lies deeper than half of what is seen between the two.
    """
    every = thinning(len(cloud.keep), LOOKED_AT)
    shows = every * np.flatnonzero(cloud.keep[::every].sum(axis=1) >= LEAST_RETURNS)
    if not shows.size:
        return 0.0
    some = cloud.of_frames(shows[np.unique(np.linspace(0, shows.size - 1, FEW).astype(int))])
    _, profiles, _ = _profiles(some, np.arange(len(some.keep)))
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
    return abs(float(right.corner[1] - left.corner[1])) < most("groove_level") * depth


def _profiles(cloud: Cloud, of: Int) -> tuple[list[int], list[tuple[Float, Float, Int]], Float]:
    """Frames with enough returns; x from left to right, z and columns of each; and `_flips` of all."""
    frames, profiles, flips = [], [], _flips(cloud)
    for i in of:
        column = np.flatnonzero(cloud.keep[i])
        if column.size < LEAST_RETURNS:
            continue
        x = flips[i] * cloud.x_mm[i, column].astype(np.float64)
        # In the order of the columns: under a fan, what lies far below a root face may have a smaller x than that.
        order = slice(None) if x[-1] >= x[0] else slice(None, None, -1)
        frames.append(int(i))
        profiles.append((x[order], cloud.z_mm[i, column].astype(np.float64)[order], column[order]))
    return frames, profiles, flips


def _steady(corners: Float, group: Int) -> Bool:
    """Profiles (n,) whose corners (n, 4) lie where those of their neighbours do: lost returns make false ends."""
    out = np.ones(len(corners), bool)
    for p in np.unique(group):
        mine = np.flatnonzero(group == p)
        for _ in range(2):
            near = mine[out[mine]]
            off = np.abs(corners[near] - scipy.ndimage.median_filter(corners[near], (NEIGHBOURS, 1), mode="nearest"))
            wide = np.maximum(STEADY_SIGMAS * np.median(off, axis=0) / 0.6745, STEADY_MM)
            out[near] = (off < wide).all(axis=1)
    return out


def _flips(cloud: Cloud) -> Float:
    """1 for each frame whose x runs as that of the first frame does, else -1."""
    ex, ez = cloud.base_from_profiler[:, :3, 0], cloud.base_from_profiler[:, :3, 2]
    out = np.ones(len(ex))
    for p in np.unique(cloud.pass_index):
        mine = cloud.pass_index == p
        # The normal of the laser plane, x from left to right and z both as in the first frame, keeps its sense.
        same = float((np.cross(ez[mine], ex[mine]) @ np.cross(ez[0], ex[0])).mean())
        out[mine] = 1.0 if same >= 0 else -1.0
    return out


def _kind(sides: list[Side]) -> tuple[Kind, float]:
    """The kind that most profiles show of a plate, and their share of those that show a face."""
    faces = [side.kind for side in sides if side.kind != "edge"]
    if len(faces) < LEAST_FACE * len(sides):
        return "edge", 1.0
    best = max(sorted(set(faces)), key=faces.count)
    return best, faces.count(best) / len(faces)


def groove_curve(cloud: Cloud, read: ReadFrames) -> tuple[Curve, Float]:
    """The curve midway between the upper edges, and each profile's arc length (n,) on it."""
    left, right = ([side.corner for side in sides] for sides in read.sides)
    middle = 0.5 * (np.array(left) + np.array(right))
    pose = cloud.base_from_profiler[read.frame]
    ex, up = read.flip[:, None] * pose[:, :3, 0], read.up * pose[:, :3, 2]
    points = pose[:, :3, 3] + middle[:, :1] * ex + middle[:, 1:] * up
    check_advance(cloud, points)
    whole, across = np.full((len(cloud.keep), 3), np.nan), np.full((len(cloud.keep), 3), np.nan)
    whole[read.frame], across[read.frame] = points, np.cross(up, ex)
    along = edge_direction(whole, across, cloud)[read.frame]
    good = np.isfinite(along).all(axis=1)
    check_advance(cloud, points[good])
    group = cloud.pass_index[read.frame]
    s = np.full(len(points), np.nan)
    s[good] = along_motion(points[good], along[good], group[good])
    curve = fit_curve(points[good], s[good], group[good])
    s[good] = curve.project(points[good], s[good])
    return curve, s


def section_points(
    cloud: Cloud, read: ReadFrames, curve: Curve, s: Float, turn: Float, k: int, indices: Int, mirror: float
) -> tuple[Float, Float]:
    """Points (m, 2) of profile k in the section planes: (right, up), turned by `turn`; mirrored by mirror = -1.

    And their arc lengths (m,): a profile cuts the groove obliquely.
    """
    i = np.full(indices.size, read.frame[k])
    points = cloud.placed(i, read.columns[k][indices])
    at = curve.project(points, np.full(indices.size, s[k]))
    right, up = axes(curve, at, np.full(indices.size, turn[k]))
    off = points - curve.position(at)
    return np.stack([mirror * (off * right).sum(axis=1), (off * up).sum(axis=1)], axis=1), at


def axes(curve: Curve, s: Float, turn: Float) -> tuple[Float, Float]:
    """Right and up (n, 3) of the section planes; `turn` (n,): direction of right in the curve's frame."""
    _, a, b = curve.frame(s)
    c, d = np.cos(turn)[:, None], np.sin(turn)[:, None]
    return c * a + d * b, d * a - c * b


def plate_turn(cloud: Cloud, read: ReadFrames, curve: Curve, s: Float) -> tuple[Float, Course, float]:
    """Direction of both plates' upper surfaces in the curve's frame: (n,) at each profile, and as a course.

    Also a constant near it: the course is of the difference.
    """
    pose = cloud.base_from_profiler[read.frame]
    _, a, b = curve.frame(s)
    ex = read.flip[:, None] * pose[:, :3, 0]
    rough = np.arctan2((ex * b).sum(axis=1), (ex * a).sum(axis=1))
    about = float(np.angle(np.exp(1j * rough).mean()))
    found = np.full((s.size, 2), np.nan)
    for k in range(s.size):
        for side in (0, 1):
            points, _ = section_points(cloud, read, curve, s, np.full(s.size, about), k, read.sides[side][k].upper, 1.0)
            found[k, side] = _line(points, _ray(cloud, read, curve, s, np.full(s.size, about), k, 1.0))[2]
    tilt = fit_course(s, found.mean(axis=1), None, cloud.pass_index[read.frame])
    return about - tilt.value(s), tilt, about


def _ray(cloud: Cloud, read: ReadFrames, curve: Curve, s: Float, turn: Float, k: int, mirror: float) -> Float:
    right, up = axes(curve, s[k : k + 1], turn[k : k + 1])
    ez = cloud.base_from_profiler[read.frame[k], :3, 2]
    ray = np.array([mirror * float(right[0] @ ez), float(up[0] @ ez)])
    return np.asarray(ray / np.linalg.norm(ray))


def _line(points: Float, ray: Float) -> tuple[Float, float, float, float, float, float]:
    """Line through points (m, 2) with noise along `ray`, robust.

    Returns centroid, rms of the residuals along the ray, direction, and for residuals of 1 mm: variance of the
    direction, of the centroid across the line; share of the ray's noise that counts across the line.
    """
    side = np.array([ray[1], -ray[0]])
    side = side * (1.0 if side[0] >= 0 else -1.0)
    u, v = points @ side, points @ ray
    keep = np.ones(u.size, bool)
    for _ in range(4):
        mean_u, mean_v = u[keep].mean(), v[keep].mean()
        suu = float(((u[keep] - mean_u) ** 2).sum())
        slope = float(((u[keep] - mean_u) * (v[keep] - mean_v)).sum()) / max(suu, 1e-12)
        off = v - mean_v - slope * (u - mean_u)
        scale = 1.4826 * float(np.median(np.abs(off[keep]))) + LEAST_SIGMA_MM
        again = np.abs(off) < STRAY_SIGMAS * scale
        if again.sum() < max(3, 0.5 * u.size) or (again == keep).all():
            break
        keep = again
    count = int(keep.sum())
    rms = math.sqrt(float((off[keep] ** 2).sum()) / max(count - 2, 1)) + LEAST_SIGMA_MM
    way = side + slope * ray
    across = 1.0 / math.hypot(1.0, slope)
    return (
        mean_u * side + mean_v * ray,
        rms,
        math.atan2(way[1], way[0]),
        across**4 / max(suu, 1e-9),
        across**2 / count,
        across,
    )


def _median_or(values: Float, otherwise: float) -> float:
    """The median of values (n,) less their NaN; of nothing else the other."""
    return float(np.nanmedian(values)) if np.isfinite(values).any() else otherwise


def _hidden_lever(fillets: Fillets, k: int, arc: Float, ray: Float, noise_mm: float) -> float:
    """By how much an error across the arc of profile k moves its radius; NaN: no circle, else it joins the fillets."""
    circle = fit_circle(arc, ray, noise_mm)
    if circle is None:
        return math.nan
    fillets.add(k, circle)
    half = math.asin(min(1.0, 0.5 * float(np.linalg.norm(arc[-1] - arc[0])) / circle.radius_mm))
    return 1.0 / (1.0 - math.cos(half))


def side_lines(cloud: Cloud, read: ReadFrames, curve: Curve, s: Float, turn: Float, which: int) -> Lines:
    """The left (0) or right (1) plate of every profile."""
    n, mirror = s.size, (1.0, -1.0)[which]
    kind = read.kinds[which]
    names = (
        "plate",
        "plate_v",
        "face",
        "face_v",
        "step",
        "root_a",
        "face_s",
        "spacing",
        "rms_p",
        "rms_f",
        "share",
        "edge_step",
        "missing",
        "next_up",
        "grazing",
        "lever",
        "plate_way",
        "face_way",
        "width_p",
        "width_f",
    )
    value = {name: np.full(n, np.nan) for name in names}
    corner, corner_v = np.full((n, 2), np.nan), np.full((n, 2), np.nan)
    last, lowest, ends, beneath, lost = (np.full((n, 2), np.nan) for _ in range(5))
    held = []
    fillets = Fillets(n)
    form, of_plate, of_face = Form(), Repeated(cloud.keep.shape[1]), Repeated(cloud.keep.shape[1])
    value["next_up"] = _next_up(cloud, read, which)
    beyond_end, beyond_last = (_columns_on(cloud, read, which, name) for name in ("end", "last"))
    for k, side in enumerate(read.sides[which]):
        if not np.isfinite(s[k]):
            continue
        ray = _ray(cloud, read, curve, s, turn, k, mirror)
        strip = _strip(side, which)
        take = [side.upper, side.face, side.arc, np.array([side.end, side.last]), side.below, strip]
        points, at = section_points(cloud, read, curve, s, turn, k, np.concatenate(take), mirror)
        cuts = np.cumsum([part.size for part in take])[:-1]
        upper, face, arc, end, below, beside = np.split(points, cuts)
        held.append((k, upper, face, arc, ray, np.split(at, cuts)[:2], beside))
        ends[k], last[k], value["step"][k] = end[0], end[1], side.step_mm * beyond_last[k]
        columns = read.columns[k]
        face_columns = columns[side.arc if side.arc.size else side.face]
        lost[k] = [_lost(of, int(columns[side.last])) for of in (face_columns, columns[side.below])]
        spacing = float(np.median(np.hypot(*np.diff(upper[-30:], axis=0).T)))
        value["missing"][k] = spacing * _without_return(columns, side.last, which)
        value["edge_step"][k], value["grazing"][k] = spacing * beyond_end[k], side.step_mm / spacing
        if len(below) >= 2:
            low = below[np.argmin(below[:, 1])]
            beneath[k] = np.abs(low - end[1])
            lowest[k] = np.nan if side.covered else low
            value["root_a"][k] = float(np.median(below[:, 0]))
            value["spacing"][k] = float(np.median(np.abs(np.diff(below[:, 1])))) + 1e-3
        elif side.covered:
            last[k] = np.nan
        value["width_p"][k] = math.dist(upper[0], upper[-1])
        place, value["rms_p"][k], level, *_ = _line(upper, ray)
        off = (upper - place) @ np.array([-math.sin(level), math.cos(level)])
        on = np.abs(off) < STRAY_SIGMAS * value["rms_p"][k]
        form.add(upper[on], off[on])
        of_plate.add(read.columns[k][side.upper[on]], off[on])
        if face.size:
            value["width_f"][k] = math.dist(face[0], face[-1])
            value["face_s"][k] = float(np.split(at, cuts)[1].mean())
            place, value["rms_f"][k], level, *_, value["share"][k] = _line(face, ray)
            off = (face - place) @ np.array([-math.sin(level), math.cos(level)]) / value["share"][k]
            on = np.abs(off) < STRAY_SIGMAS * value["rms_f"][k]
            of_face.add(read.columns[k][side.face[on]], off[on])
    noise_p, noise_f = _median_or(value["rms_p"], 0.02), _median_or(value["rms_f"], 0.02)
    guess, told = 4.0, np.mean(beyond_end == 1) > COVERED  # beside blind columns, or a gap that looks like these
    for k, upper, face, arc, ray, cuts_at, beside in held:
        centre, _, angle, angle_v, off_v, _ = _line(upper, ray)
        value["plate"][k], value["plate_v"][k] = angle, angle_v * noise_p**2
        value["plate_way"][k] = _way_along(upper, cuts_at[0], angle)
        plate = (centre, angle, value["plate_v"][k], off_v * noise_p**2)
        if kind in ("edge", "hidden") and not (beyond_end[k] > 1 and told):
            corner[k], corner_v[k] = _end_corner(plate, ends[k], value["edge_step"][k])
        if kind == "hidden":
            value["lever"][k] = _hidden_lever(fillets, k, arc, ray, noise_p)
        if kind in ("edge", "hidden"):
            continue
        middle, _, way, way_v, face_off_v, share = _line(face, ray)
        way = _downwards(way)
        way_v, face_off_v = way_v * noise_f**2, face_off_v * noise_f**2
        if kind == "round":
            found = fit_below_flank(np.concatenate([face, arc]), middle, way, noise_f * share, guess)
            if found is None:
                continue
            (way, way_v, middle, face_off_v), fillet = found
            guess = fillet.radius_mm
            fillets.add(k, fillet)
        value["face"][k], value["face_v"][k] = way, way_v
        value["face_way"][k] = _way_along(face, cuts_at[1], way)
        corner[k], corner_v[k] = _crossing(plate, (middle, way, way_v, face_off_v))
        form.add_strip(beside, plate, corner[k])
    width_p, width_f = _median_or(value["width_p"], math.nan), _median_or(value["width_f"], math.nan)
    is_covered = bool(np.mean([side.covered for side in read.sides[which]]) > COVERED)
    last[is_covered], lowest[is_covered] = np.nan, np.nan  # all or none
    across = _median_or(value["share"], 1.0)
    return Lines(
        kind,
        value["plate"],
        value["plate_v"],
        value["face"],
        value["face_v"],
        value["face_s"],
        value["plate_way"],
        value["face_way"],
        corner,
        corner_v,
        last,
        value["step"],
        value["edge_step"],
        float(np.nanmedian(value["missing"])) if np.isfinite(value["missing"]).any() else 0.0,
        value["next_up"],
        value["grazing"],
        float(np.median([side.rounded_mm for side in read.sides[which]])),
        max(noise_f * across, LEAST_SIGMA_MM),
        value["lever"],
        fillets,
        lowest,
        value["root_a"],
        value["spacing"],
        lost,
        beneath,
        is_covered,
        of_plate.pattern(),
        of_plate.walk(width_p),
        of_face.walk(width_f * across) if kind == "bevel" and across > LEAST_ACROSS else NOTHING_TOLD,
        *form.found(),
        width_p,
        width_f,
    )


def _strip(side: Side, which: int) -> Int:
    """Returns between an upper surface and the face below it."""
    if not side.face.size:
        return np.empty(0, np.int64)
    ends = (side.upper[-1] + 1, side.face[0]) if which == 0 else (side.face[-1] + 1, side.upper[0])
    return np.arange(*ends)


def _columns_on(cloud: Cloud, read: ReadFrames, which: int, name: str) -> Int:
    """Columns (n,) from a side's `end` or `last` return towards the groove to the next that ever measures; mostly 1."""
    outwards = np.zeros(len(read.frame), np.int64)
    for k, (columns, side) in enumerate(zip(read.columns, read.sides[which], strict=True)):
        rises = columns[-1] >= columns[0]
        outwards[k] = columns[getattr(side, name)] * (1 if rises == (which == 0) else -1)
    return columns_to_next(cloud.z_mm, outwards)


def _next_up(cloud: Cloud, read: ReadFrames, which: int) -> Float:
    """`Lines.next_up` (n,) of a side."""
    out = np.full(len(read.frame), np.nan)
    for k, (columns, side, other) in enumerate(
        zip(read.columns, read.sides[which], read.sides[1 - which], strict=True)
    ):
        next_ = other.below[(0, -1)[which]] if other.below.size else other.last
        between = abs(int(next_) - side.last) - 1
        blank = abs(int(columns[next_]) - int(columns[side.last])) - 1 - between
        if not side.below.size and between <= MOST_BETWEEN and blank <= ADJOINS_COLUMNS:
            z = read.up * cloud.z_mm[read.frame[k], columns[min(next_, side.last) : max(next_, side.last) + 1]]
            ends = (float(z[0]), float(z[-1])) if next_ > side.last else (float(z[-1]), float(z[0]))
            if between <= ADJOINS_RETURNS or z.min() > min(ends) - DROP_MM:
                out[k] = ends[1] - ends[0]
    return out


def _without_return(columns: Int, last: int, which: int) -> int:
    """Columns without a return among the next ones from return `last` of a profile towards the groove.

    Up to the third return: the first one may be a mixed pixel of the end.
    """
    beyond = min(max(last + (THIRD, -THIRD)[which], 0), columns.size - 1)
    return abs(int(columns[beyond]) - int(columns[last])) - abs(beyond - last)


def _lost(columns: Int, root: int) -> float:
    """Share without return among a face's columns next to the root's, between two that have one; NaN: too few."""
    away = np.abs(columns - root)
    away = away[away < LAST_COLUMNS]
    return 1.0 - (away.size - 2) / float(np.ptp(away) - 1) if away.size > LAST_COLUMNS // 4 else math.nan


def _way_along(points: Float, at: Float, angle: float) -> float:
    """Arc length (m,) along the groove a mm along a line of points (m, 2)."""
    along = points @ np.array([math.cos(angle), math.sin(angle)])
    return float(np.polyfit(along - along.mean(), at, 1)[0])


def _downwards(way: float) -> float:
    return way if math.sin(way) < 0 else way + (math.pi if way < 0 else -math.pi)


Line = tuple[Float, float, float, float]  # a place on it, its direction, variances of direction and of place across


def _crossing(one: Line, other: Line) -> tuple[Float, Float]:
    """Where two lines meet, and the variances of its two coordinates."""
    (p, a, av, po), (q, b, bv, qo) = one, other
    da, db = np.array([math.cos(a), math.sin(a)]), np.array([math.cos(b), math.sin(b)])
    na, nb = np.array([-da[1], da[0]]), np.array([-db[1], db[0]])
    matrix = np.linalg.inv(np.stack([na, nb]))
    at = matrix @ np.array([na @ p, nb @ q])
    # A line that turns about its place moves at the crossing by its lever; so both lines' places across vary by:
    across = np.array([po + av * float((at - p) @ da) ** 2, qo + bv * float((at - q) @ db) ** 2])
    return at, matrix**2 @ across


def _end_corner(plate: Line, last: Float, step: float) -> tuple[Float, Float]:
    """The end of an upper surface below which nothing is seen: half a column beyond its last return."""
    centre, angle, angle_v, off_v = plate
    along = np.array([math.cos(angle), math.sin(angle)])
    away = float((last - centre) @ along) + 0.5 * step
    return centre + away * along, np.array([step**2 / 12.0, off_v + angle_v * away**2])
