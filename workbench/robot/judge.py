"""A program judged as its controller will run it: driven through the cell without a gap, from the file's own words.

    read back -> way (segments, corners rounded) -> places -> each stretch between two places is proven or halved

A stretch is proven where limits, wrist and every pair of bodies keep their margins for all that lies between.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from workbench.artefacts import Judgement, Moves, Nearest, ProgramMoves, Violation
from workbench.geometry.moves import arc_lengths_mm, chords_mm, runs
from workbench.geometry.poses import inverse
from workbench.robot.bounds import SAFE_MM, CollisionScreen
from workbench.robot.cell_model import Cell, dexterity, turntable_margin
from workbench.robot.collision import left_out, sliding, standing_poses, turntable_pose
from workbench.robot.controller import frame_faults
from workbench.robot.kinematics import forward_kinematics, motions
from workbench.robot.process import disorders, placed
from workbench.robot.surface import Driven, Planned, deviations, lateral_mm
from workbench.robot.way import (
    CORNER,
    JOINTS,
    Places,
    Way,
    WayError,
    between,
    first_look,
    joined,
    timed_faults,
    way_of,
    worst,
)
from workbench.units import Bool, Float, Int

ROUNDS = 16  # of halving: 5 mm to 0.1 um, beyond any margin
LEAST_REACH = 1e-5  # rad, and the same share of a whole: what is still open then is reported as a violation
MOST_REACH = 0.25  # rad, of all joints together in a stretch that can be proven at once
MOST_VIOLATIONS = 40
TIGHT = 0.1 * np.pi / 180  # rad: how near the stated distance from limits is to the true one
ON_BOUNDARY = 0.02 * np.pi / 180  # rad: what the digits of a program may turn a joint by
Configuration = Callable[[Float, Cell], tuple[int, ...] | None]
ArcLookup = Callable[[int, float], float]


def judge(
    cell: Cell, program: ProgramMoves, planned: Planned | None = None, configuration: Configuration | None = None
) -> Judgement:
    """Drive a program through its cell.

    Between targets: collision, joint limits, the wrist's singularity and the condition of the Jacobian, each with the
    cell's margins and the stated uncertainty of tool and part; speed and acceleration of the joints; at each target
    the axis configuration that the program says; and how far the tool leaves the planned surface.

    Args:
        cell: robot, tool, bodies, margins.
        program: as read back from its file.
        planned: the path that it is to follow; None: its deviation is not judged, and the judgement says so.
        configuration: of a posture, as the program's dialect counts it.
    """
    program = placed(program, cell)
    try:
        way, tools = _way(cell, program)
    except WayError as error:
        return _undriven(program, Violation(error.line, 0.0, "way", str(error)))
    foreign, unknown = frame_faults(cell, program, tools)
    if foreign is not None:
        return _undriven(program, foreign)
    cell = dataclasses.replace(cell, unchecked=(*cell.unchecked, *unknown))
    way, places = first_look(cell, way)
    screen = CollisionScreen(cell)
    found = _proven(screen, way, places, _Findings())
    return _judgement(screen, program, way, found, planned, configuration)


def follows(cell: Cell, program: ProgramMoves) -> tuple[str, tuple[str, str] | None] | None:
    """What stands between joint moves: kind of the first fault, and the pair of bodies of a collision; None: nothing.

    The cutter may touch what `may_touch` says, as on a path.
    """
    try:
        way, _ = _way(cell, program)
    except WayError:  # one posture alone
        return None
    screen = CollisionScreen(cell)
    found = _proven(screen, *first_look(cell, way), _Findings())
    if not found.faults:
        return None
    kind = found.faults[0][2]
    return kind, _names(screen, _least(found)[1]) if kind == "collision" else None


class JudgedCell(Cell):
    """A cell through which programs are driven."""

    __slots__ = ()

    def judge(
        self,
        program: ProgramMoves,
        moves: Moves,
        tolerance_mm: float,
        configuration: Callable[..., tuple[int, ...] | None],
    ) -> Judgement:
        """`judge`, with the path of the moves to follow."""
        postures = moves.postures
        assert postures is not None
        planned = Planned(moves.toolpath, postures.planned_turntable, tolerance_mm, postures.flange_from_point)
        return judge(self, program, planned, configuration)


def _way(cell: Cell, program: ProgramMoves) -> tuple[Way, dict[str, Float]]:
    """The way, and the tools by name."""
    tools, frames = _frames(cell, program)
    return way_of(cell, program, tools, frames), tools


def _frames(cell: Cell, program: ProgramMoves) -> tuple[dict[str, Float], dict[str, Float]]:
    """Tools and work objects by name: the program's, and the controller's that the cell knows."""
    tools = {name: tool.flange_from_tool for name, tool in program.tools.items()}
    tools = {name: cell.controller_tools.get(name) if pose is None else pose for name, pose in tools.items()}
    frames = {
        name: cell.controller_frames.get(name) if pose is None else pose for name, pose in program.work_objects.items()
    }
    for move in program.moves:
        for name, known, what in ((move.tool, tools, "tool"), (move.work_object, frames, "work object")):
            if known.get(name) is None and not (what == "work object" and move.pose is None):
                raise WayError(move.line, f"the {what} '{name}' is neither in the program nor in the cell file")
    return (
        {name: pose for name, pose in tools.items() if pose is not None},
        {name: pose for name, pose in frames.items() if pose is not None},
    )


@dataclass
class _Findings:
    """What is gathered while stretches are proven."""

    places: list[Places] = field(default_factory=list)
    clearance: list[Float] = field(default_factory=list)
    pair: list[Int] = field(default_factory=list)
    margin: list[Float] = field(default_factory=list)
    wrist: list[Float] = field(default_factory=list)
    condition: list[Float] = field(default_factory=list)
    proven_mm: float = np.inf  # least distance of all, with what the bodies move between places taken off
    proven_pair: int = -1
    least_margin: float = np.inf  # rad, of joints and turntable from their limits where they were looked at
    proven_margin: float = np.inf  # rad, with what lies between taken off
    proven_wrist: float = np.inf  # rad, likewise of axis 6 from axis 4
    faults: list[tuple[int, float, str, str]] = field(default_factory=list)  # segment, share, kind, finding


def _proven(pairs: CollisionScreen, way: Way, places: Places, found: _Findings) -> _Findings:
    """Halve every stretch until it is proven, or found to be at fault."""
    found.places.append(places)
    before, after = places.at(np.arange(len(places) - 1)), places.at(np.arange(1, len(places)))
    for turn in range(ROUNDS):
        middle = between(pairs.cell, way, before, after)
        last = turn == ROUNDS - 1
        open_ = _stretches(way, pairs, before, middle, after, found, last=last)
        found.places.append(middle)
        if not open_.any() or last:
            break
        some = middle.at(open_)
        before, after = joined([before.at(open_), some]), joined([some, after.at(open_)])
    return found


def _on_the_path(program: ProgramMoves, way: Way, places: Places, driven: tuple[int, int] | None) -> Bool:
    """Which segments (g,) belong to the path: of joint moves those of its layers and travels, where it is driven."""
    in_space = way.kind != JOINTS
    if driven is None:
        return np.asarray(in_space)
    said = np.array([move.layer is not None for move in program.moves])[way.move]
    ends = np.searchsorted(places.segment, np.arange(len(way.kind)), side="right") - 1
    begins = np.append(0, ends[:-1])
    return np.asarray(in_space | (said & (begins >= driven[0]) & (ends <= driven[1])))


def _off_the_path(cell: Cell, way: Way, places: Places, on_path: Bool) -> list[tuple[int, float, str, str]]:
    """Collisions off the path with nothing allowed to touch the plate: the cutter mills on its path alone."""
    strict, found = cell.without_contact, _Findings()
    joint_moves = ~on_path[places.segment]
    if strict.may_touch == cell.may_touch or not joint_moves.any():
        return []
    screen = CollisionScreen(strict)
    for first, last in runs(joint_moves):
        _proven(screen, way, places.at(np.arange(max(first - 1, 0), last + 1)), found)
    return [fault for fault in found.faults if fault[2] == "collision"]


def _stretches(
    way: Way, pairs: CollisionScreen, before: Places, middle: Places, after: Places, found: _Findings, *, last: bool
) -> Bool:
    """Which stretches (n,) stay open; faults are noted."""
    cell = pairs.cell
    open_, closed = np.zeros(len(middle), bool), np.zeros(len(middle), bool)

    def fault(which: Bool, kind: str, finding: Callable[[int], str]) -> None:
        for i in np.flatnonzero(which & ~closed).tolist():
            found.faults.append((int(middle.segment[i]), float(middle.share[i]), kind, finding(i)))
        closed[which] = True

    three = np.stack([np.column_stack([part.joints, part.turntable]) for part in (before, middle, after)])
    lost = np.asarray(~np.isfinite(three).all(axis=(0, 2)))
    fault(lost, "unreachable", lambda i: "no posture of the robot reaches it")
    three[:, lost] = 0.0
    reach = np.maximum(np.abs(three[0] - three[1]), np.abs(three[2] - three[1]))
    reach += np.abs(three[1] - (three[0] + three[2]) / 2)
    tiny = (reach.sum(axis=1) < LEAST_REACH) | last
    wide = reach.sum(axis=1) > MOST_REACH
    fault(
        wide
        & (np.linalg.norm(after.tool[:, :3, 3] - before.tool[:, :3, 3], axis=1) < 0.01)
        & (not sliding(cell) or three[0, :, 6] == three[2, :, 6])
        & (way.kind[middle.segment] != JOINTS),
        "singular",
        lambda i: (
            f"joint {int(reach[i].argmax()) + 1} turns by {np.degrees(reach[i].max()):.0f} deg while the tool stands"
        ),
    )
    open_ |= wide
    tip = forward_kinematics(cell.chain, three[1][:, :6]) @ cell.flange_from_cutter
    wrist, condition, asked = dexterity(cell.chain, three[1][:, :6], tip[:, :3, 3], cell.margins.twist)
    asked[way.kind[middle.segment] == JOINTS] = 0.0
    room = _room(cell, three[1], asked)
    margin, which = room.min(axis=1), room.argmin(axis=1)
    sure, sure_wrist = (room - reach).min(axis=1), wrist - reach[:, 4]
    found.margin.append(np.where(lost, np.nan, margin))
    in_space = way.kind[middle.segment] != JOINTS  # a joint move may pass through singular postures
    found.wrist.append(np.where(lost | ~in_space, np.nan, wrist))
    found.condition.append(np.where(lost | ~in_space, np.nan, condition))
    need = cell.margins.limit
    beyond = margin < need - 1e-9
    fault(beyond, "limit", lambda i: _limit_finding(cell, three[1][i], asked[i], int(which[i])))
    found.least_margin = float(np.nanmin(np.append(margin[~lost], found.least_margin)))
    open_ |= sure < max(need - 1e-9, found.least_margin - TIGHT)
    fault(
        in_space & (wrist < cell.margins.wrist),
        "singular",
        lambda i: (
            f"axis 6 stands {np.degrees(wrist[i]):.2f} deg from axis 4, expected at least "
            f"{np.degrees(cell.margins.wrist):g} deg"
        ),
    )
    open_ |= in_space & (sure_wrist < cell.margins.wrist)
    fault(
        in_space & (condition > cell.margins.condition),
        "singular",
        lambda i: f"the Jacobian's condition number is {condition[i]:.0f}, expected at most {cell.margins.condition:g}",
    )
    near = _collisions(pairs, middle.at(~lost), reach[~lost], tiny[~lost], found)
    open_[~lost] |= near[0]
    hit, least, pair = np.full(len(middle), -1), np.full(len(middle), np.nan), np.full(len(middle), -1)
    hit[~lost], least[~lost], pair[~lost] = near[1:]
    found.clearance.append(least)
    found.pair.append(pair)
    fault(hit >= 0, "collision", lambda i: _collision_finding(pairs, int(hit[i]), float(least[i])))
    fault(open_ & tiny, "limit", lambda i: _limit_finding(cell, three[1][i], asked[i], int(which[i])))
    open_ &= ~closed
    done = ~(open_ | lost)
    found.proven_margin = min(found.proven_margin, float(sure[done].min(initial=np.inf)))
    found.proven_wrist = min(found.proven_wrist, float(sure_wrist[done & in_space].min(initial=np.inf)))
    return np.asarray(open_)


def _room(cell: Cell, seven: Float, asked: Float) -> Float:
    """How far joints and external axes (n, m) stand from their limits, what errors of tool and part ask for off."""
    low, high = cell.chain.limits.T
    rooms = [np.minimum(seven[:, :6] - low, high - seven[:, :6]) - asked]
    for axis, values in zip(cell.axes, seven[:, 6:].T, strict=False):
        room = np.minimum(values - axis.limits[0], axis.limits[1] - values)
        rooms.append(room + cell.margins.limit - turntable_margin(cell, axis))  # as the others count
    return np.column_stack(rooms if cell.axes else [*rooms, np.full(len(seven), np.inf)])


def _limit_finding(cell: Cell, seven: Float, asked: Float, which: int) -> str:
    if which >= 6:
        axis = cell.axes[which - 6]
        (low, high), name, off, unit = axis.limits, f"the {axis.name}", 0.0, axis.unit
    else:
        (low, high), name, off, unit = cell.chain.limits[which], f"joint {which + 1}", float(asked[which]), "deg"
    angle, margin = float(seven[which]), np.degrees(min(seven[which] - low, high - seven[which]))
    blur = f" (and tool and part may ask it for {np.degrees(off):.3f} deg more)" if off > 0 else ""
    return (
        f"{name} at {np.degrees(angle):.3f} {unit} keeps {margin:.3f} {unit} from its limit{blur}, expected "
        f"{np.degrees(cell.margins.limit):g} {unit}"
    )


def _collisions(
    pairs: CollisionScreen, places: Places, reach: Float, tiny: Bool, found: _Findings
) -> tuple[Bool, Int, Float, Int]:
    """Which stretches stay open, the pair that is too near or -1, the least distance and its pair (n,) each."""
    n = len(places)
    open_, hit = np.zeros(n, bool), np.full(n, -1)
    if not len(pairs.model.pairs) or not n:
        return open_, hit, np.full(n, np.inf), np.full(n, -1)
    apart, middles = pairs.pair_bounds_mm(places.joints, places.turntable)
    moved = pairs.moved_mm(places.joints, places.turntable, reach, middles)
    need = pairs.least_mm + SAFE_MM
    doubtful = apart - moved <= need
    rows = np.flatnonzero(doubtful.any(axis=1))
    links, tables = motions(pairs.cell.chain, places.joints[rows]), standing_poses(pairs.cell, places.turntable[rows])
    for i, row in enumerate(rows.tolist()):
        which = np.flatnonzero(doubtful[row])
        apart[row, which] = pairs.model.distances(links[i], tables[:, i], which.tolist())
        short = apart[row, which] < pairs.least_mm[which]
        if short.any():
            hit[row] = which[np.where(short, apart[row, which], np.inf).argmin()]
        unproven = apart[row, which] - moved[row, which] <= need[which]
        if unproven.any():
            open_[row] = True
            if tiny[row] and hit[row] < 0:
                hit[row] = which[np.where(unproven, apart[row, which], np.inf).argmin()]
    pair = apart.argmin(axis=1)
    least = apart[np.arange(n), pair]
    sure = np.where(open_[:, None], np.inf, apart - moved)
    at = int(sure.min(axis=0).argmin())
    if sure.min() < found.proven_mm:
        found.proven_mm, found.proven_pair = float(sure.min()), at
    least = np.where(hit >= 0, apart[np.arange(n), np.maximum(hit, 0)], least)
    return open_, hit, least, np.where(hit >= 0, hit, pair)


def _collision_finding(pairs: CollisionScreen, hit: int, distance: float) -> str:
    a, b = pairs.pair(hit)
    need = float(pairs.least_mm[hit])
    how = f"{a} runs into {b}" if distance <= 0 else f"{a} comes within {distance:.2f} mm of {b}"
    return f"{how}, expected a clearance of {need:.2f} mm"


def _undriven(program: ProgramMoves, violation: Violation) -> Judgement:
    nan = float("nan")
    return Judgement(program, (violation,), (), nan, nan, 0, nan, None, nan, nan, nan, nan, nan, {})


def _judgement(
    screen: CollisionScreen,
    program: ProgramMoves,
    way: Way,
    found: _Findings,
    planned: Planned | None,
    configuration: Configuration | None,
) -> Judgement:
    cell, everywhere = screen.cell, joined(found.places)
    order = np.lexsort((everywhere.share, everywhere.segment))
    places = everywhere.at(order)
    arc = arc_lengths_mm(places.tool[:, :3, 3])
    at = _arc_lookup(places, arc)

    def there(place: int, kind: str, finding: str) -> Violation:
        return Violation(int(way.line[places.segment[place]]), float(arc[place]), kind, finding)

    unchecked = [*dict.fromkeys((*cell.unchecked, *left_out(cell, ()))), *cell.unseen]  # margins may have grown since
    driven, deviation = Driven(), float("nan")
    if planned is None:
        unchecked.append("the tool's deviation from its path: no path was given")
    else:
        tool = forward_kinematics(cell.chain, places.joints) @ planned.flange_from_point
        seconds = np.where(way.timed[places.segment[1:]], _seconds(way, places), np.inf)
        driven = deviations(cell, planned, tool, places.turntable, places.segment, seconds)
        deviation = driven.largest_mm
    found.faults += _off_the_path(cell, way, found.places[0], _on_the_path(program, way, places, driven.ends))
    timed, timed_share = timed_faults(cell, way)
    found.faults += timed
    faults = [Violation(int(way.line[s]), at(s, share), kind, finding) for s, share, kind, finding in found.faults]
    faults += [there(*one) for one in driven.faults]
    faults += _configurations(cell, program, way, places, at, configuration)
    if cell.process is not None:
        faults += [
            Violation(program.moves[i].line, at(int(np.searchsorted(way.move, i)), 0.0), "process", text)
            for i, text in (*disorders(program, cell.process), *_unprobed(cell, program, planned))
        ]
    speeds, share = _speeds(cell, way, places)
    faults += [there(*one) for one in speeds]
    inside = np.argsort(order)[len(found.places[0]) :]
    along = {
        name: np.concatenate(values)[np.argsort(inside)]
        for name, values in (
            ("clearance_mm", found.clearance),
            ("limit_margin", found.margin),
            ("wrist", found.wrist),
            ("condition", found.condition),
        )
    }
    along["arc_length_mm"] = arc[np.sort(inside)]
    least, pair = _least(found)
    stops = sum(move.zone_mm == 0 and move.time_s is None for move in program.moves[1:-1])
    ramp_s = cell.controller.acceleration_s if cell.controller else None  # half of it is lost before, half behind
    return Judgement(
        program=program,
        violations=tuple(_first_of_each(faults)),
        unchecked=tuple(unchecked),
        length_mm=float(arc[-1]),
        time_s=float(way.duration_s.sum()) + stops * (ramp_s or 0.0),
        stops=stops,
        stops_counted=ramp_s is not None,
        postures=len(everywhere),
        clearance_mm=min(found.proven_mm, least),
        clearance_pair=_names(screen, found.proven_pair if found.proven_mm <= least else pair),
        limit_margin=min(found.proven_margin, float(np.nanmin(along["limit_margin"], initial=np.inf))),
        wrist=min(found.proven_wrist, np.pi / 2),
        condition=float(np.nanmax(along["condition"])) if np.isfinite(along["condition"]).any() else np.nan,
        speed_share=max(share, timed_share),
        deviation_mm=deviation,
        along=along,
        nearest=_nearest(screen, way, places, arc),
        driven=_driven(way, found.places[0]),
    )


def _driven(way: Way, places: Places) -> dict[str, Float]:
    """Where the robot stands, when, in which line, how fast its tool goes."""
    seconds = _seconds(way, places)
    steps = chords_mm(places.tool[:, :3, 3])
    return {
        "joints": places.joints,
        "turntable": places.turntable,
        "time_s": np.append(0.0, np.cumsum(seconds)),
        "line": way.line[places.segment].astype(float),
        "mm_s": np.append(0.0, steps / np.maximum(seconds, 1e-9)),
    }


def _nearest(screen: CollisionScreen, way: Way, places: Places, arc: Float) -> Nearest | None:
    """The least distance of all places that the robot reaches."""
    reached = np.flatnonzero(np.isfinite(places.joints).all(axis=1))
    found = screen.tightest(places.joints[reached], places.turntable[reached])
    if found is None:
        return None
    distance, pair, at = found
    here = int(reached[at])
    return Nearest(distance, screen.pair(pair), int(way.line[places.segment[here]]), float(arc[here]))


def _least(found: _Findings) -> tuple[float, int]:
    clearance, pair = np.concatenate(found.clearance), np.concatenate(found.pair)
    if not np.isfinite(clearance).any():
        return np.inf, -1
    i = int(np.nanargmin(clearance))
    return float(clearance[i]), int(pair[i])


def _names(screen: CollisionScreen, pair: int) -> tuple[str, str] | None:
    return None if pair < 0 else screen.pair(pair)


def _arc_lookup(places: Places, arc: Float) -> ArcLookup:
    """Arc length of the tool from the first target, by segment and share."""
    key = places.segment + np.minimum(places.share, 1 - 1e-12)

    def at(segment: int, share: float) -> float:
        i = int(np.searchsorted(key, segment + min(share, 1 - 1e-12)))
        return float(arc[min(i, len(arc) - 1)])

    return at


def _configurations(
    cell: Cell,
    program: ProgramMoves,
    way: Way,
    places: Places,
    at: Callable[[int, float], float],
    configuration: Configuration | None,
) -> Iterator[Violation]:
    """Targets whose configuration is another than the program says: a restart there would take another posture."""
    if configuration is None:
        return
    last = np.flatnonzero(np.append(np.diff(way.move[places.segment]) != 0, True))
    for i in last.tolist():
        move = program.moves[way.move[places.segment[i]]]
        if move.configuration is None or not np.isfinite(places.joints[i]).all():
            continue
        there = configuration(places.joints[i], cell)
        if there is None:
            continue
        within = places.joints[i : i + 1]
        if way.kind[places.segment[i]] == CORNER:  # the target is passed by, on the whole range of the corner
            within = places.joints[places.segment == places.segment[i]]
            within = within[np.isfinite(within).all(axis=1)]
        steps = (within[:, None] + ON_BOUNDARY * np.array([[0.0], [-1.0], [1.0]])).reshape(-1, 6)
        near = [configuration(joints, cell) for joints in steps]
        pairs = zip(move.configuration, zip(*(one for one in near if one is not None), strict=True), strict=True)
        if not all(said in found for said, found in pairs):  # an angle on the boundary of two counts as both
            said = f"the program says configuration {list(move.configuration)}, the robot has {list(there)}"
            yield Violation(move.line, at(int(places.segment[i]), float(places.share[i])), "configuration", said)


def _unprobed(cell: Cell, program: ProgramMoves, planned: Planned | None) -> Iterator[tuple[int, str]]:
    """Index of a move and what is wrong, where the program does not stop for the operator above the path's begin."""
    probe = None if cell.process is None else cell.process.probe
    if probe is None or planned is None:
        return
    first = next(i for i, move in enumerate(program.moves) if move.kind != "J")
    stops = [event.before for event in program.events if event.kind == "stop" and 0 < event.before <= first]
    joints = program.moves[stops[0] - 1].joints if stops else None
    if joints is None:
        yield 0, "the program does not stop where the operator sees the part's place"
        return
    tool = forward_kinematics(cell.chain, joints) @ planned.flange_from_point
    table = program.moves[stops[0] - 1].turntable
    if table is not None:
        tool = turntable_pose(cell, planned.turntable) @ inverse(turntable_pose(cell, table)) @ tool
    off = lateral_mm(planned.toolpath, tool, probe.distance_mm)
    if off > planned.tolerance_mm:
        yield stops[0] - 1, f"the program stops {off:.2f} mm beside the point that the operator is asked for"


def _seconds(way: Way, places: Places) -> Float:
    """From each of n places to the next (n - 1,)."""
    same = places.segment[1:] == places.segment[:-1]
    share = places.share[1:] - np.where(same, places.share[:-1], 0.0)
    return np.asarray(share * way.duration_s[places.segment[1:]])


def _speeds(cell: Cell, way: Way, places: Places) -> tuple[list[tuple[int, str, str]], float]:
    """Joints that cannot keep the programmed feed, place, kind, finding; and the largest share of a rated speed.

    Accelerations are asked for within segments and through rounded corners, where the controller does not stop.
    """
    seconds, by_joints = _seconds(way, places), way.kind[places.segment[1:]] == JOINTS
    moved = np.diff(np.column_stack([places.joints, places.turntable]), axis=0)
    long_enough = seconds > 1e-9
    rate = np.where(long_enough[:, None], moved / np.maximum(seconds, 1e-9)[:, None], 0.0)
    speed = np.where(by_joints[:, None], 0.0, np.nan_to_num(np.abs(rate) / cell.rated_speeds))
    found = [("speed", worst(cell, speed, "speed"))]
    if cell.rated_accelerations is not None:
        flying = (places.segment[1:-1] == places.segment[2:]) & long_enough[1:] & long_enough[:-1] & ~by_joints[:-1]
        change = np.abs(np.diff(rate, axis=0)) / np.maximum((seconds[1:] + seconds[:-1]) / 2, 1e-9)[:, None]
        asked = np.where(flying[:, None], np.nan_to_num(change / cell.rated_accelerations), 0.0)
        found.append(("acceleration", worst(cell, asked, "acceleration")))
    return [(one[0] + 1, kind, one[1]) for kind, one in found if one is not None], float(speed.max(initial=0.0))


def _first_of_each(faults: list[Violation]) -> Iterator[Violation]:
    """One of each kind and line, in the order of the way, not more than can be read."""
    kept: dict[tuple[int, str], Violation] = {}
    for fault in sorted(faults, key=lambda fault: fault.arc_length_mm):
        kept.setdefault((fault.line, fault.kind), fault)
    yield from list(kept.values())[:MOST_VIOLATIONS]
