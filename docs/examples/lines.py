"""A post-processor in one file: `workbench run PIPELINE.json --plugin lines.py`, with the stage `lines.program`.

Its language is made up: a statement a line, poses as x, y, z in mm and a unit quaternion w, x, y, z in the robot's
base, joint angles in degrees, feeds in mm/s.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from workbench.api import (
    DEG,
    Cell,
    Document,
    Float,
    InputError,
    Judgement,
    Language,
    MillingTool,
    Moves,
    PathGate,
    ProgramJob,
    ProgramMove,
    ProgramMoves,
    ProgramTool,
    RobotCell,
    pose_from,
    quaternion_from_rotation,
    rotation_from_quaternion,
    stage,
    write_program,
)

POSE = " ".join(f"{{pose[{i}]:.7f}}" for i in range(7))
VIA = POSE.replace("pose", "via")
LINES = Language(
    forms={
        "begin": "PROGRAM {name}",
        "tool": f"TOOL {POSE}",
        "table": "TABLE {angle:.4f}",
        "axes": "AXES " + " ".join(f"{{joints[{i}]:.7f}}" for i in range(6)),
        "straight": f"LINE {POSE} FEED {{feed:.6f}}",
        "circular": f"ARC {VIA} TO {POSE} FEED {{feed:.6f}}",
        "end": "END",
    },
    order={
        "": ("begin",),
        "begin": ("tool",),
        "tool": ("table", "axes"),
        "table": ("axes",),
        "axes": ("straight", "circular", "end"),
        "end": (),
    },
    comment="#",
)
ZONE_MM = 0.0  # every target is reached


@dataclass
class Lines:
    """The dialect: one job as text, and back."""

    job: ProgramJob

    def head(self) -> Iterator[str]:
        """Name, remarks, tool; where the turntable must stand."""
        tool, angles = self.job.tool, self.job.turntable_deg
        yield LINES.say("begin", name=self.job.name)
        yield from map(self.remark, self.job.remarks)
        yield LINES.say("tool", pose=[*self.job.tool_centre_point_mm, *tool.quaternion_wxyz])
        if angles is not None:
            if np.ptp(angles) > 0:
                raise InputError(self.job.name, "expected a turntable that stands, got one that turns")
            yield LINES.say("table", angle=angles[0])

    def start(self) -> Iterator[str]:
        """By the axes to the first posture, which is at target 0."""
        joints = self.job.moves.joints_deg
        assert joints is not None  # write_program takes no moves without postures
        yield LINES.say("axes", joints=joints[0])

    def straight(self, i: int) -> Iterator[str]:
        """To target i."""
        yield LINES.say("straight", pose=self._pose(i), feed=self.job.moves.feed_mm_s[i])

    def circular(self, i: int) -> Iterator[str]:
        """Over via i to target i."""
        moves = self.job.moves
        via = [*moves.via_position_mm[i], *moves.via_quaternion_wxyz[i]]
        yield LINES.say("circular", via=via, pose=self._pose(i), feed=moves.feed_mm_s[i])

    def remark(self, text: str) -> str:
        """A comment."""
        return f"# {text}"

    def foot(self) -> Iterator[str]:
        """The end."""
        yield LINES.say("end")

    def documents(self, text: str) -> Mapping[str, str]:
        """One file."""
        return {f"{self.job.name}.lines": text}

    def read(self, files: Mapping[str, str]) -> ProgramMoves:
        """The program back from its file."""
        [(name, text)] = files.items()
        tools, moves, table = dict[str, ProgramTool](), list[ProgramMove](), None
        for said in LINES.read(text, name):
            one = said.values
            if said.form == "tool":
                tools["tool"] = ProgramTool(_matrix(one["pose"]), 0.0, np.zeros(3))
            elif said.form == "table":
                table = one["angle"] * DEG
            elif said.form == "axes":
                joints = np.array(one["joints"]) * DEG
                moves.append(ProgramMove(said.line, "J", "tool", "base", joints=joints, turntable=table))
            elif said.form in ("straight", "circular"):
                via = _matrix(one["via"]) if said.form == "circular" else None
                there, feed = _matrix(one["pose"]), one["feed"]
                move = partial(ProgramMove, said.line, "L" if via is None else "C", "tool", "base", pose=there, via=via)
                moves.append(move(feed_mm_s=feed, zone_mm=ZONE_MM, turntable=table))
        return ProgramMoves("lines", name, tuple(moves), tools, {"base": np.eye(4)})

    def configuration(self, joints: Float, cell: Cell) -> None:
        """The language says none: the robot keeps that of the first posture."""

    def _pose(self, i: int) -> list[float]:
        return [*self.job.moves.position_mm[i], *self.job.moves.quaternion_wxyz[i]]


def _matrix(values: list[float]) -> Float:
    return pose_from(rotation_from_quaternion(np.array(values[3:])), np.array(values[:3]))


@stage("lines.program")
def program(moves: Moves, gate: PathGate, cell: RobotCell | None = None) -> tuple[Document | PathGate | Judgement, ...]:
    """Write the moves in the language of this example, read them back and drive them through the cell."""
    if not isinstance(cell, Cell) or moves.flange_from_point is None:
        raise InputError("lines.program", "expected a robot cell, and moves that rest on postures")
    tool, radius = moves.flange_from_point, moves.toolpath.cutter.diameter_mm / 2
    on_axis = MillingTool(tool[:3, 3] - radius * tool[:3, 0], quaternion_from_rotation(tool[:3, :3]), 0.0, np.zeros(3))
    silent = (*cell.unchecked, "signals and ways to and from home: this language has no words for them")
    written = write_program(
        Lines(ProgramJob("BevelPath", moves, on_axis, ZONE_MM, moves.turntable_deg)),
        gate,
        dataclasses.replace(cell, process=None, unchecked=silent),
    )
    made = (*written.documents, written.gate, written.judgement)
    return tuple(one for one in made if one is not None)
