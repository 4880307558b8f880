"""Does a recording contradict itself? What `scan.read`, `scan.fuse` and `workbench look` ask."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from workbench.artefacts import LINEAR_AXIS, Check, Recording
from workbench.checks.conventions import AS_READ, Convention, known_conventions, mirrored_profiles
from workbench.checks.limits import Bound, check, least, most
from workbench.checks.motion import LEAST_STRETCH, Consistency, chord_obliquity_deg, consistency, held_poses, jump_mm
from workbench.checks.one_sensor import lateral_step
from workbench.checks.passes import Repeats, disagreement_mm, find_repeats
from workbench.checks.profiles import ALIKE_MM, IN_ORDER, Chain, chains, disorder, mirrored_frames
from workbench.checks.sensor import (
    PACKED,
    column_pitch_mm,
    is_packed,
    position_step_mm,
    quaternion_step,
    sensor_traces,
    shared_range,
    some,
    steadiest,
    step_mm,
    uneven_share,
    uneven_step_mm,
)
from workbench.checks.window import (
    as_delivered,
    dropped_columns,
    hidden_columns,
    some_frames,
)
from workbench.errors import InputError
from workbench.geometry.along import by_pass
from workbench.geometry.grids import blind_columns, extent, telling_returns
from workbench.geometry.moves import chords_mm, runs
from workbench.geometry.poses import interpolate_poses
from workbench.units import AnyArray, Float

STEP_SHARE = 0.25  # of the columns' distance: coarser steps move returns unevenly
NOT_JUDGED = Check(
    "recording_judged",
    None,
    None,
    True,
    "scan.fuse judges poses and profiles by each other",
    "not judged: a cloud holds neither poses nor profiles; its maker answers for these and for points removed or moved",
)
STANDING_MM = 1e-6  # of way from frame to frame
ROUNDED_DEG = 1e-6  # between orientations that are the same but for rounding
AXIS_MM = (2.0, 100_000.0)  # way of a linear axis: less is no scan
FEW_POSES = 12  # of a pass: with fewer the way between them is straight, whatever their noise
CHORD_DEG = 10.0  # by which chords of the edge's way may stand further off square
SMALL_DEG = 12.0  # obliquity of a scan as it is usually made
SCANNED_SO_DEG = 35.0  # scans stand off square by no more on purpose
OBLIQUE_DEG = 10.0  # from here on a small twist is looked into
SURE_TWIST_DEG = 1.2  # by more no plate happens to be twisted as a known mistake would show it
SWAYING_DEG_S, LEAST_S = 2.0, 1e-3  # of the turning's rate; with less 5 ms turn the section by 0.01 deg
LAST_DIGITS_DEG = 2e-4  # between quaternions of six digits that differ in the last; servos follow no better than 1e-3
TURNS_DEG = 10.0  # of the flange: with less, nothing shows the hand-eye pose
CONVENTION_TWIST_DEG = 0.25  # likewise, of a scan that is oblique
EXPLAINED = 0.15  # share of the twist that a better reading may leave
SEEN_TWIST_DEG = 0.06  # what the best reading may leave of a twist, with that share of it
SQUARER_DEG = 1.5  # by which a better reading may take the laser plane further from square
VARIES_DEG = 0.05  # by which the obliquity may vary more under a better reading
# From here on it is looked into why the obliquity varies: wavy edges vary by 1 to 6 under any reading, a path through
# points that were taught to 0.3 mm and 33 mm apart by up to 2.7.
VARIED_DEG = 3.0
STEADIER = 0.4  # share of that, and of its swing, which a better reading leaves: of sound scans chance leaves 0.64
CLOSELY = 100  # profiles of a pass that are looked at where it varies by more
# Where it varies by less, but more than LEAST_VARIES_DEG: the share of the swing that a reading may leave which also
# leaves STEADIER of variation and twist; of the variation that mirrored profiles may. Of 1,196 scans none does so.
LEAST_VARIES_DEG, LESS_SWING, CONSTANT = 0.5, 0.6, 0.2
COARSE_MM = 0.02  # steps of ranges that bend faces, where another check fails
COARSE, NARROWEST_MM = 25.0, 0.5  # a view narrower than usual that is scanned in steps of fewer columns is a true one
UNKNOWN = ": are orientations, axes or the hand-eye pose wrong?"
SWAPPED = "ranges are evenly spaced, as columns are, and lateral places are not: axes x and z swapped?"
UNMET = "no face was seen by two passes: the recording does not show how far apart these lie"
MOST_NAMED = 3  # copies of passes that a refusal names
SUSPICION = "; suspicion: "  # of a reading of poses, hand-eye pose or axes under which they agree
ELSE = "; else "  # between suspicions: a refusal names the first
UNITS_MM = {"metres": 1000.0, "inches": 25.4, "centimetres": 10.0, "micrometres": 0.001}


def judge_recording(recording: Recording, limits: Mapping[str, Bound] | None = None) -> tuple[Check, ...]:
    """Every check of a recording, passed or not; none raises. docs/checks.md tells each with its reason.

    Args:
        recording: as read: times, poses and grid are there and finite.
        limits: limits to set instead of those of the table; a value that only these allow is marked as loosened.

    Example:
        >>> failed = [check for check in judge_recording(recording) if not check.passed]  # doctest: +SKIP
    """
    return judged(recording, limits=limits)[0]


def judged(
    recording: Recording,
    flange_from_profiler: Float | None = None,
    limits: Mapping[str, Bound] | None = None,
    calibrating: bool = False,
) -> tuple[tuple[Check, ...], Recording]:
    """As `judge_recording`; and the recording less what only repeats itself: evidence counts once.

    Without frames and passes that are there already, and without columns in which the sensor measures nothing.

    Args:
        recording, limits: see there.
        calibrating: see `refuse_unsound`.
        flange_from_profiler: the hand-eye pose (4, 4) to judge with; None: the recording's own, if it has one.

    Example:
        >>> from pathlib import Path
        >>> from workbench.scan import read
        >>> recording = read(recording=Path("data/synthetic/milled_edge.h5"))
        >>> len(judged(recording)[1].time_s) == len(recording.time_s)
        True
    """
    hand_eye = recording.flange_from_profiler if flange_from_profiler is None else flange_from_profiler
    recording = as_delivered(recording)
    repeats = find_repeats(recording.z_mm, recording.pass_index)
    once = _without_copies(recording, repeats)
    checks = tuple(_checks(recording, repeats, once, hand_eye, limits or {}, calibrating))
    if not all(one.passed for one in checks) and (cause := returns_cause(recording.x_mm, recording.z_mm)):
        first, *others = checks
        # What another reading of the poses explains is no trace of the returns.
        left = (one.passed or SUSPICION in one.finding for one in others)
        pairs = zip(others, left, strict=True)
        checks = (first, *(one if sound else dataclasses.replace(one, finding=cause) for one, sound in pairs))
    return checks, once


def returns_cause(x_mm: AnyArray, z_mm: AnyArray) -> str:
    """What returns (N, M) themselves show to be wrong, and would make other checks fail; empty: nothing."""
    if shared := shared_range(z_mm):
        cause = f"{100 * shared[1]:.2g} % of the returns have the range {shared[0]:.6g} mm to the digit: "
        cause += "the sensor's code for no return, or ranges that saturate? "
        return cause + "make them NaN (`missing` in the mapping of an import)"
    if is_packed(x_mm, z_mm):
        return f"are {PACKED}?"
    if not check("uneven_share", _uneven(x_mm, z_mm)).passed:
        return SWAPPED
    step = step_mm(some(z_mm))
    return f"ranges are rounded to {step:.3g} mm: export them at full resolution" if step > COARSE_MM else ""


def refuse_failed(checks: Sequence[Check], where: str, parameter: str = "scan.fuse.limits") -> None:
    """Raise for the first check that did not pass, with its suspicion, value and limit.

    Raises:
        InputError: a check did not pass.
    """
    for one in checks:
        if not one.passed:
            limit = f"{one.limit[0]:g} to {one.limit[1]:g}" if isinstance(one.limit, tuple) else f"{one.limit:g}"
            likeliest, *others = one.finding.split(ELSE)
            more = f" (or {len(others)} others)" if others else ""
            raise InputError(
                where, f"{likeliest}{more} (check {one.name}: {one.value:.4g}, limit {limit}; {parameter} sets it)"
            )


def refuse_unsound(
    recording: Recording, limits: Mapping[str, Bound], parameter: str, calibrating: bool = False
) -> tuple[Check, ...]:
    """The checks of a recording, by its own hand-eye pose, all of them passed.

    Args:
        recording: as read.
        limits: limits to set by name.
        parameter: of the stage, that they come from.
        calibrating: its poses are postures that a calibration chose, without a sphere: no way along an edge.

    Raises:
        InputError: a check did not pass.

    Example:
        >>> from pathlib import Path
        >>> from workbench.scan import read
        >>> recording = read(recording=Path("data/synthetic/milled_edge.h5"))
        >>> refuse_unsound(recording, {"reach_mm": (500, 3000)}, "scan.fuse.limits")[0].name
        'view_width_mm'
    """
    checks = judged(recording, limits=limits, calibrating=calibrating)[0]
    refuse_failed(checks, recording.source, parameter)
    return checks


def _without_copies(recording: Recording, repeats: Repeats) -> Recording:
    drop = repeats.copies | np.isin(recording.pass_index, list(repeats.passes))
    if not drop.any():
        return recording
    keep = ~drop
    return dataclasses.replace(
        recording,
        time_s=recording.time_s[keep],
        x_mm=recording.x_mm[keep],
        z_mm=recording.z_mm[keep],
        pass_index=recording.pass_index[keep],
        intensity=None if recording.intensity is None else recording.intensity[keep],
    )


def consistent_conventions(recording: Recording) -> tuple[tuple[Convention, Consistency], ...]:
    """The readings of poses and hand-eye under which neighbouring profiles agree, the likeliest first.

    The recording as it is read is among those tried, as `AS_READ`. A reading counts if the laser plane is then within
    12 deg of square to the edge, and the orientations explain how the section turns, but for 1.2 deg or 0.15 of
    what they leave as read. A single straight pass in one orientation can agree with several.

    Args:
        recording: as read.

    Example:
        >>> [reading.name for reading, _ in consistent_conventions(recording)]  # doctest: +SKIP
        ['quaternions are stored x y z w, not w x y z']
    """
    if recording.flange_from_profiler is None:
        return ()
    found = chains(recording.x_mm, recording.z_mm, recording.pass_index)
    return _consistent(recording, found, recording.flange_from_profiler, SMALL_DEG)


def _consistent(
    recording: Recording,
    found: Mapping[int, Chain],
    hand_eye: Float,
    most_deg: float,
    turning: bool = False,
    twist_deg: float | None = None,
) -> tuple[tuple[Convention, Consistency], ...]:
    as_read = consistency(found, _poses(recording, found, hand_eye, AS_READ))
    allowed = max(SURE_TWIST_DEG, EXPLAINED * as_read.twist_deg) if twist_deg is None else twist_deg
    every = *mirrored_profiles(), *known_conventions()
    known = [one for one in every if not turning or _turning([one.name])]
    tried = _tried(recording, found, hand_eye, known, most_deg)
    fits = [(one, c) for one, c in tried if c.obliquity_deg <= most_deg and c.twist_deg <= allowed]
    fits.sort(key=lambda fit: _unlikely(fit[1], known.index(fit[0])))
    if as_read.obliquity_deg <= most_deg:
        fits.insert(0, (AS_READ, as_read))
    return tuple(fits)


def _tried(
    recording: Recording, found: Mapping[int, Chain], hand_eye: Float, known: Sequence[Convention], most_deg: float
) -> Iterator[tuple[Convention, Consistency]]:
    """How poses and profiles agree under each reading that may bring the laser plane within `most_deg` of square."""
    for one in known:
        poses = _poses(recording, found, hand_eye, one)
        if chord_obliquity_deg(found, poses) < most_deg + CHORD_DEG:
            yield one, consistency(found, poses)


def _unlikely(there: Consistency, rank: int) -> float:
    """Twice the negative log of a reading's probability: three standard deviations are what a sound scan may have.

    The more common a mistake, the likelier; probabilities fall with the rank (Zipf).
    """
    shares = there.obliquity_deg / most("obliquity_deg"), there.twist_deg / most("twist_deg")
    return float(sum((3.0 * share) ** 2 for share in shares) + 2.0 * np.log(1.0 + rank))


def _poses(
    recording: Recording,
    found: Mapping[int, Chain],
    hand_eye: Float,
    reading: Convention,
) -> dict[int, Float]:
    """base_from_profiler (k, 4, 4) at the profiles of each chain, under a reading."""
    quaternion, position, hand_eye = reading.read(
        recording.robot_quaternion_wxyz, recording.robot_position_mm, hand_eye
    )
    made = {}
    for number, chain in found.items():
        at = recording.robot_pass == number
        time = recording.robot_time_s[at]
        seen = recording.time_s[chain.frames]
        if reading.frames_reversed:
            seen = recording.time_s[recording.pass_index == number][[0, -1]].sum() - seen
        frames = np.clip(seen, time[0], time[-1])
        made[number] = interpolate_poses(frames, time, position[at], quaternion[at]) @ hand_eye
    return made


def _checks(
    recording: Recording,
    repeats: Repeats,
    once: Recording,
    hand_eye: Float | None,
    given: Mapping[str, Bound],
    calibrating: bool,
) -> Iterator[Check]:
    calibration = calibrating or recording.sphere_diameter_mm is not None
    change, frame = lateral_step(recording.x_mm, recording.z_mm)
    how = "x is mirrored, or columns are reversed," if change < -1.0 else f"x is scaled by {100.0 * change:+.1f} %"
    finding = f"{how} from frame {frame} on: is it of another sensor?" if change else ""
    yield check("one_sensor", abs(change), finding, given=given)
    varies, name = steadiest(recording.x_mm, recording.z_mm)
    finding = (
        f"the {name} is the same in every frame: were they zeroed, levelled or centred one by one? switch that off"
    )
    yield check("frames_vary", varies, finding, given=given)
    yield from _profile_checks(recording, given)
    yield from _pose_checks(recording, given, calibration)
    yield from _copy_checks(recording, repeats, given, calibration)
    yield from _sensor_checks(recording, given)
    if hand_eye is not None:
        yield _hand_eye_check(hand_eye, given)
        if not calibration and recording.clock != "own":
            yield from _motion_checks(once, hand_eye, given)
    if unsure := recording.not_confirmed:
        about = "; ".join(line.partition(":")[0] for line in unsure)
        finding = (
            f"its import took {len(unsure)} values for granted ({about}): correct them in the mapping, take their "
            "lines out of its list 'uncertain' and import again"
        )
        yield check("not_confirmed", len(unsure), finding, given=given)


def _profile_checks(recording: Recording, given: Mapping[str, Bound]) -> Iterator[Check]:
    shown, far = extent(recording.x_mm, recording.z_mm)
    width = max(shown, (recording.z_mm.shape[1] - 1) * _pitch_mm(recording))
    finding = f"the profiles are {width:.4g} mm wide{_unit(width, (10.0, 500.0))}"
    narrowest = NARROWEST_MM if _columns_a_frame(recording) < COARSE else least("view_width_mm")
    yield check("view_width_mm", width, finding, given=given, default=(narrowest, most("view_width_mm")))
    yield check("uneven_share", _uneven(recording.x_mm, recording.z_mm), SWAPPED, given=given)
    yield check("range_mm", far, f"a return is {far:.4g} mm away{_unit(far, (20.0, 2000.0))}", given=given)


def _uneven(x_mm: AnyArray, z_mm: AnyArray) -> float | None:
    """Share of the columns that are unevenly spaced, where ranges are even; None: they are not, as they have noise."""
    return uneven_share(x_mm) if uneven_share(z_mm) < most("uneven_share") else None


def _pitch_mm(recording: Recording) -> float:
    """How far columns lie apart that return side by side: any x may be written for lost returns."""
    return column_pitch_mm(np.where(np.isfinite(some(recording.z_mm)), some(recording.x_mm), np.nan))


def _columns_a_frame(recording: Recording) -> float:
    """How many columns' widths the flange moves from frame to frame: of profiles in inches 25 times as many."""
    position, pitch = recording.robot_position_mm, _pitch_mm(recording)
    way = sum(float(chords_mm(position[poses]).sum()) for poses in by_pass(recording.robot_pass))
    return way / max(len(recording.time_s) - 1, 1) / pitch if pitch > 0 else float("inf")


def _pose_checks(recording: Recording, given: Mapping[str, Bound], calibration: bool) -> Iterator[Check]:
    position = recording.robot_position_mm
    axis = recording.part.robot == LINEAR_AXIS  # it has no base that it reaches from, but a way
    reach = float(np.linalg.norm(position - position[0] if axis else position, axis=1).max())
    usual = (20.0, 10_000.0) if axis else (400.0, 10_000.0)
    of = (
        "the axis's place is at most {} from its first one"
        if axis
        else "the flange is at most {} from the robot's base"
    )
    finding = of.format(f"{reach:.4g} mm") + _unit(reach, usual)
    yield check("reach_mm", reach, finding, given=given, default=AXIS_MM if axis else None)
    step = quaternion_step(recording.robot_quaternion_wxyz)
    finding = f"orientations are rounded to {step:g} in each number of their quaternions: were digits lost in writing?"
    yield check("orientation_step_deg", math.degrees(step), finding, given=given)
    yield _position_step(recording)
    if calibration:
        return
    jump = jump_mm(recording.robot_time_s, position, recording.robot_pass)
    finding = (
        f"a recorded position jumps by {jump:.2g} mm in an even motion: an encoder that slipped, a base set anew, "
        "poses of two moves in one pass?"
    )
    yield check("position_jump_mm", jump, finding, given=given)
    standing, held = [], [0]
    for number in np.unique(recording.pass_index):
        at, time = recording.robot_pass == number, recording.time_s[recording.pass_index == number]
        place = np.stack([np.interp(time, recording.robot_time_s[at], column) for column in position[at].T], axis=1)
        moved = chords_mm(place)
        standing.append(float((moved < STANDING_MM).mean()) if len(moved) else 0.0)
        took, turn = np.maximum(np.diff(recording.robot_time_s[at]), LEAST_S), recording.robot_quaternion_wxyz[at]
        angle = _angles_deg(turn[1:], turn[:-1])
        ways = chords_mm(position[at]), np.where(angle > ROUNDED_DEG, angle, 0.0)
        held += [held_poses(way / took) for way in ways]
    finding = (
        f"{max(held)} poses in a row have one position, or one orientation, and the next one jumps: a frozen stream?"
    )
    yield check("held_poses", max(held), finding if max(held) else "", given=given)
    share = max(standing)
    yield check(
        "standing_share",
        share,
        f"the recorded pose stands still during {100 * share:.0f} % of the frames: a frozen pose stream, or "
        "rounded positions?",
        given=given,
    )


def _position_step(recording: Recording) -> Check:
    """Whether the recorded positions are whole numbers; reported, not judged: they may have been commanded so."""
    step = 0.0 if recording.part.robot == LINEAR_AXIS else position_step_mm(recording.robot_position_mm)
    finding = "positions are no multiples of a tenth of a millimetre"
    if step:
        finding = f"all recorded positions are multiples of {step:g} mm: were they rounded, or commanded instead of "
        finding += "measured? what they are off moves the edge and would not show"
    return Check("position_step_mm", step, None, True, "a robot's own positions have more digits", finding)


def _copy_checks(
    recording: Recording, repeats: Repeats, given: Mapping[str, Bound], calibration: bool
) -> Iterator[Check]:
    passes = repeats.passes
    count = len(np.unique(recording.pass_index))
    copies = ", ".join(f"{copy} of {original}" for copy, original in list(passes.items())[:MOST_NAMED])
    again = np.isin(recording.pass_index, list(passes))
    copied = repeats.copies | again if calibration else repeats.copies & ~again
    findings = [f"{100 * copied.mean():.1f} % of the frames are an earlier frame again"] if copied.any() else []
    if passes:
        findings.append(f"{len(passes)} of {count} passes are copies of others: {copies}")
    reason = "of frames that repeat others the first counts"
    yield Check("repeated_share", float(copied.mean()), None, True, reason, "; ".join(findings))
    run = max((last - first + 1 for first, last in runs(copied)), default=0)
    waits = f"one profile comes {run + 1} times in a row: a frozen or repeating scanner, a driver that waits? All that "
    waits += "comes after may be as many frames late"
    yield check("repeated_run", float(run), waits, given=given)


def _sensor_checks(recording: Recording, given: Mapping[str, Bound]) -> Iterator[Check]:
    traces = sensor_traces(recording.x_mm, recording.z_mm, recording.pass_index)
    step = step_mm(some(recording.z_mm))
    finding = f"ranges are rounded to {step:.3g} mm: export them at full resolution"
    yield check("range_step_mm", step, finding, given=given)
    step, pitch = uneven_step_mm(recording.x_mm, recording.z_mm), _pitch_mm(recording)
    finding = f"lateral places are rounded to {step:.3g} mm: export them at full resolution"
    yield check("lateral_step_mm", step, finding, given=given, default=max(most("lateral_step_mm"), STEP_SHARE * pitch))
    finding = (
        f"the sensor has averaged its profiles over {traces.mean_columns:.2g} columns: switch its smoothing filter off"
    )
    mean = None if recording.sphere_diameter_mm else traces.mean_columns  # no corner or narrow face, for it to round
    yield check("mean_columns", mean, finding, given=given)
    finding = (
        f"{100 * traces.held_end_share:.0f} % of the short gaps in faces hold the value beside them, or continue its "
        "slope: a median filter, or lost returns filled? "
    )
    yield check("held_end_share", traces.held_end_share, finding + "switch the sensor's filters off", given=given)
    yield from _sensor_notes(recording, traces.mean_frames)


def _sensor_notes(recording: Recording, mean_frames: float) -> Iterator[Check]:
    """What may hide the end of a face, reported and not judged."""
    seen, in_u = telling_returns(recording.z_mm), "in the uncertainty of the face's end"
    dropped, hidden = dropped_columns(some_frames(recording)), hidden_columns(seen)
    blind = blind_columns(seen)
    rows = (
        (
            "mean_frames",
            mean_frames,
            in_u,
            "no mean over frames is seen",
            f"the sensor has averaged over {mean_frames:.0f} frames, which blurs what changes along the edge",
        ),
        (
            "dropped_columns",
            dropped,
            in_u,
            "single losses leave gaps of one column, or too few were seen",
            f"beside every lost return {dropped} more columns are lost on both sides: a face may go on by as much",
        ),
        (
            "hidden_columns",
            hidden,
            in_u,
            "no end stays in one column, or no others are blind",
            f"returns end in one column, and elsewhere {hidden} columns are blind side by side: the face that ends "
            "there may go on by as much",
        ),
        (
            "blind_columns",
            blind,
            "a face that ends beside them is known to their width",
            "every column between others measures",
            f"{blind} columns between others that measure never return: is the scanner's window dirty?",
        ),
    )
    for name, value, reason, nothing, finding in rows:
        yield Check(name, value, None, True, reason, finding if value else nothing)


def _hand_eye_check(hand_eye: Float, given: Mapping[str, Bound]) -> Check:
    distance = float(np.linalg.norm(hand_eye[:3, 3]))
    finding = f"the hand-eye pose has the profiler {distance:.4g} mm from the flange{_unit(distance, (20.0, 1000.0))}"
    return check("hand_eye_mm", distance if distance > 0 else None, finding, given=given)


def _motion_checks(recording: Recording, hand_eye: Float, given: Mapping[str, Bound]) -> Iterator[Check]:
    found = chains(recording.x_mm, recording.z_mm, recording.pass_index)
    now = consistency(found, _poses(recording, found, hand_eye, AS_READ))
    if now.varies_deg > VARIED_DEG:  # the way about a small ring, over few profiles, is no smooth one
        found = chains(recording.x_mm, recording.z_mm, recording.pass_index, CLOSELY)
        now = consistency(found, _poses(recording, found, hand_eye, AS_READ))
    suspected = steadier = _steadier(recording, found, hand_eye, now)
    unwaved = max(now.unsteady_deg - now.waved_deg, 0.0)
    plane, about = "the laser plane is {:.0f} deg off square", "the section would rotate by {:.2f} deg about the edge"
    if most("obliquity_deg") < now.obliquity_deg < SCANNED_SO_DEG:
        plane += " (if it was scanned so, turn it nearer to square)"
    steady = VARIED_DEG if now.varies_deg > VARIED_DEG else LEAST_VARIES_DEG
    varied = "the angle between laser plane and edge would vary by {:.1f} deg to each side"
    judged = [
        check(name, value, template.format(value), given=given, default=bound)
        for name, value, template, bound in (
            ("obliquity_deg", now.obliquity_deg, plane, None),
            ("obliquity_varies_deg", now.varies_deg, varied, steady if steadier else None),
            ("unsteady_twist_deg", unwaved, f"{about} and back, unlike any plate", None),
            ("twist_deg", now.twist_deg, f"{about}, which the orientations do not explain", None),
        )
    ]
    mirrored = [frame for chain in found.values() for frame in mirrored_frames(recording.x_mm, recording.z_mm, chain)]
    finding = f"profiles are mirrored, or their columns reversed, from frame {mirrored[0]} on" if mirrored else ""
    yield check("mirrored_frames", len(mirrored), finding, given=given)
    yield from _order_checks(recording, found, given)
    finding = f"the recorded poses jump by {now.pose_noise_mm:.2f} mm across the edge: noisy, or rounded?"
    yield check("pose_noise_mm", now.pose_noise_mm, finding, given=given)
    sure = SURE_TWIST_DEG if now.obliquity_deg < OBLIQUE_DEG else CONVENTION_TWIST_DEG
    unexplained, only = now.twist_deg > sure + now.waved_deg, all(one.passed for one in judged)
    if now.twist_deg > CONVENTION_TWIST_DEG + now.waved_deg or not only:
        readings = _consistent(recording, found, hand_eye, most("obliquity_deg"), turning=only)
        others = [(one.name, c) for one, c in readings if one is not AS_READ]
        turns = now.varies_deg > LEAST_VARIES_DEG
        agree = [
            name
            for name, c in others
            if turns and c.twist_deg < STEADIER * now.twist_deg and _turns_less(c, now, STEADIER, LESS_SWING)
        ]
        explained = [name for name, c in others if _explains(c, now)] if unexplained or not only else []
        suspected = list(dict.fromkeys([*steadier, *agree, *explained]))
        unexplained |= bool(agree)
    if unexplained and _turning(suspected):
        judged[3] = check("twist_deg", now.twist_deg, judged[3].finding, given=given, default=CONVENTION_TWIST_DEG)
    hint = f"{SUSPICION}{ELSE.join(suspected)}" if suspected else UNKNOWN
    yield from (one if one.passed else dataclasses.replace(one, finding=one.finding + hint) for one in judged)
    yield _unseen(recording, found, now)
    yield from _pass_check(recording, found, hand_eye, given)
    together = min((float(one.good.mean()) for one in found.values() if len(one.good) >= LEAST_STRETCH), default=None)
    finding = f"{100 * (together or 0.0):.0f} % of neighbouring profiles lie on each other: frames out of order, "
    finding += "profiles of several parts, or a profiler's axes swapped?"
    yield check("together_share", together, finding, given=given)


def _unseen(recording: Recording, found: Mapping[int, Chain], now: Consistency) -> Check:
    """How much the flange turns within a pass, and what does not show where that is little; reported, not judged.

    What it turns with the edge, as along an arc, shows nothing: only what the section turns in the view, or the laser
    plane against the edge, does.
    """
    # nine tenths of it: a single pair of profiles that goes together wrongly is no turn
    ranges = [float(np.degrees(np.ptp(np.percentile(chain.track[1], [5, 95])))) for chain in found.values()]
    against = max(ranges, default=0.0)
    against += 2.0 * now.varies_deg if np.isfinite(now.varies_deg) else 0.0
    rotation_deg = max(_rotation_deg(recording.robot_quaternion_wxyz[poses]) for poses in by_pass(recording.robot_pass))
    finding = f"the flange rotates by {rotation_deg:.1f} deg within a pass: "
    finding += "a scale of its travel and frames in reverse order would not show"
    if min(rotation_deg, against) < TURNS_DEG:
        finding += (
            ", nor a hand-eye pose that is displaced, or rotated by less than the limit of obliquity_deg, mirrored or "
            "swapped axes of the robot or of the profiler, orientations with a constant error"
        )
    if not _sways(recording):
        finding += "; it rotates evenly, which does not show whether the clocks agree"
    fewest = int(np.unique(recording.robot_pass, return_counts=True)[1].min())
    if fewest < FEW_POSES:
        finding += f"; a pass has {fewest} poses only: noise in them would not show"
    if rotation_deg == 0.0:
        finding += (
            "; the orientation is the same to the last digit: if it was not measured, its rotation is in no value"
        )
    reason = f"a hand-eye error is visible where the flange rotates against the edge by {TURNS_DEG:g} deg and more"
    return Check("flange_turn_deg", rotation_deg, None, True, reason, finding)


def _sways(recording: Recording) -> bool:
    """Whether the flange turns unevenly enough, in some pass, for a clock offset to turn the section with it."""
    for at in by_pass(recording.robot_pass):
        step_s = np.maximum(np.diff(recording.robot_time_s[at]), LEAST_S)
        quaternion = recording.robot_quaternion_wxyz[at]
        if len(step_s) and np.std(_angles_deg(quaternion[1:], quaternion[:-1]) / step_s) > SWAYING_DEG_S:
            return True
    return False


def _rotation_deg(quaternion: Float) -> float:
    """Greatest angle to the first of unit quaternions (k, 4); 0 where all are that one but for their last digits."""
    rotation = float(_angles_deg(quaternion, quaternion[:1]).max())
    return rotation if rotation > LAST_DIGITS_DEG else 0.0


def _angles_deg(one: Float, other: Float) -> Float:
    """Angles (k,) between unit quaternions (k, 4) or (1, 4)."""
    apart = np.minimum(np.linalg.norm(one - other, axis=1), np.linalg.norm(one + other, axis=1))
    return np.asarray(np.degrees(4.0 * np.arcsin(0.5 * apart)))


def _explains(there: Consistency, now: Consistency) -> bool:
    """Whether a reading makes better what is bad as read.

    A small twist may be the plate's own: it counts against what was read only if the reading that explains it also
    takes the laser plane nearer to square, which scans mostly are.
    """
    left = EXPLAINED * now.twist_deg + SEEN_TWIST_DEG
    if now.obliquity_deg > most("obliquity_deg"):
        better, left = there.obliquity_deg < 0.5 * now.obliquity_deg, max(left, CONVENTION_TWIST_DEG)
    elif now.twist_deg < SURE_TWIST_DEG:
        better = there.obliquity_deg < 0.5 * now.obliquity_deg
    else:  # orientations that turn about another axis take the turn from about the edge to across it
        better = there.varies_deg < now.varies_deg + VARIES_DEG
        better &= there.obliquity_deg < now.obliquity_deg + SQUARER_DEG
    return better and there.twist_deg < left


def _turns_less(there: Consistency, now: Consistency, varies: float, swing: float) -> bool:
    """Whether a reading leaves less than these shares of what the laser plane turns against the edge."""
    return (
        there.varies_deg < varies * now.varies_deg
        and there.swing_deg < swing * now.swing_deg
        and there.obliquity_deg < now.obliquity_deg + SQUARER_DEG
    )


def _order_checks(recording: Recording, found: Mapping[int, Chain], given: Mapping[str, Bound]) -> Iterator[Check]:
    """Whether the section jumps about in the view from frame to frame, as it does where frames are out of order."""
    here = disorder(recording.x_mm, recording.z_mm, recording.pass_index, found)
    finding = f"the section jumps by {here.jumps_mm:.2f} mm in the view from frame to frame: frames out of order, or a "
    finding += "part that vibrates?"
    known = np.isfinite(here.jumps_mm)
    yield check("wiggle_mm", here.jumps_mm if known else None, finding, given=given)
    finding = "neighbouring frames are similar, which shows their order"
    if not known:
        finding = "too few profiles agree, which does not show their order"
    elif here.share > IN_ORDER and here.jumps_mm < ALIKE_MM:
        finding = "the part hardly moves in the view, which does not show the order of its frames"
    elif here.share > IN_ORDER:
        finding = f"the section's place in the view scatters by {here.jumps_mm:.2f} mm between neighbouring frames, "
        finding += f"{100 * here.share:.0f} % of its scatter over the whole pass: vibration, noise, or frames out of "
        finding += "order; the recording does not show which"
    yield Check(
        "order_share",
        here.share if known else None,
        None,
        True,
        "where they scatter as all do, no order can be distinguished",
        finding,
    )


def _steadier(recording: Recording, found: Mapping[int, Chain], hand_eye: Float, now: Consistency) -> list[str]:
    """Readings under which the laser plane keeps its angle to the edge, where as read that angle varies.

    An edge that waves turns against the laser plane by as much under any reading; along a curve, axes that are mirrored
    or swapped turn the plane one way and the edge the other.
    """
    readings: Iterable[tuple[Convention, Consistency]] = ()
    share, most_deg = STEADIER, most("obliquity_deg")
    if now.varies_deg > VARIED_DEG:
        readings = _consistent(recording, found, hand_eye, most_deg, twist_deg=most("twist_deg"))
    elif now.varies_deg > LEAST_VARIES_DEG:
        share, readings = CONSTANT, _tried(recording, found, hand_eye, mirrored_profiles(), most_deg)
    return [one.name for one, there in readings if one is not AS_READ and _turns_less(there, now, share, STEADIER)]


def _turning(names: Sequence[str]) -> bool:
    """Whether a reading of orientations is among those that agree: of axes, some always do."""
    return any(not name.startswith(("the robot's axes", "the profiler's axes")) for name in names)


def _pass_check(
    recording: Recording, found: Mapping[int, Chain], hand_eye: Float, given: Mapping[str, Bound]
) -> Iterator[Check]:
    if len(found) < 2:
        return
    poses = np.zeros((len(recording.time_s), 4, 4))
    frames = {number: chain.frames for number, chain in found.items()}
    for number, made in _poses(recording, found, hand_eye, AS_READ).items():
        poses[frames[number]] = made
    apart = disagreement_mm(recording.x_mm, recording.z_mm, frames, poses)
    finding = f"two passes see one face {apart:.2f} mm apart: has the part been moved, "
    finding += "is the hand-eye pose wrong, or are frames of a pass in reverse order?"
    yield check("pass_disagreement_mm", apart, finding if np.isfinite(apart) else UNMET, given=given)


def _unit(length_mm: float, usual_mm: tuple[float, float]) -> str:
    """': metres read as mm?' for the units in which the length would be a usual one."""
    likely = [name for name, mm in UNITS_MM.items() if usual_mm[0] <= length_mm * mm <= usual_mm[1]]
    return f": {' or '.join(likely)} read as mm?" if likely else ": is the unit wrong?"
