"""RAPID's language: text as words, numbers and signs with their lines, values of its data types, what a module says."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, NoReturn

import numpy as np

from workbench.errors import InputError
from workbench.units import Float

Numbers = tuple[float, ...]
# White space and comments, then one token: a word, a number, a string, `:=`, else any one character; '' at the end.
TOKEN = re.compile(
    r"(?:[ \t\r\n]+|![^\n]*)*([A-Za-z][A-Za-z0-9_]*|[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
    r'|"[^"\\\n]*"|:=|.|\Z)',
    re.DOTALL,
)
LARGEST = 3.4e38  # RAPID's num has single precision
LONGEST_STRING = 80  # characters
SHOWN = 40
NORM_TOLERANCE = 1e-3  # of quaternions (docs/conventions.md)

# What a value of each type consists of; `orient` is a unit quaternion.
POS = ("num",) * 3
POSE = (POS, "orient")
AXES = ("num",) * 6
SHAPES: dict[str, tuple[Any, ...]] = {
    "robtarget": (POS, "orient", ("num",) * 4, AXES),
    "jointtarget": (AXES, AXES),
    "tooldata": ("bool", POSE, ("num", POS, "orient", "num", "num", "num")),
    "wobjdata": ("bool", "bool", "string", POSE, POSE),
    "speeddata": ("num",) * 4,
    "zonedata": ("bool", *("num",) * 6),
}


class Pose(NamedTuple):
    """A frame in another."""

    position_mm: Numbers  # 3
    quaternion_wxyz: Numbers  # 4


class RobTarget(NamedTuple):
    """Where a move leads, in its work object."""

    position_mm: Numbers  # 3
    quaternion_wxyz: Numbers  # 4
    configuration: Numbers  # 4: cf1, cf4, cf6, cfx
    external_axes: Numbers  # 6, deg or mm; 9E+09: not there


class JointTarget(NamedTuple):
    """Where a move of the axes leads."""

    joints_deg: Numbers  # 6
    external_axes: Numbers  # 6


class ToolData(NamedTuple):
    """A tool: its frame in the flange and its load."""

    held_by_robot: bool
    frame: Pose
    mass_kg: float
    centre_of_gravity_mm: Numbers  # 3


class WorkObject(NamedTuple):
    """A work object: the object's frame in the user's, the user's in the world."""

    held_by_robot: bool
    user_frame: Pose
    object_frame: Pose


NO_POSE = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
TOOL0 = ToolData(True, NO_POSE, 0.001, (0.0, 0.0, 0.001))
WOBJ0 = WorkObject(False, NO_POSE, NO_POSE)


class OnController(NamedTuple):
    """A joint target that the module does not declare: the controller has it."""

    name: str


class Event(NamedTuple):
    """A statement between moves: SetDO, WaitDI, WaitTime, ActUnit, VelSet, Stop, label, or call."""

    instruction: str
    arguments: tuple[str | float, ...]
    before: int  # index of the move of the procedure that comes next
    line: int  # of the file, from 1


class Move(NamedTuple):
    """One move: MoveL, MoveC, MoveJ (to a RobTarget) or MoveAbsJ (to joint angles)."""

    instruction: str
    target: RobTarget | JointTarget | OnController
    via: RobTarget | None  # of MoveC
    feed_mm_s: float
    zone_mm: float  # 0: fine
    tool: str
    work_object: str
    line: int  # of the file, from 1


@dataclass(frozen=True, slots=True, eq=False)
class RapidProgram:
    """One module."""

    module: str
    tools: dict[str, ToolData]
    work_objects: dict[str, WorkObject]
    procedures: dict[str, tuple[Move, ...]]
    events: dict[str, tuple[Event, ...]] = field(default_factory=dict)  # by procedure

    @property
    def moves(self) -> tuple[Move, ...]:
        """All moves, procedure after procedure."""
        return tuple(move for moves in self.procedures.values() for move in moves)

    @property
    def poses(self) -> tuple[Float, Float]:
        """Positions (k, 3) in mm and unit quaternions (k, 4) of all targets in space."""
        targets = [move.target for move in self.moves if isinstance(move.target, RobTarget)]
        q = np.array([target.quaternion_wxyz for target in targets]).reshape(-1, 4)
        position = np.array([target.position_mm for target in targets]).reshape(-1, 3)
        return position, q / np.linalg.norm(q, axis=1, keepdims=True)


class Tokens:
    """The tokens of a program from first to last; every complaint names the line."""

    def __init__(self, text: str, name: str) -> None:
        """Split `text`; `name` is the file's, for messages."""
        self.text, self.name, self.at = text, name, 0
        matches = list(TOKEN.finditer(text))
        self.tokens: list[str] = [match.group(1) for match in matches]
        self._starts = [match.start(1) for match in matches]
        self._ends = [match.start() for match in re.finditer("\n", text)]

    def peek(self) -> str:
        """The next token as it stands; '' at the end."""
        return self.tokens[self.at] if self.at < len(self.tokens) else ""

    def word(self, ahead: int = 0) -> str:
        """The next token, or one further ahead, in lower case: RAPID knows no other."""
        return self.tokens[self.at + ahead].lower() if self.at + ahead < len(self.tokens) else ""

    def take(self, *expected: str) -> str:
        """Step over one of `expected` (in lower case) and return it."""
        found = self.tokens[self.at].lower()
        if found not in expected:
            self.refuse(" or ".join(map(repr, expected)))
        self.at += 1
        return found

    def number(self) -> float:
        """Step over a number."""
        token = self.tokens[self.at]
        try:
            value = float(token) if token[-1:] in "0123456789." else None
        except ValueError:
            value = None
        if value is None or abs(value) > LARGEST:
            self.refuse("a number")
        self.at += 1
        return value

    def string(self) -> str:
        """Step over a string."""
        token = self.tokens[self.at]
        if len(token) < 2 or token[0] != '"' or len(token) > LONGEST_STRING + 2:
            self.refuse(f"a string of at most {LONGEST_STRING} characters")
        self.at += 1
        return token[1:-1]

    def refuse(self, expected: str, at: int | None = None) -> NoReturn:
        """Raise InputError: what was expected in place of the next token, or of the one at index `at`."""
        index = self.at if at is None else at
        found = self.tokens[index] if index < len(self.tokens) else ""
        shown = repr(found[:SHOWN]) if found else "the end of the file"
        raise InputError(self.name, f"line {self.line(index)}: expected {expected}, found {shown}")

    def line(self, index: int) -> int:
        """The line, from 1, in which a token begins."""
        at = self._starts[index] if index < len(self._starts) else len(self.text)
        return bisect_right(self._ends, at - 1) + 1


def read_value(tokens: Tokens, kind: str) -> Any:
    """A value of one type, written out; InputError with its line where it is none."""
    begin, value = tokens.at, _record(tokens, SHAPES[kind])
    if kind == "speeddata" and min(value) <= 0:
        tokens.refuse("speeds above 0", begin)
    if kind == "zonedata" and min(value[1:]) < 0:
        tokens.refuse("zones of 0 or more", begin)
    return MAKERS[kind](value) if kind in MAKERS else value


def _record(tokens: Tokens, shape: tuple[Any, ...]) -> tuple[Any, ...]:
    """Parts in brackets, a comma between them."""
    tokens.take("[")
    parts = []
    for i, part in enumerate(shape):
        if i:
            tokens.take(",")
        parts.append(_record(tokens, part) if isinstance(part, tuple) else LEAVES[part](tokens))
    tokens.take("]")
    return tuple(parts)


def _orient(tokens: Tokens) -> tuple[float, ...]:
    begin, q = tokens.at, _record(tokens, ("num",) * 4)
    norm = math.hypot(*q)
    if abs(norm - 1.0) > NORM_TOLERANCE:
        tokens.refuse(f"a quaternion of unit length, not {norm:.6g}", begin)
    return q


def _boolean(tokens: Tokens) -> bool:
    return tokens.take("true", "false") == "true"


LEAVES: dict[str, Callable[[Tokens], Any]] = {
    "num": Tokens.number,
    "bool": _boolean,
    "string": Tokens.string,
    "orient": _orient,
}
MAKERS: dict[str, Callable[[Any], Any]] = {
    "robtarget": RobTarget._make,
    "jointtarget": JointTarget._make,
    "tooldata": lambda v: ToolData(v[0], Pose(*v[1]), v[2][0], v[2][1]),
    "wobjdata": lambda v: WorkObject(v[0], Pose(*v[3]), Pose(*v[4])),
}
