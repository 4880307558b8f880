"""Programs for robot controllers: what a dialect must be able to write, and the one way from moves to a program.

`program.write` has dialects of four makers; a plug-in adds another by the same door (`workbench.api`): a small class
with these methods and a stage that calls `write_program`.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from workbench.artefacts import Document, Moves, PathGate, RobotCell, Toolpath
from workbench.errors import InputError
from workbench.geometry.corners import rounding_mm
from workbench.geometry.poses import quaternion_from_rotation, rotation_from_quaternion
from workbench.units import DEG, Float

LONGEST_REMARK = 70  # characters
UNSAFE = re.compile(r"[^A-Za-z0-9 _.,:+/()=-]")  # everything that any controller could take for more than a comment


@dataclass(frozen=True, slots=True, eq=False)
class MillingTool:
    """The cutter in its spindle on the robot's flange."""

    position_mm: Float  # (3,) in the flange: the point on the cutter's axis beside the middle of the bevel face
    quaternion_wxyz: Float  # (4,) of the frame of a path's points: z from shank to tip, x into the material
    mass_kg: float
    centre_of_gravity_mm: Float  # (3,) in the flange

    def tool_centre_point_mm(self, radius_mm: float) -> Float:
        """The origin of the path's frames (3,) in the flange: on the cutter's flank, a radius along x off its axis."""
        return np.asarray(self.position_mm + radius_mm * rotation_from_quaternion(self.quaternion_wxyz)[:, 0])


@dataclass(frozen=True, slots=True, eq=False)
class ProgramJob:
    """All that a program says: k moves with a tool in a work object."""

    name: str  # of the program and its file
    moves: Moves
    tool: MillingTool
    zone_mm: float  # from a target, where the next move may begin to blend in; 0: every target is reached
    turntable_deg: Float | None = None  # (k,) external axis at each target; None: it is not driven
    rounding_mm: float = 0.05  # by which blending may leave the path: sharper corners are driven to their point

    @property
    def tool_centre_point_mm(self) -> Float:
        """Of the tool with the path's own cutter (3,), in the flange."""
        return self.tool.tool_centre_point_mm(self.moves.toolpath.cutter.diameter_mm / 2.0)

    @property
    def blends(self) -> list[bool]:
        """Whether the next move may blend in before each target (k,)."""
        moves = self.moves
        off = rounding_mm(moves.position_mm, moves.via_position_mm, moves.circular, self.zone_mm)
        free = (off <= self.rounding_mm) & (self.zone_mm > 0)
        free[[0, -1]] = False
        return [bool(one) for one in free]

    @property
    def work_object(self) -> tuple[Float, Float]:
        """Position (3,) in mm and quaternion (4,) of the frame of the moves in the robot's base."""
        pose = self.moves.toolpath.base_from_workobject
        if pose is None or self.moves.postures is not None:  # postures hold in the base
            pose = np.eye(4)
        return pose[:3, 3], quaternion_from_rotation(pose[:3, :3])

    @property
    def remarks(self) -> tuple[str, ...]:
        """What it is and what it was made from, in lines that are safe in a comment."""
        moves, path = self.moves, self.moves.toolpath
        return tuple(
            plain(line)
            for line in (
                f"Milling path of a bevel, {path.bevel_deg:g} deg, root {path.root_mm:g} mm, {len(path.layers)} layers",
                f"part: {path.part.part_id or 'unknown'}",
                f"source: {path.source or 'unnamed'}",
                f"cutter: diameter {path.cutter.diameter_mm:g} mm, {path.cutter.flutes} flutes, right-hand",
                f"{len(moves.layer)} targets for {moves.points_before} points of the path,",
                f"within {moves.chord_tolerance_mm:g} mm and {moves.angle_tolerance_deg:g} deg",
                "Check tool, load and work object before the first run.",
                "The spindle is not started here.",
            )
        )


class Dialect(Protocol):
    """One job in the language of one maker's controllers. Lines are without their ends; i counts the moves from 0."""

    @property
    def job(self) -> ProgramJob:
        """What is to be written."""
        ...

    def head(self) -> Iterable[str]:
        """All before the first move: declarations, tool, work object."""
        ...

    def start(self) -> Iterable[str]:
        """To the first target."""
        ...

    def straight(self, i: int) -> Iterable[str]:
        """A straight move to target i."""
        ...

    def circular(self, i: int) -> Iterable[str]:
        """A circular move over via i to target i."""
        ...

    def remark(self, text: str) -> str:
        """A comment; `text` is plain."""
        ...

    def foot(self) -> Iterable[str]:
        """All after the last move."""
        ...

    def documents(self, text: str) -> Mapping[str, str]:
        """File names and texts of the program whose lines are `text`: mostly one."""
        ...


def write_program(dialect: Dialect, gate: PathGate | None, cell: RobotCell | None = None) -> tuple[Document, ...]:
    """The dialect's job as files; none where the path did not pass its checks: then no robot may run it.

    Args:
        dialect: the job in its language.
        gate: the decision on the path of the job's moves.
        cell: the robot cell of the pipeline, if it has one.

    Raises:
        InputError: the gate is another path's, or does not hold for these moves (`released`); no moves, or values that
            no controller could take.
    """
    name, moves = dialect.job.name, dialect.job.moves
    if not released(name, moves.toolpath, gate, cell, moves):
        return ()
    columns = (moves.position_mm, moves.quaternion_wxyz, moves.feed_mm_s, moves.via_position_mm[moves.circular])
    if not len(moves.layer) or not all(np.isfinite(column).all() for column in columns) or moves.feed_mm_s.min() <= 0:
        raise InputError(name, "expected moves with finite targets and feeds above 0")
    said = (dialect.remark(line) for line in reservations(gate)) if gate else ()
    text = "\n".join([*dialect.head(), *said, *_moves(dialect), *dialect.foot()]) + "\n"
    return tuple(Document(file, content.encode("ascii")) for file, content in dialect.documents(text).items())


def released(name: str, toolpath: Toolpath, gate: PathGate | None, cell: RobotCell | None,
             moves: Moves | None = None) -> bool:  # fmt: skip
    """Whether the path may be run, as far as this pipeline can know.

    Raises:
        InputError: no decision on this very path; a cell, but no postures; moves that leave the path farther than its
            check allows for.
    """
    if gate is None or gate.toolpath is not toolpath:
        raise InputError(name, "expected a path that was checked: the gate is not this path's (path.check after the "
                         "last stage that changes it)")  # fmt: skip
    if not gate.passed:
        return False
    if (cell is not None or gate.reached) and (not gate.reached or (moves and moves.postures is None)):
        raise InputError(name, "the pipeline knows the robot's cell: expected moves that rest on postures "
                         "(stiffness.posture before path.simplify)")  # fmt: skip
    if moves and (off := deviation_mm(moves)) > gate.tolerance_mm + 1e-9:
        raise InputError(name, f"the moves leave the path by up to {off:.3g} mm, and it was checked for "
                         f"{gate.tolerance_mm:g} mm: expected smaller tolerances of path.simplify")  # fmt: skip
    return True


def deviation_mm(moves: Moves) -> float:
    """How far the cutter may leave its path between targets: off the line, and turned, over half its flutes."""
    lever = moves.toolpath.cutter.flute_length_mm / 2
    return moves.chord_tolerance_mm + lever * math.sin(min(moves.angle_tolerance_deg, 90.0) * DEG)


def reservations(gate: PathGate) -> tuple[str, ...]:
    """Comments on what was not looked at, or with less force than the rule; plain and in short lines."""
    robot = () if gate.reached else ("reach, joint limits and collisions of the robot, which needs its cell",)
    texts = [f"CHECK LOOSENED: {text}" for text in gate.loosened]
    texts += [f"Not checked: {text}" for text in (*gate.unchecked, *robot)]
    return tuple(line for text in texts for line in textwrap.wrap(UNSAFE.sub("?", text), LONGEST_REMARK))


def _moves(dialect: Dialect) -> Iterator[str]:
    circular, layer = dialect.job.moves.circular.tolist(), dialect.job.moves.layer.tolist()
    yield from dialect.start()
    for i in range(1, len(layer)):
        if layer[i] != layer[i - 1]:
            yield dialect.remark(f"layer {layer[i]}" if layer[i] else "through the air")
        yield from dialect.circular(i) if circular[i] else dialect.straight(i)


def plain(text: str) -> str:
    """`text` for a comment: printable ASCII without a meaning to any controller, one line, not long."""
    return UNSAFE.sub("?", text)[:LONGEST_REMARK].strip()


def rounded_feeds(feed_mm_s: Float) -> Float:
    """Feeds (k,) to three significant digits: programs name a speed once for all moves that share it."""
    scale = 10.0 ** (2 - np.floor(np.log10(feed_mm_s)))
    return np.asarray(np.round(feed_mm_s * scale) / scale)
