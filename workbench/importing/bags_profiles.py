"""Profiles out of a bag's PointCloud2 messages, gathered one by one into a grid of frames x columns."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.importing.bags_reader import CLOUD, Bag, chosen_topic, listed, stamp_s
from workbench.importing.mapping_parts import LENGTH_MM, BagPart
from workbench.importing.neutral import Points, ProfileFrames
from workbench.units import AnyArray, Float, Int, Shaped

# One message of a bag as points, by its fields.
#
# Coordinates here are the message's own, in its own frame and unit.

# sensor_msgs/PointField: INT8 = 1 ... FLOAT64 = 8
FIELD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
INTENSITY = ("intensity", "intensities")


class Returns(NamedTuple):
    """What one message holds: H rows (profiles) of W points."""

    xyz: Shaped[Float, "3 H W"]  # in the message's frame and unit; NaN = no return; an axis that is not there is 0
    intensity: Shaped[AnyArray, "H W"] | None


def cloud_points(message: Any, where: str) -> Returns:
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
        return Returns(np.empty((3, max(height, 1), 0)), None)
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
    return Returns(xyz, next((points[name] for name in INTENSITY if name in layout), None))


def _field_type(field: Any, is_bigendian: bool, point_step: int, where: str) -> str:
    """numpy's name of a field's type."""
    known = FIELD_TYPES.get(field.datatype)
    if known is None or field.count not in (0, 1):
        found = f"type {field.datatype}, count {field.count}"
        raise InputError(f"{where}.{field.name}", f"expected one number of a type 1 to 8 a point, found {found}")
    if field.offset + int(known[1:]) > point_step:
        raise InputError(f"{where}.{field.name}", f"expected a field within point_step {point_step}")
    return (">" if is_bigendian else "<") + known


MAX_COLUMNS = 10_000
MAX_MM = 1e6  # of a coordinate: what is beyond was not measured
FLAT_MM = 0.01  # how far a profile's points may lie off the laser plane


class Found(NamedTuple):
    """What the messages turned out to be."""

    profiles: ProfileFrames
    ros_from_profiler: Shaped[Float, "3 3"]  # axes of the profiler in the frame of the messages
    frame_id: str
    notes: list[str]


def profile_topics(bag: Bag, part: BagPart) -> list[str]:
    """The topics of the profiles: the mapping's, or the only one that there is; none where the bag has none.

    Raises:
        InputError: an unknown topic, several candidates, one twice.
    """
    if part.profiles is None:
        found = bag.topics(CLOUD)
        if len(found) > 1:
            raise InputError(
                str(bag.path), f"expected $.bag.profiles in the mapping to choose from {listed(bag, found)}"
            )
        return found
    topics = [chosen_topic(bag, topic, (CLOUD,), "profiles") for topic in part.profiles]
    if len(set(topics)) < len(topics):
        raise InputError(str(bag.path), f"expected different topics in $.bag.profiles, found {topics}")
    return topics


def read_profiles(bag: Bag, topics: list[str], part: BagPart) -> Found:
    """All profiles of these topics, topic by topic: the first topic is pass 0, and so on.

    Raises:
        InputError: a message that is no profile, or leaves doubt about what it means.
    """
    ros_from_profiler = _axes(part.lateral, part.range, str(bag.path))
    points, frame_id, times, of_topic = Points(), "", list[float](), list[int]()
    left_out, empty = "", 0  # why there is no intensity; messages without points
    for number, topic in enumerate(topics):
        for message in bag.messages([topic]):
            frame_id = frame_id or message.value.header.frame_id
            if message.value.header.frame_id != frame_id:
                what = f"expected frame_id '{frame_id}', found '{message.value.header.frame_id}'"
                raise InputError(message.where, what)
            found = cloud_points(message.value, message.where)
            xyz_mm = _checked_mm(found.xyz, part, message.where)
            local = np.einsum("rp,rhw->phw", ros_from_profiler, xyz_mm).astype(np.float32)  # R^T: into the profiler
            _check_flat(local[1], message.where)
            rows, columns = local.shape[1:]
            if columns > MAX_COLUMNS:
                what = f"expected a profile of at most {MAX_COLUMNS} points, found {columns}"
                raise InputError(message.where, what)
            if rows > 1 and part.row_period_s is None:
                what = f"{rows} profiles with one time: expected $.bag.row_period_s in the mapping"
                raise InputError(message.where, what)
            light, why = _counts(found.intensity, (rows, columns))
            left_out, empty = left_out or why, empty + (rows if not columns else 0)
            points.add(local[0].ravel(), local[2].ravel(), np.arange(rows) * columns, light.ravel())
            times += (stamp_s(message, part.time) + np.arange(rows) * (part.row_period_s or 0.0)).tolist()
            of_topic += [number] * rows
    if not points.rows:
        raise InputError(str(bag.path), "expected profiles with points, found none")
    grid = points.gridded(str(bag.path), by_spacing=part.ragged == "spacing")
    if not np.isfinite(grid.z_mm).any():
        raise InputError(str(bag.path), "expected returns in the profiles, found none")
    profiles = ProfileFrames(
        source=str(bag.path),
        x_mm=grid.x_mm,
        z_mm=grid.z_mm,
        time_s=np.array(times),
        intensity=None if left_out else grid.intensity,
        pass_index=_passes(of_topic, times, part.pass_gap_s),
        length_unit=part.length_unit,
    )
    notes = [
        f"profiles: {listed(bag, topics)}, frame '{frame_id}', in {part.length_unit}; "
        f"x of the profiler is {part.lateral}, its z is {part.range}",
        f"intensity: {left_out or 'taken'}",
        *([f"{empty} messages without points: frames without returns"] if empty else []),
        *filter(None, [grid.note]),
    ]
    return Found(profiles, ros_from_profiler, frame_id, notes)


def _counts(intensity: AnyArray | None, shape: tuple[int, int]) -> tuple[AnyArray, str]:
    """Intensity as uint16; zeros, and why, where there is none, or not such."""
    zeros = np.zeros(shape, np.uint16)
    if intensity is None:
        return zeros, "none in the bag" if zeros.size else ""
    if np.array_equal(intensity, np.clip(np.rint(intensity), 0, 65535)):
        return intensity.astype(np.uint16), ""
    return zeros, "left out: not whole numbers from 0 to 65535"


def _passes(of_topic: list[int], times: list[float], gap_s: float | None) -> Int | None:
    """Passes (N,) from 0: a new one with each topic and after each gap longer than `gap_s`; None: there is one."""
    begins = np.diff(of_topic) != 0
    if gap_s is not None:
        begins |= np.diff(times) > gap_s
    return np.append(0, np.cumsum(begins)) if begins.any() else None


def _axes(lateral: str, upward: str, where: str) -> Float:
    """Columns: x, y, z of the profiler as the messages count them; y = z x x completes a right-handed frame."""
    x, z = (_unit(name) for name in (lateral, upward))
    if abs(x @ z) > 0:
        raise InputError(
            where, f"expected $.bag.lateral and $.bag.range to be different axes, found {lateral}, {upward}"
        )
    return np.column_stack([x, np.cross(z, x), z])


def _unit(axis: str) -> Float:
    return np.asarray(np.eye(3)["xyz".index(axis[-1])] * (-1.0 if axis[0] == "-" else 1.0))


def _checked_mm(xyz: Float, part: BagPart, where: str) -> Float:
    """Points in mm with all that means no return as NaN; raises InputError where the mapping must say what is meant."""
    said = part.no_return
    missing = np.isnan(xyz).any(axis=0)
    for name, here in (("zero", (xyz == 0).all(axis=0)), ("inf", np.isinf(xyz).any(axis=0))):
        if said is not None and name in said:
            missing |= here
        elif here.any() and (said is None or name == "inf"):
            meant = 'or leave it out if they are real (["nan"])' if name == "zero" else "if they mean no return"
            what = "at 0, 0, 0" if name == "zero" else "at an infinite place"
            raise InputError(where, f'{here.sum()} points {what}: expected "{name}" in $.bag.no_return {meant}')
    xyz = np.where(missing, np.nan, xyz)
    limit = MAX_MM / LENGTH_MM[part.length_unit]
    if (np.abs(xyz) > limit).any():
        largest = float(np.nanmax(np.abs(xyz)))
        raise InputError(where, f"expected coordinates of at most {limit:g} {part.length_unit}, found {largest:g}")
    return np.asarray(xyz * LENGTH_MM[part.length_unit])


def _check_flat(off_plane_mm: Float, where: str) -> None:
    far = float(np.nanmax(np.abs(off_plane_mm), initial=0.0)) if np.isfinite(off_plane_mm).any() else 0.0
    if far > FLAT_MM:
        raise InputError(
            where, f"expected points in the plane of $.bag.lateral and $.bag.range, found one {far:g} mm off"
        )
