"""Is this a bevel at all? What the faces that were found must satisfy before any size of theirs is told."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Check, Cloud
from workbench.checks.corners import LEAST_FRAMES, frames_with, stands_out, thinning
from workbench.checks.judge import refuse_failed
from workbench.checks.levels import step_check
from workbench.checks.limits import Bound, check, least, most
from workbench.checks.passes import LEAST_RETURNS
from workbench.checks.sensor import column_pitch_mm, some
from workbench.checks.straightness import NAMES, Straightness, straight_checks, straightness
from workbench.geometry.medians import median
from workbench.units import DEG, AnyArray, Float

SAMPLE = 40  # frames with faces
COUNTED = 500  # frames, of which eight times as many tell the share that shows faces
LEAST_POINTS = 8  # of a face, to tell its direction
ON = 2.0 * DEG  # turn, median of the frames, of what goes on elsewhere
FURTHER = "further_face_deg"
HOLLOW = 12.0 * DEG  # turn beyond which a surface turns back, and within which it goes on
RIGHT, UPRIGHT = 90.0 * DEG, 15.0 * DEG  # the plate's surface stands upright on its root face to within this
SKIP, ADJOINING = 4, 24  # columns at a corner that are left out, and of the surface beyond it
FEW = 8  # columns of that surface at least
LONG_MM = 1.0  # of that surface at least: a rounded edge is none
WIDEST_WITHOUT_UPPER = 2.3  # times its nominal size, of a root face with no upper surface in view: true ones reach 2
NARROWEST_ALONE = 0.5  # likewise, where the nominal sizes alone tell it from a bevel face as narrow
AT_END = 2.0 / 3.0  # of its bow a face stands off its line at its ends


class ViewContext(NamedTuple):
    """What the view shows beside root face and bevel face themselves."""

    two_plates_share: float  # of the profiles, that show a groove between two plates
    root_seen_share: float  # of the frames with faces, in which the root face's own end is seen
    root_over_nominal: float  # its width over its nominal size
    root_nominal_mm: float
    upper_seen: bool  # the upper surface is in view, which tells the bevel face from it
    lower_seen: bool  # likewise the lower surface
    bevel_deg: float  # angle between the two faces
    bevel_nominal_deg: float
    readings_apart: float  # in score (edge.identify), by which root face and bevel face read the other way fit worse
    lies_on: bool  # what the plate lies on joins the root face's lower end
    rim_mm: float = 0.0  # of the root face at that end, that is its rounded or chamfered edge


def require_bevel(
    cloud: Cloud,
    labels: AnyArray,
    context: ViewContext,
    limits: Mapping[str, Bound] | None = None,
) -> tuple[Check, ...]:
    """As `judge_faces`; nor are faces a bevel that the view cuts off, or whose mirror image in view fits as well.

    Args:
        cloud, labels: see there.
        shown: what else the view shows.
        limits: limits to set by name.

    Raises:
        InputError: what was found is no bevel.
    """
    share, over = context.root_seen_share, context.root_over_nominal
    finding = f"the root face's lower end is in view in {100 * share:.0f} % of the frames with faces only: does "
    finding += "the view end on the part, so that upper surface and bevel face look like bevel face and root face, or "
    finding += "does something stand in front of it?"
    seen = check("root_seen_share", share, finding, given=limits)
    finding = f"what would be the root face is {over:.2g} times as wide as its nominal size: another face, or "
    finding += "another nominal size?"
    alone = not (context.upper_seen or context.lower_seen)
    narrowest = NARROWEST_ALONE if alone else least("root_over_nominal")
    widest = most("root_over_nominal") if context.upper_seen else WIDEST_WITHOUT_UPPER
    wide = check("root_over_nominal", over, finding, given=limits, default=(narrowest, widest))
    finding = (
        f"the faces meet at {context.bevel_deg:.1f} deg, where {context.bevel_nominal_deg:g} is nominal, as the upper "
        f"surface and a bevel face of {90.0 - context.bevel_deg:.1f} deg would: is the root face in view, and the "
        "nominal angle the drawing's? or a bevel above a land (inspect_preparation.json)?"
    )
    finding = finding if alone else "the upper or the lower surface is in view, which distinguishes the faces"
    deviations = [abs(angle - context.bevel_nominal_deg) for angle in (context.bevel_deg, 90.0 - context.bevel_deg)]
    right = check("complement_nearer_deg", deviations[0] - deviations[1] if alone else None, finding, given=limits)
    plates = plates_check(context.two_plates_share if alone else 0.0, limits)
    other = alone or context.two_plates_share > most("two_plates_share")
    finding = (
        "read the other way, bevel face as root face, the profiles fit as well: both are about as wide as the "
        "nominal root face, and neither upper nor lower surface is in view, or another plate is: give upper_side, "
        "widen the view, or is it a weld groove, for inspect_groove.json?"
    )
    finding = finding if other else "the upper or the lower surface is in view, which distinguishes the faces"
    apart = check("readings_apart", context.readings_apart if other else None, finding, given=limits)
    judged = judge_faces(cloud, labels, limits, context.lies_on, context.rim_mm)
    stepped = step_check(cloud, labels, context.root_nominal_mm, limits)
    checks = (plates, seen, wide, *judged, *stepped, right, apart)
    refuse_failed(checks, f"{cloud.source}: no bevel", "edge.segment.limits")
    return checks


def require_columns(cloud: Cloud, width_mm: float, limits: Mapping[str, Bound] | None = None) -> Check:
    """The check that columns stand close enough for a face as wide as expected.

    Args:
        cloud: organised.
        width_mm: expected width of the face.
        limits: limits to set by name.

    Raises:
        InputError: they do not.
    """
    pitch = column_pitch_mm(cloud.x_mm)
    count = width_mm / pitch if pitch > 0 else None
    finding = f"columns are {pitch:.3g} mm apart, which puts at most {count or 0:.0f} on a root face of {width_mm:g} mm"
    found = check("root_columns", count, f"{finding}: too coarse to tell its faces apart", given=limits)
    refuse_failed([found], cloud.source, "edge.segment.limits")
    return found


def plates_check(two_plates_share: float, limits: Mapping[str, Bound] | None = None) -> Check:
    """The check that no groove between two plates is taken for the edge of one."""
    share = f"{100 * two_plates_share:.0f} %"
    finding = (
        f"{share} of the profiles show two plates with a groove between them: a weld groove, for inspect_groove.json?"
    )
    return check("two_plates_share", two_plates_share, finding, given=limits)


def judge_faces(
    cloud: Cloud,
    labels: AnyArray,
    limits: Mapping[str, Bound] | None = None,
    lies_on: bool = False,
    rim_mm: float = 0.0,
) -> tuple[Check, ...]:
    """Checks of the faces (labels of `workbench.artefacts`, (N, M)) that were found in a cloud; none raises.

    The faces of a bevel are straight in the section and are there along the whole edge. On anything round, two chords
    that differ by 20 deg and more bow by a tenth of their width; on a bevel by less than a hundredth.
    lies_on: what joins the root face's other end is what the plate lies on, and turns up. rim_mm: of the root face at
    that end, that is rounded or chamfered: it is not asked whether it is straight.
    """
    given = limits or {}
    every = thinning(len(labels), COUNTED)
    shows = cloud.keep[::every].sum(axis=1) >= LEAST_RETURNS
    found = np.isin(labels[::every], list(NAMES)).any(axis=1)
    share = float((found & shows).sum() / max(int(shows.sum()), 1))
    finding = f"faces of a bevel were found in {100 * share:.0f} % of the frames: no bevel, or little of one?"
    rows = some(every * np.flatnonzero(found), SAMPLE)
    clear = _without_rim(cloud, labels, rim_mm) if rim_mm > 0.0 else labels
    shape = {face: straightness(cloud, clear, face) for face in NAMES}
    seen = [one for i in rows if (one := _corner_of(cloud, labels[i], int(i))) is not None]
    goes_on, further = _beyond_checks(seen, lies_on, given)
    turns = dict.fromkeys(NAMES, _turn_of(seen))
    if further.value:
        turns[BEVEL_FACE] = min(turns[BEVEL_FACE], further.value * DEG)  # parted by a bow, it has as much of it
    corner = stands_out(cloud, labels, *NAMES)
    bowed = bowed_mm(shape.values())
    out = corner.corner_mm - bowed
    ledge = f"the corner of root face and bevel face stands out of them by {out:.2g} mm: a ledge, a burr there, "
    ledge += "a nose (inspect_preparation.json)?"
    return (
        check("found_share", share, finding, given=given),
        *straight_checks(shape, turns, "a dome, a bar, a cable, a rounded groove, a hollow face", given),
        goes_on,
        further,
        check("corner_stands_out_mm", out, ledge, given=given),
        _ledge_check(corner.by_ledge_mm(bowed)),
    )


def _beyond_checks(seen: Sequence[_Corner], lies_on: bool, given: Mapping[str, Bound]) -> tuple[Check, Check]:
    """What follows beyond a face: beyond the root face, no part of a plate; beyond the bevel it may be a second one."""
    share, off = _goes_on(seen, BEVEL_FACE, lies_on)
    further = abs(off) if share > most("goes_on_share") else 0.0
    another = f"beyond the bevel face a further one follows, {further:.0f} deg off its direction: a compound bevel "
    another += "(inspect_preparation.json measures both faces), a land or a fillet"
    share, off = _goes_on(seen, ROOT_FACE, lies_on)
    bent = f"beyond what would be the root face the surface goes on, {abs(off):.0f} deg off its direction, in "
    bent += f"{100 * share:.0f} % of the frames: a compound bevel (inspect_preparation.json), or a face that bows?"
    if off < -HOLLOW / DEG:
        bent = f"beside the root face the surface turns up again in {100 * share:.0f} % of the frames: a groove, a "
        bent += "step in the root face, or a plate that lies on something (let its lower edge stand free by 2 mm)?"
    return (
        check("goes_on_share", share, bent, given=given),
        Check(FURTHER, further, None, True, "the verdict depends on which face is meant", another),
    )


def _ledge_check(close_mm: float) -> Check:
    """What a ledge too small to be seen would take off the root face goes by this."""
    finding = f"returns close to the corner of root face and bevel face stand out of them by {close_mm:.2g} mm"
    return Check("close_stands_out_mm", close_mm, None, True, "a ledge of that is in the uncertainty", finding)


def bowed_mm(faces: Iterable[Straightness]) -> float:
    """How far faces stand off their lines at their ends by their bows, mm: the most of them."""
    return AT_END * max(abs(one.bow_mm) for one in faces)


def corners_checks(
    cloud: Cloud, labels: AnyArray, pairs: Sequence[tuple[int, int]], limits: Mapping[str, Bound] | None = None
) -> tuple[Check, Check]:
    """The checks that no corner of two faces, by pairs of their labels (N, M), stands out of both."""
    out = close = 0.0
    for pair in pairs:
        corner, bowed = stands_out(cloud, labels, *pair), bowed_mm(straightness(cloud, labels, one) for one in pair)
        out, close = max(out, corner.corner_mm - bowed), max(close, corner.by_ledge_mm(bowed))
    finding = f"a corner of two faces stands out of them by {out:.2g} mm: a ledge, a further face, a burr there?"
    return check("corner_stands_out_mm", out, finding, given=limits), _ledge_check(close)


def bows_check(
    cloud: Cloud,
    labels: AnyArray,
    faces: Sequence[int],
    pairs: Sequence[tuple[int, int]],
    limits: Mapping[str, Bound] | None = None,
) -> tuple[Check, Check, Check]:
    """The checks that no face, by its label (N, M), is round or bent, or has too few returns to tell.

    pairs: of faces that make a corner.
    """
    rows = frames_with(labels, faces, SAMPLE)
    cornered = {label for pair in pairs for label in pair}
    counts = [
        np.median(((labels[rows] == face) & cloud.keep[rows]).sum(axis=1)) for face in cornered.intersection(faces)
    ]
    fewest = float(min(counts)) if counts and len(rows) else None
    few = f"the narrowest face has {fewest or 0:.0f} returns in a profile: too few to tell a face from a rounded corner"
    turns: dict[int, float] = {}
    for pair in pairs:
        turn = _turn_of([one for i in rows if (one := _corner_of(cloud, labels[i], int(i), pair)) is not None])
        turns |= {face: min(turns.get(face, turn), turn) for face in pair if turn}
    shape = {face: straightness(cloud, labels, face) for face in {*faces, *cornered}}
    return (
        check("face_columns", fewest, few, given=limits),
        *straight_checks(shape, turns, "a fillet, a rounded corner, a bead, or a face that is not straight", limits),
    )


def _turn_of(seen: Sequence[_Corner]) -> float:
    """Of the corner of two faces, rad, the median of some frames; 0: none shows it."""
    return max(float(np.median([one.turn for one in seen])), ON) if seen else 0.0


def _without_rim(cloud: Cloud, labels: AnyArray, rim_mm: float) -> AnyArray:
    """The labels (N, M) without so much of the root face's end away from the bevel face."""
    labels, columns = labels.copy(), np.arange(labels.shape[1])
    root = (labels == ROOT_FACE) & cloud.keep
    for i in np.flatnonzero(root.any(axis=1) & (labels == BEVEL_FACE).any(axis=1)):
        on = columns[root[i]]
        end = on[-1] if np.median(on) > np.median(columns[labels[i] == BEVEL_FACE]) else on[0]
        x, z = cloud.x_mm[i], cloud.z_mm[i]
        labels[i, on[np.hypot(x[on] - x[end], z[on] - z[end]) < rim_mm]] = 0
    return labels


class _Corner(NamedTuple):
    """What one frame shows of root face and bevel face, which stand side by side."""

    turn: float  # from one face to the other, rad
    adjoining: dict[int, float]  # by face, the turn to the surface that joins it on its other side, in that sense


def _goes_on(seen: Sequence[_Corner], face: int, lies_on: bool) -> tuple[float, float]:
    """Share of the frames in which the surface beyond a face is another face and none of the plate; its turn, deg.

    Upper and lower surface stand upright on the root face; what the plate lies on turns up.
    """
    upright = [RIGHT - UPRIGHT - (one.turn if face == BEVEL_FACE else 0.0) for one in seen]
    beyond = [one.adjoining[face] for one in seen]
    least = -HOLLOW if lies_on and face == ROOT_FACE else -np.inf
    goes = [least < turn < max(HOLLOW, lowest) for turn, lowest in zip(beyond, upright, strict=True)]
    off = float(np.median(np.array(beyond)[goes])) if any(goes) else 0.0
    return share_of([one and abs(off) > ON for one in goes]), off / DEG  # second returns stand off both ways


def share_of(found: list[bool]) -> float:
    """Share of the frames for which something was found; 0 where there are too few to tell."""
    return float(np.mean(found)) if len(found) >= LEAST_FRAMES else 0.0


def _corner_of(cloud: Cloud, labels: AnyArray, i: int, pair: Iterable[int] = NAMES) -> _Corner | None:
    """What frame i shows of the corner of its faces, a pair of labels; None: they do not stand side by side.

    From face to face along a profile of a convex edge the direction turns one way. In a groove it turns back.
    """
    x, z = cloud.x_mm[i].astype(np.float64), cloud.z_mm[i].astype(np.float64)
    kept = np.flatnonzero(cloud.keep[i])
    on = {face: np.flatnonzero((labels == face) & cloud.keep[i]) for face in pair}
    if min(len(one) for one in on.values()) < LEAST_POINTS // 2:
        return None
    (lower, first), (upper, second) = sorted(on.items(), key=lambda one: float(np.median(one[1])))
    sign = rising(x[kept])
    at_first, at_second = direction(x[first], z[first], sign), direction(x[second], z[second], sign)
    sense = float(np.sign(at_second - at_first))
    before = _joined(x, z, kept[kept < first[0]][::-1], first, sign)
    after = _joined(x, z, kept[kept > second[-1]], second[::-1], sign)
    adjoining = {lower: (at_first - before) * sense, upper: (after - at_second) * sense}
    return _Corner(abs(at_second - at_first), adjoining)


def rising(x: Float) -> float:
    """+1 if x rises with the column, else -1."""
    return 1.0 if x[-1] >= x[0] else -1.0


def direction(x: Float, z: Float, sign: float) -> float:
    """Angle (rad) of a straight run of returns, along rising columns; robust against a few strays."""
    half = len(x) // 2
    return float(np.arctan2(median(z[half:]) - median(z[:half]), sign * (median(x[half:]) - median(x[:half]))))


def _joined(x: Float, z: Float, beyond: AnyArray, face: AnyArray, sign: float) -> float:
    """Direction of the surface that begins where a face ends, without a jump, and long enough; NaN: none does.

    `beyond` and `face` are columns, both from the face's end on.
    """
    own, end = face[:ADJOINING], face[0]
    pitch = median(np.hypot(np.diff(x[own]), np.diff(z[own])))
    long = max(ADJOINING, math.ceil(LONG_MM / max(pitch, 1e-3)))
    run = beyond[SKIP : SKIP + long]
    if len(run) > FEW:  # a surface that the rays graze has few columns a millimetre
        far = np.hypot(x[run] - x[run[0]], z[run] - z[run[0]]) >= LONG_MM
        long = max(FEW, int(np.argmax(far)) + 1) if far.any() else long
        run = run[:long]
    if len(run) < long or abs(int(run[-1]) - int(end)) > 2 * (long + SKIP):
        return math.nan
    step = np.hypot(np.diff(x[run]), np.diff(z[run]))
    usual = max(median(step), pitch)
    gap = float(np.hypot(x[run[0]] - x[end], z[run[0]] - z[end]))
    if step.max() > 8.0 * usual or gap > 1.5 * usual * abs(int(run[0]) - int(end)):
        return math.nan
    run = np.sort(run)
    return direction(x[run], z[run], sign)
