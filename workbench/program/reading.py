"""What the readers of line-based languages share: lines, numbers, complaints that name the line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NoReturn

import numpy as np

from workbench.artefacts import EventKind, ProgramEvent, ProgramMove
from workbench.errors import InputError
from workbench.geometry.poses import pose_from
from workbench.program.skeleton import known_events
from workbench.robot.cell_file import ProcessPart
from workbench.units import DEG, Float

NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
NAME = r"([A-Za-z][A-Za-z0-9_]*)"
SHOWN = 50  # characters of a line that is refused


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
        """One that is known by the name that it uses (`workbench.program.skeleton.known_events`)."""
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
