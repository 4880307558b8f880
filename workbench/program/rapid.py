"""RAPID, ABB's language: the path as a module (ABB, RAPID Instructions, Functions and Data types).

Targets in mm and quaternions w x y z, in the work object; unused external axes 9E+09. Positions have 4 decimals,
quaternions 8: the rounding stays below 0.0001 mm and 0.00001 deg, less than the controller's own single precision.
Feeds have 3 significant digits, one speeddata each. Where the moves rest on postures the program begins with MoveAbsJ
to the first one, the tool is the cell's, targets are in the base, and the turntable is the external axis eax_a. Every
target says its axis configuration, and the controller monitors it (ConfL\\On): a restart in another posture is stopped.
Circular moves turn the tool in the frame of the work object (`CirPathMode\\ObjectFrame`), as `path.simplify` assumes.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from workbench.artefacts import EventKind, Moves, ProgramMoves
from workbench.dialect import ProgramJob, rounded_feeds
from workbench.errors import InputError
from workbench.program.rapid_reader import read_rapid
from workbench.program.skeleton import CellDialect, check_words
from workbench.program.words import free_name
from workbench.robot.cell import Cell
from workbench.robot.wrist import arm_sides
from workbench.units import DEG, Float, Int

TURN_DEG_S = 50  # where the orientation alone moves
UNUSED = "9E+09"  # an external axis that is not there
MODES = ("    ConfJ\\Off;", "    ConfL\\On;", "    CirPathMode\\ObjectFrame;")
UNLIMITED = "    VelSet 100,5000;"  # as the controller starts with it


@dataclass
class Rapid(CellDialect):
    """The dialect of ABB's controllers."""

    procedure: str
    tool_name: str
    work_object_name: str

    def __post_init__(self) -> None:
        """Refuse names of the process that mean something in RAPID."""
        process = self.cell.process
        if process is None:
            return
        spindle = process.spindle
        names = [
            process.coolant_signal,
            process.mechanical_unit,
            process.home.controller_name,
            *process.before,
            *process.after,
            *((spindle.on_signal, spindle.at_speed_signal) if spindle else ()),
        ]
        for name in (str(one) for one in names if one is not None):
            try:
                free_name(name)
            except ValueError as error:
                raise InputError(f"{self.cell.source}: $.process", f"{error}, found {name!r}") from None
        check_words(self.cell, process, "ABB", signals="names", units=True)

    def event(self, kind: EventKind, value: str) -> list[str]:
        """What happens between moves (ABB, RAPID Instructions: ActUnit, SetDO, Stop, VelSet, WaitDI, WaitTime).

        A WaitDI that waits longer than its MaxTime stops the program.
        """
        if kind == "restart":
            return [f"    {value}:", *MODES]
        switched = {"on": 1, "off": 0}.get(kind.rpartition("_")[2])
        if switched is not None:
            return [f"    SetDO {value},{switched};"]
        longest = self.cell.process.spindle.wait_s if self.cell.process and self.cell.process.spindle else 0.0
        words = {
            "hook": value,
            "activate_axis": f"ActUnit {value}",
            "feed_limits": f"VelSet {value}",
            "stop": "Stop",
            "wait_speed": f"WaitDI {value},1\\MaxTime:={longest:g}",
            "wait_time": f"WaitTime {value}",
        }
        return [f"    {words[kind]};"]

    @functools.cached_property
    def feeds(self) -> tuple[Float, Int]:
        """The distinct feeds in mm/s, and which of them each move has."""
        distinct, which = np.unique(rounded_feeds(self.job.moves.feed_mm_s), return_inverse=True)
        return distinct, which

    @functools.cached_property
    def ends(self) -> list[str]:
        """All that stands behind the target of each move: speed, zone, tool and work object."""
        which = self.feeds[1].tolist()
        zones = ["zonePath" if blends else "fine" for blends in self.blends]
        tool, place = self.job.tool_name or self.tool_name, self.job.work_object_name or self.work_object_name
        tail = f"{tool}\\WObj:={place};"
        return [f"feed{w + 1},{zone},{tail}" for w, zone in zip(which, zones, strict=True)]

    def head(self) -> Iterator[str]:
        """Declarations: tool, work object, zone, speeds, targets."""
        job = self.job
        load = f"[{job.tool.mass_kg:g},{_vector(job.tool.centre_of_gravity_mm)},[1,0,0,0],0,0,0]"
        frame = _pose(job.tool_centre_point_mm, job.tool.quaternion_wxyz)
        z = job.zone_mm
        yield f"MODULE {job.name}"
        yield from (f"  ! {remark}" for remark in job.remarks)
        if job.tool_name is None:
            yield f"  PERS tooldata {self.tool_name}:=[TRUE,{frame},{load}];"
        if job.work_object_name is None:
            yield f'  TASK PERS wobjdata {self.work_object_name}:=[FALSE,TRUE,"",{_pose(*job.work_object)},{NO_POSE}];'
        if z:
            yield f"  CONST zonedata zonePath:=[FALSE,{z:g},{z:g},{z:g},{z / 10:g},{z:g},{z / 10:g}];"
        for i, feed in enumerate(self.feeds[0].tolist(), 1):
            yield f"  CONST speeddata feed{i}:=[{feed:.7g},{TURN_DEG_S},5000,1000];"
        assert job.moves.joints_deg is not None
        said = configurations(self.cell, job.moves.joints_deg * DEG)
        yield from _targets(
            "p",
            np.arange(len(job.moves.layer)),
            job.moves.position_mm,
            job.moves.quaternion_wxyz,
            job.turntable_deg,
            said,
        )
        arcs = np.flatnonzero(job.moves.circular)
        said = configurations(self.cell, _joints_on_arcs(job.moves))
        yield from _targets("via", arcs, job.moves.via_position_mm, job.moves.via_quaternion_wxyz, _halfway(job), said)
        skeleton = self.skeleton
        if skeleton is None:
            yield from self._start_posture()
        else:
            if not skeleton.process.home.controller_name:
                yield joint_target("jHome", *skeleton.home_deg)
            if skeleton.probe_deg is not None:
                yield joint_target("jProbe", *skeleton.probe_deg)
            yield joint_target("jStart", *skeleton.start_deg)
            place, turn = skeleton.retracted
            last = None if job.turntable_deg is None else job.turntable_deg[-1:]
            yield from _targets(
                "retract", np.array([0]), place, turn, last, configurations(self.cell, skeleton.retract_joints[None])
            )
        yield f"  PROC {self.procedure}()"
        yield from self.said(skeleton.first) if skeleton else ()
        yield from MODES

    def _home(self, end: str) -> str:
        assert self.skeleton is not None
        return f"    MoveAbsJ {self.skeleton.process.home.controller_name or 'jHome'}\\NoEOffs,{end}"

    def start(self) -> Iterable[str]:
        """By the axes to the first posture, and exactly to the first target."""
        end, skeleton = self.ends[0], self.skeleton
        probe = self.probed(f"    MoveAbsJ jProbe\\NoEOffs,{end}")
        before = [*self.said(skeleton.settings), self._home(end), *probe] if skeleton else []
        behind = self.said(skeleton.on) if skeleton else []
        return [*before, f"    MoveAbsJ jStart\\NoEOffs,{end}", *behind, f"    MoveL p1,{end}"]

    def _start_posture(self) -> Iterator[str]:
        """Joint angles of the first target."""
        joints, turntable = self.job.moves.joints_deg, self.job.turntable_deg
        if joints is not None:
            yield joint_target("jStart", joints[0], None if turntable is None else float(turntable[0]))

    def straight(self, i: int) -> Iterable[str]:
        """MoveL."""
        return [*self.layer(i), f"    MoveL p{i + 1},{self.ends[i]}"]

    def circular(self, i: int) -> Iterable[str]:
        """MoveC."""
        return [*self.layer(i), f"    MoveC via{i + 1},p{i + 1},{self.ends[i]}"]

    def remark(self, text: str) -> str:
        """Up to the end of the line."""
        return f"    ! {text}"

    def foot(self) -> Iterable[str]:
        """Settings as the controller starts with them."""
        skeleton, end = self.skeleton, self.ends[-1]
        back = (
            []
            if skeleton is None
            else [
                f"    MoveL retract1,{end}",
                *self.said(skeleton.off),
                self._home(end),
                *self.said(skeleton.last),
                *([UNLIMITED] if skeleton.process.feed else []),
            ]
        )
        return [*back, "    CirPathMode\\PathFrame;", "    ConfJ\\On;", "  ENDPROC", "ENDMODULE"]

    def read(self, files: Mapping[str, str]) -> ProgramMoves:
        """Turn it back."""
        ((name, text),) = files.items()
        return read_rapid(text, name, self.cell.process)

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


def joint_target(name: str, joints_deg: Float, turntable_deg: float | None) -> str:
    """A declaration."""
    axes = ",".join(f"{angle:.4f}" for angle in (np.round(joints_deg, 4) + 0.0).tolist())
    first = UNUSED if turntable_deg is None else f"{round(turntable_deg, 4) + 0.0:.4f}"
    return f"  CONST jointtarget {name}:=[[{axes}],[{first},{','.join([UNUSED] * 5)}]];"


def _joints_on_arcs(moves: Moves) -> Float:
    """Joint angles (k, 6) at the point of the path that is the middle one of each move, rad."""
    assert moves.postures is not None
    assert moves.point is not None
    return moves.postures.joints[(moves.point + np.append(moves.point[:1], moves.point[:-1])) // 2]


def _halfway(job: ProgramJob) -> Float | None:
    """Where the turntable stands at the middle of each move."""
    if job.turntable_deg is None:
        return None
    return np.append(job.turntable_deg[:1], (job.turntable_deg[1:] + job.turntable_deg[:-1]) / 2)


def _targets(
    prefix: str, indices: Int, position_mm: Float, quaternion: Float, turntable: Float | None, configuration: Int
) -> Iterator[str]:
    """One declaration a target, numbered from 1."""
    others = ",".join([UNUSED] * 5)
    axis = [UNUSED] * len(position_mm) if turntable is None else [f"{angle:.4f}" for angle in _tidy(turntable, 4)]
    rows = zip(indices.tolist(), _tidy(position_mm[indices], 4), _tidy(quaternion[indices], 8), strict=True)
    for i, (x, y, z), (w, a, b, c) in rows:
        yield (
            f"  CONST robtarget {prefix}{i + 1}:=[[{x:.4f},{y:.4f},{z:.4f}],[{w:.8f},{a:.8f},{b:.8f},{c:.8f}],"
            f"[{','.join(map(str, configuration[i].tolist()))}],[{axis[i]},{others}]];"
        )


def _tidy(values: Float, digits: int) -> list[list[float]]:
    """Rounded, without negative zeros."""
    rounded: list[list[float]] = (np.round(values, digits) + 0.0).tolist()
    return rounded


def _vector(v: Float) -> str:
    return "[" + ",".join(f"{x:.4f}" for x in (np.round(v, 4) + 0.0).tolist()) + "]"


def _pose(position_mm: Float, quaternion_wxyz: Float) -> str:
    turn = ",".join(f"{x:.8f}" for x in (np.round(quaternion_wxyz, 8) + 0.0).tolist())
    return f"[{_vector(position_mm)},[{turn}]]"


NO_POSE = "[[0,0,0],[1,0,0,0]]"
