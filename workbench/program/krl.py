"""`program.krl`: the path as a KRL program for KUKA controllers."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from workbench.artefacts import Document, Moves, PathGate, RobotCell
from workbench.dialect import ProgramJob, rounded_feeds, write_program
from workbench.errors import InputError
from workbench.geometry.poses import rotation_from_quaternion
from workbench.program.parameters import (
    TOOL_CENTRE_OF_GRAVITY_MM,
    TOOL_POSITION_MM,
    UPRIGHT,
    ToolCentreOfGravity,
    ToolMass,
    ToolPosition,
    ToolQuaternion,
    Zone,
    tool,
)
from workbench.stage import stage
from workbench.units import DEG, Float

_WORDS = """and bas bool brake case char circ circ_rel confirm const continue decl def defdat deffct default do else end
enddat endfct endfor endif endloop endswitch endwhile enum exit ext extfct false for frame global goto halt if
import int interrupt is lin lin_rel loop not or ptp ptp_rel public pulse real repeat resume return sec signal spline
struc switch then to trigger true until wait when while xor"""
RESERVED = frozenset(_WORDS.split())


def free_name(name: str) -> str:
    """`name`, if a KRL program may have it; else ValueError."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,23}", name) or name.lower() in RESERVED:
        raise ValueError("expected a letter, then letters, digits and _, at most 24 in all, no word of KRL")
    return name


@stage("program.krl")
def krl(
    moves: Moves,
    gate: PathGate,
    cell: RobotCell | None = None,
    *,
    name: Annotated[str, AfterValidator(free_name), Field(description="of the program and its file")] = "BevelPath",
    tool_position_mm: ToolPosition = TOOL_POSITION_MM,
    tool_quaternion_wxyz: ToolQuaternion = UPRIGHT,
    tool_mass_kg: ToolMass = 15.0,
    tool_centre_of_gravity_mm: ToolCentreOfGravity = TOOL_CENTRE_OF_GRAVITY_MM,
    zone_mm: Zone = 0.3,
) -> Document | None:
    """Write the moves as a KRL program (KUKA System Software, Operating and programming instructions).

    Targets are frames in $BASE: X, Y, Z in mm, and R = Rz(A) Ry(B) Rx(C) with A, B, C in deg. Feeds become $VEL.CP in
    m/s, 3 significant digits. Circular moves turn the tool in the frame of the base ($CIRC_TYPE = #BASE), as
    `path.simplify` assumes. The program begins where the robot stands and goes straight to the first target. ASCII;
    names out of recordings stand in comments only, filtered. Nothing is written where the gate rejects the path.

    Args:
        moves: the path as straight and circular moves.
        gate: of this path's own checks.
        cell: the robot cell, where the pipeline has one: then the moves must rest on postures.
        name: of the program and its file.

    Raises:
        InputError: the moves rest on postures; the gate is another path's; a cell, but no postures; moves that leave
            the path farther than its check allows for.
    """
    if moves.start_joints_deg is not None:
        raise InputError("program.krl", "expected moves without postures: only program.rapid writes a turntable and a "
                         "first posture")  # fmt: skip
    spindle = tool(tool_position_mm, tool_quaternion_wxyz, tool_mass_kg, tool_centre_of_gravity_mm)
    job = ProgramJob(name, moves, spindle, zone_mm, rounding_mm=gate.tolerance_mm if gate else 0.0)
    return write_program(Krl(job), gate, cell)


@dataclass
class Krl:
    """The dialect of KUKA's controllers."""

    job: ProgramJob
    suffix: str = ".src"

    @functools.cached_property
    def frames(self) -> list[str]:
        """Of the targets."""
        return frames(self.job.moves.position_mm, self.job.moves.quaternion_wxyz)

    @functools.cached_property
    def vias(self) -> list[str]:
        """Of the middles of arcs."""
        return frames(self.job.moves.via_position_mm, self.job.moves.via_quaternion_wxyz)

    @functools.cached_property
    def feeds(self) -> list[float]:
        """Of the moves, mm/s."""
        rounded: list[float] = rounded_feeds(self.job.moves.feed_mm_s).tolist()
        return rounded

    @functools.cached_property
    def blends(self) -> list[bool]:
        """Where the next move may blend in."""
        return self.job.blends

    def head(self) -> Iterator[str]:
        """MillingTool, load, base and how to move."""
        job = self.job
        x, y, z = job.tool.centre_of_gravity_mm
        yield from ("&ACCESS RVP", f"DEF {job.name} ( )")
        yield from (f"  ; {remark}" for remark in job.remarks)
        yield "  BAS (#INITMOV,0)"
        yield f"  $TOOL={frame(job.tool_centre_point_mm, job.tool.quaternion_wxyz)}"
        centre = f"CM {{X {x:.4f},Y {y:.4f},Z {z:.4f},A 0.0,B 0.0,C 0.0}}"
        yield f"  $LOAD={{M {job.tool.mass_kg:g},{centre},J {{X 0.0,Y 0.0,Z 0.0}}}}"
        yield f"  $BASE={frame(*job.work_object)}"
        yield from ("  $IPO_MODE=#BASE", "  $ORI_TYPE=#VAR", "  $CIRC_TYPE=#BASE", f"  $APO.CDIS={job.zone_mm:g}")

    def start(self) -> Iterable[str]:
        """A program must begin with PTP: to where the robot stands."""
        return ["  PTP $AXIS_ACT", f"  $VEL.CP={self.feeds[0] / 1000:.9g}", f"  LIN {self.frames[0]}"]

    def straight(self, i: int) -> Iterable[str]:
        """LIN."""
        return [*self._feed(i), f"  LIN {self.frames[i]}{self._blend(i)}"]

    def circular(self, i: int) -> Iterable[str]:
        """CIRC."""
        return [*self._feed(i), f"  CIRC {self.vias[i]},{self.frames[i]}{self._blend(i)}"]

    def remark(self, text: str) -> str:
        """Up to the end of the line."""
        return f"  ; {text}"

    def foot(self) -> Iterable[str]:
        """The end."""
        return ["END"]

    def _feed(self, i: int) -> list[str]:
        return [f"  $VEL.CP={self.feeds[i] / 1000:.9g}"] if self.feeds[i] != self.feeds[i - 1] else []

    def _blend(self, i: int) -> str:
        return " C_DIS" if self.blends[i] else ""


def euler_deg(quaternion_wxyz: Float) -> Float:
    """A, B, C (k, 3) in deg with R = Rz(A) Ry(B) Rx(C); where B is +-90 deg only A -+ C counts, and C is 0."""
    r = rotation_from_quaternion(quaternion_wxyz)
    cosine = np.hypot(r[:, 0, 0], r[:, 1, 0])
    level = cosine < 1e-9
    a = np.where(level, np.arctan2(-r[:, 0, 1], r[:, 1, 1]), np.arctan2(r[:, 1, 0], r[:, 0, 0]))
    b = np.arctan2(-r[:, 2, 0], cosine)
    c = np.where(level, 0.0, np.arctan2(r[:, 2, 1], r[:, 2, 2]))
    return np.stack([a, b, c], axis=1) / DEG


def frames(position_mm: Float, quaternion_wxyz: Float) -> list[str]:
    """Poses (k, 3), (k, 4) as aggregates of KRL; 6 decimals of a degree are below 0.00001 deg."""
    values = np.concatenate([np.round(position_mm, 4), np.round(euler_deg(quaternion_wxyz), 6)], axis=1) + 0.0
    return [f"{{X {x:.4f},Y {y:.4f},Z {z:.4f},A {a:.6f},B {b:.6f},C {c:.6f}}}" for x, y, z, a, b, c in values.tolist()]


def frame(position_mm: Float, quaternion_wxyz: Float) -> str:
    """One pose."""
    return frames(position_mm[None], quaternion_wxyz[None])[0]
