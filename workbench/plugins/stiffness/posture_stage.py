"""`stiffness.posture`: how robot, cutter and turntable should stand at every point of a path (eq. 25)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from workbench.api import (
    DEG,
    AnyArray,
    Bool,
    Cell,
    Chapter,
    Document,
    Float,
    InputError,
    PathGate,
    Postures,
    Progress,
    Side,
    Toolpath,
    external_at,
    refuse_contradiction,
    result_file,
    sliding,
    stage,
    within_margins,
)
from workbench.plugins.ranges import LeastMargin, Stations
from workbench.plugins.stiffness.arm import FREE, NO_SPRINGS, AnyArm, Unsprung, arm_of
from workbench.plugins.stiffness.margins import Steadiness, cuts_of
from workbench.plugins.stiffness.outcome import (
    AWKWARDNESS,
    DISPLACEMENT,
    Case,
    Found,
    case_at,
    case_of,
    mean_of,
    posture_chapter,
    postures,
)
from workbench.plugins.stiffness.path_points import Load, PathPoints, path_points
from workbench.plugins.stiffness.track import along_track, places
from workbench.plugins.stiffness.traversal import (
    CAUSES,
    JUDGED,
    Choice,
    Examiner,
    PostureMap,
    Share,
    Traversal,
    lowest,
    mapped,
    sample,
    search,
    traversal,
    within,
    words_of,
)
from workbench.plugins.stiffness.values import JointStiffness, MillingForce, RobotModes

STEP_DEG, COARSE_DEG = 1.0, 5.0  # of the grid, with and without stiffness
NO_STIFFNESS = (
    "how far the robot gives way: nobody states its joint stiffness ($.robot.joint_stiffness_nm_per_rad, or "
    "stiffness.identify from loading tests)"
)
Range = tuple[Annotated[float, Field(ge=-360, le=360)], Annotated[float, Field(ge=-360, le=360)]]


@stage("stiffness.posture")
def posture(
    cell: Cell | None,
    stiffness: JointStiffness | None,
    toolpath: Toolpath,
    force: MillingForce,
    gate: PathGate | None = None,
    modes: RobotModes | None = None,
    *,
    progress: Progress = None,
    configuration: list[Side] | None = None,
    cutter_rotation_deg: Range = (
        -180,
        180,
    ),
    turntable_deg: Range | None = None,
    tilt_deg: Range | None = None,
    tilt_step_deg: Annotated[float, Field(ge=0.25, le=90)] = 15.0,
    step_deg: Annotated[float, Field(ge=0.25, le=30)] | None = None,
    sampled_points: Annotated[int, Field(ge=2, le=5000)] = 60,
    load: Load = "mean",
    reach_mm: Annotated[
        float | None,
        Field(ge=-200, le=500),
    ] = None,
    planned_at_deg: Annotated[float, Field(ge=-360, le=360)] | None = None,
    planned_tilt_deg: Annotated[float, Field(ge=-360, le=360)] | None = None,
    whole_map: bool = True,
    map_step_deg: Annotated[float, Field(ge=0.25, le=30)] = 5.0,
    least_margin: LeastMargin = 1.5,
    stations: Stations = 24,
    mode: Literal["constant", "along_path"] = "constant",
) -> tuple[Postures, PathGate | None, Document, Chapter] | tuple[PathGate] | None:
    """Choose cutter rotation and turntable angle of least deflection: eq. (25), Fig. 17.

    The proven optimum of the grid within the cell's margins (docs/stiffness.md). Writes `posture.json`.

    Args:
        cell: robot, tool, turntable, what stands around; without one there are no postures.
        stiffness: of the joints; None: nobody knows it, and no displacement is predicted.
        toolpath: the path, as planned.
        force: on the cutter along it.
        gate: of this path's own checks, passed on; without them there is no decision and no program.
        modes: of robot, spindle and cutter; None: nobody asks for a margin from chatter.
        configuration: in which the arm stays, one word of each pair at most; null: the cell file's.
        cutter_rotation_deg: lowest and highest; a full turn is the whole circle.
        turntable_deg: lowest and highest; null: the cell's limits.
        tilt_deg: of the turntable's tilt, likewise.
        tilt_step_deg: between the tilts examined.
        step_deg: of the grid, both ways; null: 1, or 5 without stiffness or with modes.
        sampled_points: number of loaded points that the traversal averages; the result holds for all.
        load: force of a revolution: its mean or its peak.
        reach_mm: of the cutter beyond a point's frame, along its axis; null: half its flutes.
        planned_at_deg: turntable angle at which the part was scanned; null: as `robot.plate` has it, else 0.
        planned_tilt_deg: likewise of its tilt.
        whole_map: false: cells worse than the optimum are not examined for collision.
        map_step_deg: of the map's grid, if larger; each free cell takes about 2 ms.
        least_margin: with modes: least ratio of unstable depth, less U, to the depth.
        stations: number of places at which that is judged.
        mode: `constant`: one pair of angles for all points; `along_path`: that too, with what angles of each point's
            own would win at most.

    Raises:
        InputError: out of reach or colliding at every angle; too fine a grid for a robot without fast kernels; another
            path's force.

    Example:
        >>> from workbench import path, robot
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> springs = stiffness.read(cell)
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> force, file = stiffness.force(plan, None, cell)
        >>> at = {"cutter_rotation_deg": (0, 0), "turntable_deg": (0, 0), "whole_map": False}
        >>> postures, gate, *files = stiffness.posture(cell, springs, plan, force, path.check_file(plan), **at)
        >>> gate.passed, [type(one).__name__ for one in files]
        (True, ['Document', 'Chapter'])
    """
    if cell is None:
        return None if gate is None else (gate,)
    kept = within_margins(cell)
    _check_home(kept)
    sprung = arm_of(kept.chain, NO_SPRINGS if stiffness is None else stiffness.nm_per_rad)
    arm = Unsprung(sprung, kept) if stiffness is None else sprung
    words = words_of(arm, kept.chain)
    allowed = _allowed(words, cell.configuration if configuration is None else configuration)
    step_deg = step_deg or (STEP_DEG if stiffness and modes is None else COARSE_DEG)
    reach = toolpath.cutter.flute_length_mm / 2 if reach_mm is None else reach_mm
    planned = _planned(cell, planned_at_deg, planned_tilt_deg)
    points = path_points(toolpath, force, load=load, reach_mm=reach, planned=planned)
    rotations = grid(cutter_rotation_deg, step_deg)
    at = sample(points, sampled_points)
    keeps = None
    if modes is not None and least_margin:
        cuts = cuts_of(toolpath, force, points.layer, points.base_from_point)
        keeps = Steadiness(cell, modes, cuts, least_margin, stations)
    pair = Examiner(cell, arm, points, keeps).screen.always_near()
    if pair is not None:
        raise InputError(
            f"{cell.source}: {pair[0]}, {pair[1]}",
            "expected bodies that some posture keeps apart, found these too near in every one: is a shape too large or "
            "out of place, or may they touch ($.may_touch)?",
        )
    ways = [
        (way, tables, traversal(arm, kept, way.only(at), rotations, tables))
        for way in _ways(cell, points, tilt_deg, tilt_step_deg)
        if len(tables := _tables(cell, turntable_deg, step_deg, way))
    ]
    examiner, traversed, choice, over = _best(cell, arm, keeps, ways, allowed, within(progress, 0.0, 0.5))
    points = examiner.points
    if whole_map:
        every = max(int(map_step_deg / step_deg + 1e-9), 1)
        thinned = traversed.thinned(every, choice.rotation, choice.table)
        over = mapped(examiner, thinned, within(progress, 0.5, 1.0))
    made = postures(examiner, toolpath, choice, cell.warnings + _unsteady(choice, least_margin))
    worst = np.nan_to_num(np.linalg.norm(made.displacement_mm, axis=1)).max()
    if worst > toolpath.cutter.diameter_mm / 2:  # the cutter would leave the face that it cuts
        raise InputError(
            "stiffness.posture",
            f"the cutter gives way by {worst:.3g} mm, more than its radius: expected stiffness of the joints in Nm/rad",
        )
    least = [lowest(arm, kept, way.only(at), rotations, tables) for way, tables, _ in ways] if stiffness else []
    found = Found(
        postures=made,
        points=points,
        choice=choice,
        map=over,
        measure=DISPLACEMENT if stiffness else AWKWARDNESS,
        words=words,
        bound_at=np.flatnonzero(np.isin(points.loaded, at)),
        cases=_cases(examiner, choice, over),
        bound=np.min(least, axis=0) if least else None,
        asked=None if keeps is None else keeps.asked,
    )
    if mode == "along_path":
        win = "without joint stiffness nothing says what angles of each point's own would win"
        if found.gap is not None:
            win = f"angles of each point's own would lower the mean displacement by {100 * found.gap:.2g} % at most"
        one_pair = f"mode along_path: one pair of angles serves all points; {win}"
        made = replace(made, warnings=(*made.warnings, one_pair))
        found = replace(found, postures=made)
    return (
        made,
        _gate(gate, found, force),
        posture_document(found),
        posture_chapter(cell, found, toolpath),
    )


def _allowed(words: Sequence[tuple[str, ...]], wanted: Sequence[Side]) -> Bool:
    """Which configurations (8,) are wanted."""
    try:
        refuse_contradiction(wanted)
    except ValueError as error:
        raise InputError("stiffness.posture.configuration", str(error)) from None
    return np.array([set(wanted) <= set(one) for one in words])


def grid(limits_deg: Range, step_deg: float) -> Float:
    """Angles in rad from the lowest on; of a full turn without its end."""
    low, high = limits_deg
    if not low <= high:
        raise InputError(
            "stiffness.posture", f"expected a range with the lower angle first, found {low:g}, {high:g} deg"
        )
    count = int(np.floor((min(high - low, 360.0) + 1e-9) / step_deg)) + 1
    angles = low + step_deg * np.arange(count)
    return np.asarray(angles[angles < low + 360 - 1e-9] * DEG)


def _unsteady(choice: Choice, asked: float) -> tuple[str, ...]:
    """What to say where no posture is far enough from chatter."""
    if choice.steady:
        return ()
    return (
        f"chatter: no posture keeps a margin of {asked:g} less U (least_margin), the best has {choice.margin:.2g}; "
        "stiffness.chatter tells which depth, direction and speed would do, tap tests (stiffness.modes) lower U",
    )


def _check_home(kept: Cell) -> None:
    """Refuse a home from which no program could begin."""
    if kept.process is None:
        return
    home, (low, high) = kept.process.home.joints, kept.chain.limits.T
    for i in np.flatnonzero((home < low) | (home > high)).tolist():
        room = f"{low[i] / DEG:.2f} to {high[i] / DEG:.2f} deg"
        raise InputError(
            f"{kept.source}: $.process.home.joints_deg[{i}]",
            f"expected joint {i + 1} within its limits by their margin, {room}, found {home[i] / DEG:g}",
        )


Searched = tuple[PathPoints, Float, Traversal]  # a way of the other axes, angles of the sought one, the costs


def _ways(cell: Cell, points: PathPoints, tilt_deg: Range | None, step_deg: float) -> Iterator[PathPoints]:
    """The points from a track that stands, and from one that goes along with the tool; or with each tilt."""
    if len(cell.axes) < 2:
        yield points
        if sliding(cell):
            yield along_track(cell, points)
        return
    for tilt in _angles(cell, 0, tilt_deg, step_deg):
        yield replace(points, drift=np.tile([tilt, 0.0], (len(points.layer), 1)))


def _best(
    cell: Cell, arm: AnyArm, keeps: Steadiness | None, ways: list[Searched], allowed: Bool, progress: Share
) -> tuple[Examiner, Traversal, Choice, PostureMap]:
    """The best free cell of all ways, each of which is searched as far as it may have a better one."""
    least = [np.where(one.said[allowed] == FREE, one.mean[allowed], np.inf).min() for _, _, one in ways]
    best: tuple[Examiner, Traversal, Choice, PostureMap] | None = None
    examined, of, refused = 0, sum(one.said[0].size for _, _, one in ways), list[InputError]()
    for done, i in enumerate(np.argsort(least, kind="stable").tolist()):
        points, _, traversed = ways[i]
        below = best[2].mean if best is not None and best[2].steady else np.inf
        if best is not None and least[i] >= below:
            break
        examiner = Examiner(cell, arm, points, keeps)
        share = within(progress, done / len(ways), (done + 1) / len(ways))
        try:
            choice, over = search(examiner, traversed, allowed, share, below)
        except InputError as error:
            refused.append(error)
            continue
        examined += choice.examined
        if best is None or choice.rank > best[2].rank:
            best = examiner, traversed, choice, over
    if best is None:
        raise refused[0]
    return *best[:2], replace(best[2], examined=examined, of=of), best[3]


def _planned(cell: Cell, turntable_deg: float | None, tilt_deg: float | None) -> Float:
    """Where the external axes stood when the part was scanned, rad: as asked for, else as its scan was placed, else 0.

    Raises:
        InputError: both are said, and differ.
    """
    placed = external_at(cell, 0.0, 0.0, "") if cell.scanned_at is None else cell.scanned_at
    asked = external_at(cell, turntable_deg or 0.0, tilt_deg or 0.0, "stiffness.posture.planned_tilt_deg")
    unsaid = np.array([tilt_deg is None, turntable_deg is None])[-asked.size :].reshape(asked.shape)
    planned = np.where(unsaid, placed, asked)
    if cell.scanned_at is None or np.allclose(planned, placed):
        return planned
    both = [", ".join(f"{angle:g}" for angle in np.atleast_1d(one) / DEG) for one in (placed, planned)]
    words = "expected {} deg, as robot.plate has it, found {}: the part was scanned at one angle"
    raise InputError("stiffness.posture.planned_at_deg", words.format(*both))


def _tables(cell: Cell, limits_deg: Range | None, step_deg: float, points: PathPoints) -> Float:
    """Turntable angles within the cell's limits by the margin; one angle, 0, where there is no turntable."""
    if cell.turntable is None:
        return np.zeros(1)
    if sliding(cell):
        if limits_deg is not None or points.planned:
            raise InputError(
                "stiffness.posture", "expected turntable_deg null and planned_at_deg 0: the cell has a track"
            )
        return places(cell, points.drift)
    return _angles(cell, -1, limits_deg, step_deg)


def _angles(cell: Cell, which: int, limits_deg: Range | None, step_deg: float) -> Float:
    """Angles of an external axis within its limits by the margin, and within those asked for."""
    low, high = cell.axes[which].limits / DEG
    if limits_deg is not None:
        low, high = max(low, limits_deg[0]), min(high, limits_deg[1])
    angles = grid((low, high), step_deg)
    low, high = within_margins(cell).axes[which].limits
    kept = angles[(angles >= low - 1e-9) & (angles <= high + 1e-9)]
    if not len(kept) and high > low:
        kept = grid((low / DEG, high / DEG), step_deg)
    if not len(kept):
        why = f"expected {cell.axes[which].name} angles {cell.margins.limit / DEG:g} deg from its limits, found none"
        raise InputError("stiffness.posture", why)
    return np.asarray(kept)


def _cases(examiner: Examiner, choice: Choice, over: PostureMap) -> dict[str, Case | None]:
    """What the choice is compared with: how the path was planned, and the worst of its map."""
    as_planned, planned = examiner, examiner.points.planned if examiner.cell.turntable else 0.0
    if np.ndim(planned):
        points = replace(examiner.points, drift=np.tile(planned, (len(examiner.points.layer), 1)))
        as_planned, planned = Examiner(examiner.whole, examiner.arm, points), 0.0
    worst = np.unravel_index(np.nanargmax(over.mean), over.mean.shape)
    places = {
        "as planned": (0.0, float(planned)),
        "worst": (over.rotations[worst[0]], over.tables[worst[1]]),
    }
    found = {name: case_at(as_planned if name == "as planned" else examiner, *at) for name, at in places.items()}
    return {**found, "best": case_of(examiner, choice.rotation, choice.table, choice.joints)}


def _gate(gate: PathGate | None, found: Found, force: MillingForce) -> PathGate | None:
    """The decision so far, with what was found; None where it is on another path, or there is none."""
    if gate is None or gate.toolpath is not found.postures.toolpath:
        return None
    reason = f"postures found for {len(found.points.layer)} points, {mean_of(found)}"
    assumed = [f"NOT CHECKED: {force.assumed}"] if force.assumed and found.measure == DISPLACEMENT else []
    assumed += [f"NOT CHECKED: {NO_STIFFNESS}"] if found.measure == AWKWARDNESS else []
    loosened = (*gate.loosened, *assumed)
    short = _unsteady(found.choice, found.asked or 0.0)
    whole = "; ".join([*short, gate.reason, reason])
    passed = gate.passed and not short
    return replace(gate, reason=whole, passed=passed, reached=True, loosened=loosened)


# `posture.json`: postures of every point, and the map that the choice was made on. Degrees, mm.


def posture_document(found: Found) -> Document:
    """`points` are the layers' in their order; `travels` those of the travel moves, which come in between."""
    made, kept = found.postures, found.choice.steady
    # From chatter, less U, as `stiffness.chatter` has it; infinite: null.
    margin = {"least_margin_asked": found.asked, "least_margin": found.choice.margin, "margin_kept": kept}
    return result_file(
        "posture.json",
        {
            "part": asdict(made.toolpath.part),
            **_measured(found, found.cost.mean()),
            "constant": {
                **_angles_deg(found, found.choice.rotation, found.points.external(found.choice.table, 0)),
                "configuration": list(found.configuration),
                **_measured(found, found.cost.mean()),
                "cells_examined": found.choice.examined,
                **({} if found.asked is None else margin),
            },
            "compared": {name: None if case is None else _case(found, case) for name, case in found.cases.items()},
            "pointwise_bound_mm": None if found.bound is None else found.bound.mean(),
            "gap_to_bound": found.gap,
            "warnings": list(made.warnings),
            "points": _rows(found, np.flatnonzero(made.layer)),
            "travels": _rows(found, np.flatnonzero(made.layer == 0)),
            "map": _map(found),
        },
    )


def _named(made: Postures, external: Float) -> dict[str, Any]:
    """Values of the external axes, rad, by their names; a track's beside a turntable that is not there."""
    names = (["tilt_deg"] if made.turntable.ndim > 1 else []) + ["turntable_deg"]
    said = _rounded(external / DEG, 6)
    named = dict(zip(names, np.moveaxis(said, -1, 0), strict=True)) if made.turntable.ndim > 1 else {names[0]: said}
    if made.on_track:
        named |= {"turntable_deg": 0.0 * said, "track_mm": said}
    return named


def _angles_deg(found: Found, rotation: Any, external: Float) -> dict[str, Any]:
    return {"cutter_rotation_deg": _rounded(rotation / DEG, 6), **_named(found.postures, external)}


def _measured(found: Found, mean: Any) -> dict[str, Any]:
    """What postures were chosen by, under the name of its measure; `mean_displacement_mm` is always there."""
    if found.measure == DISPLACEMENT:
        return {"mean_displacement_mm": mean}
    return {"mean_displacement_mm": np.full(np.shape(mean), np.nan), "mean_awkwardness": mean}


def _case(found: Found, case: Case) -> dict[str, Any]:
    return {
        **_angles_deg(found, case.rotation, case.external[0]),
        **_measured(found, case.cost.mean()),
        "cause": CAUSES[case.cause],
        "pair": case.pair,
    }


def _rows(found: Found, chosen: AnyArray) -> list[dict[str, Any]]:
    made = found.postures
    columns = {
        "layer": made.layer,
        **_angles_deg(found, made.cutter_rotation, made.turntable),
        "joints_deg": _rounded(made.joints / DEG, 6),
        "displacement_mm": _rounded(np.linalg.norm(made.displacement_mm, axis=1), 6),
        "clearance_mm": _rounded(made.clearance_mm, 3),
    }
    return [{name: column[i] for name, column in columns.items()} for i in chosen.tolist()]


def _map(found: Found) -> dict[str, Any]:
    over = found.map
    shown = {
        **_angles_deg(found, over.rotations, found.points.external(over.tables, 0)),
        **_measured(found, _rounded(over.mean, 6)),
        "cause": [[CAUSES[i] for i in row] for row in over.cause.tolist()],
        "judged": [[JUDGED[i] for i in row] for row in over.how.tolist()],
        "collision_pairs": [list(pair) for pair in over.pairs],
        "collision_pair": [[None if i < 0 else i for i in row] for row in over.pair.tolist()],
    }
    if over.chatter is not None and found.asked is not None:  # by the screen; null: infeasible, or beyond all depths
        shown |= {"margin": _rounded(over.chatter[0], 4), "margin_kept": over.chatter[1] >= found.asked}
    return shown


def _rounded(values: Float | float, digits: int) -> Float:
    return np.round(values, digits) + 0.0
