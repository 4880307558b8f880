"""Words of robots' languages: names that a program may have for its own, what a cell's names mean, lines and numbers.

The readers of line-based languages share the latter; their complaints name the line.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NoReturn

import numpy as np

from workbench.artefacts import EventKind, ProgramEvent, ProgramMove
from workbench.errors import InputError
from workbench.geometry.poses import pose_from
from workbench.robot.cell_file import ProcessPart, Signal
from workbench.units import DEG, Float

IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")  # upper and lower case are the same to RAPID
_WORDS = """alias and backward case connect const default div do else elseif endfor endfunc endif endmodule endproc
endrecord endtest endtrap endwhile error exit false for from func goto if inout local mod module nostepin not noview or
pers proc raise readonly record retry return step sysmodule task test then to trap true trynext undo var viewonly while
with xor"""
_INSTRUCTIONS = "movel movec movej moveabsj confl confj cirpathmode setdo waitdi waittime actunit velset stop"
_TYPES = "num bool string pos orient pose robtarget jointtarget tooldata wobjdata loaddata speeddata zonedata"
TAKEN = frozenset(f"{_WORDS} {_INSTRUCTIONS} {_TYPES}".split())
# Data that every controller has; speeds in mm/s, zones in mm.
SPEEDS = {
    f"v{v}": float(v)
    for v in (
        5,
        10,
        20,
        30,
        40,
        50,
        60,
        80,
        100,
        150,
        200,
        300,
        400,
        500,
        600,
        800,
        1000,
        1500,
        2000,
        2500,
        3000,
        4000,
        5000,
        6000,
        7000,
    )
}
ZONES = {"fine": 0.0, "z0": 0.3} | {f"z{z}": float(z) for z in (1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)}
PREDEFINED = frozenset([*SPEEDS, *ZONES, "vmax", "tool0", "wobj0", "load0"])
GENERATED = re.compile(r"(?:p|via|feed|layer|retract)\d+|zonepath", re.IGNORECASE)  # by `program.rapid`
_KRL = """and bas bool brake case char circ circ_rel confirm const continue decl def defdat deffct default do else end
enddat endfct endfor endif endloop endswitch endwhile enum exit ext extfct false for frame global goto halt if
import int interrupt is lin lin_rel loop not or ptp ptp_rel public pulse real repeat resume return sec signal
spline struc switch then to trigger true until wait when while xor"""
_URSCRIPT = """and break continue def else elif end false for global halt if in local loop mod not or return sec thread
true while xor movej movel movec set_tcp set_payload popup sync"""
RESERVED = frozenset(f"{_KRL} {_URSCRIPT}".split()) | TAKEN | PREDEFINED
LONGEST = 24  # KRL's
NUMBERED = re.compile(r"x[pv]\d+|xstart|xpark|xprobe|xretract", re.IGNORECASE)  # positions in KRL

NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
NAME = r"([A-Za-z][A-Za-z0-9_]*)"
SHOWN = 50  # characters of a line that is refused


def free_name(name: str) -> str:
    """`name`, if a program may use it for something of its own; else ValueError."""
    if not IDENTIFIER.fullmatch(name):
        raise ValueError("expected a letter, then letters, digits and _, at most 32 in all")
    if name.lower() in TAKEN | PREDEFINED or GENERATED.fullmatch(name):
        raise ValueError("expected a name that has no meaning in RAPID yet")
    return name


def program_name(name: str) -> str:
    """`name`, if programs of all controllers may have it; else ValueError."""
    spelt = re.fullmatch(rf"[A-Za-z][A-Za-z0-9_]{{0,{LONGEST - 1}}}", name)
    if not spelt or name.lower() in RESERVED or GENERATED.fullmatch(name) or NUMBERED.fullmatch(name):
        raise ValueError(
            f"expected a letter, then letters, digits and _, at most {LONGEST} in all, no word of a robot's language"
        )
    return name


class Lines:
    """A text, line by line; `number` is the line that was taken last, from 1."""

    def __init__(self, text: str, name: str, comment: str) -> None:
        """Split `text`; `name` is the file's, for messages; lines that begin with `comment` become remarks."""
        self.name, self.number = name, 0
        self._lines = text.splitlines()
        self.remarks: list[str] = []
        self._comment = comment

    @property
    def more(self) -> bool:
        """Whether a line is left that says something; comments and empty lines before it are stepped over."""
        while self.number < len(self._lines):
            line = self._lines[self.number].strip()
            if line and not line.startswith(self._comment):
                return True
            if line:
                self.remarks.append(line[len(self._comment) :].strip())
            self.number += 1
        return False

    def peek(self) -> str:
        """The next line that says something; '' at the end."""
        return self._lines[self.number].strip() if self.more else ""

    def take(self, pattern: str, expected: str) -> re.Match[str]:
        """Step over the next line, which must match all of `pattern`."""
        line = self.peek()
        self.number += 1
        found = re.fullmatch(pattern, line)
        if found is None:
            self.refuse(expected, line)
        return found

    def end(self) -> None:
        """Refuse what is left."""
        if self.more:
            self.number += 1
            self.refuse("the end of the file", self._lines[self.number - 1].strip())

    def refuse(self, expected: str, found: str) -> NoReturn:
        """Raise InputError for the line that was taken last."""
        shown = repr(found[:SHOWN]) if found else "the end of the file"
        raise InputError(self.name, f"line {self.number}: expected {expected}, found {shown}")


class Events:
    """What a program does between its moves, as its reader comes to it."""

    def __init__(self, lines: Lines, moves: list[ProgramMove], process: ProcessPart | None) -> None:
        """`moves` grows as the program is read; names are those of the cell's `process`."""
        self.lines, self.moves, self.known = lines, moves, known_events(process)
        self.found: list[ProgramEvent] = []
        self.labels: set[str] = set()

    def add(self, kind: EventKind, value: str) -> None:
        """One that says itself what it is. Controllers run ahead of a move that blends: there it comes too early."""
        if self.moves and self.moves[-1].zone_mm > 0:
            self.lines.refuse("a move that reaches its target before this statement", value or kind)
        self.found.append(ProgramEvent(self.lines.number, len(self.moves), kind, value))

    def use(self, use: str, name: str) -> None:
        """One that is known by the name that it uses (`known_events`)."""
        kind = self.known.get((use, name.lower()))
        if kind is None:
            self.lines.refuse("a name and a use of the cell file's process section", name)
        self.add(kind, name)

    def tell(self, found: re.Match[str]) -> None:
        """One of a dialect's statements: seven groups in this order, one of them found."""
        output, value, awaited, seconds, pause, label, routine = found.groups()
        if output:
            self.use("1" if value == "ON" else "0", output)
        elif awaited:
            self.use("wait", awaited)
        elif seconds:
            self.add("wait_time", seconds)
        elif pause:
            self.add("stop", "")
        elif label:
            if label in self.labels:
                self.lines.refuse("a label that is not taken", label)
            self.labels.add(label)
            self.add("restart", label)
        else:
            self.use("call", routine)


def one_file(files: Mapping[str, str], suffix: str) -> tuple[str, str]:
    """Name and text of the only file with an ending; InputError where there is none or several."""
    found = [name for name in files if name.lower().endswith(suffix)]
    if len(found) != 1:
        raise InputError(", ".join(files) or "program", f"expected one file that ends in {suffix}, found {len(found)}")
    return found[0], files[found[0]]


def numbers(found: re.Match[str], first: int, last: int) -> list[float]:
    """Groups `first` to `last` of a match, as numbers."""
    return [float(found[i]) for i in range(first, last + 1)]


def euler_pose(values: list[float]) -> Float:
    """The pose (4, 4) of X, Y, Z in mm and A, B, C in deg: R = Rz(A) Ry(B) Rx(C)."""
    (ca, cb, cc), (sa, sb, sc) = np.cos(np.array(values[3:]) * DEG), np.sin(np.array(values[3:]) * DEG)
    turn = np.array(
        [
            [ca * cb, ca * sb * sc - sa * cc, ca * sb * cc + sa * sc],
            [sa * cb, sa * sb * sc + ca * cc, sa * sb * cc - ca * sc],
            [-sb, cb * sc, cb * cc],
        ]
    )
    return pose_from(turn, np.array(values[:3]))


def known_events(process: ProcessPart | None) -> dict[tuple[str, str], EventKind]:
    """What each use of a name means, by the cell's file: (use, name in lower case) -> kind.

    Uses: '1' and '0' of an output, 'wait' for an input, 'call' of a routine, 'unit' that is activated.
    """
    if process is None:
        return {}
    spindle = process.spindle
    names: list[tuple[str, Signal | None, EventKind]] = [
        *(("call", hook, "hook") for hook in (*process.before, *process.after)),
        ("1", process.coolant_signal, "coolant_on"),
        ("0", process.coolant_signal, "coolant_off"),
        ("unit", process.mechanical_unit, "activate_axis"),
    ]
    if spindle:
        names += [
            ("1", spindle.on_signal, "spindle_on"),
            ("0", spindle.on_signal, "spindle_off"),
            ("wait", spindle.at_speed_signal, "wait_speed"),
        ]
    return {(use, str(name).lower()): kind for use, name, kind in names if name is not None}
