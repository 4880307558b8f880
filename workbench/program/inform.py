"""INFORM, Yaskawa's language, as a relative job (`.JBI`).

(Yaskawa Motoman: NX100 and DX100 Instructions, Data Transmission Function, job data format; DX100 and YRC1000
Instructions, INFORM Language.) Targets are X, Y, Z in mm and R = Rz(Rz) Ry(Ry) Rx(Rx) in deg, in the robot's frame or
in a user frame that the controller has, for a tool that it has: a job declares none. RCONF says the arm's branch for
every target: flip 0 (R, axis 4, within +-90 deg) or no flip 1, upper arm 0 or lower arm 1, front 0 or rear 1, then
whether R, T and S (joints 4, 6 and 1) are beyond +-180 deg. MOVJ goes to such a target too, of which the robot must
have exactly one within its limits: pulses of the encoders, the other way to say a posture, are known to the controller
alone. Speeds are mm/s in tenths, rounded down. A target is reached (PL=0), or rounded by CR in mm where the controller
has that tag, or by the largest position level (PL=1 to 8) that the zone holds, where the cell file says their zones,
which no job does. An arc that follows another one begins where that ended; any other one says its start again. WAIT
waits without end; feeds are limited where they are written.
"""

from __future__ import annotations

import functools
import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from workbench.artefacts import EventKind, ProgramTool
from workbench.errors import InputError
from workbench.geometry.poses import inverse, pose_from, quaternion_from_rotation, rotation_from_quaternion
from workbench.language import NUMBER, Language, row
from workbench.program.fanuc import cut
from workbench.program.reading import Reading, euler_pose, euler_rows
from workbench.program.skeleton import SWITCHED, Numbered, check_standing_turntable, check_words, numbered
from workbench.robot.cell_model import Cell
from workbench.robot.inverse import inverse_kinematics
from workbench.robot.kinematics import Chain, forward_kinematics
from workbench.robot.wrist import arm_sides
from workbench.units import DEG, Float, Shaped

FASTEST_MM_S = 1500.0  # of the tag V=
LEAST_CORNER_MM = 1.0  # of the tag CR=
MOST_POSITIONS = 9999  # of a job: their names have five digits, and a job has as many steps
REMARK = 32  # characters of a comment and of MSG
Configuration = tuple[int, ...]  # no flip, lower arm, rear; R, T, S beyond +-180 deg
FLIP_DEG = 90.0  # to both sides of R's home, and of whole turns of it
WHOLE = 2 * np.pi
R_T_S = [3, 5, 0]  # joints R, T, S
SAME_POSTURE = 1e-3 * DEG  # branches that coincide
ARC = "MOVC C{via:05d} V={speeds[0]:.1f}\nMOVC C{target:05d} V={speeds[1]:.1f} {near} FPT"
BODY = ("straight", "arc", "axes", "home_", *SWITCHED)
JOB = Language(
    forms={
        "header": "/JOB\n//NAME {name}\n//POS\n///NPOS {count:d},0,0,0,0,0{user}\n///TOOL {tool:d}\n"
        "///POSTYPE {kind}\n///RECTAN",
        "rconf": f"///RCONF {row([''] * 6, 'flags', 'd')}{',0' * 18}",
        "position": f"C{{number:05d}}={row([''] * 3, 'at', '.3f')},{row([''] * 3, 'turn', '.4f')}",
        "instructions": "//INST\n///ATTR SC,RW,RJ\n///FRAME {frame}\n///GROUP1 RB1\nNOP",
        "turntable": 'MSG "TURNTABLE AT {angle:.4f} DEG?"\nPAUSE',
        "axes": "MOVJ C{target:05d} VJ={percent:.2f} PL=0",
        "home_": "MOVJ {variable} VJ={percent:.2f} PL=0",
        "straight": "MOVL C{target:05d} V={feed:.1f} {near}",
        "arc": f"MOVC C{{start:05d}} V={{speeds[2]:.1f}} PL=0\n{ARC}",
        "arc_on": ARC,
        "switch_on": "DOUT OT#({signal}) ON",
        "switch_off": "DOUT OT#({signal}) OFF",
        "wait_speed": "WAIT IN#({signal})=ON",
        "wait_time": "TIMER T={seconds}",
        "stop": "PAUSE",
        "restart": "*{value}",
        "hook": "CALL JOB:{value}",
        "end": "END",
    },
    order={
        "": ("header",),
        "header": ("rconf",),
        "rconf": ("position",),
        "position": ("position", "rconf", "instructions"),
        "instructions": ("hook", "turntable", "axes", "home_"),
        "turntable": ("axes", "home_"),
        **dict.fromkeys(BODY, BODY),
        **dict.fromkeys(("arc", "arc_on"), ("arc_on", *BODY)),
        "hook": (*BODY, "turntable"),
        "end": (),
    },
    kinds={
        "user": r"(?:\r?\n///USER [0-9]+)?",
        "kind": "ROBOT|USER",
        "flags": "[01]",
        "frame": "ROBOT|USER [0-9]+",
        "variable": "P[0-9]+",
        "near": f"PL=[0-8]|CR={NUMBER}",
        "signal": "[0-9]+",
        "seconds": r"[0-9]+\.[0-9][0-9]",
    },
    comment="'",
)


class Arm(NamedTuple):
    """A robot with the controller's tool, and the frame of its positions."""

    chain: Chain
    flange_from_tool: Shaped[Float, "4 4"]
    base_from_frame: Shaped[Float, "4 4"]

    def pose(self, base_from_flange: Float) -> Float:
        """frame_from_tool (4, 4) of a flange (4, 4) in the base."""
        return np.asarray(inverse(self.base_from_frame) @ base_from_flange @ self.flange_from_tool)

    def postures(self, frame_from_tool: Float, configuration: Configuration) -> list[Float]:
        """Joint angles (6,), rad, within the limits, that put the tool at a pose (4, 4) with this configuration."""
        flange = self.base_from_frame @ frame_from_tool @ inverse(self.flange_from_tool)
        branches = inverse_kinematics(self.chain, flange[None])[0]
        found: list[Float] = []
        for branch in branches[np.isfinite(branches).all(axis=1)]:
            for turns in itertools.product(*(self._turns(i, angle) for i, angle in enumerate(branch.tolist()))):
                joints = branch + WHOLE * np.array(turns)
                same = any(np.abs(joints - other).max() < SAME_POSTURE for other in found)
                if not same and inform_configuration(self.chain, joints) == configuration:
                    found.append(joints)
        return found

    def _turns(self, joint: int, angle: float) -> list[int]:
        lower, upper = self.chain.limits[joint]
        return [k for k in (0, 1, -1) if lower <= angle + WHOLE * k <= upper]


def arm_of(cell: Cell, *, in_user_frame: bool) -> Arm:
    """The cell's robot with the cutter as the controller has it; positions in the work object, or in the base."""
    return Arm(cell.chain, cell.flange_from_cutter, cell.base_from_workobject if in_user_frame else np.eye(4))


class Job(Reading):
    """The job, statement by statement; MOVJ goes to a pose of the cell's robot."""

    language, dialect, suffix = JOB, "yaskawa", ".jbi"

    def __init__(self, cell: Cell) -> None:
        super().__init__(cell)
        self.cell, self.levels_mm = cell, cell.controller.position_levels_mm if cell.controller else []
        self.flags: Configuration = ()
        self.positions: list[tuple[Configuration, Float]] = []
        self.at: int | None = None  # the position that the last move went to, where it was not the controller's home
        self.table: float | None = None  # rad: where a message asks for it

    def header(self, name: str, count: int, user: str, tool: int, kind: str) -> None:
        self.tool, self.count = f"TOOL[{tool}]", count
        self.frame = user.strip()[3:] if user else "ROBOT"
        if kind != self.frame.split(" ")[0]:
            self.refuse("///POSTYPE USER where ///USER is said, else ROBOT", f"///POSTYPE {kind}")
        self.work_object = re.sub(r"USER (\d+)", r"USER[\1]", self.frame)  # as cell files have it
        self.tools = {self.tool: ProgramTool(None)}
        self.objects = {self.work_object: None if user else np.eye(4)}
        self.arm = arm_of(self.cell, in_user_frame=bool(user))

    def rconf(self, flags: list[int]) -> None:
        self.flags = tuple(flags)

    def position(self, number: int, at: list[float], turn: list[float]) -> None:
        if number != len(self.positions):
            self.refuse(f"C{len(self.positions):05d}")
        self.positions.append((self.flags, euler_pose(at, turn[::-1])))

    def instructions(self, frame: str) -> None:
        if len(self.positions) != self.count:
            self.refuse(f"///NPOS {len(self.positions)}", str(self.count))
        if frame != self.frame:
            self.refuse(f"///FRAME {self.frame}, as the positions have it", f"///FRAME {frame}")

    def turntable(self, angle: float) -> None:
        if self.moves or self.table is not None:
            self.refuse("this message once, before the first move")
        self.table = angle * DEG

    def axes(self, target: int, percent: float) -> None:
        configuration, pose = self._position(target)
        postures = self.arm.postures(pose, configuration)
        if len(postures) != 1:
            self.refuse(f"a position that RCONF makes one posture of the robot, not {len(postures)}")
        self.by_joints(percent / 100, postures[0], self.table)

    def home_(self, variable: str, percent: float) -> None:
        if variable != self.home:
            self.refuse("a position of this job or the controller's home", variable)
        self.at = None
        self.by_joints(percent / 100, None, place=variable)

    def straight(self, target: int, feed: float, near: str, via: Float | None = None) -> None:
        configuration, pose = self._position(target)
        zone = float(near[3:])
        if near.startswith("PL") and zone > len(self.levels_mm):
            self.refuse("PL=0, or a level of the cell file's ($.controller.position_levels_mm)", near)
        if near.startswith("PL"):
            zone = self.levels_mm[int(zone) - 1] if zone else 0.0
        self.in_space(pose, via, feed, zone, turntable=self.table, configuration=configuration)

    def arc_on(self, via: int, target: int, speeds: list[float], near: str) -> None:
        if len({*speeds}) > 1:
            self.refuse("the same speed all along the arc")
        self.said = self.said._replace(line=self.said.line + len(speeds) - 1)  # where it ends
        self.straight(target, speeds[0], near, self._position(via)[1])

    def arc(self, start: int, **more: Any) -> None:
        if start != self.at or self.moves[-1].zone_mm > 0:
            self.refuse("an arc that starts where the move before ended, with PL=0")
        self.arc_on(**more)

    def _position(self, number: int) -> tuple[Configuration, Float]:
        """Configuration and pose (4, 4) of C<number>, where the robot then is."""
        if number >= len(self.positions):
            self.refuse(f"a position of //POS, C00000 to C{len(self.positions) - 1:05d}", f"C{number:05d}")
        self.at = number
        return self.positions[number]


@dataclass
class Inform(Numbered):
    """The dialect of Yaskawa's controllers."""

    language, reader, note = JOB, Job, "'"
    begin, home_as = 0, "variable"

    def __post_init__(self) -> None:
        """Refuse what a job cannot say."""
        feed = self.job.moves.feed_mm_s
        if not self.slowest <= feed.min() <= feed.max() <= FASTEST_MM_S:
            raise InputError(
                "program.write",
                f"expected feeds of {self.slowest:g} to {FASTEST_MM_S:g} mm/s for Yaskawa, found {feed.min():.3g} to "
                f"{feed.max():.5g}",
            )
        check_standing_turntable(
            self.job, self.cell, "jobs for Yaskawa's controllers are written for the robot's own axes only"
        )
        if self._count > MOST_POSITIONS:
            raise InputError(
                "program.write",
                f"expected at most {MOST_POSITIONS} positions in a job for Yaskawa, found {self._count}: larger "
                "tolerances of path.simplify make fewer",
            )
        variable = r"P\d{3,5}", "a position variable, P000 to P99999,"
        check_words(self.cell, "Yaskawa", signals="numbers", home=variable)

    @functools.cached_property
    def tool(self) -> int:
        """Number of the tool on the controller."""
        if self.job.tool_name is None:
            raise InputError(
                f"{self.cell.source}: $.tool.controller_name",
                "expected TOOL[n], the number of the tool as measured on Yaskawa's controller: its jobs declare none",
            )
        return numbered(self.cell, "Yaskawa", "tool", "TOOL", self.job.tool_name, "{1,2}")

    @functools.cached_property
    def frame(self) -> int | None:
        """Number of the user frame on the controller; None: the robot's own frame."""
        name = self.job.work_object_name
        return None if name is None else numbered(self.cell, "Yaskawa", "work_object", "USER", name, "{1,2}")

    @functools.cached_property
    def arm(self) -> Arm:
        """The robot with the controller's tool in the frame of the targets."""
        return arm_of(self.cell, in_user_frame=self.frame is not None)

    def fields(self, kind: EventKind, value: str) -> dict[str, Any]:
        """Names are in capitals."""
        return super().fields(kind, value) | {"value": value.upper()}

    @functools.cached_property
    def ends(self) -> list[dict[str, Any]]:
        """All that stands behind the target of each move: speed, and how near it is reached."""
        controller = self.cell.controller
        corner = math.floor(self.job.zone_mm * 10 + 1e-9) / 10 if controller and controller.corner_region else 0.0
        levels = controller.position_levels_mm if controller else []
        within = [level for level, zone_mm in enumerate(levels, 1) if zone_mm <= self.job.zone_mm]
        level = max(within, key=lambda level: levels[level - 1], default=0)
        rounded = f"CR={corner:.1f}" if corner >= LEAST_CORNER_MM else f"PL={level}"
        blends = self.blends
        arc_next = [*self.job.moves.circular[1:].tolist(), False]  # its own start is said again: nothing to round there
        near = [rounded if free and not arc else "PL=0" for free, arc in zip(blends, arc_next, strict=True)]
        return [{"feed": feed, "near": end, "speeds": [feed] * 3} for feed, end in zip(self.feeds, near, strict=True)]

    def head(self) -> Iterator[str]:
        """Remarks; the first posture's angles, by which its branch is told on the pendant; the turntable's."""
        yield from (self.remark(remark) for remark in self.job.remarks)
        said = " ".join(
            f"{axis} {round(angle, 1) + 0.0:.1f}"
            for axis, angle in zip("SLURBT", self.postures["start"][0].tolist(), strict=True)
        )
        yield self.remark(f"C00000 on the pendant, deg: {said}")
        yield from self.events("first")
        if self.job.turntable_deg is not None:
            yield from self.say("turntable", angle=self.job.turntable_deg[0] + 0.0)

    def move(self, i: int) -> list[str]:
        """MOVL; or MOVC over the middle to the end, which FPT ends: the first of several says its start once more."""
        circular = self.job.moves.circular
        if not circular[i]:
            return super().move(i)
        again = "arc" if not circular[i - 1] or self.layer(i) else "arc_on"
        begin = self.numbers[-1] + 2 if i == 1 and self.skeleton else self.numbers[i - 1]
        return self.say(again, start=begin, **self.place(i), **self.ends[i])

    @property
    def _count(self) -> int:
        return self.numbers[-1] + 1 + (3 + self.cell.probes if self.cell.process else 0)

    def configuration(self, joints: Float, cell: Cell) -> Configuration:
        """RCONF of a posture (6,), rad: no flip, lower arm, rear, and whether R, T, S are beyond +-180 deg."""
        return inform_configuration(cell.chain, joints)

    def documents(self, text: str) -> dict[str, str]:
        """Positions, then instructions."""
        name, kind = self.job.name.upper(), "ROBOT" if self.frame is None else "USER"
        user, place = ("", kind) if self.frame is None else (f"\n///USER {self.frame}", f"USER {self.frame}")
        content = [JOB.say("header", name=name, count=self._count, user=user, tool=self.tool, kind=kind)]
        content += [*self._positions(), JOB.say("instructions", frame=place)]
        for line in text.splitlines():
            content += [f"'{piece}" for piece in cut(line[1:], REMARK)] if line.startswith("'") else [line]
        return {f"{name}.JBI": "\n".join([*content, ""]).replace("\n", "\r\n")}

    def _positions(self) -> Iterator[str]:
        moves, skeleton = self.job.moves, self.skeleton
        assert moves.joints_deg is not None
        joints = moves.joints_deg * DEG
        arcs = np.flatnonzero(moves.circular)
        here = self._spelled(moves.position_mm, moves.quaternion_wxyz)
        over = self._spelled(moves.via_position_mm[arcs], moves.via_quaternion_wxyz[arcs])
        via = dict(zip(arcs.tolist(), over, strict=True))
        said = [self.configuration(posture, self.cell) for posture in joints]
        rows = [self._posture(self.postures["start"][0] * DEG)]
        for i in range(1, len(joints)):
            rows += [(said[i], via[i])] if i in via else []
            rows.append((said[i], here[i]))
        if skeleton is not None:
            back = self._spelled(*skeleton.retracted)[0]
            rows += [self._posture(skeleton.home_deg[0] * DEG), (said[0], here[0])]
            rows.append((self.configuration(skeleton.retract_joints, self.cell), back))
            rows += [] if skeleton.probe_deg is None else [self._posture(skeleton.probe_deg[0] * DEG)]
        last: Configuration = ()
        for number, (configuration, values) in enumerate(rows):
            if configuration != last:
                yield JOB.say("rconf", flags=configuration)
            last = configuration
            yield JOB.say("position", number=number, at=values[:3], turn=values[:2:-1])

    def _posture(self, joints: Float) -> tuple[Configuration, list[float]]:
        """RCONF and pose of joint angles (6,), rad."""
        pose = self.arm.pose(forward_kinematics(self.cell.chain, joints))
        return self.configuration(joints, self.cell), _rows(pose[None])[0]

    def _spelled(self, position_mm: Float, quaternion_wxyz: Float) -> list[list[float]]:
        """Targets (k, 3), (k, 4) of the job's work object, in the frame of the positions."""
        poses = pose_from(rotation_from_quaternion(quaternion_wxyz), position_mm)
        return _rows(poses if self.frame is not None else self.job.base_from_workobject @ poses)


def _rows(poses: Float) -> list[list[float]]:
    """X, Y, Z, Rz, Ry, Rx of poses (k, 4, 4): 3 decimals of a mm, 4 of a degree."""
    return euler_rows(poses[:, :3, 3], quaternion_from_rotation(poses[:, :3, :3]), 3, 4)


def inform_configuration(chain: Chain, joints: Float) -> Configuration:
    """RCONF of a posture (6,), rad: no flip, lower arm, rear; whether R, T and S are beyond +-180 deg.

    Flip is -90 < R <= 90 deg, and so about every whole turn of R (NX100 Operator's Manual, Manipulator Types): the
    wrist's other solution has R half a turn away. R counts from the axis' home position, as the robot's URDF must.
    """
    behind, down, _ = arm_sides(chain, joints)[0].tolist()
    angles = np.round(joints[R_T_S] / DEG, 4)
    flip = 0.0 < (float(angles[0]) + FLIP_DEG) % 360.0 <= 2.0 * FLIP_DEG
    beyond = ((angles > 180) | (angles <= -180)).astype(int).tolist()
    return (int(not flip), int(down), int(behind), *beyond)
