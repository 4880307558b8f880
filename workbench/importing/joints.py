"""Joint positions: in a table of text, and the flange's poses that follow from them by the robot's URDF."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.geometry.poses import quaternion_from_rotation
from workbench.importing.joint_states import MM, SLACK, JointModel
from workbench.importing.mapping import Mapping, claims
from workbench.importing.mapping_parts import LENGTH_MM, TIME_S, Robot
from workbench.importing.neutral import Imported, JointStream, PoseStream
from workbench.importing.table import header_names, read_table
from workbench.units import DEG, Float

NAME = "table of joints (by the mapping)"
MOST = 1e7  # degrees, mm or micrometres: no joint goes so far
NO_ROBOT = (
    "joints become poses by the robot's URDF: expected urdf, base_frame and flange_frame in the mapping's part of them"
)


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the mapping names the file, or all columns of its joints stand in the header."""
    part = mapping.joints
    if part is None:
        return False
    if part.files is not None:
        return claims(part, path)
    return set(part.columns) <= set(header_names(head, part))


def read(path: Path, mapping: Mapping) -> Imported:
    """Postures, one a row; with the robot's URDF also the flange's poses.

    Raises:
        InputError: another number of joints than the URDF has between base and flange, one beyond its limits.
    """
    part = mapping.joints
    assert part is not None
    wanted = {f"joint {k}": column for k, column in enumerate(part.columns)}
    optional = {"time": part.time, "number": part.number}
    table = read_table(path, part, wanted | {role: one for role, one in optional.items() if one is not None})
    values = np.stack([table.present(role) for role in wanted], axis=1)
    time_s = table.present("time") * TIME_S[part.time_unit or "s"] if part.time is not None else None
    numbers = table.whole("number") if part.number is not None else None
    names = tuple(table.names[role] for role in wanted)
    stream = JointStream(table.where, values, names, time_s, numbers, part.angle_unit)

    def line(row: int) -> str:
        return f"{table.where}: line {table.line[row]}"

    return moved(stream, part, mapping.base_dir, LENGTH_MM[part.length_unit], line)


def moved(stream: JointStream, robot: Robot, folder: Path, unit_mm: float, place: Callable[[int], str]) -> Imported:
    """Postures as they stand in a file, in rad and m; with the robot's URDF also the flange's poses.

    Args:
        stream: `position` in the file's units.
        robot: the part of the mapping that names it, or does not.
        folder: where a relative path to the URDF starts.
        unit_mm: of linear joints, mm.
        place: what to call a row, from 0, in messages.

    Raises:
        InputError: as `read`.
    """
    far = np.flatnonzero((np.abs(stream.position) > MOST).any(axis=1))
    if len(far):
        found = np.abs(stream.position[far[0]]).max()
        raise InputError(place(int(far[0])), f"expected positions of joints, found {found:.4g}")
    turn = DEG if stream.angle_unit == "deg" else 1.0
    if robot.urdf is None or robot.base_frame is None or robot.flange_frame is None:
        note = f"joints: {', '.join(stream.names)}, in {stream.angle_unit}; no robot is named, so no poses follow"
        return Imported(joints=replace(stream, position=stream.position * turn), notes=(note,))
    model = JointModel.read(folder / robot.urdf, robot.base_frame, robot.flange_frame)
    if len(stream.names) != len(model.names):
        names = ", ".join(model.names)
        what = f"expected {len(model.names)} joints ({names}), found {len(stream.names)} columns"
        raise InputError(stream.source, what)
    units = [unit_mm / MM if model.linear(name) else turn for name in model.names]
    joints = stream.position * np.array(units)
    _check_limits(joints, model, stream.angle_unit, place)
    pose = model.base_from_flange(joints)
    poses = PoseStream(stream.source, pose[:, :3, 3], quaternion_from_rotation(pose[:, :3, :3]), stream.time_s)
    way = f"{robot.base_frame} to {robot.flange_frame}"
    note = f"joints: {', '.join(model.names)} by {robot.urdf}, {way}, in {stream.angle_unit}"
    return Imported(poses=poses, joints=replace(stream, position=joints), notes=(note,))


def _check_limits(joints: Float, model: JointModel, unit: str, place: Callable[[int], str]) -> None:
    for k, name in enumerate(model.names):
        low, high = model.limits(name)
        wrong = (joints[:, k] < low - SLACK) | (joints[:, k] > high + SLACK)
        if wrong.any():
            row = int(wrong.argmax())
            other = "rad declared as deg" if unit == "deg" else "deg declared as rad"
            kind, hint = ("m", "another unit?") if model.linear(name) else ("rad", f"{other}? another order?")
            what = f"joint '{name}': expected {low:g} to {high:g} {kind}, found {joints[row, k]:.4g} ({hint})"
            raise InputError(place(row), what)
