"""One message of a bag as points: PointCloud2 by its fields, LaserScan by its angles and ranges.

Coordinates here are the message's own, in its own frame and unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.errors import InputError
from workbench.units import AnyArray, Float

# sensor_msgs/PointField: INT8 = 1 ... FLOAT64 = 8
FIELD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
INTENSITY = ("intensity", "intensities")


@dataclass(frozen=True, slots=True)
class Points:
    """What one message holds: H rows (profiles) of W points."""

    xyz: Float  # (3, H, W) in the message's frame and unit; NaN = no return; an axis that is not there is 0
    intensity: AnyArray | None  # (H, W)


def cloud_points(message: Any, where: str) -> Points:
    """Points of a sensor_msgs/PointCloud2: fields of any type and offset, either byte order, rows with padding.

    Raises:
        InputError: sizes that contradict each other, fields that do not fit, none of x, y, z.
    """
    height, width, step, row = message.height, message.width, message.point_step, message.row_step
    if len(message.data) != height * row or row < width * step:
        found = f"{len(message.data)} bytes, row_step {row}, point_step {step}"
        raise InputError(where, f"expected height {height} x row_step bytes of width {width} points, found {found}")
    fields = {field.name: field for field in message.fields if field.name in ("x", "y", "z", *INTENSITY)}
    if height * width == 0:
        return Points(np.empty((3, max(height, 1), 0)), None)
    layout = {name: _field_type(field, message.is_bigendian, step, where) for name, field in fields.items()}
    if not {"x", "y", "z"} & set(layout):
        named = ", ".join(str(field.name) for field in message.fields[:12]) or "none"
        raise InputError(where, f"expected fields x, y, z, found {named}")
    dtype = np.dtype(
        {
            "names": list(layout),
            "formats": list(layout.values()),
            "offsets": [fields[name].offset for name in layout],
            "itemsize": step,
        }
    )
    rows = np.ascontiguousarray(message.data.reshape(height, row)[:, : width * step])
    points = rows.view(dtype)
    xyz = np.zeros((3, height, width))
    for axis, name in enumerate("xyz"):
        if name in layout:
            xyz[axis] = points[name]
    return Points(xyz, next((points[name] for name in INTENSITY if name in layout), None))


def _field_type(field: Any, is_bigendian: bool, point_step: int, where: str) -> str:
    """numpy's name of a field's type."""
    known = FIELD_TYPES.get(field.datatype)
    if known is None or field.count not in (0, 1):
        found = f"type {field.datatype}, count {field.count}"
        raise InputError(f"{where}.{field.name}", f"expected one number of a type 1 to 8 a point, found {found}")
    if field.offset + int(known[1:]) > point_step:
        raise InputError(f"{where}.{field.name}", f"expected a field within point_step {point_step}")
    return (">" if is_bigendian else "<") + known


def scan_points(message: Any, where: str) -> Points:
    """Points of a sensor_msgs/LaserScan in its own x-y plane: x = r cos a, y = r sin a, angles from x towards y.

    No return: NaN, an infinity (REP 117), or a range outside range_min to range_max.

    Raises:
        InputError: angles or limits that are no numbers, no ranges.
    """
    ranges = np.asarray(message.ranges, float)
    limits = (message.angle_min, message.angle_increment, message.range_min, message.range_max)
    if not all(map(math.isfinite, limits[:3])) or math.isnan(limits[3]) or message.angle_increment == 0:
        raise InputError(where, f"expected angle_min, angle_increment, range_min and range_max, found {limits}")
    if abs(message.angle_increment) * len(ranges) > 2.1 * math.pi:
        raise InputError(where, f"expected angles within one turn, in rad, found steps of {message.angle_increment:g}")
    angle = message.angle_min + np.arange(len(ranges)) * message.angle_increment
    seen = np.isfinite(ranges) & (ranges >= message.range_min) & (ranges <= message.range_max)
    r = np.where(seen, ranges, np.nan)
    xyz = np.stack([r * np.cos(angle), r * np.sin(angle), np.zeros(len(r))])[:, None, :]
    intensity = np.asarray(message.intensities)
    return Points(xyz, intensity[None, :] if len(intensity) == len(ranges) else None)
