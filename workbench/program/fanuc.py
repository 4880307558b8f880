"""TP, FANUC's language, as an ASCII file (`.ls`).

(FANUC Robot series R-30iB, Operator's Manual: motion instructions, position data.) Targets are X, Y, Z in mm and R =
Rz(R) Ry(P) Rx(W) with W, P, R in deg, in a user frame, for a tool: the controller's own by their numbers, where the
cell names them ("UTOOL[3]"), else declared by way of a position register. The configuration string has F or N (wrist
flipped or not), D or U (elbow down or up), B or T (behind or before axis 1), and how often J1, J4, J6 went beyond +-180
deg. The program begins with J to the first posture, whose J3 counts against the ground (`level_joint_3`). The turntable
is motion group 2 (J1, or J1 and J2: tilt and turntable), a track E1 of group 1. Speeds are mm/sec in tenths, rounded
down. A target is FINE, or CR with the zone in whole mm where the controller has that option, or CNT100 where the cell
file says in what time a move reaches its feed: the one move's end and the next one's begin then share that time, so the
corner is a parabola from feed * time / 2 before the target to as much behind it. Feeds are limited where they are
written, and WAIT waits without end.

Read back with right line numbers and LINE_COUNT, and every P in the program's own frame and tool, with the groups that
DEFAULT_GROUP names.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from workbench.artefacts import EventKind, ProgramTool
from workbench.errors import InputError
from workbench.geometry.moves import chords_mm
from workbench.language import NUMBER, Language, refuse
from workbench.program.reading import Reading, euler_pose, euler_rows, one_or_all
from workbench.program.skeleton import SWITCHED, Numbered, check_words, numbered, tidy
from workbench.robot.cell_model import DIGITS, Cell
from workbench.robot.collision import sliding
from workbench.robot.wrist import arm_sides, free_joint_3, level_joint_3
from workbench.units import DEG, Float

DECLARED, REGISTER = 9, 99  # numbers of tool and frame, and of the position register, where a program declares them
HEADER = """/PROG  {name}
/ATTR
OWNER = MNEDITOR;
PROG_SIZE = 0;
FILE_NAME = ;
VERSION = 0;
LINE_COUNT = {lines:d};
MEMORY_SIZE = 0;
PROTECT = READ_WRITE;
TCD:  STACK_SIZE = 0,
      TASK_PRIORITY = 50,
      TIME_SLICE = 0,
      BUSY_LAMP_OFF = 0,
      ABORT_REQUEST = 0,
      PAUSE_REQUEST = 0;
DEFAULT_GROUP = {groups};
CONTROL_CODE = 00000000 00000000;
/MN"""
JOINTS = ",\n\t".join(
    ",\t".join(f"J{j}= {{joints[{j - 1}]:.{DIGITS}f}} deg" for j in three) for three in ((1, 2, 3), (4, 5, 6))
)
SPACE = ",\n\t".join(
    ",\t".join(f"{axis} = {{{field}[{i}]:.{DIGITS}f}} {unit}" for i, axis in enumerate(axes))
    for axes, field, unit in (("XYZ", "at", "mm"), ("WPR", "wpr", "deg"))
)
SECOND = f"\n   GP2:\n\tUF : {{frame_2:d}}, UT : {{tool_2:d}},\n\tJ1= {{turntable[0]:.{DIGITS}f}} deg"
THIRD = f",\tJ2= {{turntable[1]:.{DIGITS}f}} deg"
EXTENDED = f",\n\tE1= {{turntable[0]:.{DIGITS}f}} mm"
ALONE, BOTH = "1,*,*,*,*", "1,1,*,*,*"  # motion groups
MORE = {"": "", "_3": SECOND + THIRD, "_2": SECOND, "_e": EXTENDED}  # of a position, by the form's ending
BODY = ("straight", "circular", "axes", "home_", *SWITCHED)
PROGRAM = Language(
    forms={
        "header": HEADER,
        "declare": f"PR[{REGISTER}]=LPOS\n"
        + "".join(f"PR[{REGISTER},{i + 1}]={{element[{i}]}}\n" for i in range(6))
        + f"{{place}}=PR[{REGISTER}]",
        "numbers": "UFRAME_NUM={frame:d}\nUTOOL_NUM={tool:d}",
        "axes": "J P[{target:d}] {percent:d}% FINE",
        "home_": "J {register} {percent:d}% FINE",
        "straight": "L P[{target:d}] {feed:.1f}mm/sec {near}",
        "circular": "C P[{via:d}]\nP[{target:d}] {feed:.1f}mm/sec {near}",
        "switch_on": "DO[{signal}]=ON",
        "switch_off": "DO[{signal}]=OFF",
        "wait_speed": "WAIT DI[{signal}]=ON",
        "wait_time": "WAIT {seconds}(sec)",
        "stop": "PAUSE",
        "restart": "LBL[{number}:{value}]",
        "hook": "CALL {value}",
        "end": "/POS",
    },
    order={
        "": ("header",),
        "header": ("hook", "declare", "numbers"),
        "declare": ("declare", "numbers"),
        "numbers": BODY,
        "restart": ("numbers",),
        "end": (),
    },
    kinds={
        "groups": "|".join(map(re.escape, (ALONE, BOTH))),
        "element": rf"\(-{NUMBER}\)|{NUMBER}",
        "place": r"(?:UFRAME|UTOOL)\[[0-9]+\]",
        "register": r"PR\[[0-9]+\]",
        "near": "FINE|CNT100|CR[0-9]+",
        "signal": "[0-9]+",
        "seconds": r"[0-9]+\.[0-9][0-9]",
        "number": "[0-9]+",
    },
    comment="!",
)
FRAMES = "P[{number:d}]{{\n   GP1:\n\tUF : {frame:d}, UT : {tool:d},"
CONFIGURATION = "  CONFIG : '{flip} {elbow} {back}, {turns[0]:d}, {turns[1]:d}, {turns[2]:d}',"
POSITIONS = Language(
    forms={
        f"{form}{ending}": f"{FRAMES}{said}\n\t{values}{more}\n}}}};"
        for form, said, values in (("axes", "", JOINTS), ("target", CONFIGURATION, SPACE))
        for ending, more in MORE.items()
    }
    | {"end": "/END"},
    order={"": (*(f"{form}{ending}" for form in ("target", "axes") for ending in MORE), "end"), "end": ()},
    kinds={"flip": "[FN]", "elbow": "[DU]", "back": "[BT]", "turns": "-?[0-9]"},
)


class Position(NamedTuple):
    """One P: joint angles in rad or a pose; the external axes in rad."""

    joints: Float | None
    pose: Float | None
    configuration: tuple[int, ...] | None
    turntable: Float | float | None
    numbers: tuple[int, int]  # of frame and tool


class _Positions(Reading):
    """Section /POS."""

    language = POSITIONS

    def __init__(self, cell: Cell) -> None:
        super().__init__()
        self.cell, self.found = cell, dict[int, Position]()

    def axes(self, number: int, frame: int, tool: int, joints: list[float], **second: Any) -> None:
        angles = np.array(joints) * DEG
        free = free_joint_3(self.cell.chain, angles) if levelled(self.cell) else angles
        self._add(number, (frame, tool), (free, None, None), **second)

    def target(self, number: int, frame: int, tool: int, at: list[float], wpr: list[float], **more: Any) -> None:
        said = coded(*(more.pop(key) for key in ("flip", "elbow", "back", "turns")))
        self._add(number, (frame, tool), (None, euler_pose(at, wpr[::-1]), said), **more)

    axes_2, target_2 = axes_3, target_3 = axes_e, target_e = axes, target

    def _add(self, number: int, numbers: tuple[int, int], values: tuple[Any, Any, Any], **second: Any) -> None:
        if number in self.found:
            self.refuse("a position that is not there yet", f"P[{number}]")
        if second and self.said.form[-2:] != _ending(self.cell):
            self.refuse("E1 in mm where the robot stands on a track, else J1 of group 2, and J2 where it tilts")
        if "frame_2" in second and (second["frame_2"], second["tool_2"]) != numbers:
            self.refuse("the same UF and UT of both groups")
        turntable = one_or_all([value * DEG for value in second.get("turntable", ())])
        self.found[number] = Position(*values, turntable, numbers)


class Program(Reading):
    """Sections /PROG, /ATTR and /MN of a TP program, with its positions, for the robot and the controller of a cell."""

    language, dialect, suffix = PROGRAM, "fanuc", ".ls"
    runs_on = False  # the move before ends in CNT100

    def __init__(self, cell: Cell) -> None:
        super().__init__(cell)
        self.cell, self.declared, self.frame = cell, dict[str, Float](), (0, 0)

    def run(self, name: str, text: str) -> None:
        """Positions first."""
        lines, self.count = _without_numbers(name, text.splitlines())
        end = lines.index("/POS") + 1 if "/POS" in lines else len(lines)
        positions = _Positions(self.cell)
        positions.run(name, "\n".join([*[""] * end, *lines[end:]]))
        self.positions = positions.found
        super().run(name, "\n".join(lines[:end]))

    def header(self, name: str, lines: int, groups: str) -> None:
        if lines != self.count:
            self.refuse(f"LINE_COUNT {self.count} in /ATTR", str(lines))
        self.second = groups == BOTH or sliding(self.cell)
        if groups == BOTH and sliding(self.cell):
            self.refuse("group 1 alone, whose E1 is the track", groups)

    def declare(self, element: list[str], place: str) -> None:
        values = [float(one.strip("()")) for one in element]
        self.declared[place] = euler_pose(values[:3], values[:2:-1])

    def numbers(self, frame: int, tool: int) -> None:
        self.frame, self.tool, self.work_object = (frame, tool), f"UTOOL[{tool}]", f"UFRAME[{frame}]"
        self.tools[self.tool] = ProgramTool(self.declared.get(self.tool))
        self.objects[self.work_object] = self.declared.get(self.work_object)

    def axes(self, target: int, percent: int) -> None:
        here = self._position(target)
        if here.joints is None:
            self.refuse("J to joint angles")
        self.by_joints(percent / 100, here.joints, here.turntable)

    def home_(self, register: str, percent: int) -> None:
        if register != self.home:
            self.refuse("the position register of the cell file's home", register)
        self.by_joints(percent / 100, None, place=register)

    def straight(self, target: int, feed: float, near: str, via: int | None = None) -> None:
        here, over = self._position(target), None if via is None else self._position(via)
        if here.pose is None or (over and over.pose is None):
            self.refuse("positions in space, with a configuration string")
        if self.runs_on and feed > (self.moves[-1].feed_mm_s or 0.0):
            self.refuse("no faster a move behind CNT100: it would begin to blend earlier")
        self.runs_on = near == "CNT100"
        cnt_mm = float(continuous_mm(self.cell, np.array(feed))) if self.runs_on else 0.0
        zone = float(near[2:]) if near.startswith("CR") else cnt_mm
        if not np.isfinite(zone):
            self.refuse("FINE or CR: the cell file does not say by what CNT rounds ($.controller)")
        more = {"turntable": here.turntable, "configuration": here.configuration}
        self.in_space(here.pose, over.pose if over else None, feed, zone, **more)

    circular = straight

    def _position(self, number: int) -> Position:
        here = self.positions.get(number)
        if here is None or here.numbers != self.frame or (here.turntable is not None) != self.second:
            self.refuse("a position of /POS in the program's own frame, tool and groups", f"P[{number}]")
        return here


def _without_numbers(name: str, lines: list[str]) -> tuple[list[str], int]:
    """The lines without the numbers and ends that those of /MN have, and how many have a number."""
    made, number, inside = list[str](), 0, False
    for place, line in enumerate(map(str.strip, lines), 1):
        inside = line == "/MN" or (inside and not line.startswith("/"))
        found = re.fullmatch(r"(\d+):(.*?) *;|(\d+):(C P\[\d+\])|: *(P\[.*?) *;", line) if inside else None
        if (inside and line not in ("/MN", "") and found is None) or (not inside and line.startswith("!")):
            refuse(name, place, f"line number {number + 1}, a statement and ';'" if inside else "no remark", line)
        if found and not found[5]:
            number += 1
            if int(found[1] or found[3]) != number:
                refuse(name, place, f"line number {number}", line)
        made.append(line if found is None else (found[2] or found[4] or found[5] or "").strip())
    return made, number


@dataclass
class Fanuc(Numbered):
    """The dialect of FANUC's controllers."""

    language, reader, note = PROGRAM, Program, "!"
    begin, home_as = 1, "register"

    def __post_init__(self) -> None:
        """Refuse feeds that its tenths of mm/sec cannot say without being faster."""
        if self.job.moves.feed_mm_s.min() < self.slowest:
            raise InputError(
                "program.write",
                f"expected feeds of 0.1 mm/s or more for FANUC, found {self.job.moves.feed_mm_s.min():.3g}",
            )
        register = rf"PR\[(?!{REGISTER}\])\d+\]", f"a position register PR[n] but {REGISTER}"
        check_words(self.cell, "FANUC", signals="numbers", home=register)

    def fields(self, kind: EventKind, value: str) -> dict[str, Any]:
        """A label has a number; other programs' names are in capitals."""
        said = value.upper() if kind == "hook" else value
        return super().fields(kind, value) | {"value": said, "number": value.removeprefix("layer")}

    def again(self) -> list[str]:
        """The numbers of frame and tool: they hold until others are said."""
        return self.say("numbers", frame=self.frame[0], tool=self.frame[1])

    @functools.cached_property
    def ends(self) -> list[dict[str, Any]]:
        """All that stands behind the target of each move: speed and termination."""
        controller, moves, feeds = self.cell.controller, self.job.moves, np.array(self.feeds)
        region = math.floor(self.job.zone_mm) if controller and controller.corner_region else 0
        length = chords_mm(moves.position_mm)
        room = np.minimum(np.minimum(np.append(0.0, length), np.append(length, 0.0)) / 2, self.job.zone_mm)
        within = (continuous_mm(self.cell, feeds) <= room) & (np.append(feeds[1:], 0.0) <= feeds)
        rounded = [f"CR{region}" if region else "CNT100" if free else "FINE" for free in within.tolist()]
        ends = [end if blends else "FINE" for end, blends in zip(rounded, self.blends, strict=True)]
        return [{"feed": feed, "near": end} for feed, end in zip(feeds.tolist(), ends, strict=True)]

    @functools.cached_property
    def frame(self) -> tuple[int, int]:
        """Numbers of the user frame and of the tool."""
        named = ("work_object", "UFRAME", self.job.work_object_name), ("tool", "UTOOL", self.job.tool_name)
        frame, tool = (
            DECLARED if name is None else numbered(self.cell, "FANUC", part, kind, name) for part, kind, name in named
        )
        return frame, tool

    def head(self) -> Iterator[str]:
        """Remarks; frame and tool, as far as the program declares them; their numbers."""
        job, (frame, tool) = self.job, self.frame
        yield from (self.remark(remark) for remark in job.remarks)
        yield from self.events("first")
        if job.work_object_name is None:
            yield from _declared(f"UFRAME[{frame}]", *job.work_object)
        if job.tool_name is None:
            yield from _declared(f"UTOOL[{tool}]", job.tool_centre_point_mm, job.tool.quaternion_wxyz)
        yield from self.again()

    def configuration(self, joints: Float, cell: Cell) -> tuple[int, ...]:
        """Flip, elbow down, back, and the turns of J1, J4, J6 of a posture (6,), rad."""
        return coded(*configuration(cell, joints[None])[0].values())

    def documents(self, text: str) -> dict[str, str]:
        """Attributes, numbered lines, positions."""
        *said, end = text.splitlines()
        lines = list(self._numbered(said))
        ending = "" if self.job.turntable_deg is None else _ending(self.cell)
        group = BOTH if ending in ("_2", "_3") else ALONE
        count, name = sum(not line.startswith("    :") for line in lines), self.job.name.upper()
        header = PROGRAM.say("header", name=name, lines=count, groups=group)
        content = "\n".join([header, *lines, end, *self._positions(ending), "/END", ""])
        return {f"{name}.ls": content.replace("\n", "\r\n")}

    def _numbered(self, lines: list[str]) -> Iterator[str]:
        """Lines with numbers; remarks in pieces of 32 characters, the second point of an arc without."""
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

    def _positions(self, group: str) -> Iterator[str]:
        moves, turntable, skeleton = self.job.moves, self.job.turntable_deg, self.skeleton
        assert moves.joints_deg is not None
        configurations = configuration(self.cell, moves.joints_deg * DEG)
        here = euler_rows(moves.position_mm, moves.quaternion_wxyz, DIGITS, DIGITS)
        via = euler_rows(moves.via_position_mm, moves.via_quaternion_wxyz, DIGITS, DIGITS)
        none = [None] * len(here)
        table, half = (none if all_ is None else list(all_) for all_ in (turntable, self.halfway_deg))

        def said(form: str, number: int, angle: Float | None, **more: Any) -> str:
            frame, tool = self.frame
            seen = [] if angle is None else tidy(np.atleast_1d(angle), DIGITS)
            same = {"frame": frame, "frame_2": frame, "tool": tool, "tool_2": tool, "turntable": seen}
            return POSITIONS.say(f"{form}{group}", number=number, **same, **more)

        def axes(where: str) -> str:
            joints_deg, angle = self.postures[where]
            level = levelled(self.cell)
            shown = level_joint_3(self.cell.chain, joints_deg[None])[0] if level else joints_deg
            return said("axes", self.place(where)["target"], angle, joints=tidy(shown, DIGITS))

        def target(number: int, values: list[float], posture: dict[str, Any], angle: Float | None) -> str:
            return said("target", number, angle, at=values[:3], wpr=values[:2:-1], **posture)

        yield axes("start")
        for i, number in enumerate(self.numbers[1:], 1):
            if moves.circular[i]:
                yield target(number - 1, via[i], configurations[i], half[i])
            yield target(number, here[i], configurations[i], table[i])
        if skeleton is None:
            return
        last = self.numbers[-1]
        if "home" in self.postures:
            yield axes("home")
        yield target(last + 2, here[0], configurations[0], table[0])
        (back,) = euler_rows(*skeleton.retracted, DIGITS, DIGITS)
        (posture,) = configuration(self.cell, skeleton.retract_joints[None])
        yield target(last + 3, back, posture, table[-1])
        if "probe" in self.postures:
            yield axes("probe")


def _declared(name: str, position_mm: Float, quaternion_wxyz: Float) -> list[str]:
    """A frame by way of a position register, which takes the robot's place first so that it is one in space."""
    (row,) = euler_rows(position_mm[None], quaternion_wxyz[None], DIGITS, DIGITS)
    numbers = [f"{value:.{DIGITS}f}" for value in (*row[:3], *row[:2:-1])]
    element = [f"({one})" if one.startswith("-") else one for one in numbers]
    return PROGRAM.say("declare", element=element, place=name).split("\n")


def _ending(cell: Cell) -> str:
    """Of the forms that positions have with the cell's external axes."""
    return "_e" if sliding(cell) else "_3" if len(cell.axes) > 1 else "_2"


def levelled(cell: Cell) -> bool:
    """Whether joint 3 counts against the ground on the cell's controller."""
    part = cell.controller
    return part is None or (part.dialect == "fanuc" if part.level_joint_3 is None else part.level_joint_3)


def continuous_mm(cell: Cell, feed_mm_s: Float) -> Float:
    """From a target, where CNT100 begins to blend at feeds (k,); inf where the cell does not tell the time of it."""
    time_s = None if cell.controller is None else cell.controller.acceleration_s
    return np.full(np.shape(feed_mm_s), np.inf) if time_s is None else feed_mm_s * time_s / 2


def configuration(cell: Cell, joints: Float) -> list[dict[str, Any]]:
    """What FANUC's configuration strings say of postures (n, 6), rad."""
    sides = arm_sides(cell.chain, joints)
    turns = np.floor((np.round(joints[:, [0, 3, 5]] / DEG, DIGITS) + 180) / 360).astype(int)
    letters = np.where(sides[:, ::-1], list("FDB"), list("NUT"))
    rows = zip(letters.tolist(), turns.tolist(), strict=True)
    return [dict(zip(("flip", "elbow", "back", "turns"), (*said, times), strict=True)) for said, times in rows]


def coded(flip: str, elbow: str, back: str, turns: list[int]) -> tuple[int, ...]:
    """Flip, elbow down, back; turns of J1, J4, J6."""
    return (int(flip == "F"), int(elbow == "D"), int(back == "B"), *turns)


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
