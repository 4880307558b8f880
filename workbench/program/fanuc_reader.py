"""A strict reader for the part of FANUC's TP (`.ls`) that milling programs need.

Sections /PROG, /ATTR, /MN, /POS, /END; in /MN remarks, UFRAME_NUM, UTOOL_NUM, J with P and percent, L and C with P,
mm/sec and FINE or CR, DO[n]=ON and OFF, WAIT DI[n]=ON, WAIT n(sec), PAUSE, LBL[n:name], CALL. The first motion is J; J
goes to joint angles (or the controller's home, PR[n]), L and C to positions in space with a configuration string.
Signals and routines are those of the cell file's process; none stands behind CR. Line numbers and LINE_COUNT must be
right; every P must be there, in the program's own frame and tool, with the groups that DEFAULT_GROUP names. Everything
else is refused with its line.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from workbench.artefacts import ProgramMove, ProgramMoves, ProgramTool
from workbench.program.reading import NAME, NUMBER, Events, Lines, euler_pose, numbers, one_file
from workbench.robot.cell_file import ProcessPart
from workbench.robot.kinematics import Chain
from workbench.robot.wrist import free_joint_3
from workbench.units import DEG, Float

CONFIGURATION = r"CONFIG : '([NF]) ([UD]) ([TB]), (-?\d), (-?\d), (-?\d)',"
COMMA = r",\s*"
AXES = [COMMA.join(f"J{i}= *{NUMBER} deg" for i in three) for three in ((1, 2, 3), (4, 5, 6))]
SPACE = [COMMA.join(f"{c} = *{NUMBER} *{unit}" for c in three) for three, unit in (("XYZ", "mm"), ("WPR", "deg"))]
TERMINATION = r"(FINE|CR(\d+))"


class Position(NamedTuple):
    """One P: joint angles in deg or a pose; the turntable in deg."""

    joints_deg: Float | None
    pose: Float | None
    configuration: tuple[int, ...] | None  # flip, elbow down, back; turns of J1, J4, J6
    turntable_deg: float | None
    numbers: tuple[int, int]  # of frame and tool


EVENT = (
    r"DO\[(\d+)\]=(ON|OFF)|WAIT DI\[(\d+)\]=ON|WAIT (\d+\.\d\d)\(sec\)|(PAUSE)|LBL\[\d+:([A-Za-z0-9_]+)\]|"
    rf"CALL {NAME}"
)


def read_fanuc(
    files: Mapping[str, str], chain: Chain, level_joint_3: bool, process: ProcessPart | None = None
) -> ProgramMoves:
    """Read a TP program from its file, name -> text.

    Args:
        files: one that ends in `.ls`.
        chain: the robot, for the coupling of joints 2 and 3.
        level_joint_3: whether joint 3 counts against the ground on the controller.
        process: whose signals switch what; None: a program that switches any is refused.

    Raises:
        InputError: "line 12: expected ..., found ...".
    """
    name, text = one_file(files, ".ls")
    lines = Lines(text, name, "\0")
    lines.take(rf"/PROG +{NAME}", "/PROG and a name")
    count, groups = _attributes(lines)
    statements = _statements(lines, count)
    positions = _positions(lines, groups)
    lines.end()
    return _Program(lines, positions, chain, level_joint_3, process).read(statements)


def _attributes(lines: Lines) -> tuple[int, int]:
    """LINE_COUNT, and the number of motion groups."""
    lines.take("/ATTR", "/ATTR")
    count = groups = 0
    while not lines.peek().startswith("/"):
        found = lines.take(
            r"(?:TCD: *)?([A-Z_]+) *= *([^;,]*(?:,[1*],[1*],[1*],[1*])?)[;,]", "an attribute and its value"
        )
        if found[1] == "LINE_COUNT":
            count = int(found[2])
        if found[1] == "DEFAULT_GROUP":
            groups = {"1,*,*,*,*": 1, "1,1,*,*,*": 2}.get(found[2].strip(), 0)
    if not groups:
        lines.refuse("DEFAULT_GROUP 1,*,*,*,* or 1,1,*,*,*", lines.peek())
    return count, groups


def _statements(lines: Lines, count: int) -> list[tuple[int, str]]:
    """Lines of /MN with their places; the second point of an arc hangs on its first."""
    lines.take("/MN", "/MN")
    made: list[tuple[int, str]] = []
    while not lines.peek().startswith("/"):
        if made and made[-1][1].startswith("C ") and made[-1][1].count("P[") == 1:
            found = lines.take(r": +(P\[.*?) *;", "the second point of an arc")
            made[-1] = (made[-1][0], f"{made[-1][1]} {found[1]}")
            continue
        found = lines.take(r"(\d+):(.*?) *;|(\d+):(C P\[\d+\])", "a numbered line that ends in ';'")
        if int(found[1] or found[3]) != len(made) + 1:
            lines.refuse(f"line number {len(made) + 1}", found[0])
        made.append((lines.number, (found[2] or found[4]).strip()))
    if len(made) != count:
        lines.refuse(f"LINE_COUNT {len(made)} in /ATTR", str(count))
    return made


def _positions(lines: Lines, groups: int) -> dict[int, Position]:
    lines.take("/POS", "/POS")
    made: dict[int, Position] = {}
    while lines.peek().startswith("P["):
        number = int(lines.take(r"P\[(\d+)\]\{", "P[n]{")[1])
        if number in made:
            lines.refuse("a position that is not there yet", f"P[{number}]")
        made[number] = _position(lines, groups)
    lines.take("/END", "a position or /END")
    return made


def _position(lines: Lines, groups: int) -> Position:
    lines.take("GP1:", "GP1:")
    found = lines.take(rf"UF : (\d+), UT : (\d+),(?: *{CONFIGURATION})?", "UF, UT and a configuration")
    rows, expected = (SPACE, "X, Y, Z and W, P, R") if found[3] else (AXES, "J1 to J6")
    values = [*numbers(lines.take(rows[0] + ",", expected), 1, 3), *numbers(lines.take(rows[1], expected), 1, 3)]
    turntable = None
    if groups == 2:
        lines.take("GP2:", "GP2:")
        lines.take(rf"UF : {found[1]}, UT : {found[2]},", "the same UF and UT")
        turntable = float(lines.take(rf"J1= *{NUMBER} deg", "J1 of group 2 in deg")[1])
    lines.take(r"\};", "};")
    frame = int(found[1]), int(found[2])
    if not found[3]:
        return Position(np.array(values), None, None, turntable, frame)
    said = (int(found[3] == "F"), int(found[4] == "D"), int(found[5] == "B"), *(int(found[i]) for i in (6, 7, 8)))
    return Position(None, euler_pose([*values[:3], *values[:2:-1]]), said, turntable, frame)


class _Program:
    """The statements, one after the other."""

    def __init__(
        self, lines: Lines, positions: dict[int, Position], chain: Chain, level: bool, process: ProcessPart | None
    ) -> None:
        self.lines, self.positions, self.chain, self.level = lines, positions, chain, level
        self.frame: dict[str, int] = {}
        self.declared: dict[str, Float] = {}
        self.register: dict[str, list[float]] = {}
        self.moves: list[ProgramMove] = []
        self.remarks: list[str] = []
        self.home = (process.home.controller_name if process else None) or ""
        self.events = Events(lines, self.moves, process)

    def read(self, statements: list[tuple[int, str]]) -> ProgramMoves:
        for line, text in statements:
            self.lines.number = line
            if text.startswith("!"):
                self.remarks.append(text[1:])
            elif found := re.fullmatch(r"(UFRAME|UTOOL)_NUM=(\d+)", text):
                self.frame[found[1]] = int(found[2])
            elif text.startswith(("PR[", "UFRAME[", "UTOOL[")):
                self.declare(text)
            elif event := re.fullmatch(EVENT, text):
                self.events.tell(event)
            else:
                self.moves.append(self.move(text))
        tools = {move.tool: ProgramTool(self.declared.get(move.tool)) for move in self.moves}
        objects = {move.work_object: self.declared.get(move.work_object) for move in self.moves}
        return ProgramMoves(
            "fanuc", self.lines.name, tuple(self.moves), tools, objects, tuple(self.events.found), tuple(self.remarks)
        )

    def declare(self, text: str) -> None:
        """A frame by way of a position register: LPOS, its six elements in their order, then the frame."""
        place, part = re.fullmatch(r"PR\[(\d+)\]=LPOS", text), re.fullmatch(rf"PR\[(\d+),(\d)\]=\(?{NUMBER}\)?", text)
        whole = re.fullmatch(r"((?:UFRAME|UTOOL)\[\d+\])=PR\[(\d+)\]", text)
        if place and not self.moves:
            self.register[place[1]] = []
        elif part and not self.moves and len(self.register.get(part[1], [0.0] * 9)) == int(part[2]) - 1:
            self.register[part[1]].append(float(part[3]))
        elif whole and not self.frame and len(values := self.register.get(whole[2], [])) == 6:
            self.declared[whole[1]] = euler_pose([*values[:3], *values[:2:-1]])
        else:
            self.lines.refuse("PR[n]=LPOS, its elements 1 to 6 in their order, then a frame, before UFRAME_NUM", text)

    def move(self, text: str) -> ProgramMove:
        lines = self.lines
        if not self.moves or text.startswith("J "):
            return self.by_joints(text)
        found = re.fullmatch(rf"L P\[(\d+)\] {NUMBER}mm/sec {TERMINATION}", text)
        via = None
        if found is None:
            found = re.fullmatch(rf"C P\[(\d+)\] P\[(\d+)\] {NUMBER}mm/sec {TERMINATION}", text)
            if found is None:
                lines.refuse("a motion L or C, UFRAME_NUM, UTOOL_NUM or a remark", text)
            via = self.position(int(found[1]), text)
        end, feed, zone = found.groups()[-4], float(found.groups()[-3]), found.groups()[-1]
        here = self.position(int(end), text)
        if here.pose is None or (via and via.pose is None) or feed <= 0:
            lines.refuse("a speed above 0 and positions in space, with a configuration string", text)
        return ProgramMove(
            lines.number,
            "C" if via else "L",
            *self.names,
            pose=here.pose,
            via=via.pose if via else None,
            feed_mm_s=feed,
            zone_mm=float(zone or 0),
            configuration=here.configuration,
            turntable=None if here.turntable_deg is None else here.turntable_deg * DEG,
        )

    def by_joints(self, text: str) -> ProgramMove:
        """J to a posture."""
        if self.moves and self.moves[-1].zone_mm > 0:
            self.lines.refuse("a move that reaches its target before J", text)
        home = re.fullmatch(r"J (PR\[\d+\]) (\d+)% FINE", text)
        if home and home[1] == self.home and 0 < int(home[2]) <= 100:
            return ProgramMove(self.lines.number, "J", *self.names, joint_speed=int(home[2]) / 100, place=self.home)
        found = re.fullmatch(r"J P\[(\d+)\] (\d+)% FINE", text)
        here = self.position(int(found[1]), text) if found else None
        if not found or not here or here.joints_deg is None or not 0 < int(found[2]) <= 100:
            self.lines.refuse("J to joint angles, 1% to 100%, FINE, as the first motion", text)
        joints = here.joints_deg * DEG
        return ProgramMove(
            self.lines.number,
            "J",
            *self.names,
            joints=free_joint_3(self.chain, joints) if self.level else joints,
            joint_speed=int(found[2]) / 100,
            turntable=None if here.turntable_deg is None else here.turntable_deg * DEG,
        )

    @property
    def names(self) -> tuple[str, str]:
        """Of tool and work object."""
        return f"UTOOL[{self.frame.get('UTOOL')}]", f"UFRAME[{self.frame.get('UFRAME')}]"

    def position(self, number: int, text: str) -> Position:
        here = self.positions.get(number)
        if here is None or {"UFRAME": here.numbers[0], "UTOOL": here.numbers[1]} != self.frame:
            self.lines.refuse("a position of /POS in the program's own frame and tool (UFRAME_NUM, UTOOL_NUM)", text)
        return here
