"""Joint positions of tables, and the flange's poses by URDF and pinocchio: joints in rad and m, poses in mm.

Only the joints between base and flange count: a gripper, a second arm or a turntable in the URDF may stand anywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from workbench.errors import InputError, nearest
from workbench.extras import Extra
from workbench.geometry.poses import pose_from, quaternion_from_rotation
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import LENGTH_MM
from workbench.importing.neutral import Imported, JointStream, PoseStream
from workbench.importing.text import read_table, recognised
from workbench.units import DEG, MM, Float

pin = Extra("pinocchio")

SLACK = 0.02  # rad or m by which a joint may stand beyond its limits


class JointModel(NamedTuple):
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

    def check(self, joints: Float, unit: str, place: Callable[[int], str]) -> None:
        """Refuse joints (K, n), in rad and m, beyond their limits; `place`: what to call a row, from 0."""
        for k, name in enumerate(self.names):
            low, high = self.limits(name)
            wrong = ~((joints[:, k] >= low - SLACK) & (joints[:, k] <= high + SLACK))
            if wrong.any():
                row = int(wrong.argmax())
                other = "rad declared as deg" if unit == "deg" else "deg declared as rad"
                kind, hint = ("m", "another unit?") if self.linear(name) else ("rad", f"{other}? another order?")
                what = f"joint '{name}': expected {low:g} to {high:g} {kind}, found {joints[row, k]:.4g} ({hint})"
                raise InputError(place(row), what)

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
        data, poses = self.model.createData(), np.empty((len(joints), 4, 4))
        at = [self.model.joints[self.model.getJointId(name)].idx_v for name in self.names]
        positions = np.zeros(self.model.nv)  # integrated, as a continuous joint is counted by its cosine and sine
        for k, row in enumerate(joints):
            positions[at] = row
            pin.framesForwardKinematics(self.model, data, pin.integrate(self.model, pin.neutral(self.model), positions))
            moved = data.oMf[self.base].actInv(data.oMf[self.flange])
            poses[k] = pose_from(moved.rotation, moved.translation * MM)
        return poses


NAME = "table of joints (by the mapping)"
MOST = 1e7  # degrees, mm or micrometres: no joint goes so far
NO_ROBOT = (
    "joints become poses by the robot's URDF: expected urdf, base_frame and flange_frame in the mapping's part of them"
)


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the mapping names the file, or all columns of its joints stand in the header."""
    return recognised(mapping.joints, path, head)


def read(path: Path, mapping: Mapping) -> Imported:
    """Postures, one a row, in rad and m; with the robot's URDF also the flange's poses.

    Raises:
        InputError: another number of joints than the URDF has between base and flange, one beyond its limits.
    """
    part = mapping.joints
    assert part is not None
    table = read_table(path, part)
    values = table.all_of("joint", len(part.columns))
    far = np.flatnonzero((np.abs(values) > MOST).any(axis=1))
    if len(far):
        found = np.abs(values[far[0]]).max()
        raise InputError(table.place(int(far[0])), f"expected positions of joints, found {found:.4g}")
    turn = DEG if part.angle_unit == "deg" else 1.0
    names = tuple(name for role, name in table.names.items() if role.startswith("joint"))
    times = table.times(part.time_unit)
    stream = JointStream(table.where, values * turn, names, times, table.whole("number"), part.angle_unit)
    if part.urdf is None or part.base_frame is None or part.flange_frame is None:
        note = f"joints: {', '.join(names)}, in {part.angle_unit}; no robot is named, so no poses follow"
        return Imported(joints=stream, notes=(note,))
    model = JointModel.read(mapping.base_dir / part.urdf, part.base_frame, part.flange_frame)
    if len(names) != len(model.names):
        what = f"expected {len(model.names)} joints ({', '.join(model.names)}), found {len(names)} columns"
        raise InputError(table.where, what)
    linear = LENGTH_MM[part.length_unit] / MM
    joints = values * [linear if model.linear(name) else turn for name in model.names]
    model.check(joints, part.angle_unit, table.place)
    pose = model.base_from_flange(joints)
    poses = PoseStream(table.where, pose[:, :3, 3], quaternion_from_rotation(pose[:, :3, :3]), times)
    way = f"{part.base_frame} to {part.flange_frame}"
    note = f"joints: {', '.join(model.names)} by {part.urdf}, {way}, in {part.angle_unit}"
    return Imported(poses=poses, joints=replace(stream, position=joints), notes=(note,))
