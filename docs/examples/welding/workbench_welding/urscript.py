"""`program.urscript`: the path as a URScript program, for controllers of Universal Robots."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from workbench.api import (
    Document,
    Float,
    InputError,
    MillingTool,
    Moves,
    PathGate,
    ProgramJob,
    RobotCell,
    rotation_from_quaternion,
    stage,
    vector_from_rotation,
    write_program,
)

Vector = tuple[float, float, float]
_WORDS = """and break continue def else elif end false for global halt if in local loop mod not or return sec thread
true while xor"""
RESERVED = frozenset(_WORDS.split())


def free_name(name: str) -> str:
    """`name`, if a URScript function may have it; else ValueError."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,31}", name) or name.lower() in RESERVED:
        raise ValueError("expected a letter, then letters, digits and _, at most 32 in all, no word of URScript")
    return name


@stage("program.urscript")
def urscript(
    moves: Moves,
    gate: PathGate,
    cell: RobotCell | None = None,
    *,
    name: Annotated[str, AfterValidator(free_name), Field(description="of the program and its file")] = "BevelPath",
    tool_position_mm: Annotated[Vector, Field(description="in the flange, on the cutter's axis")] = (0.0, 0.0, 400.0),
    tool_mass_kg: Annotated[float, Field(gt=0, le=100, description="of spindle and cutter")] = 5.0,
    tool_centre_of_gravity_mm: Annotated[Vector, Field(description="in the flange")] = (0.0, 0.0, 150.0),
    acceleration_mm_s2: Annotated[float, Field(gt=0, le=10_000, description="of the tool")] = 500.0,
    zone_mm: Annotated[float, Field(ge=0, le=50, description="blend radius; 0: every target is reached")] = 0.3,
) -> tuple[Document, ...]:
    """Write the moves as a URScript program (Universal Robots, The URScript Programming Language: movel, movec).

    Poses are p[x, y, z, rx, ry, rz] in m and rad, in the work object; feeds in m/s. Circular moves have mode 0: the
    orientation goes from one target's to the next's. The tool's frame has the flange's directions. ASCII; names out of
    recordings stand in comments only, filtered. Nothing is written where the gate rejects the path.

    Raises:
        InputError: the moves rest on postures, which this dialect does not write; or the gate does not hold for them.
    """
    if moves.postures is not None:
        raise InputError("program.urscript", "expected moves without postures: program.write takes those")
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    spindle = MillingTool(np.array(tool_position_mm), upright, tool_mass_kg, np.array(tool_centre_of_gravity_mm))
    return write_program(UrScript(ProgramJob(name, moves, spindle, zone_mm), acceleration_mm_s2 / 1000), gate, cell)


@dataclass
class UrScript:
    """The dialect of Universal Robots' controllers."""

    job: ProgramJob
    acceleration_m_s2: float

    @functools.cached_property
    def targets(self) -> list[str]:
        """Poses of the moves' ends, in the base."""
        return placed(self.job.moves.position_mm, self.job.moves.quaternion_wxyz)

    @functools.cached_property
    def vias(self) -> list[str]:
        """Poses of the middles of arcs; not a number for straight moves."""
        return placed(self.job.moves.via_position_mm, self.job.moves.via_quaternion_wxyz)

    def head(self) -> Iterator[str]:
        """Function, tool, load, work object."""
        job, tool = self.job, self.job.tool
        yield f"def {job.name}():"
        yield from (self.remark(one) for one in job.remarks)
        yield f"  set_tcp({poses(job.tool_centre_point_mm[None], tool.quaternion_wxyz[None])[0]})"
        x, y, z = tool.centre_of_gravity_mm / 1000
        yield f"  set_payload({tool.mass_kg:g}, [{x:.6f}, {y:.6f}, {z:.6f}])"
        position_mm, quaternion_wxyz = job.work_object
        yield f"  work_object = {poses(position_mm[None], quaternion_wxyz[None])[0]}"

    def start(self) -> Iterable[str]:
        """Straight from where the robot stands."""
        return [f"  movel({self.targets[0]}, {self._how(0)})"]

    def straight(self, i: int) -> Iterable[str]:
        """Movel."""
        return [f"  movel({self.targets[i]}, {self._how(i)})"]

    def circular(self, i: int) -> Iterable[str]:
        """Movec."""
        return [f"  movec({self.vias[i]}, {self.targets[i]}, {self._how(i)}, mode=0)"]

    def remark(self, text: str) -> str:
        """Up to the end of the line."""
        return f"  # {text}"

    def foot(self) -> Iterable[str]:
        """The end of the function, and its call."""
        return ["end", f"{self.job.name}()"]

    def documents(self, text: str) -> dict[str, str]:
        """One script."""
        return {f"{self.job.name}.script": text}

    def _how(self, i: int) -> str:
        ends = i in (0, len(self.targets) - 1)
        blend_m = 0.0 if ends else self.job.zone_mm / 1000
        return f"a={self.acceleration_m_s2:g}, v={self.job.moves.feed_mm_s[i] / 1000:.6g}, r={blend_m:g}"


def poses(position_mm: Float, quaternion_wxyz: Float) -> list[str]:
    """Poses (k, 3), (k, 4) as p[x, y, z, rx, ry, rz]: m to a micrometre's hundredth, rotation vector in rad."""
    vectors = vector_from_rotation(rotation_from_quaternion(quaternion_wxyz))
    values = np.concatenate([np.round(position_mm / 1000, 8), np.round(vectors, 9)], axis=1) + 0.0
    return ["p[" + ", ".join(f"{x:.9g}" for x in row) + "]" for row in values.tolist()]


def placed(position_mm: Float, quaternion_wxyz: Float) -> list[str]:
    """The same, taken from the work object into the base."""
    return [f"pose_trans(work_object, {pose})" for pose in poses(position_mm, quaternion_wxyz)]
