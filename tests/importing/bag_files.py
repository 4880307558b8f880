"""Bags for the tests, written by rosbags: profiles, poses, frames and joint states out of a recording."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from workbench.artefacts import Recording
from workbench.units import AnyArray, Float

Kind = Literal["mcap", "sqlite3", "rosbag1"]
KINDS: tuple[Kind, ...] = ("mcap", "sqlite3", "rosbag1")
CLOUD = "sensor_msgs/msg/PointCloud2"
POSE, TRANSFORM = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped"
ODOMETRY, JOINTS, TF = "nav_msgs/msg/Odometry", "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"
ZSTD = (rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
LZ4 = (rosbag1.Writer.CompressionFormat.LZ4,)
Entry = tuple[str, str, int, Any]  # topic, type, time of recording in ns, message


class Ros:
    """Messages of one ROS."""

    def __init__(self, kind: Kind) -> None:
        self.kind = kind
        self.store = get_typestore(Stores.ROS1_NOETIC if kind == "rosbag1" else Stores.ROS2_HUMBLE)
        if TF not in self.store.fielddefs:
            self.store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))

    def make(self, name: str, /, **fields: Any) -> Any:
        """A message of the type `name` (package/type)."""
        return self.store.types[name.replace("/", "/msg/", 1)](**fields)

    def header(self, time_s: float, frame: str) -> Any:
        ns = round(time_s * 1e9)
        stamp = self.make("builtin_interfaces/Time", sec=ns // 10**9, nanosec=ns % 10**9)
        count = {"seq": 0} if self.kind == "rosbag1" else {}
        return self.make("std_msgs/Header", stamp=stamp, frame_id=frame, **count)

    def cloud(
        self, time_s: float, fields: dict[str, AnyArray], frame: str = "laser", big: bool = False, padding: int = 0
    ) -> Any:
        """A PointCloud2 of the fields by name, each (W,) or (H, W); `padding` bytes before fields, after rows."""
        shape = np.atleast_2d(next(iter(fields.values()))).shape
        codes = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
        made, offset = [], 0
        for name, values in fields.items():
            offset += padding
            code = codes[values.dtype.str[1:]]
            made.append(self.make("sensor_msgs/PointField", name=name, offset=offset, datatype=code, count=1))
            offset += values.itemsize
        data = np.zeros((shape[0], shape[1] * offset + padding), np.uint8)
        for field, values in zip(made, fields.values(), strict=True):
            raw = np.atleast_2d(values).astype(values.dtype.newbyteorder(">" if big else "<"))
            raw = raw[..., None].view(np.uint8)
            for byte in range(values.itemsize):
                data[:, field.offset + byte : shape[1] * offset : offset] = raw[..., byte]
        return self.make(
            "sensor_msgs/PointCloud2",
            header=self.header(time_s, frame),
            height=shape[0],
            width=shape[1],
            fields=made,
            is_bigendian=big,
            point_step=offset,
            row_step=data.shape[1],
            data=data.ravel(),
            is_dense=False,
        )

    def pose(
        self,
        name: str,
        time_s: float,
        position_m: Float,
        q_wxyz: Float,
        parent: str = "base_link",
        child: str = "tool0",
    ) -> Any:
        """A PoseStamped, TransformStamped or Odometry."""
        w, x, y, z = map(float, q_wxyz)
        px, py, pz = map(float, position_m)
        turn, header = self.make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w), self.header(time_s, parent)
        at = {"x": px, "y": py, "z": pz}
        if name == TRANSFORM:
            moved = self.make(
                "geometry_msgs/Transform", translation=self.make("geometry_msgs/Vector3", **at), rotation=turn
            )
            return self.make("geometry_msgs/TransformStamped", header=header, child_frame_id=child, transform=moved)
        pose = self.make("geometry_msgs/Pose", position=self.make("geometry_msgs/Point", **at), orientation=turn)
        if name == POSE:
            return self.make("geometry_msgs/PoseStamped", header=header, pose=pose)
        none = self.make("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0)
        still = self.make("geometry_msgs/Twist", linear=none, angular=none)
        return self.make(
            "nav_msgs/Odometry",
            header=header,
            child_frame_id=child,
            pose=self.make("geometry_msgs/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=self.make("geometry_msgs/TwistWithCovariance", twist=still, covariance=np.zeros(36)),
        )

    def tf(self, *transforms: Any) -> Any:
        return self.make("tf2_msgs/TFMessage", transforms=list(transforms))

    def joints(self, time_s: float, named: dict[str, float]) -> Any:
        none = np.zeros(0)
        return self.make(
            "sensor_msgs/JointState",
            header=self.header(time_s, ""),
            name=list(named),
            position=np.array(list(named.values()), float),
            velocity=none,
            effort=none,
        )

    def write(self, path: Path, entries: Iterable[Entry], compression: tuple[Any, ...] = ()) -> Path:
        """Write a bag in the order of recording; returns what to import (a directory for rosbag2).

        `compression` is what the writer of this kind takes for it.
        """
        connections: dict[str, Any] = {}
        bag = self._writer(path)
        if compression:
            bag.set_compression(*compression)
        with bag as writer:
            for topic, name, time_ns, message in sorted(entries, key=lambda entry: entry[2]):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, name, typestore=self.store)
                raw = (self.store.serialize_ros1 if self.kind == "rosbag1" else self.store.serialize_cdr)(message, name)
                writer.write(connections[topic], time_ns, raw)
        return path

    def _writer(self, path: Path) -> Any:
        if self.kind == "rosbag1":
            return rosbag1.Writer(path)
        plugin = rosbag2.StoragePlugin.MCAP if self.kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        return rosbag2.Writer(path, version=9, storage_plugin=plugin)


def profile_entries(ros: Ros, recording: Recording, topic: str = "/profiles") -> Iterator[Entry]:
    """One PointCloud2 a frame: x, z and intensity in m, recorded a millisecond after its stamp."""
    for i, time_s in enumerate(recording.time_s):
        x, z = (grid[i] / np.float32(1000) for grid in (recording.x_mm, recording.z_mm))
        fields: dict[str, AnyArray] = {"x": x, "z": z}
        if recording.intensity is not None:
            fields["intensity"] = recording.intensity[i].astype(np.uint16)
        yield topic, CLOUD, round(time_s * 1e9) + 10**6, ros.cloud(time_s, fields)


def pose_entries(ros: Ros, recording: Recording, name: str = POSE, topic: str = "/flange") -> Iterator[Entry]:
    """One message a pose."""
    for time_s, position, q in zip(
        recording.robot_time_s, recording.robot_position_mm, recording.robot_quaternion_wxyz, strict=True
    ):
        yield topic, name, round(time_s * 1e9) + 10**6, ros.pose(name, time_s, position / 1000, q)
