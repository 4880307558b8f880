"""`edge.segment_groove`: a weld groove between two plates, from an organised cloud."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal, get_args

import numpy as np

from workbench.artefacts import Check, Cloud, Groove, GrooveType
from workbench.checks.faces import bows_check
from workbench.checks.judge import refuse_failed
from workbench.checks.limits import Bound, check, judged_by
from workbench.checks.profiles import in_order
from workbench.checks.window import hidden_columns_u
from workbench.edge.column_errors import declared_linearity
from workbench.edge.end_templates import EdgeCondition
from workbench.edge.extrapolated import name_extrapolated
from workbench.edge.frame_order import left_out
from workbench.edge.groove_frames import COMPOUND, ReadFrames, axes, groove_curve, read_frames
from workbench.edge.groove_plates import bare, labels_of, plates
from workbench.edge.groove_profile import JUMP_MM, Kind
from workbench.edge.groove_root_end import BLUNTED
from workbench.edge.groove_sizes import GrooveSizes
from workbench.edge.joint_lines import LEAST_FRAMES, Along, typical
from workbench.edge.parameters import (
    STATION_MM,
    USUAL_NOISE_MM,
    Limits,
    RobotNoiseLength,
    RobotNoiseOrUsual,
    usual_noise_mm,
)
from workbench.edge.segment_stage import laser_plane_u
from workbench.edge.unseen import by_window, fixed_end_check
from workbench.errors import InputError
from workbench.geometry.curves import Curve, covered, turn_by_robot
from workbench.stage import InputFile, stage
from workbench.units import AnyArray, Float, Int

SHADOW = "one root lies in the shadow of the other plate's: gap and depth are not told; lean the scan the other way"
LANDS = (
    "below the bevels the profile goes on level, but {:.1f} mm of it return nothing: lands beside an open gap, or a "
)
LANDS += "weld or a backing strip that is dark there; gap and depth are not told"
BENEATH = (
    "one root begins less deep than the other: below it the view may hide a steeper face, down to the other's level, "
)
BENEATH += "so that gap and depth are known bluntly: give `groove`"
COVERED = "what lies between the plates joins their faces, a weld or a backing strip: where these end is not told"
CUT = "in {:.0f} % of the profiles a plate ends behind something nearer, or beside a column that hardly ever returns, "
CUT += "over which it moves: a cable, blind columns or the sensor's window end what is seen; these ends are not told"
# Of profiles: beside gaps that wander in the view up to 0.02 share their columns, beside blind columns all.
BLIND_SHARE = 0.5
BLIND = "expected two plates with a groove between them: what parts them lies in the same columns of all profiles, "
BLIND += "which return nothing: dirt on the window, or on the sensor? Or a groove that the robot follows well: give "
BLIND += "`groove`"
KNIVES = ("V", "HV")  # types whose bevels reach the plate's lower surface
Given = Literal["auto", "I", "V", "Y", "HV", "HY", "X", "K", "U", "J"]


@stage("edge.segment_groove")
def segment_groove(
    cloud: Cloud,
    *,
    groove: Given = "auto",
    edge_condition: EdgeCondition = "unknown",
    robot_noise_mm: RobotNoiseOrUsual = USUAL_NOISE_MM,
    robot_noise_length_mm: RobotNoiseLength = None,
    sensor: InputFile | None = None,
    limits: Annotated[Limits, judged_by("edge.segment_groove")] = {},  # noqa: B006  (never changed)
) -> Groove:
    """Find the groove between two plates: corners, bevels, gap, root faces, fillets.

    How profiles are read, and what one side does not show: docs/grooves.md.

    Args:
        cloud: the organised cloud of one groove, in one or more passes from above it.
        groove: type by ISO 9692-1, or `auto`. Types that look alike from one side are all named.
        edge_condition: as in `edge.segment`, of the roots (docs/grooves.md).
        sensor: as in `edge.segment`.

    Raises:
        InputError: no two plates with a groove in view, or a declared type that is excluded.

    Example:
        >>> from workbench import edge, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/groove.h5"))
        >>> edge.segment_groove(points).type
        'Y'
    """
    cloud, read, layers = bare(cloud, read_frames(cloud))
    _refuse_blind(read, groove, cloud.source)
    kinds = read.kinds
    checks = _read_checks(read, limits)
    refuse_failed(checks, f"{cloud.source}: no groove", "edge.segment_groove.limits")
    curve, read, s = groove_curve(cloud, read)
    linearity = declared_linearity(sensor)
    labels = labels_of(cloud.of_frames(read.frame), read)
    both, tilt, about, taken_off = plates(cloud, labels, read, curve, s, linearity)
    cut = both[0].cut | both[1].cut
    notes = (CUT.format(100.0 * cut.mean()),) if cut.any() else ()
    if notes and min(np.isfinite(one.end[:, 0]).sum() for one in both) < LEAST_FRAMES:
        raise InputError(cloud.source, *notes)
    first, length = float(s.min()), float(np.ptp(s))
    at = np.linspace(0.0, length, max(3, round(length / STATION_MM) + 1))
    by_robot = turn_by_robot(curve, max(length, 1.0), usual_noise_mm(robot_noise_mm), robot_noise_length_mm)
    along = Along(
        s,
        cloud.pass_index[read.frame],
        at + first,
        np.hypot(curve.tangent_u(at + first), math.hypot(by_robot, laser_plane_u(cloud))),
        in_order(cloud.checks),
    )
    measured = GrooveSizes(
        cloud.source,
        both,
        along,
        _view(cloud, read.frame, curve, s, about - tilt.value(s)),
        linearity,
        hidden_columns_u(cloud.checks),
        edge_condition,
        0.5 if groove == "auto" else float(groove in KNIVES),
    )
    measured.measure(groove == "auto")
    checks.extend(_checks(cloud.of_frames(read.frame), read, labels, measured, limits))
    refuse_failed(checks, f"{cloud.source}: no groove", "edge.segment_groove.limits")
    ends = fixed_end_check(cloud.of_frames(read.frame), [one.outwards for one in measured.plates], len(read.frame))
    type_, alternatives, declared = _type(cloud, kinds, measured, groove)
    seen_s = np.full(len(cloud.keep), np.nan)
    seen_s[read.frame] = s - first
    t = curve.tangent(at + first)
    right, up = axes(curve, at + first, about - tilt.value(at + first))
    found = Groove(
        type=type_,
        alternatives=alternatives,
        declared=declared,
        arc_length_mm=at,
        origin_mm=curve.position(at + first),
        tangent=t,
        normal=right,
        across=up,
        seen=covered(seen_s, cloud.pass_index, at),
        sizes=measured.sizes,
        corners=measured.corners,
        frame_arc_length_mm=seen_s,
        x_mm=cloud.x_mm,
        base_from_profiler=cloud.base_from_profiler,
        pass_index=cloud.pass_index,
        part=cloud.part,
        checks=(*cloud.checks, *checks, ends),
        unseen=by_window(ends) + (type_ in KNIVES and edge_condition == "unknown") * (BLUNTED,),
        warnings=(
            *_alike(type_, alternatives, declared),
            *_hidden(measured, declared),
            *left_out(cloud.pass_index, np.isfinite(seen_s)),
            *((SHADOW,) if measured.shadowed else ()),
            *notes,
            *layers,
            *taken_off,
            *_covered(typical(np.array([one.parted_mm for one in measured.plates]))),
        ),
    )
    return name_extrapolated(found, cloud, max(one.sigma for one in measured.plates))


def _refuse_blind(read: ReadFrames, groove: Given, source: str) -> None:
    """Where nobody says that it is a groove, what parts the plates may be blind columns."""
    if groove == "auto" and read.blind > BLIND_SHARE:
        raise InputError(source, BLIND)


def _read_checks(read: ReadFrames, given: Mapping[str, Bound]) -> list[Check]:
    """That the profiles show two plates with one face each, and the same ones."""
    few = f"two plates with a groove between them were found in {100 * read.share:.0f} % of the profiles"
    few += f", in {100 * read.unread:.0f} % a face is too steep, low or curved to read" if read.unread else ""
    agree = read.agreement * read.share / max(read.share + read.unread, 1e-9)
    mixed = (
        f"{100 * agree:.0f} % of the profiles agree on the faces of the plates, in {100 * read.unread:.0f} % a face is "
        "too steep, low or curved to read: is it one groove, or a plate with two faces?"
    )
    return [
        check("found_share", read.share, f"{few}: no groove?", given=given),
        check("groove_compound", read.compound, COMPOUND.format(100.0 * read.compound), given=given),
        check("agreement", agree, mixed, given=given),
    ]


def _checks(
    cloud: Cloud, read: ReadFrames, labels: AnyArray, measured: GrooveSizes, given: Mapping[str, Bound]
) -> list[Check]:
    """That what was measured is a groove, that its faces are straight and that their ends were seen."""
    level = measured.level_share()
    gap, radius = measured.sizes["gap_mm"], measured.sizes.get("root_radius_mm")
    overlap, wide = typical(-gap.value - 3.0 * gap.u), max(typical(gap.value), 0.0)
    grazing = max((typical(one.grazing) for one in measured.plates if one.kind == "bevel"), default=math.nan)
    small = math.nan if radius is None else typical(radius.value)
    by = f"{100 * level:.0f} % of the groove's depth" if level < 10.0 else "many times the groove's depth"
    stands = f"one plate stands {by} above the other: a plate's edge or a lap joint?"
    far = f"the plates stand {wide:.1f} mm apart: two plates beside something else, or what lies under them?"
    if overlap > 0.0:
        wide, far = -overlap, "the plates' roots overlap: no gap, other faces were followed"
    steep = f"along a bevel the returns stand {grazing:.0f} times as far apart as on its plate: the view grazes it, so "
    steep += "that nothing tells where it ends; scan it more squarely"
    lean = max((one.lean_deg for one in measured.plates), default=math.nan)
    leans = f"what would be a root face leans by {lean:.0f} deg from the square to its plate: the lower face of a "
    leans += "compound bevel, or the bevel below a dressed upper edge; or what lies under the root, a backing strip?"
    misfit = max((off for one in measured.plates if math.isfinite(off := one.fillets.misfit())), default=math.nan)
    bent = f"what would be a fillet lies {misfit:.0f} times its noise off any circle: two faces that meet, a weld or a "
    bent += "backing strip at the root?"
    unlike = f"one plate's root begins {100 * measured.unlike:.0f} % less deep than the other's: a bevel of which the "
    unlike += "view hides the lower part?"
    short = f"a fillet of {small:.1f} mm: it is not told from a rounded corner"
    return [
        check("groove_level", level, stands, given=given),
        check("groove_gap_mm", _known(wide), far, given=given),
        check("bevel_grazing", _known(grazing), steep, given=given),
        check("root_face_lean_deg", _known(lean), leans, given=given),
        check("fillet_misfit", _known(misfit), bent, given=given),
        check("root_levels", _known(measured.unlike), unlike, given=given),
        check("fillet_radius_mm", _known(small), short, given=given),
        *_straight(cloud, read, labels, given),
    ]


def _straight(cloud: Cloud, read: ReadFrames, labels: AnyArray, given: Mapping[str, Bound]) -> tuple[Check, ...]:
    """The checks that the bevels, by their labels (n, M), are straight, and no rounded edges of the plates."""
    shown = [(plate, kind) for plate, kind in zip((1, 3), read.kinds, strict=True) if kind in ("bevel", "round")]
    if not shown:
        return ()
    corners = [(plate, plate + 1) for plate, kind in shown if kind == "bevel"]
    return bows_check(cloud, labels, [plate + 1 for plate, _ in shown], corners, given)


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _alike(type_: GrooveType, alternatives: tuple[GrooveType, ...], declared: bool) -> tuple[str, ...]:
    if not alternatives:
        return ()
    how, try_ = ("as given", "") if declared else ("by the evidence", ": give `groove` where it is known")
    return (f"type {type_} {how}; from the side seen it cannot be told from {', '.join(alternatives)}{try_}",)


def _hidden(measured: GrooveSizes, declared: bool) -> tuple[str, ...]:
    if measured.hides_beneath:
        return (BENEATH,)
    if declared or not measured.hides_bevels:
        return ()
    deg = f"{measured.hidden_deg:.0f} deg"
    note = f"nothing is seen below a plate's upper surface, where a bevel of up to {deg} may be: the gap is "
    note += "known bluntly" if np.isfinite(measured.sizes["gap_mm"].value).any() else "not told"
    return (note + ", and nothing that would rest on a square face: give `groove`",)


def _covered(parted_mm: float) -> tuple[str, ...]:
    if math.isnan(parted_mm):
        return ()
    return (LANDS.format(parted_mm) if parted_mm > JUMP_MM else COVERED,)


def possible_types(kinds: tuple[Kind, Kind], root_face: bool, no_root_face: bool) -> tuple[GrooveType, ...]:
    """Types whose upper side looks like this, the likeliest first; none: no groove of ISO 9692-1.

    root_face: one is seen; no_root_face: one would be seen if there were one.
    """
    square = [kind in ("square", "edge") for kind in kinds]
    fillet = "round" in kinds or "hidden" in kinds
    if all(square):  # a steep flank may hide as a square face does, and its fillet with it
        return ("I",) if "edge" not in kinds else ("I", "J") if "square" in kinds else ("I", "J", "U")
    if any(square):
        if fillet:
            return ("J",) if "square" in kinds else ("J", "U")
        return ("HY", "K") if root_face else ("HV",) if no_root_face else ("HV", "HY", "K")
    if fillet:
        return ("U",) if "bevel" not in kinds else ()
    return ("Y", "X") if root_face else ("V",) if no_root_face else ("V", "Y", "X")


def with_a_bevel(types: tuple[GrooveType, ...]) -> tuple[GrooveType, ...]:
    """Types that look as some others do if a plate that shows nothing below its upper surface has a bevel.

    Nobody can declare one: nothing of that bevel is measured.
    """
    may_be: Mapping[GrooveType, tuple[GrooveType, ...]] = {"I": ("HV", "HY", "K"), "HV": ("V",), "HY": ("Y", "X")}
    return tuple(dict.fromkeys(other for one in types for other in may_be.get(one, ()) if other not in types))


def _type(
    cloud: Cloud, kinds: tuple[Kind, Kind], measured: GrooveSizes, groove: Given
) -> tuple[GrooveType, tuple[GrooveType, ...], bool]:
    possible = possible_types(kinds, measured.root_face_seen, measured.root_face_excluded)
    hidden = with_a_bevel(possible) if measured.hides_bevels else ()
    words = {
        "edge": "nothing below its upper edge",
        "square": "a square face",
        "bevel": "a bevel",
        "round": "a flank with a fillet",
        "hidden": "a fillet below a flank that is not seen",
    }
    shown = f"the left plate shows {words[kinds[0]]}, the right one {words[kinds[1]]}"
    if not possible:
        raise InputError(cloud.source, f"{shown}: no groove of ISO 9692-1")
    if groove == "auto":
        return possible[0], (*possible[1:], *hidden), False
    if groove not in possible:
        root = ", a root face is seen" if measured.root_face_seen else ""
        expected = f"expected {' or '.join(possible)}"
        if hidden:
            expected += f"; {' or '.join(hidden)} needs a scan, or a further pass, that shows the faces of both plates"
        raise InputError(f"{cloud.source}: groove '{groove}'", f"{shown}{root}: {expected}")
    found = next(one for one in get_args(GrooveType) if one == groove)
    return found, tuple(one for one in possible if one != groove), True


def _view(cloud: Cloud, frame: Int, curve: Curve, s: Float, turn: Float) -> tuple[float, float]:
    """How far the range axis goes right a mm upwards, and as long a way square to the sheet: medians of the profiles.

    The first with its sign.
    """
    good = np.isfinite(s)
    right, up = axes(curve, s[good], turn[good])
    ey, ez = np.moveaxis(cloud.base_from_profiler[frame[good], :3, 1:3], -1, 0)
    beside, lean = (float(np.median((one * right).sum(axis=1) / (ez * up).sum(axis=1))) for one in (ey, ez))
    return lean, abs(beside)
