"""Robot poses in a table of text: by the mapping, or under one of three headers that leave no doubt."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.geometry.poses import (
    USUAL_ANGLE_UNIT,
    components,
    inverse,
    pose_from,
    quaternion_from_rotation,
    quaternions,
    rotation_from_quaternion,
)
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import LENGTH_MM, FramesPart, PosesPart
from workbench.importing.neutral import Imported, PoseStream
from workbench.importing.suspicions import check_angles
from workbench.importing.text import Table, first_bytes, part_of, read_table
from workbench.scan.checks import UNIT_TOLERANCE
from workbench.units import DEG, Float

NAME = "table of poses (by the mapping)"
POSITION = ("x_mm", "y_mm", "z_mm")
ORIENTATIONS = {  # by their own names; A B C and rx ry rz mean several things and need a mapping
    "quaternion_wxyz": ("qw", "qx", "qy", "qz"),
    "abb": ("q1", "q2", "q3", "q4"),
    "fanuc_wpr": ("w_deg", "p_deg", "r_deg"),
}


KNOWN = {
    ("time_s", *POSITION, *names): PosesPart(
        length_unit="mm",
        time_unit="s",
        position=POSITION,
        orientation=list(names),
        convention=convention,
        time="time_s",
    )
    for convention, names in ORIENTATIONS.items()
}


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the mapping names the file, all its columns stand in the header, or the header is a known one."""
    return part_of(mapping.poses, KNOWN, path, head) is not None


def read(path: Path, mapping: Mapping) -> Imported:
    """The flange's poses.

    Raises:
        InputError: a column is missing, a cell is no number or empty, a quaternion not of unit length, angles that
            look like the other unit.
    """
    part = part_of(mapping.poses, KNOWN, path, first_bytes(path))
    assert part is not None
    table = read_table(path, part)
    position_mm = table.all_of("position", 3) * LENGTH_MM[part.length_unit]
    position_mm, quaternion_wxyz = of_flange_in_base(position_mm, _orientations(table, part, mapping), part)
    stream = PoseStream(
        table.where,
        position_mm,
        quaternion_wxyz,
        table.times(part.time_unit),
        table.whole("scan_pass"),
        length_unit=part.length_unit,
        time_unit=part.time_unit or "s",
    )
    return Imported(poses=stream, notes=(_note(part, table),))


def of_flange_in_base(position_mm: Float, quaternion_wxyz: Float, part: FramesPart) -> tuple[Float, Float]:
    """Flange poses in the base, where the mapping tells of a tool or of another frame."""
    if part.flange_from_tool is None and part.base_from_frame is None:
        return position_mm, quaternion_wxyz
    frame_from_tool = pose_from(rotation_from_quaternion(quaternion_wxyz), position_mm)
    base_from_frame = np.eye(4) if part.base_from_frame is None else np.array(part.base_from_frame)
    flange_from_tool = np.eye(4) if part.flange_from_tool is None else np.array(part.flange_from_tool)
    base_from_flange = base_from_frame @ frame_from_tool @ inverse(flange_from_tool)
    return base_from_flange[:, :3, 3], quaternion_from_rotation(base_from_flange[:, :3, :3])


def _orientations(table: Table, part: PosesPart, mapping: Mapping) -> Float:
    """Unit quaternions out of the table's convention."""
    values = table.all_of("orientation", len(part.orientation))
    unit = part.angle_unit or USUAL_ANGLE_UNIT.get(part.convention, "rad")
    if components(part.convention) == 3:
        check_angles(values, unit, mapping, table.where)
        return quaternions(values * (DEG if unit == "deg" else 1.0), part.convention)
    quaternion = quaternions(values, part.convention)
    norm = np.linalg.norm(np.clip(quaternion, -1e3, 1e3), axis=1)
    wrong = np.flatnonzero(np.abs(norm - 1) > UNIT_TOLERANCE)
    if len(wrong):
        raise InputError(table.place(int(wrong[0])), f"expected a quaternion of norm 1, found {norm[wrong[0]]:.4g}")
    return np.asarray(quaternion / norm[:, None])


def _note(part: PosesPart, table: Table) -> str:
    angles = part.angle_unit or USUAL_ANGLE_UNIT.get(part.convention)
    names = ", ".join(table.names.values())
    units = f"lengths in {part.length_unit}" + (f", angles in {angles}" if angles else "")
    times = f"times in {part.time_unit or 's'}" if part.time is not None else "no times"
    frames = [f"{name} applied" for name in ("base_from_frame", "flange_from_tool") if getattr(part, name) is not None]
    return "; ".join([f"poses: {names}; orientation {part.convention}; {units}, {times}", *frames])
