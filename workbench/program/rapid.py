"""RAPID, ABB's language: the path as a module (ABB, RAPID Overview; RAPID Instructions, Functions and Data types).

Targets in mm and quaternions w x y z, in the work object; unused external axes 9E+09. Positions have 4 decimals,
quaternions 8: the rounding stays below 0.0001 mm and 0.00001 deg, less than the controller's own single precision.
Feeds have 3 significant digits, one speeddata each. Where the moves rest on postures the program begins with MoveAbsJ
to the first one, the tool is the cell's, targets are in the base, and the turntable is the external axis eax_a, or
eax_b behind its tilt. Every target says its axis configuration, and the controller monitors it (ConfL\\On): a restart
in another posture is stopped. Circular moves turn the tool in the frame of the work object
(`CirPathMode\\ObjectFrame`), as `path.simplify` assumes. A WaitDI that waits longer than its MaxTime stops the program.

Read back is the module as it is written. Refused as by a controller on loading, or earlier: names that are declared
twice, of the wrong type or RAPID's own; quaternions not of unit length; circles that no controller can make; external
axes beyond eax_b. A tool, work object or joint target that the module does not declare is one that the controller has,
and so are signals, units and procedures.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.artefacts import EventKind, Moves, ProgramTool
from workbench.dialect import rounded_feeds
from workbench.geometry.poses import pose_from, rotation_from_quaternion
from workbench.language import NUMBER, Language, row
from workbench.program.reading import Reading, one_or_all
from workbench.program.skeleton import SWITCHED, CellDialect, check_words, tidy
from workbench.program.words import GENERATED, IDENTIFIER, PREDEFINED, TAKEN
from workbench.robot.cell_model import Cell
from workbench.robot.wrist import arm_sides
from workbench.units import DEG, Float, Int

TURN_DEG_S = 50  # where the orientation alone moves
UNUSED = "9E+09"  # an external axis that is not there
ABSENT = 9e8  # an external axis beyond this is not there (9E+09 in single precision)
LEAST_DISTANCE_MM, LEAST_ANGLE_DEG = 0.1, 1.0  # of MoveC: start to via and target; between these, seen from the start
NORM_TOLERANCE = 1e-3  # of quaternions (docs/conventions.md)


def _elements(field: str, count: int, spec: str) -> str:
    return f"[{row([''] * count, field, spec)}]"


TARGET = (
    f"[{_elements('at', 3, '.4f')},{_elements('turn', 4, '.8f')},{_elements('cf', 4, '')},{_elements('axes', 6, '')}]"
)
JOINTS = f"[{_elements('joints', 6, '.4f')},{_elements('axes', 6, '')}]"
POSE = f"[{_elements('at', 3, '.4f')},{_elements('turn', 4, '.8f')}]"
LOAD = f"[{{mass:g}},{_elements('centre', 3, '.4f')},[1,0,0,0],0,0,0]"
END = "{speed},{zone},{tool}\\WObj:={object};"
DATA = ("tooldata", "wobjdata", "zonedata", "speeddata", "robtarget", "jointtarget")
BODY = ("straight", "circular", "axes", "activate_axis", "feed_limits", *SWITCHED)
MODULE = Language(
    forms={
        "module": "MODULE {name}",
        "tooldata": f"  PERS tooldata {{name}}:=[TRUE,{POSE},{LOAD}];",
        "wobjdata": f'  TASK PERS wobjdata {{name}}:=[FALSE,TRUE,"",{POSE},[[0,0,0],[1,0,0,0]]];',
        "zonedata": "  CONST zonedata {name}:=[FALSE," + row([""] * 6, "zones", "g") + "];",
        "speeddata": f"  CONST speeddata {{name}}:=[{{feed:.7g}},{TURN_DEG_S},5000,1000];",
        "robtarget": f"  CONST robtarget {{name}}:={TARGET};",
        "jointtarget": f"  CONST jointtarget {{name}}:={JOINTS};",
        "procedure": "  PROC {name}()",
        "modes": "    ConfJ\\Off;\n    ConfL\\On;\n    CirPathMode\\ObjectFrame;",
        "axes": f"    MoveAbsJ {{target}}\\NoEOffs,{END}",
        "straight": f"    MoveL {{target}},{END}",
        "circular": f"    MoveC {{via}},{{target}},{END}",
        "switch_off": "    SetDO {signal},0;",
        "switch_on": "    SetDO {signal},1;",
        "wait_speed": "    WaitDI {signal},1\\MaxTime:={longest:g};",
        "wait_time": "    WaitTime {seconds};",
        "activate_axis": "    ActUnit {value};",
        "feed_limits": "    VelSet {percent:g},{most:g};",
        "stop": "    Stop;",
        "restart": "    {value}:",
        "hook": "    {value};",
        "end": "    CirPathMode\\PathFrame;\n    ConfJ\\On;\n  ENDPROC\nENDMODULE",
    },
    order={
        "": ("module",),
        "module": (*DATA, "procedure"),
        "procedure": ("modes", "hook"),
        "modes": BODY,
        "restart": ("modes",),
        "end": (),
    },
    kinds={"cf": "-?[0-9]+", "axes": NUMBER, "seconds": NUMBER},
    comment="!",
)
MODES = MODULE.say("modes").split("\n")
NAMES = {"home": "jHome", "probe": "jProbe", "start": "jStart", "first": "p1", "retract": "retract1"}


class Module(Reading):
    """A module with one procedure that moves, statement by statement.

    The turntable is the external axis eax_a, or eax_b on a tilt that is eax_a; it turns what stands on it, the work
    object stays in the base.
    """

    language, dialect, suffix = MODULE, "abb", ".mod"

    def __init__(self, cell: Cell | None = None) -> None:
        super().__init__(cell)
        self.objects["wobj0"] = np.eye(4)
        self.data: dict[str, tuple[str, str, Any]] = {"fine": ("fine", "zonedata", 0.0)}  # by names in lower case
        self.share, self.most = 1.0, np.inf  # of the programmed feeds; mm/s

    # Names and data.

    def _declare(self, name: str, value: Any = None) -> None:
        if name.lower() in TAKEN | PREDEFINED | self.data.keys():
            self.refuse("a name that is not taken", name)
        self.data[name.lower()] = (name, self.said.form, value)

    module = procedure = _declare

    def _named(self, kind: str, name: str) -> Any:
        """What a name stands for; None: the controller has it."""
        known = kind in ("tooldata", "wobjdata", "jointtarget")
        spelt, found, value = self.data.get(name.lower(), (name, kind if known else "", None))
        if spelt != name:
            self.refuse(f"'{spelt}', as it is declared", name)
        if found != kind:
            self.refuse(f"a {kind}, not a {found}" if found else f"the name of a {kind} that is declared", name)
        return value

    def _pose(self, at: list[float], turn: list[float]) -> Float:
        norm = math.hypot(*turn)
        if abs(norm - 1.0) > NORM_TOLERANCE:
            self.refuse(f"a quaternion of unit length, not {norm:.6g}")
        return pose_from(rotation_from_quaternion(np.array(turn) / norm), np.array(at))

    def tooldata(self, name: str, at: list[float], turn: list[float], mass: float, centre: list[float]) -> None:
        self._declare(name)
        self.tools[name] = ProgramTool(self._pose(at, turn), mass, np.array(centre))

    def wobjdata(self, name: str, at: list[float], turn: list[float]) -> None:
        self._declare(name)
        self.objects[name] = self._pose(at, turn)

    def speeddata(self, name: str, feed: float) -> None:
        self._above_0(feed)
        self._declare(name, feed)

    def zonedata(self, name: str, zones: list[float]) -> None:
        if min(zones) < 0:
            self.refuse("zones of 0 or more")
        self._declare(name, zones[0])

    def robtarget(self, name: str, at: list[float], turn: list[float], cf: list[str], axes: list[str]) -> None:
        self._declare(name, (self._pose(at, turn), tuple(map(int, cf)), self._turntable(axes)))

    def jointtarget(self, name: str, joints: list[float], axes: list[str]) -> None:
        self._declare(name, (np.array(joints) * DEG, self._turntable(axes)))

    def _turntable(self, axes: list[str]) -> Float | float | None:
        """Angle of eax_a in rad, or of eax_a and eax_b (2,); None: there are none."""
        values = [float(one) for one in axes]
        there = [value * DEG for value in values if value < ABSENT]
        if len(there) > 2 or min(values[len(there) :]) < ABSENT:
            self.refuse("no external axes but eax_a, and eax_b behind it", ",".join(axes))
        return one_or_all(there)

    # Statements.

    modes = Reading.header

    def _end(self, speed: str, zone: str, tool: str, object: str) -> dict[str, Any]:
        """Feed and zone; tool and work object hold."""
        self._named("tooldata", tool)
        self._named("wobjdata", object)
        self.tools.setdefault(tool, ProgramTool(None))
        self.objects.setdefault(object, None)
        self.tool, self.work_object = tool, object
        feed = min(self.share * self._named("speeddata", speed), self.most)
        return {"feed_mm_s": feed, "zone_mm": self._named("zonedata", zone)}

    def axes(self, target: str, **end: str) -> None:
        found = self._named("jointtarget", target)
        joints, turntable = found or (None, None)
        self.move("J", joints=joints, turntable=turntable, place="" if found else target, **self._end(**end))

    def straight(self, target: str, via: str = "", **end: str) -> None:
        pose, configuration, turntable = self._named("robtarget", target)
        over = self._named("robtarget", via)[0] if via else None
        start = self.moves[-1].pose if self.moves else None
        if over is not None and (start is None or not _is_circle(start, over, pose)):
            self.refuse("a circle that can be made through the target before, via and target")
        self.in_space(pose, over, **self._end(**end), configuration=configuration, turntable=turntable)

    circular = straight

    def use(self, use: str, name: str) -> None:
        """Nothing that the module has taken."""
        if name.lower() in self.data:
            self.refuse("a name that the controller knows and this module has not taken", name)
        super().use(use, name)

    def wait_speed(self, signal: str, longest: float) -> None:  # type: ignore[override]
        self._above_0(longest)
        self.use("wait", signal)

    def wait_time(self, seconds: str) -> None:
        self._above_0(float(seconds))
        self.event("wait_time", seconds)

    def activate_axis(self, value: str) -> None:
        self.use("unit", value)

    def feed_limits(self, percent: float, most: float) -> None:
        self._above_0(min(percent, most))
        self.share, self.most = percent / 100, most
        self.event("feed_limits", f"{percent:g},{most:g}")

    def restart(self, value: str, **_: str) -> None:
        self._declare(value)
        self.event("restart", value)

    def _above_0(self, number: float) -> None:
        if number <= 0:
            self.refuse("a number above 0")


def _is_circle(start: Float, via: Float, target: Float) -> bool:
    """Whether a controller can make the circle: its points lie apart, and not on a line seen from the start."""
    a, b = via[:3, 3] - start[:3, 3], target[:3, 3] - start[:3, 3]
    shortest = float(min(np.linalg.norm(a), np.linalg.norm(b)))
    angle = math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))
    return shortest >= LEAST_DISTANCE_MM and LEAST_ANGLE_DEG <= angle / DEG <= 180.0 - LEAST_ANGLE_DEG


@dataclass
class Rapid(CellDialect):
    """The dialect of ABB's controllers."""

    procedure: str
    tool_name: str
    work_object_name: str
    language, reader, note = MODULE, Module, "    ! "

    def __post_init__(self) -> None:
        """Refuse names of the process that mean something in RAPID."""
        home = IDENTIFIER.pattern, "the name of a jointtarget"
        words = TAKEN | PREDEFINED
        check_words(self.cell, "ABB", signals="names", units=True, home=home, words=words, taken=GENERATED)

    def fields(self, kind: EventKind, value: str) -> dict[str, Any]:
        """A longest wait stops the program; feed limits are two numbers."""
        spindle = self.cell.process.spindle if self.cell.process else None
        percent, most = map(float, value.split(",")) if kind == "feed_limits" else (0.0, 0.0)
        more = {"longest": spindle.wait_s if spindle else 0.0, "percent": percent, "most": most}
        return {**super().fields(kind, value), **more}

    def again(self) -> list[str]:
        """The modes."""
        return MODES

    @functools.cached_property
    def feeds(self) -> tuple[Float, Int]:
        """The distinct feeds in mm/s, and which of them each move has."""
        distinct, which = np.unique(rounded_feeds(self.job.moves.feed_mm_s), return_inverse=True)
        return distinct, which

    @functools.cached_property
    def ends(self) -> list[dict[str, str]]:
        """All that stands behind the target of each move: speed, zone, tool and work object."""
        which = self.feeds[1].tolist()
        zones = ["zonePath" if blends else "fine" for blends in self.blends]
        tool, place = self.job.tool_name or self.tool_name, self.job.work_object_name or self.work_object_name
        tail = {"tool": tool, "object": place}
        return [{"speed": f"feed{w + 1}", "zone": zone, **tail} for w, zone in zip(which, zones, strict=True)]

    def head(self) -> Iterator[str]:
        """Declarations: tool, work object, zone, speeds, targets."""
        job, moves, z = self.job, self.job.moves, self.job.zone_mm
        tool = {"mass": job.tool.mass_kg, "centre": tidy(job.tool.centre_of_gravity_mm, 4)}
        yield MODULE.say("module", name=job.name)
        yield from (f"  ! {remark}" for remark in job.remarks)
        if job.tool_name is None:
            frame = _spelt(job.tool_centre_point_mm, job.tool.quaternion_wxyz)
            yield MODULE.say("tooldata", name=self.tool_name, **frame, **tool)
        if job.work_object_name is None:
            yield MODULE.say("wobjdata", name=self.work_object_name, **_spelt(*job.work_object))
        if z:
            yield MODULE.say("zonedata", name="zonePath", zones=[z, z, z, z / 10, z, z / 10])
        for i, feed in enumerate(self.feeds[0].tolist(), 1):
            yield MODULE.say("speeddata", name=f"feed{i}", feed=feed)
        assert moves.joints_deg is not None
        said, all_ = configurations(self.cell, moves.joints_deg * DEG), np.arange(len(moves.layer))
        yield from _targets("p", all_, moves.position_mm, moves.quaternion_wxyz, job.turntable_deg, said)
        arcs, said = np.flatnonzero(moves.circular), configurations(self.cell, _joints_on_arcs(moves))
        yield from _targets("via", arcs, moves.via_position_mm, moves.via_quaternion_wxyz, self.halfway_deg, said)
        for where, (angles, table) in self.postures.items():
            yield MODULE.say("jointtarget", name=NAMES[where], joints=tidy(angles, 4), axes=_external(table))
        if skeleton := self.skeleton:
            last = None if job.turntable_deg is None else job.turntable_deg[-1:]
            said = configurations(self.cell, skeleton.retract_joints[None])
            yield from _targets("retract", np.array([0]), *skeleton.retracted, last, said)
        yield MODULE.say("procedure", name=self.procedure)
        yield from (*self.events("first"), *MODES)

    def place(self, where: int | str) -> dict[str, Any]:
        """By names."""
        return (
            {"via": f"via{where + 1}", "target": f"p{where + 1}"}
            if isinstance(where, int)
            else {"target": NAMES[where]}
        )

    def start(self) -> list[str]:
        """Exactly to the first target, without a process too."""
        return super().start() if self.skeleton else [*self.axes("start"), *self.straight_to("first")]

    def reset(self) -> list[str]:
        """Feeds without limits."""
        limited = self.skeleton and self.skeleton.process.feed
        return self.say("feed_limits", percent=100, most=5000) if limited else []

    def configuration(self, joints: Float, cell: Cell) -> tuple[int, ...]:
        """cf1, cf4, cf6, cfx of a posture (6,), rad."""
        return tuple(configurations(cell, joints[None])[0].tolist())

    def documents(self, text: str) -> dict[str, str]:
        """One module."""
        return {f"{self.job.name}.mod": text}


def configurations(cell: Cell, joints: Float) -> Int:
    """cf1, cf4, cf6, cfx (n, 4) of postures (n, 6), rad (ABB, RAPID Data types: confdata).

    cf1, cf4, cf6: the quarter turns of joints 1, 4 and 6, from 0 on upwards and from -1 on downwards. cfx: wrist centre
    behind axis 1 (4), behind the lower arm (2), joint 5 negative (1).
    """
    quarters = np.floor(np.round(joints[:, [0, 3, 5]] / DEG, 3) / 90.0).astype(int)
    sides = arm_sides(cell.chain, joints)
    return np.column_stack([quarters, sides @ np.array([4, 2, 1])])


def _external(turntable_deg: Float | None) -> list[str]:
    said = [] if turntable_deg is None else tidy(np.atleast_1d(turntable_deg), 4)
    return [*(f"{value:.4f}" for value in said), *[UNUSED] * (6 - len(said))]


def _joints_on_arcs(moves: Moves) -> Float:
    """Joint angles (k, 6) at the point of the path that is the middle one of each move, rad."""
    assert moves.postures is not None
    assert moves.point is not None
    return moves.postures.joints[(moves.point + np.append(moves.point[:1], moves.point[:-1])) // 2]


def _targets(
    prefix: str, indices: Int, position_mm: Float, quaternion: Float, turntable: Float | None, configuration: Int
) -> Iterator[str]:
    """One declaration a target, numbered from 1."""
    said = zip(indices.tolist(), tidy(position_mm[indices], 4), tidy(quaternion[indices], 8), strict=True)
    for i, at, turn in said:
        axes = _external(None if turntable is None else turntable[i])
        cf = configuration[i].tolist()
        yield MODULE.say("robtarget", name=f"{prefix}{i + 1}", at=at, turn=turn, cf=cf, axes=axes)


def _spelt(position_mm: Float, quaternion_wxyz: Float) -> dict[str, Any]:
    return {"at": tidy(position_mm, 4), "turn": tidy(quaternion_wxyz, 8)}
