"""TP, FANUC's language, as an ASCII file (`.ls`).

(FANUC Robot series R-30iB, Operator's Manual: motion instructions, position data.) Targets are X, Y, Z in mm and R =
Rz(R) Ry(P) Rx(W) with W, P, R in deg, in a user frame, for a tool: the controller's own by their numbers, where the
cell names them ("UTOOL[3]"), else declared by way of a position register. The configuration string has F or N (wrist
flipped or not), D or U (elbow down or up), B or T (behind or before axis 1), and how often J1, J4, J6 went beyond
+-180 deg. The program begins with J to the first posture, whose J3 counts against the ground (`level_joint_3`). The
turntable is motion group 2. Speeds are mm/sec in tenths, rounded down. A target is FINE, or CR with the zone in whole
mm where the controller has that option, or CNT100 where the cell file says in what time a move reaches its feed: the
one move's end and the next one's begin then share that time, so the corner is a parabola from feed * time / 2 before
the target to as much behind it.

Read back strictly, and no more of it than milling programs need: sections /PROG, /ATTR, /MN, /POS, /END; in /MN
remarks, UFRAME_NUM, UTOOL_NUM, J with P and percent, L and C with P, mm/sec and FINE, CR or CNT100, DO[n]=ON and OFF,
WAIT DI[n]=ON, WAIT n(sec), PAUSE, LBL[n:name], CALL. The first motion is J; J goes to joint angles (or the controller's
home, PR[n]), L and C to positions in space with a configuration string. Signals and routines are those of the cell
file's process; none stands behind CR. Line numbers and LINE_COUNT must be right; every P must be there, in the
program's own frame and tool, with the groups that DEFAULT_GROUP names. Everything else is refused with its line.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from workbench.artefacts import EventKind, ProgramMove, ProgramMoves, ProgramTool
from workbench.errors import InputError
from workbench.program.krl import euler_deg
from workbench.program.skeleton import CellDialect, check_words, limited
from workbench.program.words import NAME, NUMBER, Events, Lines, euler_pose, numbers, one_file
from workbench.robot.cell import DIGITS, Cell
from workbench.robot.wrist import arm_sides, free_joint_3, level_joint_3
from workbench.units import DEG, Float

DECLARED, REGISTER = 9, 99  # numbers of tool and frame, and of the position register, where a program declares them
JOINT_PERCENT = 20  # of the axes' largest speeds, on the way to the first posture
ATTRIBUTES = """OWNER = MNEDITOR;
PROG_SIZE = 0;
FILE_NAME = ;
VERSION = 0;
LINE_COUNT = {lines};
MEMORY_SIZE = 0;
PROTECT = READ_WRITE;
TCD:  STACK_SIZE = 0,
      TASK_PRIORITY = 50,
      TIME_SLICE = 0,
      BUSY_LAMP_OFF = 0,
      ABORT_REQUEST = 0,
      PAUSE_REQUEST = 0;
DEFAULT_GROUP = {groups};
CONTROL_CODE = 00000000 00000000;"""
CONFIGURATION = r"CONFIG : '([NF]) ([UD]) ([TB]), (-?\d), (-?\d), (-?\d)',"
COMMA = r",\s*"
AXES = [COMMA.join(f"J{i}= *{NUMBER} deg" for i in three) for three in ((1, 2, 3), (4, 5, 6))]
SPACE = [COMMA.join(f"{c} = *{NUMBER} *{unit}" for c in three) for three, unit in (("XYZ", "mm"), ("WPR", "deg"))]
TERMINATION = r"(FINE|CNT100|CR(\d+))"


@dataclass
class Fanuc(CellDialect):
    """The dialect of FANUC's controllers."""

    def __post_init__(self) -> None:
        """Refuse feeds that its tenths of mm/sec cannot say without being faster."""
        if self.job.moves.feed_mm_s.min() < 0.1:
            raise InputError(
                "program.write",
                f"expected feeds of 0.1 mm/s or more for FANUC, found {self.job.moves.feed_mm_s.min():.3g}",
            )
        process = self.cell.process
        if process is None:
            return
        check_words(self.cell, process, "FANUC", signals="numbers")
        home = process.home.controller_name
        if home is not None and (not re.fullmatch(r"PR\[\d+\]", home) or home == f"PR[{REGISTER}]"):
            where = f"{self.cell.source}: $.process.home.controller_name"
            raise InputError(where, f"expected a position register PR[n] but {REGISTER} for FANUC, found {home!r}")

    def event(self, kind: EventKind, value: str) -> list[str]:
        """What happens between moves: DO[n], WAIT DI[n], WAIT (sec), PAUSE, LBL, CALL.

        The termination before is FINE, and WAIT waits without end. Feeds are limited where they are written.
        """
        words: dict[EventKind, list[str]] = {
            "hook": [f"CALL {value.upper()}"],
            "stop": ["PAUSE"],
            "feed_limits": [],
            "wait_speed": [f"WAIT DI[{value}]=ON"],
        }
        if kind == "wait_time":
            return [f"WAIT {float(value):.2f}(sec)"]
        if kind == "restart":
            return [f"LBL[{value.removeprefix('layer')}:{value}]", *self._numbers]
        switched = {"on": "ON", "off": "OFF"}.get(kind.rpartition("_")[2])
        return [f"DO[{value}]={switched}"] if switched else words[kind]

    @property
    def _numbers(self) -> list[str]:
        """Of frame and tool: hold until others are said."""
        return [f"UFRAME_NUM={self.frame[0]}", f"UTOOL_NUM={self.frame[1]}"]

    @functools.cached_property
    def ends(self) -> list[str]:
        """All that stands behind the target of each move: speed and termination."""
        controller, moves = self.cell.controller, self.job.moves
        region = math.floor(self.job.zone_mm) if controller and controller.corner_region else 0
        feeds = np.maximum(np.floor(limited(moves.feed_mm_s, self.cell) * 10 + 1e-9) / 10, 0.1)
        length = np.linalg.norm(np.diff(moves.position_mm, axis=0), axis=1)
        room = np.minimum(np.minimum(np.append(0.0, length), np.append(length, 0.0)) / 2, self.job.zone_mm)
        within = (continuous_mm(self.cell, feeds) <= room) & (np.append(feeds[1:], 0.0) <= feeds)
        rounded = [f"CR{region}" if region else "CNT100" if free else "FINE" for free in within.tolist()]
        ends = [end if blends else "FINE" for end, blends in zip(rounded, self.blends, strict=True)]
        return [f"{feed:.1f}mm/sec {end}" for feed, end in zip(feeds.tolist(), ends, strict=True)]

    @functools.cached_property
    def frame(self) -> tuple[int, int]:
        """Numbers of the user frame and of the tool."""
        return self._number("UFRAME", self.job.work_object_name), self._number("UTOOL", self.job.tool_name)

    def _number(self, what: str, name: str | None) -> int:
        found = re.fullmatch(rf"{what}\[(\d+)\]", f"{what}[{DECLARED}]" if name is None else name)
        if found is None:
            raise InputError(f"{self.cell.source}: controller_name", f"expected {what}[n] for FANUC, found {name!r}")
        return int(found[1])

    def head(self) -> Iterator[str]:
        """Remarks; frame and tool, as far as the program declares them; their numbers."""
        job, (frame, tool) = self.job, self.frame
        yield from (self.remark(remark) for remark in job.remarks)
        yield from self.said(self.skeleton.first) if self.skeleton else ()
        if job.work_object_name is None:
            yield from _declared(f"UFRAME[{frame}]", *job.work_object)
        if job.tool_name is None:
            yield from _declared(f"UTOOL[{tool}]", job.tool_centre_point_mm, job.tool.quaternion_wxyz)
        yield from self._numbers

    def start(self) -> Iterable[str]:
        """By the joints to the first posture; with a process from home, and straight to the first target."""
        start = f"J P[1] {JOINT_PERCENT}% FINE"
        if self.skeleton is None:
            return [start]
        first = f"L P[{self.numbers[-1] + 2}] {self.ends[0]}"
        probe = self.probed(f"J P[{self.numbers[-1] + 4}] {JOINT_PERCENT}% FINE")
        return [self._home, *probe, start, *self.said(self.skeleton.on), first]

    @property
    def _home(self) -> str:
        assert self.skeleton is not None
        place = self.skeleton.process.home.controller_name or f"P[{self.numbers[-1] + 1}]"
        return f"J {place} {JOINT_PERCENT}% FINE"

    def straight(self, i: int) -> Iterable[str]:
        """L."""
        return [*self.layer(i), f"L P[{self.numbers[i]}] {self.ends[i]}"]

    def circular(self, i: int) -> Iterable[str]:
        """C."""
        return [*self.layer(i), f"C P[{self.numbers[i] - 1}]", f"P[{self.numbers[i]}] {self.ends[i]}"]

    def remark(self, text: str) -> str:
        """Up to the end of the line; FANUC takes 32 characters."""
        return f"!{text}"

    def foot(self) -> Iterable[str]:
        """With a process back, and home."""
        skeleton = self.skeleton
        if skeleton is None:
            return []
        retract = f"L P[{self.numbers[-1] + 3}] {self.ends[-1]}"
        return [retract, *self.said(skeleton.off), self._home, *self.said(skeleton.last)]

    @functools.cached_property
    def numbers(self) -> list[int]:
        """Of each target's position; an arc's middle has the one before. Behind: home, first, retract, probe."""
        numbers: list[int] = np.cumsum(1 + self.job.moves.circular.astype(int)).tolist()
        return numbers

    def read(self, files: Mapping[str, str]) -> ProgramMoves:
        """Turn it back."""
        return read_fanuc(files, self.cell)

    def configuration(self, joints: Float, cell: Cell) -> tuple[int, ...]:
        """Flip, elbow down, back, and the turns of J1, J4, J6 of a posture (6,), rad."""
        said = configuration(cell, joints[None])[0].replace(",", "").split()
        return (*(int(a == b) for a, b in zip(said, "FDB", strict=False)), *map(int, said[3:]))

    @property
    def level(self) -> bool:
        """Whether joint 3 counts against the ground."""
        return levelled(self.cell)

    def documents(self, text: str) -> dict[str, str]:
        """Attributes, numbered lines, positions."""
        lines = list(self._numbered(text.splitlines()))
        groups = "1,*,*,*,*" if self.job.turntable_deg is None else "1,1,*,*,*"
        count = sum(not line.startswith("    :") for line in lines)
        name = self.job.name.upper()
        attributes = ATTRIBUTES.format(lines=count, groups=groups)
        content = [f"/PROG  {name}", "/ATTR", attributes, "/MN", *lines, "/POS", *self._positions(), "/END", ""]
        return {f"{name}.ls": "\r\n".join(content).replace("\r\n", "\n").replace("\n", "\r\n")}

    def _numbered(self, lines: list[str]) -> Iterator[str]:
        """Lines with numbers; remarks in pieces, the second point of an arc without."""
        number = 0
        for line in lines:
            if line.startswith("P["):
                yield f"    :  {line}    ;"
                continue
            pieces = [line] if line[0] != "!" else [f"!{piece}" for piece in cut(line[1:], 32)]
            for piece in pieces:
                number += 1
                motion = piece[:2] in ("J ", "L ", "C ")
                end = "" if piece.startswith("C ") else "    ;"
                yield f"{number:4d}:{'' if motion else '  '}{piece}{end}"

    def _positions(self) -> Iterator[str]:
        moves, turned = self.job.moves, self.job.turntable_deg
        assert moves.joints_deg is not None
        joints = moves.joints_deg * DEG
        configurations = configuration(self.cell, joints)
        here = place(moves.position_mm, moves.quaternion_wxyz)
        via = place(moves.via_position_mm, moves.via_quaternion_wxyz)
        half = None if turned is None else np.append(turned[:1], (turned[1:] + turned[:-1]) / 2)
        skeleton, first = self.skeleton, None if turned is None else float(turned[0])
        start = (moves.joints_deg[0], first) if skeleton is None else skeleton.start_deg
        yield from self._position(1, "", self._axes(start[0]), start[1])
        for i, number in enumerate(self.numbers[1:], 1):
            if moves.circular[i]:
                between = None if half is None else half[i]
                yield from self._position(number - 1, configurations[i], spelled(via[i]), between)
            yield from self._position(
                number, configurations[i], spelled(here[i]), None if turned is None else turned[i]
            )
        if skeleton is None:
            return
        if not skeleton.process.home.controller_name:
            home = skeleton.home_deg
            yield from self._position(self.numbers[-1] + 1, "", self._axes(home[0]), home[1])
        yield from self._position(self.numbers[-1] + 2, configurations[0], spelled(here[0]), first)
        (back,), (said,) = place(*skeleton.retracted), configuration(self.cell, skeleton.retract_joints[None])
        last = None if turned is None else turned[-1]
        yield from self._position(self.numbers[-1] + 3, said, spelled(back), last)
        if skeleton.probe_deg is not None:
            probe = skeleton.probe_deg
            yield from self._position(self.numbers[-1] + 4, "", self._axes(probe[0]), probe[1])

    def _axes(self, joints_deg: Float) -> list[str]:
        """Joint angles (6,) as the controller counts them: two lines of a position."""
        shown = level_joint_3(self.cell.chain, joints_deg[None])[0] if self.level else joints_deg
        rows = [f"J{j}= {angle:.{DIGITS}f} deg" for j, angle in enumerate((np.round(shown, DIGITS) + 0.0).tolist(), 1)]
        return [",\t".join(rows[:3]) + ",", ",\t".join(rows[3:])]

    def _position(self, number: int, said: str, values: list[str], turned: float | None) -> Iterator[str]:
        frame, tool = self.frame
        yield from (f"P[{number}]{{", "   GP1:", f"\tUF : {frame}, UT : {tool},{said and f'  CONFIG : {said!r},'}")
        yield from (f"\t{value}" for value in values)
        if turned is not None:
            yield from (
                "   GP2:",
                f"\tUF : {frame}, UT : {tool},",
                f"\tJ1= {round(float(turned), DIGITS) + 0.0:.{DIGITS}f} deg",
            )
        yield "};"


def _declared(name: str, position_mm: Float, quaternion_wxyz: Float) -> Iterator[str]:
    """A frame by way of a position register, which takes the robot's place first so that it is one in space."""
    yield f"PR[{REGISTER}]=LPOS"
    for i, value in enumerate(place(position_mm[None], quaternion_wxyz[None])[0].tolist(), 1):
        yield f"PR[{REGISTER},{i}]={value:.{DIGITS}f}" if value >= 0 else f"PR[{REGISTER},{i}]=({value:.{DIGITS}f})"
    yield f"{name}=PR[{REGISTER}]"


def levelled(cell: Cell) -> bool:
    """Whether joint 3 counts against the ground on the cell's controller."""
    return cell.controller.level_joint_3 if cell.controller else True


def continuous_mm(cell: Cell, feed_mm_s: Float) -> Float:
    """From a target, where CNT100 begins to blend at feeds (k,); inf where the cell does not tell the time of it."""
    time_s = None if cell.controller is None else cell.controller.acceleration_s
    return np.full(np.shape(feed_mm_s), np.inf) if time_s is None else feed_mm_s * time_s / 2


def configuration(cell: Cell, joints: Float) -> list[str]:
    """FANUC's configuration strings of postures (n, 6), rad."""
    sides = arm_sides(cell.chain, joints)
    turns = np.floor((np.round(joints[:, [0, 3, 5]] / DEG, DIGITS) + 180) / 360).astype(int)
    letters = np.where(sides[:, ::-1], list("FDB"), list("NUT"))
    rows = zip(letters.tolist(), turns.tolist(), strict=True)
    return [f"{' '.join(said)}, {', '.join(map(str, times))}" for said, times in rows]


def place(position_mm: Float, quaternion_wxyz: Float) -> Float:
    """X, Y, Z, W, P, R (k, 6): mm and deg, rounded."""
    turned = euler_deg(quaternion_wxyz)[:, ::-1]
    return np.asarray(np.round(np.concatenate([position_mm, turned], axis=1), DIGITS) + 0.0)


def spelled(values: Float) -> list[str]:
    """A position's two lines."""
    texts = [
        f"{name} = {value:.{DIGITS}f} {'mm' if name in 'XYZ' else 'deg'}"
        for name, value in zip("XYZWPR", values.tolist(), strict=True)
    ]
    return [",\t".join(texts[:3]) + ",", ",\t".join(texts[3:])]


def cut(text: str, longest: int) -> list[str]:
    """A text in pieces, at blanks where there are some."""
    pieces = [""]
    for word in text.split(" "):
        if pieces[-1] and len(pieces[-1]) + 1 + len(word) > longest:
            pieces.append("")
        pieces[-1] = f"{pieces[-1]} {word}" if pieces[-1] else word
        while len(pieces[-1]) > longest:
            pieces[-1:] = [pieces[-1][:longest], pieces[-1][longest:]]
    return pieces


# The reader.


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


def read_fanuc(files: Mapping[str, str], cell: Cell) -> ProgramMoves:
    """Read a TP program from its file, name -> text.

    Args:
        files: one that ends in `.ls`.
        cell: its robot, for the coupling of joints 2 and 3; its controller; its process' signals.

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
    return _Program(lines, positions, cell).read(statements)


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

    def __init__(self, lines: Lines, positions: dict[int, Position], cell: Cell) -> None:
        self.lines, self.positions, self.cell, process = lines, positions, cell, cell.process
        self.frame: dict[str, int] = {}
        self.declared: dict[str, Float] = {}
        self.register: dict[str, list[float]] = {}
        self.runs_on = False  # the move before ends in CNT100
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
        end, feed, zone = found.groups()[-4], float(found.groups()[-3]), float(found.groups()[-1] or 0)
        here = self.position(int(end), text)
        if here.pose is None or (via and via.pose is None) or feed <= 0:
            lines.refuse("a speed above 0 and positions in space, with a configuration string", text)
        if self.runs_on and feed > (self.moves[-1].feed_mm_s or 0.0):
            lines.refuse("no faster a move behind CNT100: it would begin to blend earlier", text)
        self.runs_on = found.groups()[-2] == "CNT100"
        if self.runs_on:
            zone = float(continuous_mm(self.cell, np.array(feed)))
            if not np.isfinite(zone):
                lines.refuse("FINE or CR: the cell file does not say by what CNT rounds ($.controller)", text)
        return ProgramMove(
            lines.number,
            "C" if via else "L",
            *self.names,
            pose=here.pose,
            via=via.pose if via else None,
            feed_mm_s=feed,
            zone_mm=zone,
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
            joints=free_joint_3(self.cell.chain, joints) if levelled(self.cell) else joints,
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
