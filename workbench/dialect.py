"""Programs for robot controllers: what a dialect must be able to write, and the one way from moves to a program.

`program.write` has dialects of five makers; a plug-in adds another by the same door (`workbench.api`): a small class
with these methods and a stage that calls `write_program`.
"""

from __future__ import annotations

import dataclasses
import math
import re
import textwrap
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from workbench.artefacts import (
    Check,
    Document,
    Judgement,
    Moves,
    Nearest,
    Part,
    PathGate,
    ProgramMoves,
    RobotCell,
    Toolpath,
    Violation,
)
from workbench.artefacts.decisions import NOT_CHECKED, SHAPE_ONLY
from workbench.artefacts.showing import shown
from workbench.errors import InputError
from workbench.geometry.moves import rounding_mm
from workbench.geometry.poses import quaternion_from_rotation, rotation_from_quaternion
from workbench.strict_json import strict_json
from workbench.units import DEG, Bool, Float, Shaped

LONGEST_REMARK = 70  # characters
PROBED = (
    "where the part stands: the program stops at a point of the path, with the spindle off, for the operator to see"
)
SPELT = str.maketrans(  # what has a meaning to some controller, or no sign in ASCII
    {";": ",", "[": "(", "]": ")", "%": "percent", "°": " deg", "µ": "u", "μ": "u", "±": "+-", "ß": "ss", "–": "-"}
    | {"œ": "oe", "Œ": "Oe", "æ": "ae", "Æ": "Ae", "ø": "o", "Ø": "O", "ł": "l", "Ł": "L", "đ": "d", "Đ": "D"}
    | dict.fromkeys("'\"`<>^’“”«»„")
)
UNSAFE = re.compile(r"[^A-Za-z0-9 _.,:+/()=-]")  # everything that any controller could take for more than a comment


@shown
@dataclass(frozen=True, slots=True, eq=False)
class MillingTool:
    """The cutter in its spindle on the robot's flange."""

    position_mm: Shaped[Float, " 3"]  # in the flange: on the cutter's axis, beside the middle of the bevel face
    quaternion_wxyz: Shaped[Float, " 4"]  # of the frame of a path's points: z from shank to tip, x into the material
    mass_kg: float
    centre_of_gravity_mm: Shaped[Float, " 3"]  # in the flange

    def tool_centre_point_mm(self, radius_mm: float) -> Float:
        """The origin of the path's frames (3,) in the flange: on the cutter's flank, a radius along x off its axis."""
        return np.asarray(self.position_mm + radius_mm * rotation_from_quaternion(self.quaternion_wxyz)[:, 0])


@shown
@dataclass(frozen=True, slots=True, eq=False)
class ProgramJob:
    """All that a program says: k moves with a tool in a work object."""

    name: str  # of the program and its file
    moves: Moves
    tool: MillingTool
    zone_mm: float  # from a target, where the next move may begin to blend in; 0: every target is reached
    # External axis at each target, tilt and turntable in columns; None: none is driven.
    turntable_deg: Shaped[Float, "k ..."] | None = None
    rounding_mm: float = 0.05  # by which blending may leave the path: sharper corners are driven to their point
    base_from_workobject: Float = field(default_factory=lambda: np.eye(4))  # of the frame of the moves
    tool_name: str | None = None  # of a tool that is measured on the controller; None: the program declares it
    work_object_name: str | None = None  # of a frame that is measured on the controller; None: the program declares it
    too_sudden: Shaped[Bool, " k"] | None = (
        None  # where blending asks more of a joint than its acceleration; None: not known
    )

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
        if self.too_sudden is not None:
            free &= ~self.too_sudden
        return [bool(one) for one in free]

    @property
    def work_object(self) -> tuple[Float, Float]:
        """Position (3,) in mm and quaternion (4,) of the frame of the moves in the robot's base."""
        pose = self.base_from_workobject
        return pose[:3, 3], quaternion_from_rotation(pose[:3, :3])

    @property
    def remarks(self) -> tuple[str, ...]:
        """What it is and what it was made from, in lines that are safe in a comment."""
        moves, path = self.moves, self.moves.toolpath
        axes = 1 if self.turntable_deg is None else self.turntable_deg.ndim
        about = [line for text in path.about for line in textwrap.wrap(_safe(text), LONGEST_REMARK)]
        return tuple(
            plain(line)
            for line in (
                *(about or self._milling),
                f"part: {path.part.part_id or 'unknown'}",
                f"source: {path.source or 'unnamed'}",
                *(("External axis 1: the track under the robot, mm",) if moves.on_track else ()),
                *(("External axes: 1 the tilt, 2 the turntable on it",) if axes > 1 else ()),
                f"{len(moves.layer)} targets for {moves.points_before} points of the path,",
                f"within {moves.chord_tolerance_mm:g} mm and {moves.angle_tolerance_deg:g} deg",
                "Check tool, load and work object before the first run.",
            )
        )

    @property
    def _milling(self) -> tuple[str, ...]:
        """What a milling path's head says of it."""
        path = self.moves.toolpath
        return (
            f"Milling path of a {path.shape}, {path.bevel_deg:g} deg, root face {path.root_mm:g} mm"
            + (f", radius {path.root_radius_mm:g} mm" if path.root_radius_mm else "")
            + f", {len(path.layers)} layers",
            f"cutter: diameter {path.cutter.diameter_mm:g} mm, {path.cutter.flutes} flutes, right-hand"
            + (", ball end" if path.cutter.ball_end else ""),
        )


class Dialect(Protocol):
    """One job in the language of one maker's controllers. Lines are without their ends; i counts the moves from 0."""

    @property
    def job(self) -> ProgramJob:
        """What is to be written."""

    def head(self) -> Iterable[str]:
        """All before the first move: declarations, tool, work object."""

    def start(self) -> Iterable[str]:
        """To the first target."""

    def straight(self, i: int) -> Iterable[str]:
        """A straight move to target i."""

    def circular(self, i: int) -> Iterable[str]:
        """A circular move over via i to target i."""

    def remark(self, text: str) -> str:
        """A comment; `text` is plain."""

    def foot(self) -> Iterable[str]:
        """All after the last move."""

    def documents(self, text: str) -> Mapping[str, str]:
        """File names and texts of the program whose lines are `text`: mostly one."""

    def read(self, files: Mapping[str, str]) -> ProgramMoves:
        """The program back from its files (name -> text), strictly: what it does not know is refused."""

    def configuration(self, joints: Float, cell: Any) -> tuple[int, ...] | None:
        """Of a posture (6,) in a cell, rad, as this dialect counts it; None: its programs say none."""


class Written(NamedTuple):
    """A program's files, the decision on them, and what came of driving them."""

    documents: tuple[Document, ...]  # none where the program may not run
    gate: PathGate
    judgement: Judgement | None  # None: there is no cell to drive it through


def write_program(
    dialect: Dialect, gate: PathGate | None, cell: RobotCell | None = None, checks: tuple[Check, ...] = ()
) -> Written:
    """The dialect's job as files, read back from them and driven through the cell: what fails leaves no program.

    Args:
        dialect: the job in its language.
        gate: the decision on the path of the job's moves.
        cell: the robot cell of the pipeline; without one no program is written.
        checks: that the job passed besides, for the record.

    Raises:
        InputError: the gate is another path's, or does not hold for these moves (`released`); no moves, or values that
            no controller could take; a program that its own reader refuses.
    """
    name, moves = dialect.job.name, dialect.job.moves
    free = released(name, moves.toolpath, gate, cell, moves)
    assert gate is not None
    if not free or cell is None or (gate.shape_only and not cell.probes):
        return Written((), gate, None)
    if gate.shape_only:
        kept = tuple(text for text in gate.loosened if not text.startswith(SHAPE_ONLY))
        gate = dataclasses.replace(gate, loosened=kept, unchecked=(*gate.unchecked, PROBED))
    silent = tuple(f"{NOT_CHECKED}{text}" for text in cell.unchecked)
    gate = dataclasses.replace(gate, loosened=gate.loosened + silent, unchecked=gate.unchecked + cell.unseen)
    files = program_files(dialect, gate)
    judgement = cell.judge(dialect.read(files), moves, gate.tolerance_mm, dialect.configuration)
    late = tuple(f"{NOT_CHECKED}{text}" for text in judgement.unchecked if text not in gate.left_open)
    gate = dataclasses.replace(gate, loosened=gate.loosened + late)
    record = Document("program_check.json", judgement_document(judgement, moves.toolpath.part, checks))
    if judgement.passed:
        reason = f"{gate.reason}; the program was driven through its cell: {_least(judgement)}"
        programs = tuple(Document(file, content.encode("ascii")) for file, content in files.items())
        return Written((*programs, record), dataclasses.replace(gate, reason=reason), judgement)
    first, more = judgement.violations[0], len(judgement.violations) - 1
    also = f"; and {more} more (program_check.json)" if more else ""
    refused = dataclasses.replace(gate, passed=False, reason=f"program refused: {place(first)}{also}")
    return Written((record,), refused, judgement)


def program_files(dialect: Dialect, gate: PathGate) -> Mapping[str, str]:
    """The text of each file of the program, by name: not judged yet.

    Raises:
        InputError: no moves, or values that no controller could take.
    """
    moves = dialect.job.moves
    columns = (moves.position_mm, moves.quaternion_wxyz, moves.feed_mm_s, moves.via_position_mm[moves.circular])
    if not len(moves.layer) or not all(np.isfinite(column).all() for column in columns) or moves.feed_mm_s.min() <= 0:
        raise InputError(dialect.job.name, "expected moves with finite targets and feeds above 0")
    said = (dialect.remark(line) for line in reservations(gate))
    return dialect.documents("\n".join([*dialect.head(), *said, *_moves(dialect), *dialect.foot()]) + "\n")


def place(violation: Violation) -> str:
    """A violation in words: where, and what."""
    return f"line {violation.line}, at {violation.arc_length_mm:.1f} mm of its way: {violation.finding}"


def _least(judgement: Judgement) -> str:
    pair = " and ".join(judgement.clearance_pair) if judgement.clearance_pair else "nothing"
    clearance = f"{judgement.clearance_mm:.1f} mm between {pair}" if judgement.clearance_pair else "nothing could touch"
    if judgement.nearest is not None:
        clearance += f" is proven, {nearest_words(judgement.nearest)}"
    return (
        f"clearance at least {clearance}, {judgement.limit_margin / DEG:.2f} deg to the nearest limit, deviation "
        f"{judgement.deviation_mm:.3f} mm"
    )


def nearest_words(found: Nearest) -> str:
    """The least measured distance and its place."""
    pair = " and ".join(found.pair)
    return f"measured {found.distance_mm:.1f} mm between {pair} in line {found.line}, at {found.arc_length_mm:.0f} mm"


def judgement_document(judgement: Judgement, part: Part, checks: tuple[Check, ...] = ()) -> bytes:
    """`program_check.json`: what was driven, how near it came to anything, and what is wrong."""
    return strict_json(
        {
            "format": "program-check",
            "version": 1,
            "part": dataclasses.asdict(part),
            "dialect": judgement.program.dialect,
            "program": judgement.program.name,
            "passed": judgement.passed,
            "violations": [
                {"line": one.line, "arc_length_mm": _known(one.arc_length_mm), "kind": one.kind, "finding": one.finding}
                for one in judgement.violations
            ],
            "not_checked": list(judgement.unchecked),
            "length_mm": _known(judgement.length_mm),
            "time_s": _known(judgement.time_s),
            "stops": judgement.stops,
            "stops_counted": judgement.stops_counted,
            "postures": judgement.postures,
            "clearance_mm": _known(judgement.clearance_mm),
            "clearance_pair": judgement.clearance_pair,
            "nearest": None if judgement.nearest is None else dataclasses.asdict(judgement.nearest),
            "limit_margin_deg": _known(judgement.limit_margin / DEG),
            "wrist_deg": _known(judgement.wrist / DEG),
            "condition": _known(judgement.condition),
            "speed_share": _known(judgement.speed_share),
            "deviation_mm": _known(judgement.deviation_mm),
            "checks": [
                {"name": one.name, "value": one.value, "limit": one.limit, "passed": one.passed} for one in checks
            ],
        }
    )


def _known(value: float) -> float | None:
    return round(value, 6) if math.isfinite(value) else None


def released(
    name: str, toolpath: Toolpath, gate: PathGate | None, cell: RobotCell | None, moves: Moves | None = None
) -> bool:
    """Whether the path may be run, as far as this pipeline can know.

    Raises:
        InputError: no decision on this very path; a cell, but no postures; moves that leave the path farther than its
            check allows for.
    """
    if gate is None or gate.toolpath is not toolpath:
        raise InputError(
            name,
            "expected a path that was checked: the gate is not this path's (path.check after the "
            "last stage that changes it)",
        )
    if not gate.passed:
        return False
    if (cell is not None or gate.reached) and (not gate.reached or (moves and moves.postures is None)):
        raise InputError(
            name,
            "the pipeline knows the robot's cell: expected moves that rest on postures "
            "(stiffness.posture before path.simplify)",
        )
    if moves and (off := deviation_mm(moves)) > gate.tolerance_mm + 1e-9:
        raise InputError(
            name,
            f"the moves leave the path by up to {off:.3g} mm, and it was checked for "
            f"{gate.tolerance_mm:g} mm: expected smaller tolerances of path.simplify",
        )
    return True


def deviation_mm(moves: Moves) -> float:
    """How far the cutter may leave its path between targets: off the line, and turned, over half its flutes."""
    lever = moves.toolpath.cutter.flute_length_mm / 2
    return moves.chord_tolerance_mm + lever * math.sin(min(moves.angle_tolerance_deg, 90.0) * DEG)


def reservations(gate: PathGate) -> tuple[str, ...]:
    """Comments on what was not looked at, or with less force than the rule; plain and in short lines."""
    texts = [text if text.startswith(NOT_CHECKED) else f"CHECK LOOSENED: {text}" for text in gate.loosened]
    texts += [f"{NOT_CHECKED}{text}" for text in gate.unchecked]
    return tuple(line for text in texts for line in textwrap.wrap(_safe(text), LONGEST_REMARK))


def _moves(dialect: Dialect) -> Iterator[str]:
    circular, layer = dialect.job.moves.circular.tolist(), dialect.job.moves.layer.tolist()
    yield from dialect.start()
    for i in range(1, len(layer)):
        if layer[i] != layer[i - 1]:
            yield dialect.remark(f"layer {layer[i]}" if layer[i] else "travel")
        yield from dialect.circular(i) if circular[i] else dialect.straight(i)


def plain(text: str) -> str:
    """`text` for a comment: printable ASCII without a meaning to any controller, one line, not long."""
    return _safe(text)[:LONGEST_REMARK].strip()


def _safe(text: str) -> str:
    """In characters that no controller could take for more than a comment; the root of a place goes unseen."""
    spelt = unicodedata.normalize("NFKD", text.replace("$.", "").translate(SPELT))
    return UNSAFE.sub("?", "".join(one for one in spelt if not unicodedata.combining(one)))


def rounded_feeds(feed_mm_s: Float) -> Float:
    """Feeds (k,) to three significant digits: programs name a speed once for all moves that share it."""
    scale = 10.0 ** (2 - np.floor(np.log10(feed_mm_s)))
    return np.asarray(np.round(feed_mm_s * scale) / scale)
