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

from workbench.artefacts import ProgramMoves
from workbench.dialect import ProgramJob, rounded_feeds
from workbench.errors import InputError
from workbench.geometry.poses import pose_from, rotation_from_quaternion, vector_from_rotation
from workbench.program.urscript_reader import read_urscript
from workbench.robot.cell import Cell
from workbench.units import DEG, Float

ACCELERATION_M_S2 = 0.5  # of the tool
JOINT_SPEED, JOINT_ACCELERATION = 0.35, 0.5  # rad/s, rad/s^2: on the way to the first posture
SHARE = 0.45  # of a move's length that a blend may take at either end
STANDS_DEG = 1e-4  # a turntable that moves by less stands


@dataclass
class UrScript:
    """The dialect of Universal Robots' controllers."""

    job: ProgramJob
    cell: Cell

    def __post_init__(self) -> None:
        """Refuse what the controller cannot do."""
        turned = self.job.turntable_deg
        span = 0.0 if turned is None else float(np.ptp(turned))
        if span > STANDS_DEG:
            raise InputError(
                "program.write",
                f"expected a turntable that stands: along this path it turns by {span:.3g} deg, and controllers of "
                "Universal Robots drive no external axis (stiffness.posture: turntable_moves false)",
            )

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
        blend = np.where(self.job.blends, np.minimum(self.job.zone_mm, room), 0.0)
        rows = zip(
            (rounded_feeds(moves.feed_mm_s) / 1000).tolist(), (np.floor(blend * 1000) / 1e6).tolist(), strict=True
        )
        return [f"a={ACCELERATION_M_S2:g}, v={feed:.9g}, r={r:.6f}" for feed, r in rows]

    def head(self) -> Iterator[str]:
        """Function, tool, load; where the turntable must stand."""
        job, tool = self.job, self.job.tool
        yield f"def {job.name}():"
        yield from (self.remark(one) for one in job.remarks)
        turn = rotation_from_quaternion(tool.quaternion_wxyz)
        yield f"  set_tcp({poses(job.tool_centre_point_mm[None], turn[None])[0]})"
        x, y, z = tool.centre_of_gravity_mm / 1000
        yield f"  set_payload({tool.mass_kg:g}, [{x:.6f}, {y:.6f}, {z:.6f}])"
        if job.turntable_deg is not None:
            yield f'  popup("Turntable at {job.turntable_deg[0] + 0.0:.4f} deg?", title="Turntable", blocking=True)'

    def start(self) -> Iterable[str]:
        """By the joints to the first posture."""
        assert self.job.moves.joints_deg is not None
        angles = ", ".join(f"{angle:.9f}" for angle in (np.round(self.job.moves.joints_deg[0] * DEG, 9) + 0.0).tolist())
        return [f"  movej([{angles}], a={JOINT_ACCELERATION:g}, v={JOINT_SPEED:g})"]

    def straight(self, i: int) -> Iterable[str]:
        """Movel."""
        return [f"  movel({self.targets[i]}, {self.ends[i]})"]

    def circular(self, i: int) -> Iterable[str]:
        """Movec."""
        return [f"  movec({self.vias[i]}, {self.targets[i]}, {self.ends[i]}, mode=0)"]

    def remark(self, text: str) -> str:
        """Up to the end of the line."""
        return f"  # {text}"

    def foot(self) -> Iterable[str]:
        """The end of the function, and its call."""
        return ["end", f"{self.job.name}()"]

    def read(self, files: Mapping[str, str]) -> ProgramMoves:
        """Turn it back."""
        return read_urscript(files, self.cell.chain.speeds)

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


def poses(position_mm: Float, rotation: Float) -> list[str]:
    """Poses (k, 3), (k, 3, 3) as p[x, y, z, rx, ry, rz]: m to a hundredth of a micrometre, rotation vector in rad."""
    finite = np.isfinite(position_mm).all(axis=1)
    vectors = np.full_like(position_mm, np.nan)
    vectors[finite] = vector_from_rotation(rotation[finite])
    values = np.concatenate([np.round(position_mm / 1000, 8), np.round(vectors, 9)], axis=1) + 0.0
    return ["p[" + ", ".join(f"{x:.9g}" for x in row) + "]" for row in values.tolist()]
