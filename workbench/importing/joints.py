"""Joint positions in a table of text: the flange's poses by the robot's URDF."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.geometry.poses import quaternion_from_rotation
from workbench.importing.files import claims
from workbench.importing.joint_states import SLACK, JointModel
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_tables import TIME_S
from workbench.importing.neutral import Imported, PoseStream
from workbench.importing.table import header_names, read_table
from workbench.units import DEG

NAME = "table of joints (by the mapping)"


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the mapping names the file, or all columns of its joints stand in the header."""
    part = mapping.joints
    if part is None:
        return False
    if part.files is not None:
        return claims(part, path)
    return set(part.columns) <= set(header_names(head, part))


def read(path: Path, mapping: Mapping) -> Imported:
    """Poses of the flange, one a row.

    Raises:
        InputError: another number of joints than the URDF has between base and flange, one beyond its limits.
    """
    part = mapping.joints
    assert part is not None
    model = JointModel.read(mapping.base_dir / part.urdf, part.base_frame, part.flange_frame)
    if len(part.columns) != len(model.names):
        names = ", ".join(model.names)
        raise InputError(str(path), f"expected {len(model.names)} joints ({names}), found {len(part.columns)} columns")
    wanted = {f"joint {k}": column for k, column in enumerate(part.columns)}
    table = read_table(path, part, wanted | ({"time": part.time} if part.time is not None else {}))
    joints = np.stack([table.present(role) for role in wanted], axis=1) * (DEG if part.angle_unit == "deg" else 1.0)
    for k, name in enumerate(model.names):
        low, high = model.limits(name)
        wrong = (joints[:, k] < low - SLACK) | (joints[:, k] > high + SLACK)
        if wrong.any():
            row = int(wrong.argmax())
            other = "rad declared as deg" if part.angle_unit == "deg" else "deg declared as rad"
            found = f"{joints[row, k]:.4g} ({other}? another order?)"
            what = f"joint '{name}': expected {low:g} to {high:g} rad, found {found}"
            raise InputError(f"{table.where}: line {table.line[row]}", what)
    pose = model.base_from_flange(joints)
    time_s = table.present("time") * TIME_S[part.time_unit or "s"] if part.time is not None else None
    stream = PoseStream(table.where, pose[:, :3, 3], quaternion_from_rotation(pose[:, :3, :3]), time_s)
    way = f"{part.base_frame} to {part.flange_frame}"
    note = f"joints: {', '.join(model.names)} by {part.urdf}, {way}, in {part.angle_unit}"
    return Imported(poses=stream, notes=(note,))
