"""RAPID, ABB's language: the path as a module (ABB, RAPID Instructions, Functions and Data types).

Targets in mm and quaternions w x y z, in the work object; unused external axes 9E+09. Positions have 4 decimals,
quaternions 8: the rounding stays below 0.0001 mm and 0.00001 deg, less than the controller's own single precision.
Feeds have 3 significant digits, one speeddata each. Where the moves rest on postures the program begins with MoveAbsJ
to the first one, the tool is the cell's, targets are in the base, and the turntable is the external axis eax_a. Axis
configurations are not monitored: from its first posture on, the robot keeps its configuration; circular moves turn
the tool in the frame of the work object (`CirPathMode\\ObjectFrame`), as `path.simplify` assumes.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from workbench.dialect import ProgramJob, rounded_feeds
from workbench.units import Float, Int

UNUSED = "9E+09"  # an external axis that is not there
TURN_DEG_S = 50  # where the orientation alone moves


@dataclass
class Rapid:
    """The dialect of ABB's controllers."""

    job: ProgramJob
    procedure: str
    tool_name: str
    work_object_name: str

    @functools.cached_property
    def feeds(self) -> tuple[Float, Int]:
        """The distinct feeds in mm/s, and which of them each move has."""
        distinct, which = np.unique(rounded_feeds(self.job.moves.feed_mm_s), return_inverse=True)
        return distinct, which

    @functools.cached_property
    def ends(self) -> list[str]:
        """All that stands behind the target of each move: speed, zone, tool and work object."""
        which = self.feeds[1].tolist()
        zones = ["zonePath" if blends else "fine" for blends in self.job.blends]
        tail = f"{self.tool_name}\\WObj:={self.work_object_name};"
        return [f"feed{w + 1},{zone},{tail}" for w, zone in zip(which, zones, strict=True)]

    def head(self) -> Iterator[str]:
        """Declarations: tool, work object, zone, speeds, targets."""
        job = self.job
        load = f"[{job.tool.mass_kg:g},{_vector(job.tool.centre_of_gravity_mm)},[1,0,0,0],0,0,0]"
        frame = _pose(job.tool_centre_point_mm, job.tool.quaternion_wxyz)
        z = job.zone_mm
        yield f"MODULE {job.name}"
        yield from (f"  ! {remark}" for remark in job.remarks)
        yield f"  PERS tooldata {self.tool_name}:=[TRUE,{frame},{load}];"
        yield f'  TASK PERS wobjdata {self.work_object_name}:=[FALSE,TRUE,"",{_pose(*job.work_object)},{NO_POSE}];'
        if z:
            yield f"  CONST zonedata zonePath:=[FALSE,{z:g},{z:g},{z:g},{z / 10:g},{z:g},{z / 10:g}];"
        for i, feed in enumerate(self.feeds[0].tolist(), 1):
            yield f"  CONST speeddata feed{i}:=[{feed:.7g},{TURN_DEG_S},5000,1000];"
        yield from _targets("p", np.arange(len(job.moves.layer)), job.moves.position_mm, job.moves.quaternion_wxyz,
                            job.turntable_deg)  # fmt: skip
        arcs = np.flatnonzero(job.moves.circular)
        yield from _targets("via", arcs, job.moves.via_position_mm, job.moves.via_quaternion_wxyz, _halfway(job))
        yield from self._start_posture()
        yield f"  PROC {self.procedure}()"
        yield from ("    ConfJ\\Off;", "    ConfL\\Off;", "    CirPathMode\\ObjectFrame;")

    def start(self) -> Iterable[str]:
        """From wherever the robot stands, to the first target, in its posture where one is given."""
        if self.job.moves.postures is not None:
            return [f"    MoveAbsJ jStart\\NoEOffs,{self.ends[0]}", f"    MoveL p1,{self.ends[0]}"]
        return [f"    MoveJ p1,{self.ends[0]}"]

    def _start_posture(self) -> Iterator[str]:
        """Joint angles of the first target."""
        joints, turntable = self.job.moves.joints_deg, self.job.turntable_deg
        if joints is not None:
            axes = ",".join(f"{angle:.4f}" for angle in (np.round(joints[0], 4) + 0.0).tolist())
            first = UNUSED if turntable is None else f"{_tidy(turntable[:1], 4)[0]:.4f}"
            others = ",".join([UNUSED] * 5)
            yield f"  CONST jointtarget jStart:=[[{axes}],[{first},{others}]];"

    def straight(self, i: int) -> Iterable[str]:
        """MoveL."""
        return [f"    MoveL p{i + 1},{self.ends[i]}"]

    def circular(self, i: int) -> Iterable[str]:
        """MoveC."""
        return [f"    MoveC via{i + 1},p{i + 1},{self.ends[i]}"]

    def remark(self, text: str) -> str:
        """Up to the end of the line."""
        return f"    ! {text}"

    def foot(self) -> Iterable[str]:
        """Settings as the controller starts with them."""
        return ["    CirPathMode\\PathFrame;", "    ConfL\\On;", "    ConfJ\\On;", "  ENDPROC", "ENDMODULE"]

    def documents(self, text: str) -> dict[str, str]:
        """One module."""
        return {f"{self.job.name}.mod": text}


def _halfway(job: ProgramJob) -> Float | None:
    """Where the turntable stands at the middle of each move."""
    if job.turntable_deg is None:
        return None
    return np.append(job.turntable_deg[:1], (job.turntable_deg[1:] + job.turntable_deg[:-1]) / 2)


def _targets(
    prefix: str, indices: Int, position_mm: Float, quaternion: Float, turntable: Float | None
) -> Iterator[str]:
    """One declaration a target, numbered from 1."""
    others = ",".join([UNUSED] * 5)
    axis = [UNUSED] * len(position_mm) if turntable is None else [f"{angle:.4f}" for angle in _tidy(turntable, 4)]
    rows = zip(indices.tolist(), _tidy(position_mm[indices], 4), _tidy(quaternion[indices], 8), strict=True)
    for i, (x, y, z), (w, a, b, c) in rows:
        yield (
            f"  CONST robtarget {prefix}{i + 1}:=[[{x:.4f},{y:.4f},{z:.4f}],[{w:.8f},{a:.8f},{b:.8f},{c:.8f}],"
            f"[0,0,0,0],[{axis[i]},{others}]];"
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
