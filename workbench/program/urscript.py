"""URScript, the language of Universal Robots.

(Universal Robots, The URScript Programming Language: movej, movel, movec, set_tcp, set_payload, popup.) Poses are
p[x, y, z, rx, ry, rz] in m and rotation vector, in the robot's base (`base_frame` of the cell: the controller's base,
not the URDF's base_link); joint angles in rad, feeds in m/s, accelerations in m/s^2. The program begins with movej to
the first posture. Circular moves have mode 0: the orientation goes from one target's to the next's. The blend radius
stays below half of either move: where blends overlap, the controller leaves a move out. There are no external axes: a
turntable that turns along the path is refused; one that stands is asked for by a popup that waits.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from workbench.artefacts import EventKind, ProgramMoves
from workbench.dialect import ProgramJob, rounded_feeds
from workbench.errors import InputError
from workbench.geometry.poses import pose_from, rotation_from_quaternion, vector_from_rotation
from workbench.program.skeleton import (
    Event,
    Skeleton,
    blends_of,
    check_standing_turntable,
    check_words,
    limited,
    skeleton_of,
)
from workbench.program.urscript_reader import read_urscript
from workbench.robot.cell import Cell
from workbench.units import DEG, Float

ACCELERATION_M_S2 = 0.5  # of the tool
JOINT_SPEED, JOINT_ACCELERATION = 0.35, 0.5  # rad/s, rad/s^2: on the way to the first posture
SHARE = 0.45  # of a move's length that a blend may take at either end


@dataclass
class UrScript:
    """The dialect of Universal Robots' controllers."""

    job: ProgramJob
    cell: Cell

    def __post_init__(self) -> None:
        """Refuse what the controller cannot do."""
        check_standing_turntable(self.job, self.cell, "controllers of Universal Robots drive no external axis")
        process = self.cell.process
        if process is None:
            return
        check_words(self.cell, process, "UR", signals="numbers")
        if process.home.controller_name is not None:
            where = f"{self.cell.source}: $.process.home.controller_name"
            raise InputError(
                where, f"expected null for UR: programs say home themselves, found {process.home.controller_name!r}"
            )

    @functools.cached_property
    def skeleton(self) -> Skeleton | None:
        """What the cell's process asks for around the milling."""
        return skeleton_of(self.job, self.cell)

    def event(self, kind: EventKind, value: str) -> list[str]:
        """What happens between moves: digital outputs and inputs, sleep, popup, functions of the installation.

        Waits without end for a speed. There are no labels: a program begins at its begin.
        """
        switched = {"on": "True", "off": "False"}.get(kind.rpartition("_")[2])
        if switched:
            return [f"  set_standard_digital_out({value}, {switched})"]
        words: dict[EventKind, list[str]] = {
            "hook": [f"  {value}()"],
            "feed_limits": [],
            "restart": [],
            "wait_time": [f"  sleep({value})"],
            "stop": ['  popup("Go on with the next layer?", title="Stop", blocking=True)'],
            "wait_speed": [f"  while not get_standard_digital_in({value}):", "    sync()", "  end"],
        }
        return words[kind]

    def _said(self, events: Iterable[Event]) -> list[str]:
        return [line for event in events for line in self.event(*event)]

    @functools.cached_property
    def targets(self) -> list[str]:
        """Poses of the moves' ends, in the base."""
        return poses(*self._in_base(self.job.moves.position_mm, self.job.moves.quaternion_wxyz))

    @functools.cached_property
    def vias(self) -> list[str]:
        """Poses of the middles of arcs; not a number for straight moves."""
        return poses(*self._in_base(self.job.moves.via_position_mm, self.job.moves.via_quaternion_wxyz))

    @functools.cached_property
    def ends(self) -> list[str]:
        """How each move is made."""
        moves = self.job.moves
        chord = np.linalg.norm(np.diff(moves.position_mm, axis=0), axis=1)
        room = SHARE * np.minimum(np.append(0.0, chord), np.append(chord, 0.0))
        blend = np.where(blends_of(self.job, self.skeleton), np.minimum(self.job.zone_mm, room), 0.0)
        feed = rounded_feeds(limited(moves.feed_mm_s, self.cell)) / 1000
        rows = zip(feed.tolist(), (np.floor(blend * 1000) / 1e6).tolist(), strict=True)
        return [f"a={ACCELERATION_M_S2:g}, v={feed:.9g}, r={r:.6f}" for feed, r in rows]

    def head(self) -> Iterator[str]:
        """Function, tool, load; where the turntable must stand."""
        job, tool = self.job, self.job.tool
        yield f"def {job.name}():"
        yield from (self.remark(one) for one in job.remarks)
        yield from self._said(self.skeleton.first) if self.skeleton else ()
        turn = rotation_from_quaternion(tool.quaternion_wxyz)
        yield f"  set_tcp({poses(job.tool_centre_point_mm[None], turn[None])[0]})"
        x, y, z = tool.centre_of_gravity_mm / 1000
        yield f"  set_payload({tool.mass_kg:g}, [{x:.6f}, {y:.6f}, {z:.6f}])"
        if job.turntable_deg is not None:
            yield f'  popup("Turntable at {job.turntable_deg[0] + 0.0:.4f} deg?", title="Turntable", blocking=True)'

    def start(self) -> Iterable[str]:
        """By the joints to the first posture; with a process from home, and straight to the first target."""
        assert self.job.moves.joints_deg is not None
        skeleton = self.skeleton
        if skeleton is None:
            return [by_joints(self.job.moves.joints_deg[0])]
        first = f"  movel({self.targets[0]}, {self.ends[0]})"
        return [by_joints(skeleton.home_deg[0]), by_joints(skeleton.start_deg[0]), *self._said(skeleton.on), first]

    def _layer(self, i: int) -> list[str]:
        """What stands before move i where a layer begins with it."""
        return self._said(self.skeleton.layer(i)) if self.skeleton else []

    def straight(self, i: int) -> Iterable[str]:
        """Movel."""
        return [*self._layer(i), f"  movel({self.targets[i]}, {self.ends[i]})"]

    def circular(self, i: int) -> Iterable[str]:
        """Movec."""
        return [*self._layer(i), f"  movec({self.vias[i]}, {self.targets[i]}, {self.ends[i]}, mode=0)"]

    def remark(self, text: str) -> str:
        """Up to the end of the line."""
        return f"  # {text}"

    def foot(self) -> Iterable[str]:
        """With a process back, and home; the end of the function, and its call."""
        end, skeleton = ["end", f"{self.job.name}()"], self.skeleton
        if skeleton is None:
            return end
        retract = f"  movel({poses(*self._in_base(*skeleton.retracted))[0]}, {self.ends[-1]})"
        return [retract, *self._said(skeleton.off), by_joints(skeleton.home_deg[0]), *self._said(skeleton.last), *end]

    def read(self, files: Mapping[str, str]) -> ProgramMoves:
        """Turn it back."""
        return read_urscript(files, self.cell.chain.speeds, self.cell.process)

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


def by_joints(joints_deg: Float) -> str:
    """Movej to joint angles (6,)."""
    angles = ", ".join(f"{angle:.9f}" for angle in (np.round(joints_deg * DEG, 9) + 0.0).tolist())
    return f"  movej([{angles}], a={JOINT_ACCELERATION:g}, v={JOINT_SPEED:g})"


def poses(position_mm: Float, rotation: Float) -> list[str]:
    """Poses (k, 3), (k, 3, 3) as p[x, y, z, rx, ry, rz]: m to a hundredth of a micrometre, rotation vector in rad."""
    finite = np.isfinite(position_mm).all(axis=1)
    vectors = np.full_like(position_mm, np.nan)
    vectors[finite] = vector_from_rotation(rotation[finite])
    values = np.concatenate([np.round(position_mm / 1000, 8), np.round(vectors, 9)], axis=1) + 0.0
    return ["p[" + ", ".join(f"{x:.9g}" for x in row) + "]" for row in values.tolist()]
