"""`parse_rapid`: a strict reader for the part of RAPID that milling programs need.

One module with data and procedures without parameters; in them moves, their settings, signals, waits, stops, labels
and calls. Everything else is refused with its line, as a controller would on loading, or earlier: names that are
not declared, declared twice, of the wrong type or RAPID's own; quaternions not of unit length; circles that no
controller can make.

    module      = MODULE name {data} {procedure} ENDMODULE
    data        = [LOCAL | TASK] (CONST | PERS | VAR) type name := value ;
    procedure   = [LOCAL] PROC name ( ) {statement} ENDPROC
    statement   = move | (ConfL | ConfJ) \\ (On | Off) ; | CirPathMode \\ (PathFrame | ObjectFrame | CirPointOri) ;
                | SetDO name , (0 | 1) ; | WaitDI name , 1 \\ MaxTime := number ; | WaitTime number ; | ActUnit name ;
                | VelSet number , number ; | Stop ; | name : | name ;
    move        = (MoveL | MoveJ) target , end | MoveC via , target , end | MoveAbsJ target [\\ NoEOffs] , end
    end         = speed , zone , tool [\\ WObj := work object] ;

A tool, work object or joint target that the module does not declare is taken for one that the controller has, and so
are signals, units and procedures.

(ABB, RAPID Overview; RAPID Instructions, Functions and Data types.)
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from workbench.program.rapid_program import Event, JointTarget, Move, OnController, RapidProgram, RobTarget
from workbench.program.rapid_tokens import Tokens
from workbench.program.rapid_values import SHAPES, TOOL0, WOBJ0, read_value
from workbench.program.rapid_words import IDENTIFIER, PREDEFINED, SPEEDS, TAKEN, ZONES
from workbench.units import DEG

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
