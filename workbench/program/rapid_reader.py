"""A RAPID module as moves that can be judged."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from workbench.artefacts import EventKind, ProgramEvent, ProgramMove, ProgramMoves, ProgramTool
from workbench.errors import InputError
from workbench.geometry.poses import pose_from, rotation_from_quaternion
from workbench.program.rapid_language import (
    SHAPES,
    TOOL0,
    WOBJ0,
    Event,
    JointTarget,
    Move,
    OnController,
    Pose,
    RapidProgram,
    RobTarget,
    Tokens,
    read_value,
)
from workbench.program.words import IDENTIFIER, PREDEFINED, SPEEDS, TAKEN, ZONES, known_events
from workbench.robot.cell_file import ProcessPart
from workbench.units import DEG, Float

KINDS = {"MoveAbsJ": "J", "MoveJ": "J", "MoveL": "L", "MoveC": "C"}
ABSENT = 9e8  # an external axis beyond this is not there (9E+09 in single precision)


def read_rapid(text: str, name: str = "program", process: ProcessPart | None = None) -> ProgramMoves:
    """Read a RAPID module with one procedure that moves.

    The turntable is the external axis eax_a; it turns what stands in the cell, the work object stays in the base.

    Args:
        text: the module.
        name: of its file, for messages.
        process: whose signals switch what; None: a program that switches any is refused.

    Raises:
        InputError: what `parse_rapid` refuses; several procedures that move, or none; an external axis other than
            eax_a; a signal or unit of no known use; a statement that a blending move would run ahead of; a stationary
            tool or a work object that the robot holds.
    """
    program = parse_rapid(text, name)
    moving = [moves for moves in program.procedures.values() if moves]
    if [one for key, found in program.events.items() if not program.procedures[key] for one in found]:
        raise InputError(name, "expected statements in the procedure that moves, and in no other")
    if len(moving) != 1:
        raise InputError(name, f"expected one procedure that moves, found {len(moving)}")
    tools = {"tool0": TOOL0, **program.tools}
    objects = {"wobj0": WOBJ0, **program.work_objects}
    for tool, data in tools.items():
        if not data.held_by_robot:
            raise InputError(name, f"expected a tool that the robot holds, '{tool}' is stationary")
    for place, where in objects.items():
        if where.held_by_robot:
            raise InputError(name, f"expected a work object that stands, the robot holds '{place}'")
    declared = {key.lower() for key in (*tools, *objects)}
    named = {move.tool: ProgramTool(None) for move in moving[0] if move.tool.lower() not in declared}
    places: dict[str, Float | None] = {
        move.work_object: None for move in moving[0] if move.work_object.lower() not in declared
    }
    spelt = {key.lower(): key for key in (*named, *places, *tools, *objects)}
    events = tuple(one for found in program.events.values() for one in found)
    _stops(moving[0], events, name)
    return ProgramMoves(
        dialect="abb",
        name=name,
        events=tuple(_events(events, process, name)),
        moves=tuple(_move(move, spelt, name, *_limits(events, i)) for i, move in enumerate(moving[0])),
        tools=named
        | {
            key: ProgramTool(_matrix(data.frame), data.mass_kg, np.array(data.centre_of_gravity_mm))
            for key, data in tools.items()
        },
        work_objects=places
        | {key: _matrix(data.user_frame) @ _matrix(data.object_frame) for key, data in objects.items()},
    )


def _stops(moves: tuple[Move, ...], events: tuple[Event, ...], name: str) -> None:
    """The controller runs ahead of a move that blends: what is switched there is switched too early."""
    for event in events:
        if event.before and moves[event.before - 1].zone_mm > 0:
            raise InputError(name, f"line {event.line}: expected a move to 'fine' before this statement")


def _limits(events: tuple[Event, ...], i: int) -> tuple[float, float]:
    """Share of the programmed feeds and largest feed, mm/s, at a move: VelSet's last words before it."""
    said = [event.arguments for event in events if event.instruction == "velset" and event.before <= i]
    percent, most = said[-1] if said else (100.0, np.inf)
    return float(percent) / 100, float(most)


def _events(events: tuple[Event, ...], process: ProcessPart | None, name: str) -> Iterator[ProgramEvent]:
    """What each statement between moves does, by the cell file's names."""
    known = known_events(process)
    plain: dict[str, EventKind] = {"waittime": "wait_time", "velset": "feed_limits", "stop": "stop", "label": "restart"}
    for event in events:
        name_of, switched = (*(str(one).lower() for one in event.arguments[:2]), "", "")[:2]
        use = {"setdo": switched, "waitdi": "wait", "actunit": "unit", "call": "call"}.get(event.instruction, "")
        kind = plain.get(event.instruction) or known.get((use, name_of))
        if kind is None:
            raise InputError(
                name,
                f"line {event.line}: expected a name and a use of the cell file's process section, "
                f"found {event.instruction} {event.arguments[0]}",
            )
        value = ",".join(f"{one:g}" if isinstance(one, float) else one for one in event.arguments)
        yield ProgramEvent(event.line, event.before, kind, value)


def _move(move: Move, spelt: dict[str, str], name: str, share: float, most_mm_s: float) -> ProgramMove:
    target = move.target
    joints = np.array(target.joints_deg) * DEG if isinstance(target, JointTarget) else None
    return ProgramMove(
        line=move.line,
        kind=KINDS[move.instruction],  # type: ignore[arg-type]
        tool=spelt[move.tool.lower()],
        work_object=spelt[move.work_object.lower()],
        joints=joints,
        pose=_of_target(target) if isinstance(target, RobTarget) else None,
        via=None if move.via is None else _of_target(move.via),
        feed_mm_s=min(share * move.feed_mm_s, most_mm_s),
        zone_mm=move.zone_mm,
        turntable=None
        if isinstance(target, OnController)
        else _turntable(target.external_axes, f"{name}: line {move.line}"),
        place=target.name if isinstance(target, OnController) else "",
        configuration=tuple(int(part) for part in target.configuration) if isinstance(target, RobTarget) else None,
    )


def _turntable(axes: tuple[float, ...], where: str) -> float | None:
    """Angle of eax_a in rad; None: it is not there."""
    if any(axis < ABSENT for axis in axes[1:]):
        raise InputError(where, "expected no external axis but eax_a")
    return axes[0] * DEG if axes[0] < ABSENT else None


def _of_target(target: RobTarget) -> Float:
    return _matrix(Pose(target.position_mm, target.quaternion_wxyz))


def _matrix(pose: Pose) -> Float:
    q = np.array(pose.quaternion_wxyz)
    return pose_from(rotation_from_quaternion(q / np.linalg.norm(q)), np.array(pose.position_mm))


# `parse_rapid`: a strict reader for the part of RAPID that milling programs need.
#
# One module with data and procedures without parameters; in them moves, their settings, signals, waits, stops, labels
# and calls. Everything else is refused with its line, as a controller would on loading, or earlier: names that are
# not declared, declared twice, of the wrong type or RAPID's own; quaternions not of unit length; circles that no
# controller can make.
#
# module      = MODULE name {data} {procedure} ENDMODULE data        = [LOCAL | TASK] (CONST | PERS | VAR) type name
# := value ; procedure   = [LOCAL] PROC name ( ) {statement} ENDPROC statement   = move | (ConfL | ConfJ) \ (On | Off)
# ; | CirPathMode \ (PathFrame | ObjectFrame | CirPointOri) ; | SetDO name , (0 | 1) ; | WaitDI name , 1 \ MaxTime :=
# number ; | WaitTime number ; | ActUnit name ; | VelSet number , number ; | Stop ; | name : | name ; move        =
# (MoveL | MoveJ) target , end | MoveC via , target , end | MoveAbsJ target [\ NoEOffs] , end end         = speed ,
# zone , tool [\ WObj := work object] ;
#
# A tool, work object or joint target that the module does not declare is taken for one that the controller has, and
# so are signals, units and procedures.
#
# (ABB, RAPID Overview; RAPID Instructions, Functions and Data types.)

ON_CONTROLLER = ("tooldata", "wobjdata", "jointtarget")  # what a move may name without the module declaring it
LEAST_DISTANCE_MM, LEAST_ANGLE_DEG = 0.1, 1.0  # of MoveC: start to via and target; between these, seen from the start
MOVES = {"movel": "MoveL", "movec": "MoveC", "movej": "MoveJ", "moveabsj": "MoveAbsJ"}
EVENTS = {  # what follows each: names and numbers, signs, one of several words
    "setdo": ("name", ",", "0|1"),
    "waitdi": ("name", ",", "1", "\\", "maxtime", ":=", "number"),
    "waittime": ("number",),
    "actunit": ("name",),
    "velset": ("number", ",", "number"),
    "stop": (),
}
SWITCHES = {"confl": ("on", "off"), "confj": ("on", "off"), "cirpathmode": ("pathframe", "objectframe", "cirpointori")}


def parse_rapid(text: str, name: str = "program") -> RapidProgram:
    """Read a RAPID module.

    Args:
        text: the module.
        name: of its file, for messages.

    Raises:
        InputError: "line 12: expected ..., found ...".
    """
    return _Parser(Tokens(text, name)).module()


class _Parser:
    """One method a rule of the grammar; each steps over what it has read."""

    def __init__(self, tokens: Tokens) -> None:
        self.tokens = tokens
        self.taken = {*TAKEN, *PREDEFINED}  # names in lower case
        self.data: dict[str, tuple[str, Any]] = {"tool0": ("tooldata", TOOL0), "wobj0": ("wobjdata", WOBJ0)}
        self.data |= {name: ("speeddata", (feed, 500.0, 5000.0, 1000.0)) for name, feed in SPEEDS.items()}
        self.data |= {name: ("zonedata", (not zone, zone)) for name, zone in ZONES.items()}

    def module(self) -> RapidProgram:
        self.tokens.take("module")
        module = self.name()
        declared: dict[str, tuple[str, Any]] = {}
        while self.tokens.word() in ("local", "task", "const", "pers", "var") and self.tokens.word(1) != "proc":
            name, kind, value = self.declaration()
            declared[name] = self.data[name.lower()] = (kind, value)
        procedures, events = {}, {}
        while self.tokens.word() in ("local", "proc"):
            name, procedures[name], events[name] = self.procedure()
        self.tokens.take("endmodule")
        self.tokens.take("")
        tools = {name: value for name, (kind, value) in declared.items() if kind == "tooldata"}
        objects = {name: value for name, (kind, value) in declared.items() if kind == "wobjdata"}
        return RapidProgram(module, tools, objects, procedures, events)

    def declaration(self) -> tuple[str, str, Any]:
        scope = self.tokens.take("local", "task") if self.tokens.word() in ("local", "task") else ""
        keeping = self.tokens.take(*(("pers", "var") if scope == "task" else ("const", "pers", "var")))
        kind = self.tokens.take(*SHAPES)
        if kind in ("tooldata", "wobjdata") and keeping != "pers":
            self.tokens.refuse(f"PERS before {kind}", self.tokens.at - 2)
        name = self.name()
        self.tokens.take(":=")
        value = read_value(self.tokens, kind)
        self.tokens.take(";")
        return name, kind, value

    def procedure(self) -> tuple[str, tuple[Move, ...], tuple[Event, ...]]:
        if self.tokens.word() == "local":
            self.tokens.take("local")
        self.tokens.take("proc")
        name = self.name()
        self.tokens.take("(")
        self.tokens.take(")")
        moves: list[Move] = []
        events: list[Event] = []
        while (word := self.tokens.word()) != "endproc":
            if word in MOVES:
                moves.append(self.move(moves[-1].target if moves else None))
            elif word in SWITCHES:
                self.switch()
            elif word in EVENTS or (sign := self.tokens.word(1)) == ":" or (sign == ";" and word not in self.taken):
                line = self.tokens.line(self.tokens.at)
                events.append(Event(*self.event(), len(moves), line))
            else:
                self.tokens.refuse("a move, a setting, a signal, a wait, a stop, a label, a call or ENDPROC")
        self.tokens.take("endproc")
        return name, tuple(moves), tuple(events)

    def event(self) -> tuple[str, tuple[str | float, ...]]:
        """A statement between moves: its instruction and arguments."""
        tokens = self.tokens
        if tokens.word() not in EVENTS:
            kind, name = ("label", self.name()) if tokens.word(1) == ":" else ("call", self.known())
            tokens.take(":" if kind == "label" else ";")
            return kind, (name,)
        word = tokens.take(*EVENTS)
        arguments: list[str | float] = [
            self.known() if part == "name" else self.amount() if part == "number" else tokens.take(*part.split("|"))
            for part in EVENTS[word]
        ]
        tokens.take(";")
        return word, tuple(one for one in arguments if one not in (",", "\\", ":=", "maxtime"))

    def known(self) -> str:
        """The name of something that the controller has."""
        name, key = self.tokens.peek(), self.tokens.word()
        if not IDENTIFIER.fullmatch(name) or key in self.taken:
            self.tokens.refuse("a name that the controller knows and this module has not taken")
        self.tokens.take(key)
        return name

    def amount(self) -> float:
        """A number above 0."""
        begin, value = self.tokens.at, self.tokens.number()
        if value <= 0:
            self.tokens.refuse("a number above 0", begin)
        return value

    def switch(self) -> None:
        word = self.tokens.take(*SWITCHES)
        self.tokens.take("\\")
        self.tokens.take(*SWITCHES[word])
        self.tokens.take(";")

    def move(self, start: RobTarget | JointTarget | OnController | None) -> Move:
        begin, word = self.tokens.at, self.tokens.take(*MOVES)
        via = self.target("robtarget") if word == "movec" else None
        if via:
            self.tokens.take(",")
        target = self.target("jointtarget" if word == "moveabsj" else "robtarget")
        if via and not _is_circle(start, via, target):
            self.tokens.refuse("a circle that can be made through the target before, via and target", begin)
        if word == "moveabsj" and self.tokens.word() == "\\":
            self.tokens.take("\\")
            self.tokens.take("noeoffs")
        speed, _ = self.argument("speeddata")
        zone, _ = self.argument("zonedata")
        _, tool = self.argument("tooldata")
        work_object = self.work_object()
        self.tokens.take(";")
        line = self.tokens.line(begin)
        return Move(MOVES[word], target, via, speed[0], 0.0 if zone[0] else zone[1], tool, work_object, line)

    def target(self, kind: str) -> Any:
        """Written out, or by name."""
        if self.tokens.word() == "[":
            return read_value(self.tokens, kind)
        value, name = self.named(kind)
        return OnController(name) if value is None else value

    def argument(self, kind: str) -> tuple[Any, str]:
        """A comma and the name of declared data: its value and the name as written."""
        self.tokens.take(",")
        return self.named(kind)

    def work_object(self) -> str:
        if self.tokens.word() != "\\":
            return "wobj0"
        for token in ("\\", "wobj", ":="):
            self.tokens.take(token)
        return self.named("wobjdata")[1]

    def named(self, kind: str) -> tuple[Any, str]:
        name, key = self.tokens.peek(), self.tokens.word()
        if kind in ON_CONTROLLER and key not in self.taken and IDENTIFIER.fullmatch(name):
            self.tokens.take(key)
            return None, name
        if key not in self.data:
            self.tokens.refuse(f"the name of a {kind} that is declared")
        if self.data[key][0] != kind:
            self.tokens.refuse(f"a {kind}, not a {self.data[key][0]}")
        self.tokens.take(key)
        return self.data[key][1], name

    def name(self) -> str:
        """A new name; it is taken from now on."""
        name, key = self.tokens.peek(), self.tokens.word()
        if not IDENTIFIER.fullmatch(name):
            self.tokens.refuse("a name: a letter, then letters, digits and _, at most 32 in all")
        if key in self.taken:
            self.tokens.refuse("a name that is not taken")
        self.taken.add(key)
        self.tokens.take(key)
        return name


def _is_circle(start: RobTarget | JointTarget | OnController | None, via: RobTarget, target: RobTarget) -> bool:
    """Whether a controller can make the circle: its points lie apart, and not on a line seen from the start."""
    if not isinstance(start, RobTarget):
        return False
    a, b = (np.subtract(point.position_mm, start.position_mm) for point in (via, target))
    shortest = float(min(np.linalg.norm(a), np.linalg.norm(b)))
    angle = math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))
    return shortest >= LEAST_DISTANCE_MM and LEAST_ANGLE_DEG <= angle / DEG <= 180.0 - LEAST_ANGLE_DEG
