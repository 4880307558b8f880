"""Around the milling, in any dialect: home, approach and retract, spindle, coolant, routines, restart points, stops.

    routines; by the axes home, and to the approach; spindle, wait for its speed, coolant; the path, each layer with a
    stop and a restart point where the process asks for them; straight back; coolant and spindle off; home; routines

What happens between moves are events (`workbench.artefacts.EventKind`), which each dialect writes in its own words.
Every restart point has all that milling needs behind it, so that a program that is started there turns its spindle.
Events follow moves that reach their target only: controllers run ahead of moves that blend.
"""

from __future__ import annotations

import functools
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from workbench.artefacts import EventKind, ProgramMoves
from workbench.dialect import ProgramJob, plain
from workbench.errors import InputError
from workbench.geometry.poses import rotation_from_quaternion
from workbench.language import Language
from workbench.program.reading import Reading
from workbench.program.words import NUMBERED, RESERVED
from workbench.robot.cell_file import ProcessPart
from workbench.robot.cell_model import Cell
from workbench.robot.process import drawn_back, turntable_at_home
from workbench.units import DEG, Float

JOINT_PERCENT = 20  # of the axes' largest speeds, on the way to the first posture
STANDS_DEG = 1e-4  # a turntable that moves by less stands
SWITCHED = ("switch_on", "switch_off", "wait_speed", "wait_time", "stop", "restart", "hook", "end")  # forms of events
Event = tuple[EventKind, str]  # what happens, and the name that it is about
Axes = tuple[Float, Float | None]  # joint angles (6,) and the external axes', deg


@dataclass
class Skeleton:
    """What a process asks for, in the order of the program."""

    job: ProgramJob
    cell: Cell
    process: ProcessPart

    def __post_init__(self) -> None:
        """Refuse one signal for two things."""
        process, spindle = self.process, self.process.spindle
        coolant = process.coolant_signal
        if coolant is not None and spindle and str(coolant).lower() == str(spindle.on_signal).lower():
            raise InputError(f"{self.cell.source}: $.process", "expected different signals of spindle and coolant")

    @functools.cached_property
    def layer_starts(self) -> dict[int, int]:
        """Index of the move that begins a layer -> the layer."""
        if not (self.process.restart or self.process.stop_between_layers):
            return {}
        starts: dict[int, int] = {}
        for i, layer in enumerate(self.job.moves.layer.tolist()):
            if layer and layer not in starts.values():
                starts[max(i, 1)] = layer
        return starts

    @property
    def stops(self) -> set[int]:
        """Indices of the moves that must reach their target: something is switched behind them."""
        return {i - 1 for i in self.layer_starts}

    @functools.cached_property
    def home_deg(self) -> Axes:
        """Joint angles (6,) and the external axes'."""
        home, table = self.process.home, self.job.turntable_deg
        return np.array(home.joints_deg), None if table is None else turntable_at_home(home, table[0])

    @functools.cached_property
    def start_deg(self) -> Axes:
        """The posture from which the tool goes straight to the first target, and the turntable there."""
        table = self.job.turntable_deg
        found = self._off(0, self.process.approach_mm, "approach_mm") / DEG
        return found, None if table is None else table[0]

    @functools.cached_property
    def probe_deg(self) -> Axes | None:
        """The posture in which the operator looks, above the first cutting target, and the turntable; None: no stop."""
        if self.process.probe is None:
            return None
        moves, table = self.job.moves, self.job.turntable_deg
        i = int(np.argmax(moves.cutting))
        found = self._off(i, self.process.probe.distance_mm, "probe.distance_mm") / DEG
        return found, None if table is None else table[i]

    @functools.cached_property
    def retract_joints(self) -> Float:
        """The posture (6,) to which the tool goes straight from the last target, rad."""
        return self._off(-1, self.process.retract_mm, "retract_mm")

    @property
    def retracted(self) -> tuple[Float, Float]:
        """Position (1, 3) and quaternion (1, 4) of the tool there, in the work object."""
        moves = self.job.moves
        axis = rotation_from_quaternion(moves.quaternion_wxyz[-1:])[:, :, 2]
        return moves.position_mm[-1:] - self.process.retract_mm * axis, moves.quaternion_wxyz[-1:]

    def _off(self, i: int, distance_mm: float, which: str) -> Float:
        """The posture with the cutter drawn back along its axis from target i: of all, the nearest to the target's."""
        assert self.job.moves.joints_deg is not None
        found = drawn_back(self.cell, self.job.moves.joints_deg[i] * DEG, distance_mm)
        if found is None:
            raise InputError(
                f"{self.cell.source}: $.process.{which}",
                f"expected a point that the robot reaches, {distance_mm:g} mm along the cutter's axis is none",
            )
        return found

    @property
    def first(self) -> list[Event]:
        """Before anything moves."""
        return [("hook", hook) for hook in self.process.before]

    @property
    def settings(self) -> list[Event]:
        """Of the controller, at the begin and again at every restart point."""
        process, feed = self.process, self.process.feed
        unit: list[Event] = [("activate_axis", process.mechanical_unit)] if process.mechanical_unit else []
        return unit + ([("feed_limits", f"{feed.override_percent:g},{feed.most_mm_s:g}")] if feed else [])

    @property
    def on(self) -> list[Event]:
        """Spindle at speed, then coolant."""
        spindle, coolant = self.process.spindle, self.process.coolant_signal
        said: list[Event] = []
        if spindle:
            speed = spindle.at_speed_signal
            said = [("spindle_on", str(spindle.on_signal))]
            said += [("wait_time", f"{spindle.wait_s:g}")] if speed is None else [("wait_speed", str(speed))]
        return said + ([] if coolant is None else [("coolant_on", str(coolant))])

    @property
    def off(self) -> list[Event]:
        """Coolant, then spindle."""
        spindle, coolant = self.process.spindle, self.process.coolant_signal
        said: list[Event] = [] if coolant is None else [("coolant_off", str(coolant))]
        return said + ([("spindle_off", str(spindle.on_signal))] if spindle else [])

    def layer(self, i: int) -> list[Event]:
        """Where a layer begins with move i: a stop between layers, and a restart point."""
        if i not in self.layer_starts:
            return []
        layer = self.layer_starts[i]
        stop: list[Event] = (
            [*self.off, ("stop", "")] if self.process.stop_between_layers and i != min(self.layer_starts) else []
        )
        again: list[Event] = [("restart", f"layer{layer}"), *self.settings] if self.process.restart else []
        return [*stop, *again, *(self.on if stop or again else [])]

    @property
    def last(self) -> list[Event]:
        """At home again."""
        return [("hook", hook) for hook in self.process.after]


@dataclass
class CellDialect(ABC):
    """A dialect (`workbench.dialect`) by the table of its language: here is the order, there are the words.

    A language has the forms `axes`, `straight`, `circular` for moves, `home_` for one to the controller's own home
    where that is said otherwise, and forms for the events (`switch_on`, `switch_off`, and others by their kind); one
    that has none for a kind says nothing of it.
    """

    job: ProgramJob
    cell: Cell
    language: ClassVar[Language]
    reader: ClassVar[type[Reading]]
    note: ClassVar[str]  # before a remark, up to the end of the line
    home_as: ClassVar[str] = "target"  # what the form of a move to the controller's own home calls it
    by_joints: ClassVar[Mapping[str, float]] = {}  # what the form of a move by the joints says besides

    @abstractmethod
    def place(self, where: int | str) -> dict[str, Any]:
        """Fields that say a place: of a move by its index, of the 'first' target, the 'retract', and of `postures`."""

    @property
    @abstractmethod
    def ends(self) -> list[dict[str, Any]]:
        """Fields that say how each move is made: feed, and how near it comes to its target."""

    def again(self) -> list[str]:
        """What is said again behind a restart point."""
        return []

    def reset(self) -> list[str]:
        """Settings as the controller starts with them, in the end."""
        return []

    def say(self, form: str, **values: Any) -> list[str]:
        """The lines of a form."""
        return self.language.say(form, **values).split("\n")

    def axes(self, where: str) -> list[str]:
        """By the joints: 'home' and 'back' there, 'probe' (where the operator looks), 'start' (of the path)."""
        end, where = self.ends[-1 if where == "back" else 0], "home" if where == "back" else where
        named = self.skeleton.process.home.controller_name if self.skeleton and where == "home" else None
        place = {self.home_as: named} if named else self.place(where)
        form = "home_" if named and "home_" in self.language.forms else "axes"
        return self.say(form, **{**place, **end, **self.by_joints})

    def straight_to(self, where: str) -> list[str]:
        """Straight to the 'first' target, and in the end to the 'retract'."""
        return self.say("straight", **self.place(where), **self.ends[0 if where == "first" else -1])

    def move(self, i: int) -> list[str]:
        """To target i, straight or over its via."""
        form = "circular" if self.job.moves.circular[i] else "straight"
        return self.say(form, **self.place(i), **self.ends[i])

    def fields(self, kind: EventKind, value: str) -> dict[str, Any]:
        """What a form of an event may say."""
        return {"value": value, "signal": value, "seconds": value}

    def event(self, kind: EventKind, value: str) -> list[str]:
        """What happens between moves, in the language's own lines."""
        switched = kind.rpartition("_")[2]
        form = f"switch_{switched}" if switched in ("on", "off") else kind
        said = self.say(form, **self.fields(kind, value)) if form in self.language.forms else []
        return [*said, *(self.again() if kind == "restart" else ())]

    @functools.cached_property
    def skeleton(self) -> Skeleton | None:
        """What the cell's process asks for around the milling; None: its file has none."""
        return None if self.cell.process is None else Skeleton(self.job, self.cell, self.cell.process)

    @functools.cached_property
    def postures(self) -> dict[str, Axes]:
        """To which it goes by the joints: 'home', unless the controller has it, 'probe' and 'start', as they are."""
        skeleton, table = self.skeleton, self.job.turntable_deg
        if skeleton is None:
            assert self.job.moves.joints_deg is not None
            return {"start": (self.job.moves.joints_deg[0], None if table is None else table[0])}
        home = None if skeleton.process.home.controller_name else skeleton.home_deg
        all_ = {"home": home, "probe": skeleton.probe_deg, "start": skeleton.start_deg}
        return {where: angles for where, angles in all_.items() if angles is not None}

    @property
    def halfway_deg(self) -> Float | None:
        """External axes at the middle of each move (k, ...)."""
        table = self.job.turntable_deg
        return None if table is None else np.concatenate([table[:1], (table[1:] + table[:-1]) / 2])

    @property
    def limited_mm_s(self) -> Float:
        """Feeds (k,) within the process' limits, for languages in which a program cannot limit them otherwise."""
        feed, moves = None if self.cell.process is None else self.cell.process.feed, self.job.moves
        return (
            moves.feed_mm_s
            if feed is None
            else np.minimum(moves.feed_mm_s * feed.override_percent / 100, feed.most_mm_s)
        )

    def remark(self, text: str) -> str:
        """A comment, up to the end of the line."""
        return f"{self.note}{text}"

    @functools.cached_property
    def blends(self) -> list[bool]:
        """Whether the next move may blend in before each target (k,): not where something is switched behind it."""
        stops = self.skeleton.stops if self.skeleton else set()
        return [blends and i not in stops for i, blends in enumerate(self.job.blends)]

    def events(self, which: str) -> list[str]:
        """The lines of the skeleton's `first`, `settings`, `on`, `off` or `last`; none without a process."""
        return self.said(getattr(self.skeleton, which)) if self.skeleton else []

    def said(self, events: Iterable[Event]) -> list[str]:
        """The lines of several events."""
        return [line for event in events for line in self.event(*event)]

    def layer(self, i: int) -> list[str]:
        """What stands before move i where a layer begins with it."""
        return self.said(self.skeleton.layer(i)) if self.skeleton else []

    def start(self) -> list[str]:
        """By the joints to the first posture; with a process from home, and straight to the first target."""
        if self.skeleton is None:
            return self.axes("start")
        probe, asked = self.skeleton.process.probe, list[str]()
        if probe is not None:
            ask = f"PROBE: the tip is {probe.distance_mm:g} mm back from where it cuts"
            asked = [*self.axes("probe"), self.remark(plain(ask)), *self.event("stop", "probe")]
        begin = [*self.events("settings"), *self.axes("home"), *asked, *self.axes("start")]
        return [*begin, *self.events("on"), *self.straight_to("first")]

    def straight(self, i: int) -> list[str]:
        """To target i."""
        return [*self.layer(i), *self.move(i)]

    circular = straight

    def foot(self) -> list[str]:
        """With a process back, and home; the end."""
        home = [*self.straight_to("retract"), *self.events("off"), *self.axes("back")] if self.skeleton else []
        return [*home, *self.events("last"), *self.reset(), *self.say("end", name=self.job.name)]

    def read(self, files: Mapping[str, str]) -> ProgramMoves:
        """Turn it back."""
        return self.reader(self.cell).program(files)


class Numbered(CellDialect):
    """A dialect whose positions have numbers: an arc's middle the one before its target's.

    Behind the targets': home, the first target said again, the retract, the probe.
    """

    begin: ClassVar[int]  # number of the first
    by_joints: ClassVar[Mapping[str, float]] = {"percent": JOINT_PERCENT}

    slowest: ClassVar[float] = 0.1  # mm/s: speeds are said in tenths

    def fields(self, kind: EventKind, value: str) -> dict[str, Any]:
        """Seconds in hundredths."""
        return super().fields(kind, value) | {"seconds": f"{float(value):.2f}" if kind == "wait_time" else ""}

    @functools.cached_property
    def feeds(self) -> list[float]:
        """Of the moves, mm/s in tenths, rounded down."""
        tenths: list[float] = np.maximum(np.floor(self.limited_mm_s * 10 + 1e-9) / 10, self.slowest).tolist()
        return tenths

    @functools.cached_property
    def numbers(self) -> list[int]:
        """Of each target's position."""
        last: list[int] = (np.cumsum(1 + self.job.moves.circular.astype(int)) - 1 + self.begin).tolist()
        return last

    def place(self, where: int | str) -> dict[str, Any]:
        """By numbers."""
        if isinstance(where, int):
            return {"via": self.numbers[where] - 1, "target": self.numbers[where]}
        behind = {"home": 1, "first": 2, "retract": 3, "probe": 4}
        return {"target": self.begin if where == "start" else self.numbers[-1] + behind[where]}


def tidy(values: Float, digits: int) -> Any:
    """Rounded, without negative zeros, as lists."""
    return (np.round(values, digits) + 0.0).tolist()


def numbered(cell: Cell, what: str, part: str, kind: str, name: str, digits: str = "+") -> int:
    """The number in the controller's name of a tool or frame: 3 of UTOOL[3]; `part` of the cell file has it."""
    found = re.fullmatch(rf"{kind}\[(\d{digits})\]", name)
    if found is None or (what != "Yaskawa" and not int(found[1])):  # number 0 is flange or world, where there is one
        where = f"{cell.source}: $.{part}.controller_name"
        raise InputError(where, f"expected {kind}[n] for {what}, found {name!r}")
    return int(found[1])


def check_words(
    cell: Cell,
    what: str,
    *,
    signals: str,
    units: bool = False,
    home: tuple[str, str] = (".*", ""),
    words: frozenset[str] = RESERVED,
    taken: re.Pattern[str] = NUMBERED,
) -> None:
    """Refuse what a maker's programs cannot name.

    Args:
        cell: whose process it is; without one there is nothing to refuse.
        what: the controller, for messages.
        signals: 'names', 'numbers', or 'both'.
        units: whether programs activate mechanical units.
        home: pattern of its name on the controller, and in words what is expected.
        words: that mean something to the controller.
        taken: names that the program itself may declare.
    """
    process = cell.process
    if process is None:
        return
    spindle = process.spindle
    where = f"{cell.source}: $.process"
    named = {"coolant_signal": process.coolant_signal}
    if spindle:
        named |= {"spindle.on_signal": spindle.on_signal, "spindle.at_speed_signal": spindle.at_speed_signal}
    for key, signal in named.items():
        if signal is None or signals == "both" or isinstance(signal, int) == (signals == "numbers"):
            continue
        raise InputError(f"{where}.{key}", f"expected one of a signal's {signals} for {what}, found {signal!r}")
    known = process.home.controller_name
    for name in (known, process.mechanical_unit, *process.before, *process.after, *named.values()):
        if isinstance(name, str) and (name.lower() in words or taken.fullmatch(name)):
            raise InputError(where, f"expected a name that has no meaning to {what} yet, found {name!r}")
    if known is not None and not re.fullmatch(home[0], known):
        raise InputError(f"{where}.home.controller_name", f"expected {home[1]} for {what}, found {known!r}")
    if process.mechanical_unit and not units:
        raise InputError(f"{where}.mechanical_unit", f"expected null for {what}: its programs activate no unit")


def check_standing_turntable(job: ProgramJob, cell: Cell, why: str) -> None:
    """Refuse a turntable that turns along the path, or stands elsewhere at home; `why` a program cannot drive it."""
    table, process = job.turntable_deg, cell.process
    if table is None:
        return
    span = float(np.ptp(table))
    if span > STANDS_DEG:
        raise InputError(
            "program.write",
            f"expected a turntable that stands: along this path it turns by {span:.3g} deg, and {why}",
        )
    if process is not None and abs(turntable_at_home(process.home, table[0]) - table[0]) > STANDS_DEG:
        raise InputError(
            f"{cell.source}: $.process.home.turntable_deg",
            f"expected the angle at which the turntable stands along the path, {table[0]:.4f}",
        )
