"""`program.write`: the path as a program in the language of the robot's controller."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from workbench import pieces
from workbench.artefacts import Chapter, Check, Document, Judgement, Moves, Part, PathGate, ProgramMoves, RobotCell
from workbench.artefacts.decisions import NO_PROGRAM, NOT_CHECKED
from workbench.dialect import Dialect, MillingTool, ProgramJob, nearest_words, place, released, write_program
from workbench.errors import InputError
from workbench.geometry.moves import chords_mm
from workbench.geometry.poses import inverse, pose_from, quaternion_from_rotation, rotation_from_quaternion
from workbench.marks import LIMIT, MEASURED
from workbench.plot import Figure
from workbench.program.fanuc import Fanuc
from workbench.program.inform import Inform
from workbench.program.krl import Krl
from workbench.program.limits import NO_FORCE, NO_STIFFNESS, root_checks, spindle_checks
from workbench.program.playback import playback
from workbench.program.rapid import Rapid
from workbench.program.trajectory import Trajectory
from workbench.program.urscript import UrScript
from workbench.program.words import free_name, program_name
from workbench.robot.cell_model import Cell
from workbench.robot.collision import sliding
from workbench.robot.makers import Make
from workbench.robot.process import NO_PROCESS, not_seen
from workbench.stage import stage
from workbench.units import DEG, Bool, Float

Name = Annotated[str, AfterValidator(free_name)]
OTHERS: dict[str, Callable[[ProgramJob, Cell], Dialect]] = {
    "kuka": Krl,
    "fanuc": Fanuc,
    "ur": UrScript,
    "yaskawa": Inform,
    "trajectory": Trajectory,
}


def foreseen(cell: RobotCell | None, controller: Make | None) -> str:
    """Why no program can be written, or that nothing tells whether its controller takes it, whatever the path; or ''.

    Raises:
        InputError: no controller is named, or one whose language cannot drive the cell's axes.
    """
    if not isinstance(cell, Cell):
        return "" if controller is None else f"{NO_PROGRAM}{controller}: it needs the robot's cell (input 'cell')"
    known = cell.controller.dialect if cell.controller else None
    chosen = controller or known
    if chosen is None:
        raise InputError(
            f"{cell.source}: $.controller",
            "expected the make of the robot's controller: abb, kuka, "
            "fanuc, ur, yaskawa or trajectory (or the pipeline's input 'controller')",
        )
    if (sliding(cell) or len(cell.axes) > 1) and chosen not in DRIVE_AXES:
        what, way = ("track", "$.robot.held") if sliding(cell) else ("turntable.tilt", "another base_from_turntable")
        raise InputError(
            f"{cell.source}: $.{what}",
            f"expected none for {chosen}: programs drive it in the languages of ABB, KUKA and FANUC alone; let it "
            f"stand ({way})",
        )
    if known in (None, chosen):
        return ""
    return f"{NOT_CHECKED}that the controller takes it: the cell names {known}, and this is for {chosen}"


@stage("program.write", ahead=foreseen)
def write(
    moves: Moves,
    gate: PathGate,
    cell: RobotCell | None = None,
    *,
    controller: Make | None = None,
    name: Annotated[str, AfterValidator(program_name)] = "BevelPath",
    procedure: Name = "MillBevel",
    tool_name: Name = "tMill",
    work_object_name: Name = "woEdge",
    zone_mm: Zone = 0.3,
    root_tolerance_mm: Annotated[float, Field(gt=0, le=10)] = 0.5,
) -> tuple[Document | PathGate | Judgement | Chapter, ...]:
    """Write the moves as a program for the robot's controller (docs/controllers.md).

    It is read back and driven through the cell (docs/programs.md); what fails leaves no program. `program_check.json`
    has violations and the nearest approaches. A tool or work object that the cell file does not name is declared, with
    the tool centre point on the cutter's flank.

    Args:
        moves: the path as straight and circular moves.
        gate: of this path's own checks.
        cell: the robot cell; without one nothing is written, and the gate is passed on: where a controller is asked
            for, with exit status 1.
        controller: whose language: RAPID, KRL, FANUC's TP, URScript, INFORM, or joint angles over time; null: the
            cell's.
        name: of the program and its files.
        procedure: RAPID: name of the procedure that mills.
        tool_name: RAPID: name of the tool data, where the program declares it.
        work_object_name: RAPID: name of the work object, likewise.
        root_tolerance_mm: of the root face, plus or minus, to judge repeatability and deflection.

    Raises:
        InputError: equal names in RAPID; another path's gate; a cell without postures; moves that leave the path
            farther than its check allows; a turntable that turns, in URScript or INFORM.

    Example:
        >>> from workbench import path, program, robot
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> springs = stiffness.read(cell)
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> force, file = stiffness.force(plan, None, cell)
        >>> at = {"cutter_rotation_deg": (0, 0), "turntable_deg": (0, 0), "whole_map": False}
        >>> gate = path.check_file(plan)
        >>> postures, gate, *_ = stiffness.posture(cell, springs, plan, force, gate, **at)
        >>> made = program.write(path.simplify(plan, postures), gate, cell)
        >>> [type(one).__name__ for one in made]
        ['Document', 'Document', 'PathGate', 'Judgement', 'Chapter']
    """
    said = foreseen(cell, controller)
    if not released(name, moves.toolpath, gate, cell, moves):
        return (gate,)
    if said:
        gate = dataclasses.replace(gate, loosened=(*gate.loosened, said))
    if not isinstance(cell, Cell):
        return (gate,)
    chosen = controller or (cell.controller.dialect if cell.controller else None)
    assert chosen is not None
    cell = _with_process_notes(cell, chosen)
    mills = moves.toolpath.mills
    of_root = root_checks(moves, gate, cell, root_tolerance_mm) if mills else ()
    of_spindle = spindle_checks(moves, cell) if mills else ()
    checks = (*of_root, *of_spindle)
    if wrong := [check.finding for check in checks if not check.passed]:
        return (dataclasses.replace(gate, passed=False, reason=f"program refused: {'; '.join(wrong)}"),)
    for group, unknown in ((of_root, NO_STIFFNESS), (of_spindle, NO_FORCE)):
        if any(check.value is None for check in group):
            cell = dataclasses.replace(cell, unchecked=(*cell.unchecked, unknown))
    job = program_job(name, moves, cell, zone_mm, gate.tolerance_mm)
    dialect = (
        _rapid(job, cell, procedure, tool_name, work_object_name) if chosen == "abb" else OTHERS[chosen](job, cell)
    )
    written = write_program(dialect, gate, cell, checks)
    if written.judgement is None:
        return (written.gate,)
    stops, within = stops_in_the_cut(written.judgement.program, moves)
    counted = "is" if written.judgement.stops_counted else "is not"
    tool, there, cost = TOOL_STOPS if mills else SCANNER_STOPS
    warning = (
        f"{tool} stops at {stops} of {within} targets {there}: each {cost}, and its time {counted} "
        "counted ($.controller.acceleration_s)"
    )
    return (
        *written.documents,
        dataclasses.replace(written.gate, warnings=(warning,)) if stops else written.gate,
        written.judgement,
        program_chapter(written.judgement, written.gate, cell, moves.toolpath.part, checks),
    )


def stops_in_the_cut(program: ProgramMoves, moves: Moves) -> tuple[int, int]:
    """At how many targets between two moves that cut the tool stands still, and how many there are.

    A program without a way from home is at its first target by the joints; a trajectory stops nowhere.
    """
    placed = [move for move in program.moves if move.kind != "J"][: len(moves.layer)]
    cutting = moves.cutting[len(moves.layer) - len(placed) :].tolist()
    inside = [move for move, here, after in zip(placed, cutting, cutting[1:], strict=False) if here and after]
    return sum(move.zone_mm == 0 for move in inside), len(inside)


def _with_process_notes(cell: Cell, chosen: str) -> Cell:
    """The cell with what a program of this controller can say of its process: signals are named as its maker does."""
    process, known = cell.process, cell.controller.dialect if cell.controller else chosen
    if process is None:
        return cell
    if chosen == known and chosen != "trajectory":
        return dataclasses.replace(cell, unseen=(*cell.unseen, *not_seen(cell, process, chosen)))
    why = "a trajectory has no words for it" if chosen == "trajectory" else f"the cell file's words are for {known}"
    return dataclasses.replace(cell, process=None, unchecked=(*cell.unchecked, f"{NO_PROCESS} ({why})"))


def _rapid(job: ProgramJob, cell: Cell, procedure: str, tool_name: str, work_object_name: str) -> Rapid:
    for part, name in (("tool", job.tool_name), ("work_object", job.work_object_name)):
        try:
            free_name(name or part)
        except ValueError as error:  # tool0 and wobj0 are the flange and the world, whatever the cell file says
            raise InputError(f"{cell.source}: $.{part}.controller_name", f"{error}, found {name!r}") from None
    names = [job.name, procedure, job.tool_name or tool_name, job.work_object_name or work_object_name]
    if len({name.lower() for name in names}) < len(names):
        raise InputError("program.write", f"expected four different names, got {', '.join(names)}")
    return Rapid(job, cell, procedure, tool_name, work_object_name)


# The chapter of the report on a program: whether it is released, its least margins, what was not checked.

DRIVE_AXES = ("abb", "kuka", "fanuc")  # a track, or two axes of a positioner
TOOL_STOPS = "the cutter", "in the cut", "may leave a mark"
SCANNER_STOPS = "the scanner", "of the pass", "gives one place many frames"
MOST_LISTED = 10  # violations in the report; all are in program_check.json
CHECKED = {
    "root_deflection_mm": "Of the root face, by giving way, mm",
    "root_repeatability_mm": "Of the root face, by the robot's repeatability, mm",
    "spindle_torque_nm": "Largest torque of the cutter, Nm",
    "spindle_power_kw": "Largest power of the cutter, kW",
}
STRETCHES = 600  # of the charts, each with its worst place


def program_chapter(
    judgement: Judgement, gate: PathGate, cell: Cell, part: Part, checks: tuple[Check, ...] = ()
) -> Chapter:
    """What came of driving the written program through its cell."""
    pair = " and ".join(judgement.clearance_pair) if judgement.clearance_pair else "nothing"
    clearance = f"{judgement.clearance_mm:.1f} mm ({pair})" if np.isfinite(judgement.clearance_mm) else "no bodies"
    name = f"{judgement.program.name} ({judgement.program.dialect})"
    left_open, items = gate.left_open, "item" if len(gate.left_open) == 1 else "items"
    free = f"released with {len(left_open)} {items} NOT CHECKED" if left_open else "released"
    released = free if gate.passed else "not released: it was not written"
    halts = f"{judgement.stops} stops {'counted' if judgement.stops_counted else 'not counted'}"
    straight, none = np.isfinite(judgement.condition), "no linear moves"
    facts = [
        ("Program", name),
        ("Release", released),
        ("Length of the way", f"{judgement.length_mm:.0f} mm in {judgement.time_s:.0f} s, {halts}"),
        ("Postures examined", f"{judgement.postures}"),
        ("Least clearance, proven", clearance),
        *(() if judgement.nearest is None else (("Least clearance", nearest_words(judgement.nearest)),)),
        ("Least distance from a joint limit", f"{judgement.limit_margin / DEG:.2f}°"),
        ("Least wrist angle", f"{judgement.wrist / DEG:.2f}°" if straight else none),
        ("Largest condition number, where examined", f"{judgement.condition:.1f}" if straight else none),
        ("Largest share of a joint's speed", f"{judgement.speed_share:.3f}"),
        ("Largest deviation from the path", f"{judgement.deviation_mm:.3f} mm"),
        *(
            (CHECKED[check.name], f"{check.value:.3g}, at most {check.limit:.3g}")
            for check in checks
            if check.value is not None
        ),
    ]
    wrong = [place(one) for one in judgement.violations[:MOST_LISTED]]
    lists = (("Reasons against release", wrong), ("Not checked, or with less force than the rule", left_open))
    text = pieces.facts_html(facts) + "".join(
        pieces.heading(title) + pieces.list_html(texts) for title, texts in lists if texts
    )
    if (scene := playback(judgement, cell)) is not None:
        text += pieces.heading("The program as it runs") + pieces.SPACE
    if (chart := margins_chart(judgement, cell)) is not None:
        text += pieces.heading("Margins along the way") + pieces.figure_html(
            chart,
            "Clearance, distance from joint limits, wrist angle and condition number along the way",
            "Each place shows the worst of its stretch; dashed: what the cell file requires.",
        )
    return Chapter(
        title="Program",
        html=text,
        verdict=gate.verdict,
        summary=f"{name}: {released}",
        part=part,
        not_checked=left_open,
        scene=scene,
    )


def margins_chart(judgement: Judgement, cell: Cell) -> bytes | None:
    """SVG of what a program keeps along its way, against what it must keep; None: it was not driven."""
    arc = judgement.along.get("arc_length_mm")
    if arc is None or len(arc) < 2 or not arc[-1] > 0:
        return None
    which = np.minimum((arc / float(arc[-1]) * STRETCHES).astype(int), STRETCHES - 1)
    kept, first = np.unique(which, return_index=True)

    def worst(name: str, sign: float = 1.0) -> Float:
        found = np.full(STRETCHES, np.inf)
        values = judgement.along[name]
        np.minimum.at(found, which, np.where(np.isnan(values), np.inf, sign * values))
        return np.asarray(np.where(np.isfinite(found), sign * found, np.nan)[kept])

    margins = cell.margins
    rows = (
        ("clearance, mm", worst("clearance_mm"), cell.margin_mm),
        ("to a joint\nlimit, °", worst("limit_margin") / DEG, margins.limit / DEG),
        ("wrist\nangle, °", worst("wrist") / DEG, margins.wrist / DEG),
        ("condition\nnumber", worst("condition", -1.0), margins.condition),
    )
    shown = [row for row in rows if np.isfinite(row[1]).any()]
    figure = Figure(figsize=(10, 0.5 + 1.5 * len(shown)))
    charts = figure.subplots(len(shown), 1, sharex=True)
    for axes, (name, values, limit) in zip(charts, shown, strict=True):
        top = 1.08 * max(float(np.nanmax(values)), limit)
        axes.set(xlim=(0.0, float(arc[-1])), ylim=(0.0, top), ylabel=name)
        axes.y_label_at = -0.05
        axes.plot(arc[first], values, linewidth=1.0, color=MEASURED)
        axes.axhline(limit, color=LIMIT, linewidth=1.0, dashes=(6, 3))
    charts[-1].set(xlabel="way of the tool, mm")
    return figure.svg()


# What the dialects share: the zone, and the tool and the work object as the cell has them.

Zone = Annotated[
    float,
    Field(
        ge=0,
        le=50,
        description="how far before a target the next move may blend in, but at sharp corners; 0: never.",
    ),
]
GENTLE = 0.8  # share of a joint's acceleration that blending may take
NOTHING = 1e-6  # mm
NO_LOAD_KG, NO_LOAD_MM = 0.001, (0.0, 0.0, 0.001)  # ABB's tool0: what a program says of a load that nobody stated


def program_job(name: str, moves: Moves, cell: Cell, zone_mm: float, rounding_mm: float) -> ProgramJob:
    """The job as the cell has it.

    A tool that the controller knows by name is the cutter's tip; one that the program declares is the path's own frame,
    on the cutter's flank. Targets are in the cell's work object.
    """
    assert moves.flange_from_point is not None
    tool = moves.flange_from_point if cell.tool_name is None else cell.flange_from_cutter
    seen = as_seen(moves, inverse(cell.base_from_workobject), inverse(moves.flange_from_point) @ tool)
    radius = moves.toolpath.cutter.diameter_mm / 2
    stated = cell.tool_mass_kg is not None and cell.tool_centre_of_gravity_mm is not None
    mass, centre = (cell.tool_mass_kg, cell.tool_centre_of_gravity_mm) if stated else (NO_LOAD_KG, np.array(NO_LOAD_MM))
    assert mass is not None
    assert centre is not None
    spindle = MillingTool(tool[:3, 3] - radius * tool[:3, 0], quaternion_from_rotation(tool[:3, :3]), mass, centre)
    return ProgramJob(
        name,
        seen,
        spindle,
        zone_mm,
        moves.turntable_deg,
        rounding_mm,
        cell.base_from_workobject,
        cell.tool_name,
        cell.work_object_name,
        too_sudden(moves, cell, zone_mm),
    )


def too_sudden(moves: Moves, cell: Cell, zone_mm: float) -> Bool | None:
    """Targets (k,) at which blending would ask more of a joint than GENTLE of its acceleration: these are reached.

    Through a zone the velocity turns from the one move's to the next one's, in the time that it takes to cross it at
    the feed. Velocities of the joints are those of the path's own postures beside the target. None: the cell's file
    states no accelerations.
    """
    made, point = moves.postures, moves.point
    most = cell.rated_accelerations
    if most is None or made is None or point is None:
        return None
    length = chords_mm(moves.position_mm)
    room = np.minimum(np.append(0.0, length), np.append(length, 0.0)) / 2
    zone = np.maximum(np.minimum(zone_mm, room), NOTHING)
    steps = chords_mm(made.position_mm)
    a_mm = np.diff(made.axes, axis=0) / np.maximum(steps, NOTHING)[:, None]  # rad of each a mm of way
    inside = np.clip(point, 1, len(a_mm) - 1)
    change = np.abs(a_mm[inside] - a_mm[inside - 1]) * moves.feed_mm_s[:, None]
    asked = change / (2 * zone / moves.feed_mm_s)[:, None]
    return np.asarray((asked > GENTLE * most).any(axis=1))


def as_seen(moves: Moves, frame_from_base: Float, point_from_tool: Float) -> Moves:
    """The same moves as targets of another tool frame in another frame."""

    def in_frame(position: Float, quaternion: Float) -> tuple[Float, Float]:
        poses = frame_from_base @ pose_from(rotation_from_quaternion(quaternion), position) @ point_from_tool
        return poses[:, :3, 3], quaternion_from_rotation(poses[:, :3, :3])

    position, quaternion = in_frame(moves.position_mm, moves.quaternion_wxyz)
    via, via_turn = moves.via_position_mm.copy(), moves.via_quaternion_wxyz.copy()
    arcs = moves.circular
    via[arcs], via_turn[arcs] = in_frame(via[arcs], via_turn[arcs])
    return dataclasses.replace(
        moves, position_mm=position, quaternion_wxyz=quaternion, via_position_mm=via, via_quaternion_wxyz=via_turn
    )
