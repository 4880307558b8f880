"""Flange poses from joint states, by the robot's URDF and pinocchio. Joints in rad and m, poses in mm.

Only the joints between base and flange count: a gripper, a second arm or a turntable in the URDF may stand anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import InputError, nearest
from workbench.geometry.poses import pose_from
from workbench.units import Float

MM = 1e3  # mm per m
SLACK = 0.02  # rad or m by which a joint may stand beyond its limits


@dataclass(frozen=True, slots=True, eq=False)
class JointModel:
    """A robot from its URDF, between two of its frames."""

    path: Path
    model: Any  # pin.Model
    base: int  # pin's indices of the frames
    flange: int
    names: tuple[str, ...]  # of the joints between them

    @classmethod
    def read(cls, path: Path, base_frame: str, flange_frame: str) -> JointModel:
        """Build the robot. Its meshes are not looked at.

        Raises:
            InputError: no such file, not a URDF, an unknown frame, no joint between the frames.
        """
        import pinocchio as pin

        from workbench.robot.urdf import kinematic_model

        model = kinematic_model(path)
        known = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
        for name in (base_frame, flange_frame):
            if name not in known:
                raise InputError(f"{path}: '{name}'", f"unknown link{nearest(name, known)}")
        base, flange = (model.getFrameId(name, pin.FrameType.BODY) for name in (base_frame, flange_frame))
        ways = [set(model.supports[model.frames[frame].parentJoint]) for frame in (base, flange)]
        joints = sorted(ways[0] ^ ways[1])
        if not joints:
            raise InputError(str(path), f"expected joints between '{base_frame}' and '{flange_frame}', found none")
        for joint in joints:
            if model.nvs[joint] != 1:
                raise InputError(f"{path}: {model.names[joint]}", "expected a revolute, continuous or prismatic joint")
        return cls(path, model, base, flange, tuple(model.names[joint] for joint in joints))

    def joints(self, state: Any, where: str) -> Float | None:
        """Positions (n,) of this robot's joints in a sensor_msgs/JointState; None where it tells of others only.

        Raises:
            InputError: some joints are missing, a name stands twice, a position is no number or beyond its limits.
        """
        given = dict(zip(state.name, state.position, strict=False))
        if len(given) < len(state.name) or len(state.position) != len(state.name):
            found = f"{len(state.name)} names, {len(state.position)} positions"
            raise InputError(where, f"expected one position for each of different names, found {found}")
        missing = [name for name in self.names if name not in given]
        if len(missing) == len(self.names):
            return None
        if missing:
            raise InputError(where, f"joint '{missing[0]}' is missing{nearest(missing[0], given)}")
        values = np.array([given[name] for name in self.names], float)
        for name, value in zip(self.names, values, strict=True):
            self._check(name, value, where)
        return values

    def _check(self, name: str, value: float, where: str) -> None:
        low, high = self.limits(name)
        if not low - SLACK <= value <= high + SLACK:
            raise InputError(
                where, f"expected joint '{name}' from {low:g} to {high:g} (rad, m), found {value:g}; are these degrees?"
            )

    def limits(self, name: str) -> tuple[float, float]:
        """Least and greatest position of a joint, rad or m; of a continuous one some turns."""
        joint = self.model.joints[self.model.getJointId(name)]
        if joint.nq != 1:
            return -1e3, 1e3
        return float(self.model.lowerPositionLimit[joint.idx_q]), float(self.model.upperPositionLimit[joint.idx_q])

    def linear(self, name: str) -> bool:
        """Whether a joint goes along its axis, and does not turn."""
        return "JointModelP" in str(self.model.joints[self.model.getJointId(name)].shortname())

    def base_from_flange(self, joints: Float) -> Float:
        """Poses (K, 4, 4), mm, at joint positions (K, n)."""
        import pinocchio as pin

        data, q = self.model.createData(), pin.neutral(self.model)
        poses = np.empty((len(joints), 4, 4))
        places = [self.model.joints[self.model.getJointId(name)] for name in self.names]
        for k, row in enumerate(joints):
            for joint, value in zip(places, row, strict=True):
                q[joint.idx_q : joint.idx_q + joint.nq] = (value,) if joint.nq == 1 else (np.cos(value), np.sin(value))
            pin.forwardKinematics(self.model, data, q)
            base, flange = (pin.updateFramePlacement(self.model, data, f) for f in (self.base, self.flange))
            moved = base.actInv(flange)
            poses[k] = pose_from(moved.rotation, moved.translation * MM)
        return poses
