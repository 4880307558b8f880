"""URScript, the language of Universal Robots.

(Universal Robots, The URScript Programming Language: movej, movel, movec, set_tcp, set_payload, popup.) Poses are
p[x, y, z, rx, ry, rz] in m and rotation vector, in the robot's base (`base_frame` of the cell: the controller's base,
not the URDF's base_link); joint angles in rad, feeds in m/s, accelerations in m/s^2. The program begins with movej to
the first posture. Circular moves have mode 0: the orientation goes from one target's to the next's. The blend radius
stays below half of either move: where blends overlap, the controller leaves a move out, and the reader refuses. There
are no external axes: a turntable that turns along the path is refused; one that stands is asked for by a popup that
waits. There are no labels: a program begins at its begin. Waits without end for a speed.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from workbench.artefacts import EventKind, ProgramTool
from workbench.dialect import rounded_feeds
from workbench.geometry.moves import chords_mm
from workbench.geometry.poses import pose_from, rotation_from_quaternion, rotation_from_vector, vector_from_rotation
from workbench.language import NUMBER, Language, row
from workbench.program.reading import Reading
from workbench.program.skeleton import CellDialect, check_standing_turntable, check_words, tidy
from workbench.robot.cell_model import Cell
from workbench.units import DEG, Float

ACCELERATION_M_S2 = 0.5  # of the tool
JOINT_SPEED, JOINT_ACCELERATION = 0.35, 0.5  # rad/s, rad/s^2: on the way to the first posture
SHARE = 0.45  # of a move's length that a blend may take at either end
TOOL, BASE = "tcp", "base"
ASKED = {"": "Go on with the next layer?", "probe": "Is the tip where the part has it?"}
POSE, VIA = (f"p[{row([''] * 6, field, '.9g', ', ')}]" for field in ("pose", "via"))
END = "a={acceleration:g}, v={feed:.9g}, r={radius:.6f}"
BODY = ("straight", "circular", "axes", "switch_on", "switch_off", "wait_speed", "wait_time", "stop", "hook", "end")
SCRIPT = Language(
    forms={
        "begin": "def {name}():",
        "tcp": f"  set_tcp({POSE})",
        "payload": f"  set_payload({{mass:g}}, [{row([''] * 3, 'centre', '.6f', ', ')}])",
        "turntable": '  popup("Turntable at {angle:.4f} deg?", title="Turntable", blocking=True)',
        "axes": f"  movej([{row([''] * 6, 'joints', '.9f', ', ')}], a={{acceleration:g}}, v={{speed:g}})",
        "straight": f"  movel({POSE}, {END})",
        "circular": f"  movec({VIA}, {POSE}, {END}, mode=0)",
        "switch_on": "  set_standard_digital_out({signal}, True)",
        "switch_off": "  set_standard_digital_out({signal}, False)",
        "wait_speed": "  while not get_standard_digital_in({signal}):\n    sync()\n  end",
        "wait_time": "  sleep({seconds})",
        "stop": '  popup("{asked}", title="Stop", blocking=True)',
        "hook": "  {value}()",
        "end": "end\n{name}()",
    },
    order={
        "": ("begin",),
        "begin": ("hook", "tcp"),
        "tcp": ("payload",),
        "payload": ("turntable", "axes"),
        "turntable": ("axes",),
        "axes": BODY,
        "end": (),
    },
    kinds={"signal": "[0-9]+", "seconds": NUMBER, "asked": r'[^"\r\n]*'},
    comment="#",
)


class Script(Reading):
    """The program, statement by statement, for the robot of a cell: its slowest joint tells the share of a speed."""

    language, dialect, suffix = SCRIPT, "ur", ".script"
    at: float | None = None  # rad: where a message asks for the turntable

    def __init__(self, cell: Cell) -> None:
        super().__init__(cell)
        self.slowest = float(np.min(cell.chain.speeds))
        self.tool, self.work_object, self.objects = TOOL, BASE, {BASE: np.eye(4)}

    def begin(self, name: str) -> None:
        self.called = name

    def tcp(self, pose: list[float]) -> None:
        self.flange_from_tool = _pose(pose)

    def payload(self, mass: float, centre: list[float]) -> None:
        self.tools = {TOOL: ProgramTool(self.flange_from_tool, mass, np.array(centre) * 1000)}

    def turntable(self, angle: float) -> None:
        self.at = angle * DEG

    def axes(self, joints: list[float], acceleration: float, speed: float) -> None:
        if acceleration <= 0:
            self.refuse("an acceleration above 0")
        self.by_joints(speed / self.slowest, np.array(joints), self.at)

    def straight(
        self, pose: list[float], acceleration: float, feed: float, radius: float, via: list[float] | None = None
    ) -> None:
        last, there, zone = self.moves[-1], _pose(pose), 1000 * radius
        if acceleration <= 0:
            self.refuse("an acceleration above 0")
        if last.pose is not None and radius:
            chord = float(np.linalg.norm(there[:3, 3] - last.pose[:3, 3]))
            if last.zone_mm + zone > chord:
                self.refuse(f"blends that do not overlap: {last.zone_mm:g} and {zone:g} mm on {chord:.3g} mm")
        self.in_space(there, _pose(via) if via else None, 1000 * feed, zone, turntable=self.at)

    circular = straight

    def end(self, name: str) -> None:
        if name != self.called:
            self.refuse(f"{self.called}()", f"{name}()")


def _pose(values: list[float]) -> Float:
    return pose_from(rotation_from_vector(np.array(values[3:])), np.array(values[:3]) * 1000)


@dataclass
class UrScript(CellDialect):
    """The dialect of Universal Robots' controllers."""

    language, reader, note = SCRIPT, Script, "  # "
    by_joints: ClassVar[Mapping[str, float]] = {"acceleration": JOINT_ACCELERATION, "speed": JOINT_SPEED}

    def __post_init__(self) -> None:
        """Refuse what the controller cannot do."""
        check_standing_turntable(self.job, self.cell, "controllers of Universal Robots drive no external axis")
        check_words(self.cell, "UR", signals="numbers", home=("(?!)", "null, since programs say home themselves,"))

    def fields(self, kind: EventKind, value: str) -> dict[str, Any]:
        """A stop asks."""
        return {**super().fields(kind, value), "asked": ASKED.get(value, "")}

    @functools.cached_property
    def targets(self) -> list[list[float]]:
        """Poses of the moves' ends, in the base."""
        return poses(*self._in_base(self.job.moves.position_mm, self.job.moves.quaternion_wxyz))

    @functools.cached_property
    def vias(self) -> list[list[float]]:
        """Poses of the middles of arcs; not a number for straight moves."""
        return poses(*self._in_base(self.job.moves.via_position_mm, self.job.moves.via_quaternion_wxyz))

    @functools.cached_property
    def ends(self) -> list[dict[str, float]]:
        """How each move is made."""
        moves = self.job.moves
        chord = chords_mm(moves.position_mm)
        room = SHARE * np.minimum(np.append(0.0, chord), np.append(chord, 0.0))
        blend = np.where(self.blends, np.minimum(self.job.zone_mm, room), 0.0)
        feed = rounded_feeds(self.limited_mm_s) / 1000
        rows = zip(feed.tolist(), (np.floor(blend * 1000) / 1e6).tolist(), strict=True)
        return [{"acceleration": ACCELERATION_M_S2, "feed": feed, "radius": r} for feed, r in rows]

    def head(self) -> list[str]:
        """Function, tool, load; where the turntable must stand."""
        job, tool = self.job, self.job.tool
        turn = rotation_from_quaternion(tool.quaternion_wxyz)[None]
        asked = [] if job.turntable_deg is None else [SCRIPT.say("turntable", angle=job.turntable_deg[0] + 0.0)]
        return [
            SCRIPT.say("begin", name=job.name),
            *map(self.remark, job.remarks),
            *self.events("first"),
            SCRIPT.say("tcp", pose=poses(job.tool_centre_point_mm[None], turn)[0]),
            SCRIPT.say("payload", mass=tool.mass_kg, centre=tool.centre_of_gravity_mm / 1000),
            *asked,
        ]

    def place(self, where: int | str) -> dict[str, Any]:
        """The places themselves."""
        if where == "retract" and self.skeleton is not None:
            return {"pose": poses(*self._in_base(*self.skeleton.retracted))[0]}
        if isinstance(where, str) and where in self.postures:
            return {"joints": tidy(self.postures[where][0] * DEG, 9)}
        i = 0 if isinstance(where, str) else where
        return {"pose": self.targets[i], "via": self.vias[i]}

    def configuration(self, joints: Float, cell: Cell) -> None:
        """URScript says none: the robot keeps that of the first posture."""

    def documents(self, text: str) -> dict[str, str]:
        """One script."""
        return {f"{self.job.name}.script": text}

    def _in_base(self, position_mm: Float, quaternion_wxyz: Float) -> tuple[Float, Float]:
        """Positions (k, 3) and rotations (k, 3, 3) of targets."""
        place, turn = self.job.work_object
        base_from_object = pose_from(rotation_from_quaternion(turn), place)
        return (
            position_mm @ base_from_object[:3, :3].T + place,
            base_from_object[:3, :3] @ rotation_from_quaternion(quaternion_wxyz),
        )


def poses(position_mm: Float, rotation: Float) -> list[list[float]]:
    """x, y, z, rx, ry, rz of poses (k, 3), (k, 3, 3): m to a hundredth of a micrometre, rotation vector in rad."""
    finite = np.isfinite(position_mm).all(axis=1)
    vectors = np.full_like(position_mm, np.nan)
    vectors[finite] = vector_from_rotation(rotation[finite])
    rows: list[list[float]] = (
        np.concatenate([np.round(position_mm / 1000, 8), np.round(vectors, 9)], axis=1) + 0.0
    ).tolist()
    return rows
