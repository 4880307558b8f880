"""Around the milling in RAPID: home, approach and retract, spindle, coolant, routines, restart points, stops.

(ABB, RAPID Instructions: ActUnit, SetDO, Stop, VelSet, WaitDI, WaitTime.) A WaitDI that waits longer than its MaxTime
stops the program. Every restart point is a label with all that milling needs behind it, so that a program that is
started there turns its spindle. Statements follow moves to `fine` only: the controller runs ahead of others.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from workbench.dialect import ProgramJob
from workbench.errors import InputError
from workbench.geometry.poses import rotation_from_quaternion
from workbench.program.rapid_words import free_name
from workbench.robot.cell import Cell
from workbench.robot.cell_file import ProcessPart
from workbench.robot.inverse import inverse_kinematics
from workbench.robot.kinematics import forward_kinematics
from workbench.units import DEG, Float

UNUSED = "9E+09"  # an external axis that is not there
MODES = ("    ConfJ\\Off;", "    ConfL\\Off;", "    CirPathMode\\ObjectFrame;")
UNLIMITED = "    VelSet 100,5000;"  # as the controller starts with it


@dataclass
class Skeleton:
    """The statements that a process asks for."""

    job: ProgramJob
    cell: Cell
    process: ProcessPart

    def __post_init__(self) -> None:
        """Refuse names that mean something in RAPID."""
        process, spindle = self.process, self.process.spindle
        names = [
            process.coolant_signal,
            process.mechanical_unit,
            process.home.controller_name,
            *process.before,
            *process.after,
            *((spindle.on_signal, spindle.at_speed_signal) if spindle else ()),
        ]
        for name in filter(None, names):
            try:
                free_name(name)
            except ValueError as error:
                raise InputError(f"{self.cell.source}: $.process", f"{error}, found {name!r}") from None
        if process.coolant_signal and spindle and process.coolant_signal.lower() == spindle.on_signal.lower():
            raise InputError(f"{self.cell.source}: $.process", "expected different signals of spindle and coolant")

    @functools.cached_property
    def layer_starts(self) -> dict[int, int]:
        """Index of the move that begins a layer -> the layer."""
        if not (self.process.restart or self.process.stop_between_layers):
            return {}
        starts: dict[int, int] = {}
        for i, layer in enumerate(self.job.moves.layer.tolist()):
            if layer and layer not in starts.values():
                starts[max(i, 1)] = layer
        return starts

    @property
    def home(self) -> str:
        """Name of the joint target."""
        return self.process.home.controller_name or "jHome"

    def data(self) -> Iterator[str]:
        """Home, and the posture from which the tool goes straight to the first target."""
        home, table = self.process.home, self.job.turntable_deg
        if not home.controller_name:
            yield joint_target("jHome", np.array(home.joints_deg), None if table is None else home.turntable_deg)
        start = self._off(0, self.process.approach_mm, "approach_mm") / DEG
        yield joint_target("jStart", start, None if table is None else float(table[0]))

    @functools.cached_property
    def retract_joints(self) -> Float:
        """The posture (6,) to which the tool goes straight from the last target, rad."""
        return self._off(-1, self.process.retract_mm, "retract_mm")

    @property
    def retracted(self) -> tuple[Float, Float]:
        """Position (1, 3) and quaternion (1, 4) of the tool there, in the work object."""
        moves = self.job.moves
        axis = rotation_from_quaternion(moves.quaternion_wxyz[-1:])[:, :, 2]
        return moves.position_mm[-1:] - self.process.retract_mm * axis, moves.quaternion_wxyz[-1:]

    def _off(self, i: int, distance_mm: float, which: str) -> Float:
        """The posture with the cutter drawn back along its axis from target i: of all, the nearest to the target's."""
        assert self.job.moves.joints_deg is not None
        there = self.job.moves.joints_deg[i] * DEG
        flange = forward_kinematics(self.cell.chain, there)
        flange[:3, 3] -= distance_mm * (flange @ self.cell.flange_from_cutter)[:3, 2]
        branches = inverse_kinematics(self.cell.chain, flange[None])[0]
        near = branches + 2 * np.pi * np.round((there - branches) / (2 * np.pi))
        away = np.abs(near - there).max(axis=1)
        if not np.isfinite(away).any():
            raise InputError(
                f"{self.cell.source}: $.process.{which}",
                f"expected a point that the robot reaches, {distance_mm:g} mm along the cutter's axis is none",
            )
        return np.asarray(near[np.nanargmin(away)])

    def first(self) -> list[str]:
        """Before anything moves."""
        return [f"    {hook};" for hook in self.process.before]

    def start(self, end: str) -> list[str]:
        """To home."""
        return [*self._settings(), f"    MoveAbsJ {self.home}\\NoEOffs,{end}"]

    def _settings(self) -> list[str]:
        process, feed = self.process, self.process.feed
        unit = [f"    ActUnit {process.mechanical_unit};"] if process.mechanical_unit else []
        return unit + ([f"    VelSet {feed.override_percent:g},{feed.most_mm_s:g};"] if feed else [])

    def on(self) -> list[str]:
        """Spindle at speed, then coolant."""
        spindle, coolant = self.process.spindle, self.process.coolant_signal
        said = []
        if spindle:
            at_speed = spindle.at_speed_signal
            wait = f"WaitDI {at_speed},1\\MaxTime:={spindle.wait_s:g}" if at_speed else f"WaitTime {spindle.wait_s:g}"
            said = [f"    SetDO {spindle.on_signal},1;", f"    {wait};"]
        return said + ([f"    SetDO {coolant},1;"] if coolant else [])

    def off(self) -> list[str]:
        """Coolant, then spindle."""
        spindle, coolant = self.process.spindle, self.process.coolant_signal
        signals = [coolant, spindle.on_signal if spindle else None]
        return [f"    SetDO {signal},0;" for signal in signals if signal]

    def layer(self, i: int) -> list[str]:
        """Where a layer begins with move i: a stop between layers, and a restart point."""
        if i not in self.layer_starts:
            return []
        stops = self.process.stop_between_layers and i != min(self.layer_starts)
        again = [f"    layer{self.layer_starts[i]}:", *MODES, *self._settings()] if self.process.restart else []
        return [*([*self.off(), "    Stop;"] if stops else []), *again, *(self.on() if stops or again else [])]

    def end(self, end: str) -> list[str]:
        """Back, off and home."""
        home = f"    MoveAbsJ {self.home}\\NoEOffs,{end}"
        after = [f"    {hook};" for hook in self.process.after]
        return [f"    MoveL retract1,{end}", *self.off(), home, *after, *([UNLIMITED] if self.process.feed else [])]


def joint_target(name: str, joints_deg: Float, turntable_deg: float | None) -> str:
    """A declaration."""
    axes = ",".join(f"{angle:.4f}" for angle in (np.round(joints_deg, 4) + 0.0).tolist())
    first = UNUSED if turntable_deg is None else f"{round(turntable_deg, 4) + 0.0:.4f}"
    return f"  CONST jointtarget {name}:=[[{axes}],[{first},{','.join([UNUSED] * 5)}]];"
