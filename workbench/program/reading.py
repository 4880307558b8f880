"""What a program does, statement by statement: the reader that all languages share.

A language's own reader has a method for each of its forms; those of what happens between moves are here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, ClassVar, NoReturn

import numpy as np

from workbench.artefacts import EventKind, ProgramEvent, ProgramMove, ProgramMoves, ProgramTool
from workbench.errors import InputError
from workbench.geometry.poses import pose_from, rotation_from_quaternion, rotation_from_rpy
from workbench.language import NUMBER, Language, Said, refuse
from workbench.robot.cell_file import ProcessPart, Signal
from workbench.robot.cell_model import Cell
from workbench.units import DEG, Float


class Reading:
    """A program as its statements come: what holds, and what came of it."""

    language: ClassVar[Language]
    dialect: ClassVar[str] = ""
    suffix: ClassVar[str] = ""  # of its file

    def __init__(self, cell: Cell | None = None) -> None:
        """Names are those of the cell's process; where there is none, a program that switches anything is refused."""
        process = None if cell is None else cell.process
        self.known, self.home = known_events(process), (process.home.controller_name if process else None) or ""
        self.moves: list[ProgramMove] = []
        self.events: list[ProgramEvent] = []
        self.labels: set[str] = set()
        self.name, self.said = "", Said("", {}, 0, "")
        self.tool = self.work_object = ""
        self.tools: dict[str, ProgramTool] = {}
        self.objects: dict[str, Float | None] = {}  # None: the controller has it

    def program(self, files: Mapping[str, str]) -> ProgramMoves:
        """The program of its files, name -> text.

        Raises:
            InputError: no or several such files; "line 12: expected ..., found ...".
        """
        name, text = one_file(files, self.suffix)
        self.run(name, text)
        return ProgramMoves(self.dialect, name, tuple(self.moves), self.tools, self.objects, tuple(self.events))

    def run(self, name: str, text: str) -> None:
        """Read a file: each statement by the method that has its form's name.

        Raises:
            InputError: "line 12: expected ..., found ...".
        """
        self.name = name
        for said in self.language.read(text, name):
            self.said = said
            getattr(self, said.form)(**said.values)

    def refuse(self, expected: str, found: str = "") -> NoReturn:
        """Raise InputError for the statement that was read last."""
        refuse(self.name, self.said.line, expected, found or self.said.text.strip())

    def header(self, *_: Any, **__: Any) -> None:
        """What says nothing of the way."""

    begin = end = header

    # Moves.

    def by_joints(
        self, share: float, joints: Float | None, turntable: Float | float | None = None, place: str = ""
    ) -> None:
        """By the joints, at a share of their largest speeds: to angles (6,), rad, or a place of the controller's."""
        if self.moves and self.moves[-1].zone_mm > 0:
            self.refuse("a move that reaches its target before this one")
        if not 0 < share <= 1:
            self.refuse("a joint speed above 0, and of 100 % at most")
        self.move("J", joint_speed=share, joints=joints, turntable=turntable, place=place)

    def in_space(self, pose: Float, via: Float | None, feed_mm_s: float, zone_mm: float, **more: Any) -> None:
        """Straight, or over `via`, to a pose (4, 4)."""
        if not self.moves:
            self.refuse("a move to joint angles first")
        if feed_mm_s <= 0 or zone_mm < 0:
            self.refuse("a speed above 0 and a zone of 0 or more")
        self.move("L" if via is None else "C", pose=pose, via=via, feed_mm_s=feed_mm_s, zone_mm=zone_mm, **more)

    def move(self, kind: Any, **more: Any) -> None:
        """One move, of the tool and in the frame that hold."""
        external = (more.get("turntable"), *(move.turntable for move in self.moves[-1:]))
        if len({np.size(one) for one in external if one is not None}) > 1:
            self.refuse("as many external axes as in the move before")
        self.moves.append(ProgramMove(self.said.line, kind, self.tool, self.work_object, **more))

    # What happens between them.

    def event(self, kind: EventKind, value: str) -> None:
        """One that says itself what it is. Controllers run ahead of a move that blends: there it comes too early."""
        if self.moves and self.moves[-1].zone_mm > 0:
            self.refuse("a move that reaches its target before this statement")
        self.events.append(ProgramEvent(self.said.line, len(self.moves), kind, value))

    def use(self, use: str, name: str) -> None:
        """One that is known by the name that it uses (`known_events`)."""
        kind = self.known.get((use, name.lower()))
        if kind is None:
            self.refuse("a name and a use of the cell file's process section", name)
        self.event(kind, name)

    def switch_on(self, signal: str) -> None:
        """An output."""
        self.use("1", signal)

    def switch_off(self, signal: str) -> None:
        """An output."""
        self.use("0", signal)

    def wait_speed(self, signal: str) -> None:
        """For an input."""
        self.use("wait", signal)

    def hook(self, value: str) -> None:
        """A routine."""
        self.use("call", value)

    def wait_time(self, seconds: str) -> None:
        """For so long."""
        self.event("wait_time", seconds)

    def stop(self, **_: str) -> None:
        """Until the operator goes on."""
        self.event("stop", "")

    def restart(self, value: str, **_: str) -> None:
        """A label."""
        if value in self.labels:
            self.refuse("a label that is not taken", value)
        self.labels.add(value)
        self.event("restart", value)


def one_file(files: Mapping[str, str], suffix: str) -> tuple[str, str]:
    """Name and text of the only file with an ending; InputError where there is none or several."""
    found = [name for name in files if name.lower().endswith(suffix)]
    if len(found) != 1:
        raise InputError(", ".join(files) or "program", f"expected one file that ends in {suffix}, found {len(found)}")
    return found[0], files[found[0]]


def numbers_in(text: str) -> list[float]:
    """All of a text whose form was looked at."""
    return [float(one) for one in re.findall(NUMBER, text)]


def one_or_all(values: list[float]) -> Float | float | None:
    """Values of external axes as a `ProgramMove` has them; None: there are none."""
    return np.array(values) if len(values) > 1 else next(iter(values), None)


def euler_pose(at: list[float], abc: list[float]) -> Float:
    """The pose (4, 4) of X, Y, Z in mm and A, B, C in deg: R = Rz(A) Ry(B) Rx(C)."""
    return pose_from(rotation_from_rpy(*(np.array(abc) * DEG).tolist()), np.array(at))


def euler_deg(quaternion_wxyz: Float) -> Float:
    """A, B, C (k, 3) in deg with R = Rz(A) Ry(B) Rx(C); where B is +-90 deg only A -+ C counts, and C is 0."""
    r = rotation_from_quaternion(quaternion_wxyz)
    cosine = np.hypot(r[:, 0, 0], r[:, 1, 0])
    level = cosine < 1e-9
    a = np.where(level, np.arctan2(-r[:, 0, 1], r[:, 1, 1]), np.arctan2(r[:, 1, 0], r[:, 0, 0]))
    b = np.arctan2(-r[:, 2, 0], cosine)
    c = np.where(level, 0.0, np.arctan2(r[:, 2, 1], r[:, 2, 2]))
    return np.stack([a, b, c], axis=1) / DEG


def euler_rows(position_mm: Float, quaternion_wxyz: Float, digits_mm: int, digits_deg: int) -> list[list[float]]:
    """X, Y, Z, A, B, C of poses (k, 3), (k, 4), rounded."""
    angles = np.round(euler_deg(quaternion_wxyz), digits_deg)
    rows: list[list[float]] = (np.concatenate([np.round(position_mm, digits_mm), angles], axis=1) + 0.0).tolist()
    return rows


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
