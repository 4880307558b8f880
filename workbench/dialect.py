"""Programs for robot controllers: what a dialect must be able to write, and the one way from moves to a program.

RAPID and KRL are dialects; a plug-in adds another by the same door (`workbench.api`): a small class with these methods
and a stage that calls `write_program`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from workbench.artefacts import Document, Gate, Moves
from workbench.errors import InputError
from workbench.geometry.poses import quaternion_from_rotation, rotation_from_quaternion
from workbench.units import Float

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

    @property
    def tool_centre_point_mm(self) -> Float:
        """Of the tool with the path's own cutter (3,), in the flange."""
        return self.tool.tool_centre_point_mm(self.moves.toolpath.cutter.diameter_mm / 2.0)

    @property
    def work_object(self) -> tuple[Float, Float]:
        """Position (3,) in mm and quaternion (4,) of the frame of the moves in the robot's base."""
        pose = self.moves.toolpath.base_from_workobject
        if pose is None or self.moves.start_joints_deg is not None:  # postures hold in the base
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
                f"part: {path.part_id or 'unnamed'}",
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

    @property
    def suffix(self) -> str:
        """Of the program's file, with its dot."""
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


def write_program(dialect: Dialect, gate: Gate) -> Document | None:
    """The dialect's job as a file; None where the path did not pass its own checks: then no robot may run it.

    Raises:
        InputError: no moves, or values that no controller could take.
    """
    if not gate.passed:
        return None
    name, moves = dialect.job.name, dialect.job.moves
    columns = (moves.position_mm, moves.quaternion_wxyz, moves.feed_mm_s, moves.via_position_mm[moves.circular])
    if not len(moves.layer) or not all(np.isfinite(column).all() for column in columns) or moves.feed_mm_s.min() <= 0:
        raise InputError(name, "expected moves with finite targets and feeds above 0")
    text = "\n".join([*dialect.head(), *_moves(dialect), *dialect.foot()]) + "\n"
    return Document(name + dialect.suffix, text.encode("ascii"))


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
