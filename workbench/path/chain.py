"""The links of the chain that a plan rests on beside edge and hand-eye pose: tool, turntable, robot."""

from __future__ import annotations

import math
from pathlib import Path

from workbench.artefacts import ChainU
from workbench.result_files.links import tool_u, turntable_u
from workbench.units import DEG

UNKNOWN_AXIS_DEG = 0.05  # u of a tool's axis that was not measured: a spindle's mounting, as in report.sensitivity


def chain_u(tool: Path | None, turntable: Path | None, robot_mm: float) -> ChainU | None:
    """What the files of `calibrate.tcp` and `calibrate.turntable` state, and the robot's accuracy; None: nothing."""
    parts = {}
    if tool is not None:
        parts["tool"] = tool_u(tool, UNKNOWN_AXIS_DEG)
    if turntable is not None:
        parts["turntable"] = turntable_u(turntable)
    if robot_mm > 0.0:
        parts["robot"] = robot_mm, 0.0
    if not parts:
        return None
    return ChainU(
        math.hypot(*(mm for mm, _ in parts.values())), math.hypot(*(deg for _, deg in parts.values())) * DEG, (*parts,)
    )
