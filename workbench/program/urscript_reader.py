"""A strict reader for the part of URScript that milling programs need.

    program = def name(): {event} set_tcp(pose) set_payload(kg, [x, y, z]) [popup(...)] {event} movej {move | event} end
              name()
    move    = movej([q1..q6], a=, v=) | movel(pose, a=, v=, r=) | movec(pose, pose, a=, v=, r=, mode=0)
    event   = name() | set_standard_digital_out(n, True | False) | sleep(s) | popup(..., title="Stop", ...)
            | while not get_standard_digital_in(n): sync() end

Everything else is refused with its line: signals and functions that the cell file's process does not name; a blend
before an event or movej; blends that overlap, which a controller answers by leaving moves out.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from workbench.artefacts import ProgramMove, ProgramMoves, ProgramTool
from workbench.geometry.poses import pose_from, rotation_from_vector
from workbench.program.reading import NAME, NUMBER, Events, Lines, numbers, one_file
from workbench.robot.cell_file import ProcessPart
from workbench.units import DEG, Float, Shaped

POSE = rf"p\[{', '.join([NUMBER] * 6)}\]"
END = rf"a={NUMBER}, v={NUMBER}, r={NUMBER}"
POPUP = rf'popup\("Turntable at {NUMBER} deg\?", title="Turntable", blocking=True\)'
TOOL, BASE = "tcp", "base"


STOP = r'popup\("[^"]*", title="Stop", blocking=True\)'


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
    found = lines.take(shapes, "a move, an event or end (see workbench.program.urscript_reader)")
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
