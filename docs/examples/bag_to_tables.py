"""Profiles and poses of a bag of ROS as tables: `python bag_to_tables.py BAG PROFILE_TOPIC POSE_TOPIC`."""

import sys
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

MM = 1000.0  # per unit of length in the bag: REP 103 says m
FLANGE = "tool0"  # the child frame, where poses stand in /tf
KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # of sensor_msgs/PointField


def profile(cloud):
    """x and z of a PointCloud2, in mm; NaN, and 0, 0, are no return."""
    assert cloud.height == 1, "a cloud of several rows: write each as a profile of its own"
    fields = [field for field in cloud.fields if field.name in ("x", "z")]
    forms = [(">" if cloud.is_bigendian else "<") + KINDS[field.datatype] for field in fields]
    names, offsets = [field.name for field in fields], [field.offset for field in fields]
    layout = np.dtype({"names": names, "formats": forms, "offsets": offsets, "itemsize": cloud.point_step})
    points = np.frombuffer(cloud.data.tobytes(), layout, cloud.width)
    both = np.stack([points["x"], points["z"]], axis=1).astype(float) * MM
    both[~np.isfinite(both).all(axis=1) | (both == 0).all(axis=1)] = np.nan
    return both


def pose(message):
    """x, y, z in mm and qw, qx, qy, qz of a PoseStamped, Odometry or TransformStamped."""
    found = message.transform if hasattr(message, "transform") else getattr(message.pose, "pose", message.pose)
    moved = hasattr(found, "rotation")
    place, turn = (found.translation, found.rotation) if moved else (found.position, found.orientation)
    return [place.x * MM, place.y * MM, place.z * MM, turn.w, turn.x, turn.y, turn.z]


frames, poses = [], []
with AnyReader([Path(sys.argv[1])], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
    for topic, _, raw in bag.messages([one for one in bag.connections if one.topic in sys.argv[2:]]):
        read = bag.deserialize(raw, topic.msgtype)
        for message in getattr(read, "transforms", [read]):
            time_s = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            if topic.topic == sys.argv[2]:
                points = profile(message)
                count = len(points)
                frames.append(np.column_stack([np.full(count, len(frames)), np.full(count, time_s), points]))
            elif not hasattr(read, "transforms") or message.child_frame_id == FLANGE:
                poses.append([time_s, *pose(message)])
table = {"fmt": "%.16g", "delimiter": ",", "comments": ""}
np.savetxt("profiles.csv", np.concatenate(frames), header="frame,time_s,x_mm,z_mm", **table)
np.savetxt("poses.csv", np.unique(poses, axis=0), header="time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz", **table)
