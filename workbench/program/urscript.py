"""URScript, the language of Universal Robots.

(Universal Robots, The URScript Programming Language: movej, movel, movec, set_tcp, set_payload, popup.) Poses are
p[x, y, z, rx, ry, rz] in m and rotation vector, in the robot's base (`base_frame` of the cell: the controller's base,
not the URDF's base_link); joint angles in rad, feeds in m/s, accelerations in m/s^2. The program begins with movej to
the first posture. Circular moves have mode 0: the orientation goes from one target's to the next's. The blend radius
stays below half of either move: where blends overlap, the controller leaves a move out. There are no external axes: a
turntable that turns along the path is refused; one that stands is asked for by a popup that waits.

Read back strictly, and no more of it than milling programs need.

    program = def name(): {event} set_tcp(pose) set_payload(kg, [x, y, z]) [popup(...)] {event} movej {move | event} end
              name()
    move    = movej([q1..q6], a=, v=) | movel(pose, a=, v=, r=) | movec(pose, pose, a=, v=, r=, mode=0)
    event   = name() | set_standard_digital_out(n, True | False) | sleep(s) | popup(..., title="Stop", ...)
            | while not get_standard_digital_in(n): sync() end

Everything else is refused with its line: signals and functions that the cell file's process does not name; a blend
before an event or movej; blends that overlap, which a controller answers by leaving moves out.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from workbench.artefacts import EventKind, ProgramMove, ProgramMoves, ProgramTool
from workbench.dialect import rounded_feeds
from workbench.errors import InputError
from workbench.geometry.poses import pose_from, rotation_from_quaternion, rotation_from_vector, vector_from_rotation
from workbench.program.skeleton import (
    CellDialect,
    check_standing_turntable,
    check_words,
    limited,
)
from workbench.program.words import NAME, NUMBER, Events, Lines, numbers, one_file
from workbench.robot.cell import Cell
from workbench.robot.cell_file import ProcessPart
from workbench.units import DEG, Float, Shaped

ACCELERATION_M_S2 = 0.5  # of the tool
JOINT_SPEED, JOINT_ACCELERATION = 0.35, 0.5  # rad/s, rad/s^2: on the way to the first posture
SHARE = 0.45  # of a move's length that a blend may take at either end
POSE = rf"p\[{', '.join([NUMBER] * 6)}\]"
END = rf"a={NUMBER}, v={NUMBER}, r={NUMBER}"
POPUP = rf'popup\("Turntable at {NUMBER} deg\?", title="Turntable", blocking=True\)'
TOOL, BASE = "tcp", "base"
ASKED = {"": "Go on with the next layer?", "probe": "Is the tip where the part has it?"}
STOP = r'popup\("[^"]*", title="Stop", blocking=True\)'


@dataclass
class UrScript(CellDialect):
    """The dialect of Universal Robots' controllers."""

    def __post_init__(self) -> None:
        """Refuse what the controller cannot do."""
        check_standing_turntable(self.job, self.cell, "controllers of Universal Robots drive no external axis")
        process = self.cell.process
        if process is None:
            return
        check_words(self.cell, process, "UR", signals="numbers")
        if process.home.controller_name is not None:
            where = f"{self.cell.source}: $.process.home.controller_name"
            raise InputError(
                where, f"expected null for UR: programs say home themselves, found {process.home.controller_name!r}"
            )

    def event(self, kind: EventKind, value: str) -> list[str]:
        """What happens between moves: digital outputs and inputs, sleep, popup, functions of the installation.

        Waits without end for a speed. There are no labels: a program begins at its begin.
        """
        switched = {"on": "True", "off": "False"}.get(kind.rpartition("_")[2])
        if switched:
            return [f"  set_standard_digital_out({value}, {switched})"]
        words: dict[EventKind, list[str]] = {
            "hook": [f"  {value}()"],
            "feed_limits": [],
            "restart": [],
            "wait_time": [f"  sleep({value})"],
            "stop": [f'  popup("{ASKED.get(value)}", title="Stop", blocking=True)'],
            "wait_speed": [f"  while not get_standard_digital_in({value}):", "    sync()", "  end"],
        }
        return words[kind]

    @functools.cached_property
    def targets(self) -> list[str]:
        """Poses of the moves' ends, in the base."""
        return poses(*self._in_base(self.job.moves.position_mm, self.job.moves.quaternion_wxyz))

    @functools.cached_property
    def vias(self) -> list[str]:
        """Poses of the middles of arcs; not a number for straight moves."""
        return poses(*self._in_base(self.job.moves.via_position_mm, self.job.moves.via_quaternion_wxyz))

    @functools.cached_property
    def ends(self) -> list[str]:
        """How each move is made."""
        moves = self.job.moves
        chord = np.linalg.norm(np.diff(moves.position_mm, axis=0), axis=1)
        room = SHARE * np.minimum(np.append(0.0, chord), np.append(chord, 0.0))
        blend = np.where(self.blends, np.minimum(self.job.zone_mm, room), 0.0)
        feed = rounded_feeds(limited(moves.feed_mm_s, self.cell)) / 1000
        rows = zip(feed.tolist(), (np.floor(blend * 1000) / 1e6).tolist(), strict=True)
        return [f"a={ACCELERATION_M_S2:g}, v={feed:.9g}, r={r:.6f}" for feed, r in rows]

    def head(self) -> Iterator[str]:
        """Function, tool, load; where the turntable must stand."""
        job, tool = self.job, self.job.tool
        yield f"def {job.name}():"
        yield from (self.remark(one) for one in job.remarks)
        yield from self.said(self.skeleton.first) if self.skeleton else ()
        turn = rotation_from_quaternion(tool.quaternion_wxyz)
        yield f"  set_tcp({poses(job.tool_centre_point_mm[None], turn[None])[0]})"
        x, y, z = tool.centre_of_gravity_mm / 1000
        yield f"  set_payload({tool.mass_kg:g}, [{x:.6f}, {y:.6f}, {z:.6f}])"
        if job.turntable_deg is not None:
            yield f'  popup("Turntable at {job.turntable_deg[0] + 0.0:.4f} deg?", title="Turntable", blocking=True)'

    def start(self) -> Iterable[str]:
        """By the joints to the first posture; with a process from home, and straight to the first target."""
        assert self.job.moves.joints_deg is not None
        skeleton = self.skeleton
        if skeleton is None:
            return [by_joints(self.job.moves.joints_deg[0])]
        first = f"  movel({self.targets[0]}, {self.ends[0]})"
        probe = [] if skeleton.probe_deg is None else self.probed(by_joints(skeleton.probe_deg[0]))
        home, start = (by_joints(joints) for joints, _ in (skeleton.home_deg, skeleton.start_deg))
        return [home, *probe, start, *self.said(skeleton.on), first]

    def straight(self, i: int) -> Iterable[str]:
        """Movel."""
        return [*self.layer(i), f"  movel({self.targets[i]}, {self.ends[i]})"]

    def circular(self, i: int) -> Iterable[str]:
        """Movec."""
        return [*self.layer(i), f"  movec({self.vias[i]}, {self.targets[i]}, {self.ends[i]}, mode=0)"]

    def remark(self, text: str) -> str:
        """Up to the end of the line."""
        return f"  # {text}"

    def foot(self) -> Iterable[str]:
        """With a process back, and home; the end of the function, and its call."""
        end, skeleton = ["end", f"{self.job.name}()"], self.skeleton
        if skeleton is None:
            return end
        retract = f"  movel({poses(*self._in_base(*skeleton.retracted))[0]}, {self.ends[-1]})"
        return [retract, *self.said(skeleton.off), by_joints(skeleton.home_deg[0]), *self.said(skeleton.last), *end]

    def read(self, files: Mapping[str, str]) -> ProgramMoves:
        """Turn it back."""
        return read_urscript(files, self.cell.chain.speeds, self.cell.process)

    def configuration(self, joints: Float, cell: Cell) -> None:
        """URScript says none: the robot keeps that of the first posture."""

    def documents(self, text: str) -> dict[str, str]:
        """One script."""
        return {f"{self.job.name}.script": text}

    def _in_base(self, position_mm: Float, quaternion_wxyz: Float) -> tuple[Float, Float]:
        """Positions (k, 3) and rotations (k, 3, 3) of targets."""
        place, turn = self.job.work_object
        base_from_object = pose_from(rotation_from_quaternion(turn), place)
        return (
            position_mm @ base_from_object[:3, :3].T + place,
            base_from_object[:3, :3] @ rotation_from_quaternion(quaternion_wxyz),
        )


def by_joints(joints_deg: Float) -> str:
    """Movej to joint angles (6,)."""
    angles = ", ".join(f"{angle:.9f}" for angle in (np.round(joints_deg * DEG, 9) + 0.0).tolist())
    return f"  movej([{angles}], a={JOINT_ACCELERATION:g}, v={JOINT_SPEED:g})"


def poses(position_mm: Float, rotation: Float) -> list[str]:
    """Poses (k, 3), (k, 3, 3) as p[x, y, z, rx, ry, rz]: m to a hundredth of a micrometre, rotation vector in rad."""
    finite = np.isfinite(position_mm).all(axis=1)
    vectors = np.full_like(position_mm, np.nan)
    vectors[finite] = vector_from_rotation(rotation[finite])
    values = np.concatenate([np.round(position_mm / 1000, 8), np.round(vectors, 9)], axis=1) + 0.0
    return ["p[" + ", ".join(f"{x:.9g}" for x in row) + "]" for row in values.tolist()]


# The reader.


def read_urscript(
    files: Mapping[str, str], speeds: Shaped[Float, " 6"], process: ProcessPart | None = None
) -> ProgramMoves:
    """Read a URScript program from its file, name -> text.

    Args:
        files: one that ends in `.script`.
        speeds: (6,) rad/s, the joints' largest: what a share of is said by `ProgramMove.joint_speed`.
        process: whose signals switch what; None: a program that switches any is refused.

    Raises:
        InputError: "line 12: expected ..., found ...".
    """
    name, text = one_file(files, ".script")
    lines = Lines(text, name, "#")
    program = lines.take(rf"def {NAME}\(\):", "def name():")[1]
    moves: list[ProgramMove] = []
    events = Events(lines, moves, process)
    while not lines.peek().startswith("set_tcp") and re.fullmatch(rf"{NAME}\(\)", lines.peek()):
        _event(lines, events)
    tool = _pose(numbers(lines.take(rf"set_tcp\({POSE}\)", "set_tcp(pose)"), 1, 6))
    load = lines.take(rf"set_payload\({NUMBER}, \[{NUMBER}, {NUMBER}, {NUMBER}\]\)", "set_payload(kg, [x, y, z])")
    turntable = None
    if lines.peek().startswith("popup"):
        turntable = float(lines.take(POPUP, "popup that asks for the turntable")[1]) * DEG
    moves.append(_by_joints(lines, turntable, speeds, moves))
    while lines.peek() not in ("end", ""):
        if lines.peek().startswith("movej"):
            moves.append(_by_joints(lines, turntable, speeds, moves))
        elif lines.peek().startswith("move"):
            moves.append(_move(lines, turntable, moves))
        else:
            _event(lines, events)
    lines.take("end", "a move or end")
    lines.take(rf"{program}\(\)", f"{program}()")
    lines.end()
    tools = {TOOL: ProgramTool(tool, float(load[1]), np.array(numbers(load, 2, 4)) * 1000)}
    return ProgramMoves("ur", name, tuple(moves), tools, {BASE: np.eye(4)}, tuple(events.found), tuple(lines.remarks))


def _event(lines: Lines, events: Events) -> None:
    """What happens between moves."""
    shapes = rf"({STOP})|sleep\({NUMBER}\)|set_standard_digital_out\((\d+), (True|False)\)|"
    shapes += rf"while not get_standard_digital_in\((\d+)\):|{NAME}\(\)"
    found = lines.take(shapes, "a move, an event or end (see workbench.program.urscript)")
    stop, seconds, output, value, awaited, function = found.groups()
    if stop:
        events.add("stop", "")
    elif seconds:
        events.add("wait_time", seconds)
    elif output:
        events.use("1" if value == "True" else "0", output)
    elif awaited:
        events.use("wait", awaited)
        lines.take(r"sync\(\)", "sync()")
        lines.take("end", "end of the wait")
    else:
        events.use("call", function)


def _by_joints(lines: Lines, turntable: float | None, speeds: Float, before: list[ProgramMove]) -> ProgramMove:
    if before and before[-1].zone_mm > 0:
        lines.refuse("a move that reaches its target before movej", lines.peek())
    found = lines.take(
        rf"movej\(\[{', '.join([NUMBER] * 6)}\], a={NUMBER}, v={NUMBER}\)", "movej to joint angles first"
    )
    share = float(found[8]) / float(np.min(speeds))
    if not 0 < share <= 1:
        lines.refuse("a joint speed that all joints can do", found[0])
    joints = np.array(numbers(found, 1, 6))
    return ProgramMove(lines.number, "J", TOOL, BASE, joints=joints, joint_speed=share, turntable=turntable)


def _move(lines: Lines, turntable: float | None, before: list[ProgramMove]) -> ProgramMove:
    circular = lines.peek().startswith("movec")
    if circular:
        found = lines.take(rf"movec\({POSE}, {POSE}, {END}, mode=0\)", "movec(pose, pose, a=, v=, r=, mode=0)")
        via = _pose(numbers(found, 1, 6))
        pose = _pose(numbers(found, 7, 12))
    else:
        found = lines.take(rf"movel\({POSE}, {END}\)", "movel(pose, a=, v=, r=)")
        via, pose = None, _pose(numbers(found, 1, 6))
    acceleration, feed, radius = (float(value) for value in found.groups()[-3:])
    if min(acceleration, feed) <= 0 or radius < 0:
        lines.refuse("an acceleration and a speed above 0, a radius of 0 or more", found[0])
    last = before[-1]
    if last.pose is not None:
        chord = float(np.linalg.norm(pose[:3, 3] - last.pose[:3, 3]))
        if radius and last.zone_mm + 1000 * radius > chord:
            lines.refuse(
                f"blends that do not overlap: {last.zone_mm:g} and {1000 * radius:g} mm on {chord:.3g} mm", found[0]
            )
    return ProgramMove(
        lines.number,
        "C" if circular else "L",
        TOOL,
        BASE,
        pose=pose,
        via=via,
        feed_mm_s=1000 * feed,
        zone_mm=1000 * radius,
        turntable=turntable,
    )


def _pose(values: list[float]) -> Float:
    return pose_from(rotation_from_vector(np.array(values[3:])), np.array(values[:3]) * 1000)
