"""Makers of controllers: by what name a cell's file knows them, where base and flange are, how poses are logged.

A further one has its language in `workbench/program/`, which `workbench/program/write_stage.py` names.

Sources: FANUC and Yaskawa: the world's (robot's) origin lies where axis 1 meets the height of axis 2
(ros-industrial/fanuc#101, ros-industrial/motoman#234). ABB: at the foot, on axis 1, x forward, z up
(ros-industrial/abb#63); KUKA likewise ($ROBROOT). UR: `base` of ur_description, turned by 180 deg about z against
`base_link` (its page "Robot Frames"). Flanges: `tool0`, the tool with all zeros on the pendant (draft REP-199;
ros-industrial/fanuc_experimental#57). Axes' senses: the makers' data sheets and those packages.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from workbench.units import Float

Make = Literal["abb", "kuka", "fanuc", "ur", "yaskawa", "trajectory"]  # whose language; joint angles over time
AXES = {"+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0), "+z": (0, 0, 1), "-z": (0, 0, -1)}
SERIAL, LEVEL = "+z +y +y +x +y +x", "+z +y -y -x -y -x"


@dataclass(frozen=True, slots=True)
class Maker:
    """The rule of one maker's controllers: directions are in its base, all joints at zero."""

    name: str
    joints: str  # axis of each joint, by its sense
    flange: str  # x and z of the flange
    at_axis_2: bool  # the base's origin is at the height of axis 2, else at the foot
    world: bool  # the controller may know a world in which its base stands elsewhere
    logged: str  # where a recording's poses come from, each with its time

    @property
    def axes(self) -> Float:
        """(6, 3)."""
        return np.array([AXES[axis] for axis in self.joints.split()], float)

    @property
    def base_from_flange(self) -> Float:
        """Rotation (3, 3) of the flange."""
        x, z = (np.array(AXES[axis], float) for axis in self.flange.split())
        return np.column_stack([x, np.cross(z, x), z])

    @property
    def origin(self) -> str:
        """Of the base, in words."""
        return "on axis 1 at axis 2's height" if self.at_axis_2 else "on axis 1 at the robot's foot"


MAKERS = {
    "abb": Maker(
        "ABB",
        SERIAL,
        "-z +x",
        at_axis_2=False,
        world=True,
        logged="EGM or a socket task, flange (tool0) in the base",
    ),
    "kuka": Maker(
        "KUKA",
        "-z +y +y -x +y -x",
        "-z +x",
        at_axis_2=False,
        world=True,
        logged="RSI, $POS_ACT with $NULLFRAME as tool and base",
    ),
    "fanuc": Maker(
        "FANUC",
        LEVEL,
        "+z +x",
        at_axis_2=True,
        world=False,
        logged="KAREL CURPOS or Stream Motion, tool frame 0 in the world",
    ),
    "ur": Maker(
        "UR",
        "+z -y -y -y -z -y",
        "+x -y",
        at_axis_2=False,
        world=False,
        logged="RTDE, actual_q or actual_TCP_pose with the flange as TCP",
    ),
    "yaskawa": Maker(
        "Yaskawa",
        LEVEL,
        "+z +x",
        at_axis_2=True,
        world=False,
        logged="the high-speed Ethernet server, flange in the base",
    ),
}
